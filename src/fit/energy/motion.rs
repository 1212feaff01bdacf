//! In: poses as they were fitted and how well each was determined. Out: velocities, the pose to expect next and how far
//! to trust it. One constant-velocity Kalman filter per degree of freedom; its prediction is the temporal term of the
//! energy.

use crate::body::skeleton::{Dof, Pose, Skeleton};
use crate::fit::config::{PredictionConfig, TermsConfig};
use crate::joints::DOF;

/// Uncertainty before anything was seen: metres or radians, and per second.
const INITIAL: [f64; 2] = [0.3, 1.0];
/// Greatest variance of a velocity, (m/s)² or (rad/s)².
const MAX_RATE_VARIANCE: f64 = 36.0;
/// Interval over which accelerations keep their sign, seconds: turns them into a noise density.
const ACCELERATION_TIME: f64 = 1.0 / 30.0;
/// Errors are alike for about so many seconds, so that a frame tells less than its variance says: by as many times as
/// its interval lies in them, and at least by this factor. Less at 5 to 15 frames a second costs 1 to 4 mm.
const ALIKE: f64 = 0.1;
const LEAST_ALIKE: f64 = 3.0;
/// The temporal term's weight is the inverse variance of the prediction times that factor and this. The filter itself,
/// for which observations count that many times less than in the energy, would call for 1. Half of this has a little
/// less error and twice the jitter.
const CALM: f64 = 2.0 / 9.0;

/// By how many times a frame `since` seconds after the last tells less than its variance says.
fn correlated(since: f64) -> f64 {
    (ALIKE / since.max(1e-3)).max(LEAST_ALIKE)
}

/// Typical acceleration of each degree of freedom, m/s² or rad/s².
fn acceleration(dof: Dof, skeleton: &Skeleton) -> f64 {
    match dof {
        Dof::Position(0 | 1) => 2.5,
        Dof::Position(_) => 2.0,
        Dof::Rotation(_) => 8.0,
        Dof::Angle(k) => {
            let name = skeleton.angles()[k].name.as_str();
            let part = name.trim_start_matches("r_").trim_start_matches("l_");
            match part.split('_').next().unwrap_or(part) {
                "spine" => 5.0,
                "neck" => 6.0,
                "shoulder" => 25.0,
                "elbow" => 30.0,
                "hip" => 20.0,
                "knee" => 30.0,
                _ => 15.0,
            }
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Covariance {
    place: f64,
    mixed: f64,
    rate: f64,
}

/// Velocities of one person and how certain pose and velocity are.
#[derive(Debug, Clone)]
pub struct Motion {
    /// Velocity of every degree of freedom, in the order of [`Dof`]: its unit a second.
    pub velocity: [f64; DOF],
    covariance: [Covariance; DOF],
    /// Seconds since a pose was taken in.
    since: f64,
}

impl Default for Motion {
    fn default() -> Self {
        Self {
            velocity: [0.0; DOF],
            covariance: [Covariance {
                place: INITIAL[0] * INITIAL[0],
                mixed: 0.0,
                rate: INITIAL[1] * INITIAL[1],
            }; DOF],
            since: 0.0,
        }
    }
}

/// Noise densities of all degrees of freedom; built once.
#[derive(Debug, Clone)]
pub struct MotionModel {
    density: [f64; DOF],
    fade: [f64; DOF],
    temporal: f64,
}

impl MotionModel {
    /// From the energy's weights and the fading of unseen motion.
    pub fn new(skeleton: &Skeleton, terms: &TermsConfig, prediction: &PredictionConfig) -> Self {
        Self {
            density: std::array::from_fn(|d| {
                acceleration(Dof::of(d), skeleton).powi(2) * ACCELERATION_TIME
            }),
            fade: std::array::from_fn(|d| match Dof::of(d) {
                Dof::Position(_) => prediction.root_fade,
                Dof::Rotation(_) | Dof::Angle(_) => prediction.joint_fade,
            }),
            temporal: terms.temporal,
        }
    }
}

impl Motion {
    /// The pose `dt` seconds ahead, with velocities that fade as nothing is seen; nothing is changed.
    pub fn ahead(&self, pose: &Pose, dt: f64, model: &MotionModel) -> Pose {
        let step = std::array::from_fn(|d| {
            let tau = model.fade[d];
            self.velocity[d] * tau * -(-dt / tau).exp_m1()
        });
        pose.moved(&step)
    }

    /// Moves on by `dt` seconds in which something is expected to be seen; returns the predicted pose.
    pub fn predict(&mut self, pose: &Pose, dt: f64, model: &MotionModel) -> Pose {
        self.since += dt;
        let step = std::array::from_fn(|d| self.velocity[d] * dt);
        for (c, s) in self.covariance.iter_mut().zip(&model.density) {
            c.place += 2.0 * dt * c.mixed + dt * dt * c.rate + s * dt * dt * dt / 3.0;
            c.mixed += dt * c.rate + s * dt * dt / 2.0;
            c.rate = (c.rate + s * dt).min(MAX_RATE_VARIANCE);
            // Keep it a covariance where the rate was capped.
            let bound = (c.place * c.rate).sqrt();
            c.mixed = c.mixed.clamp(-bound, bound);
        }
        pose.moved(&step)
    }

    /// Moves on by `dt` seconds in which nothing was seen.
    pub fn coast(&mut self, pose: &Pose, dt: f64, model: &MotionModel) -> Pose {
        let ahead = self.ahead(pose, dt, model);
        self.predict(pose, dt, model);
        for (v, tau) in self.velocity.iter_mut().zip(&model.fade) {
            *v *= (-dt / tau).exp();
        }
        ahead
    }

    /// Weights of the temporal term by degree of freedom: a share of the prediction's inverse variance.
    pub fn weights(&self, model: &MotionModel) -> [f64; DOF] {
        let factor = CALM * model.temporal * correlated(self.since);
        std::array::from_fn(|d| factor / self.covariance[d].place)
    }

    /// Takes in a fitted pose: `innovation` is its step from the prediction, `information` the diagonal of the matrix
    /// it was solved with, the temporal term's `weights` included.
    pub fn correct(
        &mut self,
        innovation: &[f64; DOF],
        information: &[f64; DOF],
        weights: &[f64; DOF],
    ) {
        let correlated = correlated(self.since);
        self.since = 0.0;
        for d in 0..DOF {
            let c = &mut self.covariance[d];
            self.velocity[d] += c.mixed / c.place * innovation[d];
            let seen = (information[d] - weights[d]).max(0.0) / correlated;
            let gain = c.place * seen / (1.0 + c.place * seen);
            let (k1, mixed) = (c.mixed * gain / c.place, c.mixed);
            c.place *= 1.0 - gain;
            c.mixed *= 1.0 - gain;
            c.rate = (c.rate - k1 * mixed).max(1e-9);
        }
    }

    /// Forgets the motion of one degree of freedom, e.g. after its angle jumped to an equivalent one.
    pub fn restart(&mut self, dof: Dof) {
        let dof = dof.number();
        self.velocity[dof] = 0.0;
        self.covariance[dof] = Covariance {
            place: INITIAL[0] * INITIAL[0],
            mixed: 0.0,
            rate: INITIAL[1] * INITIAL[1],
        };
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.velocity.iter().all(|v| v.is_finite())
            && self
                .covariance
                .iter()
                .all(|c| c.place.is_finite() && c.mixed.is_finite() && c.rate.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_velocity_is_learned_without_lag() {
        let model = MotionModel::new(
            Skeleton::builtin(),
            &TermsConfig::default(),
            &PredictionConfig::default(),
        );
        let mut motion = Motion::default();
        let mut pose = Pose::facing_camera(3.0);
        let dt = 1.0 / 30.0;
        let mut miss = 0.0;
        for i in 0..90 {
            let predicted = motion.predict(&pose, dt, &model);
            let truth = 0.05 * i as f64;
            miss = truth - predicted.position.x;
            // A measurement with variance 0.01.
            let weights = motion.weights(&model);
            let information: [f64; DOF] = weights.map(|w| w + 100.0);
            let mut step = [0.0; DOF];
            step[0] = miss * 100.0 / information[0];
            pose = predicted.moved(&step);
            motion.correct(&step, &information, &weights);
        }
        assert!(miss.abs() < 0.005, "{miss}");
        assert!((motion.velocity[0] - 1.5).abs() < 0.1);
        let ahead = motion.ahead(&pose, 10.0, &model);
        assert!(
            ahead.position.x - pose.position.x < 1.5,
            "extrapolation fades"
        );
        for _ in 0..1000 {
            pose = motion.coast(&pose, dt, &model);
        }
        assert!(motion.is_finite() && motion.velocity[0].abs() < 1e-6);
    }

    /// How far the fitted place of somebody who stands still is off, of errors that last for 0.15 s, at so many frames
    /// a second: its second difference over a thirtieth of a second, root mean square.
    fn shakes(fps: f64) -> f64 {
        let skeleton = Skeleton::builtin();
        let model = MotionModel::new(
            skeleton,
            &TermsConfig::default(),
            &PredictionConfig::default(),
        );
        let (mut motion, mut pose) = (Motion::default(), Pose::facing_camera(3.0));
        let (dt, every) = (1.0 / fps, (fps / 30.0) as usize);
        // Sines of many rates in place of chance: the same errors at any frame rate.
        let error = |t: f64| {
            let rates = (1..60).map(|k| 0.7 * f64::from(k));
            let parts = rates.map(|w| (w * t + 5.0 * w * w).sin() / (1.0 + (0.15 * w).powi(2)));
            0.02 * parts.sum::<f64>()
        };
        let mut places = Vec::new();
        for i in 0..(60.0 * fps) as usize {
            let predicted = motion.predict(&pose, dt, &model);
            let weights = motion.weights(&model);
            let seen = 1.0 / 0.05f64.powi(2);
            let information: [f64; DOF] = weights.map(|w| w + seen);
            let mut step = [0.0; DOF];
            step[0] = (error(i as f64 * dt) - predicted.position.x) * seen / information[0];
            pose = predicted.moved(&step);
            motion.correct(&step, &information, &weights);
            if i % every == 0 {
                places.push(pose.position.x);
            }
        }
        let bends = places[60..]
            .windows(3)
            .map(|p| (p[0] - 2.0 * p[1] + p[2]).powi(2));
        let (sum, count) = bends.fold((0.0, 0.0), |(s, n), b| (s + b, n + 1.0));
        (sum / f64::max(count, 1.0)).sqrt()
    }

    #[test]
    fn somebody_shakes_as_little_before_a_fast_camera() {
        let (usual, fast) = (shakes(30.0), shakes(120.0));
        assert!(fast < 1.15 * usual, "{usual} at 30 a second, {fast} at 120");
    }
}
