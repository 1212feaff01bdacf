//! Where people were in the last pictures of a film: who is seen nowhere near is more likely a thing.

use std::collections::VecDeque;

use edgecap_client::message::Observation;

use super::bounds::bounds;

/// How long it is remembered where people were, nanoseconds.
const REMEMBERED_NS: u64 = 5_000_000_000;
/// From one picture that is remembered to the next.
const APART_NS: u64 = 250_000_000;
/// How far somebody goes beyond the box they were in, share of its longer side: who falls comes to lie beside it.
const REACH: f32 = 0.5;

/// The boxes of people in some of the last pictures.
#[derive(Debug, Clone, Default)]
pub struct Lately {
    pictures: VecDeque<(u64, Vec<[[f32; 2]; 2]>)>,
}

impl Lately {
    /// These people are in the picture of `now`, nanoseconds.
    pub fn seen(&mut self, now: u64, people: &[Observation]) {
        // What is of the future is of a clock that went backwards.
        self.pictures
            .retain(|(then, _)| *then <= now && now - then < REMEMBERED_NS);
        let last = self.pictures.back().map(|(then, _)| *then);
        if !people.is_empty() && last.is_none_or(|last| now - last >= APART_NS) {
            self.pictures
                .push_back((now, people.iter().map(bounds).collect()));
        }
    }

    /// Whether anybody was near this place.
    pub fn is_near(&self, person: &Observation) -> bool {
        let here = bounds(person);
        let boxes = self.pictures.iter().flat_map(|(_, boxes)| boxes);
        boxes.into_iter().any(|&[low, high]| {
            let reach = REACH * (high[0] - low[0]).max(high[1] - low[1]);
            (0..2).all(|k| here[0][k] <= high[k] + reach && here[1][k] >= low[k] - reach)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn person(u: f32) -> Observation {
        let mut p = Observation::default();
        for (j, joint) in p.joints2d.iter_mut().enumerate() {
            *joint = [u + (j % 2) as f32 * 40.0, 100.0 + 10.0 * j as f32, 0.9];
        }
        p
    }

    #[test]
    fn who_falls_lies_near_and_things_far_away_do_not() {
        let mut lately = Lately::default();
        assert!(!lately.is_near(&person(100.0)));
        lately.seen(SECOND, &[person(100.0)]);
        for (u, expected) in [(100.0, true), (190.0, true), (10.0, true), (230.0, false)] {
            assert_eq!(lately.is_near(&person(u)), expected, "{u}");
        }
        assert!(
            !lately.is_near(&Observation::default()),
            "nobody is nowhere"
        );
    }

    #[test]
    fn a_while_later_it_is_forgotten_and_memory_does_not_grow() {
        let mut lately = Lately::default();
        for k in 0..1000 {
            lately.seen(k * SECOND / 30, &[person(100.0)]);
        }
        assert!(lately.pictures.len() <= 21, "{}", lately.pictures.len());
        let last = 999 * SECOND / 30;
        lately.seen(last + 4 * SECOND, &[]);
        assert!(lately.is_near(&person(100.0)));
        lately.seen(last + 6 * SECOND, &[]);
        assert!(!lately.is_near(&person(100.0)));
    }

    #[test]
    fn a_clock_that_goes_backwards_begins_anew() {
        let mut lately = Lately::default();
        lately.seen(90 * SECOND, &[person(100.0)]);
        lately.seen(SECOND, &[person(600.0)]);
        assert!(lately.is_near(&person(600.0)) && !lately.is_near(&person(100.0)));
    }
}
