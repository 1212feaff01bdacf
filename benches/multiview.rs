//! Time of the live fit to several cameras: what one instant of four views and six people costs on one core.

use criterion::{Criterion, criterion_group, criterion_main};
use edgecap::fit::FitConfig;
use edgecap::message::BodyFrame;
use edgecap::multiview::live::{FrameSet, LiveFit};
use rand::SeedableRng;
use rand::rngs::SmallRng;

#[path = "../tests/fit/scene/mod.rs"]
mod scene;

use scene::people::{Activity, Person, walk};
use scene::ring::{Spoil, observe, views};

fn live(c: &mut Criterion) {
    let people: Vec<Person> = (0..6u64)
        .map(|i| {
            let (x, z) = (1.2 * (i % 3) as f64 - 1.2, 3.4 + 1.6 * (i / 3) as f64);
            let legs = walk(0.0, 1.0, &[(x, z), (x + 0.4, z + 0.3), (x, z)]);
            let activities = [Activity::Wave, Activity::Squat, Activity::Reach];
            Person::new(40 + i, legs, activities[i as usize % 3])
        })
        .collect();
    let spoil = Spoil {
        pixels: 4.0,
        space: 0.05,
        unseen: 0.08,
        outliers: 0.03,
        ..Spoil::default()
    };
    let views = views(4);
    let mut rng = SmallRng::seed_from_u64(1);
    let mut sets: Vec<FrameSet> = (0..300)
        .map(|k| {
            let t = k as f64 / 30.0;
            let each = views.iter().map(|view| {
                let frame = observe(view, &people, t, spoil, &mut rng);
                Some(frame.people().to_vec())
            });
            FrameSet {
                capture_ns: 1_000_000_000 + k * 33_333_333,
                file_time: false,
                stage_times: Default::default(),
                views: each.collect(),
            }
        })
        .collect();
    let mut fit = LiveFit::new(views, FitConfig::default()).expect("defaults are valid");
    let mut out = Box::new(BodyFrame::default());
    for set in &sets {
        fit.update(set, &mut out);
    }
    assert_eq!(out.count, 6, "everybody has an identity");
    let (mut next, mut now) = (0, out.capture_ns);
    c.bench_function("multiview/live, four views, six people", |b| {
        b.iter(|| {
            // There and back again, so that people never jump.
            let k = if next < 300 { 299 - next } else { next - 300 };
            next = (next + 1) % 600;
            now += 33_333_333;
            sets[k].capture_ns = now;
            fit.update(&sets[k], &mut out);
        });
    });
    assert_eq!(out.count, 6, "everybody kept an identity");
}

criterion_group!(benches, live);
criterion_main!(benches);
