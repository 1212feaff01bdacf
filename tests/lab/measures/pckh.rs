//! PCKh@0.5 of people in MPII's formats.

use assert_cmd::Command;
use edgecap::lab::eval::{
    EvalError, EvalOptions, Format, PckhScore, Predictions, Report, TruthSet, evaluate,
};
use serde_json::{Value, json};

use super::{Joints2d, line, observation};
use crate::near;

/// Evidence joints of somebody who stands, pixels. From neck to head top it is 40.
const STANDING: Joints2d = [
    [200.0, 40.0, 1.0],
    [200.0, 80.0, 1.0],
    [170.0, 90.0, 1.0],
    [160.0, 130.0, 1.0],
    [155.0, 170.0, 1.0],
    [230.0, 90.0, 1.0],
    [240.0, 130.0, 1.0],
    [245.0, 170.0, 1.0],
    [180.0, 180.0, 1.0],
    [178.0, 240.0, 1.0],
    [176.0, 300.0, 1.0],
    [220.0, 180.0, 1.0],
    [222.0, 240.0, 1.0],
    [224.0, 300.0, 1.0],
];
const PELVIS: [f64; 2] = [200.0, 180.0];
const THORAX: [f64; 2] = [200.0, 90.0];
/// MPII's joints: ours, pelvis and thorax.
const ORDER: [Option<usize>; 16] = [
    Some(10),
    Some(9),
    Some(8),
    Some(11),
    Some(12),
    Some(13),
    None,
    None,
    Some(1),
    Some(0),
    Some(4),
    Some(3),
    Some(2),
    Some(5),
    Some(6),
    Some(7),
];
const UPPER_NECK: usize = 8;
const HEAD_TOP: usize = 9;
/// A head with a diagonal of 50 pixels, so that joints are right within 15, just as by neck and head top.
const HEAD: [f64; 4] = [186.0, 41.0, 216.0, 81.0];

/// Where the joints are, in MPII's order; the first pixel is 0.
fn places() -> Vec<[f64; 2]> {
    let at = |(k, joint): (usize, &Option<usize>)| match joint {
        Some(j) => [f64::from(STANDING[*j][0]), f64::from(STANDING[*j][1])],
        None if k == 6 => PELVIS,
        None => THORAX,
    };
    ORDER.iter().enumerate().map(at).collect()
}

/// An entry as public toolboxes write them: the first pixel is 1.
fn entry(image: &str, change: impl Fn(&mut Value)) -> Value {
    let joints: Vec<[f64; 2]> = places().iter().map(|p| p.map(|x| x + 1.0)).collect();
    let mut entry = json!({
        "image": image, "joints": joints, "joints_vis": vec![1; 16], "center": [201, 171], "scale": 1.4,
    });
    change(&mut entry);
    entry
}

/// The person with a left wrist as far off as may be, a right one half a pixel more, a neck that is 6 from the thorax
/// and 16 from the upper neck, and without a right ankle.
fn seen() -> Joints2d {
    let mut seen = STANDING;
    seen[7][0] += 15.0;
    seen[4][0] += 15.5;
    seen[1][1] += 16.0;
    seen[10] = [0.0; 3];
    seen
}

/// Of `a.jpg`, where that person is seen, and `b.jpg` with nobody reported.
fn predictions() -> String {
    [
        line(0, "a.jpg", &observation(0.9, &seen())),
        line(1, "b.jpg", ""),
    ]
    .join("\n")
}

fn measure(truth: &Value) -> Report {
    let truth = TruthSet::parse(&truth.to_string(), "t", Format::Auto, None).unwrap();
    let predictions = Predictions::parse(&predictions(), "p").unwrap();
    evaluate(&predictions, &truth, &EvalOptions::default()).unwrap()
}

fn parts(score: &PckhScore) -> Vec<f64> {
    score
        .parts
        .iter()
        .map(|(_, share)| share.unwrap())
        .collect()
}

fn boxed(e: &mut Value) {
    e["headbox"] = json!(HEAD);
}

#[test]
fn joints_within_half_a_head_of_mpii_are_right() {
    for (change, by_joints) in [(boxed as fn(&mut Value), 0), (|_: &mut Value| (), 1)] {
        let score = measure(&json!([entry("a.jpg", change)])).pckh.unwrap();
        near(score.mean, 11.0 / 14.0);
        assert_eq!(parts(&score), [0.5, 1.0, 1.0, 0.5, 1.0, 1.0, 0.5]);
        let names: Vec<&str> = score.parts.iter().map(|p| p.0).collect();
        let tables = "head shoulder elbow wrist hip knee ankle";
        assert_eq!(names.join(" "), tables);
        let wrong = score.per_joint.iter().filter(|j| j.1 == Some(0.0));
        let wrong: Vec<&str> = wrong.map(|j| j.0).collect();
        assert_eq!(wrong, ["neck", "r_wrist", "r_ankle"]);
        let counts = (score.people, score.head_by_joints, score.without_head);
        assert_eq!(counts, (1, by_joints, 0));
    }
}

#[test]
fn the_box_of_a_head_tells_its_size_before_joints_do() {
    // Of a diagonal of 52 pixels joints are right within 15.6.
    let larger = |e: &mut Value| e["headbox"] = json!([0, 0, 20, 48]);
    let score = measure(&json!([entry("a.jpg", larger)])).pckh.unwrap();
    near(score.mean, 12.0 / 14.0);
    let other_name = |e: &mut Value| e["head_rect"] = json!([0, 0, 20, 48]);
    let same = measure(&json!([entry("a.jpg", other_name)])).pckh.unwrap();
    assert_eq!(same, score);
}

#[test]
fn whoever_is_not_reported_has_every_joint_wrong() {
    let truth = json!([entry("a.jpg", boxed), entry("b.jpg", |_| ())]);
    let report = measure(&truth);
    let score = report.pckh.as_ref().unwrap();
    near(score.mean, 11.0 / 28.0);
    assert_eq!(parts(score), [0.25, 0.5, 0.5, 0.25, 0.5, 0.5, 0.25]);
    let text = report.to_string();
    let row = "39.3 %, heads: 1 by box, 1 by 0.75 of upper neck to head top\n";
    assert!(text.contains(row), "{text}");
    assert!(text.contains("25.0 %, its top alone 50.0 %"), "{text}");
}

#[test]
fn people_of_unknown_head_are_left_out_and_counted() {
    for hidden in [UPPER_NECK, HEAD_TOP] {
        let hide = |e: &mut Value| {
            e["joints_vis"][hidden] = 0.into();
            e["joints"][hidden] = json!([-1.0, -1.0]);
        };
        let truth = json!([entry("a.jpg", |_| ()), entry("b.jpg", hide)]);
        let report = measure(&truth);
        let score = report.pckh.as_ref().unwrap();
        near(score.mean, 11.0 / 14.0);
        assert_eq!((score.people, score.without_head), (1, 1));
        let text = report.to_string();
        assert!(
            text.contains("head top, 1 unknown and left out\n"),
            "{text}"
        );
        assert_eq!(measure(&json!([entry("b.jpg", hide)])).pckh, None);
        // The box alone is enough.
        let told = |e: &mut Value| {
            hide(e);
            boxed(e);
        };
        let truth = json!([entry("a.jpg", |_| ()), entry("b.jpg", told)]);
        near(measure(&truth).pckh.unwrap().mean, 11.0 / 27.0);
    }
}

/// Converters to COCO's format keep MPII's names; some call the thorax a neck.
#[test]
fn mpii_in_cocos_format_has_the_same_figures() {
    for thorax in ["thorax", "neck"] {
        let names = [
            "right_ankle",
            "right_knee",
            "right_hip",
            "left_hip",
            "left_knee",
            "left_ankle",
            "pelvis",
            thorax,
            "upper_neck",
            "head_top",
            "right_wrist",
            "right_elbow",
            "right_shoulder",
            "left_shoulder",
            "left_elbow",
            "left_wrist",
        ];
        let keypoints: Vec<f64> = places().iter().flat_map(|p| [p[0], p[1], 2.0]).collect();
        let person = json!({
            "image_id": 3, "category_id": 1, "keypoints": keypoints, "bbox": [155, 40, 90, 260], "area": 12000.0,
        });
        let mut truth = json!({
            "images": [{"id": 3, "file_name": "a.jpg"}],
            "categories": [{"id": 1, "keypoints": names}],
            "annotations": [person],
        });
        let report = measure(&truth);
        let by_joints = report.pckh.unwrap();
        near(by_joints.mean, 11.0 / 14.0);
        assert_eq!(by_joints.head_by_joints, 1);
        // MPII labels some of the people: nobody else who is reported is wrong.
        assert_eq!(report.coco, None);
        truth["annotations"][0]["headbox"] = json!(HEAD);
        let by_box = measure(&truth).pckh.unwrap();
        assert_eq!((by_box.mean, by_box.head_by_joints), (by_joints.mean, 0));
    }
}

#[test]
fn sets_without_heads_have_no_pckh() {
    let truth = super::synthetic(|_| ()).unwrap();
    let predictions = Predictions::parse(&line(0, "", ""), "p").unwrap();
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    assert_eq!(report.pckh, None);
    assert!(!report.to_string().contains("PCKh"));
}

#[test]
fn a_box_that_is_none_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("p.jsonl"), predictions()).unwrap();
    for (wrong, word) in [
        // x, y, width, height.
        (json!([186.0, 41.0, 30.0, 40.0]), "t.json, a.jpg"),
        (json!([186.0, 41.0, 186.0, 81.0]), "headbox"),
        (json!([186.0, 41.0, 216.0]), "expected an array of length 4"),
        (json!("none"), "--format mpii"),
    ] {
        let truth = json!([entry("a.jpg", |e| e["headbox"] = wrong.clone())]).to_string();
        let parsed = TruthSet::parse(&truth, "t", Format::Auto, None);
        assert!(matches!(parsed, Err(EvalError::Format { .. })), "{wrong}");
        std::fs::write(folder.path().join("t.json"), truth).unwrap();
        let mut command = Command::cargo_bin("edgecap").unwrap();
        command.current_dir(folder.path());
        command.args(["eval", "--predictions", "p.jsonl", "--truth", "t.json"]);
        let failed = command.assert().code(65);
        let said = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
        assert!(said.lines().count() == 1 && said.contains(word), "{said}");
    }
}
