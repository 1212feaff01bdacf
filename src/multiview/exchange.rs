//! Left and right: a detector that sees a person from behind, or from the side, calls some limbs by the other side's
//! name, in one view and for many frames on end. The other views tell.

use glam::DVec3;

use super::moment::Moment;
use super::sight::{LIMB_PAIRS, Sight, distance};
use super::triangulate::{Line, SIGMA, meet, passing, robust};
use crate::camera::View;
use crate::joints::{
    EVIDENCE_JOINTS, HIPS, L_HIP, L_SHOULDER, MIRROR, NECK, R_HIP, R_SHOULDER, SHOULDERS,
};

/// Limbs that are tried before there is a body: arms and legs.
const BEFORE: usize = 2;
/// Cost of calling one view's limbs exchanged, square metres: it decides where all fits as well.
const RELUCTANCE: f64 = 2e-3;
/// Cost of shoulders that point another way than hips, square metres.
const CROSSED: f64 = 5e-3;
/// Views whose states are tried in every combination; more are tried one by one.
const MOST_COMBINED: usize = 6;
/// How far a ray counts to be from a partner that a reading takes from it, metres: less, and rays that miss each other
/// by a detector's error would be taken apart; more, and those of two arms would stay together.
const ALONE: f64 = 0.05;
/// Cost of a joint that is not known in the next frame where the other side's is, sides as they are and exchanged,
/// square metres: a joint is lost more easily than it changes sides, so the first is that of a way of 2·SIGMA, the
/// second that of the farthest.
const LOST: [f64; 2] = [2.0 * SIGMA * SIGMA, 4.0 * SIGMA * SIGMA];
/// By what factor the exchanged reading must fit a body better.
const MARGIN: f64 = 0.6;
/// Seconds between moments up to which the way from one to the other counts in full: in more a limb goes anywhere.
const FULL: f64 = 1.0 / 30.0;
/// Neck, shoulders, hips: the same trunk whichever side is called right.
const TRUNK: [[usize; 2]; 3] = [[NECK, NECK], SHOULDERS, HIPS];

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
        // Of a joint's mirror image a reading takes the rays that the opposite one takes of the joint.
        let is_combined = seen.len() <= MOST_COMBINED;
        let all: u32 = if is_combined { 1 << seen.len() } else { 0 };
        let of = |states: u32, j: usize| of_joint(views, sights, &seen, states, j);
        let known = right.iter().flat_map(|&j| (0..all).map(move |s| of(s, j)));
        let known: Vec<Reading> = known.collect();
        let read = |states: u32| -> Reading {
            let joints = right
                .iter()
                .enumerate()
                .flat_map(|(k, &j)| match is_combined {
                    true => {
                        [states, all - 1 - states].map(|s| known[k * all as usize + s as usize])
                    }
                    false => [j, MIRROR[j]].map(|j| of(states, j)),
                });
            joints.fold(Reading::default(), |sum, one| Reading {
                cost: sum.cost + one.cost,
                alone: sum.alone + one.alone,
            })
        };
        let as_told = read(0).alone;
        let cost = |states: u32| -> f64 {
            let Reading { cost, alone } = read(states);
            // Rays without a partner miss nothing: else the reading that takes all of them apart would cost nothing.
            let taken = robust(ALONE * ALONE, SIGMA) * (alone - as_told).max(0.0);
            RELUCTANCE * f64::from(states.count_ones()) + cost + taken
        };
        let best = if is_combined {
            let each = (0..all).map(|s| (s, cost(s)));
            each.min_by(|a, b| a.1.total_cmp(&b.1))
                .map_or(0, |(s, _)| s)
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
            let since = match k {
                0 => FULL,
                _ => times[k] - times[k - 1],
            };
            // However many frames a second there are, a change of sides is paid once and a stretch by its length.
            own = own.map(|cost| cost * (since / FULL).min(1.0));
            let (mut cost, mut back) = (own, [0, 1]);
            if let Some(before) = least.last() {
                let told = (FULL / since).min(1.0);
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
    let (shoulders, hips) = (
        joints[L_SHOULDER]? - joints[R_SHOULDER]?,
        joints[L_HIP]? - joints[R_HIP]?,
    );
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
        let was = from[j]?;
        let [now, else_now] = match other {
            false => [to[j], to[MIRROR[j]]],
            true => [to[MIRROR[j]], to[j]],
        };
        let cost = |now: DVec3| robust((now - was - gone).length_squared(), 2.0 * SIGMA);
        // A reading in which joints lead nowhere must not be cheaper than the one in which they go a little.
        now.map(cost)
            .or_else(|| else_now.map(|_| LOST[usize::from(other)]))
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

/// What a reading makes of a joint, or of several.
#[derive(Clone, Copy, Default)]
struct Reading {
    /// By how far rays miss each other, weighted, square metres.
    cost: f64,
    /// Weight of the rays that have no partner.
    alone: f64,
}

fn of_joint(
    views: &[View],
    sights: &[Option<Sight>],
    seen: &[usize],
    states: u32,
    joint: usize,
) -> Reading {
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
    if let [alone] = lines[..] {
        return Reading {
            cost: 0.0,
            alone: alone.weight,
        };
    }
    // Rays that tell no depth tell all the same how far they pass from each other: else the reading that makes them
    // parallel would cost nothing.
    let cost = meet(&lines).map_or_else(|| passing(&lines), |(_, cost)| cost);
    Reading { cost, alone: 0.0 }
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
    use crate::joints::{L_ELBOW, L_WRIST, R_ELBOW, R_WRIST};
    use crate::message::Observation;

    /// Level, 1.4 m high, at this place of the floor, and looks to above the origin; the world's y is up.
    fn facing(x: f64, z: f64) -> View {
        let ahead = -DVec3::new(x, 0.0, z).normalize();
        let down = DVec3::NEG_Y;
        View {
            name: format!("{x} {z}"),
            size: [1280, 960],
            focal: DVec2::splat(1000.0),
            centre: DVec2::new(639.5, 479.5),
            distortion: Default::default(),
            rotation: DMat3::from_cols(down.cross(ahead), down, ahead).transpose(),
            position: DVec3::new(x, 1.4, z),
        }
    }

    fn at(height: f64, side: f64) -> DVec3 {
        DVec3::new(0.0, height, side)
    }

    /// Somebody who stands with hanging arms; arms at the height of the cameras.
    fn standing() -> [DVec3; EVIDENCE_JOINTS] {
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
        joints
    }

    /// These joints, by a view that sees everything so much too high.
    fn seen(view: &View, off: f64, shown: &[usize]) -> Option<Sight> {
        let mut seen = Observation::default();
        for &j in shown {
            let pixel = view.project(standing()[j] + at(off, 0.0)).unwrap();
            seen.joints2d[j] = [pixel.x as f32, pixel.y as f32, 0.9];
        }
        Some(Sight::new(view, &seen))
    }

    /// Arms at the height of the cameras, each as far to its side as the other: rays of left and right are parallel.
    #[test]
    fn a_reading_that_makes_rays_parallel_is_not_for_nothing() {
        let views = [facing(-4.2, 0.0), facing(4.2, 0.0)];
        let all: Vec<usize> = (0..EVIDENCE_JOINTS).collect();
        // One camera sees everything 3 cm too high, the other too low.
        let mut sights = [seen(&views[0], 0.03, &all), seen(&views[1], -0.03, &all)];
        assert_eq!(agree(&views, &mut sights), [0, 0]);
    }

    #[test]
    fn rays_are_not_taken_apart_because_one_alone_misses_nothing() {
        let [right, left] = [
            [R_SHOULDER, R_ELBOW, R_WRIST],
            [L_SHOULDER, L_ELBOW, L_WRIST],
        ];
        for other in [facing(4.2, 0.0), facing(0.0, 4.2)] {
            let views = [facing(-4.2, 0.0), other];
            let mut same = [
                seen(&views[0], 0.03, &right),
                seen(&views[1], -0.03, &right),
            ];
            assert_eq!(agree(&views, &mut same), [0, 0], "{}", views[1].name);
            // Nor are rays of two arms brought together because they would meet.
            let mut two = [seen(&views[0], 0.0, &right), seen(&views[1], 0.0, &left)];
            assert_eq!(agree(&views, &mut two), [0, 0], "{}", views[1].name);
        }
    }

    /// Two views that agree on somebody at these joints.
    fn moment(joints: [Option<DVec3>; EVIDENCE_JOINTS]) -> Moment {
        let nothing = Sight::new(&facing(4.2, 0.0), &Observation::default());
        Moment {
            sights: vec![Some(nothing); 2],
            joints,
            healed: 0,
            lifted: None,
            contours: Vec::new(),
        }
    }

    /// What [`settle`] exchanges of moments at so many a second.
    fn settled(rate: f64, mut moments: Vec<Moment>) -> Vec<States> {
        let times: Vec<f64> = (0..moments.len()).map(|k| k as f64 / rate).collect();
        let mut states = vec![[0; BEFORE]; moments.len()];
        let mut each: Vec<&mut Moment> = moments.iter_mut().collect();
        settle(&times, &mut each, &mut states);
        states
    }

    #[test]
    fn an_arm_beside_one_that_nobody_sees_does_not_change_sides() {
        let noisy = |k: usize| {
            let mut joints = standing().map(Some);
            joints[5..8].fill(None);
            for (j, joint) in joints.iter_mut().enumerate().skip(2).take(3) {
                let angle = (7 * k + 3 * j) as f64;
                let off = DVec3::new(angle.sin(), (2.0 * angle).cos(), (3.0 * angle).sin());
                *joint = joint.map(|p| p + 0.03 * off);
            }
            moment(joints)
        };
        let states = settled(30.0, (0..60).map(noisy).collect());
        assert!(states.iter().all(|s| *s == [0, 0]), "{states:?}");
    }

    #[test]
    fn how_long_a_stretch_of_exchanged_sides_may_be_goes_by_seconds() {
        for rate in [30_u32, 60, 120, 240] {
            let stretch = rate..rate + 3 * rate / 10;
            let each = (0..2 * rate).map(|k| {
                let mut joints = standing().map(Some);
                if stretch.contains(&k) {
                    let right = LIMB_PAIRS[..BEFORE].concat();
                    right.iter().for_each(|&j| joints.swap(j, MIRROR[j]));
                }
                moment(joints)
            });
            let states = settled(f64::from(rate), each.collect());
            let expected = |k: usize| match stretch.contains(&(k as u32)) {
                true => [0b11; BEFORE],
                false => [0; BEFORE],
            };
            let is_healed = states.iter().enumerate().all(|(k, s)| *s == expected(k));
            assert!(is_healed, "{rate} a second: {states:?}");
        }
    }
}
