//! Two cameras of which one hardly ever sees the person: frames of the other alone tell neither size nor distance.

use edgecap::lab::multiview::own::{own, steady};
use edgecap::multiview::{MultiviewOptions, evidence_joints};

/// Of five frames so many are seen by both.
const BOTH: usize = 2;

/// Mean distance of joints from the truth in frames of one camera, metres; the shape's errors with all frames of both
/// cameras and with some, metres; how much views counted.
fn errors(paths: bool) -> (f64, [f64; 2], Vec<f64>) {
    let whole = own(2, 2, 60, steady(2));
    let mut part = whole.clone();
    for (k, views) in part.seen.iter_mut().enumerate() {
        if k % 5 >= BOTH {
            views[1].clear();
        }
    }
    let options = MultiviewOptions {
        rate: whole.rate,
        paths,
        hierarchy: true,
    };
    let [all, some] = [&whole, &part].map(|trial| trial.fit(options, None, &|_| ()));
    let shapes = [&all, &some].map(|found| whole.errors(found).shape.expect("of the same model"));
    let [person] = &some.people[..] else {
        panic!("one person, found {}", some.people.len())
    };
    assert_eq!(person.frames.len(), 60);
    let alone = person.frames.iter().filter(|f| f.frame % 5 >= BOTH);
    let off = alone.map(|f| {
        let own = evidence_joints(&f.body.posed);
        let apart = own.iter().zip(&part.joints[f.frame]);
        apart.map(|(a, b)| a.distance(*b)).sum::<f64>() / own.len() as f64
    });
    let off: Vec<f64> = off.collect();
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    println!(
        "paths {paths}: {mean:.3} m, shapes {shapes:.4?} m, weights {:?}",
        some.weights
    );
    (mean, shapes, some.weights)
}

#[test]
fn frames_of_one_camera_go_along_with_those_of_both() {
    for paths in [false, true] {
        let (joints, shapes, weights) = errors(paths);
        assert_eq!(weights, [1.0, 1.0]);
        // The shape is that of frames which tell it, not the mean body's.
        assert!(shapes[1] < shapes[0] + 0.004, "{shapes:?}");
        assert!(joints < 0.15, "{joints} m");
    }
}
