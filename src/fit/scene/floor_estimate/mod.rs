//! In: places where feet stand, everybody's at canonical stature. Out: the floor that they share, and how tall who
//! stands on it is.
//!
//! A running sum over feet (`standers`), in which looks at resting feet count for little (`places`); the floor is found
//! from these sums (`solve`).

mod places;
mod solve;
mod standers;
#[cfg(test)]
mod tests;

use glam::DVec3;
use nalgebra::Vector3;

use self::places::Places;
use self::standers::Stander;
use super::floor_plane::FloorPlane;
use crate::body::skeleton::ANKLE_HEIGHT;

/// Feet that must have stood somewhere before a floor is believed.
const ENOUGH: f64 = 40.0;
/// Old feet fade so that about this many count; who has fewer left than that is forgotten.
const MEMORY: f64 = 2000.0;
const FORGOTTEN: f64 = 0.5;
/// People whose feet are remembered.
const PEOPLE: usize = 32;
/// A foot farther than this (metres) from where its person stands on a believed floor stands on something else, …
const OUTLIER: f64 = 0.4;
/// … and so does that of a newcomer who would have to be that small or tall (shares of the assumed stature).
const BELIEVED: [f64; 2] = [0.45, 1.35];
/// What is left of all feet after one that contradicts the floor: a camera that was moved has another one after some
/// minutes.
const DOUBT: f64 = 0.995;

/// Whose feet stood where.
#[derive(Debug, Clone, Default)]
pub struct FloorEstimate {
    /// In the order of the last look.
    standers: Vec<Stander>,
    places: Places,
    /// By how much feet that contradict the floor lately outweigh those that it bears.
    against: f64,
    found: Option<Floor>,
}

/// A floor and who stands on it.
#[derive(Debug, Clone)]
pub struct Floor {
    /// In metres, if people on average are as tall as assumed.
    pub ground: FloorPlane,
    /// Identity and stature, as a share of the assumed one, of those whose feet tell it.
    statures: Vec<(u32, f64)>,
    /// Slopes and common intercept.
    plane: Vector3<f64>,
    /// Standard error of the slope along the view, radians.
    pub pitch_error: f64,
}

impl Floor {
    /// Stature as a share of the assumed one; `None` for people whose feet do not tell it.
    pub fn stature(&self, id: u32) -> Option<f64> {
        let own = self.statures.iter().find(|(who, _)| *who == id);
        own.map(|(_, stature)| *stature)
    }

    /// Whether a foot may stand on it; `owner`: where it stood before.
    fn bears(&self, foot: DVec3, owner: Option<&Stander>) -> bool {
        let intercept = foot.y - self.plane.x * foot.x - self.plane.y * foot.z;
        if let Some(owner) = owner.filter(|s| s.count() >= ENOUGH) {
            return (intercept - owner.intercept(&self.plane)).abs() <= OUTLIER;
        }
        let stature = self.plane.z / intercept;
        intercept > 0.0 && stature > BELIEVED[0] && stature < BELIEVED[1]
    }
}

impl FloorEstimate {
    /// The floor as of the last call of [`update`](Self::update), once enough feet stood at enough distances.
    pub fn floor(&self) -> Option<&Floor> {
        self.found.as_ref()
    }

    /// Unit vector towards the floor, camera axes: of the newest floor, else as if the camera were level.
    pub fn down(&self) -> DVec3 {
        self.found
            .as_ref()
            .map_or(DVec3::Y, |floor| -floor.ground.normal)
    }

    /// Takes in a standing ankle of person `id`: camera space at canonical stature, metres.
    pub fn add(&mut self, id: u32, ankle: DVec3) {
        let foot = ankle + ANKLE_HEIGHT * self.down();
        if !foot.is_finite() || foot.z < 0.3 {
            return;
        }
        let weight = self.places.worth_of_look(id, foot);
        let known = self.standers.iter().position(|s| s.id == id);
        if let Some(floor) = &self.found
            && !floor.bears(foot, known.map(|k| &self.standers[k]))
        {
            self.fade(DOUBT.powf(weight));
            self.against += weight;
            if self.count() < self.against.min(ENOUGH) {
                // What is left stood on the old floor: together with feet on another it would make a slope of a step.
                self.standers.clear();
                self.against = 0.0;
            }
            return;
        }
        self.against = (self.against - weight).max(0.0);
        self.fade((MEMORY / (self.count() + weight)).min(1.0));
        let mut own = known.map_or_else(|| Stander::new(id), |k| self.standers.remove(k));
        own.add(foot, weight);
        self.standers.push(own);
        self.standers.retain(|s| s.count() > FORGOTTEN);
        if self.standers.len() > PEOPLE {
            self.standers.remove(0);
        }
    }

    fn fade(&mut self, left: f64) {
        for s in &mut self.standers {
            s.fade(left);
        }
    }

    /// Finds the floor anew.
    pub fn update(&mut self) {
        self.found = self.solve();
    }

    fn count(&self) -> f64 {
        self.standers.iter().map(Stander::count).sum()
    }
}

/// The lower of somebody's ankles; `down`: unit vector towards the floor.
pub fn lower(ankles: impl Iterator<Item = DVec3>, down: DVec3) -> Option<DVec3> {
    ankles.max_by(|a, b| a.dot(down).total_cmp(&b.dot(down)))
}
