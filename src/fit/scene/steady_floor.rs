//! In: the floor as it is known from frame to frame. Out: a floor-aligned world that stays put: y up, origin on the
//! floor below the camera.
//!
//! The first estimate is taken as it is. Later ones are approached slowly, never faster than eyes forgive: a world that
//! turns by degrees makes everybody slide. A floor that stops being estimated, because nobody stands anywhere, stays
//! where it was.

use super::floor_plane::FloorPlane;
use crate::message::{World, WorldState};

/// Greatest turn of the world, radians per second, and greatest change of the camera's height, metres per second.
const TURN: f64 = 0.5 * std::f64::consts::PI / 180.0;
const RISE: f64 = 0.03;
/// Seconds in which a small difference shrinks to 1/e.
const FOLLOW: f64 = 4.0;

/// A floor without jumps.
#[derive(Debug, Clone, Copy, Default)]
pub struct SteadyFloor {
    floor: Option<FloorPlane>,
}

impl SteadyFloor {
    /// Takes in the estimate, `dt` seconds after the last one.
    pub fn follow(&mut self, estimate: Option<FloorPlane>, dt: f64) {
        let Some(estimate) = estimate else { return };
        let Some(floor) = &mut self.floor else {
            self.floor = Some(estimate);
            return;
        };
        let share = -(-dt / FOLLOW).exp_m1();
        let apart = floor.normal.angle_between(estimate.normal);
        let turn = (apart * share).min(TURN * dt);
        if apart > 1e-9 {
            let towards = floor.normal.lerp(estimate.normal, turn / apart);
            floor.normal = towards.try_normalize().unwrap_or(floor.normal);
        }
        let rise = (estimate.offset - floor.offset) * share;
        floor.offset += rise.clamp(-RISE * dt, RISE * dt);
    }

    /// Forgets the floor: another camera, another recording.
    pub fn forget(&mut self) {
        self.floor = None;
    }

    /// The given floor, else the one found so far.
    pub fn ground(&self, given: Option<FloorPlane>) -> Option<FloorPlane> {
        given.or(self.floor)
    }

    /// The world on the given floor, else on the one found so far.
    pub fn world(&self, given: Option<FloorPlane>) -> World {
        let Some(ground) = self.ground(given) else {
            return World::default();
        };
        let state = match given {
            Some(_) => WorldState::GIVEN,
            None => WorldState::ESTIMATED,
        };
        let (rotation, translation) = ground.world_from_camera();
        World {
            rotation: rotation.as_quat().to_array(),
            translation: translation.as_vec3().to_array(),
            state,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    fn tilted(degrees: f64, offset: f64) -> FloorPlane {
        FloorPlane {
            normal: DQuat::from_rotation_x(-degrees.to_radians()) * DVec3::NEG_Y,
            offset,
        }
    }

    #[test]
    fn the_world_moves_slowly_and_arrives() {
        let mut steady = SteadyFloor::default();
        assert_eq!(steady.world(None).state, WorldState::NONE);
        steady.follow(Some(tilted(10.0, 1.5)), 0.033);
        assert_eq!(steady.floor, Some(tilted(10.0, 1.5)));
        let wanted = tilted(16.0, 1.8);
        let mut before = steady.floor.unwrap();
        for frame in 0..1800 {
            // Estimates that flicker by degrees, and frames without one.
            let flicker = if frame % 2 == 0 { 1.0 } else { -1.0 };
            let estimate = (frame % 7 != 0).then(|| tilted(16.0 + flicker, 1.8 + 0.05 * flicker));
            steady.follow(estimate, 1.0 / 30.0);
            let now = steady.floor.unwrap();
            assert!(now.normal.angle_between(before.normal) <= TURN / 30.0 + 1e-9);
            assert!((now.offset - before.offset).abs() <= RISE / 30.0 + 1e-9);
            before = now;
        }
        assert!(before.normal.angle_between(wanted.normal).to_degrees() < 0.5);
        assert!((before.offset - wanted.offset).abs() < 0.02);
        assert_eq!(steady.world(None).state, WorldState::ESTIMATED);
        assert_eq!(
            steady.world(Some(wanted)).state,
            WorldState::GIVEN,
            "what is given is not smoothed"
        );
        steady.forget();
        assert_eq!(steady.world(None), World::default());
    }
}
