//! In: a joint, and a place where it is known to stand. Out: how far it is from there. The contact term: a foot on the
//! floor does not slide.

use glam::DVec3;

use super::quadratic::Quadratic;
use super::robust::robust_weight;

/// A point where a joint is known to stand, e.g. a foot on the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The standing joint.
    pub joint: usize,
    /// Where it stands, camera space, metres at canonical stature.
    pub place: DVec3,
    /// Inverse variance across the ray from the camera to the place, 1/m².
    pub weight: f64,
    /// Share of `weight` along that ray, 0–1.
    pub along: f64,
}

impl Contact {
    /// Direction from the camera to the place.
    fn ray(&self) -> DVec3 {
        self.place.normalize_or_zero()
    }

    /// How far a joint lies from the place: squared, in standard deviations.
    pub fn deviation(&self, joint: DVec3) -> f64 {
        let r = joint - self.place;
        let along = r.dot(self.ray());
        self.weight * (r.length_squared() - (1.0 - self.along) * along * along)
    }

    /// Adds what the place says of a joint.
    pub fn add_to(&self, joint: DVec3, space: &mut Quadratic) {
        let (r, ray) = (joint - self.place, self.ray());
        let weight = self.weight * robust_weight(self.deviation(joint));
        space.add_point(weight, r);
        // The whole holds all directions alike: what is too much along the ray is taken off.
        space.add_row(-weight * (1.0 - self.along), ray, r.dot(ray));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::R_ANKLE;

    #[test]
    fn a_place_holds_less_along_its_ray() {
        let place = DVec3::new(1.0, 1.5, 5.0);
        let contact = Contact {
            joint: R_ANKLE,
            place,
            weight: 400.0,
            along: 0.2,
        };
        let ray = place.normalize();
        let across = ray.any_orthonormal_vector();
        for (direction, deviation) in [(ray, 0.8), (across, 4.0), (ray.cross(across), 4.0)] {
            let found = contact.deviation(place + 0.1 * direction);
            assert!((found - deviation).abs() < 1e-9, "{direction}: {found}");
        }
    }
}
