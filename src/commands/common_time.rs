//! Views brought to one time by the times in their files: rows that are of one instant as they are, else what every
//! view saw at instants of equal distance.

use super::exit::Failure;
use super::view_file::ViewFile;
use crate::counted::counted;
use crate::message::Observation;
use crate::multiview::between;

/// Frames of two views nearer than this share of a frame's time need no interpolation.
pub const IN_STEP: f64 = 0.25;
/// A frame this near to a wanted instant is taken as it is, as a share of a frame's time.
const OWN: f64 = 0.1;
/// Frames nearer than this are of one instant, seconds.
const SAME: f64 = 1e-3;
/// Longest time between two frames that is interpolated, in frames.
const GAP: f64 = 4.0;
/// So long before and after anybody is seen there are instants, seconds; of longer pauses nothing is lost but their
/// length, which the instants' times tell.
const PAUSE: f64 = 1.0;
/// Seconds that views may differ in length which are only taken to have started together, and by which one may begin
/// or end apart from the others without a word.
const SPARE: f64 = 0.5;
/// How much rates of views may differ that go by number.
const RATE_TOLERANCE: f64 = 0.03;
/// What to do about views that differ in length.
const CUT: &str = "cut them to the same time";
/// Rate of views whose files tell no times.
const USUAL_RATE: f64 = 30.0;

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

/// Whether views of these rates do not go by number.
fn is_other_rate(rate: f64, wanted: f64) -> bool {
    (rate / wanted - 1.0).abs() > RATE_TOLERANCE
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

/// Refuses views that differ more in length than by `apart` seconds; `uneven` is what to do then.
fn expect_lengths(seen: &[ViewFile], apart: f64, uneven: &str) -> anyhow::Result<()> {
    let by_length = |a: &&ViewFile, b: &&ViewFile| length(a).total_cmp(&length(b));
    let ends = (seen.iter().min_by(by_length), seen.iter().max_by(by_length));
    if let (Some(least), Some(most)) = ends
        && length(most) - length(least) > apart.max(SPARE)
    {
        return Err(Failure::data(format!(
            "expected views of one length, found {:.1} s of camera {} and {:.1} s of {}; {uneven}",
            length(most),
            most.name,
            length(least),
            least.name
        ))
        .into());
    }
    Ok(())
}

/// Seconds from a view's first frame to its last; it tells its times.
fn length(view: &ViewFile) -> f64 {
    let span = view.times[view.times.len() - 1] - view.times[0];
    span as f64 * 1e-9
}

/// Whether a view is as long as one of others, so that it may have started and ended with it; every one tells its
/// times.
pub fn is_as_long<'a>(view: &ViewFile, mut others: impl Iterator<Item = &'a ViewFile>) -> bool {
    others.any(|other| (length(other) - length(view)).abs() <= SPARE)
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
fn row_by_row(seen: Vec<ViewFile>, rate: f64, notes: &mut Vec<String>) -> Common {
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

/// A view, and when its frames were on the clock of all.
struct Timed<'a> {
    file: &'a ViewFile,
    /// Frames a second.
    rate: f64,
    /// When every frame was, seconds after the first view's start, rising.
    seconds: Vec<f64>,
}

impl<'a> Timed<'a> {
    fn new(file: &'a ViewFile, shift: f64) -> Self {
        let seconds = |t: &u64| (t - file.times[0]) as f64 * 1e-9 - shift;
        Self {
            file,
            rate: file.rate().unwrap_or(USUAL_RATE),
            seconds: file.times.iter().map(seconds).collect(),
        }
    }

    fn end(&self) -> f64 {
        self.seconds[self.seconds.len() - 1]
    }

    /// The frame nearest to an instant.
    fn nearest(&self, now: f64) -> usize {
        let next = self.seconds.partition_point(|t| *t <= now);
        let near = [next.saturating_sub(1), next.min(self.seconds.len() - 1)];
        let off = |k: usize| (self.seconds[k] - now).abs();
        if off(near[0]) <= off(near[1]) {
            near[0]
        } else {
            near[1]
        }
    }

    /// Who was seen at an instant; nobody where frames are too far from it.
    fn at(&self, now: f64) -> Vec<Observation> {
        let off = |k: usize| (self.seconds[k] - now).abs();
        let nearest = self.nearest(now);
        let frames = &self.file.frames;
        if off(nearest) < SAME {
            return frames[nearest].clone();
        }
        let next = self.seconds.partition_point(|t| *t <= now);
        if next == 0 || next == frames.len() {
            return Vec::new();
        }
        let step = self.seconds[next] - self.seconds[next - 1];
        if step > GAP / self.rate {
            return Vec::new();
        }
        let other = if nearest == next { next - 1 } else { next };
        between(&frames[nearest], &frames[other], off(nearest) / step, step)
    }
}

/// Whether frames of one number are of one instant, and follow each other evenly.
fn are_in_step(all: &[Timed<'_>]) -> bool {
    let first = &all[0];
    let near = IN_STEP / first.rate;
    let mut steps = first.seconds.windows(2);
    steps.all(|w| (w[1] - w[0] - 1.0 / first.rate).abs() < near)
        && all[1..].iter().all(|view| {
            let mut pairs = view.seconds.iter().zip(&first.seconds);
            pairs.all(|(own, other)| (own - other).abs() < near)
        })
}

/// What every view saw at instants of equal distance, as many a second as the fastest view has frames, while all ran.
fn sampled(all: &[Timed<'_>], otherwise: &str, notes: &mut Vec<String>) -> anyhow::Result<Common> {
    let begin = all.iter().map(|v| v.seconds[0]).fold(f64::MIN, f64::max) - SAME;
    let end = all.iter().map(Timed::end).fold(f64::MAX, f64::min) + SAME;
    let lead = (0..all.len())
        .max_by(|a, b| all[*a].rate.total_cmp(&all[*b].rate).then(b.cmp(a)))
        .unwrap_or(0);
    let lead = &all[lead];
    let origin = lead.seconds.iter().copied().find(|t| *t >= begin);
    let Some(origin) = origin.filter(|t| *t <= end) else {
        return Err(Failure::data(format!(
            "expected views that ran at one time, found none in which all did; {otherwise}"
        ))
        .into());
    };
    note_ends(all, notes);
    let mut common = Common {
        people: vec![Vec::new(); all.len()],
        times: Vec::new(),
        numbers: vec![Vec::new(); all.len()],
        rate: lead.rate,
        in_step: false,
    };
    for k in inhabited(all, origin, end, lead.rate) {
        let even = origin + k as f64 / lead.rate;
        let own = lead.seconds[lead.nearest(even)];
        let now = if (own - even).abs() < OWN / lead.rate {
            own
        } else {
            even
        };
        let after = (now.max(0.0) * 1e9).round() as u64;
        common
            .times
            .push(all[0].file.times[0].saturating_add(after));
        for (people, view) in common.people.iter_mut().zip(all) {
            people.push(view.at(now));
        }
    }
    if common.times.is_empty() {
        return Err(Failure::data(
            "expected somebody in view while all cameras ran, found nobody; check that views are of one time",
        )
        .into());
    }
    Ok(common)
}

/// Says which view begins late or ends early, by which what the others saw is left out.
fn note_ends(all: &[Timed<'_>], notes: &mut Vec<String>) {
    let ends = |at: &dyn Fn(&Timed<'_>) -> f64| {
        let each = all.iter().map(|v| (at(v), v.file.name.as_str()));
        let mut each: Vec<(f64, &str)> = each.collect();
        each.sort_by(|a, b| a.0.total_cmp(&b.0));
        (each[0], each[each.len() - 1])
    };
    let ((first, early), (last, late)) = ends(&|v| v.seconds[0]);
    if last - first > SPARE {
        notes.push(format!(
            "camera {late} begins {:.1} s after {early}; what was seen before is left out",
            last - first
        ));
    }
    let ((first, early), (last, late)) = ends(&|v| v.end());
    if last - first > SPARE {
        notes.push(format!(
            "camera {early} ends {:.1} s before {late}; what was seen after is left out",
            last - first
        ));
    }
}

/// Numbers of the instants, `rate` a second from `origin` to `end`, near which anybody is seen, rising.
fn inhabited(all: &[Timed<'_>], origin: f64, end: f64, rate: f64) -> Vec<u64> {
    let each = all
        .iter()
        .flat_map(|v| v.seconds.iter().zip(&v.file.frames));
    let mut seen: Vec<f64> = each
        .filter(|(_, people)| !people.is_empty())
        .map(|(t, _)| *t)
        .collect();
    seen.sort_by(f64::total_cmp);
    let (mut numbers, mut next) = (Vec::new(), 0_u64);
    for t in seen {
        let from = ((t - PAUSE - origin) * rate).ceil().max(0.0) as u64;
        let last = ((t + PAUSE).min(end) - origin) * rate;
        if last >= 0.0 {
            numbers.extend(from.max(next)..=last as u64);
            next = next.max(last as u64 + 1);
        }
    }
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::Intrinsics;

    /// A view with somebody in every frame, at these times, nanoseconds.
    fn view(name: &str, times: impl Iterator<Item = u64>) -> ViewFile {
        let times: Vec<u64> = times.collect();
        ViewFile {
            name: name.to_owned(),
            size: [640, 480],
            intrinsics: Intrinsics::default(),
            frames: vec![vec![Observation::default()]; times.len()],
            times,
            numbers: Vec::new(),
            of_machine: false,
        }
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
