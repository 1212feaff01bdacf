//! A scene: camera, place, light, sensor and the people in it.

use std::sync::OnceLock;

use glam::Vec3;

use super::camera::Camera;
use super::mesh::Mesh;
use super::noise::Dice;
use super::outfit::Outfit;
use super::place::Place;
use super::pose::{Pose, Posed};
use super::shape::{BONES, Shape};

/// One person: everything that does not change with time.
#[derive(Debug, Clone)]
pub struct Person {
    /// Identity, from 1, constant over a clip.
    pub id: u32,
    /// Build.
    pub shape: Shape,
    /// Clothes.
    pub outfit: Outfit,
    /// Size of the surface's cells, metres.
    step: f32,
    /// Made when first asked for: most of the work, and who only wants to know where joints are does without.
    mesh: OnceLock<Mesh>,
    /// Rest position of every bone's pivot.
    pub pivots: [Vec3; BONES],
}

/// Where a person is and how they hold themselves at one moment.
#[derive(Debug, Clone, Copy)]
pub struct Stance {
    /// Index into [`Scene::people`].
    pub person: usize,
    /// Pose.
    pub pose: Pose,
    /// Pelvis over the floor.
    pub place: Vec3,
    /// Degrees about y, 0 faces +z.
    pub heading: f32,
}

/// Light of a scene.
#[derive(Debug, Clone, Copy)]
pub struct Light {
    /// Unit vector to the key light.
    pub to_key: Vec3,
    /// Key light.
    pub key: Vec3,
    /// Light from above.
    pub sky: Vec3,
    /// Light from below.
    pub ground: Vec3,
    /// Direction and strength of a weak second light.
    pub to_fill: Vec3,
    /// Its strength.
    pub fill: Vec3,
    /// Width of shadow edges, metres.
    pub softness: f32,
}

/// What the camera's sensor and lens do to the light.
#[derive(Debug, Clone, Copy)]
pub struct Sensor {
    /// Mean brightness that the exposure aims at, display values 0–1.
    pub brightness: f32,
    /// Contrast of the display curve; 1 is neutral.
    pub contrast: f32,
    /// Colour saturation; 1 is neutral.
    pub saturation: f32,
    /// White balance.
    pub tint: Vec3,
    /// Standard deviation of blur, pixels.
    pub blur: f32,
    /// Standard deviation of noise in the dark, display values.
    pub noise: f32,
    /// Darkening of the corners, 0–1.
    pub vignette: f32,
    /// JPEG quality of the written picture.
    pub quality: u8,
}

/// Everything about a scene but time.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The camera.
    pub camera: Camera,
    /// The surroundings.
    pub place: Place,
    /// The light.
    pub light: Light,
    /// The sensor.
    pub sensor: Sensor,
    /// The people.
    pub people: Vec<Person>,
    /// Seed of the sensor's noise.
    pub seed: u64,
}

impl Person {
    /// A random person. `step`: size of the surface's cells, metres.
    pub fn random(id: u32, dice: &mut Dice, step: f32) -> Self {
        let shape = Shape::random(dice);
        let outfit = Outfit::random(shape.feminine, dice);
        Self::new(id, shape, outfit, step)
    }

    /// A person of a build in an outfit.
    pub fn new(id: u32, shape: Shape, outfit: Outfit, step: f32) -> Self {
        let pivots = std::array::from_fn(|b| shape.pivot(b));
        Self {
            id,
            shape,
            outfit,
            step,
            mesh: OnceLock::new(),
            pivots,
        }
    }

    /// Surface.
    pub fn mesh(&self) -> &Mesh {
        self.mesh
            .get_or_init(|| Mesh::new(&self.shape, &self.outfit, self.step))
    }

    /// Bones and joints in the world.
    pub fn posed(&self, stance: &Stance) -> Posed {
        Posed::new(&self.shape, &stance.pose, stance.place, stance.heading)
    }
}

impl Light {
    /// Random light for a place.
    pub fn random(dice: &mut Dice, indoors: bool) -> Self {
        let azimuth = dice.range(0.0, std::f32::consts::TAU);
        let height = if indoors {
            dice.range(0.7, 1.5)
        } else {
            dice.range(0.3, 1.3)
        };
        let direction = |a: f32, h: f32| Vec3::new(a.cos() * h.cos(), h.sin(), a.sin() * h.cos());
        let warm = |dice: &mut Dice, amount: f32| {
            let w = dice.range(-amount, amount);
            Vec3::new(1.0 + w, 1.0, 1.0 - w)
        };
        let ambient = dice.range(0.3, 0.75);
        let key = (1.25 - ambient) * dice.range(0.7, 1.6);
        let second = dice.range(0.0, std::f32::consts::TAU);
        Self {
            to_key: direction(azimuth, height),
            key: warm(dice, 0.12) * key,
            sky: warm(dice, 0.08) * ambient,
            ground: warm(dice, 0.1) * ambient * dice.range(0.45, 0.85),
            to_fill: direction(second, dice.range(0.1, 0.8)),
            fill: warm(dice, 0.15) * dice.range(0.0, 0.35),
            softness: if indoors {
                dice.range(0.03, 0.15)
            } else {
                dice.range(0.01, 0.06)
            },
        }
    }
}

impl Sensor {
    /// A random camera, from clean to a cheap one in the dark.
    pub fn random(dice: &mut Dice) -> Self {
        let dark = dice.chance(0.08);
        Self {
            brightness: if dark {
                dice.range(0.22, 0.36)
            } else {
                dice.range(0.42, 0.66)
            },
            contrast: dice.range(0.85, 1.25),
            saturation: dice.range(0.65, 1.2),
            tint: Vec3::new(dice.range(0.92, 1.08), 1.0, dice.range(0.90, 1.10)),
            blur: dice.pick(&[0.0, 0.0, 0.3, 0.4, 0.5, 0.6, 0.9]),
            noise: if dark {
                dice.range(0.01, 0.04)
            } else {
                dice.range(0.002, 0.018)
            },
            vignette: dice.range(0.0, 0.35),
            quality: 60 + dice.below(35) as u8,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::lab::synth::studio::Studio;

    #[test]
    fn all_masks_of_a_person_are_of_one_skin() {
        let studio = Studio::new(3, (64, 48), 2, 1, 1, 10.0);
        let is_made = || studio.clip.scene.people[0].mesh.get().is_some();
        assert!(!is_made(), "whoever wants no pixels does without");
        studio.owners(&studio.cameras[0], 0);
        assert!(is_made(), "only that of a copy was, which is gone");
    }
}
