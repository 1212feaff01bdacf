//! In: places where feet stand. Out: the floor, and the world that stands on it: y up, origin on the floor below the camera.

use glam::{DMat3, DQuat, DVec3};

use super::config::GroundConfig;

/// Height of a standing ankle above the floor at canonical stature, metres.
pub const ANKLE: f64 = 0.085;
/// Error of a standing ankle, metres.
const SIGMA: f64 = 0.12;
/// Cameras stand nearly upright: spread of the floor's slope across (roll) and along (pitch) the view.
const ROLL: f64 = 0.05;
const PITCH: f64 = 0.4;
/// Feet that must have stood somewhere, and their spread in depth (metres), before a floor is believed.
const ENOUGH: f64 = 40.0;
const SPREAD: f64 = 0.25;
/// Old feet fade so that about this many count.
const MEMORY: f64 = 2000.0;
/// A foot farther than this (metres) from a believed floor stands on something else.
const OUTLIER: f64 = 0.4;

/// The floor in camera axes: points p with normal · p + offset = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// Unit vector away from the floor.
    pub normal: DVec3,
    /// Height of the camera above the floor, metres.
    pub offset: f64,
}

impl Ground {
    /// From settings; `None` if the normal is no direction.
    pub fn from_config(config: &GroundConfig) -> Option<Self> {
        Some(Self {
            normal: DVec3::from_array(config.normal).try_normalize()?,
            offset: config.offset,
        })
    }

    /// Height of a point above the floor, metres.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) + self.offset
    }

    /// Rotation and translation from camera axes to the floor-aligned world: x to the camera's right, y up, z towards the
    /// camera's back; the origin is on the floor below the camera. World = rotation · camera + translation.
    pub fn world_from_camera(&self) -> (DQuat, DVec3) {
        let y = self.normal;
        let x = (DVec3::X - y * y.x).try_normalize().unwrap_or(DVec3::Z);
        let z = x.cross(y);
        // Rows are the world's axes in camera coordinates.
        let rotation = DQuat::from_mat3(&DMat3::from_cols(x, y, z).transpose()).normalize();
        (rotation, DVec3::new(0.0, self.offset, 0.0))
    }

    /// A camera-space point in the floor-aligned world.
    pub fn to_world(&self, point: DVec3) -> DVec3 {
        let (rotation, translation) = self.world_from_camera();
        rotation * point + translation
    }
}

/// Running least squares of y = a·x + b·z + c over standing ankles.
#[derive(Debug, Clone, Default)]
pub struct GroundEstimate {
    count: f64,
    /// Sums of the products of (x, z, 1) with themselves and with y.
    xx: [[f64; 3]; 3],
    xy: [f64; 3],
}

impl GroundEstimate {
    /// Takes in an ankle that stands at a place (camera space, metres) of a person `scale` times canonical stature.
    pub fn add(&mut self, place: DVec3, scale: f64) {
        let foot = place + DVec3::new(0.0, ANKLE * scale, 0.0);
        if !foot.is_finite() || foot.z < 0.3 {
            return;
        }
        if let Some(ground) = self.ground()
            && ground.height(foot).abs() > OUTLIER
        {
            return;
        }
        let fade = (MEMORY / (self.count + 1.0)).min(1.0);
        let row = [foot.x, foot.z, 1.0];
        for i in 0..3 {
            for j in 0..3 {
                self.xx[i][j] = fade * self.xx[i][j] + row[i] * row[j];
            }
            self.xy[i] = fade * self.xy[i] + row[i] * foot.y;
        }
        self.count = fade * self.count + 1.0;
    }

    /// The floor, once enough feet stood at enough distances.
    pub fn ground(&self) -> Option<Ground> {
        if self.count < ENOUGH {
            return None;
        }
        let mean_z = self.xx[1][2] / self.count;
        let spread = (self.xx[1][1] / self.count - mean_z * mean_z)
            .max(0.0)
            .sqrt();
        if spread < SPREAD {
            return None;
        }
        let mut a = nalgebra::Matrix3::from_fn(|i, j| self.xx[i][j]);
        a[(0, 0)] += (SIGMA / ROLL).powi(2);
        a[(1, 1)] += (SIGMA / PITCH).powi(2);
        let solution = a.cholesky()?.solve(&nalgebra::Vector3::from(self.xy));
        let (a, b, c) = (solution.x, solution.y, solution.z);
        let length = (a * a + b * b + 1.0).sqrt();
        let offset = c / length;
        let ground = Ground {
            normal: DVec3::new(a, -1.0, b) / length,
            offset,
        };
        (ground.normal.is_finite() && offset > 0.05).then_some(ground)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn feet_tell_a_tilted_floor() {
        // Camera 2.2 m up, pitched 20° down.
        let truth = Ground {
            normal: DQuat::from_rotation_x(-20f64.to_radians()) * DVec3::NEG_Y,
            offset: 2.2,
        };
        let mut estimate = GroundEstimate::default();
        for i in 0..300 {
            let (x, z) = (f64::from(i % 7) - 3.0, 3.0 + 0.5 * f64::from(i % 9));
            let noise = 0.05 * (f64::from(i * 37 % 11) / 5.0 - 1.0);
            // On the floor, an ankle's height up.
            let n = truth.normal;
            let y = -(n.x * x + n.z * z + truth.offset) / n.y;
            let wild = if i % 25 == 24 { -1.0 } else { 0.0 };
            estimate.add(
                DVec3::new(x, y + noise + wild, z) - DVec3::new(0.0, ANKLE, 0.0),
                1.0,
            );
        }
        let found = estimate.ground().unwrap();
        assert!(found.normal.dot(truth.normal) > 0.999, "{found:?}");
        assert!((found.offset - truth.offset).abs() < 0.1, "{found:?}");
    }

    #[test]
    fn one_spot_is_no_floor() {
        let mut estimate = GroundEstimate::default();
        for _ in 0..500 {
            estimate.add(DVec3::new(0.0, 1.4, 4.0), 1.0);
        }
        assert_eq!(estimate.ground(), None);
    }

    #[test]
    fn the_world_stands_on_the_floor() {
        let ground = Ground {
            normal: DQuat::from_rotation_x(-0.3) * DVec3::NEG_Y,
            offset: 1.7,
        };
        assert!((ground.to_world(DVec3::ZERO) - DVec3::new(0.0, 1.7, 0.0)).length() < 1e-12);
        let below = ground.normal * -1.7;
        assert!(ground.to_world(below).length() < 1e-12);
        let (rotation, _) = ground.world_from_camera();
        assert!((rotation * ground.normal - DVec3::Y).length() < 1e-12);
        assert!((rotation * DVec3::X - DVec3::X).length() < 1e-12);
        // What is in front of the camera lies towards −z.
        assert!((rotation * DVec3::Z).z < -0.9);
    }
}
