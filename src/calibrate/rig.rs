//! All cameras, from nothing: the pair that tells most, then one view after the other.

use glam::{DMat3, DVec2, DVec3};
use rand::SeedableRng;
use rand::rngs::SmallRng;
use rand::seq::index;

use super::pose::Pose;
use super::relative::{Pair, Relative, angle, off, relative, turned};
use super::resect::{Seen, resect};
use super::turn::{Lifted, turns};
use super::{CalibrateError, Sizes, people, refine, rescale, world};
use crate::camera::View;
use crate::joints::EVIDENCE_JOINTS;
use crate::multiview::{Detections, Sight, Track};

/// How exact a detector is, as a share of a person's height in the picture.
const EXACTNESS: f64 = 0.02;
/// More figures than these tell nothing new to the first guesses.
const MOST_GROUPS: usize = 300;
/// Rays of a pair must meet under such an angle, radians: nearly parallel ones tell no depth.
const ANGLES: std::ops::RangeInclusive<f64> = 0.15..=2.95;
/// Pairs that are tried as a start.
const MOST_STARTS: usize = 8;
/// Answers that differ by less become one where cameras are moved to agree about everyone: radians, and distances as a
/// share of those of all cameras from the first one.
const ONE_ANSWER: f64 = 2e-3;
/// A start whose two cameras stand so nearly as an answer has them leads there again: radians. Before the other views
/// are placed, starts that lead to one answer are up to a few hundredths apart; another answer is about a radian away.
pub(super) const ON_THE_WAY: f64 = 0.1;
/// Share of a figure's joints that agree where two figures are one person.
const SAME: f64 = 0.6;
/// Share of all joints that agree where two views surely saw the same people.
const SURE: f64 = 0.6;
/// Joints by which a view is placed, at least.
const LEAST_SHARED: usize = 60;
/// How far a view may be off while the room takes shape, metres at the person.
const SIGMA: f64 = 0.15;

/// Places every camera, the first of a pair at its own origin; people are of canonical stature. Several answers that
/// differ, each from another start, in no order: most starts lead to the same one.
pub fn assemble(
    lenses: &[View],
    frames: &[Vec<Detections>],
    rate: f64,
) -> Result<Vec<Vec<Pose>>, CalibrateError> {
    answers(lenses, frames, rate, ON_THE_WAY)
}

/// As [`assemble`]; `on_the_way` is how near to an answer, radians, a start is given up for it; by 0 none is.
pub(super) fn answers(
    lenses: &[View],
    frames: &[Vec<Detections>],
    rate: f64,
    on_the_way: f64,
) -> Result<Vec<Vec<Pose>>, CalibrateError> {
    let mut heights: Vec<f64> = frames
        .iter()
        .flatten()
        .flatten()
        .filter_map(height)
        .collect();
    heights.sort_by(f64::total_cmp);
    let sigma = EXACTNESS
        * heights
            .get(heights.len() / 2)
            .ok_or(CalibrateError::NoSize)?;
    // The same guesses every time: who calibrates twice gets the same.
    let mut random = SmallRng::seed_from_u64(1);
    let mut pairs = pairs(frames, lenses.len(), sigma, &mut random);
    pairs.sort_by(|a, b| b.worth().total_cmp(&a.worth()));
    let starts = pairs
        .iter()
        .filter(|p| ANGLES.contains(&p.found.angle))
        .take(MOST_STARTS);
    let mut failure = CalibrateError::NoPair;
    let mut answers: Vec<Vec<Pose>> = Vec::new();
    for start in starts {
        let placed = start.metric(sigma).and_then(|pose| {
            let placed = Placed {
                lenses,
                frames,
                rate,
                order: vec![start.a, start.b],
                poses: vec![Pose::ORIGIN, pose],
            };
            let is_known =
                |placed: &Placed<'_>| answers.iter().any(|a| placed.leads_to(a, on_the_way));
            placed.all(&pairs, sigma, is_known, &mut random)
        });
        match placed {
            Ok(None) => {}
            Ok(Some(poses)) if answers.iter().any(|a| are_alike(&poses, a, ONE_ANSWER)) => {}
            Ok(Some(poses)) => answers.push(poses),
            Err(e) => failure = e,
        }
    }
    if answers.is_empty() {
        return Err(no_angle(lenses, &pairs).unwrap_or(failure));
    }
    Ok(answers)
}

/// Whether two lists place their cameras alike, wherever either begins and however large its room is: within `most`,
/// radians, and of distances as a share of those of all cameras from the first one.
pub(super) fn are_alike(a: &[Pose], b: &[Pose], most: f64) -> bool {
    let beside = |all: &[Pose], k: usize| {
        let (first, pose) = (&all[0], &all[k]);
        let size: f64 = all
            .iter()
            .map(|c| c.position.distance(first.position))
            .sum();
        Pose {
            rotation: pose.rotation * first.rotation.transpose(),
            position: first.rotation * (pose.position - first.position) / size,
        }
    };
    (1..a.len()).all(|k| {
        let (p, q) = (beside(a, k), beside(b, k));
        angle(&p.rotation, &q.rotation) < most && p.position.distance(q.position) < most
    })
}

/// What is wrong where the two views that agree best are too near to each other, or look into each other.
fn no_angle(lenses: &[View], pairs: &[TwoViews]) -> Option<CalibrateError> {
    let agreeing = |p: &&TwoViews| p.found.agreeing;
    let best = pairs
        .iter()
        .max_by(|p, q| agreeing(p).total_cmp(&agreeing(q)))?;
    let tells = best.found.agreeing < SURE || ANGLES.contains(&best.found.angle);
    let name = |v: usize| lenses[v].name.clone();
    (!tells)
        .then(|| CalibrateError::NoAngle(name(best.a), name(best.b), best.found.angle.to_degrees()))
}

/// A figure's longer extent on the plane z = 1.
fn height(sight: &Sight) -> Option<f64> {
    let known: Vec<DVec2> = sight.rays.iter().flatten().map(|r| r.plane).collect();
    let low = known.iter().copied().reduce(DVec2::min)?;
    let high = known.iter().copied().reduce(DVec2::max)?;
    (known.len() >= EVIDENCE_JOINTS / 2).then(|| (high - low).max_element())
}

/// Two views, and what they are to each other.
struct TwoViews {
    a: usize,
    b: usize,
    found: Relative,
    /// Joints that both saw of every two figures, numbered by joint.
    figures: Vec<Vec<(usize, Pair)>>,
}

impl TwoViews {
    /// Joints that agree, the more so the better they tell depth.
    fn worth(&self) -> f64 {
        let joints: usize = self.figures.iter().map(Vec::len).sum();
        joints as f64 * self.found.agreeing.powi(2) * self.found.angle.sin().max(0.05)
    }

    /// The second camera where people are of canonical stature.
    fn metric(&self, sigma: f64) -> Result<Pose, CalibrateError> {
        let pose = self.found.pose;
        let agrees = |(_, pair): &&(usize, Pair)| off(&pose, pair) < 2.0 * sigma;
        let same = self
            .figures
            .iter()
            .filter(|f| f.iter().filter(agrees).count() as f64 >= SAME * f.len() as f64);
        let people: Vec<world::Joints> = same
            .map(|figure| {
                let mut joints = [None; EVIDENCE_JOINTS];
                for (j, (p, q)) in figure.iter().filter(agrees).copied() {
                    joints[j] = meeting(&pose, p, q);
                }
                joints
            })
            .collect();
        let size = world::size(&people).ok_or(CalibrateError::NoSize)?;
        Ok(Pose {
            position: pose.position / size,
            ..pose
        })
    }
}

/// Where rays of a camera at the origin and of another are nearest to each other, on the first.
fn meeting(pose: &Pose, p: DVec2, q: DVec2) -> Option<DVec3> {
    let (a, b) = (p.extend(1.0).normalize(), pose.direction(q));
    let (w, c) = (-pose.position, a.dot(b));
    let scale = 1.0 - c * c;
    let along = (c * w.dot(b) - w.dot(a)) / scale;
    (scale > 1e-6 && along > 0.0).then(|| along * a)
}

fn pairs(
    frames: &[Vec<Detections>],
    views: usize,
    sigma: f64,
    random: &mut SmallRng,
) -> Vec<TwoViews> {
    let mut all = Vec::new();
    for b in 0..views {
        for a in 0..b {
            let both = frames.iter().flat_map(|f| {
                let each = f[a].iter();
                each.flat_map(|p| f[b].iter().map(move |q| (p, q)))
            });
            let figures: Vec<Vec<(usize, Pair)>> = both
                .map(|(p, q)| {
                    let joints = p.rays.iter().zip(&q.rays).enumerate();
                    joints
                        .filter_map(|(j, (p, q))| Some((j, (p.as_ref()?.plane, q.as_ref()?.plane))))
                        .collect()
                })
                .filter(|joints: &Vec<_>| joints.len() >= EVIDENCE_JOINTS / 2)
                .collect();
            let figures = thinned(figures, random);
            let groups: Vec<Vec<Pair>> = figures
                .iter()
                .map(|f| f.iter().map(|(_, pair)| *pair).collect())
                .collect();
            let lifted: Vec<(Lifted, Lifted)> = frames
                .iter()
                .flat_map(|f| {
                    let each = f[a].iter().filter_map(|p| p.lifted);
                    each.flat_map(|p| f[b].iter().filter_map(move |q| Some((p, q.lifted?))))
                })
                .collect();
            let by_turn = turns(&thinned(lifted, random), random);
            let by_turn = by_turn
                .into_iter()
                .filter_map(|turn| turned(&groups, turn, sigma));
            let found = relative(&groups, sigma, random).into_iter().chain(by_turn);
            all.extend(found.map(|found| {
                let figures = figures.clone();
                TwoViews {
                    a,
                    b,
                    found,
                    figures,
                }
            }));
        }
    }
    all
}

/// As many as tell something new, drawn from all and in their order. Every so-many-th would not do: figures of two
/// views come pair by pair, so that all of them could be of the same two detections of their frames.
fn thinned<T>(all: Vec<T>, random: &mut SmallRng) -> Vec<T> {
    if all.len() <= MOST_GROUPS {
        return all;
    }
    let mut is_drawn = vec![false; all.len()];
    for k in index::sample(random, all.len(), MOST_GROUPS) {
        is_drawn[k] = true;
    }
    let each = all.into_iter().zip(is_drawn);
    each.filter_map(|(one, drawn)| drawn.then_some(one))
        .collect()
}

/// Cameras so far, in the order in which they came.
struct Placed<'a> {
    lenses: &'a [View],
    frames: &'a [Vec<Detections>],
    rate: f64,
    order: Vec<usize>,
    poses: Vec<Pose>,
}

impl Placed<'_> {
    /// Places one view after the other, the one of which most agrees first. `None` where the two that are placed lead
    /// where another start has led: placing and settling all the others takes most of the time.
    fn all(
        mut self,
        pairs: &[TwoViews],
        sigma: f64,
        is_known: impl Fn(&Self) -> bool,
        random: &mut SmallRng,
    ) -> Result<Option<Vec<Pose>>, CalibrateError> {
        let mut tracks = self.settle()?;
        if is_known(&self) {
            return Ok(None);
        }
        loop {
            if self.order.len() == self.lenses.len() {
                return Ok(Some(self.in_order()));
            }
            let next = (0..self.lenses.len()).filter(|v| !self.order.contains(v));
            let best = next.filter_map(|v| {
                let groups = self.groups(&tracks, v, random);
                let guesses = self.directions(v, pairs);
                let (pose, agreeing) = resect(&groups, &guesses, sigma, random)?;
                (agreeing >= LEAST_SHARED).then_some((v, pose, agreeing))
            });
            let Some((v, pose, _)) = best.max_by_key(|b| b.2) else {
                let missing = (0..self.lenses.len()).find(|v| !self.order.contains(v));
                let name = missing.map_or_else(String::new, |v| self.lenses[v].name.clone());
                return Err(CalibrateError::NotLinked(name));
            };
            self.order.push(v);
            self.poses.push(pose);
            tracks = self.settle()?;
        }
    }

    /// Whether the cameras so far stand to each other as in an answer, within `most` radians.
    fn leads_to(&self, answer: &[Pose], most: f64) -> bool {
        let there: Vec<Pose> = self.order.iter().map(|v| answer[*v]).collect();
        are_alike(&self.poses, &there, most)
    }

    /// Moves the placed cameras to agree about everyone, and tells who is there.
    fn settle(&mut self) -> Result<Vec<Track>, CalibrateError> {
        let lenses: Vec<View> = self.order.iter().map(|v| self.lenses[*v].clone()).collect();
        let of_frame = |f: &Vec<Detections>| self.order.iter().map(|v| f[*v].clone()).collect();
        let frames: Vec<Vec<Detections>> = self.frames.iter().map(of_frame).collect();
        for _ in 0..2 {
            let tracks = people(&lenses, &self.poses, &frames, self.rate)?;
            refine(&mut self.poses, &tracks, SIGMA);
            let size = Sizes::new(&lenses, &self.poses, &tracks).of_room()?;
            rescale(&mut self.poses, 1.0 / size);
        }
        people(&lenses, &self.poses, &frames, self.rate)
    }

    /// Known people's joints and every figure that a view not placed yet saw at that time.
    fn groups(&self, tracks: &[Track], v: usize, random: &mut SmallRng) -> Vec<Vec<Seen>> {
        let moments = tracks.iter().flat_map(|t| &t.moments);
        let figures = moments.flat_map(|(f, moment)| {
            let each = self.frames[*f][v].iter();
            each.map(|sight| {
                let joints = moment.joints.iter().zip(&sight.rays);
                let seen = joints.filter_map(|(p, ray)| Some(((*p)?, ray.as_ref()?.plane)));
                seen.collect::<Vec<Seen>>()
            })
        });
        let figures = figures.filter(|g| g.len() >= EVIDENCE_JOINTS / 2);
        thinned(figures.collect(), random)
    }

    /// Directions that pairs with placed views suggest.
    fn directions(&self, v: usize, pairs: &[TwoViews]) -> Vec<DMat3> {
        let known = |c: usize| self.order.iter().position(|o| *o == c);
        let suggest = |p: &TwoViews| {
            let turn = p.found.pose.rotation;
            if p.b == v {
                Some(turn * self.poses[known(p.a)?].rotation)
            } else if p.a == v {
                Some(turn.transpose() * self.poses[known(p.b)?].rotation)
            } else {
                None
            }
        };
        pairs.iter().filter_map(suggest).collect()
    }

    /// The poses by camera.
    fn in_order(&self) -> Vec<Pose> {
        let mut all = vec![Pose::ORIGIN; self.order.len()];
        for (v, pose) in self.order.iter().zip(&self.poses) {
            all[*v] = *pose;
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_the_same_wherever_it_begins() {
        let at = |turn: f64, x: f64, z: f64| Pose {
            rotation: DMat3::from_rotation_y(turn),
            position: DVec3::new(x, 0.2 * x, z),
        };
        let answer = [at(0.0, 0.0, 0.0), at(1.0, 3.0, 1.0), at(2.0, -2.0, 4.0)];
        let axes = DMat3::from_rotation_x(0.7) * DMat3::from_rotation_z(-2.0);
        let elsewhere = answer.map(|pose| Pose {
            rotation: pose.rotation * axes.transpose(),
            position: 1.3 * (axes * pose.position) + DVec3::new(4.0, -1.0, 2.0),
        });
        assert!(are_alike(&answer, &elsewhere, ONE_ANSWER));
        for k in 0..answer.len() {
            let (mut turned, mut moved) = (elsewhere, elsewhere);
            turned[k].rotation = DMat3::from_rotation_y(0.01) * turned[k].rotation;
            moved[k].position.y += 0.1;
            for other in [turned, moved] {
                assert!(!are_alike(&answer, &other, ONE_ANSWER), "{k}");
            }
        }
    }

    #[test]
    fn a_pair_that_stands_as_in_an_answer_leads_to_it() {
        let at = |turn: f64, x: f64, z: f64| Pose {
            rotation: DMat3::from_rotation_y(turn),
            position: DVec3::new(x, 0.0, z),
        };
        let answer = [at(0.3, 1.0, 0.0), at(1.0, 3.0, 1.0), at(2.0, -2.0, 4.0)];
        let leads = |turn: f64, order: [usize; 2]| {
            let mut second = answer[2];
            second.rotation = DMat3::from_rotation_z(turn) * second.rotation;
            let start = Placed {
                lenses: &[],
                frames: &[],
                rate: 10.0,
                order: order.to_vec(),
                poses: vec![answer[0], second],
            };
            start.leads_to(&answer, ON_THE_WAY)
        };
        // As far off as a start that has not seen the other views yet, and as another answer's.
        assert!(leads(0.0, [0, 2]) && leads(-0.05, [0, 2]));
        assert!(!leads(0.2, [0, 2]));
        assert!(!leads(0.0, [0, 1]), "another pair of the same answer");
    }

    /// Of two people's four pairs a frame every kind is drawn, however many frames there are.
    #[test]
    fn pairs_of_every_kind_are_drawn() {
        for frames in [75, 76, 200, 290, 301, 526, 600] {
            let mut random = SmallRng::seed_from_u64(1);
            let all: Vec<usize> = (0..4 * frames).collect();
            let drawn = thinned(all, &mut random);
            assert_eq!(drawn.len(), MOST_GROUPS.min(4 * frames));
            assert!(drawn.is_sorted());
            for kind in 0..4 {
                let count = drawn.iter().filter(|k| *k % 4 == kind).count();
                assert!((50..100).contains(&count), "{frames} frames: {count}");
            }
        }
    }
}
