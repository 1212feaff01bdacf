//! Moves people through a clip: what everyone is to do goes in, everyone's stance in every frame comes out.

use glam::Vec3;

use super::acts::{self, Act};
use super::gait;
use super::noise::{Dice, smoothstep};
use super::pose::{Pose, Posed};
use super::scene::{Person, Stance};
use crate::joints::{L_ANKLE, R_ANKLE};

/// One step of a script.
#[derive(Debug, Clone, Copy)]
pub enum Task {
    /// Walk to a place on the floor at a speed in m/s.
    Walk(Vec3, f32),
    /// Step sideways (positive: to the own left) by metres.
    Sidestep(f32),
    /// Turn on the spot to a heading in degrees.
    Face(f32),
    /// Do something for some seconds.
    Do(Act, f32),
    /// Begin something for the arms that goes on while the next tasks run.
    Begin(Act),
    /// End what was begun.
    End,
    /// Stand for some seconds.
    Wait(f32),
}

/// A person with a script, which starts again when it ends.
#[derive(Debug, Clone)]
pub struct Actor {
    /// What to do, in order.
    pub script: Vec<Task>,
    /// Where on the floor they start.
    pub start: Vec3,
    /// Heading at the start, degrees.
    pub heading: f32,
    /// Person's own number, for small movements.
    pub seed: u32,
}

/// Simulation steps per second.
const RATE: f32 = 120.0;
/// Simulation step, seconds.
const STEP: f32 = 1.0 / RATE;
/// Time to change from one act to another, seconds.
const CHANGE: f32 = 0.55;

#[derive(Clone)]
struct State {
    at: Vec3,
    heading: f32,
    velocity: Vec3,
    phase: f32,
    side_phase: f32,
    side_speed: f32,
    task: usize,
    since: f32,
    begun: Vec3,
    acts: Vec<Doing>,
}

/// An act that fades in while `on`, then out.
#[derive(Clone)]
struct Doing {
    act: Act,
    age: f32,
    weight: f32,
    on: bool,
}

fn turn_towards(heading: f32, goal: f32, most: f32) -> f32 {
    let d = (goal - heading + 180.0).rem_euclid(360.0) - 180.0;
    heading + d.clamp(-most, most)
}

fn off(heading: f32, goal: f32) -> f32 {
    ((goal - heading + 180.0).rem_euclid(360.0) - 180.0).abs()
}

impl State {
    fn new(actor: &Actor) -> Self {
        Self {
            at: actor.start,
            heading: actor.heading,
            velocity: Vec3::ZERO,
            phase: (actor.seed % 97) as f32 / 97.0,
            side_phase: 0.0,
            side_speed: 0.0,
            task: 0,
            since: 0.0,
            begun: actor.start,
            acts: Vec::new(),
        }
    }

    fn next(&mut self, script: &[Task]) {
        self.task = (self.task + 1) % script.len();
        // The step under way still adds its own length: the new task starts at 0.
        self.since = -STEP;
        self.begun = self.at;
    }

    fn stop_acts(&mut self) {
        for d in &mut self.acts {
            d.on = false;
        }
    }

    fn start_act(&mut self, act: Act) {
        self.stop_acts();
        self.acts.push(Doing {
            act,
            age: 0.0,
            weight: 0.0,
            on: true,
        });
    }

    fn step(&mut self, actor: &Actor, person: &Person, others: &[(Vec3, Vec3)], own: usize) {
        let mut wish = Vec3::ZERO;
        let mut side = 0.0;
        match actor.script[self.task] {
            Task::Walk(to, speed) => {
                let way = Vec3::new(to.x - self.at.x, 0.0, to.z - self.at.z);
                let left = way.length();
                if left < 0.06 {
                    self.next(&actor.script);
                } else {
                    let mut dir = way / left;
                    // Give way to whoever is near and ahead.
                    for (k, (q, _)) in others.iter().enumerate() {
                        let to = Vec3::new(q.x - self.at.x, 0.0, q.z - self.at.z);
                        let d = to.length();
                        if k != own && d < 0.95 && d > 1e-3 && to.dot(dir) > 0.0 && d < left {
                            let aside = Vec3::new(-dir.z, 0.0, dir.x);
                            let s = if to.dot(aside) > 0.0 { -1.0 } else { 1.0 };
                            dir += aside * (s * 1.4 * (0.95 - d) / 0.55);
                        }
                    }
                    dir = dir.normalize_or_zero();
                    let goal = dir.x.atan2(dir.z).to_degrees();
                    self.heading = turn_towards(self.heading, goal, 230.0 * STEP);
                    let aligned = 1.0 - smoothstep(25.0, 80.0, off(self.heading, goal));
                    let slow = (left / 0.5).clamp(0.25, 1.0);
                    wish = dir * (speed * slow * aligned);
                }
            }
            Task::Sidestep(by) => {
                if (self.at - self.begun).length() >= by.abs() || self.since > 6.0 {
                    self.next(&actor.script);
                } else {
                    side = by.signum() * 0.55;
                }
            }
            Task::Face(goal) => {
                self.heading = turn_towards(self.heading, goal, 150.0 * STEP);
                if off(self.heading, goal) < 1.0 {
                    self.next(&actor.script);
                }
            }
            Task::Do(act, seconds) => {
                if self.since == 0.0 {
                    self.start_act(act);
                }
                if self.since >= seconds {
                    self.stop_acts();
                    self.next(&actor.script);
                }
            }
            Task::Begin(act) => {
                self.start_act(act);
                self.next(&actor.script);
            }
            Task::End => {
                self.stop_acts();
                self.next(&actor.script);
            }
            Task::Wait(seconds) => {
                if self.since >= seconds {
                    self.next(&actor.script);
                }
            }
        }
        self.since += STEP;
        let change = wish - self.velocity;
        self.velocity += change.clamp_length_max(2.2 * STEP);
        self.side_speed += (side - self.side_speed).clamp(-1.5 * STEP, 1.5 * STEP);
        let h = self.heading.to_radians();
        let left = Vec3::new(h.cos(), 0.0, -h.sin());
        self.at += (self.velocity + left * self.side_speed) * STEP;
        let speed = self.velocity.length();
        // Small steps also when turning on the spot.
        self.phase = (self.phase
            + STEP * speed / gait::stride_length(&person.shape, speed.max(0.3)))
        .rem_euclid(1.0);
        self.side_phase = (self.side_phase + STEP * self.side_speed.abs() / 0.5).rem_euclid(1.0);
        for d in &mut self.acts {
            d.age += STEP;
            d.weight = (d.weight + if d.on { STEP } else { -STEP } / CHANGE).clamp(0.0, 1.0);
        }
        self.acts.retain(|d| d.on || d.weight > 0.0);
    }

    fn pose(&self, actor: &Actor, person: &Person, t: f32) -> Pose {
        let idle = acts::idle(t, actor.seed);
        let speed = self.velocity.length();
        let mut pose = idle;
        let side = smoothstep(0.02, 0.3, self.side_speed.abs());
        if side > 0.0 {
            let mut step = idle;
            let w = (self.side_phase * std::f32::consts::TAU).sin();
            let dir = self.side_speed.signum();
            for (k, s) in [(0, -1.0f32), (1, 1.0)] {
                let leads = s * dir > 0.0;
                let lift = if leads { w.max(0.0) } else { (-w).max(0.0) };
                step.legs[k].abduct =
                    5.0 + 9.0 * (1.0 - (self.side_phase * std::f32::consts::TAU).cos()) * 0.5;
                step.legs[k].flex += 16.0 * lift;
                step.legs[k].knee += 30.0 * lift;
                step.legs[k].ankle += 10.0 * lift;
            }
            pose = pose.blend(&step, side);
        }
        let walk = smoothstep(0.03, 0.55, speed);
        if walk > 0.0 {
            let mut stride = gait::stride(&person.shape, speed, self.phase);
            stride.neck = [
                stride.neck[0] + 0.5 * idle.neck[0],
                stride.neck[1] + 0.6 * idle.neck[1],
            ];
            pose = pose.blend(&stride, walk);
        }
        for d in &self.acts {
            let over = acts::act(d.act, &pose, d.age);
            pose = pose.blend(&over, smoothstep(0.0, 1.0, d.weight));
        }
        pose
    }
}

/// Mean of the ankles relative to the pelvis, floor plane, heading 0.
fn ankles(person: &Person, pose: &Pose) -> Vec3 {
    let b = Posed::new(&person.shape, pose, Vec3::ZERO, 0.0);
    let m = (b.joints[R_ANKLE] + b.joints[L_ANKLE]) * 0.5;
    Vec3::new(m.x, 0.0, m.z)
}

/// Where actor number `own` is after a step and how they hold themselves; `t` is the time in seconds that small
/// movements are of.
fn stance(own: usize, state: &State, actor: &Actor, person: &Person, t: f32) -> Stance {
    let pose = state.pose(actor, person, t);
    // On the spot the feet stay and the pelvis moves: sitting down, squatting, bowing.
    let still = 1.0 - smoothstep(0.03, 0.4, state.velocity.length());
    let shift = ankles(person, &pose) - ankles(person, &Pose::default());
    let h = state.heading.to_radians();
    let shift = Vec3::new(
        shift.x * h.cos() + shift.z * h.sin(),
        0.0,
        shift.z * h.cos() - shift.x * h.sin(),
    );
    Stance {
        person: own,
        pose,
        place: state.at - shift * still,
        heading: state.heading,
    }
}

/// Between two stances of one person; headings are those of one course, which does not jump by a turn.
fn between(from: &Stance, to: &Stance, share: f32) -> Stance {
    Stance {
        person: to.person,
        pose: from.pose.blend(&to.pose, share),
        place: from.place.lerp(to.place, share),
        heading: from.heading + (to.heading - from.heading) * share,
    }
}

/// Stances of all actors (one per person, same order) in every frame. A frame that falls between two steps lies between
/// their stances: else it would be off by part of a step, which a rate that does not divide the steps' turns into
/// shaking. Fewer frames where `is_stopped`, which is asked before each, says so.
pub fn direct(
    people: &[Person],
    actors: &[Actor],
    frames: u64,
    fps: f32,
    is_stopped: &dyn Fn() -> bool,
) -> Vec<Vec<Stance>> {
    let mut states: Vec<State> = actors.iter().map(State::new).collect();
    // One step before.
    let mut last = states.clone();
    let mut out = Vec::with_capacity(frames as usize);
    let mut steps = 0u64;
    for frame in (0..frames).take_while(|_| !is_stopped()) {
        // Exact where it is a whole number, so that such a frame is that step.
        let due = frame as f64 * f64::from(RATE) / f64::from(fps);
        let until = due.ceil();
        while steps < until as u64 {
            last.clone_from(&states);
            let places: Vec<(Vec3, Vec3)> = states.iter().map(|s| (s.at, s.velocity)).collect();
            for (k, s) in states.iter_mut().enumerate() {
                s.step(&actors[k], &people[k], &places, k);
            }
            steps += 1;
        }
        let t = frame as f32 / fps;
        let share = (1.0 - (until - due)) as f32;
        let cast = actors.iter().zip(people).enumerate();
        let stances = cast.map(|(k, (actor, person))| {
            let to = stance(k, &states[k], actor, person, t);
            if share < 1.0 {
                let from = stance(k, &last[k], actor, person, t);
                return between(&from, &to, share);
            }
            to
        });
        out.push(stances.collect());
    }
    out
}

/// Gestures for somebody who stands.
pub fn gestures(dice: &mut Dice, n: usize) -> Vec<Task> {
    let mut out = Vec::new();
    for _ in 0..n {
        let s = dice.below(2);
        let act = dice.pick(&[
            Act::Wave(s),
            Act::Wave(s),
            Act::RaiseBoth,
            Act::ReachUp(s),
            Act::ReachForward(s),
            Act::Point(s),
            Act::HandsOnHips,
            Act::CrossArms,
            Act::Telephone(s),
            Act::Clap,
            Act::Drink(s),
            Act::LookAround,
            Act::Squat,
            Act::Bow,
            Act::Stretch,
            Act::JumpingJack,
        ]);
        out.push(Task::Do(act, dice.range(1.4, 2.6)));
        out.push(Task::Wait(dice.range(0.3, 0.9)));
    }
    out
}
