//! Who is who: detections of several views go in frame by frame, people with one detection a view and an identity over
//! time come out.
//!
//! Known people take the detections whose rays pass near their joints; what is left is grouped so that within a group
//! every view agrees with every other. Somebody new must persist and be built like a body: two views alone see ghosts.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use super::exchange;
use super::groups::{groups, ray_distance};
use super::moment::Moment;
use super::sight::{LIMB_PAIRS, Ray, Sight, distance};
use super::triangulate::{Joints3d, triangulate};
use crate::assignment::Matcher;
use crate::camera::View;
use crate::joints::{EVIDENCE_JOINTS, MIRROR};

/// Mean distance of a person's rays from their joints beyond which they are somebody else's, metres.
pub const REACH: f64 = 0.35;
/// How much further a person may have gone for every second that two views have missed them, metres, and at most.
const ROAM: [f64; 2] = [1.5, 0.4];
/// Seconds between frames in which somebody goes no farther than `REACH`, and the most beyond them that count as if
/// they had been missed: what is farther apart, motion must tell.
const STEP: [f64; 2] = [1.0 / 30.0, 0.2];
/// By how much, a second, somebody's velocity is learnt; the fastest that anybody goes, metres a second, and for how
/// long they are expected to go on, seconds.
const SPEED_LEARNT: f64 = 10.0;
const FASTEST: f64 = 10.0;
const GOES_ON: f64 = 1.0;
/// Bodies whose joints are so near on average are one person's, metres.
const ONE_BODY: f64 = 0.12;
/// Shared joints under which two detections cannot be compared.
pub(super) const LEAST_SHARED: usize = 5;
/// Seconds without any view after which somebody is gone, and without two of them: one view alone may follow somebody
/// else.
const MEMORY: f64 = 1.0;
pub(super) const ONE_VIEW: f64 = 10.0;
/// Seconds, from frame to frame, for which three views or more must agree about somebody before they count, and two:
/// three frames and ten at 30 a second, and a little less, so that neither rounding nor uneven times decide anything.
pub(super) const PROOF: [f64; 2] = [0.055, 0.285];
/// Neck to middle of the hips, metres: no body is outside of this.
const TRUNK: [f64; 2] = [0.25, 0.85];
/// The longest bones that are nobody's, metres: upper arm, forearm, thigh, shank.
const BONES: [(usize, usize, f64); 8] = [
    (2, 3, 0.5),
    (5, 6, 0.5),
    (3, 4, 0.45),
    (6, 7, 0.45),
    (8, 9, 0.7),
    (11, 12, 0.7),
    (9, 10, 0.7),
    (12, 13, 0.7),
];

/// Everyone one view sees in one frame.
pub type Detections = Vec<Sight>;

/// Joints of one person in space, world axes, metres; `None` where they are not known.
pub(super) type Joints = [Option<DVec3>; EVIDENCE_JOINTS];

/// Everyone in one frame, by view.
type Frame<'a> = [&'a [Sight]];

/// One person over time.
#[derive(Debug, Clone)]
pub struct Track {
    /// From 1, by first frame.
    pub id: u32,
    /// Frames with at least one view, rising.
    pub moments: Vec<(usize, Moment)>,
}

struct Live {
    moments: Vec<(usize, Moment)>,
    /// Exchanged limbs of every moment.
    states: Vec<exchange::States>,
    joints: Joints,
    /// Frame of the joints, and how fast they went there, metres a second.
    at: usize,
    velocity: DVec3,
    /// How far away they are, as a part of what one view alone takes them to be.
    farther: f64,
    /// Last frame in which two views saw them, and one did.
    met: usize,
    seen: usize,
    /// Frames with three views, and with two.
    proof: [usize; 2],
}

impl Live {
    /// Whether nobody saw them in the frame before.
    fn is_absent(&self, f: usize) -> bool {
        f > self.seen + 1
    }

    /// Frames in which two views might have seen them and did not.
    fn away(&self, f: usize) -> usize {
        (f - self.met).saturating_sub(1)
    }

    /// Where their joints are in a frame if they go on as they went.
    fn ahead(&self, f: usize, rate: f64) -> Joints {
        let seconds = ((f - self.at) as f64 / rate).min(GOES_ON);
        self.joints.map(|p| p.map(|p| p + seconds * self.velocity))
    }

    /// Takes joints for theirs; those that are not known go along with the others. How fast that was is learnt.
    fn go(&mut self, f: usize, now: &Joints, rate: f64) {
        let each = self.joints.iter().zip(now);
        let ways: Vec<DVec3> = each
            .filter_map(|(was, now)| Some((*now)? - (*was)?))
            .collect();
        let mut by = DVec3::ZERO;
        if ways.len() >= LEAST_SHARED && f > self.at {
            by = median(&ways);
            let seconds = (f - self.at) as f64 / rate;
            let now = (by / seconds).clamp_length_max(FASTEST);
            self.velocity += (SPEED_LEARNT * seconds).min(1.0) * (now - self.velocity);
        }
        for (was, now) in self.joints.iter_mut().zip(now) {
            *was = now.or(was.map(|p| p + by));
        }
        self.at = f;
    }

    /// Goes on as one with somebody who was the same: of every frame what more views saw stays.
    fn join(&mut self, other: Self) {
        let views = |moment: &Moment| moment.sights.iter().flatten().count();
        for ((f, moment), states) in other.moments.into_iter().zip(other.states) {
            match self.moments.binary_search_by_key(&f, |(own, _)| *own) {
                Ok(k) if views(&moment) > views(&self.moments[k].1) => {
                    (self.moments[k].1, self.states[k]) = (moment, states);
                }
                Ok(_) => {}
                Err(k) => {
                    self.moments.insert(k, (f, moment));
                    self.states.insert(k, states);
                }
            }
        }
        for (own, other) in self.proof.iter_mut().zip(other.proof) {
            *own = (*own).max(other);
        }
    }

    /// Adds a frame.
    fn add(&mut self, views: &[View], f: usize, look: Look, rate: f64) {
        let known = look.joints.iter().flatten().count();
        self.seen = f;
        if look.is_met() {
            self.met = f;
            self.go(f, &look.joints, rate);
            if is_body(&look.joints) {
                self.proof[usize::from(look.count() < 3)] += 1;
                for (view, sight) in views.iter().zip(&look.sights) {
                    self.measure(view, sight.as_ref(), DISTANCE_LEARNT / rate);
                }
            }
        } else if let Some((view, sight)) = shows_most(views, &look.sights) {
            let now = self.followed(view, sight, DISTANCE_TAKEN / rate);
            self.go(f, &now, rate);
        }
        let joints = match known >= LEAST_SHARED {
            true => look.joints,
            false => [None; EVIDENCE_JOINTS],
        };
        let moment = Moment {
            sights: look.sights,
            joints,
            healed: 0,
            lifted: None,
            contours: Vec::new(),
        };
        self.moments.push((f, moment));
        self.states.push(look.states);
    }
}

/// Of each coordinate the median, of one place at least.
fn median(places: &[DVec3]) -> DVec3 {
    let of = |axis: usize| {
        let mut each: Vec<f64> = places.iter().map(|p| p[axis]).collect();
        each.sort_by(f64::total_cmp);
        each[each.len() / 2]
    };
    DVec3::new(of(0), of(1), of(2))
}

/// By how much, a second, what a view says of distance is learnt from where two meet, and believed where it is alone.
const DISTANCE_LEARNT: f64 = 1.0;
const DISTANCE_TAKEN: f64 = 3.0;
/// By what factor somebody may be nearer or farther than where one view has followed them to.
const NEARER: f64 = 1.15;

impl Live {
    /// Which views saw them when somebody last did.
    fn seen_by(&self) -> Vec<bool> {
        let last = self.moments.last();
        last.map_or_else(Vec::new, |(_, moment)| {
            moment.sights.iter().map(Option::is_some).collect()
        })
    }

    /// Learns how what a view says of their distance goes with where they are.
    fn measure(&mut self, view: &View, sight: Option<&Sight>, share: f64) {
        let told = sight.and_then(Sight::depth);
        if let Some((depth, told)) = depth(view, &self.joints).zip(told) {
            // The first time there is nothing to blend with.
            let share = if self.proof.iter().sum::<usize>() < 2 {
                1.0
            } else {
                share.min(1.0)
            };
            self.farther *= (depth / told / self.farther).powf(share);
        }
    }

    /// Where their joints are by the one view that sees them: on its rays, and nearer or farther as it says.
    fn followed(&self, view: &View, sight: &Sight, share: f64) -> Joints {
        let Some(depth) = depth(view, &self.joints) else {
            return [None; EVIDENCE_JOINTS];
        };
        let told = sight.depth().map_or(depth, |told| self.farther * told);
        let scale = (told / depth).powf(share.min(1.0));
        let now = |joint: DVec3, ray: &Ray| {
            let along = (joint - view.position).dot(ray.direction);
            view.position + scale * along.max(0.0) * ray.direction
        };
        let each = self.joints.iter().zip(&sight.rays);
        let moved = each.filter_map(|(p, ray)| Some(now((*p)?, ray.as_ref()?) - (*p)?));
        let (sum, count) = moved.fold((DVec3::ZERO, 0), |(s, n), by| (s + by, n + 1));
        if count == 0 {
            return [None; EVIDENCE_JOINTS];
        }
        std::array::from_fn(|j| {
            let own = self.joints[j]?;
            Some(match &sight.rays[j] {
                Some(ray) => now(own, ray),
                None => own + sum / f64::from(count),
            })
        })
    }
}

/// How far from a view joints are on average, metres.
fn depth(view: &View, joints: &Joints) -> Option<f64> {
    let each = joints.iter().flatten();
    let (sum, count) = each.fold((0.0, 0), |(s, n), p| (s + view.to_camera(*p).z, n + 1));
    let depth = sum / f64::from(count);
    (count > 0 && depth > 0.0).then_some(depth)
}

/// The view that shows most joints of somebody, the first of several; `None` where nobody sees them.
fn shows_most<'a>(views: &'a [View], sights: &'a [Option<Sight>]) -> Option<(&'a View, &'a Sight)> {
    let each = views.iter().zip(sights).rev();
    let seen = each.filter_map(|(v, s)| Some((v, s.as_ref()?)));
    seen.max_by_key(|(_, sight)| sight.rays.iter().flatten().count())
}

/// Somebody whom fewer than two views saw the last time.
#[derive(Debug)]
pub(super) struct Followed {
    /// Where their joints are about, by what one view tells.
    pub joints: Joints,
    /// By view, whether it saw them when somebody last did.
    pub seen_by: Vec<bool>,
    /// Whether nobody saw them the last time.
    pub is_absent: bool,
}

impl Followed {
    /// Whether what several views see may be a body, about where one of them has followed this person to.
    fn goes_on(&self, views: &[View], mut sights: Vec<Option<Sight>>) -> bool {
        exchange::agree(views, &mut sights);
        let joints = solve(views, &sights).points;
        let mut followed = (0..views.len()).filter(|&v| sights[v].is_some() && self.seen_by[v]);
        let is_near = |v: usize| {
            let [was, now] = [&self.joints, &joints].map(|joints| depth(&views[v], joints));
            let ratio = was.zip(now).map(|(was, now)| now / was);
            ratio.is_some_and(|r| (1.0 / NEARER..NEARER).contains(&r))
        };
        let is_told = [1, 8, 11].iter().all(|&j| joints[j].is_some());
        (is_body(&joints) || !is_told) && followed.all(is_near)
    }

    /// Of two views' detections the one that is not theirs: their rays do not meet, or not about where one view has
    /// followed them to, whose own stays. None where the two have no joint in common: nothing tells then.
    fn stranger(&self, views: &[View], sights: Vec<Option<Sight>>) -> Option<usize> {
        let all = sights.iter().enumerate();
        let own: Vec<(usize, &Sight)> = all.filter_map(|(v, s)| Some((v, s.as_ref()?))).collect();
        let [(a, of_a), (b, of_b)] = own[..] else {
            return None;
        };
        let mut both = of_a.rays.iter().zip(&of_b.rays);
        if !both.any(|(p, q)| p.is_some() && q.is_some()) {
            return None;
        }
        let apart = ray_distance((&views[a], of_a), (&views[b], of_b));
        let meet = apart.is_none_or(|d| d < REACH);
        let stranger = if self.seen_by[a] { b } else { a };
        (!(meet && self.goes_on(views, sights))).then_some(stranger)
    }
}

/// Detections of a frame, of everybody known as `[person][view]`.
pub(super) type Taken = Vec<Vec<Option<usize>>>;

/// Views with the number of their detection.
fn views_of(chosen: &[Option<usize>]) -> impl Iterator<Item = (usize, usize)> {
    let each = chosen.iter().enumerate();
    each.filter_map(|(v, d)| Some((v, (*d)?)))
}

/// Where one view has followed somebody, the distance is not known well: another one's detection may be theirs that is
/// further off than others', and one that is not too far may be somebody else's. Mends what everybody took of a frame,
/// `followed` by person, and says in which groups of detections nobody known is. `may_be` tells of a person, a view and
/// a detection whether looks allow it to be theirs.
pub(super) fn rejoin<'a>(
    views: &[View],
    frame: &[Vec<&'a Sight>],
    followed: &[Option<Followed>],
    may_be: impl Fn(usize, usize, usize) -> bool,
    taken: &mut Taken,
) -> Taken {
    let sights = |chosen: &[Option<usize>]| -> Vec<Option<Sight>> {
        let each = chosen.iter().enumerate();
        each.map(|(v, d)| Some(frame[v][(*d)?].clone())).collect()
    };
    let mut owners: HashMap<(usize, usize), usize> = HashMap::new();
    for (k, followed) in followed.iter().enumerate() {
        let Some(followed) = followed else {
            continue;
        };
        if let Some(v) = followed.stranger(views, sights(&taken[k])) {
            taken[k][v] = None;
        }
        let mut own = views_of(&taken[k]);
        if let (Some(alone), None) = (own.next(), own.next()) {
            owners.insert(alone, k);
        }
    }
    let all: HashSet<(usize, usize)> = taken.iter().flat_map(|own| views_of(own)).collect();
    let mut left: Vec<(usize, usize, &'a Sight)> = Vec::new();
    for (v, sights) in frame.iter().enumerate() {
        let is_left = |d: usize| !all.contains(&(v, d)) || owners.contains_key(&(v, d));
        let each = sights.iter().enumerate().filter(|(d, _)| is_left(*d));
        left.extend(each.map(|(d, sight)| (v, d, *sight)));
    }
    let mut new = Vec::new();
    for chosen in groups(views, &left) {
        let known: Vec<usize> = views_of(&chosen)
            .filter_map(|at| owners.get(&at).copied())
            .collect();
        let goes_on = |k: usize| {
            let followed = followed[k].as_ref();
            views_of(&chosen).all(|(v, d)| may_be(k, v, d))
                && followed.is_some_and(|f| f.goes_on(views, sights(&chosen)))
        };
        let is_somebody = || {
            let mut sights = sights(&chosen);
            exchange::agree(views, &mut sights);
            is_body(&solve(views, &sights).points)
        };
        match known[..] {
            [] => new.push(chosen),
            [k] if goes_on(k) => taken[k] = chosen,
            // Of whoever nobody saw the last time one view knows no better than two where they see somebody.
            [k] if followed[k].as_ref().is_some_and(|f| f.is_absent) && is_somebody() => {
                taken[k].fill(None);
                new.push(chosen);
            }
            // Rays of two people may meet where nobody is.
            _ => {}
        }
    }
    new
}

/// How far from their joints the rays of somebody may pass whom two views have missed for so many seconds, frames being
/// so many seconds apart, metres.
pub(super) fn reach(missed: f64, interval: f64) -> f64 {
    let beyond = (interval - STEP[0]).clamp(0.0, STEP[1]);
    REACH + (ROAM[0] * (missed + beyond)).min(ROAM[1])
}

/// Whether somebody counts whom three views or more have seen for so long, and two, where so much is needed of both.
pub(super) fn is_proven<T>(proof: [T; 2], needed: [T; 2]) -> bool
where
    T: Copy + PartialOrd + std::ops::Add<Output = T>,
{
    proof[0] >= needed[0] || proof[0] + proof[1] >= needed[1]
}

/// The same in frames, of which a sequence has so many: of one frame nobody can ask for more.
fn frames_needed(frames: usize, rate: f64) -> [usize; 2] {
    PROOF.map(|seconds| (1.0 + (seconds * rate).ceil()).min(frames as f64) as usize)
}

/// What detections of one frame, one a view, are of somebody.
struct Look {
    chosen: Vec<Option<usize>>,
    /// Exchanged limbs healed, a view that is about somebody else left out.
    sights: Vec<Option<Sight>>,
    states: exchange::States,
    joints: Joints,
}

impl Look {
    /// `None` where no view sees them.
    fn new(views: &[View], frame: &Frame<'_>, chosen: Vec<Option<usize>>) -> Option<Self> {
        let each = chosen.iter().enumerate();
        let mut sights: Vec<Option<Sight>> =
            each.map(|(v, d)| Some(frame[v][(*d)?].clone())).collect();
        let count = sights.iter().flatten().count();
        if count == 0 {
            return None;
        }
        let mut states = exchange::agree(views, &mut sights);
        let mut joints = solve(views, &sights);
        if count > 2 {
            let off = |v: usize| {
                sights[v].as_ref().map_or(0.0, |s| {
                    mean_distance(&views[v], s, &joints.points, REACH).unwrap_or(0.0)
                })
            };
            let worst = (0..views.len())
                .map(|v| (v, off(v)))
                .max_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((v, _)) = worst.filter(|(_, off)| *off > REACH) {
                sights[v] = None;
                states.iter_mut().for_each(|state| *state &= !(1 << v));
                joints = solve(views, &sights);
            }
        }
        Some(Self {
            chosen,
            sights,
            states,
            joints: joints.points,
        })
    }

    /// Views that see them.
    fn count(&self) -> usize {
        self.sights.iter().flatten().count()
    }

    /// Whether two views tell where they are.
    fn is_met(&self) -> bool {
        self.count() >= 2 && self.joints.iter().flatten().count() >= LEAST_SHARED
    }

    /// Whether another look is of the same body, all sides exchanged or not.
    fn is_of_one(&self, other: &Self) -> bool {
        let near = |swapped: bool| {
            let to = |j: usize| if swapped { MIRROR[j] } else { j };
            let each = 0..EVIDENCE_JOINTS;
            let pairs = each.filter_map(|j| Some((self.joints[j]?, other.joints[to(j)]?)));
            is_one_body(pairs)
        };
        self.is_met() && other.is_met() && (near(false) || near(true))
    }
}

/// Whether joints of two bodies, pair by pair, lie so near that they are one person's; too few pairs tell nothing.
pub(super) fn is_one_body(pairs: impl Iterator<Item = (DVec3, DVec3)>) -> bool {
    let (sum, count) = pairs.fold((0.0, 0), |(s, n), (p, q)| (s + p.distance(q), n + 1));
    count >= LEAST_SHARED && sum < ONE_BODY * count as f64
}

/// Of two looks that are of one body one person gets what both show: who is proven, else who was there first. Somebody
/// proven whose look was taken has a past of their own and goes on alone; anybody else was the same person all along.
fn merge(
    views: &[View],
    frame: &Frame<'_>,
    looks: &mut [Option<Look>],
    live: &mut [Live],
    needed: [usize; 2],
) {
    for k in 1..looks.len() {
        let (before, rest) = looks.split_at(k);
        let Some(own) = &rest[0] else {
            continue;
        };
        let is_same = |l: &Option<Look>| l.as_ref().is_some_and(|l| l.is_of_one(own));
        let Some(first) = before.iter().position(is_same) else {
            continue;
        };
        let [is_first, is_own] = [first, k].map(|k| is_proven(live[k].proof, needed));
        let (one, double) = match is_own && !is_first {
            true => (k, first),
            false => (first, k),
        };
        let Some((own, other)) = looks[double].take().zip(looks[one].take()) else {
            continue;
        };
        let both = other.chosen.iter().zip(&own.chosen);
        let both = both.map(|(one, other)| one.or(*other)).collect();
        looks[one] = Look::new(views, frame, both);
        if !(is_first && is_own) {
            let double = std::mem::replace(&mut live[double], empty());
            live[one].join(double);
        }
    }
}

/// Finds everyone in `frames`: per frame, per view, who is seen there. `rate` is frames a second.
pub fn track(views: &[View], frames: &[Vec<Detections>], rate: f64) -> Vec<Track> {
    track_by(views, &vec![true; views.len()], frames, rate)
}

/// The same by some of the views: of those that are not `used` nobody is taken.
pub(super) fn track_by(
    views: &[View],
    used: &[bool],
    frames: &[Vec<Detections>],
    rate: f64,
) -> Vec<Track> {
    let frames_in = |seconds: f64| (seconds * rate).round().max(1.0) as usize;
    let (patience, alone) = (frames_in(MEMORY), frames_in(ONE_VIEW));
    let needed = frames_needed(frames.len(), rate);
    let (mut live, mut done): (Vec<Live>, Vec<Live>) = (Vec::new(), Vec::new());
    let mut matcher = Matcher::default();
    for (f, frame) in frames.iter().enumerate() {
        let seen = frame.iter().zip(used);
        let seen = seen.map(|(d, used)| if *used { &d[..] } else { &[] });
        let frame: &Frame<'_> = &seen.collect::<Vec<_>>();
        let mut gone = Vec::new();
        live.retain_mut(|t| {
            let stays = match is_proven(t.proof, needed) {
                true => f - t.seen <= patience && f - t.met <= alone,
                false => f - t.met <= patience,
            };
            if !stays {
                gone.push(std::mem::replace(t, empty()));
            }
            stays
        });
        done.extend(gone);
        let standing = live.iter().map(|t| Standing {
            is_proven: is_proven(t.proof, needed),
            is_absent: t.is_absent(f),
            reach: [0, t.away(f)].map(|missed| reach(missed as f64 / rate, 1.0 / rate)),
            ahead: t.ahead(f, rate),
        });
        let standing: Vec<Standing> = standing.collect();
        let mut taken = take(views, frame, &live, &standing, &mut matcher);
        let followed = live.iter().map(|t| {
            (t.away(f) > 0).then(|| Followed {
                joints: t.joints,
                seen_by: t.seen_by(),
                is_absent: t.is_absent(f),
            })
        });
        let followed: Vec<Option<Followed>> = followed.collect();
        let sights: Vec<Vec<&Sight>> = frame.iter().map(|d| d.iter().collect()).collect();
        let new = rejoin(views, &sights, &followed, |_, _, _| true, &mut taken);
        let each = taken.into_iter().chain(new);
        let looks = each.map(|chosen| Look::new(views, frame, chosen));
        let mut looks: Vec<Option<Look>> = looks.collect();
        live.resize_with(looks.len(), empty);
        merge(views, frame, &mut looks, &mut live, needed);
        for (t, look) in live.iter_mut().zip(looks) {
            if let Some(look) = look {
                t.add(views, f, look, rate);
            }
        }
        // Somebody new must be built like a body; of two who are one there is nothing left.
        live.retain(|t| match t.moments.len() {
            0 => false,
            1 => is_body(&t.joints),
            _ => true,
        });
    }
    done.extend(live);
    done.retain(|t| is_proven(t.proof, needed));
    done.sort_by_key(|t| t.moments[0].0);
    let number = |(k, t): (usize, Live)| Track {
        id: k as u32 + 1,
        moments: settled(t, rate),
    };
    done.into_iter().enumerate().map(number).collect()
}

/// What is asked of everybody known before they take detections.
struct Standing {
    is_proven: bool,
    /// Whether nobody saw them in the last frame.
    is_absent: bool,
    /// How far from their joints rays may pass, metres: as of somebody just seen, and by how long they have been
    /// missed.
    reach: [f64; 2],
    /// Where their joints are if they go on as they went.
    ahead: Joints,
}

/// What everybody known takes of a frame. Who is proven takes first: a ghost lies on a real person's rays and would go
/// on living from them. But whoever was missed takes what is left by those who were seen, and from farther away what is
/// left by those near by. Nobody knows who stops and who goes on: rays may pass near where they were as well as near
/// where they were going.
fn take(
    views: &[View],
    frame: &Frame<'_>,
    live: &[Live],
    standing: &[Standing],
    matcher: &mut Matcher,
) -> Taken {
    let mut taken: Taken = vec![vec![None; views.len()]; live.len()];
    let mut free: Vec<Vec<bool>> = frame.iter().map(|d| vec![true; d.len()]).collect();
    let order = [(false, true), (false, false), (true, true), (true, false)];
    for (far, (absent, proven)) in [0, 1]
        .into_iter()
        .flat_map(|far| order.map(|who| (far, who)))
    {
        for (v, (view, detections)) in views.iter().zip(frame).enumerate() {
            let asks = |t: &usize| {
                let own = &standing[*t];
                (own.is_absent, own.is_proven) == (absent, proven) && taken[*t][v].is_none()
            };
            let people: Vec<usize> = (0..live.len()).filter(asks).collect();
            let near = |t: usize, d: usize| {
                let (own, sight) = (&standing[t], &detections[d]);
                let to = |joints: &Joints| closeness(view, sight, joints, own.reach[far]);
                to(&live[t].joints).max(to(&own.ahead))
            };
            let left: Vec<usize> = (0..detections.len()).filter(|&d| free[v][d]).collect();
            let scores: Vec<f32> = people
                .iter()
                .flat_map(|&t| left.iter().map(move |&d| (t, d)))
                .map(|(t, d)| near(t, d))
                .collect();
            let chosen = matcher.solve(people.len(), left.len(), &scores);
            for (&t, d) in people.iter().zip(chosen) {
                if let Some(d) = d.map(|d| left[d]) {
                    (taken[t][v], free[v][d]) = (Some(d), false);
                }
            }
        }
    }
    taken
}

/// A person's frames with left and right as they are.
fn settled(mut t: Live, rate: f64) -> Vec<(usize, Moment)> {
    let times: Vec<f64> = t.moments.iter().map(|(f, _)| *f as f64 / rate).collect();
    let mut moments: Vec<&mut Moment> = t.moments.iter_mut().map(|(_, m)| m).collect();
    exchange::settle(&times, &mut moments, &mut t.states);
    for (moment, states) in moments.into_iter().zip(&t.states) {
        moment.healed = states.iter().map(|s| s.count_ones() as usize).sum();
    }
    t.moments
}

fn empty() -> Live {
    Live {
        moments: Vec::new(),
        states: Vec::new(),
        joints: [None; EVIDENCE_JOINTS],
        at: 0,
        velocity: DVec3::ZERO,
        farther: 1.0,
        met: 0,
        seen: 0,
        proof: [0; 2],
    }
}

fn solve(views: &[View], sights: &[Option<Sight>]) -> Joints3d {
    let all: Vec<_> = sights.iter().map(Option::as_ref).collect();
    triangulate(views, &all)
}

/// How well a detection goes with somebody whose joints are known, above 0; 0 where its rays are farther than `reach`
/// from them, metres.
pub fn closeness(view: &View, sight: &Sight, joints: &Joints, reach: f64) -> f32 {
    // A detector may have exchanged all sides.
    let readings = [
        mean_distance(view, sight, joints, reach),
        mean_distance(view, &mirrored(sight), joints, reach),
    ];
    let least = readings.into_iter().flatten().fold(f64::INFINITY, f64::min);
    (1.0 - least / reach).max(0.0) as f32
}

/// All sides exchanged.
pub(super) fn mirrored(sight: &Sight) -> Sight {
    sight.exchanged(LIMB_PAIRS[0]).exchanged(LIMB_PAIRS[1])
}

/// Mean distance of a view's rays from joints, none of which counts more than twice the `reach`, metres; `None` where
/// too few are shared.
fn mean_distance(view: &View, sight: &Sight, joints: &Joints, reach: f64) -> Option<f64> {
    let each: Vec<f64> = sight
        .rays
        .iter()
        .zip(joints)
        .filter_map(|(ray, joint)| {
            Some(distance(view.position, ray.as_ref()?.direction, (*joint)?).min(2.0 * reach))
        })
        .collect();
    (each.len() >= LEAST_SHARED).then(|| each.iter().sum::<f64>() / each.len() as f64)
}

/// Whether joints are as far from each other as a body's.
pub fn is_body(joints: &Joints) -> bool {
    let (Some(neck), Some(r), Some(l)) = (joints[1], joints[8], joints[11]) else {
        return false;
    };
    let trunk = neck.distance((r + l) / 2.0);
    let lengths = BONES
        .iter()
        .filter_map(|&(a, b, most)| Some((joints[a]?.distance(joints[b]?), most)));
    let (mut known, mut long) = (0, 0);
    for (length, most) in lengths {
        known += 1;
        long += usize::from(length > most);
    }
    (TRUNK[0]..TRUNK[1]).contains(&trunk) && known >= 3 && 2 * long < known
}

/// The detection whose rays pass nearest to joints, sides exchanged where that is nearer; `None` where none is within
/// reach.
pub fn nearest_sight(
    view: &View,
    detections: &[Sight],
    joints: &[DVec3; EVIDENCE_JOINTS],
) -> Option<Sight> {
    let known = joints.map(Some);
    let each = detections.iter().filter_map(|sight| {
        let mut sight = sight.clone();
        exchange::follow(view, &mut sight, joints);
        Some((mean_distance(view, &sight, &known, REACH)?, sight))
    });
    let near = each.filter(|(d, _)| *d < REACH);
    near.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, s)| s)
}

/// The detection of every body in one view, sides exchanged where that is nearer: one detection a body, one body a
/// detection, and `None` where none is within reach. `people`: joints in the world, metres.
pub fn matched(
    view: &View,
    detections: &[Sight],
    people: &[[DVec3; EVIDENCE_JOINTS]],
) -> Vec<Option<Sight>> {
    let pair = |joints: &[DVec3; EVIDENCE_JOINTS], sight: &Sight| {
        let mut sight = sight.clone();
        exchange::follow(view, &mut sight, joints);
        let off = mean_distance(view, &sight, &joints.map(Some), REACH);
        let near = off.map_or(0.0, |off| (1.0 - off / REACH).max(0.0));
        (near as f32, sight)
    };
    let pairs: Vec<(f32, Sight)> = people
        .iter()
        .flat_map(|joints| detections.iter().map(|d| pair(joints, d)))
        .collect();
    let scores: Vec<f32> = pairs.iter().map(|(near, _)| *near).collect();
    let mut matcher = Matcher::default();
    let chosen = matcher.solve(people.len(), detections.len(), &scores);
    let each = chosen.iter().enumerate();
    each.map(|(k, d)| d.map(|d| pairs[k * detections.len() + d].1.clone()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Brown;
    use crate::message::Observation;

    /// Somebody who stands at the origin, arms hanging, moved by so much.
    fn standing(by: DVec3) -> Joints {
        let rest = [
            (0.0, -0.75),
            (0.0, -0.5),
            (-0.2, -0.5),
            (-0.25, -0.2),
            (-0.25, 0.05),
            (0.2, -0.5),
            (0.25, -0.2),
            (0.25, 0.05),
            (-0.1, 0.0),
            (-0.1, 0.45),
            (-0.1, 0.85),
            (0.1, 0.0),
            (0.1, 0.45),
            (0.1, 0.85),
        ];
        rest.map(|(x, y)| Some(DVec3::new(x, y, 0.0) + by))
    }

    #[test]
    fn nobody_is_near_who_is_farther_than_the_reach() {
        let view = View {
            distortion: Brown::default(),
            ..View::around(0.0)
        };
        let joints = standing(DVec3::ZERO);
        let near = |x: f64, reach: f64| {
            let mut seen = Observation::default();
            for (out, joint) in seen.joints2d.iter_mut().zip(standing(x * DVec3::X)) {
                let pixel = joint.and_then(|p| view.project(p)).expect("in front");
                *out = [pixel.x as f32, pixel.y as f32, 0.9];
            }
            closeness(&view, &Sight::new(&view, &seen), &joints, reach)
        };
        for missed in [0.0, 0.1, 0.24, 1.0, 10.0] {
            let reach = reach(missed, STEP[0]);
            assert!(near(0.5 * reach, reach) > 0.3, "{missed} s");
            for x in [1.2 * reach, 1.5, 3.0] {
                assert_eq!(near(x, reach), 0.0, "{missed} s, {x} m");
            }
        }
    }

    /// What a view sees of somebody at these joints, of these alone.
    fn seen(view: &View, joints: &Joints, shown: std::ops::Range<usize>) -> Sight {
        let mut seen = Observation::default();
        for j in shown {
            let pixel = joints[j].and_then(|p| view.project(p)).expect("in front");
            seen.joints2d[j] = [pixel.x as f32, pixel.y as f32, 0.9];
        }
        Sight::new(view, &seen)
    }

    /// For four seconds one view sees the upper body alone, the other the legs, while they walk.
    #[test]
    fn views_that_share_no_joint_go_on_with_somebody() {
        let views = [0.0, 90.0].map(View::around);
        let at = |f: usize| {
            standing(f64::from(f.saturating_sub(30).min(120) as u32) * 0.3 / 30.0 * DVec3::X)
        };
        let frames = (0..180).map(|f| {
            let shown = match (30..150).contains(&f) {
                true => [0..8, 8..EVIDENCE_JOINTS],
                false => [0..EVIDENCE_JOINTS, 0..EVIDENCE_JOINTS],
            };
            let each = views.iter().zip(shown);
            each.map(|(view, shown)| vec![seen(view, &at(f), shown)])
                .collect()
        });
        let frames: Vec<Vec<Detections>> = frames.collect();
        let people = track(&views, &frames, 30.0);
        assert_eq!(people.len(), 1);
        assert_eq!(people[0].moments.len(), frames.len());
        for (f, moment) in &people[0].moments {
            assert!(moment.sights.iter().all(Option::is_some), "frame {f}");
        }
    }
}
