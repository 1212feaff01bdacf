//! A camera that was turned after its calibration: by what that is noticed.

use edgecap::body::mesh::MeshBody;
use edgecap::lab::multiview::own::own;
use edgecap::lab::synth::detector::Flaws;
use edgecap::multiview::{MultiviewOptions, report};
use glam::DMat3;
use rayon::prelude::*;

/// Frames of everybody.
const FRAMES: usize = 30;

/// Weight of the turned view, and medians of distances in it and in the other views (mean of theirs), % of the height;
/// mean distance of joints from the truth, mm.
fn noticed(seed: u64, views: usize, degrees: f64) -> [f64; 4] {
    let mut trial = own(seed, views, FRAMES, Flaws::MEASURED);
    let turn = DMat3::from_rotation_y(degrees.to_radians());
    trial.views[1].rotation = turn * trial.views[1].rotation;
    let options = MultiviewOptions {
        rate: trial.rate,
        paths: true,
        hierarchy: true,
    };
    let found = trial.fit(options, None, &|_| ());
    let told = report(
        MeshBody::shipped(),
        &trial.views,
        &found,
        FRAMES,
        trial.rate,
        &|_, _, all| vec![None; all.len()],
    );
    let median = |v: usize| told.views[v].median_percent.unwrap_or(f64::NAN);
    let others = (0..views).filter(|v| *v != 1).map(median).sum::<f64>() / (views - 1) as f64;
    let joints = 1e3 * trial.errors(&found).joints;
    [told.views[1].weight, median(1), others, joints]
}

#[test]
fn a_view_that_was_turned_by_three_degrees_counts_less() {
    for seed in [1, 2] {
        assert_eq!(noticed(seed, 4, 0.0)[0], 1.0, "seed {seed}, not turned");
        let [weight, own, others, _] = noticed(seed, 4, 3.0);
        assert!(weight < 0.5, "seed {seed}: weight {weight}");
        assert!(own > 3.0 * others, "seed {seed}: {own} and {others} %");
    }
}

#[test]
#[ignore = "prints a table; minutes"]
fn turned_views() {
    for views in [3, 4] {
        for degrees in [0.0, 1.0, 2.0, 3.0, 5.0] {
            let seeds = 1..=5_u64;
            let each: Vec<[f64; 4]> = seeds
                .into_par_iter()
                .map(|seed| noticed(seed, views, degrees))
                .collect();
            let mean = |k: usize| each.iter().map(|e| e[k]).sum::<f64>() / each.len() as f64;
            let less = each.iter().filter(|e| e[0] < 1.0).count();
            println!(
                "{views} views, {degrees} degrees: counts less {less} of {} (weight {:.2}), {:.2} % of the height, \
                 others {:.2} %, joints {:.1} mm",
                each.len(),
                mean(0),
                mean(1),
                mean(2),
                mean(3)
            );
        }
    }
}
