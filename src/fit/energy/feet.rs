//! In: a fitted person's feet and their velocities. Out: the places where feet stand, so that they do not slide.

use glam::DVec3;

use super::contact::Contact;
use crate::body::skeleton::{Dof, Posed, Skeleton};
use crate::fit::config::TermsConfig;
use crate::joints::{ANKLES, BODY_JOINTS, DOF, PELVIS};
use crate::message::JointState;

/// A foot slower than this (m/s, across the ray from the camera) may stand …
const STANDS: f64 = 0.35;
/// … and one faster than this does not.
const MOVES: f64 = 0.4;
/// Slow looks in a row, and seconds between the first and the newest of them, from which a foot counts as standing:
/// where one step lies between two looks, a single slow one tells nothing.
const LOOKS: u32 = 2;
const SETTLE: f64 = 0.08;
/// Seconds after which a foot that has just come to rest may be anywhere: a step leaves it in place for half a second …
const HOLDS: f64 = 0.15;
/// … and slow looks in a row, and seconds between them, from which it rests for longer than in a step.
const RESTS: (u32, f64) = (4, 0.5);
/// Metres away from its place, across the ray, at which a foot has left it …
const LEFT: f64 = 0.05;
/// … and along the ray, where the fit itself wavers.
const LEFT_ALONG: f64 = 0.08;
/// Seconds for which a foot that is not seen still stands.
const HIDDEN: f64 = 0.35;
/// Error of a place across the ray from the camera, metres.
const SIGMA: f64 = 0.042;
/// Share of its weight that a place has along the ray. The picture hardly tells a foot's depth: a place that held it
/// fully would hold the whole body wherever the fit first put the foot.
const ALONG: f64 = 0.2;
/// Speed of the body along the view, m/s, that leaves 37 % of that share. At a distance a foot that swings along the
/// view hardly moves in the picture: taken for one that stands, it would hold back the whole body.
const WALKS: f64 = 0.25;
/// Seconds over which that speed is averaged: between two frames it is mostly noise.
const AVERAGED: f64 = 1.0;
/// Seconds in which a place follows what is seen.
const DRIFT: f64 = 0.4;

/// Standing feet of one person.
#[derive(Debug, Clone, Copy, Default)]
pub struct Feet {
    feet: [Foot; 2],
    /// Average speed of the pelvis away from the camera, m/s.
    receding: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Foot {
    place: Option<DVec3>,
    /// Slow looks in a row, and seconds between the first and the newest of them.
    slow: (u32, f64),
    /// Seconds since it was seen.
    hidden: f64,
}

impl Foot {
    /// Takes in where the ankle was fitted (camera space, metres) and its velocity (m/s), `dt` seconds after the last.
    fn follow(&mut self, ankle: DVec3, velocity: DVec3, dt: f64) {
        let looks = u32::from(self.hidden == 0.0);
        let ray = ankle.normalize_or_zero();
        // Depth of single frames is noisy, so the picture decides. A foot that swings along the view shows there, too,
        // while it is near: the camera is higher, and the foot is lifted.
        let speed = velocity.reject_from_normalized(ray).length();
        self.slow = match self.slow {
            _ if speed >= STANDS => (0, 0.0),
            (0, _) => (looks, 0.0),
            (before, seconds) => (before.saturating_add(looks), seconds + dt),
        };
        match &mut self.place {
            Some(place) => {
                let gap = ankle - *place;
                if speed > MOVES || has_left(gap, ray) {
                    *self = Self::default();
                } else {
                    *place += gap * (dt / DRIFT).min(1.0);
                }
            }
            None if self.slow.0 >= LOOKS && self.slow.1 >= SETTLE => self.place = Some(ankle),
            None => {}
        }
    }

    /// Share of its weight that the place has `dt` seconds after the last look.
    fn holds_for(&self, dt: f64) -> f64 {
        let (looks, seconds) = self.slow;
        if looks >= RESTS.0 && seconds >= RESTS.1 {
            1.0
        } else {
            (1.0 - (dt / HOLDS).powi(2)).max(0.0)
        }
    }
}

/// Whether a foot so far (metres) from its place stands there no more; `ray` leads from the camera to the foot.
fn has_left(gap: DVec3, ray: DVec3) -> bool {
    gap.reject_from_normalized(ray).length() > LEFT || gap.dot(ray).abs() > LEFT_ALONG
}

impl Feet {
    /// Contact terms for the fit `dt` seconds after the last in which the person was seen.
    pub fn contacts(&self, terms: &TermsConfig, dt: f64) -> [Option<Contact>; 2] {
        let along = ALONG * (-(self.receding / WALKS).powi(2)).exp();
        std::array::from_fn(|i| {
            let foot = &self.feet[i];
            let weight = terms.contact * foot.holds_for(dt) / (SIGMA * SIGMA);
            foot.place.filter(|_| weight > 0.0).map(|place| Contact {
                joint: ANKLES[i],
                place,
                weight,
                along,
            })
        })
    }

    /// Places of the feet that stand.
    pub fn places(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.feet.iter().filter_map(|f| f.place)
    }

    /// Takes in a fit, `dt` seconds after the last. A foot that is not seen (by `states`) may have left: it stands
    /// nowhere.
    pub fn update(
        &mut self,
        skeleton: &Skeleton,
        posed: &Posed,
        velocity: &[f64; DOF],
        states: &[JointState; BODY_JOINTS],
        dt: f64,
    ) {
        let away = posed.joints[PELVIS].normalize_or_zero();
        let receding = DVec3::from_slice(&velocity[Dof::POSITION]).dot(away);
        self.receding += (receding - self.receding) * (dt / AVERAGED).min(1.0);
        for (foot, joint) in self.feet.iter_mut().zip(ANKLES) {
            let ankle = posed.joints[joint];
            foot.hidden = if states[joint] == JointState::OBSERVED {
                0.0
            } else {
                foot.hidden + dt
            };
            if foot.hidden > HIDDEN {
                foot.place = None;
                foot.slow = (0, 0.0);
                continue;
            }
            let velocity = joint_velocity(skeleton, posed, velocity, joint);
            foot.follow(ankle, velocity, dt);
        }
    }

    /// Forgets where the feet stood.
    pub fn lift(&mut self) {
        self.feet = Default::default();
    }
}

/// Velocity of a joint in camera space, metres per second.
pub fn joint_velocity(
    skeleton: &Skeleton,
    posed: &Posed,
    velocity: &[f64; DOF],
    joint: usize,
) -> DVec3 {
    let mut v = DVec3::from_slice(&velocity[Dof::POSITION]);
    let turning = DVec3::from_slice(&velocity[Dof::ROTATION]);
    v += turning.cross(posed.joints[joint] - posed.joints[PELVIS]);
    for &k in skeleton.chain(joint) {
        v += velocity[Dof::Angle(k).number()] * posed.derivative(k, posed.joints[joint]);
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::Pose;

    #[test]
    fn a_resting_foot_is_held_and_a_step_lets_go() {
        let s = Skeleton::builtin();
        let mut feet = Feet::default();
        let mut pose = Pose::facing_camera(3.0);
        let mut posed = Posed::default();
        let mut velocity = [0.0; DOF];
        let seen = [JointState::OBSERVED; BODY_JOINTS];
        for _ in 0..10 {
            s.pose(&pose, s.lengths(), &mut posed);
            feet.update(s, &posed, &velocity, &seen, 0.033);
        }
        assert_eq!(feet.places().count(), 2);
        assert_eq!(
            feet.contacts(&TermsConfig::default(), 0.033)
                .iter()
                .flatten()
                .count(),
            2
        );
        let right_hip = s
            .angles()
            .iter()
            .position(|a| a.name == "r_hip_abduction")
            .unwrap();
        velocity[Dof::Angle(right_hip).number()] = 3.0;
        pose.angles[right_hip] += 0.1;
        s.pose(&pose, s.lengths(), &mut posed);
        feet.update(s, &posed, &velocity, &seen, 0.033);
        let held: Vec<usize> = feet
            .contacts(&TermsConfig::default(), 0.033)
            .iter()
            .flatten()
            .map(|c| c.joint)
            .collect();
        assert_eq!(held, [13]);
    }

    #[test]
    fn a_foot_that_swings_along_the_view_stands_nowhere() {
        // A camera at 1.5 m; the foot comes nearer at 2.4 m/s just above the floor, five metres away.
        let (mut foot, dt) = (Foot::default(), 0.033);
        let velocity = DVec3::new(0.0, 0.0, -2.4);
        for frame in 0..10 {
            let ankle = DVec3::new(0.0, 1.4, 5.0) + velocity * dt * f64::from(frame);
            foot.follow(ankle, velocity, dt);
            assert_eq!(foot.place, None, "frame {frame}");
        }
    }

    #[test]
    fn slow_cameras_need_several_looks() {
        let seen = |looks: u32, dt: f64| {
            let mut feet = Feet::default();
            for _ in 0..looks {
                feet.feet[0].follow(DVec3::new(0.0, 1.4, 5.0), DVec3::ZERO, dt);
            }
            let [held, _] = feet.contacts(&TermsConfig::default(), dt);
            (
                feet.places().count(),
                held.map(|c| c.weight > 0.999 / (SIGMA * SIGMA)),
            )
        };
        // A single look tells nothing, and of a foot that has just come to rest nothing is known a step later.
        assert_eq!(seen(1, 0.3), (0, None));
        for looks in 2..RESTS.0 {
            assert_eq!(seen(looks, 0.3), (1, None));
        }
        assert_eq!(seen(RESTS.0, 0.3), (1, Some(true)));
        let (places, weight) = seen(4, 0.03);
        assert_eq!((places, weight.is_some()), (1, true));
    }

    #[test]
    fn the_feet_of_a_body_that_moves_along_the_view_say_little_of_its_depth() {
        let s = Skeleton::builtin();
        let mut posed = Posed::default();
        s.pose(&Pose::facing_camera(5.0), s.lengths(), &mut posed);
        let seen = [JointState::OBSERVED; BODY_JOINTS];
        let along = |speed: f64| {
            let mut feet = Feet::default();
            let mut velocity = [0.0; DOF];
            velocity[2] = speed;
            for _ in 0..90 {
                feet.update(s, &posed, &velocity, &seen, 0.033);
            }
            // They stand wherever it goes.
            feet.feet[0].place = Some(posed.joints[ANKLES[0]]);
            feet.contacts(&TermsConfig::default(), 0.033)[0].map(|c| c.along / ALONG)
        };
        assert_eq!(along(0.0), Some(1.0));
        assert!(along(0.08).is_some_and(|share| share > 0.85));
        for speed in [-1.0, 1.0] {
            assert!(along(speed).is_some_and(|share| share < 0.01));
        }
    }

    #[test]
    fn a_place_follows_a_fit_that_wavers_in_depth() {
        let (mut foot, dt) = (Foot::default(), 0.033);
        let ankle = DVec3::new(0.3, 1.4, 5.0);
        let ray = ankle.normalize();
        for _ in 0..10 {
            foot.follow(ankle, DVec3::ZERO, dt);
        }
        for _ in 0..60 {
            foot.follow(ankle + 0.07 * ray, DVec3::ZERO, dt);
        }
        let place = foot.place.expect("it stands");
        assert!((place - ankle).dot(ray) > 0.06);
        foot.follow(place + 0.07 * ray.any_orthonormal_vector(), DVec3::ZERO, dt);
        assert_eq!(foot.place, None, "in the picture it has left");
    }
}
