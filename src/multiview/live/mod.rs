//! The fit while it happens: what several cameras see at one instant goes in, bodies in the world come out at once.
//!
//! `synchroniser` brings observations to common instants. Known people take the detections whose rays pass near the
//! joints where they are expected; what is left is grouped as in a recording. Everybody is then fitted with the
//! 29-degree skeleton of the fit to one camera and its energy, with a reprojection term for every view; how tall people
//! are the views see together. World axes are those of the calibration, metres.

mod build;
mod confidence;
mod energy;
mod identity;
mod looks;
mod met;
mod person;
mod publish;
mod seen;
mod settings;
mod synchroniser;

use std::collections::HashSet;

use self::identity::Identities;
use self::person::{Context, Person};
use self::publish::write_body;
use self::seen::{Seen, tell_alone};
use super::groups::groups;
use super::people::{Followed, Joints, closeness, reach, rejoin};
use super::sight::Sight;
use super::world;
use crate::assignment::Matcher;
use crate::body::skeleton::{Posed, Skeleton, rotation_vector_near};
use crate::camera::{RESTART_NS, View};
use crate::fit::config::ConfigError;
use crate::fit::{FitConfig, MotionModel, PoseSolver, VETO};
use crate::joints::{NECK, PELVIS};
use crate::message::{Body, BodyFrame, FLAG_FILE_TIME, MAX_PEOPLE, World};

pub use settings::without_meaning;
pub use synchroniser::{FrameSet, LeftOut, Synchroniser};

/// Shortest and longest step between instants, seconds.
const STEP: [f64; 2] = [1e-3, 1.0];
/// Share of a score that looks which differ in everything take away, and the difference that one person has anyway.
const LOOKS: [f64; 2] = [0.6, 0.15];
/// What a detection's fit to somebody without identity is worth beside one to somebody known.
const NEWCOMER: f32 = 0.6;
/// Pelvis and neck of somebody new are nobody known's, who is no nearer than this to both, metres.
const APART: f64 = 0.25;
/// Whoever has walked this share of the views' distance while rays met in them is the one whom one view follows: nobody
/// else stays on its rays for so long.
const ALONG: f64 = 0.3;

/// Fits everyone whom calibrated cameras see, instant by instant. Pure and deterministic: time comes from the frames
/// alone.
#[derive(Debug)]
pub struct LiveFit {
    views: Vec<View>,
    config: FitConfig,
    model: MotionModel,
    solver: PoseSolver,
    matcher: Matcher,
    world: World,
    present: Vec<Person>,
    identities: Identities,
    newest: Option<Newest>,
    /// Seconds that the machine slept since the newest instant.
    slept: f64,
    sequence: u64,
}

/// What bodies say of the newest instant.
#[derive(Debug, Clone, Copy)]
struct Newest {
    capture_ns: u64,
    flags: u32,
    stage_times: crate::message::StageTimes,
}

impl LiveFit {
    /// A fit that has seen nobody. `views` are the cameras as their pictures show them, in the order of a
    /// [`FrameSet`]'s. Of `config` what [`without_meaning`] names is not used; `height` gives everybody's stature
    /// instead of observing it.
    ///
    /// # Errors
    /// [`ConfigError`] if a setting is out of range.
    pub fn new(views: Vec<View>, config: FitConfig) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            world: world(&views),
            views,
            model: MotionModel::new(Skeleton::builtin(), &config.terms, &config.prediction),
            config,
            solver: PoseSolver::default(),
            matcher: Matcher::default(),
            present: Vec::new(),
            identities: Identities::default(),
            newest: None,
            slept: 0.0,
            sequence: 0,
        })
    }

    /// The cameras.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// People held in memory: present ones, with and without identity, and those remembered after they left.
    pub fn remembered(&self) -> usize {
        self.present.len() + self.identities.remembered()
    }

    /// Takes in an instant and writes everyone with an identity into `out`: joints, positions and orientations in the
    /// calibration's axes; `joints2d`, the picture's size and its camera are zeros, since there are several. `sequence`
    /// counts instants. `publish_ns` and `fit_us` are left to whoever publishes.
    ///
    /// An instant that is not newer than the last changes nothing; a step back of more than half a second starts over
    /// with nobody present (identities are never given again). After more than a second without an instant everybody is
    /// looked for anew and recognised at first sight.
    pub fn update(&mut self, set: &FrameSet, out: &mut BodyFrame) {
        let Some(passed) = self.step(set.capture_ns) else {
            self.publish(0.0, out);
            return;
        };
        let dt = passed.min(STEP[1]);
        let pause = (passed > STEP[1]).then_some(passed);
        self.newest = Some(Newest {
            capture_ns: set.capture_ns,
            flags: if set.file_time { FLAG_FILE_TIME } else { 0 },
            stage_times: set.stage_times,
        });
        self.sequence += 1;
        let mut seen = self.seen(set);
        let chosen = self.associate(&seen, dt);
        self.advance(&mut seen, &chosen, dt);
        self.start_people(&mut seen);
        let now = set.capture_ns;
        self.identities
            .confirm(&mut self.present, now, pause, &self.config);
        self.identities
            .forget(&mut self.present, now, dt, &self.config);
        for person in &mut self.present {
            person.turn = rotation_vector_near(person.pose.rotation, person.turn);
        }
        self.publish(0.0, out);
    }

    /// Says that the machine slept for so long since the newest instant, seconds. Times stand still meanwhile, and
    /// people do not: it is like a pause without instants.
    pub fn slept(&mut self, seconds: f64) {
        self.slept += seconds.max(0.0);
    }

    /// Writes everyone as they are expected at `pose_ns`, at most `prediction.max` seconds after the newest instant.
    /// Changes nothing.
    pub fn predict(&self, pose_ns: u64, out: &mut BodyFrame) {
        let newest = self.newest.map_or(pose_ns, |n| n.capture_ns);
        let most = (self.config.prediction.max * 1e9) as u64;
        let ahead = pose_ns.saturating_sub(newest).min(most);
        self.publish(ahead as f64 * 1e-9, out);
    }

    /// Seconds since the last instant; `None` for a stale one. Starts over where the input did.
    fn step(&mut self, now: u64) -> Option<f64> {
        let Some(Newest { capture_ns, .. }) = self.newest else {
            // Before the first instant nobody was there to be away.
            self.slept = 0.0;
            return Some(STEP[0]);
        };
        if now <= capture_ns && capture_ns - now <= RESTART_NS {
            return None;
        }
        let slept = std::mem::take(&mut self.slept);
        let dt = now.saturating_sub(capture_ns) as f64 * 1e-9 + slept;
        if now < capture_ns || dt > self.config.identity.memory.max(STEP[1]) {
            self.present.clear();
            self.identities.clear();
            return Some(STEP[0]);
        }
        if dt > STEP[1] {
            // Everybody is somewhere else now, but may be recognised.
            self.identities.leave_all(&mut self.present, capture_ns);
        }
        self.identities.slept(slept);
        Some(dt.max(STEP[0]))
    }

    /// Every detection that can be used, by view; taken ones become none.
    fn seen(&self, set: &FrameSet) -> Vec<Vec<Option<Seen>>> {
        let least = self.config.min_joint_confidence;
        let each = self.views.iter().zip(&set.views);
        each.map(|(view, people)| {
            let people = people.iter().flatten();
            let usable = people.filter_map(|o| Seen::new(view, o, least));
            let mut usable: Vec<Seen> = usable.collect();
            tell_alone(&mut usable);
            usable.into_iter().map(Some).collect()
        })
        .collect()
    }

    /// The detection of every person in every view: first within the reach of somebody just seen, about where they are
    /// expected; then of what is left also about where they were, and as far away as they may have gone. Whoever was
    /// seen the last time takes before whoever was not.
    fn associate(&mut self, seen: &[Vec<Option<Seen>>], dt: f64) -> Vec<Vec<Option<usize>>> {
        let evidence = |posed: &Posed| -> Joints { std::array::from_fn(|j| Some(posed.joints[j])) };
        let (were, ahead): (Vec<Joints>, Vec<Joints>) = self
            .present
            .iter()
            .map(|p| (evidence(&p.posed), evidence(&p.ahead(dt, &self.model).1)))
            .unzip();
        let mut chosen = vec![vec![None; self.views.len()]; self.present.len()];
        for (is_far, is_absent) in [(false, false), (false, true), (true, false), (true, true)] {
            for (v, (view, detections)) in self.views.iter().zip(seen).enumerate() {
                let all = self.present.iter().enumerate();
                let people: Vec<usize> = all
                    .filter(|(k, p)| (p.unseen > 0.0) == is_absent && chosen[*k][v].is_none())
                    .map(|(k, _)| k)
                    .collect();
                let is_taken = |d: usize| chosen.iter().any(|own| own[v] == Some(d));
                let left: Vec<(usize, &Seen)> = detections
                    .iter()
                    .enumerate()
                    .filter_map(|(d, seen)| Some((d, seen.as_ref()?)))
                    .filter(|(d, _)| !is_taken(*d))
                    .collect();
                let mut scores = Vec::with_capacity(people.len() * left.len());
                for &k in &people {
                    let person = &self.present[k];
                    let reach = reach(if is_far { person.apart } else { 0.0 }, dt);
                    for (_, seen) in &left {
                        let to = |joints| closeness(view, &seen.sight, joints, reach);
                        let near = match is_far {
                            true => to(&ahead[k]).max(to(&were[k])),
                            false => to(&ahead[k]),
                        };
                        scores.push(near * self.likeness(person, v, seen));
                    }
                }
                let pairs = self.matcher.solve(people.len(), left.len(), &scores);
                for (&k, pair) in people.iter().zip(pairs) {
                    chosen[k][v] = pair.map(|d| left[d].0);
                }
            }
        }
        self.rejoin(seen, &ahead, &mut chosen);
        chosen
    }

    /// What somebody's fit to a detection in a view is worth besides the place, 0–1.
    fn likeness(&self, person: &Person, view: usize, seen: &Seen) -> f32 {
        let known = if person.id == 0 { NEWCOMER } else { 1.0 };
        let looks = &person.looks[view].appearance;
        let looks = looks.as_ref().zip(seen.looks.as_ref());
        let unlike = looks.map_or(0.0, |(a, b)| a.distance(b));
        let is_new_here = person.unseen > 0.0 || !person.seen_by[view];
        // Whoever was out of a view and comes back in other clothes is somebody else, unless two others saw where they
        // were.
        if person.apart > 0.0
            && is_new_here
            && unlike > VETO * self.config.identity.reidentify_appearance
        {
            return 0.0;
        }
        known * (1.0 - LOOKS[0] * (unlike - LOOKS[1]).max(0.0)) as f32
    }

    /// Mends what was chosen for those whom fewer than two views saw at the last instant.
    fn rejoin(
        &mut self,
        seen: &[Vec<Option<Seen>>],
        ahead: &[Joints],
        chosen: &mut Vec<Vec<Option<usize>>>,
    ) {
        let followed = self.present.iter().zip(ahead).map(|(person, joints)| {
            (person.apart > 0.0).then(|| Followed {
                joints: *joints,
                seen_by: person.seen_by.clone(),
                is_absent: person.unseen > 0.0,
            })
        });
        let followed: Vec<Option<Followed>> = followed.collect();
        if followed.iter().all(Option::is_none) {
            return;
        }
        let sights = seen
            .iter()
            .map(|seen| seen.iter().flatten().map(|s| &s.sight).collect());
        let sights: Vec<Vec<&Sight>> = sights.collect();
        let may_be = |k: usize, v: usize, d: usize| {
            let seen = seen[v][d].as_ref();
            seen.is_some_and(|seen| self.likeness(&self.present[k], v, seen) > 0.0)
        };
        let all = |_, _, _| true;
        let mut by_rays = chosen.clone();
        rejoin(&self.views, &sights, &followed, may_be, chosen);
        rejoin(&self.views, &sights, &followed, all, &mut by_rays);
        self.believe(by_rays, chosen);
    }

    /// Where rays meet in somebody whom one view follows, looks are overruled when two other views see them there, or
    /// when rays have met all along a walk. `by_rays`: what would be chosen whatever anybody looks like.
    fn believe(&mut self, by_rays: Vec<Vec<Option<usize>>>, chosen: &mut [Vec<Option<usize>>]) {
        let count = |own: &[Option<usize>]| own.iter().flatten().count();
        for (k, by_rays) in by_rays.into_iter().enumerate() {
            let person = &mut self.present[k];
            let met = count(&by_rays);
            if met <= count(&chosen[k]) || person.unseen > 0.0 {
                person.doubted = None;
                continue;
            }
            let here = person.pose.position;
            let gone = person.doubted.get_or_insert(here).distance(here);
            let own = self.views.iter().zip(&by_rays);
            let far = own.filter_map(|(view, own)| own.map(|_| view.position.distance(here)));
            let is_believed = met > 2 || gone > ALONG * far.fold(0.0, f64::max);
            // Whom looks give to somebody else stays theirs.
            let is_free = |(v, d): (usize, &Option<usize>)| {
                let mut others = chosen.iter().enumerate().filter(|(other, _)| *other != k);
                d.is_none() || !others.any(|(_, other)| other[v] == *d)
            };
            if is_believed && by_rays.iter().enumerate().all(is_free) {
                chosen[k] = by_rays;
            }
        }
    }

    /// Fits everyone who was seen, lets the others coast.
    fn advance(&mut self, seen: &mut [Vec<Option<Seen>>], chosen: &[Vec<Option<usize>>], dt: f64) {
        let mut cx = Context {
            views: &self.views,
            config: &self.config,
            model: &self.model,
            solver: &mut self.solver,
        };
        for (person, chosen) in self.present.iter_mut().zip(chosen) {
            if chosen.iter().all(Option::is_none) {
                person.coast(dt, &cx);
                continue;
            }
            let own = take(seen, chosen);
            person.observe(own, dt, &mut cx);
        }
    }

    /// Starts a person for every group of detections that nobody took.
    fn start_people(&mut self, seen: &mut [Vec<Option<Seen>>]) {
        if self.present.len() >= 2 * MAX_PEOPLE {
            return;
        }
        let all = seen.iter().enumerate();
        let free: Vec<(usize, usize, &Sight)> = all
            .flat_map(|(v, seen)| {
                let each = seen.iter().enumerate();
                each.filter_map(move |(d, s)| Some((v, d, &s.as_ref()?.sight)))
            })
            .collect();
        let views: HashSet<usize> = free.iter().map(|f| f.0).collect();
        if views.len() < 2 {
            return;
        }
        for chosen in groups(&self.views, &free) {
            let own = take(seen, &chosen);
            let mut cx = Context {
                views: &self.views,
                config: &self.config,
                model: &self.model,
                solver: &mut self.solver,
            };
            let Some(person) = Person::start(own, &mut cx) else {
                continue;
            };
            // Whoever is missed does not stand where somebody else is seen: that is settled once it is known who this
            // is.
            let mut seen_ones = self.present.iter().filter(|other| other.unseen == 0.0);
            let is_taken = seen_ones.any(|other| {
                [PELVIS, NECK]
                    .iter()
                    .all(|&j| other.posed.joints[j].distance(person.posed.joints[j]) < APART)
            });
            if !is_taken {
                self.present.push(person);
            }
        }
    }

    fn publish(&self, ahead: f64, out: &mut BodyFrame) {
        let grace = self.config.identity.grace;
        let mut known: Vec<&Person> = self
            .present
            .iter()
            .filter(|p| p.id != 0 && p.unseen <= grace)
            .collect();
        // Those seen first, should there be more than fit.
        known.sort_by(|a, b| a.unseen.total_cmp(&b.unseen).then(a.id.cmp(&b.id)));
        known.truncate(MAX_PEOPLE);
        known.sort_by_key(|p| p.id);
        let newest = self.newest;
        let capture_ns = newest.map_or(0, |n| n.capture_ns);
        out.sequence = self.sequence.saturating_sub(1);
        out.capture_ns = capture_ns;
        out.pose_ns = capture_ns.saturating_add((ahead * 1e9).round() as u64);
        out.publish_ns = 0;
        (out.width, out.height) = (0, 0);
        out.intrinsics = Default::default();
        out.stage_times = newest.map_or_else(Default::default, |n| n.stage_times);
        out.fit_us = 0;
        out.flags = newest.map_or(0, |n| n.flags);
        out.frame_total = 0;
        out.world = self.world;
        out.count = known.len() as u32;
        for (body, person) in out.bodies.iter_mut().zip(&known) {
            write_body(person, ahead, &self.model, body);
        }
        out.bodies[known.len()..].fill(Body::default());
    }
}

/// Takes the chosen detections, one a view.
fn take(seen: &mut [Vec<Option<Seen>>], chosen: &[Option<usize>]) -> Vec<Option<Seen>> {
    let each = seen.iter_mut().zip(chosen);
    each.map(|(seen, chosen)| seen[(*chosen)?].take()).collect()
}
