//! In: evidence of a known person, placed in space. Out: the evidence without joints that contradict the rest.
//!
//! Stage I invents limbs that it cannot see, e.g. short legs for somebody behind a counter. What trunk, head and
//! shoulders say about place and size stands; a joint that lies elsewhere in the picture is treated as not seen,
//! together with those that hang on it, so that it pulls neither the root nor the pose. It comes back after it has
//! agreed for as long as it has been doubted, at most a while: a single bad frame costs no other, a lasting
//! contradiction does not flicker.

use super::Evidence;
use super::root::disagreement;
use crate::joints::{
    EVIDENCE_JOINTS, L_ANKLE, L_ELBOW, L_HIP, L_KNEE, L_WRIST, R_ANKLE, R_ELBOW, R_HIP, R_KNEE,
    R_WRIST,
};

/// Joints that may be doubted, each after the one it hangs on, and that one.
const DOUBTABLE: [(usize, Option<usize>); 10] = [
    (R_ELBOW, None),
    (R_WRIST, Some(R_ELBOW)),
    (L_ELBOW, None),
    (L_WRIST, Some(L_ELBOW)),
    (R_HIP, None),
    (R_KNEE, Some(R_HIP)),
    (R_ANKLE, Some(R_KNEE)),
    (L_HIP, None),
    (L_KNEE, Some(L_HIP)),
    (L_ANKLE, Some(L_KNEE)),
];
/// Disagreement, metres at the person's distance, above which a joint is not believed …
const DOUBTED: f64 = 0.22;
/// … and below which it is again …
const BELIEVED: f64 = 0.14;
/// … after at most this long, seconds.
const CALM: f64 = 0.3;
/// Share of an interval that is owed no more: frames do not come at equal intervals, and one bad frame would cost two
/// wherever the next one comes a little sooner.
const FORGIVEN: f64 = 0.5;

/// Which joints of a person are not believed at the moment: seconds of agreement that each still owes.
#[derive(Debug, Clone, Copy, Default)]
pub struct Trust {
    owed: [f64; EVIDENCE_JOINTS],
    /// Seconds between the last two frames.
    last: f64,
}

impl Trust {
    /// Judges the first evidence of a person.
    pub fn first(evidence: &mut Evidence) -> Self {
        let mut trust = Self::default();
        trust.judge(evidence, CALM);
        trust.last = 0.0;
        trust
    }

    /// Judges every joint, `dt` seconds after the last time, and takes those that are not believed out of the evidence.
    /// Without a root what was doubted stays doubted.
    pub fn judge(&mut self, evidence: &mut Evidence, dt: f64) {
        // A bad frame after a dropped one owes two intervals, and costs no other one either.
        let paid = dt.max(self.last);
        self.last = dt;
        for (joint, parent) in DOUBTABLE {
            let owed = &mut self.owed[joint];
            if let Some(root) = evidence.root.filter(|_| evidence.confidence[joint] > 0.0) {
                let most = if *owed > 0.0 { BELIEVED } else { DOUBTED };
                *owed = if disagreement(evidence, root, joint) > most {
                    (*owed + dt).min(CALM)
                } else {
                    let rest = *owed - paid;
                    if rest < FORGIVEN * dt { 0.0 } else { rest }
                };
            }
            if self.doubts(joint) || parent.is_some_and(|p| self.doubts(p)) {
                evidence.confidence[joint] = 0.0;
            }
            // Doubt reaches to the end of the limb.
            if parent.is_some_and(|p| self.doubts(p)) {
                self.owed[joint] = self.owed[joint].max(dt);
            }
        }
    }

    fn doubts(&self, joint: usize) -> bool {
        self.owed[joint] > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::{ANKLES, HEAD_TOP, L_SHOULDER, NECK, R_SHOULDER};
    use glam::{DVec2, DVec3};

    /// Somebody of whom every joint lies 3 m away on the axis, but for `wrong`, off by half a metre.
    fn evidence(wrong: &[usize]) -> Evidence {
        let mut plane = [DVec2::ZERO; EVIDENCE_JOINTS];
        for &j in wrong {
            plane[j].y = -0.5 / 3.0;
        }
        Evidence {
            plane,
            confidence: [0.8; EVIDENCE_JOINTS],
            points3d: [DVec3::ZERO; crate::joints::BODY_JOINTS],
            known3d: true,
            tells3d: [true; crate::joints::BODY_JOINTS],
            root: Some(DVec3::new(0.0, 0.0, 3.0)),
            score: 0.8,
        }
    }

    fn left_out(trust: &mut Trust, wrong: &[usize]) -> Vec<usize> {
        left_out_after(trust, wrong, 0.03)
    }

    fn left_out_after(trust: &mut Trust, wrong: &[usize], dt: f64) -> Vec<usize> {
        let mut e = evidence(wrong);
        trust.judge(&mut e, dt);
        (0..EVIDENCE_JOINTS)
            .filter(|&j| e.confidence[j] == 0.0)
            .collect()
    }

    #[test]
    fn doubt_reaches_outwards_and_lasts_as_long_as_the_contradiction_did() {
        let mut trust = Trust::default();
        assert_eq!(left_out(&mut trust, &[R_KNEE]), [R_KNEE, R_ANKLE]);
        // One bad frame is forgotten at the next good one.
        assert_eq!(left_out(&mut trust, &[]), [] as [usize; 0]);
        for _ in 0..40 {
            assert_eq!(left_out(&mut trust, &[R_WRIST]), [R_WRIST]);
        }
        let frames = (0..40)
            .take_while(|_| !left_out(&mut trust, &[]).is_empty())
            .count();
        assert!((8..=10).contains(&frames), "{frames}");
        // Head, neck and shoulders are what the rest is judged by.
        assert!(left_out(&mut trust, &[HEAD_TOP, NECK, R_SHOULDER, L_SHOULDER]).is_empty());
        // From the first sight on a contradiction is doubted in full.
        let mut e = evidence(&ANKLES);
        let mut trust = Trust::first(&mut e);
        assert_eq!(ANKLES.map(|j| e.confidence[j]), [0.0; 2]);
        assert!(left_out(&mut trust, &[]) == ANKLES);
    }

    #[test]
    fn one_bad_frame_costs_no_other_whatever_the_interval() {
        for [bad, good] in [
            [0.0334, 0.0332],
            [0.0332, 0.0334],
            [0.03, 0.021],
            [0.0667, 0.0333],
        ] {
            let mut trust = Trust::default();
            for _ in 0..10 {
                assert_eq!(
                    left_out_after(&mut trust, &[R_KNEE], bad),
                    [R_KNEE, R_ANKLE]
                );
                assert!(left_out_after(&mut trust, &[], good).is_empty());
            }
        }
    }
}
