//! Independent scenes for training and evaluation: a seed and a number go in, a scene with people in place comes out.

use glam::Vec3;

use super::camera::Camera;
use super::noise::Dice;
use super::place::{Form, Place};
use super::poses;
use super::scene::{Light, Person, Scene, Sensor, Stance};

/// Share of people who lie or sit on the floor.
const ON_THE_FLOOR: f32 = 0.08;

/// A set of independent scenes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stills {
    /// Equal seeds give equal scenes.
    pub seed: u64,
    /// Pixels across and down.
    pub size: (u32, u32),
    /// Most people in a scene; some have nobody.
    pub people: usize,
    /// Share of scenes that are seen from high up near by, as by a camera under a ceiling, 0..=1.
    pub overhead: f32,
}

/// Scene number `index` of a set.
pub fn still(set: &Stills, index: u64) -> (Scene, Vec<Stance>) {
    let Stills {
        seed, size, people, ..
    } = *set;
    let mut dice = Dice::new(seed, 1 + index);
    let dice = &mut dice;
    // Dice of their own, so that everybody else is who and where they would be without anybody on the floor.
    let floor = &mut Dice::new(seed, u64::MAX - index);
    let count = match dice.below(50) {
        0 | 1 => 0,
        2..=13 => 1,
        14..=25 => 2,
        26..=35 => 3,
        36..=42 => 4,
        43..=46 => 5,
        _ => 6 + dice.below(3),
    }
    .min(people);
    let fov = dice.range(36.0, 88.0);
    let tall =
        (size.1 as f32 * 0.19).ln() + 0.5 * (dice.unit() + dice.unit()) * (1.15f32 / 0.19).ln();
    let tall = tall.exp(); // stature of the first person in pixels
    let mut high = if dice.chance(0.75) {
        dice.range(0.9, 2.2)
    } else {
        dice.range(0.4, 3.2)
    };
    let focal = 0.5 * size.0 as f32 / (0.5 * fov.to_radians()).tan();
    let mut near = (focal * 1.7 / tall).clamp(1.5, 30.0);
    // Dice of their own, for the same reason.
    let mount = &mut Dice::new(seed, u64::MAX / 2 - index);
    let overhead = mount.chance(set.overhead);
    if overhead {
        (high, near) = (mount.range(2.3, 4.2), mount.range(1.0, 4.0));
    }
    let (steepest, closest) = if overhead { (75.0, 0.7) } else { (50.0, 1.35) };
    let eye = Vec3::new(0.0, high, 0.0);
    let row = dice.range(-0.14, 0.14) * size.1 as f32;
    let pitch =
        ((high - 0.9).atan2(near) - (row / focal).atan()).to_degrees() + 2.0 * dice.normal();
    let camera = Camera::new(
        size,
        fov,
        eye,
        pitch.clamp(-25.0, steepest),
        0.0,
        2.5 * dice.normal(),
    );
    let place = Place::random(dice, eye, near);
    let light = Light::random(dice, place.room.is_some());
    let sensor = Sensor::random(dice);
    let mut spots: Vec<Vec3> = Vec::new();
    let mut scene = Scene {
        camera,
        place,
        light,
        sensor,
        people: Vec::new(),
        seed: dice.bits(),
    };
    let mut stances = Vec::new();
    let crowd = dice.chance(0.35);
    for k in 0..count {
        let mut found = None;
        for _ in 0..24 {
            let mut spot = if !spots.is_empty() && (crowd || dice.chance(0.35)) {
                let (a, r) = (
                    dice.range(0.0, std::f32::consts::TAU),
                    dice.range(0.35, 1.0),
                );
                spots[dice.below(spots.len())] + Vec3::new(r * a.cos(), 0.0, r * a.sin())
            } else {
                let far = if k == 0 {
                    near
                } else {
                    near * dice.range(-0.4, 0.75).exp()
                };
                let u = dice.range(-0.46, 0.46);
                Vec3::new(u * size.0 as f32 / focal * far, 0.0, -far)
            };
            if let Some(room) = &scene.place.room {
                spot.x = spot.x.clamp(room.sides[0] + 0.4, room.sides[1] - 0.4);
                spot.z = spot.z.max(room.back + 0.4);
            }
            let apart = spots.iter().all(|s| s.distance(spot) > 0.42);
            if spot.z < -closest && apart && clear(&scene.place, spot) {
                found = Some(spot);
                break;
            }
        }
        let Some(mut spot) = found else { continue };
        spots.push(spot);
        let px = focal * 1.7 / -spot.z;
        // A cell of the surface should be no larger than two pixels or so.
        let step = (2.6 / px).clamp(0.0125, 0.026);
        let person = Person::random(k as u32 + 1, dice, step);
        let mut pose = poses::random(&person.shape, dice);
        if pose.seat > 0.0 && dice.chance(0.75) {
            seat(&mut scene.place, dice, spot, pose.seat);
        }
        let mut heading = match dice.below(10) {
            0..=5 => 45.0 * dice.normal(),
            6 => 180.0 + 40.0 * dice.normal(),
            _ => dice.range(-180.0, 180.0),
        };
        if pose.seat <= 0.0 && floor.chance(ON_THE_FLOOR) {
            pose = poses::on_the_floor(&person.shape, floor);
            heading = floor.range(-180.0, 180.0);
        }
        if dice.chance(0.02) {
            spot.y = dice.range(0.0, 0.6); // on a step
        }
        scene.people.push(person);
        stances.push(Stance {
            person: scene.people.len() - 1,
            pose,
            place: spot,
            heading,
        });
    }
    // something in front of somebody, low or slim or to the side, so that part of them stays in sight
    if !stances.is_empty() && dice.chance(0.4) {
        let of = stances[dice.below(stances.len())].place;
        let t = dice.range(0.55, 0.85);
        let low = dice.chance(0.6);
        let aside = if low {
            dice.range(-0.5, 0.5)
        } else {
            dice.sign() * dice.range(0.2, 0.6)
        };
        let foot = Vec3::new(of.x * t + aside, 0.0, of.z * t);
        if spots.iter().all(|s| s.distance(foot) > 0.75) && foot.z < -1.0 {
            let before = scene.place.things.len();
            Place::furnish(&mut scene.place.things, dice, foot);
            for thing in &mut scene.place.things[before..] {
                if let Form::Block { centre, half, .. } = &mut thing.form
                    && low
                    && centre.y + half.y > 1.0
                {
                    let scale = 1.0 / (centre.y + half.y);
                    centre.y *= scale;
                    half.y *= scale;
                }
            }
        }
    }
    (scene, stances)
}

/// Whether nothing solid stands where a person should.
fn clear(place: &Place, at: Vec3) -> bool {
    place
        .things
        .iter()
        .filter(|t| t.solid)
        .all(|t| match t.form {
            Form::Block { centre, half, turn } => {
                let (s, c) = turn.sin_cos();
                let q = at - centre;
                let (x, z) = (q.x * c - q.z * s, q.z * c + q.x * s);
                x.abs() > half.x + 0.28 || z.abs() > half.z + 0.28 || centre.y - half.y > 2.1
            }
            Form::Post { foot, radius, .. } => (at - foot).length() > radius + 0.28,
            Form::Ball { centre, radii } => {
                let q = Vec3::new(at.x - centre.x, 0.0, at.z - centre.z);
                q.length() > radii.max_element() + 0.25 || centre.y - radii.y > 2.0
            }
        })
}

/// Puts a stool, box or bench under a seated person.
fn seat(place: &mut Place, dice: &mut Dice, at: Vec3, pelvis: f32) {
    let top = pelvis - 0.105;
    let before = place.things.len();
    Place::furnish(&mut place.things, dice, at);
    let finish = place.things[before].finish;
    place.things.truncate(before);
    let wide = dice.range(0.2, 0.6);
    place.things.push(super::place::Thing {
        form: Form::Block {
            centre: Vec3::new(at.x, 0.5 * top, at.z),
            half: Vec3::new(wide, 0.5 * top, 0.19),
            turn: 0.0,
        },
        finish,
        solid: true,
    });
}
