//! Left and right: a detector that sees a person from behind, or from the side, calls some limbs by the other side's
//! name, in one view and for many frames on end. The other views tell.

use glam::DVec3;

use super::moment::Moment;
use super::sight::{LIMB_PAIRS, Sight, distance};
use super::triangulate::{Line, SIGMA, meet, passing, robust};
use crate::camera::View;
use crate::joints::{EVIDENCE_JOINTS, MIRROR};

/// Limbs that are tried before there is a body: arms and legs.
const BEFORE: usize = 2;
/// Cost of calling one view's limbs exchanged, square metres: it decides where all fits as well.
const RELUCTANCE: f64 = 2e-3;
/// Cost of shoulders that point another way than hips, square metres.
const CROSSED: f64 = 5e-3;
/// Views whose states are tried in every combination; more are tried one by one.
const MOST_COMBINED: usize = 6;
/// By what factor the exchanged reading must fit a body better.
const MARGIN: f64 = 0.6;
/// Seconds between moments up to which the way from one to the other counts in full: in more a limb goes anywhere.
const FULL: f64 = 1.0 / 30.0;
/// Neck, shoulders, hips: the same trunk whichever side is called right.
const TRUNK: [[usize; 2]; 3] = [[1, 1], [2, 5], [8, 11]];

/// Most views of one person: there is a bit for each.
pub const MOST_VIEWS: usize = u32::BITS as usize;

/// Which views' arms, and which views' legs, are exchanged: a bit a view.
pub type States = [u32; BEFORE];

/// Heals exchanges of arms and legs so that rays of all views meet best. Where that leaves two answers, all views or
/// none, the one with fewer exchanges is taken, for [`settle`] to think over. Returns what was exchanged.
///
/// # Panics
/// With more than [`MOST_VIEWS`].
pub fn agree(views: &[View], sights: &mut [Option<Sight>]) -> States {
    assert!(
        views.len() <= MOST_VIEWS,
        "expected at most {MOST_VIEWS} views, found {}",
        views.len()
    );
    let seen: Vec<usize> = (0..sights.len()).filter(|&v| sights[v].is_some()).collect();
    let mut exchanged = [0; BEFORE];
    if seen.len() < 2 {
        return exchanged;
    }
    for (right, exchanged) in LIMB_PAIRS.iter().zip(&mut exchanged) {
        let cost = |states: u32| -> f64 {
            let reluctance = RELUCTANCE * f64::from(states.count_ones());
            let joints = right.iter().flat_map(|&j| [j, MIRROR[j]]);
            reluctance
                + joints
                    .map(|j| joint_cost(views, sights, &seen, states, j))
                    .sum::<f64>()
        };
        let best = if seen.len() <= MOST_COMBINED {
            let all = (0..1u32 << seen.len()).map(|s| (s, cost(s)));
            all.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(s, _)| s)
        } else {
            one_by_one(seen.len(), cost)
        };
        for (k, &v) in seen.iter().enumerate() {
            if best >> k & 1 == 1
                && let Some(sight) = &mut sights[v]
            {
                *sight = sight.exchanged(right);
                *exchanged |= 1 << v;
            }
        }
    }
    exchanged
}

/// Thinks over who is left in a sequence of frames, of which views agree within each: a limb does not change sides from
/// frame to frame, most detections call it rightly, and shoulders point the way hips do. The best sequence of the two
/// answers a frame. `times`: of every moment, seconds, rising.
pub fn settle(times: &[f64], moments: &mut [&mut Moment], states: &mut [States]) {
    for (g, right) in LIMB_PAIRS[..BEFORE].iter().enumerate() {
        // Cost of the best sequence that ends with the frame as it is, or exchanged, and where it comes from.
        let mut least: Vec<[f64; 2]> = Vec::with_capacity(moments.len());
        let mut from: Vec<[usize; 2]> = Vec::with_capacity(moments.len());
        for (k, moment) in moments.iter().enumerate() {
            let seen = moment.sights.iter().flatten().count() as u32;
            let swapped = states[k][g].count_ones();
            let mut own =
                [swapped, seen.saturating_sub(swapped)].map(|n| RELUCTANCE * f64::from(n));
            if let Some(crossed) = is_crossed(&moment.joints) {
                own[usize::from(!crossed)] += CROSSED;
            }
            let (mut cost, mut back) = (own, [0, 1]);
            if let Some(before) = least.last() {
                let told = (FULL / (times[k] - times[k - 1])).min(1.0);
                let step = [false, true].map(|other| {
                    told * travel(&moments[k - 1].joints, &moment.joints, right, other)
                });
                for now in 0..2 {
                    let ways = [0, 1].map(|was| before[was] + step[usize::from(was != now)]);
                    back[now] = usize::from(ways[1] < ways[0]);
                    cost[now] = own[now] + ways[back[now]];
                }
            }
            least.push(cost);
            from.push(back);
        }
        let Some(last) = least.last() else {
            return;
        };
        let mut now = usize::from(last[1] < last[0]);
        for k in (0..moments.len()).rev() {
            if now == 1 {
                for (v, sight) in moments[k].sights.iter_mut().enumerate() {
                    if let Some(sight) = sight {
                        *sight = sight.exchanged(right);
                        states[k][g] ^= 1 << v;
                    }
                }
                for &j in *right {
                    moments[k].joints.swap(j, MIRROR[j]);
                }
            }
            now = from[k][now];
        }
    }
}

/// Whether shoulders point another way than hips.
pub fn is_crossed(joints: &[Option<DVec3>; EVIDENCE_JOINTS]) -> Option<bool> {
    let (shoulders, hips) = (joints[5]? - joints[2]?, joints[11]? - joints[8]?);
    Some(shoulders.dot(hips) < 0.0)
}

/// Cost of a limb pair's way from one frame to the next beside the trunk's, sides exchanged in between where `other`.
fn travel(
    from: &[Option<DVec3>; EVIDENCE_JOINTS],
    to: &[Option<DVec3>; EVIDENCE_JOINTS],
    right: &[usize],
    other: bool,
) -> f64 {
    let gone = trunk_way(from, to);
    let joints = right.iter().flat_map(|&j| [j, MIRROR[j]]);
    let each = joints.filter_map(|j| {
        let now = if other { MIRROR[j] } else { j };
        let way = to[now]? - from[j]? - gone;
        Some(robust(way.length_squared(), 2.0 * SIGMA))
    });
    each.sum()
}

/// How far the trunk went, by what of it is known both times; nowhere where nothing is.
fn trunk_way(
    from: &[Option<DVec3>; EVIDENCE_JOINTS],
    to: &[Option<DVec3>; EVIDENCE_JOINTS],
) -> DVec3 {
    let each = TRUNK.iter().filter_map(|&[r, l]| {
        let middle = |at: &[Option<DVec3>; EVIDENCE_JOINTS]| Some(0.5 * (at[r]? + at[l]?));
        Some(middle(to)? - middle(from)?)
    });
    let (sum, count) = each.fold((DVec3::ZERO, 0), |(s, n), way| (s + way, n + 1));
    sum / f64::from(count.max(1))
}

fn one_by_one(count: usize, cost: impl Fn(u32) -> f64) -> u32 {
    let (mut states, mut least) = (0, cost(0));
    for _ in 0..count {
        let flips = (0..count).map(|k| states ^ 1 << k).map(|s| (s, cost(s)));
        match flips.min_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((s, c)) if c < least => (states, least) = (s, c),
            _ => break,
        }
    }
    states
}

fn joint_cost(
    views: &[View],
    sights: &[Option<Sight>],
    seen: &[usize],
    states: u32,
    joint: usize,
) -> f64 {
    let lines: Vec<Line> = seen
        .iter()
        .enumerate()
        .filter_map(|(k, &v)| {
            let called = if states >> k & 1 == 1 {
                MIRROR[joint]
            } else {
                joint
            };
            let ray = sights[v].as_ref()?.rays[called]?;
            Some(Line {
                origin: views[v].position,
                direction: ray.direction,
                weight: ray.confidence,
            })
        })
        .collect();
    // Rays that tell no depth tell all the same how far they pass from each other: else the reading that makes them
    // parallel would cost nothing.
    meet(&lines).map_or_else(|| passing(&lines), |(_, cost)| cost)
}

/// Compares one view's limbs with a fitted body's joints and exchanges those that fit the other side much better.
/// Returns how many.
pub fn follow(view: &View, sight: &mut Sight, body: &[DVec3; EVIDENCE_JOINTS]) -> usize {
    let mut healed = 0;
    for right in LIMB_PAIRS {
        let cost = |sight: &Sight| -> (f64, usize) {
            let joints = right.iter().flat_map(|&j| [j, MIRROR[j]]);
            let each = joints.filter_map(|j| {
                let ray = sight.rays[j]?;
                let e = distance(view.position, ray.direction, body[j]);
                Some(ray.confidence * robust(e * e, 2.0 * SIGMA))
            });
            each.fold((0.0, 0), |(sum, n), c| (sum + c, n + 1))
        };
        let other = sight.exchanged(right);
        let ((as_told, n), (exchanged, _)) = (cost(sight), cost(&other));
        if n >= 3 && exchanged < MARGIN * as_told && as_told - exchanged > RELUCTANCE {
            *sight = other;
            healed += 1;
        }
    }
    healed
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2};

    use super::*;
    use crate::message::Observation;

    /// Level, 4.2 m from the origin along x, 1.4 m high, and looks along x to it; the world's y is up.
    fn facing(x: f64) -> View {
        let ahead = DVec3::new(-x.signum(), 0.0, 0.0);
        let down = DVec3::NEG_Y;
        View {
            name: format!("{x}"),
            size: [1280, 960],
            focal: DVec2::splat(1000.0),
            centre: DVec2::new(639.5, 479.5),
            distortion: Default::default(),
            rotation: DMat3::from_cols(down.cross(ahead), down, ahead).transpose(),
            position: DVec3::new(x, 1.4, 0.0),
        }
    }

    /// Arms at the height of the cameras, each as far to its side as the other: rays of left and right are parallel.
    #[test]
    fn a_reading_that_makes_rays_parallel_is_not_for_nothing() {
        let views = [facing(-4.2), facing(4.2)];
        let at = |height: f64, side: f64| DVec3::new(0.0, height, side);
        let mut joints = [at(1.6, 0.0); EVIDENCE_JOINTS];
        for (right, height, side) in [
            (2, 1.4, 0.18),
            (3, 1.4, 0.22),
            (4, 1.4, 0.25),
            (8, 0.9, 0.12),
            (9, 0.5, 0.13),
            (10, 0.1, 0.14),
        ] {
            joints[right] = at(height, side);
            joints[MIRROR[right]] = at(height, -side);
        }
        // One camera sees everything 3 cm too high, the other too low.
        let mut sights: Vec<Option<Sight>> = views
            .iter()
            .zip([0.03, -0.03])
            .map(|(view, off)| {
                let mut seen = Observation::default();
                for (out, joint) in seen.joints2d.iter_mut().zip(joints) {
                    let pixel = view.project(joint + at(off, 0.0)).unwrap();
                    *out = [pixel.x as f32, pixel.y as f32, 0.9];
                }
                Some(Sight::new(view, &seen))
            })
            .collect();
        assert_eq!(agree(&views, &mut sights), [0, 0]);
    }
}
