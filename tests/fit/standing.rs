//! Standing feet hold a body across the camera's rays, and hardly along them.

use edgecap::body::skeleton::Skeleton;
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::PELVIS;
use edgecap::message::BodyFrame;

use crate::scene::people::{self, Activity, Person};
use crate::scene::{Noise, Scene};

const FPS: f64 = 30.0;
/// About 4 pixels five metres away, and 3 cm in Stage II.
const NOISE: Noise = Noise {
    white2d: 0.02,
    white3d: 0.03,
    ..Noise::NONE
};

/// Error of the root's depth, as a share of it, two seconds after somebody of 1.70 m has stopped.
fn depth_error_after_a_walk(from: f64, to: f64, seed: u64) -> f64 {
    let way = people::walk(1.0, 1.2, &[(0.2, from), (0.2, to)]);
    let until = way[0].end + 2.0;
    let mut person = Person::new(3, way, Activity::Stand).of_height(1.70);
    person.lengths = *Skeleton::builtin().lengths();
    let mut scene = Scene::new(vec![person], NOISE, FPS, seed);
    let config = FitConfig {
        height: Some(1.70),
        ..FitConfig::default()
    };
    let mut fitter = Fitter::new(config).unwrap();
    let mut out = BodyFrame::default();
    let mut error = f64::NAN;
    for _ in 0..(until * FPS) as usize {
        let (frame, truths) = scene.next();
        fitter.update(&frame, &mut out);
        let body = &out.bodies()[0];
        error = f64::from(body.position[2]) / truths[0].joints[PELVIS].z - 1.0;
    }
    error
}

#[test]
fn whoever_walked_along_the_view_stands_where_they_stopped() {
    for (from, to) in [(3.0, 8.0), (8.0, 4.0)] {
        for seed in 1..=3 {
            let error = depth_error_after_a_walk(from, to, seed);
            println!("{from} m to {to} m, seed {seed}: {:.1} %", 100.0 * error);
            assert!(
                error.abs() < 0.02,
                "{from} m to {to} m, seed {seed}: depth off by {:.1} %",
                100.0 * error
            );
        }
    }
}
