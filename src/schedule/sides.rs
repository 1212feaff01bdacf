//! When a picture of a film is laid on its side for a look: for who leans, where somebody was lost, and as long as that
//! shows whom the upright picture does not.

/// From one try to the next, nanoseconds, while somebody leans or is lost.
const TRY_NS: u64 = 1_000_000_000;
/// How long it goes on after it last brought somebody.
const GOING_ON_NS: u64 = 1_000_000_000;
/// How long nobody in sight is taken for somebody lost, who may have fallen.
const LOST_NS: u64 = 5_000_000_000;

/// When the picture is looked at on either side. Times are those of pictures, nanoseconds.
#[derive(Debug, Clone, Default)]
pub struct Sides {
    /// When either was last looked at, and when that last brought somebody.
    tried: [Option<u64>; 2],
    brought: [Option<u64>; 2],
    /// When anybody was last in sight.
    seen: Option<u64>,
}

impl Sides {
    /// Which sides the picture of `now` is to be looked at on. What a look at it as it is shows: whether anybody is
    /// there, and which sides suit those who lean.
    pub fn wanted(&mut self, now: u64, is_anybody: bool, leaning: [bool; 2]) -> [bool; 2] {
        let within = |since: Option<u64>, span: u64| {
            // A clock that went backwards begins anew.
            since.is_some_and(|since| since <= now && now - since < span)
        };
        if is_anybody {
            self.seen = Some(now);
        }
        let is_lost = !is_anybody && within(self.seen, LOST_NS);
        [0, 1].map(|side| {
            let goes_on = within(self.brought[side], GOING_ON_NS);
            let is_worth = is_lost || leaning[side];
            goes_on || is_worth && !within(self.tried[side], TRY_NS)
        })
    }

    /// The `wanted` sides of the picture of `now` were looked at, and so they `brought` people whom the upright look
    /// has not, or not as well.
    pub fn looked(&mut self, now: u64, wanted: [bool; 2], brought: [bool; 2]) {
        for side in (0..2).filter(|side| wanted[*side]) {
            self.tried[side] = Some(now);
            if brought[side] {
                self.brought[side] = Some(now);
                self.seen = Some(now);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: u64 = 33_333_333;
    const NO: [bool; 2] = [false; 2];
    const LEFT: [bool; 2] = [false, true];

    /// Of so many pictures from `start` on how many are looked at on either side.
    fn looks(
        sides: &mut Sides,
        start: u64,
        pictures: u64,
        shows: impl Fn(u64) -> (bool, [bool; 2]),
        brings: impl Fn(u64) -> [bool; 2],
    ) -> [u64; 2] {
        let mut count = [0; 2];
        for k in 0..pictures {
            let now = start + k * FRAME;
            let (is_anybody, leaning) = shows(k);
            let wanted = sides.wanted(now, is_anybody, leaning);
            let brought = [0, 1].map(|side| wanted[side] && brings(k)[side]);
            sides.looked(now, wanted, brought);
            count = [0, 1].map(|side| count[side] + u64::from(wanted[side]));
        }
        count
    }

    #[test]
    fn nobody_and_people_who_stand_cost_nothing() {
        let mut sides = Sides::default();
        assert_eq!(looks(&mut sides, 0, 300, |_| (false, NO), |_| NO), [0, 0]);
        assert_eq!(looks(&mut sides, 0, 300, |_| (true, NO), |_| NO), [0, 0]);
    }

    #[test]
    fn who_leans_is_tried_once_a_second_on_one_side() {
        let mut sides = Sides::default();
        let shows = |_| (true, LEFT);
        assert_eq!(looks(&mut sides, 0, 300, shows, |_| NO), [0, 10]);
    }

    #[test]
    fn whom_a_side_shows_is_looked_at_in_every_picture_until_it_shows_them_no_longer() {
        let mut sides = Sides::default();
        let brings = |k| [false, k < 200];
        // They get up: nobody leans any more.
        let shows = |k| (true, [false, k < 200]);
        let [right, left] = looks(&mut sides, 0, 400, shows, brings);
        assert_eq!(right, 0);
        assert!((229..=231).contains(&left), "{left}");
    }

    #[test]
    fn who_was_lost_is_looked_for_on_both_sides_for_a_while() {
        let mut sides = Sides::default();
        let shows = |k| (k < 30, NO);
        assert_eq!(looks(&mut sides, 0, 600, shows, |_| NO), [5, 5]);
        // Found there, they are in sight.
        let brings = |k| [(60..600).contains(&k), false];
        let [right, left] = looks(&mut sides, 60 * 1_000_000_000, 600, shows, brings);
        assert!(right > 500, "{right}");
        assert!(left < 20, "{left}");
    }

    #[test]
    fn a_clock_that_goes_backwards_begins_anew() {
        let mut sides = Sides::default();
        let late = 1_000_000_000_000;
        assert_eq!(sides.wanted(late, true, LEFT), LEFT);
        sides.looked(late, LEFT, LEFT);
        assert_eq!(sides.wanted(5, false, NO), NO);
        assert_eq!(sides.wanted(5, true, LEFT), LEFT);
    }
}
