//! `fit --rate`: bodies between camera frames. Observations come at a camera's pace from a synthetic scene.

use std::time::{Duration, Instant};

use crate::program::{Running, eventually, stream};
use crate::scene::people::{self, Activity, Person};
use crate::scene::{Noise, Scene};
use edgecap::camera::monotonic_ns;
use edgecap::message::{BodyFrame, FLAG_END_OF_STREAM, ObservationFrame};
use edgecap_client::{Publisher, Subscriber};

/// Camera frames a second.
const FPS: f64 = 15.0;
/// `prediction.max`: bodies are never given for later than this after the newest frame.
const MOST_AHEAD: u64 = 100_000_000;

fn drain(bodies: &Subscriber<BodyFrame>, until: Instant, into: &mut Vec<BodyFrame>) {
    loop {
        let left = until.saturating_duration_since(Instant::now());
        match bodies.next(left).unwrap() {
            Some(frame) => into.push(*frame),
            None if left.is_zero() => return,
            None => {}
        }
    }
}

#[test]
fn bodies_come_between_frames_and_not_from_far_ahead() {
    let name = stream("rate");
    let mut observations = Publisher::<ObservationFrame>::open(&name).unwrap();
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    let run = Running::start(&["fit", "--name", &name, "--rate", "60"]);
    eventually("fit", || {
        (observations.subscriber_count() > 0 && bodies.publisher_count() > 0).then_some(())
    });

    let legs = people::walk(0.0, 1.2, &[(-1.6, 4.0), (1.6, 4.0), (-1.6, 4.0)]);
    let cast = vec![Person::new(2, legs, Activity::Stand).of_height(1.70)];
    let mut scene = Scene::new(cast, Noise::NONE, FPS, 3);
    let mut got = Vec::new();
    let (start, start_ns) = (Instant::now(), monotonic_ns());
    for k in 0..45u32 {
        let (mut frame, _) = scene.next();
        // As a camera's clock has it, however late this test is.
        frame.capture_ns = start_ns + u64::from(k) * 1_000_000_000 / FPS as u64;
        observations.publish(&frame).unwrap();
        drain(
            &bodies,
            start + (k + 1) * Duration::from_secs(1) / FPS as u32,
            &mut got,
        );
    }
    // The camera stops: messages go on, the bodies do not run away.
    let mut silent = Vec::new();
    drain(
        &bodies,
        Instant::now() + Duration::from_millis(2000),
        &mut silent,
    );
    // On a busy machine the last frame's bodies come late.
    let newest = silent.last().expect("bodies").sequence;
    let end = ObservationFrame {
        flags: FLAG_END_OF_STREAM,
        capture_ns: monotonic_ns(),
        ..ObservationFrame::default()
    };
    observations.publish(&end).unwrap();
    let last = eventually("the end", || {
        bodies
            .next(Duration::from_millis(50))
            .unwrap()
            .filter(|b| b.flags & FLAG_END_OF_STREAM != 0)
            .map(|b| *b)
    });
    drop(bodies);
    assert!(run.wait(Duration::from_secs(20)).status.success());
    assert_eq!(last.sequence, newest);

    for pair in got.windows(2) {
        let [a, b] = pair else { unreachable!() };
        assert!(b.pose_ns >= a.pose_ns, "never back in time");
        if let ([x], [y]) = (a.bodies(), b.bodies()) {
            // A walk of 1.2 m/s between the messages, and what a new frame corrects.
            let seconds = (b.pose_ns - a.pose_ns) as f32 * 1e-9;
            let step = (y.position[0] - x.position[0]).abs();
            assert!(step < 2.0 * seconds + 0.12, "{step} m in {seconds} s");
        }
    }
    for b in got.iter().chain(&silent) {
        assert!(b.pose_ns >= b.capture_ns && b.pose_ns - b.capture_ns <= MOST_AHEAD);
        assert!(b.publish_ns > b.capture_ns, "latency is filled in");
        assert!(b.fit_us > 0, "so is the time of the fit");
        assert_eq!((b.width, b.intrinsics), (crate::scene::WIDTH, scene.camera));
    }
    let between = got
        .windows(2)
        .filter(|w| w[0].sequence == w[1].sequence && w[1].pose_ns > w[0].pose_ns)
        .count();
    assert!(between > 0, "none of {} messages between frames", got.len());
    assert!(!silent.is_empty(), "predictions go on a while");
    let held = silent.last().unwrap();
    assert_eq!(held.pose_ns, held.capture_ns + MOST_AHEAD);
    let now = held.bodies()[0].position;
    let before = silent[silent.len() - 2].bodies()[0].position;
    assert_eq!(now, before, "at the bound everybody stands still");
}
