//! A whole clip: a seed goes in, a scene and everyone's stance in every frame come out.

use glam::Vec3;

use super::acts::Act;
use super::camera::Camera;
use super::director::{Actor, Task, direct, gestures};
use super::noise::Dice;
use super::place::{Finish, Form, Paint, Place, Thing};
use super::scene::{Light, Person, Scene, Sensor, Stance};

/// A clip before it is rendered.
#[derive(Debug, Clone)]
pub struct Clip {
    /// Camera, place, light, people.
    pub scene: Scene,
    /// Everyone's stance, frame by frame.
    pub stances: Vec<Vec<Stance>>,
    /// Frames per second.
    pub fps: f32,
}

impl Clip {
    /// Time of frame number `index` since the first, nanoseconds.
    pub fn time_ns(&self, index: u64) -> u64 {
        (index as f64 * 1e9 / f64::from(self.fps)).round() as u64
    }
}

/// Height of the seat of the bench, metres.
const BENCH: f32 = 0.44;
/// Height of the counter, metres.
const COUNTER: f32 = 0.98;

/// Directs a clip: people cross in front of each other, leave and come back, one stands behind a counter, one sits
/// down. It ends early where `is_stopped`, which is asked before each frame, says so.
pub fn clip(
    seed: u64,
    size: (u32, u32),
    people: usize,
    frames: u64,
    fps: f32,
    is_stopped: &dyn Fn() -> bool,
) -> Clip {
    let mut dice = Dice::new(seed, 0);
    let dice = &mut dice;
    let eye = Vec3::new(0.0, dice.range(1.3, 1.75), 0.0);
    let camera = Camera::new(
        size,
        dice.range(53.0, 58.0),
        eye,
        dice.range(6.0, 9.5),
        0.0,
        dice.range(-0.8, 0.8),
    );
    let spread = 0.5 * size.0 as f32 / camera.lens.fx;
    let mut place = Place::indoors(dice, eye, 6.2);
    place.grain = 0.0;
    if let Some(room) = &mut place.room {
        room.sides = [-6.0, 6.0];
    }
    // Furniture of the random room must not stand in the paths.
    place.things.retain(|t| match t.form {
        Form::Block { centre, .. } => !t.solid || centre.z < -6.4,
        Form::Post { foot, .. } => foot.z < -6.4,
        Form::Ball { centre, .. } => centre.z < -6.4,
    });
    let counter_at = Vec3::new(-0.52 * spread * 4.1, 0.0, -4.1);
    let bench_at = Vec3::new(0.55 * spread * 5.4, 0.0, -5.4);
    let wood = |dice: &mut Dice| {
        let v = dice.range(0.12, 0.4);
        let a = Vec3::new(v, v * 0.72, v * 0.48);
        Finish {
            paint: Paint::Planks(0.3),
            a,
            b: a * 0.85,
            seed: dice.bits() as u32,
        }
    };
    let (front, top, bench) = (wood(dice), wood(dice), wood(dice));
    if people > 3 {
        place.things.push(block(
            counter_at + Vec3::Y * (0.5 * COUNTER),
            Vec3::new(0.62, 0.5 * COUNTER, 0.24),
            front,
        ));
        place.things.push(block(
            counter_at + Vec3::Y * COUNTER,
            Vec3::new(0.67, 0.02, 0.28),
            top,
        ));
    }
    if people > 2 {
        place.things.push(block(
            bench_at + Vec3::Y * (BENCH - 0.03),
            Vec3::new(0.7, 0.03, 0.20),
            bench,
        ));
        for s in [-1.0, 1.0] {
            let leg = bench_at + Vec3::new(s * 0.6, 0.5 * BENCH - 0.03, 0.0);
            place
                .things
                .push(block(leg, Vec3::new(0.03, 0.5 * BENCH - 0.03, 0.18), bench));
        }
    }
    let light = Light::random(dice, true);
    let light = Light {
        softness: light.softness.max(0.05),
        ..light
    };
    let sensor = Sensor {
        brightness: dice.range(0.48, 0.6),
        contrast: 1.05,
        saturation: 0.95,
        blur: 0.45,
        noise: 0.0012,
        vignette: 0.15,
        ..Sensor::random(dice)
    };

    let mut cast = Vec::new();
    let mut actors = Vec::new();
    for k in 0..people {
        let mut own = Dice::new(seed, 1000 + k as u64);
        cast.push(Person::random(k as u32 + 1, &mut own, 0.0125));
        actors.push(role(k, &mut own, spread, counter_at, bench_at));
    }
    let stances = direct(&cast, &actors, frames, fps, is_stopped);
    let scene = Scene {
        camera,
        place,
        light,
        sensor,
        people: cast,
        seed: dice.bits(),
    };
    Clip {
        scene,
        stances,
        fps,
    }
}

fn block(centre: Vec3, half: Vec3, finish: Finish) -> Thing {
    Thing {
        form: Form::Block {
            centre,
            half,
            turn: 0.0,
        },
        finish,
        solid: true,
    }
}

/// What the k-th person does.
fn role(k: usize, dice: &mut Dice, spread: f32, counter: Vec3, bench: Vec3) -> Actor {
    let seed = dice.bits() as u32;
    // a point on the floor: share of the half view, distance
    let floor = |u: f32, d: f32| Vec3::new(u * spread * d, 0.0, -d);
    let outside = |u: f32, d: f32| Vec3::new(u * (spread * d + 0.75), 0.0, -d);
    match k {
        0 => {
            // stands in the middle, gestures, steps aside
            let d = dice.range(4.0, 4.5);
            let start = floor(0.08, d);
            let mut script = vec![Task::Do(Act::Wave(0), 2.2), Task::Wait(0.3)];
            script.push(Task::Sidestep(0.55));
            script.push(Task::Do(Act::RaiseBoth, 1.8));
            script.push(Task::Face(55.0));
            script.push(Task::Do(Act::ReachUp(1), 1.6));
            script.push(Task::Face(0.0));
            script.push(Task::Sidestep(-0.55));
            script.push(Task::Do(Act::Squat, 2.3));
            script.extend(gestures(dice, 3));
            Actor {
                script,
                start,
                heading: 10.0 * dice.normal(),
                seed,
            }
        }
        1 => {
            // crosses in front, leaves, comes back behind the others
            let (near, far) = (dice.range(3.1, 3.4), dice.range(5.0, 5.4));
            let start = outside(-0.82, near);
            let script = vec![
                Task::Walk(outside(1.0, near), dice.range(1.15, 1.35)),
                Task::Wait(0.5),
                Task::Begin(Act::Telephone(0)),
                Task::Walk(outside(1.0, far - 0.6), 1.2),
                Task::Walk(outside(-1.0, far - 0.4), dice.range(1.1, 1.3)),
                Task::End,
                Task::Wait(0.4),
                Task::Walk(outside(-1.0, near), 1.2),
            ];
            Actor {
                script,
                start,
                heading: 90.0,
                seed,
            }
        }
        2 => {
            // comes in, sits down, gets up, goes
            let before = bench + Vec3::new(0.0, 0.0, 0.52);
            let start = floor(0.95, 4.7);
            let script = vec![
                Task::Walk(before, 1.1),
                Task::Face(-12.0),
                Task::Do(Act::Sit(BENCH + 0.105), 3.2),
                Task::Wait(0.7),
                Task::Do(Act::Stretch, 2.0),
                Task::Walk(floor(-0.35, 5.3), 1.1),
                Task::Do(Act::HandsOnHips, 1.5),
                Task::Walk(outside(1.0, 5.0), 1.2),
                Task::Wait(0.8),
            ];
            Actor {
                script,
                start,
                heading: -110.0,
                seed,
            }
        }
        3 => {
            // behind the counter
            let start = counter + Vec3::new(0.1, 0.0, -0.62);
            let mut script = vec![
                Task::Do(Act::ReachForward(0), 1.6),
                Task::Sidestep(-0.35),
                Task::Do(Act::Drink(1), 1.6),
                Task::Do(Act::Wave(1), 1.8),
                Task::Sidestep(0.35),
                Task::Do(Act::CrossArms, 1.6),
            ];
            script.push(Task::Do(Act::Point(1), 1.4));
            Actor {
                script,
                start,
                heading: 8.0,
                seed,
            }
        }
        4 => {
            // crosses from the other side, behind the first
            let (d, back) = (dice.range(5.0, 5.3), dice.range(5.7, 6.0));
            let start = outside(1.0, d) + Vec3::X * 1.4;
            let script = vec![
                Task::Walk(floor(-0.1, d - 0.2), dice.range(1.1, 1.3)),
                Task::Face(0.0),
                Task::Do(Act::Clap, 1.5),
                Task::Walk(outside(-1.0, d), 1.25),
                Task::Wait(0.5),
                Task::Walk(outside(-1.0, back), 1.2),
                Task::Walk(outside(1.0, back), 1.3),
                Task::Wait(0.6),
            ];
            Actor {
                script,
                start,
                heading: -90.0,
                seed,
            }
        }
        _ => {
            // wanders
            let start = floor(dice.range(-0.7, 0.7), dice.range(4.2, 6.0));
            let mut script = Vec::new();
            for _ in 0..4 {
                script.push(Task::Walk(
                    floor(dice.range(-0.8, 0.8), dice.range(3.4, 6.0)),
                    dice.range(0.8, 1.4),
                ));
                script.push(Task::Face(dice.range(-60.0, 60.0)));
                script.extend(gestures(dice, 1));
            }
            script.push(Task::Walk(outside(dice.sign(), dice.range(3.5, 5.5)), 1.3));
            script.push(Task::Wait(1.0));
            Actor {
                script,
                start,
                heading: dice.range(-90.0, 90.0),
                seed,
            }
        }
    }
}
