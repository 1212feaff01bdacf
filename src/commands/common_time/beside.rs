//! What a view saw at instants that others were brought to without it.

use super::by_number::is_other_rate;
use super::lengths::SPARE;
use super::timed::{SAME, Timed};
use super::{Common, IN_STEP};
use crate::commands::view_file::ViewFile;
use crate::message::Observation;

impl Common {
    /// What another view saw at these instants; nobody while it did not run, and `None` where it ran at none of them.
    /// `first` is the first view, which started `shift` seconds after the other one; both tell their times.
    pub fn seen_beside(
        &self,
        first: &ViewFile,
        other: &ViewFile,
        shift: f64,
    ) -> Option<Vec<Vec<Observation>>> {
        let view = Timed::new(other, shift);
        let instant = |t: &u64| (i128::from(*t) - i128::from(first.times[0])) as f64 * 1e-9;
        let instants: Vec<f64> = self.times.iter().map(instant).collect();
        // As of the others where instants are their frames and it goes along with them.
        let near = match self.in_step && !is_other_rate(view.rate, self.rate) {
            true => IN_STEP / self.rate,
            false => 0.0,
        };
        let ran = view.seconds[0] - near.max(SAME)..=view.end() + near.max(SAME);
        if !instants.iter().any(|now| ran.contains(now)) {
            return None;
        }
        let at = |now: f64| {
            let nearest = view.nearest(now);
            if (view.seconds[nearest] - now).abs() < near {
                return other.frames[nearest].clone();
            }
            view.at(now)
        };
        Some(instants.into_iter().map(at).collect())
    }

    /// The same of a view whose frames go by number with the instants; nobody where it has none, and `None` where it
    /// has another rate, or is longer or shorter than views may be that go by number. `is_given` where the rate is the
    /// user's word.
    pub fn seen_by_number(
        &self,
        mut other: ViewFile,
        is_given: bool,
    ) -> Option<Vec<Vec<Observation>>> {
        let rate = other.rate_by_number().filter(|_| !is_given);
        if rate.is_some_and(|r| is_other_rate(r, self.rate)) {
            return None;
        }
        other.fill();
        let difference = self.times.len().abs_diff(other.frames.len());
        if difference as f64 > SPARE * self.rate {
            return None;
        }
        other.frames.resize_with(self.times.len(), Vec::new);
        Some(other.frames)
    }
}

#[cfg(test)]
mod tests {
    use crate::commands::common_time::{by_number, by_times, view};

    #[test]
    fn a_view_beside_others_that_go_by_number_is_about_as_long_as_they_are() {
        let times = |frames: u64| (0..frames).map(|k| k * 33_333_333);
        let others = vec![view("a", times(270)), view("b", times(270))];
        let common = by_number(None, others, &mut Vec::new()).unwrap();
        let beside = |frames: u64| {
            let seen = common.seen_by_number(view("c", times(frames)), false);
            seen.map(|seen| seen.len())
        };
        for (frames, wanted) in [(253, None), (256, Some(270)), (284, Some(270)), (287, None)] {
            assert_eq!(beside(frames), wanted, "{frames}");
        }
    }

    #[test]
    fn what_a_view_of_another_rate_saw_beside_others_is_interpolated() {
        // Joints go one pixel a millisecond of the view's own clock.
        let moving = |name: &str, times: &mut dyn Iterator<Item = u64>| {
            let mut moving = view(name, times);
            for (people, t) in moving.frames.iter_mut().zip(&moving.times) {
                for (j, joint) in people[0].joints2d.iter_mut().enumerate() {
                    *joint = [1e-6 * *t as f32, 40.0 * j as f32, 0.9];
                }
            }
            moving
        };
        let at_30 = |name: &str| moving(name, &mut (0..60).map(|k| k * 33_333_333));
        let first = at_30("a");
        let seen = vec![at_30("a"), at_30("b")];
        let common = by_times(seen, &[0.0; 2], "cut them", &mut Vec::new()).unwrap();
        assert!(common.in_step);
        let other = moving("c", &mut (0..130).map(|k| k * 16_666_667));
        let beside = common.seen_beside(&first, &other, 0.008).unwrap();
        for (people, t) in beside.iter().zip(&common.times) {
            let (x, wanted) = (people[0].joints2d[3][0], 1e-6 * *t as f32 + 8.0);
            assert!((x - wanted).abs() < 1.0, "{x}, not {wanted}");
        }
        assert!(common.seen_beside(&first, &other, 60.0).is_none());
    }
}
