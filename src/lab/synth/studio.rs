//! Several cameras round one scene: a seed goes in, the same people seen from everywhere come out, with the
//! calibration.
//!
//! A scene's axes have y up. Calibration and world truth have z up, as `edgecap calibrate` makes them: x stays, a
//! scene's z is the world's −y.

use glam::{DMat3, DVec2, DVec3, Vec3};

use super::acts::Act;
use super::camera::Camera;
use super::clip::Clip;
use super::director::{Actor, Task, direct, gestures};
use super::measure::outline;
use super::noise::Dice;
use super::place::{Place, Room};
use super::scene::{Light, Person, Scene, Sensor};
use super::survey::{SUPERSAMPLE, survey};
use super::truth::TruthFrame;
use super::world::{WorldFrame, WorldPerson};
use crate::camera::{Brown, View};

/// How far from the middle people go, metres.
const REACH: f32 = 1.25;
/// Cells of the skin, metres.
const SKIN: f32 = 0.0125;
/// Where the hall ends, metres from its middle.
const HALL: f32 = 8.5;

/// A scene and the cameras round it.
#[derive(Debug, Clone)]
pub struct Studio {
    /// What happens; its scene has the first camera.
    pub clip: Clip,
    /// The cameras, called cam01, cam02 and so on.
    pub cameras: Vec<Camera>,
}

impl Studio {
    /// Directs people in the middle of a hall and puts cameras round them, which all look at the middle. Who does what
    /// depends on the seed and not on the number of cameras.
    pub fn new(
        seed: u64,
        size: (u32, u32),
        views: usize,
        people: usize,
        frames: u64,
        fps: f32,
    ) -> Self {
        Self::until(seed, size, views, people, frames, fps, &|| false)
    }

    /// The same of fewer frames where `is_stopped`, which is asked before each is directed, says so.
    pub fn until(
        seed: u64,
        size: (u32, u32),
        views: usize,
        people: usize,
        frames: u64,
        fps: f32,
        is_stopped: &dyn Fn() -> bool,
    ) -> Self {
        let cameras = cameras(seed, size, views);
        let dice = &mut Dice::new(seed, 1);
        let mut place = hall(dice);
        place.grain = 0.0;
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
        let (mut cast, mut actors) = (Vec::new(), Vec::new());
        for k in 0..people {
            let own = &mut Dice::new(seed, 1000 + k as u64);
            cast.push(Person::random(k as u32 + 1, own, SKIN));
            actors.push(wanderer(k, people, own));
        }
        let stances = direct(&cast, &actors, frames, fps, is_stopped);
        let scene = Scene {
            camera: cameras[0],
            place,
            light,
            sensor,
            people: cast,
            seed: dice.bits(),
        };
        let clip = Clip {
            scene,
            stances,
            fps,
        };
        Self { clip, cameras }
    }

    /// Number of frames.
    pub fn frames(&self) -> u64 {
        self.clip.stances.len() as u64
    }

    /// Makes everybody's skin, so that copies of the scene share the work.
    pub fn prepare(&self) {
        for person in &self.clip.scene.people {
            person.mesh();
        }
    }

    /// The clip as camera number `view` sees it.
    pub fn seen_by(&self, view: usize) -> Clip {
        let mut clip = self.clip.clone();
        clip.scene.camera = self.cameras[view];
        clip.scene.seed = clip.scene.seed.wrapping_add(view as u64);
        clip
    }

    /// The cameras as a calibration has them.
    pub fn views(&self) -> Vec<View> {
        self.cameras
            .iter()
            .enumerate()
            .map(|(k, c)| View {
                name: name(k),
                size: [c.width, c.height],
                focal: DVec2::new(c.lens.fx.into(), c.lens.fy.into()),
                centre: DVec2::new(c.lens.cx.into(), c.lens.cy.into()),
                distortion: Brown::default(),
                rotation: orthonormal(
                    c.axes.as_dmat3() * DMat3::from_cols(DVec3::X, -DVec3::Z, DVec3::Y),
                ),
                position: to_world(c.eye).as_dvec3(),
            })
            .collect()
    }

    /// What camera number `view` sees in frame number `frame`, without rendering it: joints inside the picture count as
    /// visible.
    pub fn outline(&self, view: usize, frame: u64) -> TruthFrame {
        let (stances, time) = (&self.clip.stances[frame as usize], self.clip.time_ns(frame));
        outline(&self.clip.scene, &self.cameras[view], stances, frame, time)
    }

    /// Whom every pixel of a camera shows in frame number `frame`, by identity, as if the hall were empty of furniture.
    pub fn owners(&self, camera: &Camera, frame: u64) -> Vec<u8> {
        // Else every copy of the scene would have skins of its own to make.
        self.prepare();
        let scene = Scene {
            camera: *camera,
            ..self.clip.scene.clone()
        };
        let samples = SUPERSAMPLE * SUPERSAMPLE * (camera.width * camera.height) as usize;
        let nothing = vec![f32::INFINITY; samples];
        let stances = &self.clip.stances[frame as usize];
        let (survey, _) = survey(&scene, &nothing, stances);
        let ids: Vec<u8> = stances
            .iter()
            .map(|s| scene.people[s.person].id as u8)
            .collect();
        survey.owners(&ids)
    }

    /// Where everybody is in frame number `frame`.
    pub fn world(&self, frame: u64) -> WorldFrame {
        let people = self.clip.stances[frame as usize]
            .iter()
            .map(|stance| {
                let person = &self.clip.scene.people[stance.person];
                WorldPerson {
                    id: person.id,
                    stature: person.shape.stature,
                    joints3d: person.posed(stance).joints.map(|p| to_world(p).to_array()),
                }
            })
            .collect();
        WorldFrame {
            frame,
            time_ns: self.clip.time_ns(frame),
            people,
        }
    }
}

/// What camera number `view` is called.
pub fn name(view: usize) -> String {
    format!("cam{:02}", view + 1)
}

fn to_world(p: Vec3) -> Vec3 {
    Vec3::new(p.x, -p.z, p.y)
}

/// The rotation nearest to one in single precision.
fn orthonormal(m: DMat3) -> DMat3 {
    DMat3::from_quat(glam::DQuat::from_mat3(&m).normalize())
}

/// Cameras round the middle, all the way round where there are more than two.
fn cameras(seed: u64, size: (u32, u32), views: usize) -> Vec<Camera> {
    let dice = &mut Dice::new(seed, 2);
    let first = dice.range(0.0, 360.0);
    // Two that face each other tell no depth.
    let step = 360.0 / views.max(4) as f32;
    let step = if views == 3 { 120.0 } else { step };
    (0..views)
        .map(|k| {
            let azimuth = (first + step * k as f32 + dice.range(-12.0, 12.0)).to_radians();
            let (far, high) = (dice.range(4.7, 5.2), dice.range(1.3, 2.3));
            let eye = Vec3::new(far * azimuth.sin(), high, far * azimuth.cos());
            let aim = 0.95 + dice.range(-0.08, 0.08);
            let pitch = (high - aim).atan2(far).to_degrees();
            let (fov, roll) = (dice.range(54.0, 60.0), dice.range(-1.5, 1.5));
            // Straight ahead is −z.
            Camera::new(size, fov, eye, pitch, azimuth.to_degrees(), roll)
        })
        .collect()
}

/// An empty hall with four walls and things along them.
fn hall(dice: &mut Dice) -> Place {
    let mut place = Place::indoors(dice, Vec3::new(0.0, 1.6, 0.0), HALL);
    if let Some(room) = &mut place.room {
        *room = Room {
            sides: [-HALL, HALL],
            back: -HALL,
            front: Some(HALL),
            height: room.height.max(3.2),
            ..*room
        };
    }
    place.things.clear();
    for _ in 0..10 {
        let along = dice.range(-HALL + 1.0, HALL - 1.0);
        let wall = dice.sign() * (HALL - 0.6);
        let foot = if dice.chance(0.5) {
            Vec3::new(along, 0.0, wall)
        } else {
            Vec3::new(wall, 0.0, along)
        };
        Place::furnish(&mut place.things, dice, foot);
    }
    place
}

/// Somebody who walks about, turns and gestures. Everybody starts in a part of the floor of their own.
fn wanderer(k: usize, people: usize, dice: &mut Dice) -> Actor {
    let floor = |dice: &mut Dice, from: f32, to: f32| {
        let (a, r) = (dice.range(from, to), REACH * dice.unit().sqrt());
        Vec3::new(r * a.sin(), 0.0, r * a.cos())
    };
    let part = std::f32::consts::TAU / people as f32;
    let start = floor(dice, part * k as f32, part * (k as f32 + 1.0));
    let mut script = vec![Task::Do(Act::LookAround, dice.range(0.3, 1.0))];
    for _ in 0..5 {
        script.extend(gestures(dice, 1));
        let to = floor(dice, 0.0, std::f32::consts::TAU);
        script.push(Task::Walk(to, dice.range(0.7, 1.3)));
        script.push(Task::Face(dice.range(-180.0, 180.0)));
    }
    Actor {
        script,
        start,
        heading: dice.range(-180.0, 180.0),
        seed: dice.bits() as u32,
    }
}
