//! Views brought to one time by the times in their files: rows that are of one instant as they are, else what every
//! view saw at instants of equal distance.

mod beside;
mod by_number;
mod lengths;
mod sampled;
mod timed;

pub use by_number::{by_number, expect_no_other_start};
pub use lengths::is_as_long;

use self::by_number::row_by_row;
use self::lengths::{CUT, expect_lengths};
use self::sampled::{are_in_step, sampled};
use self::timed::Timed;
use super::view_file::ViewFile;
use crate::message::Observation;

/// Frames of two views nearer than this share of a frame's time need no interpolation.
pub const IN_STEP: f64 = 0.25;

/// What all views saw, instant by instant.
pub struct Common {
    /// Per view, per instant.
    pub people: Vec<Vec<Vec<Observation>>>,
    /// When every instant was, nanoseconds, rising, on the first view's clock.
    pub times: Vec<u64>,
    /// Per view, per instant where they are its frames, the number of the picture in its film; empty where it has none.
    pub numbers: Vec<Vec<u64>>,
    /// Instants a second, while anybody is in view.
    pub rate: f64,
    /// Whether instants are the files' own frames, not made of those before and after.
    pub in_step: bool,
}

impl Common {
    /// Every so many-th instant of it.
    pub fn thinned(self, stride: usize) -> Self {
        let of_view = |p: Vec<Vec<Observation>>| p.into_iter().step_by(stride).collect();
        let numbers = |n: Vec<u64>| n.into_iter().step_by(stride).collect();
        Self {
            people: self.people.into_iter().map(of_view).collect(),
            numbers: self.numbers.into_iter().map(numbers).collect(),
            times: self.times.into_iter().step_by(stride).collect(),
            rate: self.rate / stride as f64,
            in_step: self.in_step,
        }
    }
}

/// By how many seconds each view started before the first one, where all times are of one clock.
pub fn by_clock(seen: &[ViewFile]) -> Vec<f64> {
    let start = |s: &ViewFile| s.times.first().copied().unwrap_or(0);
    let first = seen.first().map_or(0, start);
    let apart = |s: &ViewFile| i128::from(first) - i128::from(start(s));
    seen.iter().map(|s| apart(s) as f64 * 1e-9).collect()
}

/// Brings views to one time that started `shifts` seconds before the first one; every one tells its times
/// ([`ViewFile::tells_times`]). `otherwise` is what to do where they never ran together, in the verb's own options.
///
/// # Errors
/// When there is no time at which all ran, or nobody was in view then.
pub fn by_times(
    seen: Vec<ViewFile>,
    shifts: &[f64],
    otherwise: &str,
    notes: &mut Vec<String>,
) -> anyhow::Result<Common> {
    let each = seen.iter().zip(shifts);
    let all: Vec<Timed<'_>> = each.map(|(file, shift)| Timed::new(file, *shift)).collect();
    if !are_in_step(&all) {
        return sampled(&all, otherwise, notes);
    }
    let rate = all[0].rate;
    Ok(row_by_row(seen, rate, notes))
}

/// Brings views of `multiview --sync auto` to one time of which nothing tells that they did not start together; every
/// one tells its times. `otherwise` as for [`by_times`].
///
/// # Errors
/// When they differ in length, which tells that they did not, and what [`by_times`] refuses.
pub fn as_if_together(
    seen: Vec<ViewFile>,
    otherwise: &str,
    notes: &mut Vec<String>,
) -> anyhow::Result<Common> {
    let uneven = format!("{CUT}, or give --sync times if they started together");
    expect_lengths(&seen, 0.0, &uneven)?;
    from_start(seen, otherwise, notes)
}

/// Brings views to one time as if they had started together, which may have started up to `apart` seconds apart, so
/// that they differ by no more in length; every one tells its times. `otherwise` as for [`by_times`].
///
/// # Errors
/// When they differ more in length, which tells that they did not, and what [`by_times`] refuses.
pub fn about_together(
    seen: Vec<ViewFile>,
    apart: f64,
    otherwise: &str,
    notes: &mut Vec<String>,
) -> anyhow::Result<Common> {
    expect_lengths(&seen, apart, CUT)?;
    from_start(seen, otherwise, notes)
}

/// Brings views to one time that started together.
fn from_start(
    seen: Vec<ViewFile>,
    otherwise: &str,
    notes: &mut Vec<String>,
) -> anyhow::Result<Common> {
    let shifts = vec![0.0; seen.len()];
    by_times(seen, &shifts, otherwise, notes)
}

/// A view with somebody in every frame, at these times, nanoseconds.
#[cfg(test)]
pub fn view(name: &str, times: impl Iterator<Item = u64>) -> ViewFile {
    let times: Vec<u64> = times.collect();
    ViewFile {
        name: name.to_owned(),
        size: [640, 480],
        intrinsics: crate::message::Intrinsics::default(),
        frames: vec![vec![Observation::default()]; times.len()],
        times,
        numbers: Vec::new(),
        of_machine: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_may_differ_in_length_by_what_they_may_have_started_apart() {
        let seconds = |count: u64| (0..30 * count).map(|k| k * 33_333_333);
        let films = |long| vec![view("a", seconds(long)), view("b", seconds(9))];
        let mut notes = Vec::new();
        assert_eq!(
            about_together(films(10), 1.0, "cut them", &mut notes).map_or(0, |c| c.times.len()),
            270
        );
        assert!(
            notes[0].contains("camera b has 30 frames less"),
            "{notes:?}"
        );
        let films = |tenths: u64| {
            let long = (0..3 * tenths).map(|k| k * 33_333_333);
            vec![view("a", long), view("b", seconds(9))]
        };
        for (long, apart) in [(100, 0.0), (102, 1.0), (110, 1.0)] {
            let e = about_together(films(long), apart, "cut them", &mut notes).map(|_| ());
            let e = e.unwrap_err().to_string();
            assert!(e.contains("expected views of one length"), "{e}");
            assert!(!e.contains("--sync"), "{e}");
        }
        // Where it is an option that takes them so.
        let e = as_if_together(films(110), "cut them", &mut notes).map(|_| ());
        let e = e.unwrap_err().to_string();
        assert!(
            e.contains("cut them to the same time, or give --sync times"),
            "{e}"
        );
    }

    #[test]
    fn a_picture_that_could_not_be_read_does_not_shift_the_frames_after_it() {
        let film = |name: &str, numbers: &[u64]| {
            let mut film = view(name, numbers.iter().map(|n| n * 40_000_000));
            film.numbers = numbers.to_vec();
            film
        };
        let films = || vec![film("a", &[0, 1, 2, 3, 4, 5]), film("b", &[0, 1, 3, 4, 5])];
        let expect_whole = |common: Common| {
            assert_eq!(common.times.len(), 6);
            assert!((common.rate - 25.0).abs() < 1e-6);
            for (k, people) in common.people[1].iter().enumerate() {
                assert_eq!(people.len(), usize::from(k != 2), "frame {k}");
            }
            assert_eq!(common.numbers[1], [0, 1, 2, 3, 4, 5]);
        };
        expect_whole(by_number(None, films(), &mut Vec::new()).unwrap());
        let mut rated = films();
        rated.iter_mut().for_each(|film| film.at_rate(25.0));
        expect_whole(by_number(Some(25.0), rated, &mut Vec::new()).unwrap());
        // Times tell it without.
        let common = as_if_together(films(), "cut them", &mut Vec::new()).unwrap();
        assert_eq!(common.times.len(), 6);
        assert!(common.people[1].iter().all(|people| people.len() == 1));
    }
}
