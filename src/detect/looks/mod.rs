//! What two looks at one picture show, at different sizes, goes in; everybody comes out once: as the better look has
//! them, joints where both looks together put them.

mod bounds;
mod lately;
mod lying;

use edgecap_client::message::Observation;

use super::confidence::size;
pub use lately::Lately;
pub use lying::{SIDES, join_turned, leaning, lone_lying_score};

/// Two reports whose joints are this similar, 0–1, are one person.
const SAME: f32 = 0.4;
/// Distance of two joints, over the person's size, at which they count as similar by `exp(-1/2)`.
const SPREAD: f32 = 0.09;
/// Joints that both reports must have before they can be told to be one person.
const SHARED: usize = 2;
/// Distance of two joints, over the person's size, up to which both looks mean the same place.
const AGREED: f32 = 0.05;
/// Confidence that weighs least and most as odds, so that nothing is divided by 0.
const ODDS: [f32; 2] = [0.01, 0.99];

/// Joins what two looks at the same picture report, in pixels of that picture, into `out`, by falling score: `most` of
/// them.
///
/// Who is in both is taken from the look that is surer of the joints, and each joint on which both agree from both
/// (`agreed`). Who is in one alone must be there with a probability of `lone_score`, and must not be a part of
/// somebody whom the other look reports.
pub fn joined(
    looks: [&[Observation]; 2],
    lone_score: f32,
    most: usize,
    out: &mut Vec<Observation>,
) {
    let [a, b] = looks;
    let alike: Vec<Vec<f32>> = a
        .iter()
        .map(|p| b.iter().map(|q| similarity(p, q)).collect())
        .collect();
    let mut pairs: Vec<(usize, usize)> = (0..a.len())
        .flat_map(|i| (0..b.len()).map(move |j| (i, j)))
        .filter(|&(i, j)| alike[i][j] >= SAME)
        .collect();
    pairs.sort_by(|&(i, j), &(k, l)| alike[k][l].total_cmp(&alike[i][j]));
    let (mut of_a, mut of_b) = (vec![false; a.len()], vec![false; b.len()]);
    out.clear();
    for (i, j) in pairs {
        if !of_a[i] && !of_b[j] {
            (of_a[i], of_b[j]) = (true, true);
            out.push(if sureness(&a[i]) >= sureness(&b[j]) {
                agreed(&a[i], &b[j])
            } else {
                agreed(&b[j], &a[i])
            });
        }
    }
    let known_to_b = |i: usize| alike[i].iter().any(|&s| s >= SAME);
    let known_to_a = |j: usize| alike.iter().any(|row| row[j] >= SAME);
    let alone = |p: &Observation, known: bool| !known && p.score >= lone_score;
    out.extend(
        (0..a.len())
            .filter(|&i| alone(&a[i], known_to_b(i)))
            .map(|i| a[i]),
    );
    out.extend(
        (0..b.len())
            .filter(|&j| alone(&b[j], known_to_a(j)))
            .map(|j| b[j]),
    );
    out.sort_by(|p, q| q.score.total_cmp(&p.score));
    out.truncate(most);
}

/// The surer report, its evidence joints moved to the mean of both looks where these lie within [`AGREED`] of each
/// other: their errors are of different inputs, so part of them cancels. Weights are the odds of the confidences, of
/// which the higher stays. A joint that only one of the two has, or that they put elsewhere, is the surer report's, as
/// is 3D.
fn agreed(surer: &Observation, other: &Observation) -> Observation {
    let near = AGREED * size(&surer.joints2d).max(size(&other.joints2d));
    let odds = |confidence: f32| {
        let confidence = confidence.clamp(ODDS[0], ODDS[1]);
        confidence / (1.0 - confidence)
    };
    let mut person = *surer;
    for (joint, &[u, v, confidence]) in person.joints2d.iter_mut().zip(&other.joints2d) {
        let both = joint[2] > 0.0 && confidence > 0.0;
        if both && (joint[0] - u).hypot(joint[1] - v) <= near {
            let share = odds(confidence) / (odds(joint[2]) + odds(confidence));
            joint[0] += share * (u - joint[0]);
            joint[1] += share * (v - joint[1]);
            joint[2] = joint[2].max(confidence);
        }
    }
    person
}

/// Joints that can be expected to be right.
fn sureness(p: &Observation) -> f32 {
    p.joints2d.iter().map(|[_, _, c]| c).sum()
}

/// How alike two reports are, 0–1: mean over the joints that both have.
fn similarity(p: &Observation, q: &Observation) -> f32 {
    let size = size(&p.joints2d).max(size(&q.joints2d));
    if size <= 0.0 {
        return 0.0;
    }
    let both = p.joints2d.iter().zip(&q.joints2d);
    let near: Vec<f32> = both
        .filter(|(a, b)| a[2] > 0.0 && b[2] > 0.0)
        .map(|(a, b)| {
            let apart = (a[0] - b[0]).hypot(a[1] - b[1]) / (SPREAD * size);
            (-0.5 * apart * apart).exp()
        })
        .collect();
    if near.len() < SHARED {
        return 0.0;
    }
    near.iter().sum::<f32>() / near.len() as f32
}

#[cfg(test)]
mod tests {
    use edgecap_client::joints::EVIDENCE_JOINTS;
    use edgecap_client::message::MAX_PEOPLE;

    use super::*;

    /// Somebody at `u`, `tall` pixels from the first joint to the last.
    fn person(u: f32, tall: f32, sure: f32, score: f32) -> Observation {
        let mut p = Observation {
            score,
            ..Observation::default()
        };
        for (j, joint) in p.joints2d.iter_mut().enumerate() {
            let down = j as f32 / (EVIDENCE_JOINTS - 1) as f32;
            *joint = [u + 0.1 * tall * (j % 2) as f32, 100.0 + down * tall, sure];
        }
        p
    }

    fn join(a: &[Observation], b: &[Observation]) -> Vec<Observation> {
        let mut out = vec![person(0.0, 1.0, 1.0, 1.0)];
        joined([a, b], 0.75, MAX_PEOPLE, &mut out);
        out
    }

    #[test]
    fn who_is_seen_twice_comes_once_as_the_surer_look_has_them() {
        let (far, near) = (person(50.0, 80.0, 0.4, 0.9), person(57.0, 80.0, 0.8, 0.6));
        for found in [join(&[far], &[near]), join(&[near], &[far])] {
            assert_eq!(found, [near]);
        }
        assert_eq!(join(&[far], &[far]), [far]);
    }

    #[test]
    fn a_joint_on_which_both_looks_agree_lies_between_them_by_their_odds() {
        // Odds of 1 and 4.
        let (far, mut near) = (person(50.0, 80.0, 0.5, 0.9), person(52.0, 80.0, 0.8, 0.6));
        near.joints2d[5] = [0.0, 0.0, 0.0];
        near.joints2d[6][1] -= 10.0;
        for found in [join(&[far], &[near]), join(&[near], &[far])] {
            let [found] = found[..] else {
                panic!("expected one person, found {found:?}");
            };
            for (j, (found, near)) in found.joints2d.iter().zip(&near.joints2d).enumerate() {
                // What the surer look has not, or puts elsewhere, stays its own.
                let u = if matches!(j, 5 | 6) {
                    near[0]
                } else {
                    near[0] - 0.4
                };
                assert!((found[0] - u).abs() < 1e-4, "{j}: {} {u}", found[0]);
                assert_eq!(found[1..], near[1..], "{j}");
            }
            assert_eq!(found.score, near.score);
        }
        let (sure, certain) = (person(50.0, 80.0, 1.0, 0.9), person(52.0, 80.0, 1.0, 0.9));
        let found = join(&[sure], &[certain])[0].joints2d[0];
        assert!(
            (found[0] - 51.0).abs() < 1e-4 && found[2] == 1.0,
            "{found:?}"
        );
    }

    #[test]
    fn who_is_seen_once_must_be_sure() {
        let (sure, unsure) = (person(50.0, 80.0, 0.5, 0.8), person(300.0, 80.0, 0.5, 0.6));
        assert_eq!(join(&[sure], &[unsure]), [sure]);
        assert_eq!(join(&[unsure], &[sure]), [sure]);
        assert_eq!(join(&[unsure, sure], &[]), [sure]);
        assert_eq!(join(&[], &[]), []);
    }

    #[test]
    fn a_part_of_somebody_is_nobody_new() {
        let whole = person(50.0, 200.0, 0.5, 0.8);
        let mut part = person(50.0, 200.0, 0.9, 0.95);
        for joint in &mut part.joints2d[5..] {
            joint[2] = 0.0;
        }
        // Two of one look, one of the other: the second of the two is known already.
        let found = join(&[whole], &[whole, part]);
        assert_eq!(found, [whole]);
    }

    #[test]
    fn who_stand_side_by_side_stay_two_by_falling_score() {
        let (left, right) = (person(50.0, 80.0, 0.5, 0.8), person(120.0, 80.0, 0.5, 0.9));
        assert_eq!(join(&[left, right], &[right, left]), [right, left]);
    }

    #[test]
    fn no_more_than_are_wanted_and_those_the_best() {
        let at = |k: u32, score| person(200.0 * k as f32, 80.0, 0.5, score);
        let (a, b) = ([at(0, 0.9), at(1, 0.8)], [at(2, 0.95), at(3, 0.85)]);
        for most in 0..=4 {
            let mut out = Vec::new();
            joined([&a, &b], 0.75, most, &mut out);
            assert_eq!(out, [b[0], a[0], b[1], a[1]][..most]);
        }
    }

    #[test]
    fn no_more_than_a_message_holds() {
        let row = |first: usize| -> Vec<_> {
            (first..first + MAX_PEOPLE)
                .map(|k| person(200.0 * k as f32, 80.0, 0.5, 0.9))
                .collect()
        };
        assert_eq!(join(&row(0), &row(MAX_PEOPLE)).len(), MAX_PEOPLE);
    }

    #[test]
    fn without_joints_nobody_is_the_same() {
        let blank = Observation {
            score: 0.9,
            ..Observation::default()
        };
        assert_eq!(join(&[blank], &[blank]), [blank, blank]);
    }
}
