//! Views that go together frame by frame: rows of one number are of one instant.

use super::lengths::{CUT, SPARE};
use super::timed::USUAL_RATE;
use super::{Common, IN_STEP, by_clock};
use crate::commands::exit::Failure;
use crate::commands::view_file::ViewFile;
use crate::counted::counted;

/// How much rates of views may differ that go by number.
const RATE_TOLERANCE: f64 = 0.03;

/// Whether views of these rates do not go by number.
pub fn is_other_rate(rate: f64, wanted: f64) -> bool {
    (rate / wanted - 1.0).abs() > RATE_TOLERANCE
}

/// Refuses to go by number where cameras of one machine's clock were not started together; `is_one_clock` where all
/// times are of it. `option` is what goes by number all the same.
///
/// # Errors
/// Naming the one whose times tell least, and how far starts are apart.
pub fn expect_no_other_start(
    is_one_clock: bool,
    seen: &[ViewFile],
    option: &str,
) -> anyhow::Result<()> {
    let unordered = seen.iter().filter(|s| !s.is_in_order());
    let share = |s: &&ViewFile| s.disorder() as f64 / s.times.len().max(1) as f64;
    let Some(bad) = unordered.max_by(|a, b| share(a).total_cmp(&share(b))) else {
        return Ok(());
    };
    let starts = by_clock(seen);
    let [least, most] = [
        starts.iter().copied().fold(f64::INFINITY, f64::min),
        starts.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    ];
    let rate = seen.iter().find_map(ViewFile::rate).unwrap_or(1.0);
    if !is_one_clock || most - least < IN_STEP / rate {
        return Ok(());
    }
    Err(Failure::data(format!(
        "expected times of camera {} that rise from frame to frame, found {} of {} that do not, and cameras that started up to {:.1} s apart; record it again, or give {option} if frames belong together by number",
        bad.name,
        bad.disorder(),
        bad.times.len(),
        most - least
    ))
    .into())
}

/// Brings views together frame by frame; `given` is the user's word for the rate, else it is that of the first that
/// tells one. Views whose times are in no order get those of the rate. Frames of films are numbered as their pictures:
/// of one that could not be read there is a row of nobody.
///
/// # Errors
/// When views differ in rate or length.
pub fn by_number(
    given: Option<f64>,
    mut seen: Vec<ViewFile>,
    notes: &mut Vec<String>,
) -> anyhow::Result<Common> {
    let rates: Vec<Option<f64>> = seen.iter().map(ViewFile::rate_by_number).collect();
    let first = rates.iter().position(Option::is_some).unwrap_or(0);
    let rate = given.or(rates[first]).unwrap_or(USUAL_RATE);
    let is_other = |r: &Option<f64>| r.is_some_and(|r| is_other_rate(r, rate));
    if given.is_none()
        && let Some(k) = rates.iter().position(is_other)
    {
        return Err(Failure::data(format!(
            "expected views of one rate, found {:.2} frames a second of camera {} and {:.2} of {}; bring them to one rate, or give --fps if they are",
            rate,
            seen[first].name,
            rates[k].unwrap_or(rate),
            seen[k].name
        ))
        .into());
    }
    for view in &mut seen {
        view.fill();
        if !view.is_in_order() {
            view.at_rate(rate);
        }
    }
    let (least, most) = shortest_and_longest(&seen);
    let lengths = [most, least].map(|k| seen[k].frames.len());
    if (lengths[0] - lengths[1]) as f64 > SPARE * rate {
        return Err(Failure::data(format!(
            "expected views of one length, found {} frames of camera {} and {} of {}; {CUT}",
            lengths[0], seen[most].name, lengths[1], seen[least].name
        ))
        .into());
    }
    Ok(row_by_row(seen, rate, notes))
}

/// Views that are in step: their rows of one number are of one time, that of the first view's; as many as the shortest
/// has. `rate` is in frames per second.
pub fn row_by_row(seen: Vec<ViewFile>, rate: f64, notes: &mut Vec<String>) -> Common {
    let count = note_lengths(&seen, notes);
    let times = seen[0].times[..count].to_vec();
    let (people, numbers) = seen.into_iter().map(|s| (s.frames, s.numbers)).unzip();
    Common {
        people,
        times,
        numbers,
        rate,
        in_step: true,
    }
}

fn shortest_and_longest(seen: &[ViewFile]) -> (usize, usize) {
    let length = |k: &usize| seen[*k].frames.len();
    let least = (0..seen.len()).min_by_key(length).unwrap_or(0);
    let most = (0..seen.len()).max_by_key(length).unwrap_or(0);
    (least, most)
}

/// Frames that all views have; what some have beyond is said.
fn note_lengths(seen: &[ViewFile], notes: &mut Vec<String>) -> usize {
    let (least, most) = shortest_and_longest(seen);
    let count = seen[least].frames.len();
    let difference = seen[most].frames.len() - count;
    if difference > 0 {
        notes.push(format!(
            "camera {} has {} less than {}; {} left out",
            seen[least].name,
            counted(difference as u64, "frame", "frames"),
            seen[most].name,
            match difference {
                1 => "it is",
                _ => "these are",
            }
        ));
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::common_time::view;

    #[test]
    fn of_views_in_no_order_the_one_that_tells_least_is_named() {
        let of_clock = |name: &str, start: u64, wild: &dyn Fn(u64) -> bool| {
            let back = |k: u64| if wild(k) { 70_000_000 } else { 0 };
            view(name, (2..62).map(|k| start + k * 33_333_333 - back(k)))
        };
        let views = [
            of_clock("hall", 0, &|k| k == 20),
            of_clock("door", 400_000_000, &|k| k % 6 == 5),
        ];
        let e = expect_no_other_start(true, &views, "--sync none").unwrap_err();
        let said = e.to_string();
        assert!(
            said.contains("camera door") && said.contains("10 of 60"),
            "{said}"
        );
    }

    #[test]
    fn the_rate_is_that_of_a_view_that_tells_one_wherever_it_stands() {
        let told = |rate: u64| (0..50).map(move |k| k * 1_000_000_000 / rate);
        let silent = || view("silent", (0..50).map(|_| 7));
        let at_50 = || view("a", told(50));
        for seen in [vec![silent(), at_50()], vec![at_50(), silent()]] {
            let common = by_number(None, seen, &mut Vec::new()).unwrap();
            assert!((common.rate - 50.0).abs() < 1e-6, "{}", common.rate);
        }
        let seen = vec![silent(), at_50(), view("b", told(25))];
        let e = by_number(None, seen, &mut Vec::new()).map(|_| ());
        let e = e.unwrap_err().to_string();
        assert!(e.contains("50.00 frames a second of camera a"), "{e}");
        assert!(e.contains("25.00 of b"), "{e}");
    }
}
