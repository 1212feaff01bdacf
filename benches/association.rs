//! Association of 1, 5, 10 and 20 people in perfect 512 × 320 maps; checks that all are found before it times.

#[path = "../tests/stages/detect_maps/mod.rs"]
mod detect_maps;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use edgecap::detect::{AssociationConfig, Associator};
use std::hint::black_box;

fn association(c: &mut Criterion) {
    let mut group = c.benchmark_group("association");
    for count in [1, 5, 10, 20] {
        let people = (0..)
            .map(|seed| detect_maps::crowd(count, seed))
            .find(|p| p.len() == count)
            .expect("some seed fits everyone");
        let maps = detect_maps::render(&people);
        let mut associator = Associator::new(AssociationConfig::default());
        assert_eq!(associator.associate(&maps).len(), count);
        group.bench_with_input(BenchmarkId::from_parameter(count), &maps, |b, maps| {
            b.iter(|| associator.associate(black_box(maps)).len());
        });
    }
    group.finish();
}

criterion_group!(benches, association);
criterion_main!(benches);
