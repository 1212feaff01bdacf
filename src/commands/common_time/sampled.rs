//! Views that are not in step: what every one saw at instants of equal distance, while all ran.

use super::lengths::SPARE;
use super::timed::{SAME, Timed};
use super::{Common, IN_STEP};
use crate::commands::exit::Failure;

/// A frame this near to a wanted instant is taken as it is, as a share of a frame's time.
const OWN: f64 = 0.1;
/// So long before and after anybody is seen there are instants, seconds; of longer pauses nothing is lost but their
/// length, which the instants' times tell.
const PAUSE: f64 = 1.0;

/// Whether frames of one number are of one instant, and follow each other evenly.
pub fn are_in_step(all: &[Timed<'_>]) -> bool {
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
/// `otherwise` is what to do where they never ran together.
///
/// # Errors
/// When they never did, or nobody was in view then.
pub fn sampled(
    all: &[Timed<'_>],
    otherwise: &str,
    notes: &mut Vec<String>,
) -> anyhow::Result<Common> {
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
