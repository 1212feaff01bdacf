//! Time of Stage III: a whole frame of ten people, and its parts. Every run first checks that what it measures is
//! right.

use criterion::{Criterion, criterion_group, criterion_main};
use edgecap::fit::{FitConfig, Fitter};
use edgecap::message::{BodyFrame, ObservationFrame};

#[path = "../tests/fit/scene/mod.rs"]
mod scene;

use scene::{Noise, Scene, people};

fn recorded(people: Vec<people::Person>, frames: usize) -> Vec<ObservationFrame> {
    let noise = Noise {
        miss: 0.0,
        burst: 0.0,
        phantom: 0.0,
        ..Noise::REAL
    };
    let mut scene = Scene::new(people, noise, 30.0, 3);
    (0..frames).map(|_| scene.next().0).collect()
}

fn update(c: &mut Criterion) {
    for (name, people, expected) in [("one person", 1, 1), ("ten people", 10, 10)] {
        let mut cast = scene::people::ten();
        cast.truncate(people);
        let frames = recorded(cast, 300);
        let mut fitter = Fitter::new(FitConfig::default()).expect("defaults are valid");
        let mut out = Box::new(BodyFrame::default());
        for frame in &frames {
            fitter.update(frame, &mut out);
        }
        assert_eq!(out.count, expected, "everybody has an identity");
        let mut next = 0;
        let mut frame = Box::new(frames[0]);
        let mut now = frames[299].capture_ns;
        c.bench_function(&format!("fit/update, {name}"), |b| {
            b.iter(|| {
                // There and back again, so that people never jump.
                let k = if next < 300 { next } else { 599 - next };
                next = (next + 1) % 600;
                now += 33_333_333;
                *frame = frames[299 - k];
                frame.capture_ns = now;
                frame.sequence = now;
                fitter.update(&frame, &mut out);
            });
        });
        assert_eq!(out.count, expected, "everybody kept an identity");
        let mut ahead = 0;
        c.bench_function(&format!("fit/predict, {name}"), |b| {
            b.iter(|| {
                ahead = (ahead + 1) % 50;
                fitter.predict(now + ahead * 1_000_000, &mut out);
            });
        });
    }
}

criterion_group!(benches, update);
criterion_main!(benches);
