//! Independent scenes for training and evaluation: a seed and a number go in, a scene with people in place comes out.

use glam::Vec3;

use super::camera::Camera;
use super::noise::Dice;
use super::place::{Finish, Form, Place, Thing};
use super::pose::Posed;
use super::poses;
use super::scene::{Light, Person, Scene, Sensor, Stance};
use super::support;
use super::underside::lowest;
use crate::joints::PELVIS;

/// Share of people who lie or sit on the floor.
const ON_THE_FLOOR: f32 = 0.08;

/// Whose pelvis is lower than this lies or sits on the floor with more than joints and soles, metres.
const LOW: f32 = 0.35;
/// How far others keep from what somebody sits or stands on, metres.
const ROOM_FOR_OTHERS: f32 = 0.15;

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
        let px = focal * 1.7 / -spot.z;
        // A cell of the surface should be no larger than two pixels or so.
        let step = (2.6 / px).clamp(0.0125, 0.026);
        let person = Person::random(scene.people.len() as u32 + 1, dice, step);
        let mut pose = poses::random(&person.shape, dice);
        let is_seat_seen = pose.seat > 0.0 && dice.chance(0.75);
        let seat = is_seat_seen.then(|| (finish(dice, spot), dice.range(0.2, 0.6)));
        let mut heading = match dice.below(10) {
            0..=5 => 45.0 * dice.normal(),
            6 => 180.0 + 40.0 * dice.normal(),
            _ => dice.range(-180.0, 180.0),
        };
        if pose.seat <= 0.0 && floor.chance(ON_THE_FLOOR) {
            pose = poses::on_the_floor(&person.shape, floor);
            heading = floor.range(-180.0, 180.0);
        }
        let posed = Posed::new(&person.shape, &pose, Vec3::ZERO, heading);
        let is_low = posed.joints[PELVIS].y < LOW || posed.joints.iter().any(|p| p.y < 0.0);
        if pose.seat <= 0.0 && is_low {
            pose.hop -= lowest(&person.shape, &person.outfit, &posed);
        }
        let mut put = |form: Form, finish: Finish| {
            let is_free = spots.iter().all(|s| is_beside(&form, *s, ROOM_FOR_OTHERS));
            if is_free {
                scene.place.things.push(Thing {
                    form,
                    finish,
                    solid: true,
                });
            }
            is_free
        };
        if dice.chance(0.02) {
            let high = dice.range(0.0, 0.6);
            let raised = spot.with_y(high);
            let posed = Posed::new(&person.shape, &pose, raised, heading);
            let step = support::step(&posed, raised, heading);
            if put(step, finish(floor, spot)) {
                spot = raised;
            }
        }
        if let Some((finish, wide)) = seat {
            let posed = Posed::new(&person.shape, &pose, spot, heading);
            let seat = support::seat(&person.shape, &posed, spot, heading, wide);
            put(seat, finish);
        }
        spots.push(spot.with_y(0.0));
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
    let mut solid = place.things.iter().filter(|t| t.solid);
    solid.all(|t| is_beside(&t.form, at, 0.28))
}

/// Whether somebody who stands at `at` stays so many metres beside a form, or below it.
fn is_beside(form: &Form, at: Vec3, gap: f32) -> bool {
    match *form {
        Form::Block { centre, half, turn } => {
            let (s, c) = turn.sin_cos();
            let q = at - centre;
            let (x, z) = (q.x * c - q.z * s, q.z * c + q.x * s);
            x.abs() > half.x + gap || z.abs() > half.z + gap || centre.y - half.y > 2.1
        }
        Form::Post { foot, radius, .. } => (at - foot).length() > radius + gap,
        Form::Ball { centre, radii } => {
            let q = Vec3::new(at.x - centre.x, 0.0, at.z - centre.z);
            q.length() > radii.max_element() + gap - 0.03 || centre.y - radii.y > 2.0
        }
    }
}

/// What a piece of furniture is made of.
fn finish(dice: &mut Dice, at: Vec3) -> Finish {
    let mut drawn = Vec::new();
    Place::furnish(&mut drawn, dice, at);
    drawn[0].finish
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::{ANKLES, KNEES};
    use crate::lab::synth::mesh::Mesh;

    const SET: Stills = Stills {
        seed: 3,
        size: (512, 320),
        people: 8,
        overhead: 0.0,
    };

    /// Blocks as somebody who looks along `heading` sits or stands on: their centre and half sizes.
    fn blocks(scene: &Scene, heading: f32) -> Vec<(Vec3, Vec3)> {
        let own = |thing: &Thing| match thing.form {
            Form::Block { centre, half, turn } if turn == heading.to_radians() => {
                Some((centre, half))
            }
            _ => None,
        };
        scene.place.things.iter().filter_map(own).collect()
    }

    /// Whether a point is inside a block, as seen by whoever looks along `heading`.
    fn is_inside((centre, half): (Vec3, Vec3), heading: f32, p: Vec3) -> bool {
        let turn = glam::Quat::from_rotation_y(-heading.to_radians());
        (turn * (p - centre)).abs().cmple(half).all()
    }

    #[test]
    fn identities_count_the_people_who_found_room() {
        // Near cameras leave the least room.
        let near = Stills {
            overhead: 1.0,
            ..SET
        };
        for k in 0..2_000 {
            let (scene, stances) = still(&near, k);
            let ids = scene.people.iter().map(|p| p.id);
            assert!(ids.eq(1..=stances.len() as u32), "still {k}");
        }
    }

    #[test]
    fn seats_are_under_those_who_sit_and_not_in_their_legs() {
        let (mut seated, mut on_seats) = (0, 0);
        for k in 0..2_000 {
            let (scene, stances) = still(&SET, k);
            for stance in stances.iter().filter(|s| s.pose.seat > 0.0) {
                seated += 1;
                let person = &scene.people[stance.person];
                let posed = person.posed(stance);
                let pelvis = posed.joints[PELVIS];
                let u = person.shape.unit();
                for block in blocks(&scene, stance.heading) {
                    let top = block.0.y + block.1.y;
                    if top == stance.place.y {
                        continue;
                    }
                    on_seats += 1;
                    let below = (pelvis.y - top) / u;
                    assert!((0.06..0.10).contains(&below), "{below} statures below");
                    for j in [KNEES, ANKLES].into_iter().flatten() {
                        let is_in = is_inside(block, stance.heading, posed.joints[j]);
                        assert!(!is_in, "still {k}: joint {j} is in the seat");
                    }
                    for other in stances.iter().filter(|s| s.person < stance.person) {
                        let at = other.place.with_y(block.0.y);
                        assert!(!is_inside(block, stance.heading, at), "still {k}");
                    }
                }
            }
        }
        assert!(
            3 * on_seats > seated && seated > 200,
            "{on_seats} of {seated}"
        );
    }

    #[test]
    fn whoever_is_raised_is_on_something() {
        let mut raised = 0;
        for k in 0..2_000 {
            let (scene, stances) = still(&SET, k);
            for stance in stances.iter().filter(|s| s.place.y > 0.0) {
                raised += 1;
                let below = stance.place - Vec3::Y * 1e-3;
                let is_under = |b: (Vec3, Vec3)| {
                    (b.0.y + b.1.y - stance.place.y).abs() < 1e-5
                        && is_inside(b, stance.heading, below)
                };
                let found = blocks(&scene, stance.heading).into_iter().any(is_under);
                assert!(found, "still {k}: {} m on nothing", stance.place.y);
            }
        }
        assert!(raised > 30, "{raised} are raised");
    }

    #[test]
    fn skin_of_those_on_the_floor_touches_it() {
        let mut on_the_floor = 0;
        for k in 0..400 {
            let (scene, stances) = still(&SET, k);
            for stance in &stances {
                let person = &scene.people[stance.person];
                let posed = person.posed(stance);
                let pelvis = posed.joints[PELVIS].y - stance.place.y;
                if stance.pose.seat > 0.0 || pelvis > LOW {
                    continue;
                }
                on_the_floor += 1;
                let mesh = Mesh::new(&person.shape, &person.outfit, 0.025);
                let (skin, _) = mesh.pose(&posed, &person.pivots);
                let low = skin.iter().map(|p| p.y - stance.place.y);
                let low = low.fold(f32::MAX, f32::min);
                assert!((-0.02..0.03).contains(&low), "still {k}: {low} m high");
            }
        }
        assert!(on_the_floor > 30, "{on_the_floor} on the floor");
    }
}
