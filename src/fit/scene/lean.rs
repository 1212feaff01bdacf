//! In: people as they were seen, and where up is. Out: by how much they all seem to lean towards the camera or away
//! from it.
//!
//! Single pictures hardly tell how steeply a camera looks down. Stage II takes the usual for granted, so that before
//! another camera everybody leans alike, by ten degrees and more. People do not: whoever stands or walks has their
//! centre of mass over their feet, on average (Winter 1995, Human balance and posture control during standing and
//! walking).

use std::f64::consts::PI;

use glam::{DQuat, DVec3};

use crate::fit::evidence::{Evidence, disagreement};
use crate::joints::{
    BODY_JOINTS, EVIDENCE_JOINTS, HEAD_TOP, L_ANKLE, L_ELBOW, L_FOOT_TIP, L_HIP, L_KNEE,
    L_SHOULDER, L_WRIST, NECK, PELVIS, R_ANKLE, R_ELBOW, R_FOOT_TIP, R_HIP, R_KNEE, R_SHOULDER,
    R_WRIST,
};

/// Shoulder, elbow and wrist of each side.
const ARMS: [[usize; 3]; 2] = [
    [R_SHOULDER, R_ELBOW, R_WRIST],
    [L_SHOULDER, L_ELBOW, L_WRIST],
];
/// Hip, knee, ankle and toes of each side.
const LEGS: [[usize; 4]; 2] = [
    [R_HIP, R_KNEE, R_ANKLE, R_FOOT_TIP],
    [L_HIP, L_KNEE, L_ANKLE, L_FOOT_TIP],
];
/// Where between ankle and toes somebody who stands puts their weight.
const UNDER: f64 = 0.4;
/// Greatest angle between trunk and thigh, and between thigh and shank, of a leg that somebody stands on.
const HIP_BENT: f64 = 40.0 * PI / 180.0;
const KNEE_BENT: f64 = 50.0 * PI / 180.0;
/// Whoever seems to lean farther than this does not stand.
const FARTHEST: f64 = 40.0 * PI / 180.0;
/// A single look is believed within so much of all before it.
const BELIEVED: f64 = 10.0 * PI / 180.0;
/// What is known of a lean beforehand: its spread, where the camera is level and as a share of its pitch, …
const LEVEL: f64 = 3.0 * PI / 180.0;
const PITCHED: f64 = 0.3;
/// … the error of looks at one person for a second, and of looks for ever: nobody is in balance all the time.
const SECOND: f64 = 5.0 * PI / 180.0;
const FOR_EVER: f64 = 2.5 * PI / 180.0;
/// What the first look at anybody counts, seconds: later ones err like it for about so long.
const FIRST: f64 = 1.0;
/// More than so many such spreads is not Stage II's: the floor is wrong, or all these people lean.
const MOST: f64 = 2.0;
/// An ankle farther from where its 3D joint is seen, metres, is invented, as legs behind a counter are.
const INVENTED: f64 = 0.22;
/// Sine of the angle to the vertical below which a lean has no direction, and from which it is taken away in full.
const STEEP: [f64; 2] = [0.26, 0.5];
/// Seconds of looks that are remembered.
const MEMORY: f64 = 120.0;
/// Fastest change of the lean that is taken away from people in view, radians per second.
const TURN: f64 = 3.0 * PI / 180.0;

/// By how much people before one camera seem to lean.
#[derive(Debug, Clone, Copy, Default)]
pub struct Lean {
    /// Radians times seconds, and seconds.
    sum: f64,
    weight: f64,
    /// The camera's pitch when that was so, radians.
    pitch: f64,
    applied: f64,
}

impl Lean {
    /// The lean that is taken away, radians; positive: away from the camera.
    #[cfg(test)]
    fn angle(&self) -> f64 {
        self.applied
    }

    /// Takes in the people of a frame, as they were seen, `dt` seconds after the last. `up`: unit vector, camera axes;
    /// `error`: how far it may be off, radians. While anybody is in view (`watched`) what is taken away changes slowly.
    pub fn look(&mut self, seen: &[&Evidence], up: DVec3, error: f64, dt: f64, watched: bool) {
        // The same people lean otherwise where another floor is found.
        let pitch = (-up.z).clamp(-1.0, 1.0).asin();
        self.sum += self.weight * (pitch - self.pitch);
        self.pitch = pitch;
        let leans = seen.iter().filter_map(|evidence| lean(evidence, up));
        let leans: Vec<f64> = leans.collect();
        if !leans.is_empty() {
            // People seen together err alike in part.
            let people = (leans.len() as f64).sqrt();
            let first = self.weight == 0.0;
            let weight = people * if first { FIRST } else { dt };
            let before = self.sum / self.weight.max(f64::MIN_POSITIVE);
            let believed = |lean: f64| {
                if first {
                    lean
                } else {
                    lean.clamp(before - BELIEVED, before + BELIEVED)
                }
            };
            let mean = leans.iter().map(|l| believed(*l)).sum::<f64>() / leans.len() as f64;
            let kept = (MEMORY / (self.weight + weight)).min(1.0);
            self.sum = (self.sum + weight * mean) * kept;
            self.weight = (self.weight + weight) * kept;
        }
        let spread = LEVEL.hypot(PITCHED * pitch);
        let wanted = if self.weight > 0.0 && error.is_finite() {
            let looks = SECOND.powi(2) / self.weight + FOR_EVER.powi(2);
            let share = spread * spread / (spread * spread + looks + error * error);
            (self.sum / self.weight * share).clamp(-MOST * spread, MOST * spread)
        } else {
            0.0
        };
        let most = if watched { TURN * dt } else { f64::INFINITY };
        self.applied += (wanted - self.applied).clamp(-most, most);
    }

    /// Sets somebody upright who leans as everybody does.
    pub fn take_from(&self, evidence: &mut Evidence, up: DVec3) {
        if let Some(axes) = Axes::of(evidence, up).filter(|_| self.applied != 0.0) {
            let angle = self.applied * axes.clear;
            evidence.turn(DQuat::from_axis_angle(axes.across, angle));
        }
    }
}

/// Level directions from where somebody is.
struct Axes {
    /// To the right as the camera sees them.
    across: DVec3,
    /// Away from the camera.
    away: DVec3,
    /// How clear these directions are, 0 to 1.
    clear: f64,
}

impl Axes {
    /// `None` for whoever is straight below or above the camera.
    fn of(evidence: &Evidence, up: DVec3) -> Option<Self> {
        let seen = (0..EVIDENCE_JOINTS).filter(|&j| evidence.confidence[j] > 0.0);
        let (sum, count) = seen.fold((DVec3::ZERO, 0.0), |(sum, n), j| {
            (sum + evidence.plane[j].extend(1.0), n + 1.0)
        });
        let ray = (sum / count).try_normalize()?;
        let across = ray.cross(up);
        let [none, full] = STEEP;
        let clear = ((across.length() - none) / (full - none)).clamp(0.0, 1.0);
        let across = across.try_normalize().filter(|_| clear > 0.0)?;
        Some(Self {
            across,
            away: up.cross(across),
            clear,
        })
    }
}

/// By how much somebody who stands seems to lean away from the camera, radians; `None` for whoever does not stand.
fn lean(evidence: &Evidence, up: DVec3) -> Option<f64> {
    let seen = |j: &usize| evidence.confidence[*j] > 0.0;
    if !evidence.known3d || !LEGS.iter().flat_map(|leg| &leg[..3]).all(seen) || !seen(&NECK) {
        return None;
    }
    let invented = |&[_, _, ankle, _]: &[usize; 4]| {
        let off = |root| disagreement(evidence, root, ankle);
        evidence.root.is_none_or(|root| off(root) > INVENTED)
    };
    if LEGS.iter().any(invented) {
        return None;
    }
    let p = &evidence.points3d;
    let trunk = p[PELVIS] - p[NECK];
    let stands = LEGS.iter().any(|&[hip, knee, ankle, _]| {
        let (thigh, shank) = (p[knee] - p[hip], p[ankle] - p[knee]);
        trunk.angle_between(thigh) < HIP_BENT && thigh.angle_between(shank) < KNEE_BENT
    });
    let body = centre_of_mass(p) - support(p);
    if !stands || body.angle_between(up) >= FARTHEST {
        return None;
    }
    let axes = Axes::of(evidence, up)?;
    let lean = body.dot(axes.away).atan2(body.dot(up));
    lean.is_finite().then_some(lean)
}

/// Where the weight of somebody who stands on both feet rests.
fn support(p: &[DVec3; BODY_JOINTS]) -> DVec3 {
    let foot = |[_, _, ankle, toes]: [usize; 4]| p[ankle].lerp(p[toes], UNDER);
    LEGS.map(foot).iter().sum::<DVec3>() / 2.0
}

/// Centre of mass by segments (Winter 2009, Biomechanics and Motor Control of Human Movement, table 4.1).
fn centre_of_mass(p: &[DVec3; BODY_JOINTS]) -> DVec3 {
    let hips = p[R_HIP].midpoint(p[L_HIP]);
    let mut sum = 0.081 * p[NECK].lerp(p[HEAD_TOP], 0.6) + 0.497 * p[NECK].midpoint(hips);
    for [shoulder, elbow, wrist] in ARMS {
        sum += 0.028 * p[shoulder].lerp(p[elbow], 0.436);
        sum += 0.016 * p[elbow].lerp(p[wrist], 0.43) + 0.006 * p[wrist];
    }
    for [hip, knee, ankle, toes] in LEGS {
        sum += 0.1 * p[hip].lerp(p[knee], 0.433) + 0.0465 * p[knee].lerp(p[ankle], 0.433);
        sum += 0.0145 * p[ankle].midpoint(p[toes]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::{Pose, Posed, Skeleton};
    use crate::message::{Intrinsics, Observation};

    /// Of the angles after the root's six.
    const R_HIP_FLEXION: usize = 13;
    const R_KNEE_FLEXION: usize = 16;
    const L_HIP_FLEXION: usize = 18;
    const L_KNEE_FLEXION: usize = 21;

    /// Up before a camera that looks down by so many degrees.
    fn up(pitch: f64) -> DVec3 {
        DQuat::from_rotation_x(-pitch.to_radians()) * DVec3::NEG_Y
    }

    /// Somebody `across` metres to the right and 4 m away who turned by `yaw` and stands upright, but seems to lean
    /// away from the camera by `lean` degrees.
    fn somebody(up: DVec3, across: f64, yaw: f64, lean: f64, bend: impl Fn(&mut Pose)) -> Evidence {
        let camera = Intrinsics::from_horizontal_fov(1280, 720, 70.0);
        let skeleton = Skeleton::builtin();
        let mut pose = Pose::facing_camera(4.0);
        pose.position.x = across;
        let upright = DQuat::from_rotation_arc(DVec3::NEG_Y, up);
        pose.rotation = upright * DQuat::from_rotation_y(yaw) * pose.rotation;
        bend(&mut pose);
        let mut posed = Posed::default();
        skeleton.pose(&pose, skeleton.lengths(), &mut posed);
        let axis = pose.position.cross(up).normalize();
        let seems = DQuat::from_axis_angle(axis, -lean.to_radians());
        let mut seen = Observation {
            score: 0.9,
            ..Observation::default()
        };
        for j in 0..EVIDENCE_JOINTS {
            let [u, v] = camera.project(posed.joints[j].as_vec3().to_array());
            seen.joints2d[j] = [u, v, 0.8];
        }
        for j in 0..BODY_JOINTS {
            let point = seems * (posed.joints[j] - pose.position);
            seen.joints3d[j] = point.as_vec3().to_array();
        }
        Evidence::new(&seen, &camera, 0.05).unwrap()
    }

    fn upright(up: DVec3, lean: f64) -> [Evidence; 3] {
        [(-1.0, 0.3), (0.4, 2.0), (1.5, 4.1)].map(|(x, yaw)| somebody(up, x, yaw, lean, |_| {}))
    }

    /// How far trunks are from upright, degrees.
    fn off(people: &[Evidence], up: DVec3) -> f64 {
        let trunks = people.iter().map(|e| e.points3d[NECK].angle_between(up));
        trunks.fold(0.0, f64::max).to_degrees()
    }

    #[test]
    fn who_seems_to_lean_alike_is_set_upright() {
        for (pitch, leans) in [(10.0, 5.0), (25.0, 12.0), (50.0, 15.0), (20.0, -10.0)] {
            let up = up(pitch);
            let mut people = upright(up, leans);
            let was = off(&people, up);
            let mut lean = Lean::default();
            for _ in 0..150 {
                lean.look(&people.each_ref(), up, 0.0, 0.1, true);
            }
            let found = lean.angle().to_degrees();
            assert!((found - leans).abs() < 2.0, "{leans} at {pitch}: {found}");
            people.iter_mut().for_each(|e| lean.take_from(e, up));
            let is = off(&people, up);
            assert!(is < 4.0 && is < was, "{leans} at {pitch}: {was} to {is}");
        }
    }

    #[test]
    fn who_comes_first_is_set_upright_at_once_and_who_is_in_view_slowly() {
        let up = up(30.0);
        let people = upright(up, 12.0);
        let mut lean = Lean::default();
        lean.look(&people.each_ref(), up, 0.0, 1.0 / 30.0, false);
        assert!(lean.angle().to_degrees() > 9.0);
        let mut lean = Lean::default();
        for _ in 0..300 {
            let before = lean.angle();
            lean.look(&people.each_ref(), up, 0.0, 1.0 / 30.0, true);
            assert!((lean.angle() - before).abs() <= TURN / 30.0 + 1e-12);
        }
        assert!(lean.angle().to_degrees() > 10.0);
    }

    #[test]
    fn who_sits_lies_kneels_or_bends_over_tells_nothing() {
        let up = up(20.0);
        let (right, back) = (
            up.cross(DVec3::NEG_Z).normalize(),
            std::f64::consts::FRAC_PI_2,
        );
        let bent = |hips: f64, knees: f64| {
            somebody(up, 0.3, 0.5, 10.0, move |pose| {
                for (joint, angle) in [
                    (R_HIP_FLEXION, hips),
                    (L_HIP_FLEXION, hips),
                    (R_KNEE_FLEXION, knees),
                    (L_KNEE_FLEXION, knees),
                ] {
                    pose.angles[joint] = angle;
                }
            })
        };
        let lies = |axis: DVec3| {
            somebody(up, 0.3, 0.5, 0.0, move |pose| {
                pose.rotation = DQuat::from_axis_angle(axis, back) * pose.rotation;
            })
        };
        let upright = bent(0.0, 0.0);
        assert!(lean(&upright, up).is_some());
        for other in [
            bent(1.5, 1.5),
            bent(0.0, 1.5),
            bent(1.2, 0.1),
            lies(right),
            lies(up.cross(right)),
        ] {
            assert_eq!(lean(&other, up), None);
        }
        let mut unseen = upright;
        unseen.confidence[R_ANKLE] = 0.0;
        assert_eq!(lean(&unseen, up), None, "feet that nobody saw");
    }

    #[test]
    fn a_moment_of_nonsense_counts_little_and_what_was_is_forgotten_in_the_end() {
        let up = up(10.0);
        let (some, other) = (upright(up, 8.0), upright(up, -30.0));
        let mut lean = Lean::default();
        for _ in 0..600 {
            lean.look(&some.each_ref(), up, 0.0, 0.1, false);
        }
        let before = lean.angle();
        for _ in 0..20 {
            lean.look(&other.each_ref(), up, 0.0, 0.1, false);
        }
        assert!((lean.angle() - before).abs().to_degrees() < 0.6);
        let later = upright(up, -3.0);
        for _ in 0..1800 {
            lean.look(&later.each_ref(), up, 0.0, 0.1, false);
        }
        assert!((lean.angle().to_degrees() + 3.0).abs() < 2.0);
    }

    #[test]
    fn nobody_or_who_is_straight_below_changes_nothing() {
        let mut lean = Lean::default();
        lean.look(&[], DVec3::NEG_Y, 0.0, 0.1, false);
        assert_eq!(lean.angle(), 0.0);
        // Upright, before a camera that looks straight down: beside the place below it, and nearly there.
        let up = DVec3::NEG_Z;
        let beside = somebody(up, 3.0, 0.0, 0.0, |_| {});
        assert!(super::lean(&beside, up).is_some());
        let below = somebody(up, 0.3, 0.0, 0.0, |_| {});
        assert_eq!(super::lean(&below, up), None);
        lean.look(&[&below], up, 0.0, 0.1, false);
        assert_eq!(lean.angle(), 0.0);
    }
}
