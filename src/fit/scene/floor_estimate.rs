//! In: places where feet stand, everybody's at canonical stature. Out: the floor that they share, and how tall who
//! stands on it is.
//!
//! Whoever is taken for taller or smaller than they are is placed too far or too near in proportion, feet included:
//! they stand on a floor of the same slope at another height, y = a·x + b·z + c / s, where s is their stature as a
//! share of the assumed one. So slopes are shared and everybody has an intercept of their own: a linear mixed model
//! (Laird and Ware 1982), from which the intercepts are eliminated in closed form. One camera cannot tell a room from
//! its model, so the sizes of all together rest on how tall people are: most of them adults, about as tall as assumed,
//! some children.
//!
//! How far away a foot is is known to some percent only, where it is in the picture much better. Such errors move feet
//! along their rays, and a floor through them is more level than the true one. At most they are so large that slopes
//! are those of `most` (least squares with errors in variables); how much of that is true is what the places of feet in
//! the picture say, as instruments that have no such errors. These alone would not do: heights that are wrong, as of
//! feet after the camera was moved, tilt a floor by tens of degrees.

use glam::DVec3;
use nalgebra::{Matrix3, Vector3};

use super::floor_plane::FloorPlane;
use super::stature_prior::{ADULTS, common_level, expected};
use crate::body::skeleton::ANKLE_HEIGHT;

/// Error of a standing ankle, metres. More than the 0.12 it is off by: looks at the same foot do not differ by chance
/// alone.
const SIGMA: f64 = 0.22;
/// What is wrong with a person's feet for as long as they are in view, metres.
const LASTING: f64 = 0.05;
/// Cameras stand nearly upright: spread of the floor's slope across (roll) and along (pitch) the view.
const ROLL: f64 = 0.05;
const PITCH: f64 = 0.4;
/// Greatest error of a foot's distance along its ray, as a share.
const ALONG: f64 = 0.03;
/// Feet that must have stood somewhere, and their spread in depth (metres), before a floor is believed.
const ENOUGH: f64 = 40.0;
const SPREAD: f64 = 0.25;
/// Looks at somebody's feet before they tell a stature.
const TELLING: f64 = 6.0;
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
/// Feet so near to one another (metres, over the floor) rest in one place, …
const SAME_PLACE: f64 = 0.3;
/// … of which a person has so many at a time: two, and two where restless feet go to and fro.
const PLACES: usize = 4;
/// Rounds in which people who are no taller or smaller than others tell more about slopes than who is.
const ROUNDS: usize = 4;

/// Sums over the feet of one person: products of (x, z, 1) with themselves and with y, and of their places in the
/// picture, (x/z, y/z, 1), with themselves, with (x, z, 1) and with y.
#[derive(Debug, Clone)]
struct Stander {
    id: u32,
    xx: Matrix3<f64>,
    xy: Vector3<f64>,
    seen: Matrix3<f64>,
    seen_x: Matrix3<f64>,
    seen_y: Vector3<f64>,
}

impl Stander {
    fn new(id: u32) -> Self {
        let (none, zero) = (Matrix3::zeros(), Vector3::zeros());
        Self {
            id,
            xx: none,
            xy: zero,
            seen: none,
            seen_x: none,
            seen_y: zero,
        }
    }

    fn add(&mut self, foot: DVec3, weight: f64) {
        let at = Vector3::new(foot.x, foot.z, 1.0);
        let seen = Vector3::new(foot.x / foot.z, foot.y / foot.z, 1.0);
        self.xx += weight * at * at.transpose();
        self.xy += weight * at * foot.y;
        self.seen += weight * seen * seen.transpose();
        self.seen_x += weight * seen * at.transpose();
        self.seen_y += weight * seen * foot.y;
    }

    fn fade(&mut self, left: f64) {
        for sum in [&mut self.xx, &mut self.seen, &mut self.seen_x] {
            *sum *= left;
        }
        self.xy *= left;
        self.seen_y *= left;
    }

    fn count(&self) -> f64 {
        self.xx[(2, 2)]
    }

    /// Mean of (x, z, 1).
    fn middle(&self) -> Vector3<f64> {
        self.xx.column(2) / self.count()
    }

    /// Height of the floor at x = z = 0 under this person, by slopes alone.
    fn intercept(&self, plane: &Vector3<f64>) -> f64 {
        let slopes = Vector3::new(plane.x, plane.y, 0.0);
        self.xy.z / self.count() - self.middle().dot(&slopes)
    }
}

/// Where somebody's foot was seen, and how often since it came there.
#[derive(Debug, Clone, Copy)]
struct Place {
    id: u32,
    foot: DVec3,
    looks: f64,
}

/// Whose feet stood where.
#[derive(Debug, Clone, Default)]
pub struct FloorEstimate {
    /// In the order of the last look.
    standers: Vec<Stander>,
    /// In the order of the last look.
    places: Vec<Place>,
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
        let weight = self.weight(id, foot);
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

    /// What a look at a foot is worth: the n-th at one place an n-th, whether the floor bears it or not. Whoever rests
    /// for hours tells little more than in the first seconds, and looks at a foot that rests err alike.
    fn weight(&mut self, id: u32, foot: DVec3) -> f64 {
        let is_there = |p: &Place| {
            let apart = p.foot - foot;
            p.id == id && apart.x.hypot(apart.z) < SAME_PLACE
        };
        let mut place = match self.places.iter().position(is_there) {
            Some(k) => self.places.remove(k),
            None => Place {
                id,
                foot,
                looks: 0.0,
            },
        };
        place.looks += 1.0;
        self.places.push(place);
        let own = self.places.iter().filter(|p| p.id == id).count();
        if own > PLACES
            && let Some(oldest) = self.places.iter().position(|p| p.id == id)
        {
            self.places.remove(oldest);
        }
        if self.places.len() > PEOPLE * PLACES {
            self.places.remove(0);
        }
        1.0 / place.looks
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

    fn solve(&self) -> Option<Floor> {
        let all: Matrix3<f64> = self.standers.iter().map(|s| s.xx).sum();
        let count = all[(2, 2)];
        if count < ENOUGH {
            return None;
        }
        let mean: Vector3<f64> = all.column(2) / count;
        let spread = (all[(1, 1)] / count - mean.y * mean.y).max(0.0).sqrt();
        if spread < SPREAD {
            return None;
        }
        let mut level = all_intercept(&self.standers);
        let mut variances = vec![(ADULTS * level).powi(2) + LASTING.powi(2); self.standers.len()];
        let mut plane = Vector3::zeros();
        let mut errors = Vec::new();
        let mut pitch_error = PITCH;
        for _ in 0..ROUNDS {
            let (normal, right) = self.equations(&variances, 0.0);
            let solver = normal.cholesky()?;
            plane = self.without_errors_along(solver.solve(&right), &variances);
            let covariance = solver.inverse() * (SIGMA * SIGMA);
            pitch_error = covariance[(1, 1)].sqrt() / (1.0 + plane.y * plane.y);
            // Of an intercept: by the feet, and by slopes over the distance from where most of them stood.
            errors.clear();
            errors.extend(self.standers.iter().map(|s| {
                let mut off = s.middle() - mean;
                off.z = 0.0;
                let own = LASTING.powi(2) + SIGMA * SIGMA / s.count();
                own + (off.transpose() * covariance * off)[0]
            }));
            let own = self.standers.iter().map(|s| s.intercept(&plane).max(0.1));
            let own: Vec<f64> = own.collect();
            let spreads = errors.iter().map(|e| e.sqrt() / level).collect::<Vec<_>>();
            level = common_level(&own, &spreads);
            for (v, c) in variances.iter_mut().zip(&own) {
                *v = ((ADULTS * level).powi(2) + LASTING.powi(2)).max((c - level).powi(2));
            }
        }
        let length = (plane.x * plane.x + plane.y * plane.y + 1.0).sqrt();
        let ground = FloorPlane {
            normal: DVec3::new(plane.x, -1.0, plane.y) / length,
            offset: level / length,
        };
        if !ground.normal.is_finite() || ground.offset <= 0.05 {
            return None;
        }
        let telling = self.standers.iter().zip(&errors);
        let mut statures: Vec<(u32, f64)> = telling
            .filter(|(s, _)| s.count() >= TELLING)
            .map(|(s, e)| {
                let measured = (level / s.intercept(&plane).max(0.1)).ln();
                (s.id, expected(measured, e.sqrt() / level).exp())
            })
            .collect();
        if statures.len() < 2 {
            // Nobody to compare with.
            statures.clear();
        }
        plane.z = level;
        Some(Floor {
            ground,
            statures,
            plane,
            pitch_error,
        })
    }

    /// Normal equations of slopes and common intercept, everybody's own intercept with its variance being eliminated,
    /// and of squares and products of distances what is there by an `error` of them along the rays, a share.
    fn equations(&self, variances: &[f64], error: f64) -> (Matrix3<f64>, Vector3<f64>) {
        let share = 1.0 / (1.0 + error * error);
        let (mut normal, mut right) = (prior(), Vector3::zeros());
        for (s, v) in self.standers.iter().zip(variances) {
            let u = s.xx.column(2) / (s.count() + SIGMA * SIGMA / v);
            let mut xx = s.xx;
            xx.fixed_view_mut::<2, 2>(0, 0).scale_mut(share);
            normal += xx - u * s.xx.row(2);
            right += Vector3::new(share, share, 1.0).component_mul(&s.xy) - u * s.xy.z;
        }
        (normal, right)
    }

    /// Slopes and common intercept by the places of feet in the picture (two-stage least squares), everybody's own
    /// intercept being eliminated as in [`equations`](Self::equations).
    fn by_places_seen(&self, variances: &[f64]) -> Option<Vector3<f64>> {
        let (mut seen, mut seen_x, mut seen_y) =
            (Matrix3::zeros(), Matrix3::zeros(), Vector3::zeros());
        for (s, v) in self.standers.iter().zip(variances) {
            let u = s.seen.column(2) / (s.count() + SIGMA * SIGMA / v);
            seen += s.seen - u * s.seen.row(2);
            seen_x += s.seen_x - u * s.seen_x.row(2);
            seen_y += s.seen_y - u * s.seen_y.z;
        }
        // Whoever stands in one place of the picture is no instrument.
        let least = 1e-6 * self.count();
        seen += Matrix3::from_diagonal(&Vector3::new(least, least, 0.0));
        let explained: Matrix3<f64> = seen.cholesky()?.solve(&seen_x);
        let normal = explained.transpose() * seen_x + prior();
        Some(normal.cholesky()?.solve(&(explained.transpose() * seen_y)))
    }

    /// A floor found by least squares, rid of as much of the greatest error along the rays as places in the picture
    /// say.
    fn without_errors_along(&self, found: Vector3<f64>, variances: &[f64]) -> Vector3<f64> {
        let (normal, right) = self.equations(variances, ALONG);
        let most = normal.cholesky().map(|solver| solver.solve(&right));
        let (Some(most), Some(told)) = (most, self.by_places_seen(variances)) else {
            return found;
        };
        let (apart, part) = (most.y - found.y, told.y - found.y);
        if apart.abs() < 1e-9 {
            return found;
        }
        found + (most - found) * (part / apart).clamp(0.0, 1.0)
    }
}

/// What is known of slopes beforehand.
fn prior() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(
        (SIGMA / ROLL).powi(2),
        (SIGMA / PITCH).powi(2),
        0.0,
    ))
}

/// The lower of somebody's ankles; `down`: unit vector towards the floor.
pub fn lower(ankles: impl Iterator<Item = DVec3>, down: DVec3) -> Option<DVec3> {
    ankles.max_by(|a, b| a.dot(down).total_cmp(&b.dot(down)))
}

/// Mean height of feet below the camera.
fn all_intercept(standers: &[Stander]) -> f64 {
    let count: f64 = standers.iter().map(Stander::count).sum();
    let sum: f64 = standers.iter().map(|s| s.xy.z).sum();
    (sum / count).max(0.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// Camera 2.2 m up, pitched 20° down.
    fn truth() -> FloorPlane {
        FloorPlane {
            normal: DQuat::from_rotation_x(-20f64.to_radians()) * DVec3::NEG_Y,
            offset: 2.2,
        }
    }

    /// An ankle of somebody `share` times as tall as assumed who stands at (x, z) of the true floor, a little off.
    fn ankle(share: f64, x: f64, z: f64, off: f64) -> DVec3 {
        ankle_on(truth(), share, x, z, off)
    }

    fn ankle_on(floor: FloorPlane, share: f64, x: f64, z: f64, off: f64) -> DVec3 {
        let FloorPlane { normal: n, offset } = floor;
        let y = -(n.x * x + n.z * z + offset) / n.y;
        DVec3::new(x, y + off, z) / share - DVec3::new(0.0, ANKLE_HEIGHT, 0.0)
    }

    /// The floor after people, each by identity and share, walked about for `looks` looks.
    fn walked(people: &[(u32, f64)], looks: u32) -> FloorEstimate {
        let mut estimate = FloorEstimate::default();
        for i in 0..looks {
            for &(id, share) in people {
                let k = i + 17 * id;
                let off = 0.05 * (f64::from(k * 37 % 11) / 5.0 - 1.0);
                // One in 25 steps on a stage.
                let wild = if i % 25 == 24 { -1.0 } else { 0.0 };
                let (x, z) = (f64::from(k % 7) - 3.0, 3.0 + 0.5 * f64::from(k % 9));
                estimate.add(id, ankle(share, x, z, off + wild));
            }
            estimate.update();
        }
        estimate
    }

    #[test]
    fn feet_tell_a_tilted_floor() {
        for people in [&[(1, 1.0)][..], &[(1, 1.0), (2, 0.7), (3, 1.05)]] {
            let estimate = walked(people, 300);
            let floor = estimate.floor().unwrap();
            assert!(floor.ground.normal.dot(truth().normal) > 0.999, "{floor:?}");
            assert!(
                (floor.ground.offset - truth().offset).abs() < 0.1,
                "{floor:?}"
            );
        }
    }

    #[test]
    fn the_foot_that_stands_tells_the_floor_below_a_steep_camera() {
        for pitch in [20f64, 45.0] {
            let (sin, cos) = pitch.to_radians().sin_cos();
            let truth = FloorPlane {
                normal: DVec3::new(0.0, -cos, -sin),
                offset: 3.0,
            };
            // Of an ankle (x, z) beyond the point below the camera and above the sole's height on the floor, metres.
            let along = DVec3::new(0.0, -sin, cos);
            let ankle = |x: f64, z: f64, above: f64| {
                let height = above + ANKLE_HEIGHT - truth.offset;
                DVec3::X * x + along * z + truth.normal * height
            };
            let mut estimate = FloorEstimate::default();
            for i in 0..1000u32 {
                // Round a circle; one foot stands, the other one swings past it.
                let (turn, swing) = (0.23 * f64::from(i), (0.377 * f64::from(i)).fract());
                let side = if i % 2 == 0 { 0.1 } else { -0.1 };
                let ahead = -0.6 * (std::f64::consts::PI * swing).cos();
                let above = 0.12 * (std::f64::consts::PI * swing).sin();
                let at = |beside: f64, ahead: f64, above: f64| {
                    let out = 1.2 + beside;
                    let x = out * turn.cos() - ahead * turn.sin();
                    let z = out * turn.sin() + ahead * turn.cos();
                    ankle(x, truth.offset * cos / sin + z, above)
                };
                let feet = [at(side, 0.0, 0.0), at(-side, ahead, above)];
                let lower = lower(feet.into_iter(), estimate.down()).unwrap();
                estimate.add(1, lower);
                estimate.update();
            }
            let ground = estimate.floor().expect("a floor").ground;
            let tilt = ground.normal.angle_between(truth.normal).to_degrees();
            let height = (ground.offset - truth.offset).abs();
            assert!(
                tilt < 0.25 && height < 0.05,
                "{pitch}°: {tilt}°, {height} m"
            );
        }
    }

    #[test]
    fn errors_along_the_view_do_not_make_the_floor_more_level() {
        let mut estimate = FloorEstimate::default();
        for i in 0..3000u32 {
            for id in 1..=3u32 {
                // Here and there, and taken for nearer or farther than they are, by 3 %.
                let k = i + 17 * id;
                let random = f64::from(k.wrapping_mul(2_654_435_761) >> 16) / 65536.0 - 0.5;
                let (x, z) = (f64::from(k % 7) - 3.0, 4.0 + 0.1 * f64::from(k % 9));
                let foot = ankle(1.0, x, z, 0.0) + ANKLE_HEIGHT * DVec3::Y;
                let ankle = foot * (1.0 + 0.104 * random) - ANKLE_HEIGHT * DVec3::Y;
                estimate.add(id, ankle);
            }
            estimate.update();
        }
        let ground = estimate.floor().expect("a floor").ground;
        let pitch = |normal: DVec3| (-normal.z).asin().to_degrees();
        let (found, is) = (pitch(ground.normal), pitch(truth().normal));
        assert!((found - is).abs() < 1.0, "{found}°, {is}° in truth");
    }

    #[test]
    fn a_child_in_front_of_an_adult_does_not_tilt_the_floor() {
        for (near, far) in [(0.7, 1.0), (1.0, 0.7), (1.05, 0.95)] {
            let mut estimate = FloorEstimate::default();
            for i in 0..600u32 {
                let along = 0.25 * f64::from(i % 7);
                let across = f64::from(i % 5) - 2.0;
                estimate.add(1, ankle(near, across, 3.0 + along, 0.0));
                estimate.add(2, ankle(far, -across, 4.0 + along, 0.0));
                estimate.update();
            }
            let (tilt, height) = off(&estimate);
            assert!(
                tilt < 1.5 && height < 0.25,
                "{near} before {far}: {tilt}°, {height} m"
            );
        }
    }

    #[test]
    fn a_camera_that_was_tilted_finds_its_new_floor_and_none_that_is_far_steeper() {
        for degrees in [-8.0f64, 8.0] {
            let mut estimate = walked(&[(1, 1.0), (2, 1.05)], 300);
            let tilted = FloorPlane {
                normal: DQuat::from_rotation_x(-degrees.to_radians()) * truth().normal,
                offset: truth().offset,
            };
            let mut steepest = 0.0f64;
            for i in 0..3000u32 {
                let (x, z) = (f64::from(i % 7) - 3.0, 3.0 + 0.5 * f64::from(i % 9));
                estimate.add(1 + i % 2, ankle_on(tilted, 1.0, x, z, 0.0));
                estimate.update();
                if let Some(floor) = estimate.floor() {
                    steepest = steepest.max((-floor.ground.normal.z).asin().to_degrees());
                }
            }
            let ground = estimate.floor().expect("a floor").ground;
            let tilt = ground.normal.angle_between(tilted.normal).to_degrees();
            assert!(
                tilt < 1.0 && steepest < 20.0 + degrees.max(0.0) + 6.0,
                "{degrees}°: {tilt}° off, {steepest}° at most"
            );
        }
    }

    #[test]
    fn one_spot_is_no_floor() {
        let mut estimate = FloorEstimate::default();
        for _ in 0..500 {
            estimate.add(1, DVec3::new(0.0, 1.4, 4.0));
        }
        estimate.update();
        assert!(estimate.floor().is_none());
    }

    /// How far, degrees and metres, the floor is off.
    fn off(estimate: &FloorEstimate) -> (f64, f64) {
        let ground = estimate.floor().expect("a floor").ground;
        let tilt = ground.normal.angle_between(truth().normal).to_degrees();
        (tilt, (ground.offset - truth().offset).abs())
    }

    #[test]
    fn whoever_rests_their_feet_in_one_place_for_long_does_not_tilt_the_floor() {
        // Taken for the floor, beyond what it bears, and on the floor with an error that lasts.
        for (above, nearer) in [(0.3, 1.0), (0.6, 1.0), (0.9, 1.0), (0.0, 0.95)] {
            let mut estimate = walked(&[(1, 1.0)], 2000);
            let rest = |x, z| nearer * ankle(1.0, x, z, -above);
            let places = [rest(-0.9, 4.6), rest(-0.5, 4.7)];
            for _ in 0..4000 {
                for place in places {
                    estimate.add(1, place);
                }
                estimate.update();
                let (tilt, height) = off(&estimate);
                assert!(
                    tilt < 1.0 && height < 0.1,
                    "{above} m: {tilt}°, {height} m off"
                );
            }
            for i in 0..300u32 {
                let (x, z) = (f64::from(i % 7) - 3.0, 3.0 + 0.5 * f64::from(i % 9));
                estimate.add(1, ankle(1.0, x, z, 0.0));
                estimate.update();
                let (tilt, height) = off(&estimate);
                assert!(
                    tilt < 1.0 && height < 0.1,
                    "{above} m: {tilt}°, {height} m off"
                );
            }
        }
    }

    #[test]
    fn a_floor_that_is_lost_leaves_no_feet_to_the_next() {
        let mut estimate = walked(&[(1, 1.0)], 50);
        // The camera now looks straight ahead at half the height.
        let moved = FloorPlane {
            normal: DVec3::NEG_Y,
            offset: 0.9,
        };
        let mut lost = None;
        for i in 0..1000u32 {
            let (x, z) = (f64::from(i % 7) - 3.0, 3.0 + 0.5 * f64::from(i % 9));
            estimate.add(1, ankle_on(moved, 1.0, x, z, 0.0));
            if estimate.standers.is_empty() {
                lost = lost.or(Some(i));
            }
            estimate.update();
        }
        assert!(lost.is_some_and(|i| i < 300), "{lost:?}");
        let ground = estimate.floor().unwrap().ground;
        assert!(ground.normal.dot(moved.normal) > 0.9999, "{ground:?}");
    }

    #[test]
    fn statures_beside_each_other() {
        for people in [
            &[(1, 1.0), (2, 0.7)][..],
            &[(1, 0.93), (2, 1.07)],
            &[(1, 1.06), (2, 1.0), (3, 0.94), (4, 0.65), (5, 0.8)],
        ] {
            let estimate = walked(people, 200);
            let floor = estimate.floor().unwrap();
            for &(id, share) in people {
                let found = floor.stature(id).unwrap();
                assert!((found / share - 1.0).abs() < 0.05, "{share}: {found}");
            }
        }
    }

    #[test]
    fn whoever_stands_alone_is_as_tall_as_assumed() {
        let floor = walked(&[(1, 0.8)], 200);
        assert_eq!(floor.floor().unwrap().stature(1), None);
    }

    #[test]
    fn nobody_is_a_giant() {
        // Feet on a stage, 60 cm up.
        let floor = walked(&[(1, 1.0), (2, 1.03), (3, 1.4)], 200);
        let floor = floor.floor().unwrap();
        assert!((floor.stature(3).unwrap() - 1.0).abs() < 0.05, "{floor:?}");
        assert!((floor.stature(1).unwrap() - 1.0).abs() < 0.05, "{floor:?}");
    }

    #[test]
    fn a_camera_that_was_moved_finds_its_new_floor() {
        let mut estimate = walked(&[(1, 1.0), (2, 1.05)], 1000);
        let moved = FloorPlane {
            normal: DVec3::NEG_Y,
            offset: 0.9,
        };
        for i in 0..3000u32 {
            let (x, z) = (f64::from(i % 7) - 3.0, 3.0 + 0.5 * f64::from(i % 9));
            estimate.add(1 + i % 2, ankle_on(moved, 1.0, x, z, 0.0));
            estimate.update();
        }
        let floor = estimate.floor().unwrap();
        assert!(floor.ground.normal.dot(moved.normal) > 0.999, "{floor:?}");
        assert!((floor.ground.offset - 0.9).abs() < 0.1, "{floor:?}");
    }

    #[test]
    fn memory_is_bounded_and_fades() {
        let mut estimate = walked(&[(1, 1.0), (2, 0.8)], 200);
        assert!(estimate.floor().unwrap().stature(2).is_some());
        for id in 3..3000 {
            estimate.add(id, ankle(1.0, 0.1, 3.0 + 0.001 * f64::from(id), 0.0));
        }
        estimate.update();
        assert!(estimate.standers.len() <= PEOPLE);
        assert_eq!(estimate.floor().and_then(|f| f.stature(2)), None);
        let mut estimate = walked(&[(1, 1.0), (2, 0.8)], 200);
        for i in 0..20_000 {
            estimate.add(1, ankle(1.0, 0.1, 3.0 + f64::from(i % 5), 0.0));
        }
        estimate.update();
        assert!(estimate.count() < MEMORY + 2.0);
        assert_eq!(estimate.floor().and_then(|f| f.stature(2)), None);
    }
}
