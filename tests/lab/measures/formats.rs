//! Labels of public sets and of `edgecap synth`, paired with what was predicted.

use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS, PELVIS};
use edgecap::lab::eval::{
    EvalError, EvalOptions, Format, JointSet, Predictions, TruthSet, evaluate, quiet,
};

use super::{Joints2d, body, exact, line, observation};
use crate::near;

#[test]
fn coco_truth_and_observations_are_read_and_paired() {
    let names = [
        "nose",
        "left_shoulder",
        "right_shoulder",
        "left_elbow",
        "right_elbow",
        "left_wrist",
        "right_wrist",
        "left_hip",
        "right_hip",
        "left_knee",
        "right_knee",
        "left_ankle",
        "right_ankle",
    ];
    let ours = [0, 5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10];
    let keypoints: Vec<f64> = ours
        .iter()
        .flat_map(|&j| [10.0 * f64::from(j), 5.0 * f64::from(j), 2.0])
        .collect();
    let truth = serde_json::json!({
        "images": [{"id": 4, "file_name": "a.jpg"}, {"id": 5, "file_name": "b.jpg"}],
        "categories": [{"id": 1, "keypoints": names}],
        "annotations": [
            {"image_id": 4, "category_id": 1, "keypoints": keypoints, "bbox": [0, 0, 130, 65], "area": 5000.0, "iscrowd": 0},
            {"image_id": 5, "category_id": 1, "keypoints": keypoints, "bbox": [0, 0, 130, 65], "area": 5000.0, "iscrowd": 0},
        ],
    });
    let truth = TruthSet::parse(&truth.to_string(), "t", Format::Auto, None).unwrap();
    let text = [
        line(0, "/photos/b.jpg", ""),
        line(1, "/photos/a.jpg", &observation(0.8, &exact())),
        line(2, "/photos/unlabelled.jpg", &observation(0.8, &exact())),
    ]
    .join("\n");
    let predictions = Predictions::parse(&text, "p").unwrap();
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    let coco = report.coco.unwrap();
    assert_eq!(
        (report.frames, report.predicted_people, coco.people),
        (2, 1, 2)
    );
    near(coco.ap, 51.0 / 101.0);
    near(coco.ar, 0.5);
    let found = report.finding[1];
    assert_eq!((found.people, found.found, found.false_people), (2, 1, 0));
    near(found.mean_oks.unwrap(), 1.0);
    // All 13 points: the nose cannot be found.
    let options = EvalOptions {
        joints: JointSet::All,
        ..Default::default()
    };
    let all = evaluate(&predictions, &truth, &options).unwrap();
    near(all.finding[1].mean_oks.unwrap(), 12.0 / 13.0);
    assert!(report.to_string().contains("50.0 % of 2"), "{report}");
    let quiet = quiet(&predictions).unwrap();
    assert_eq!((quiet.pictures, quiet.quiet, quiet.people), (3, 1, 2));
}

#[test]
fn synth_truth_and_bodies_are_read_and_paired() {
    let joints2d: Vec<[f64; 2]> = (0..BODY_JOINTS)
        .map(|j| [10.0 * j as f64, 5.0 * j as f64])
        .collect();
    let at = |x: f64| body().map(|p| [p[0] + x, p[1], p[2] + 4.0]).to_vec();
    let frame = |k: u64, visibility: u8| {
        serde_json::json!({
            "frame": k, "time_ns": k * 40_000_000, "camera": {},
            "people": [{
                "id": 1, "stature": 1.8, "joints3d": at(0.02 * k as f64), "joints2d": joints2d,
                "visibility": vec![visibility; BODY_JOINTS], "pixels": 900.0,
            }],
        })
    };
    let truth = serde_json::json!({
        "format": "edgecap-truth", "version": 1, "seed": 1, "width": 512, "height": 320, "fps": 25.0,
        "frames": [frame(0, 1), frame(1, 2), frame(2, 1), frame(3, 3)],
    });
    let truth = TruthSet::parse(&truth.to_string(), "t", Format::Auto, None).unwrap();
    let body_line = |k: u64, id: u64| {
        let person = serde_json::json!({
            "id": id, "state": "tracked", "position": [0.0, 0.0, 4.0], "orientation": [0.0, 0.0, 0.0, 1.0],
            "angles": vec![0.0; 29], "joints3d": at(0.02 * k as f64 + 0.3), "joints2d": joints2d,
            "confidence": vec![0.9; BODY_JOINTS], "height": 1.7,
        });
        format!(
            r#"{{"frame":{k},"time_ns":{},"people":[{person}]}}"#,
            k * 40_000_000
        )
    };
    let text = [
        body_line(0, 5),
        body_line(1, 5),
        body_line(2, 6),
        body_line(3, 6),
    ]
    .join("\n");
    let predictions = Predictions::parse(&text, "p").unwrap();
    assert!(predictions.bodies);
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    let pose = report.pose3d.unwrap();
    near(pose.mpjpe_mm, 0.0);
    near(pose.root_mm.unwrap(), 300.0);
    // In the last frame the person is hidden: neither missed nor, being predicted, wrong.
    assert_eq!(pose.people, 3);
    let id = report.identity.unwrap();
    assert_eq!((id.truth, id.predicted, id.switches), (3, 3, 1));
    near(id.idf1, 4.0 / 6.0);
    near(report.mupots[0].pck150, 1.0);
    // Somebody without a pelvis is nobody whose errors can be found.
    let mut rootless = truth.clone();
    for person in rootless.frames[0].people.iter_mut() {
        if let Some(joints) = &mut person.joints3d {
            joints[PELVIS] = None;
        }
    }
    let pose = evaluate(&predictions, &rootless, &EvalOptions::default()).unwrap();
    let pose = pose.pose3d.unwrap();
    assert_eq!((pose.people, pose.truth), (2, 2));
    // No identity lasted three frames, so that there is nothing to hold the person's motion against.
    assert_eq!((report.jitter, report.true_motion), (None, None));
}

#[test]
fn single_person_sets_are_read() {
    let joints: Vec<[f64; 3]> = (0..EVIDENCE_JOINTS)
        .map(|j| {
            [
                10.0 * j as f64,
                5.0 * j as f64,
                if j == 4 { 0.0 } else { 1.0 },
            ]
        })
        .collect();
    let people2d = serde_json::json!([
        {"file": "lsp/a.jpg", "split": "test", "joints": joints},
        {"file": "lsp/b.jpg", "split": "train", "joints": joints},
    ]);
    let truth = TruthSet::parse(&people2d.to_string(), "t", Format::Auto, Some("test")).unwrap();
    // A bystander who is not labelled does not count against the prediction.
    let mut stranger = exact();
    stranger.iter_mut().for_each(|j| j[0] += 300.0);
    let people = format!(
        "{},{}",
        observation(0.9, &stranger),
        observation(0.5, &exact())
    );
    let predictions = Predictions::parse(&line(0, "x/lsp/a.jpg", &people), "p").unwrap();
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    near(report.pck.unwrap(), 1.0);
    assert_eq!(report.pck_per_joint[4], ("r_wrist", None));
    assert_eq!(report.coco, None);

    let solid: Vec<[f64; 4]> = (0..17)
        .map(|j| [0.1 * j as f64, (j % 3) as f64, 3.0, 1.0])
        .collect();
    let flat: Vec<[f64; 3]> = (0..17)
        .map(|j| [10.0 * j as f64, 5.0 * j as f64, 1.0])
        .collect();
    let real3d = |set: &str| {
        let text = serde_json::json!([{
            "set": set, "file": "a.jpg", "joints2d": flat, "joints3d_camera_m": solid,
        }]);
        TruthSet::parse(&text.to_string(), "t", Format::Auto, None)
    };
    let h36m = real3d("h36m").unwrap().frames.remove(0).people.remove(0);
    let joints = h36m.joints3d.unwrap();
    assert_eq!(joints[PELVIS], Some([0.0, 0.0, 3.0]));
    assert!(
        (joints[4].unwrap()[0] - 1.6).abs() < 1e-9,
        "right wrist is Human3.6M's 16"
    );
    assert_eq!((joints[16], joints[20]), (None, None));
    let dhp = real3d("mpi_inf_3dhp")
        .unwrap()
        .frames
        .remove(0)
        .people
        .remove(0);
    assert!((dhp.joints3d.unwrap()[PELVIS].unwrap()[0] - 1.4).abs() < 1e-9);
    assert!(matches!(real3d("other"), Err(EvalError::Format { .. })));
    let said = real3d("smpl").unwrap_err().to_string();
    assert!(
        said.contains("as smpl has") && said.contains("found 17 and 17"),
        "{said}"
    );
}

#[test]
fn mpii_people_of_one_picture_come_together() {
    let at = |j: i32| [f64::from(j), 2.0 + f64::from(j % 2)];
    let joints: Vec<[f64; 2]> = (0..16).map(at).collect();
    let entry = |image: &str| serde_json::json!({"image": image, "joints": joints, "joints_vis": vec![1; 16], "scale": 1.0, "center": [0, 0]});
    let text = serde_json::json!([entry("a.jpg"), entry("b.jpg"), entry("a.jpg")]).to_string();
    let truth = TruthSet::parse(&text, "t", Format::Auto, None).unwrap();
    assert_eq!(truth.frames.len(), 2);
    let people = &truth.frames[0].people;
    assert_eq!(people.len(), 2);
    let at = |j: usize| {
        let k = people[0].points.iter().find(|k| k.joint == Some(j));
        k.map(|k| k.u)
    };
    // Others may be in the picture: whoever is reported beside them is neither right nor wrong.
    let mut at_them: Joints2d = [[0.0; 3]; EVIDENCE_JOINTS];
    for k in &people[0].points {
        at_them[k.joint.unwrap()] = [k.u as f32, k.v as f32, 1.0];
    }
    let mut stranger = at_them;
    stranger.iter_mut().for_each(|j| j[0] += 300.0);
    let seen = format!(
        "{},{}",
        observation(0.9, &stranger),
        observation(0.5, &at_them)
    );
    let predictions = Predictions::parse(&line(0, "a.jpg", &seen), "p").unwrap();
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    assert_eq!(report.coco, None);
    assert!(report.finding.is_empty() && !report.recall_by_company.is_empty());
    let short = text.replacen("[0.0,2.0],", "", 1);
    let said = TruthSet::parse(&short, "t", Format::Auto, None).unwrap_err();
    assert!(said.to_string().contains("15 and 16"), "{said}");
    // Right ankle, left shoulder, right wrist, head top, neck (upper neck); the file's first pixel is 1.
    assert_eq!(
        [at(10), at(5), at(4), at(0), at(1)],
        [Some(-1.0), Some(12.0), Some(9.0), Some(8.0), Some(7.0)]
    );
    assert_eq!(people[0].bbox[1], 1.0);
}

#[test]
fn keypoints_of_other_names_count_with_all_points_alone() {
    let ours = [5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10];
    let mut names: Vec<String> = ["shoulder", "elbow", "wrist", "hip", "knee", "ankle"]
        .iter()
        .flat_map(|part| ["left", "right"].map(|side| format!("{side}_{part}")))
        .collect();
    names.push("left_big_toe".into());
    let joints = ours.iter().map(|j| f64::from(*j));
    let mut keypoints: Vec<f64> = joints.flat_map(|j| [10.0 * j, 5.0 * j, 2.0]).collect();
    keypoints.extend([90.0, 9.0, 2.0]);
    let person = serde_json::json!({
        "image_id": 4, "category_id": 1, "keypoints": keypoints, "bbox": [0, 0, 130, 65], "area": 5000.0,
    });
    let hat = serde_json::json!({
        "image_id": 4, "category_id": 2, "keypoints": [1, 1, 2, 5, 5, 2], "bbox": [0, 0, 9, 9], "area": 50.0,
    });
    let read = |annotations: &[&serde_json::Value]| {
        let truth = serde_json::json!({
            "images": [{"id": 4, "file_name": "a.jpg"}],
            "categories": [{"id": 1, "keypoints": names}, {"id": 2, "keypoints": ["brim", "button"]}],
            "annotations": annotations,
        });
        TruthSet::parse(&truth.to_string(), "t", Format::Auto, None)
    };
    let truth = read(&[&person]).unwrap();
    let predictions = Predictions::parse(&line(0, "a.jpg", &observation(0.8, &exact())), "p");
    let predictions = predictions.unwrap();
    for (joints, expected) in [
        (JointSet::Shared, 1.0),
        (JointSet::Evidence, 1.0),
        (JointSet::All, 12.0 / 13.0),
    ] {
        let options = EvalOptions {
            joints,
            ..EvalOptions::default()
        };
        let report = evaluate(&predictions, &truth, &options).unwrap();
        near(report.finding[1].mean_oks.unwrap(), expected);
    }
    // What has none of our joints is nobody.
    assert_eq!(read(&[&person, &hat]).unwrap(), truth);
    let said = read(&[&hat]).unwrap_err().to_string();
    assert!(said.contains("brim") && said.contains("COCO"), "{said}");
}

/// As `edgecap synth` writes a folder: frames that follow each other, each a picture of its own.
#[test]
fn pictures_of_a_film_are_told_by_their_names() {
    let place = |k: usize| 40.0 * k as f32;
    let people: Vec<serde_json::Value> = (0..3)
        .map(|k| {
            let joints2d: Vec<[f64; 2]> = (0..BODY_JOINTS)
                .map(|j| [10.0 * j as f64 + f64::from(place(k)), 5.0 * j as f64])
                .collect();
            let solid = body().map(|p| [p[0], p[1], p[2] + 4.0]).to_vec();
            serde_json::json!({
                "id": 1, "stature": 1.8, "joints3d": solid, "joints2d": joints2d,
                "visibility": vec![1; BODY_JOINTS], "pixels": 900.0,
            })
        })
        .collect();
    let frames = people.iter().enumerate().map(|(k, person)| {
        serde_json::json!({
            "frame": k, "time_ns": k, "file": format!("{k:06}.jpg"), "camera": {}, "people": [person],
        })
    });
    let truth = serde_json::json!({
        "format": "edgecap-truth", "version": 1, "seed": 1, "width": 512, "height": 320, "fps": 15.0,
        "frames": frames.collect::<Vec<_>>(),
    });
    let truth = TruthSet::parse(&truth.to_string(), "t", Format::Auto, None).unwrap();
    assert!(truth.video && !truth.clip);
    let seen = |number: u64, k: usize| {
        let moved = exact().map(|[u, v, c]| [u + place(k), v, c]);
        let people = observation(0.9, &moved);
        line(number, &format!("syn/{k:06}.jpg"), &people)
    };
    let report = |lines: &[String]| {
        let predictions = Predictions::parse(&lines.join("\n"), "p").unwrap();
        evaluate(&predictions, &truth, &EvalOptions::default())
    };
    let whole = report(&[seen(0, 0), seen(1, 1), seen(2, 2)]).unwrap();
    assert_eq!(
        (whole.frames_without_prediction, whole.finding[2].found),
        (0, 3)
    );
    // Numbers of a folder of which a picture was taken out, or of another folder, say nothing.
    let some = report(&[seen(0, 1), seen(1, 2)]).unwrap();
    assert_eq!(
        (some.frames_without_prediction, some.finding[2].found),
        (1, 2)
    );
    let other = seen(0, 0).replace("000000.jpg", "img_000000.jpg");
    assert!(matches!(report(&[other]), Err(EvalError::Disjoint { .. })));
}
