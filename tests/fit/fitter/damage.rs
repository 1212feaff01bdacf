//! Observations of numbers that make no sense.

use edgecap::fit::config::GroundConfig;
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use edgecap::message::BodyFrame;
use proptest::prelude::*;

use super::FPS;
use crate::scene::measure::{Report, is_finite};
use crate::scene::people;
use crate::scene::{Noise, Scene};

fn wild() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -2.0f32..2.0,
        4 => -1e4f32..1e4,
        1 => any::<f32>(),
        1 => Just(f32::NAN),
        1 => Just(f32::INFINITY),
        1 => Just(0.0f32),
        1 => Just(f32::MIN_POSITIVE),
        1 => Just(f32::MAX),
    ]
}

/// What is done to one frame of a sensible scene.
#[derive(Debug, Clone)]
struct Damage {
    values: Vec<(usize, usize, f32)>,
    camera: Option<[f32; 4]>,
    time: i64,
    sequence: i64,
    count: Option<u32>,
}

fn damage() -> impl Strategy<Value = Damage> {
    (
        prop::collection::vec((0usize..8, 0usize..165, wild()), 0..60),
        prop::option::weighted(0.2, [wild(), wild(), wild(), wild()]),
        prop_oneof![
            10 => Just(33_333_333i64),
            1 => Just(0i64),
            2 => -2_000_000_000i64..2_000_000_000,
            1 => any::<i64>()
        ],
        -3i64..5,
        prop::option::weighted(0.1, any::<u32>()),
    )
        .prop_map(|(values, camera, time, sequence, count)| Damage {
            values,
            camera,
            time,
            sequence,
            count,
        })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(40) })]
    #[test]
    fn no_input_yields_a_number_that_is_none(damages in prop::collection::vec(damage(), 1..40), known in any::<bool>()) {
        let mut scene = Scene::new(people::ten(), Noise::REAL, FPS, 3);
        let config = FitConfig {
            ground: known.then_some(GroundConfig { normal: [0.0, -1.0, 0.0], offset: 1.4 }),
            ..FitConfig::default()
        };
        let mut fitter = Fitter::new(config).unwrap();
        let (mut out, mut ahead) = (BodyFrame::default(), BodyFrame::default());
        let (mut time, mut sequence) = (10_000_000_000u64, 100u64);
        for d in &damages {
            let (mut frame, _) = scene.next();
            for &(p, k, v) in &d.values {
                let person = &mut frame.people[p];
                match k {
                    0..42 => person.joints2d[k / 3 % EVIDENCE_JOINTS][k % 3] = v,
                    42..105 => person.joints3d[(k - 42) / 3 % BODY_JOINTS][k % 3] = v,
                    105..135 => person.hue[k - 105] = v,
                    135..164 => person.saturation[k - 135] = v,
                    _ => person.score = v,
                }
            }
            if let Some([fx, fy, cx, cy]) = d.camera {
                frame.intrinsics = edgecap::message::Intrinsics { fx, fy, cx, cy };
            }
            time = time.saturating_add_signed(d.time);
            sequence = sequence.saturating_add_signed(d.sequence);
            frame.capture_ns = time;
            frame.sequence = sequence;
            if let Some(count) = d.count {
                frame.count = count;
            }
            fitter.update(&frame, &mut out);
            prop_assert!(is_finite(&out));
            fitter.predict(time.saturating_add(50_000_000), &mut ahead);
            prop_assert!(is_finite(&ahead));
            let mut r = Report::default();
            crate::scene::measure::limits(&out, &mut r);
            crate::scene::measure::limits(&ahead, &mut r);
            prop_assert!(r.beyond <= 5.0);
            prop_assert!(out.bodies().is_sorted_by(|a, b| a.id < b.id));
            for body in out.bodies() {
                prop_assert!(body.confidence.iter().all(|c| (0.0..=1.0).contains(c)));
                prop_assert!((0.3..3.0).contains(&body.height));
            }
        }
    }
}
