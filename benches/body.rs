//! The mesh body: what posing and skinning one person costs.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use edgecap::body::BodyModel;
use edgecap::body::mesh::{MeshBody, PosedTree, Skin};

fn body(c: &mut Criterion) {
    let body = MeshBody::shipped();
    let person = body.person(&[0.5, -1.0, 0.3]);
    let pose = body.rest_pose();
    let mut tree = PosedTree::default();
    let mut skin = Skin::new(body, &person);
    let mut out = Vec::new();
    c.bench_function("mesh body: kinematics", |b| {
        b.iter(|| body.kinematics(black_box(&pose), &person, &mut tree));
    });
    c.bench_function("mesh body: skinning", |b| {
        b.iter(|| skin.pose(body, black_box(&pose), &tree, &mut out));
    });
    c.bench_function("mesh body: a person's shape", |b| {
        b.iter(|| Skin::new(body, black_box(&body.person(&[0.5; 10]))));
    });
}

criterion_group!(benches, body);
criterion_main!(benches);
