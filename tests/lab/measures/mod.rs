//! Measures against values worked out by hand: people and records to measure.

mod counted;
mod formats;
mod keypoints;
mod pckh;
mod poses;
mod refused;
mod tracks;

use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use edgecap::lab::eval::{EvalError, Format, Keypoint, TruthPerson, TruthSet};

type Joints2d = [[f32; 3]; EVIDENCE_JOINTS];

/// A person whose evidence joint j lies at (10 j, 5 j) and whose area is given.
fn person(area: f64) -> TruthPerson {
    let points = (0..EVIDENCE_JOINTS).map(|j| Keypoint::at(j, 10.0 * j as f64, 5.0 * j as f64, 2));
    TruthPerson {
        points: points.collect(),
        area,
        bbox: [0.0, 0.0, 130.0, 65.0],
        ..TruthPerson::default()
    }
}

fn exact() -> Joints2d {
    std::array::from_fn(|j| [10.0 * j as f32, 5.0 * j as f32, 1.0])
}

/// A body of which joint j lies at (j, 0, 0) decimetres, but for a few that lift it out of the line.
fn body() -> [[f64; 3]; BODY_JOINTS] {
    std::array::from_fn(|j| {
        let x = 0.1 * j as f64;
        [x, 0.3 * (x * 7.0).sin(), 0.4 * x * x]
    })
}

fn line(frame: u64, source: &str, people: &str) -> String {
    format!(
        r#"{{"frame":{frame},"time_ns":{},"source":"{source}","width":512,"height":320,"people":[{people}]}}"#,
        frame * 40_000_000
    )
}

fn observation(score: f64, joints: &Joints2d) -> String {
    let solid: Vec<[f64; 3]> = body().to_vec();
    serde_json::json!({"score": score, "joints2d": joints, "joints3d": solid}).to_string()
}

/// Truth of one person in a picture of 512×320, made by `change` from one who stands in it, and a box round him.
fn synthetic(change: impl Fn(&mut serde_json::Value)) -> Result<TruthSet, EvalError> {
    let joints2d: Vec<[f64; 2]> = (0..BODY_JOINTS)
        .map(|j| [10.0 * j as f64, 5.0 * j as f64])
        .collect();
    let solid = body().map(|p| [p[0], p[1], p[2] + 4.0]).to_vec();
    let mut person = serde_json::json!({
        "id": 1, "stature": 1.8, "joints3d": solid, "joints2d": joints2d,
        "visibility": vec![1; BODY_JOINTS], "pixels": 900.0, "box": [-10.0, -10.0, 140.0, 80.0],
    });
    change(&mut person);
    let truth = serde_json::json!({
        "format": "edgecap-truth", "version": 1, "seed": 1, "width": 512, "height": 320, "fps": 25.0,
        "frames": [{"frame": 0, "time_ns": 0, "camera": {}, "people": [person]}],
    });
    TruthSet::parse(&truth.to_string(), "t", Format::Auto, None)
}
