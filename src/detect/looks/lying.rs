//! Who lies or hangs in a picture: how far it has to be turned for them, and what a look at the turned one adds.

use edgecap_client::joints::{HIPS, NECK};
use edgecap_client::message::Observation;

use super::bounds::bounds;
use super::{SAME, agreed, similarity, sureness};

/// Whose trunk leans by more than this, degrees, is looked at in a turned picture, too.
const LEANING: f32 = 30.0;
/// Who is upside down by more than this, degrees, would lie in either turned picture, and is looked at in both.
const HANGING: f32 = 135.0;
/// A turned picture speaks of people alone whose trunk leans by at least this, degrees: others it shows on their side.
const SIDEWAYS: f32 = 40.0;
/// Two reports that share this much of the smaller one's box, but few joints, are of one person, or of people who hide
/// each other.
const COVERED: f32 = 0.5;
/// By so much the odds must be better of who is seen in a turned photo alone: few people lie, and among what stands in
/// rooms more looks like one on its side.
const ODDS: f32 = 2.0;

/// The two ways of laying a picture on its side, quarter turns clockwise.
pub const SIDES: [u8; 2] = [1, 3];

/// Which of [`SIDES`] suit those who lean in the picture: they put upright who lies, and lay down who hangs.
pub fn leaning(people: &[Observation]) -> [bool; 2] {
    let mut sides = [false; 2];
    for angle in people.iter().filter_map(lean) {
        if angle.abs() > LEANING {
            let hangs = angle.abs() > HANGING;
            sides[0] |= hangs || angle < 0.0;
            sides[1] |= hangs || angle > 0.0;
        }
    }
    sides
}

/// Least probability of who is seen in a turned photo alone, where it is `lone_score` of others.
pub fn lone_lying_score(lone_score: f32) -> f32 {
    ODDS * lone_score / (1.0 + (ODDS - 1.0) * lone_score)
}

/// Adds what a turned picture shows, in pixels and axes of the upright one, to the `people` who are known, of whom
/// `most` stay by falling score. Says whether that added or exchanged anybody.
///
/// Only who leans counts. Who is known like that already is taken as [`joined`](super::joined) does. Where somebody is
/// known in another pose the surer look is right. Where nobody is, the probability must be the `least` for that person.
pub fn join_turned(
    people: &mut Vec<Observation>,
    turned: &[Observation],
    least: impl Fn(&Observation) -> f32,
    most: usize,
) -> bool {
    let mut brought = false;
    let leaning = |p: &&Observation| lean(p).is_some_and(|angle| angle.abs() >= SIDEWAYS);
    for person in turned.iter().filter(leaning) {
        let alike = people
            .iter_mut()
            .map(|known| (similarity(known, person), known));
        let most_alike = alike.max_by(|(a, _), (b, _)| a.total_cmp(b));
        if let Some((_, known)) = most_alike.filter(|(alike, _)| *alike >= SAME) {
            if sureness(known) >= sureness(person) {
                *known = agreed(known, person);
            } else {
                *known = agreed(person, known);
                brought = true;
            }
            continue;
        }
        let mut there = people
            .iter_mut()
            .filter(|known| covered(known, person) >= COVERED);
        match (there.next(), there.next()) {
            (None, _) if person.score >= least(person) => people.push(*person),
            (Some(known), None) if sureness(person) > sureness(known) => *known = *person,
            _ => continue,
        }
        brought = true;
    }
    people.sort_by(|p, q| q.score.total_cmp(&p.score));
    people.truncate(most);
    brought
}

/// How far somebody leans from upright, degrees: positive with the head to the right of the hips. `None` where neck or
/// hips are not seen.
fn lean(p: &Observation) -> Option<f32> {
    let seen = |j: usize| Some(p.joints2d[j]).filter(|joint| joint[2] > 0.0);
    let [u, v, _] = seen(NECK)?;
    let hips: Vec<[f32; 3]> = HIPS.into_iter().filter_map(seen).collect();
    let count = hips.len() as f32;
    let mean = |k: usize| hips.iter().map(|hip| hip[k]).sum::<f32>() / count;
    (!hips.is_empty()).then(|| (u - mean(0)).atan2(mean(1) - v).to_degrees())
}

/// The share of the smaller box round the seen joints that lies in the other.
fn covered(p: &Observation, q: &Observation) -> f32 {
    let [a, b] = [p, q].map(bounds);
    let side = |k: usize| a[1][k].min(b[1][k]) - a[0][k].max(b[0][k]);
    let area = |[low, high]: [[f32; 2]; 2]| (high[0] - low[0]) * (high[1] - low[1]);
    let smaller = area(a).min(area(b));
    if smaller > 0.0 {
        side(0).max(0.0) * side(1).max(0.0) / smaller
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use edgecap_client::message::MAX_PEOPLE;

    use super::*;

    /// Somebody whose trunk, from the neck at `u`, `v` on, leans by so many degrees.
    fn person(angle: f32, [u, v]: [f32; 2], sure: f32, score: f32) -> Observation {
        let mut p = Observation {
            score,
            ..Observation::default()
        };
        let (sin, cos) = angle.to_radians().sin_cos();
        for (j, joint) in p.joints2d.iter_mut().enumerate() {
            let down = 20.0 * (j as f32 - NECK as f32);
            let across = if j % 2 == 0 { 30.0 } else { -30.0 } * f32::from(u8::from(j != NECK));
            *joint = [
                u - down * sin + across * cos,
                v + down * cos + across * sin,
                sure,
            ];
        }
        p
    }

    #[test]
    fn the_picture_is_turned_for_those_who_lean() {
        let at = [300.0, 100.0];
        for (angle, expected) in [
            (0.0, [false, false]),
            (20.0, [false, false]),
            (-20.0, [false, false]),
            (70.0, [false, true]),
            (-70.0, [true, false]),
            (170.0, [true, true]),
            (-170.0, [true, true]),
        ] {
            assert_eq!(leaning(&[person(angle, at, 0.5, 0.9)]), expected, "{angle}");
        }
        let [right, left] = [60.0, -60.0].map(|angle| person(angle, at, 0.5, 0.9));
        assert_eq!(
            leaning(&[right, left, person(0.0, at, 0.5, 0.9)]),
            [true; 2]
        );
        assert_eq!(leaning(&[]), [false; 2]);
        let mut unknown = person(90.0, at, 0.5, 0.9);
        unknown.joints2d[NECK][2] = 0.0;
        assert_eq!(leaning(&[unknown]), [false; 2]);
    }

    /// Who is then known, and whether the turned look is why.
    fn join(people: &[Observation], turned: &[Observation]) -> (Vec<Observation>, bool) {
        let mut people = people.to_vec();
        let brought = join_turned(&mut people, turned, |_| 0.9, MAX_PEOPLE);
        (people, brought)
    }

    #[test]
    fn who_lies_and_was_misread_is_taken_from_the_surer_look() {
        let at = [300.0, 300.0];
        // The same place, head and feet exchanged.
        let [right, wrong] = [(90.0, at, 0.8), (-90.0, [100.0, 300.0], 0.5)]
            .map(|(angle, at, sure)| person(angle, at, sure, 0.9));
        assert!(similarity(&right, &wrong) < SAME && covered(&right, &wrong) > COVERED);
        assert_eq!(join(&[wrong], &[right]), (vec![right], true));
        assert_eq!(join(&[right], &[wrong]), (vec![right], false));
    }

    #[test]
    fn who_is_found_by_both_comes_once_between_them() {
        let [known, same] = [300.0, 302.0].map(|u| person(80.0, [u, 300.0], 0.8, 0.9));
        let (found, brought) = join(&[known], &[same]);
        assert_eq!(
            (found.len(), brought),
            (1, false),
            "the known look would have done"
        );
        assert!((found[0].joints2d[NECK][0] - 301.0).abs() < 1e-3);
    }

    #[test]
    fn who_is_new_must_lean_and_be_sure() {
        let known = person(0.0, [100.0, 100.0], 0.5, 0.95);
        let new = |angle, score| person(angle, [600.0, 300.0], 0.5, score);
        let both = |score| join(&[known], &[new(90.0, score)]);
        assert_eq!(both(0.92), (vec![known, new(90.0, 0.92)], true));
        assert_eq!(both(0.99), (vec![new(90.0, 0.99), known], true));
        assert_eq!(both(0.8), (vec![known], false));
        assert_eq!(join(&[known], &[new(10.0, 0.99)]), (vec![known], false));
        let mut people = vec![known];
        let nowhere = |_: &Observation| f32::INFINITY;
        assert!(!join_turned(&mut people, &[new(90.0, 0.99)], nowhere, 5));
        join_turned(&mut people, &[new(90.0, 0.99)], |_| 0.9, 1);
        assert_eq!(people, [new(90.0, 0.99)], "no more than are wanted");
    }

    #[test]
    fn photos_ask_twice_the_odds_of_who_lies_alone() {
        // 9 to 1 become 18 to 1.
        assert!((lone_lying_score(0.9) - 18.0 / 19.0).abs() < 1e-6);
        assert_eq!((lone_lying_score(0.0), lone_lying_score(1.0)), (0.0, 1.0));
    }

    #[test]
    fn among_people_who_hide_each_other_nobody_is_exchanged() {
        let both = [0.0, 40.0].map(|u| person(0.0, [300.0 + u, 100.0], 0.5, 0.95));
        let across = person(60.0, [430.0, 130.0], 0.9, 0.99);
        assert!(both.iter().all(|known| covered(known, &across) >= COVERED));
        assert_eq!(join(&both, &[across]), (both.to_vec(), false));
    }
}
