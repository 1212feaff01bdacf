//! In: people as they were seen and fitted. Out: the floor that they stand on, how tall they are beside each other, and
//! everybody set upright.

use super::{Fitter, PersonEvidence};
use crate::fit::evidence::Evidence;
use crate::fit::scene::{FloorEstimate, FloorPlane, Lean, assumed};
use crate::joints::CANONICAL_STATURE;

/// How far a floor of the settings may be off, radians: who measures it is wrong by some degrees.
const GIVEN_ERROR: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Seconds between looks at standing feet.
const FEET_EVERY: f64 = 0.3;

impl Fitter {
    /// The floor: from the settings, else as standing feet tell it. An estimated floor is as large or small as the
    /// stature that people are assumed to have.
    pub fn ground(&self) -> Option<FloorPlane> {
        match &self.config.ground {
            Some(known) => FloorPlane::from_config(known),
            None => self.feet.floor().map(|floor| FloorPlane {
                normal: floor.ground.normal,
                offset: floor.ground.offset * assumed(&self.config) / CANONICAL_STATURE as f64,
            }),
        }
    }

    /// The floor of the settings.
    pub(super) fn given(&self) -> Option<FloorPlane> {
        self.config
            .ground
            .as_ref()
            .and_then(FloorPlane::from_config)
    }

    /// Takes from everybody the lean that all seem to have, where a floor tells what is upright.
    pub(super) fn set_upright(&mut self, seen: &mut [PersonEvidence], dt: f64) {
        let given = self.given();
        let Some(up) = self.floor.ground(given).map(|ground| ground.normal) else {
            return;
        };
        let error = match (given, self.feet.floor()) {
            (Some(_), _) => GIVEN_ERROR,
            // The world follows what is found slowly.
            (None, Some(found)) => found.pitch_error + found.ground.normal.angle_between(up),
            // Lost: the camera was moved.
            (None, None) => f64::INFINITY,
        };
        let people = seen.iter().map(|(evidence, _)| evidence);
        let people: Vec<&Evidence> = people.filter(|_| error.is_finite()).collect();
        let watched = !self.present.is_empty();
        self.lean.look(&people, up, error, dt, watched);
        for (evidence, _) in seen {
            self.lean.take_from(evidence, up);
        }
    }

    /// Looks at who stands where: the floor, and how tall they are beside each other.
    pub(super) fn learn_ground(&mut self, dt: f64) {
        if !self.config.estimate_ground || self.config.ground.is_some() {
            return;
        }
        self.since_feet += dt;
        if self.since_feet >= FEET_EVERY {
            self.since_feet = 0.0;
            let down = self.feet.down();
            for track in self.present.iter().filter(|t| t.id != 0 && t.unseen == 0.0) {
                for place in track.standing(down) {
                    self.feet.add(track.id, place);
                }
            }
            self.feet.update();
        }
        self.floor.follow(self.ground(), dt);
        if let Some(floor) = self.feet.floor() {
            for track in self.present.iter_mut().filter(|t| t.id != 0) {
                if let Some(share) = floor.stature(track.id) {
                    track.stature.follow(&self.config, share, dt);
                }
            }
        }
    }

    /// Another view: feet that stood before say nothing about it.
    pub(super) fn forget_floor(&mut self) {
        self.feet = FloorEstimate::default();
        self.floor.forget();
        self.lean = Lean::default();
        self.since_feet = 0.0;
    }
}
