//! Bodies predicted ahead of the last frame.

use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::PELVIS;
use edgecap::message::BodyFrame;

use super::FPS;
use crate::scene::people;
use crate::scene::{Noise, Scene};

#[test]
fn prediction_is_bounded_and_changes_nothing() {
    let mut scene = Scene::new(people::crossing(), Noise::NONE, FPS, 3);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let (mut now, mut ahead, mut later) = Default::default();
    for _ in 0..45 {
        fitter.update(&scene.next().0, &mut now);
    }
    fitter.predict(now.capture_ns, &mut ahead);
    assert!(ahead == now, "no time ahead is the frame itself");
    fitter.predict(now.capture_ns + 16_000_000, &mut ahead);
    assert_eq!(ahead.pose_ns, now.capture_ns + 16_000_000);
    let walker = now
        .bodies()
        .iter()
        .position(|b| b.velocity[0].abs() > 0.5)
        .expect("somebody walks");
    let step = ahead.bodies[walker].position[0] - now.bodies[walker].position[0];
    let expected = now.bodies[walker].velocity[0] * 0.016;
    assert!(
        (step - expected).abs() < 0.2 * expected.abs(),
        "{step} instead of {expected}"
    );
    fitter.predict(now.capture_ns + 100_000_000, &mut later);
    fitter.predict(now.capture_ns + 60_000_000_000, &mut ahead);
    assert!(ahead == later, "not farther than the bound");
    assert_eq!(ahead.pose_ns, now.capture_ns + 100_000_000);
    fitter.predict(0, &mut ahead);
    assert!(ahead == now, "never back in time");
}

#[test]
fn half_the_frame_rate_ahead_is_nearer_than_standing_still() {
    let mut scene = Scene::new(people::crossing(), Noise::NONE, FPS, 3);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let (mut now, mut ahead) = (BodyFrame::default(), BodyFrame::default());
    let (mut predicted, mut held) = (0.0, 0.0);
    for f in 0..120 {
        fitter.update(&scene.next().0, &mut now);
        fitter.predict(now.capture_ns + 33_333_333, &mut ahead);
        let truths = scene.truths(scene.time(f + 1));
        let matches = crate::scene::measure::match_bodies(&truths, &now, &Default::default());
        for (truth, b) in truths.iter().zip(matches) {
            let Some(b) = b else { continue };
            let grow = truth.height / f64::from(now.bodies[b].height);
            let x = truth.joints[PELVIS].x;
            predicted += (f64::from(ahead.bodies[b].position[0]) * grow - x).abs();
            held += (f64::from(now.bodies[b].position[0]) * grow - x).abs();
        }
    }
    assert!(predicted < 0.8 * held, "{predicted} {held}");
}
