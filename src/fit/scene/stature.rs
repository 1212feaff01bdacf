//! In: a fitted person and the floor. Out: the stature that puts the feet on it; without a floor, what the settings
//! say.
//!
//! A floor that the settings give tells everybody's stature. One that was found from people's feet tells how tall they
//! are beside each other.

use super::floor_plane::FloorPlane;
use crate::body::skeleton::{ANKLE_HEIGHT, Posed};
use crate::fit::config::FitConfig;
use crate::joints::{ANKLES, BODY_JOINTS, CANONICAL_STATURE};
use crate::message::JointState;

/// Statures that are believed, metres: from the least that the settings take, to a little more than anybody has. Who
/// seems taller stands on something.
const BELIEVED: [f64; 2] = [0.4, 2.3];
/// Seconds that one look stands for, and the most looks that a frame counts for: errors last about that long.
const LOOK: f64 = 1.0 / 30.0;
const MOST: f64 = 6.0;
/// Looks over which the first estimate is a plain mean: 30, and a little more, so that rounding decides nothing.
const FIRST: f64 = 30.5;
/// First step of the running median, as a share of the stature, and the difference from which a step is taken in full,
/// metres. Steps fall as looks become more, up to so many, those of 15 seconds: then a second moves the estimate by
/// 0.6 % at most.
const STEP: f64 = 0.003;
const FULL: f64 = 0.02;
const MEMORY: f64 = 450.0;

/// Seconds in which a difference to what an estimated floor tells shrinks to 1/e, and most of it, as a share of the
/// stature, in a second: bodies that grow move through the room.
const FOLLOW: f64 = 1.0;
const GROW: f64 = 0.05;

/// Stature, metres, that everybody is assumed to have.
pub fn assumed(config: &FitConfig) -> f64 {
    config.height.unwrap_or(config.default_height)
}

/// Running estimate of one person's stature.
#[derive(Debug, Clone, Copy, Default)]
pub struct Stature {
    looks: f64,
    estimate: f64,
}

impl Stature {
    /// Stature in metres.
    pub fn metres(&self, config: &FitConfig) -> f64 {
        if config.height.is_some() || self.looks == 0.0 {
            assumed(config)
        } else {
            self.estimate
        }
    }

    /// Factor from the space of canonical stature to metres.
    pub fn scale(&self, config: &FitConfig) -> f64 {
        self.metres(config) / CANONICAL_STATURE as f64
    }

    /// Takes in what the floor found from feet tells, as a share of the assumed stature, `dt` seconds after the last
    /// time.
    pub fn follow(&mut self, config: &FitConfig, share: f64, dt: f64) {
        if self.looks == 0.0 {
            *self = Self {
                looks: 1.0,
                estimate: assumed(config),
            };
        }
        let most = GROW * dt * self.estimate;
        let step = (share * assumed(config) - self.estimate) * -(-dt / FOLLOW).exp_m1();
        self.estimate += step.clamp(-most, most);
    }

    /// Takes in the first fit of somebody, as [`update`](Self::update): one look.
    pub fn first(&mut self, config: &FitConfig, posed: &Posed, states: &[JointState; BODY_JOINTS]) {
        self.update(config, posed, states, LOOK);
    }

    /// Takes in a fit at canonical stature, `dt` seconds after the last. Only a given floor tells a stature: the person
    /// is as tall as it takes for the lower foot to reach it. Feet that are not seen (by `states`) tell nothing.
    pub fn update(
        &mut self,
        config: &FitConfig,
        posed: &Posed,
        states: &[JointState; BODY_JOINTS],
        dt: f64,
    ) {
        if config.height.is_some() {
            return;
        }
        let Some(ground) = config.ground.as_ref().and_then(FloorPlane::from_config) else {
            return;
        };
        let stature = ANKLES
            .into_iter()
            .filter(|&ankle| states[ankle] == JointState::OBSERVED)
            .map(|ankle| {
                let below = ANKLE_HEIGHT - ground.normal.dot(posed.joints[ankle]);
                CANONICAL_STATURE as f64 * ground.offset / below
            })
            .filter(|s| *s > 0.0)
            .fold(f64::INFINITY, f64::min);
        if !(stature > BELIEVED[0] && stature < BELIEVED[1]) {
            return;
        }
        let look = (dt / LOOK).min(MOST);
        self.looks = (self.looks + look).min(MEMORY);
        if self.looks <= FIRST {
            self.estimate += (stature - self.estimate) * look / self.looks;
        } else {
            // Long steps that were taken in full for small differences would overshoot.
            let steps = look * FIRST / self.looks;
            let full = FULL * steps.max(1.0);
            self.estimate *=
                1.0 + STEP * steps * ((stature - self.estimate) / full).clamp(-1.0, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::{Pose, Skeleton};
    use crate::fit::config::GroundConfig;
    use crate::joints::R_ANKLE;

    const CAMERA_HEIGHT: f64 = 1.4;

    fn config() -> FitConfig {
        FitConfig {
            ground: Some(GroundConfig {
                normal: [0.0, -2.0, 0.0],
                offset: CAMERA_HEIGHT,
            }),
            ..FitConfig::default()
        }
    }

    #[test]
    fn seconds_count_and_not_frames() {
        let (config, s) = (config(), Skeleton::builtin());
        let seen = [JointState::OBSERVED; BODY_JOINTS];
        let mut pose = Pose::facing_camera(3.0);
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let low = posed.joints[R_ANKLE].y;
        // Somebody who seems to be 1.60 m tall in the first fifth of the seconds and 1.80 m from then on.
        let mut taken_for = |fps: f64, seconds: f64| {
            let mut stature = Stature::default();
            for i in 0..(seconds * fps).round() as u32 {
                let truth = match f64::from(i) < 0.2 * seconds * fps - 0.5 {
                    true => 1.60,
                    false => 1.80,
                };
                pose.position.y = CAMERA_HEIGHT * 1.70 / truth - ANKLE_HEIGHT - low;
                s.pose(&pose, s.lengths(), &mut posed);
                stature.update(&config, &posed, &seen, 1.0 / fps);
            }
            stature.metres(&config)
        };
        for fps in [240.0, 60.0, 30.0, 10.0, 5.0] {
            let mean = taken_for(fps, 1.0);
            assert!((mean - 1.76).abs() < 0.005, "{fps} fps: {mean}");
        }
        let usual = taken_for(30.0, 2.0);
        for fps in [240.0, 60.0, 10.0] {
            let found = taken_for(fps, 2.0);
            assert!((found - usual).abs() < 0.01, "{fps} fps: {found}, {usual}");
        }
        // A second between frames: the median begins with the sixth and reaches the truth within 20.
        let slow = taken_for(1.0, 20.0);
        assert!((slow - 1.80).abs() < 0.02, "{slow}");
    }

    #[test]
    fn whoever_steps_on_something_for_a_moment_does_not_grow() {
        let (config, s, truth) = (config(), Skeleton::builtin(), 1.75);
        let seen = [JointState::OBSERVED; BODY_JOINTS];
        let mut pose = Pose::facing_camera(3.0);
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let low = posed.joints[R_ANKLE].y;
        for fps in [60.0, 30.0, 10.0] {
            let mut stature = Stature::default();
            let mut stands = |seconds: f64, above: f64| {
                pose.position.y = (CAMERA_HEIGHT - above) * 1.70 / truth - ANKLE_HEIGHT - low;
                s.pose(&pose, s.lengths(), &mut posed);
                for _ in 0..(seconds * fps).round() as u32 {
                    stature.update(&config, &posed, &seen, 1.0 / fps);
                }
                stature.metres(&config)
            };
            stands(15.0, 0.0);
            let up = stands(3.0, 0.3);
            assert!((up - truth).abs() < 0.05, "{fps} fps: {up} m on the step");
            let down = stands(7.0, 0.0);
            assert!((down - truth).abs() < 0.01, "{fps} fps: {down} m after it");
            // What lasts is believed.
            let stays = stands(60.0, 0.3);
            assert!(stays > truth + 0.4, "{fps} fps: {stays} m");
        }
    }

    #[test]
    fn the_floor_tells_the_height() {
        let (config, s) = (config(), Skeleton::builtin());
        let truth = 1.86;
        let scale = truth / 1.70;
        let mut stature = Stature::default();
        assert_eq!(stature.metres(&config), 1.70);
        let seen = [JointState::OBSERVED; BODY_JOINTS];
        let mut posed = Posed::default();
        for i in 0..200 {
            let mut pose = Pose::facing_camera(3.0 + 0.01 * f64::from(i));
            s.pose(&pose, s.lengths(), &mut posed);
            // Stand it on the floor in true metres, then look at it at canonical stature.
            let low = posed.joints[R_ANKLE].y;
            let jump = if i % 50 > 45 { 0.2 } else { 0.0 };
            pose.position.y += (CAMERA_HEIGHT - jump) / scale - ANKLE_HEIGHT - low;
            s.pose(&pose, s.lengths(), &mut posed);
            stature.update(&config, &posed, &seen, LOOK);
            // Feet that nobody sees say nothing, wherever they are.
            pose.position.y -= 0.5;
            s.pose(&pose, s.lengths(), &mut posed);
            stature.update(&config, &posed, &[JointState::OCCLUDED; BODY_JOINTS], LOOK);
        }
        assert!(
            (stature.metres(&config) - truth).abs() < 0.03,
            "{}",
            stature.metres(&config)
        );
        // Whoever begins to walk, and nobody who seems to stand deep in the floor.
        for (truth, taken_for) in [(0.78, 0.78), (0.3, 1.70)] {
            let mut pose = Pose::facing_camera(6.0);
            s.pose(&pose, s.lengths(), &mut posed);
            pose.position.y +=
                CAMERA_HEIGHT * 1.70 / truth - ANKLE_HEIGHT - posed.joints[R_ANKLE].y;
            s.pose(&pose, s.lengths(), &mut posed);
            let mut stature = Stature::default();
            stature.first(&config, &posed, &seen);
            let found = stature.metres(&config);
            assert!((found - taken_for).abs() < 1e-6, "{truth} m: {found}");
        }
        let known = FitConfig {
            height: Some(1.5),
            ..config
        };
        assert_eq!(stature.metres(&known), 1.5);
    }
}
