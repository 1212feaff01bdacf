//! Stage II for 1, 5, 10 and 20 people on one core, with and without the torso's colours.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use edgecap::capture::{Frame, Letterbox};
use edgecap::detect::Detection;
use edgecap::engine::{HEAD3D_CHANNELS, Model};
use edgecap::joints::{EVIDENCE_JOINTS, LIMBS};
use edgecap::lift::{Encodings, Lifter};
use edgecap::message::{Intrinsics, Observation};
use edgecap_kernels::Isa;
use std::hint::black_box;

/// Somebody all of whose torso is in the picture.
fn person(index: usize) -> Detection {
    let left = 20.0 * index as f32;
    let at = |j: usize| [left + 7.0 * j as f32, 20.0 * j as f32, 0.8];
    Detection {
        joints: std::array::from_fn(at),
        confidence: [0.8; EVIDENCE_JOINTS],
        encodings: [[0.1; HEAD3D_CHANNELS]; EVIDENCE_JOINTS],
        limbs: [0.8; LIMBS],
        score: 0.8,
    }
}

fn lift(c: &mut Criterion) {
    let isa = Isa::detect().expect("EDGECAP_ISA names a tier of this CPU");
    let model = Model::shipped().expect("a build with weights");
    let stage2 = model.stage2().expect("the shipped model has Stage II");
    let mut lifter = Lifter::new(&stage2.layers, Encodings::Read, isa).expect("layers that fit");
    let letterbox = Letterbox {
        scale: 1.0,
        offset_u: 0.0,
        offset_v: 0.0,
    };
    let frame = Frame {
        width: 512,
        height: 320,
        rgb: (0..512 * 320 * 3).map(|i| (i % 251) as u8).collect(),
        ..Default::default()
    };
    let camera = Intrinsics::from_horizontal_fov(512, 320, 60.0);
    let mut group = c.benchmark_group("stage2");
    for count in [1, 5, 10, 20] {
        let people: Vec<_> = (0..count).map(person).collect();
        let finite = |p: [[f32; 3]; 21]| p.as_flattened().iter().all(|v| v.is_finite());
        assert!(
            lifter
                .lift_aligned(&people)
                .is_ok_and(|mut p| p.all(finite))
        );
        let seen = lifter.lift(&people, &frame, &letterbox, &camera);
        let is_coloured = |o: &Observation| (o.hue.iter().sum::<f32>() - 1.0).abs() < 1e-3;
        assert!(seen.is_ok_and(|seen| seen.iter().all(is_coloured)));
        group.bench_with_input(BenchmarkId::new("network", count), &people, |b, p| {
            b.iter(|| lifter.lift_aligned(black_box(p)).map(|p| p.len()));
        });
        group.bench_with_input(BenchmarkId::new("whole", count), &people, |b, p| {
            b.iter(|| {
                let seen = lifter.lift(black_box(p), &frame, &letterbox, &camera);
                seen.map(|o| o.len())
            });
        });
    }
    group.finish();
}

criterion_group!(benches, lift);
criterion_main!(benches);
