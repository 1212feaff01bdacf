//! Numbers and ids of bodies. Those of observations, which begin anew with another `infer` or another record, and those
//! of a `fit` that counts people from 1 go in; what comes out goes on after what a `fit` of the same run has published,
//! and goes back only with another run: so readers of a record know that ids begin anew. A `fit` that nobody supervises
//! follows none: its ids begin at 1, and its numbers are lower than those before only where `infer` began anew, too, or
//! with several cameras. A replay numbers what its record holds in the same way.

use edgecap_client::message::BodyFrame;
use serde::{Deserialize, Serialize};

/// What was published by the `fit` in whose place another one works; zeros where there was none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Before {
    /// The number of its newest frame. The bodies of the same observation have it again.
    pub number: u64,
    /// The highest id that it has given.
    pub id: u32,
}

/// Has bodies go on where those before were.
#[derive(Debug)]
pub struct Succession {
    numbers: Numbers,
    from: u32,
}

impl Succession {
    /// Of the `fit` that follows.
    pub fn after(before: Before) -> Self {
        Self {
            numbers: Numbers::after(before.number),
            from: before.id,
        }
    }

    /// Gives a frame as the fit has made it, with the number of its observation, its number and ids.
    pub fn go_on(&mut self, frame: &mut BodyFrame) {
        frame.sequence = self.numbers.go_on(frame.sequence);
        let count = frame.bodies().len();
        for body in &mut frame.bodies[..count] {
            body.id = body.id.saturating_add(self.from);
        }
    }
}

/// Keeps numbers from going back.
#[derive(Debug, Default)]
pub struct Numbers {
    newest: u64,
    /// What is added to those of the observations.
    offset: u64,
    /// Whether the next observation is another one whatever its number.
    begins_anew: bool,
}

impl Numbers {
    /// Those that go on after this one.
    pub fn after(newest: u64) -> Self {
        Self {
            newest,
            ..Self::default()
        }
    }

    /// The number of the bodies of an observation: the same again for the same one.
    pub fn go_on(&mut self, observed: u64) -> u64 {
        let begins_anew = std::mem::take(&mut self.begins_anew);
        if begins_anew || observed.saturating_add(self.offset) < self.newest {
            self.offset = self.newest.saturating_add(1).saturating_sub(observed);
        }
        self.newest = observed.saturating_add(self.offset);
        self.newest
    }

    /// Says that what comes next is no observation of before.
    pub fn begin_anew(&mut self) {
        self.begins_anew = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_begins_anew_goes_on_where_the_last_one_was() {
        let mut numbers = Numbers::default();
        let seen = [7, 7, 9, 0, 0, 1, 4, 2, u64::MAX, 3];
        let given = seen.map(|n| numbers.go_on(n));
        let most = u64::MAX;
        assert_eq!(given, [7, 7, 9, 10, 10, 11, 14, 15, most, most]);
    }

    #[test]
    fn another_fit_of_a_run_gives_no_id_again_and_no_smaller_number() {
        let before = Before {
            number: 5000,
            id: 3,
        };
        // One of a room counts its instants from 0; that of a camera goes on with the numbers of `infer`.
        for (observed, given) in [([0, 1], [5001, 5002]), ([5000, 5007], [5000, 5007])] {
            let mut bodies = Succession::after(before);
            for (observed, given) in observed.into_iter().zip(given) {
                let mut frame = BodyFrame {
                    sequence: observed,
                    count: 2,
                    ..BodyFrame::default()
                };
                (frame.bodies[0].id, frame.bodies[1].id) = (1, 2);
                bodies.go_on(&mut frame);
                let ids = frame.bodies().iter().map(|b| b.id);
                assert_eq!(ids.collect::<Vec<_>>(), [4, 5]);
                assert_eq!(frame.sequence, given);
            }
        }
    }

    #[test]
    fn another_one_of_the_same_number_has_the_next() {
        let mut numbers = Numbers::default();
        let mut given = Vec::new();
        for _ in 0..3 {
            given.extend([70, 71, 0, 1].map(|n| numbers.go_on(n)));
            numbers.begin_anew();
        }
        assert_eq!(given, (70..82).collect::<Vec<_>>());
        numbers.go_on(5);
        numbers.begin_anew();
        assert_eq!(numbers.go_on(5), 83);
    }
}
