//! The statistics of observation errors, against observations made with known ones.

use crate::scene::{Noise, Scene, Truth, people};
use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use edgecap::lab::eval::{NoiseMeter, Spread};
use edgecap::lab::synth::truth::{OCCLUDED, TruthCamera, TruthFrame, TruthPerson, VISIBLE};

fn person(truth: &Truth, scene: &Scene) -> TruthPerson {
    let joints3d = truth.joints.map(|p| p.as_vec3().to_array());
    let visible = |j: usize| j >= EVIDENCE_JOINTS || truth.visible[j];
    TruthPerson {
        id: 1 + truth.person as u32,
        stature: truth.height as f32,
        joints3d,
        joints2d: joints3d.map(|p| scene.camera.project(p)),
        visibility: std::array::from_fn::<u8, BODY_JOINTS, _>(|j| {
            if visible(j) { VISIBLE } else { OCCLUDED }
        }),
        bounds: None,
        pixels: 1.0,
    }
}

fn measure(noise: Noise) -> edgecap::lab::eval::Noise {
    // Everybody stands apart, in full view.
    let mut scene = Scene::new(people::everyday(), noise, 30.0, 7);
    let mut meter = NoiseMeter::default();
    for k in 0..1800 {
        let (frame, truths) = scene.next();
        let c = scene.camera;
        let truth = TruthFrame {
            frame: k,
            time_ns: frame.capture_ns,
            file: None,
            camera: TruthCamera {
                fx: c.fx,
                fy: c.fy,
                cx: c.cx,
                cy: c.cy,
                floor: [0.0; 4],
            },
            people: truths.iter().map(|t| person(t, &scene)).collect(),
        };
        meter.add(&frame, &truth);
    }
    meter.finish(30.0).expect("people are found")
}

fn near(what: &str, found: f64, expected: f64, tolerance: f64) {
    println!("{what}: {found:.4}, made with {expected:.4}");
    assert!(
        (found - expected).abs() <= tolerance * expected,
        "{what}: {found}, made with {expected}"
    );
}

fn parts(what: &str, found: Spread, slow: f64, white: f64, time: f64) {
    near(&format!("{what} slow"), found.slow, slow, 0.1);
    near(&format!("{what} white"), found.white, white, 0.1);
    near(&format!("{what} time"), found.time, time, 0.25);
}

/// In both profiles every part stands out from what the others leak into it: white noise far below the slow part is the
/// small difference of large numbers (2 cm beside 5 cm were read as 2.4 cm), and exchanged sides look like 0.2 % of
/// far-off joints.
#[test]
fn errors_are_measured_as_they_were_made() {
    for made in [
        Noise::REAL,
        Noise {
            slow2d: 0.02,
            white2d: 0.04,
            time2d: 0.8,
            slow3d: 0.05,
            white3d: 0.04,
            time3d: 0.2,
            hidden3d: 1.5,
            miss: 0.1,
            burst: 0.01,
            lost: 0.06,
            outlier: 0.02,
            hidden: 0.01,
            swap: 0.05,
            phantom: 0.2,
        },
    ] {
        let n = measure(made);
        parts("2D", n.plane, made.slow2d, made.white2d, made.time2d);
        parts("3D", n.space, made.slow3d, made.white3d, made.time3d);
        near(
            "hidden 3D",
            n.space_mean[1] / n.space_mean[0],
            made.hidden3d,
            0.1,
        );
        near("miss", n.miss, made.miss, 0.15);
        near("burst", n.burst, made.burst, 0.35);
        near("lost", n.lost, made.lost, 0.15);
        near("outlier", n.outlier, made.outlier, 0.25);
        // Gaps are cut and joined by everything else: right within a factor of two.
        let hidden = n.hidden / made.hidden;
        assert!((0.5..=2.0).contains(&hidden), "hidden: {hidden} times");
        near("swap", n.swap, made.swap, 0.5);
        near("phantom", n.phantom, made.phantom, 0.3);
        assert!(n.absent < 0.02);
    }
}
