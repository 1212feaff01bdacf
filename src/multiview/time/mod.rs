//! Time between views that were not started together: what each sees on its own clock goes in, how far the clocks are
//! apart comes out.
//!
//! Lags at which joints move alike in both views, by cross-correlating their speeds, are tried, and every lag roughly;
//! the one at which rays meet best is refined to parts of a frame, first view by view and then all together. Where
//! nobody moves, or all moves alike again and again, it cannot be told.

mod epipolar;
mod speeds;
mod trails;

use self::epipolar::{Agreement, Followed, agreement};
use self::speeds::Speeds;
use self::trails::{Trail, trails};
use super::sight::Sight;
use crate::camera::View;

/// Farthest that clocks are looked for apart, seconds.
pub const MOST: f64 = 5.0;
/// Lags of like speeds that are tried, and of a rough look at all.
const TRIED: usize = 10;
/// Seconds between the lags of the rough look, and times looked at.
const ROUGH: (f64, usize) = (0.04, 40);
/// Times looked at where it counts.
const FINE: usize = 160;
/// Where rays meet so much nearer, clocks far apart are believed before clocks that are near: share a second.
const NEARER: f64 = 0.03;
/// What no detector tells better, square metres.
const FLOOR: f64 = 4e-6;
/// How much farther apart rays have to be a moment before and after (seconds), as a share, for the offset to be told;
/// and that share times the root of the number of joints compared. The best of many lags is good by chance, too, the
/// more so the less is compared.
const AROUND: [f64; 2] = [0.15, 0.5];
const CLEAR: f64 = 0.6;
const CHANCE: f64 = 60.0;
/// Detectors err otherwise in every view: views whose rays meet hardly better so few seconds apart started together.
const TOGETHER: f64 = 0.1;
const STARTED: f64 = 1.3;
/// Least times and joints compared, and as a share of those with another offset.
const LEAST: f64 = 150.0;
const COMMON: f64 = 0.3;
/// An offset this much farther away that fits nearly as well makes it ambiguous: seconds and factor.
const OTHER: (f64, f64) = (0.3, 1.15);
/// Rounds in which every view is held against all others.
const ROUNDS: usize = 2;

/// What one view saw, on its own clock.
#[derive(Debug, Clone, Copy)]
pub struct Watched<'a> {
    /// The camera.
    pub view: &'a View,
    /// When every frame was taken, seconds, rising.
    pub times: &'a [f64],
    /// Who was seen in it.
    pub people: &'a [Vec<Sight>],
}

/// How far a view's clock is ahead of the first view's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Offset {
    /// Seconds: what the first view saw at t, this one saw at t + offset.
    Told(f64),
    /// Nobody moved enough, or the views share nobody.
    CannotTell,
    /// Seconds; another offset, farther away, fits nearly as well, as where somebody moves in the same way again and
    /// again.
    Ambiguous(f64),
}

impl Offset {
    /// Seconds; 0 where it cannot be told.
    pub fn seconds(self) -> f64 {
        match self {
            Self::Told(s) | Self::Ambiguous(s) => s,
            Self::CannotTell => 0.0,
        }
    }
}

struct Seen<'a> {
    view: &'a View,
    trails: Vec<Trail>,
    speeds: Speeds,
    /// Seconds.
    interval: f64,
}

impl Seen<'_> {
    fn followed(&self) -> Followed<'_> {
        Followed {
            view: self.view,
            trails: &self.trails,
        }
    }
}

/// Offsets of all views' clocks from the first view's, which is 0, at most [`MOST`] seconds.
pub fn offsets(views: &[Watched<'_>]) -> Vec<Offset> {
    let seen: Vec<Seen<'_>> = views
        .iter()
        .map(|w| {
            let trails = trails(w.times, w.people);
            let ends = [w.times.first(), w.times.last()].map(|t| t.copied().unwrap_or(0.0));
            Seen {
                view: w.view,
                speeds: Speeds::new(&trails, ends[0], ends[1]),
                interval: interval(w.times),
                trails,
            }
        })
        .collect();
    let mut found: Vec<Option<Offset>> = vec![None; seen.len()];
    if let Some(first) = found.first_mut() {
        *first = Some(Offset::Told(0.0));
    }
    // Which view each started together with, or its own number, where it started with none that is told already.
    let mut beside: Vec<usize> = (0..seen.len()).collect();
    // From view to view: two may share nobody, and both share somebody with a third.
    loop {
        let known: Vec<usize> = (0..seen.len())
            .filter(|&k| matches!(found[k], Some(Offset::Told(_))))
            .collect();
        let next = (0..seen.len())
            .filter(|&k| found[k].is_none())
            .find_map(|k| {
                known.iter().find_map(|&from| {
                    let to = pair(&seen[from], &seen[k])?;
                    let base = found[from].map_or(0.0, Offset::seconds);
                    let with = if to == Offset::Told(0.0) { from } else { k };
                    matches!(to, Offset::Told(_)).then(|| (k, with, to.shifted(base)))
                })
            });
        let Some((k, with, offset)) = next else {
            break;
        };
        found[k] = Some(offset);
        beside[k] = beside[with];
    }
    // What only an ambiguous pair tells.
    for k in 0..seen.len() {
        if found[k].is_none() {
            let told = pair(&seen[0], &seen[k]);
            found[k] = Some(told.unwrap_or(Offset::CannotTell));
        }
    }
    let mut found: Vec<Offset> = found
        .into_iter()
        .map(|o| o.unwrap_or(Offset::CannotTell))
        .collect();
    if found.len() > 2 {
        together(&seen, &beside, &mut found);
    }
    found
}

/// Typical time between frames, seconds; pauses do not count.
fn interval(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(0.0)
}

impl Offset {
    fn shifted(self, by: f64) -> Self {
        match self {
            Self::Told(s) => Self::Told(s + by),
            Self::Ambiguous(s) => Self::Ambiguous(s + by),
            Self::CannotTell => Self::CannotTell,
        }
    }
}

/// An offset, how far apart rays are with it, and how many joints that was taken from.
#[derive(Clone, Copy)]
struct Tried {
    offset: f64,
    mean: f64,
    count: f64,
}

/// Offset of one view's clock from another's; `None` where it cannot be told.
fn pair(a: &Seen<'_>, b: &Seen<'_>) -> Option<Offset> {
    if ![a, b].iter().all(|s| s.trails.iter().any(Trail::moves)) {
        return None;
    }
    let (from, to) = (a.followed(), b.followed());
    let near = |offset: f64, times: usize| {
        let met = agreement(&from, &to, offset, times);
        Some((met.mean()?, met.count))
    };
    let steps = (MOST / ROUGH.0) as i32;
    let rough: Vec<(f64, f64, f64)> = (-steps..=steps)
        .filter_map(|k| {
            let offset = f64::from(k) * ROUGH.0;
            let (mean, count) = near(offset, ROUGH.1)?;
            Some((offset, mean, count))
        })
        .collect();
    // At the ends of the common time a few lucky frames may agree.
    let most = rough.iter().map(|r| r.2).fold(0.0, f64::max);
    let mut minima: Vec<(f64, f64)> = (0..rough.len())
        .filter(|&k| {
            let beside = [k.checked_sub(1), Some(k + 1)].into_iter().flatten();
            rough[k].2 > COMMON * most
                && beside
                    .filter_map(|n| rough.get(n))
                    .all(|n| n.1 >= rough[k].1)
        })
        .map(|k| (rough[k].1, rough[k].0))
        .collect();
    minima.sort_by(|x, y| x.0.total_cmp(&y.0));
    let alike = a.speeds.alike(&b.speeds, MOST);
    let starts = minima.iter().map(|m| m.1).take(TRIED);
    let starts = starts.chain(alike.into_iter().take(TRIED)).chain([0.0]);
    let half = 0.5 * a.interval.max(b.interval);
    let cost = |offset: f64| near(offset, FINE).map_or(f64::INFINITY, |(mean, _)| mean);
    let mut tried: Vec<Tried> = starts
        .filter_map(|start| {
            let offset = least(start, half, &cost);
            let (mean, count) = near(offset, FINE)?;
            Some(Tried {
                offset,
                mean: mean + FLOOR,
                count,
            })
        })
        .collect();
    let most = tried.iter().map(|t| t.count).fold(0.0, f64::max);
    tried.retain(|t| t.count >= LEAST && t.count > COMMON * most);
    let worth = |t: &Tried| t.mean * (1.0 + NEARER * t.offset.abs());
    tried.sort_by(|x, y| worth(x).total_cmp(&worth(y)));
    let best = *tried.first()?;
    // How much worse it is a moment before and after tells whether anybody moved.
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for k in 0..4 {
        let by = AROUND[0] + (AROUND[1] - AROUND[0]) * f64::from(k) / 3.0;
        for side in [-by, by] {
            if let Some((mean, _)) = near(best.offset + side, FINE) {
                sum += mean;
                count += 1.0;
            }
        }
    }
    let worse = CLEAR.max(CHANCE / best.count.sqrt());
    if count < 4.0 || sum / count + FLOOR < (1.0 + worse) * best.mean {
        return None;
    }
    let as_good = tried.iter().filter(|t| t.mean < OTHER.1 * best.mean);
    let nearest = as_good
        .clone()
        .map(|t| t.offset)
        .min_by(|x, y| x.abs().total_cmp(&y.abs()))?;
    let in_step = near(0.0, FINE).is_some_and(|(mean, _)| mean + FLOOR < STARTED * best.mean);
    if in_step && best.offset.abs() < TOGETHER {
        return Some(Offset::Told(0.0));
    }
    let elsewhere = as_good
        .map(|t| (t.offset - nearest).abs())
        .any(|by| by > OTHER.0);
    Some(if elsewhere {
        Offset::Ambiguous(nearest)
    } else {
        Offset::Told(best.offset)
    })
}

/// The least cost near `start`, in steps of half a frame and then by golden sections.
fn least(start: f64, half: f64, cost: &dyn Fn(f64) -> f64) -> f64 {
    let around = (-4..=4).map(|k| start + f64::from(k) * half);
    let middle = around
        .map(|at| (cost(at), at))
        .min_by(|x, y| x.0.total_cmp(&y.0))
        .map_or(start, |m| m.1);
    golden(middle - half, middle + half, cost)
}

/// The least cost between two offsets, to half a millisecond.
fn golden(mut low: f64, mut high: f64, cost: &dyn Fn(f64) -> f64) -> f64 {
    const SECTION: f64 = 0.618_033_988_749_895;
    let mut left = high - SECTION * (high - low);
    let mut right = low + SECTION * (high - low);
    let (mut at_left, mut at_right) = (cost(left), cost(right));
    while high - low > 5e-4 {
        if at_left < at_right {
            (high, right, at_right) = (right, left, at_left);
            left = high - SECTION * (high - low);
            at_left = cost(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = low + SECTION * (high - low);
            at_right = cost(right);
        }
    }
    0.5 * (low + high)
}

/// Refines all offsets that are told, each so that its view agrees best with all others. Views that started together
/// (`beside` tells by number with which, a view that is beside none by its own) stay so and go along.
fn together(seen: &[Seen<'_>], beside: &[usize], found: &mut [Offset]) {
    for _ in 0..ROUNDS {
        for k in 1..seen.len() {
            let Offset::Told(own) = found[k] else {
                continue;
            };
            if beside[k] != k {
                continue;
            }
            let (alike, others): (Vec<usize>, Vec<usize>) = (0..seen.len())
                .filter(|&v| matches!(found[v], Offset::Told(_)))
                .partition(|&v| beside[v] == k);
            let cost = |at: f64| {
                let pairs = alike
                    .iter()
                    .flat_map(|&v| others.iter().map(move |&o| (v, o)));
                let each = pairs.map(|(v, o)| {
                    let offset = at - found[o].seconds();
                    agreement(&seen[o].followed(), &seen[v].followed(), offset, FINE)
                });
                let all = each.fold(Agreement::default(), |sum, a| sum.plus(&a));
                all.mean().unwrap_or(f64::INFINITY)
            };
            let half = 0.5 * seen[k].interval;
            let refined = Offset::Told(golden(own - half, own + half, &cost));
            for v in alike {
                found[v] = refined;
            }
        }
    }
}
