//! Measures against values worked out by hand.

use edgecap::joints::{BODY_JOINTS, CANONICAL_STATURE, EVIDENCE_JOINTS, PELVIS};
use edgecap::lab::eval::{
    EvalError, EvalOptions, Format, Identity, ImageOks, Jitter, JointSet, Keypoint, Mupots,
    MupotsPerson, Pck, Pose3d, PoseErrors, Predictions, Protocol, TruthFrame, TruthPerson,
    TruthSet, align_similarity, average_precision, evaluate, oks, quiet,
};
use edgecap::message::ObservationFrame;
use edgecap::record::{self, ObservationsRow, RecordWriter};

type Joints2d = [[f32; 3]; EVIDENCE_JOINTS];

fn near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-6, "{a} instead of {b}");
}

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

#[test]
fn oks_is_the_mean_of_the_joints_gaussians() {
    let truth = person(10_000.0);
    near(oks(&truth, &exact(), JointSet::All), 1.0);
    // A right ankle 17.8 px off lies one constant (k s = 2 · 0.089 · 100) away: exp(−½).
    let mut off = exact();
    off[10][0] += 17.8;
    near(
        oks(&truth, &off, JointSet::All),
        (13.0 + (-0.5_f64).exp()) / 14.0,
    );
    near(
        oks(&truth, &off, JointSet::Shared),
        (11.0 + (-0.5_f64).exp()) / 12.0,
    );
    // Head and neck are not shared with COCO.
    let mut headless = exact();
    headless[0] = [0.0; 3];
    headless[1] = [0.0; 3];
    near(oks(&truth, &headless, JointSet::Shared), 1.0);
    near(oks(&truth, &headless, JointSet::All), 12.0 / 14.0);
    // A joint that was not seen counts where it is expected.
    let mut expected = exact();
    expected[10] = [off[10][0], off[10][1], 0.0];
    near(
        oks(&truth, &expected, JointSet::All),
        oks(&truth, &off, JointSet::All),
    );
    // Unlabelled points do not count.
    let mut partly = truth.clone();
    for k in partly.points.iter_mut().skip(7) {
        k.visibility = 0;
    }
    near(oks(&partly, &off, JointSet::All), 1.0);
}

fn image(scores: &[f64], oks: &[&[f64]], ignored: &[bool]) -> ImageOks {
    ImageOks {
        scores: scores.to_vec(),
        ignored: ignored.to_vec(),
        crowd: vec![false; ignored.len()],
        excused: vec![false; scores.len()],
        oks: oks.iter().map(|r| r.to_vec()).collect(),
    }
}

#[test]
fn average_precision_follows_coco() {
    // Two people; the best prediction is right up to OKS 0.90, the second is nobody, the third right up to 0.60.
    let i = image(
        &[0.9, 0.8, 0.7],
        &[&[0.92, 0.0], &[0.0, 0.1], &[0.0, 0.62]],
        &[false, false],
    );
    let ap = average_precision(std::slice::from_ref(&i));
    // At 0.50–0.60 the curve is (½, 1), (½, ½), (1, ⅔): recalls 0–0.50 have precision 1, the 50 above ⅔. At 0.65–0.90
    // only the first is right: 51 of 101. At 0.95 nothing is.
    let both = (51.0 + 50.0 * 2.0 / 3.0) / 101.0;
    let one = 51.0 / 101.0;
    near(ap.ap50, both);
    near(ap.ap75, one);
    near(ap.ap, (3.0 * both + 6.0 * one) / 10.0);
    near(ap.ar, (3.0 * 1.0 + 6.0 * 0.5) / 10.0);
    assert_eq!(ap.people, 2);
    // An ignored person takes his prediction out of the count: then nothing false comes before the second person.
    let i = image(
        &[0.9, 0.8, 0.7],
        &[&[0.92, 0.0, 0.0], &[0.0, 0.1, 0.8], &[0.0, 0.62, 0.0]],
        &[false, false, true],
    );
    near(average_precision(&[i]).ap50, 1.0);
    // So does being excused, but whoever is right is.
    let mut i = image(
        &[0.9, 0.8, 0.7],
        &[&[0.92, 0.0], &[0.0, 0.1], &[0.0, 0.62]],
        &[false, false],
    );
    i.excused = vec![true; 3];
    near(average_precision(&[i]).ap50, 1.0);
    near(average_precision(&[]).ap, -1.0);
}

#[test]
fn every_person_is_claimed_once() {
    let i = image(&[0.9, 0.8], &[&[0.9], &[0.97]], &[false]);
    // The surer prediction takes the person although the other fits better; the other is false, after full recall. At
    // 0.95 it is the other way round, and what is right comes second.
    let ap = average_precision(&[i]);
    near(ap.ap50, 1.0);
    near(ap.ap, (9.0 + 0.5) / 10.0);
    near(ap.ar, 1.0);
}

#[test]
fn pck_counts_joints_within_a_fifth_of_the_torso() {
    // Left shoulder (50, 25) to right hip (80, 40): √1125 = 33.54 px, so the radius is 6.708 px.
    let truth = person(1.0);
    let mut predicted = exact();
    predicted[3][0] += 6.7;
    predicted[4][0] += 6.8;
    predicted[7] = [0.0; 3];
    predicted[9][2] = 0.0;
    let mut pck = Pck::new(0.2);
    assert!(pck.add(&truth, Some(&predicted)));
    near(pck.mean(), 12.0 / 14.0);
    assert!(pck.add(&truth, None));
    near(pck.mean(), 12.0 / 28.0);
    let joint = pck.per_joint();
    assert_eq!(
        (joint[3], joint[4], joint[7]),
        (Some(0.5), Some(0.0), Some(0.0))
    );
    assert_eq!(pck.people(), 2);
    let mut no_torso = truth;
    no_torso.points[5].visibility = 0;
    assert!(!pck.add(&no_torso, Some(&predicted)));
}

/// A body of which joint j lies at (j, 0, 0) decimetres, but for a few that lift it out of the line.
fn body() -> [[f64; 3]; BODY_JOINTS] {
    std::array::from_fn(|j| {
        let x = 0.1 * j as f64;
        [x, 0.3 * (x * 7.0).sin(), 0.4 * x * x]
    })
}

#[test]
fn procrustes_undoes_turn_scale_and_shift_but_no_mirror() {
    let from = body();
    let (s, c) = (0.6, 0.8);
    let moved = from.map(|[x, y, z]| {
        [
            1.7 * (c * x - s * y) + 1.0,
            1.7 * (s * x + c * y) - 2.0,
            1.7 * z + 3.0,
        ]
    });
    let aligned = align_similarity(&from, &moved);
    for (a, b) in aligned.iter().zip(&moved) {
        for k in 0..3 {
            near(a[k], b[k]);
        }
    }
    let mirrored = from.map(|[x, y, z]| [-x, y, z]);
    let aligned = align_similarity(&from, &mirrored);
    let worst = aligned
        .iter()
        .zip(&mirrored)
        .map(|(a, b)| (a[0] - b[0]).abs());
    assert!(worst.fold(0.0, f64::max) > 0.1);
}

#[test]
fn pose_errors_are_root_aligned() {
    let truth = body();
    // Everything shifted by a metre, then two joints moved by 102 mm and 200 mm.
    let mut predicted = truth.map(|[x, y, z]| [x + 1.0, y, z]);
    predicted[4][1] += 0.102;
    predicted[7][2] -= 0.2;
    let errors = PoseErrors::new(&truth.map(Some), &predicted).unwrap();
    let squares = |e: &[f64]| e.iter().map(|e| e * e).sum::<f64>();
    assert!(squares(&errors.procrustes) < squares(&errors.aligned));
    let pooled = Pose3d::pool(
        std::slice::from_ref(&errors),
        std::slice::from_ref(&errors),
        2,
        &[0.5],
    )
    .unwrap();
    near(pooled.mpjpe_mm, 302.0 / 21.0);
    assert_eq!(pooled.joints, 21);
    // Of the evidence joints alone: the pelvis is right whatever is said of it.
    near(pooled.pck150, 13.0 / 14.0);
    // 12 joints are right from 5 mm on (30 of 31 thresholds), one from 105 mm on (10), one never.
    near(pooled.auc, (12.0 * 30.0 + 10.0) / 31.0 / 14.0);
    assert_eq!(
        (pooled.people, pooled.truth, pooled.root_mm),
        (1, 2, Some(500.0))
    );
    // A spine that is off counts in MPJPE alone, as in MPI-INF-3DHP's own tool.
    let mut bent = predicted;
    bent[15][0] += 0.2;
    let bent = PoseErrors::new(&truth.map(Some), &bent).unwrap();
    let of_bent = Pose3d::pool(&[bent], &[], 1, &[]).unwrap();
    near(of_bent.mpjpe_mm, 502.0 / 21.0);
    assert_eq!((of_bent.pck150, of_bent.auc), (pooled.pck150, pooled.auc));
    // Without those two and a third too large: only N-MPJPE and PA-MPJPE do not mind.
    let larger = truth.map(|p| p.map(|x| 4.0 / 3.0 * x));
    let grown = PoseErrors::new(&truth.map(Some), &larger).unwrap();
    let own_size = PoseErrors::new(&truth.map(Some), &truth).unwrap();
    let grown = Pose3d::pool(&[grown], &[own_size], 1, &[]).unwrap();
    assert!(grown.canonical_mpjpe_mm.unwrap() < 1e-6);
    assert!(
        grown.mpjpe_mm > 50.0 && grown.n_mpjpe_mm < 1e-6,
        "{grown:?}"
    );
    // Scaled as suits best: of two joints at 1 m that are predicted at 1 m and not at all, no factor helps the second.
    let mut flat = [[0.0; 3]; BODY_JOINTS];
    flat[0] = [1.0, 0.0, 0.0];
    flat[1] = [0.0, 1.0, 0.0];
    let mut half = flat;
    half[0] = [0.5, 0.0, 0.0];
    half[1] = [0.0; 3];
    let errors = PoseErrors::new(&flat.map(Some), &half).unwrap();
    near(errors.scaled[0], 0.0);
    near(errors.scaled[1], 1.0);
    let mut rootless = truth.map(Some);
    rootless[PELVIS] = None;
    assert_eq!(PoseErrors::new(&rootless, &predicted), None);
    // A trunk without limbs has no joint of 3DPCK.
    let mut trunk = [None; BODY_JOINTS];
    (14..18).for_each(|j| trunk[j] = Some(truth[j]));
    assert!(!PoseErrors::can_be(&trunk));
    assert!(PoseErrors::can_be(&truth.map(Some)) && !PoseErrors::can_be(&rootless));
}

fn mupots_person(shift: f64, scale: f64) -> MupotsPerson {
    MupotsPerson {
        joints2d: std::array::from_fn(|j| Some([10.0 * j as f64 + shift, 5.0 * j as f64])),
        joints3d: body().map(|p| Some(p.map(|x| scale * x + shift))),
    }
}

#[test]
fn mupots_matches_in_order_and_rescales_bones() {
    let truth = [mupots_person(0.0, 1.0), mupots_person(100.0, 1.0)];
    // One prediction, between both but within 40 px of the first only, half as large.
    let predicted = [mupots_person(39.0, 0.5)];
    let mut m = Mupots::default();
    m.begin_sequence();
    m.add(&truth, &predicted);
    let all = m.score(Protocol::All).unwrap();
    let matched = m.score(Protocol::Matched).unwrap();
    near(matched.pck150, 1.0);
    near(all.pck150, 0.5);
    // Exact after rescaling: right at every threshold but 0.
    near(matched.auc, 30.0 / 31.0);
    near(all.auc, 15.0 / 31.0);
    // A second sequence with nobody found: pooled over people, but the mean is over sequences.
    m.begin_sequence();
    m.add(&truth[..1], &[]);
    let all = m.score(Protocol::All).unwrap();
    near(all.pck150, 1.0 / 3.0);
    near(all.pck150_per_sequence, 0.25);
    near(m.score(Protocol::Matched).unwrap().pck150_per_sequence, 1.0);
}

#[test]
fn idf1_and_switches() {
    let mut i = Identity::default();
    let one = |a: f64, b: f64| vec![vec![a, b], vec![b, a]];
    // Two people for four frames; identities 7 and 8, exchanged in the last frame.
    for _ in 0..3 {
        i.add(&[1, 2], &[7, 8], &one(0.9, 0.1), 0.5);
    }
    i.add(&[1, 2], &[7, 8], &one(0.1, 0.9), 0.5);
    // One more frame in which the second is missed and a stranger appears.
    i.add(&[1, 2], &[8, 9], &[vec![0.9, 0.0], vec![0.0, 0.0]], 0.5);
    let s = i.score();
    assert_eq!(
        (s.truth, s.predicted, s.matched, s.switches),
        (10, 10, 9, 2)
    );
    // Best mapping: 1 → 7 and 2 → 8, right three times each; 1 → 8 and 2 → 7 would be right three times in all.
    near(s.idf1, 12.0 / 20.0);
    assert_eq!((s.truth_identities, s.predicted_identities), (2, 3));
}

#[test]
fn a_match_that_still_holds_is_kept() {
    let mut i = Identity::default();
    i.add(&[1], &[7], &[vec![0.9]], 0.5);
    // A second body lies nearer, but 7 still lies on the person: no switch.
    i.add(&[1], &[7, 8], &[vec![0.6], vec![0.9]], 0.5);
    assert_eq!(i.score().switches, 0);
}

#[test]
fn jitter_is_the_mean_acceleration() {
    let mut j = Jitter::default();
    // x = ½ · 4 · t²: 4 m/s² at any step.
    for (k, t) in [0.0, 0.1, 0.2, 0.4].into_iter().enumerate() {
        let x: f64 = 2.0 * t * t;
        j.add(1, k as u64, t, &[[x, 0.0, 0.0]; BODY_JOINTS]);
    }
    near(j.mean().unwrap(), 4.0);
    // A gap of one frame starts anew: too few frames on either side.
    let mut gap = Jitter::default();
    for k in [0_u64, 1, 3, 4] {
        gap.add(1, k, k as f64, &[[1.0; 3]; BODY_JOINTS]);
    }
    assert_eq!(gap.mean(), None);
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
fn true_motion_is_of_the_time_that_predicted_tracks_last() {
    // Faster and faster; joints are right, but the identity changes after four of seven frames.
    let moving = |k: u64| {
        let x = 0.001 * (k * k * k) as f64;
        body().map(|p| [p[0] + x, p[1], p[2] + 4.0])
    };
    let joints2d: Vec<[f64; 2]> = (0..BODY_JOINTS)
        .map(|j| [10.0 * j as f64, 5.0 * j as f64])
        .collect();
    let mut truth = synthetic(|_| ()).unwrap();
    let first = truth.frames.remove(0);
    let mut lines = Vec::new();
    for k in 0..7 {
        let mut frame = first.clone();
        frame.frame = Some(k);
        frame.people[0].joints3d = Some(moving(k).map(Some));
        truth.frames.push(frame);
        let person = serde_json::json!({
            "id": if k < 4 { 5 } else { 6 }, "state": "tracked", "position": [0.0, 0.0, 4.0],
            "orientation": [0.0, 0.0, 0.0, 1.0], "angles": vec![0.0; 29], "joints3d": moving(k).to_vec(),
            "joints2d": joints2d, "confidence": vec![0.9; BODY_JOINTS], "height": 1.8,
        });
        lines.push(line(k, "", &person.to_string()));
    }
    let predictions = Predictions::parse(&lines.join("\n"), "p").unwrap();
    assert!(predictions.bodies);
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    assert_eq!(report.identity.unwrap().switches, 1);
    assert!(report.jitter.unwrap() > 1.0, "{:?}", report.jitter);
    near(report.jitter.unwrap(), report.true_motion.unwrap());
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
    // Right ankle, left shoulder, right wrist, head top, neck (thorax); the file's first pixel is 1.
    assert_eq!(
        [at(10), at(5), at(4), at(0), at(1)],
        [Some(-1.0), Some(12.0), Some(9.0), Some(8.0), Some(6.0)]
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

#[test]
fn truth_of_another_version_is_refused() {
    let parse = |text: &str| TruthSet::parse(text, "t", Format::Auto, None);
    for (format, version) in [("edgecap-truth", 2), ("edgecap-world", 1)] {
        let text = serde_json::json!({
            "format": format, "version": version, "fps": 25.0, "frames": [{"of": "another layout"}],
        });
        let said = parse(&text.to_string()).unwrap_err().to_string();
        let expected =
            format!("t: expected edgecap-truth version 1, found {format} version {version};");
        assert!(said.starts_with(&expected), "{said}");
        let is_another_file = said.contains("calls truth.json");
        assert_eq!(is_another_file, format == "edgecap-world", "{said}");
    }
    assert!(parse(r#"{"fps": 0.0, "frames": []}"#).is_ok());
}

#[test]
fn what_cannot_be_read_is_said() {
    let error = |r: Result<TruthSet, EvalError>| r.unwrap_err().to_string();
    let unknown = error(TruthSet::parse("{}", "t.json", Format::Auto, None));
    assert!(
        unknown.contains("t.json") && unknown.contains("--format"),
        "{unknown}"
    );
    let text = format!("{}\nno json", line(0, "a", ""));
    let bad = Predictions::parse(&text, "p.jsonl")
        .unwrap_err()
        .to_string();
    assert!(bad.contains("p.jsonl, line 2"), "{bad}");
    let short = r#"{"frame":0,"people":[{"score":1,"joints2d":[[1,2,3]],"joints3d":[[0,0,0]]}]}"#;
    let bad = Predictions::parse(short, "p").unwrap_err().to_string();
    assert!(bad.contains("21 joints3d"), "{bad}");
    let truth = r#"[{"file":"a.jpg","split":"test","joints":[[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1]]}]"#;
    let truth = TruthSet::parse(truth, "t", Format::Auto, None).unwrap();
    let predictions = Predictions::parse(&line(0, "b.jpg", ""), "p").unwrap();
    let bad = evaluate(&predictions, &truth, &EvalOptions::default());
    assert!(matches!(
        bad,
        Err(EvalError::Disjoint {
            truth: 1,
            predictions: 1
        })
    ));
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

#[test]
fn whoever_is_cut_off_by_the_picture_is_as_large_as_before() {
    let person = |truth: TruthSet| truth.frames[0].people[0].clone();
    let whole = person(synthetic(|_| ()).unwrap());
    let cut = synthetic(|p| {
        for j in 5..BODY_JOINTS {
            p["visibility"][j] = 0.into();
        }
    });
    let cut = person(cut.unwrap());
    near(cut.area, whole.area);
    assert!(cut.height() < whole.height() && cut.beyond.is_none());
}

#[test]
fn a_report_on_somebody_beyond_the_picture_is_neither_right_nor_wrong() {
    let outside = synthetic(|p| p["visibility"] = vec![0; BODY_JOINTS].into()).unwrap();
    assert_eq!(
        outside.frames[0].people[0].beyond,
        Some([-10.0, -10.0, 150.0, 90.0])
    );
    let mut truth = outside.clone();
    // Somebody else stands in the picture.
    let mut there = synthetic(|_| ()).unwrap().frames[0].people[0].clone();
    there.id = Some(2);
    there.points.iter_mut().for_each(|k| k.u += 300.0);
    truth.frames[0].people.push(there);
    let moved = |by: f32| exact().map(|[u, v, c]| [u + by, v, c]);
    let report = |reports: &[f32]| {
        let people: Vec<String> = reports
            .iter()
            .map(|by| observation(0.9, &moved(*by)))
            .collect();
        let predictions = Predictions::parse(&line(0, "", &people.join(",")), "p").unwrap();
        evaluate(&predictions, &truth, &EvalOptions::default()).unwrap()
    };
    let both = report(&[0.0, 300.0]);
    assert_eq!(
        (both.finding[1].found, both.finding[1].false_people),
        (1, 0)
    );
    near(both.coco.unwrap().ap50, 1.0);
    let far = report(&[150.0, 300.0]);
    assert_eq!((far.finding[1].found, far.finding[1].false_people), (1, 1));
}

#[test]
fn truth_that_cannot_be_is_refused() {
    let said = |r: Result<TruthSet, EvalError>| r.unwrap_err().to_string();
    let flat = said(synthetic(|p| p["stature"] = 0.0.into()));
    assert!(flat.contains("stature"), "{flat}");
    let coco = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut person = serde_json::json!({
            "image_id": 1, "category_id": 1, "keypoints": [9, 9, 2, 5, 5, 2], "bbox": [0, 0, 9, 9], "area": 50.0,
        });
        change(&mut person);
        let truth = serde_json::json!({
            "images": [{"id": 1, "file_name": "a.jpg", "width": 64, "height": 32}],
            "categories": [{"id": 1, "keypoints": ["left_hip", "right_hip"]}, {"id": 2, "name": "chair"}],
            "annotations": [person],
        });
        TruthSet::parse(&truth.to_string(), "t", Format::Auto, None)
    };
    let good = coco(&|_| ()).unwrap();
    assert_eq!(good.frames[0].size, Some([64.0, 32.0]));
    for area in [-5000.0, 0.0] {
        let said = said(coco(&|p| p["area"] = area.into()));
        assert!(said.contains("image 1") && said.contains("area"), "{said}");
    }
    let short = said(coco(&|p| p["keypoints"] = vec![9, 9, 2].into()));
    assert!(short.contains("6 numbers of 2 keypoints"), "{short}");
    // A chair is nobody, and without anybody there is nothing to measure.
    let chair = coco(&|p| p["category_id"] = 2.into()).unwrap();
    assert!(chair.frames[0].people.is_empty());
    let predictions = Predictions::parse(&line(0, "a.jpg", ""), "p").unwrap();
    for nobody in [
        chair,
        coco(&|p| p["keypoints"] = serde_json::json!([])).unwrap(),
    ] {
        let said = evaluate(&predictions, &nobody, &EvalOptions::default()).unwrap_err();
        assert!(said.to_string().contains("--no-people"), "{said}");
    }
}

#[test]
fn observations_and_bodies_are_not_mixed() {
    let seen = |k: u64| line(k, "a.jpg", &observation(0.8, &exact()));
    let body = |k: u64| seen(k).replace("\"joints2d\"", "\"position\":[0,0,4],\"joints2d\"");
    let parse = |lines: &[String]| Predictions::parse(&lines.join("\n"), "p");
    let said = parse(&[seen(0), body(1)]).unwrap_err().to_string();
    assert!(
        said.contains("p, line 2") && said.contains("bodies"),
        "{said}"
    );
    let mut one = parse(&[seen(0)]).unwrap();
    let said = one.append(parse(&[body(1)]).unwrap(), "q").unwrap_err();
    assert!(
        said.to_string().contains("q: expected observations"),
        "{said}"
    );
    one.append(parse(&[seen(1)]).unwrap(), "r").unwrap();
    // A run that found nobody has bodies all the same, and missed everybody.
    let fitted = |k: u64| line(k, "", "").replace("\"people\"", "\"fit_us\":9,\"people\"");
    let nobody = parse(&[fitted(0)]).unwrap();
    assert!(nobody.bodies);
    let truth = synthetic(|_| ()).unwrap();
    let report = evaluate(&nobody, &truth, &EvalOptions::default()).unwrap();
    let identity = report.identity.unwrap();
    assert_eq!((identity.truth, identity.predicted), (1, 0));
}

#[test]
fn observations_and_the_truth_move_at_one_size() {
    const STATURE: f64 = 1.4;
    let moving = |k: u64| body().map(|p| p.map(|x| x * (1.0 + 0.01 * (k * k) as f64)));
    let mut truth = synthetic(|_| ()).unwrap();
    let first = truth.frames.remove(0);
    let mut lines = Vec::new();
    for k in 0..4 {
        let joints = moving(k);
        let mut frame = first.clone();
        frame.frame = Some(k);
        frame.people[0].joints3d = Some(joints.map(Some));
        frame.people[0].stature = Some(STATURE);
        truth.frames.push(frame);
        let scale = f64::from(CANONICAL_STATURE) / STATURE;
        let own = joints.map(|p| std::array::from_fn(|i| scale * (p[i] - joints[PELVIS][i])));
        let solid: Vec<[f64; 3]> = own.to_vec();
        let person = serde_json::json!({"score": 0.9, "joints2d": exact(), "joints3d": solid});
        lines.push(line(k, "", &person.to_string()));
    }
    let predictions = Predictions::parse(&lines.join("\n"), "p").unwrap();
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    near(report.pose3d.unwrap().mpjpe_mm, 0.0);
    assert!(report.jitter.unwrap() > 1.0, "{:?}", report.jitter);
    near(report.jitter.unwrap(), report.true_motion.unwrap());
}

/// A body of `run`, seen at the joints of [`exact`] and so far to the right of them, pixels.
fn tracked(id: u64, right: f32, solid: &[[f64; 3]; BODY_JOINTS]) -> String {
    let joints2d = exact().map(|[u, v, c]| [u + right, v, c]);
    serde_json::json!({
        "id": id, "position": [0.0, 0.0, 4.0], "joints2d": joints2d, "joints3d": solid.to_vec(), "height": 1.7,
    })
    .to_string()
}

#[test]
fn whoever_is_beside_the_one_labelled_person_is_no_wrong_identity() {
    let mut truth = synthetic(|_| ()).unwrap();
    let people = [tracked(5, 0.0, &body()), tracked(6, 300.0, &body())].join(",");
    let predictions = Predictions::parse(&line(0, "", &people), "p").unwrap();
    assert!(predictions.bodies);
    for (single, expected) in [(true, 1.0), (false, 2.0 / 3.0)] {
        truth.single = single;
        let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
        near(report.identity.unwrap().idf1, expected);
    }
}

#[test]
fn bodies_and_a_truth_without_a_place_are_compared_by_their_poses() {
    let pelvis = body()[PELVIS];
    let pose: [[f64; 3]; BODY_JOINTS] = body().map(|p| std::array::from_fn(|i| p[i] - pelvis[i]));
    let mut truth = synthetic(|_| ()).unwrap();
    let first = truth.frames.remove(0);
    let mut lines = Vec::new();
    for k in 0..4 {
        let mut frame = first.clone();
        frame.frame = Some(k);
        frame.people[0].joints3d = Some(pose.map(Some));
        truth.frames.push(frame);
        // Faster and faster away from the camera, which such a truth does not tell.
        let z = 4.0 + 0.01 * (k * k) as f64;
        let solid = pose.map(|p| [p[0], p[1], p[2] + z]);
        lines.push(line(k, "", &tracked(5, 0.0, &solid)));
    }
    let predictions = Predictions::parse(&lines.join("\n"), "p").unwrap();
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    near(report.jitter.unwrap(), 0.0);
    near(report.true_motion.unwrap(), 0.0);
    let pose = report.pose3d.unwrap();
    near(pose.mpjpe_mm, 0.0);
    assert_eq!(pose.root_mm, None);
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

#[test]
fn whoever_is_labelled_without_an_area_is_neither_missed_nor_wrong() {
    let known = person(5000.0);
    // One joint is labelled, or two in a row: there is no area to say how near is near enough.
    let sizeless = |labelled: &[usize]| {
        let mut other = person(0.0);
        for k in &mut other.points {
            k.u += 300.0;
            k.v = 40.0;
            k.visibility = match labelled.contains(&k.joint.unwrap()) {
                true => 2,
                false => 0,
            };
        }
        other
    };
    for labelled in [&[4][..], &[2, 5]] {
        let truth = TruthSet {
            frames: vec![TruthFrame {
                source: "a.jpg".into(),
                people: vec![known.clone(), sizeless(labelled)],
                ..TruthFrame::default()
            }],
            ..TruthSet::default()
        };
        // Two pixels from the labels.
        let mut guess = exact().map(|[u, v, c]| [u + 301.0, v, c]);
        labelled.iter().for_each(|j| guess[*j][1] = 41.0);
        let report = |people: &[Joints2d]| {
            let people: Vec<String> = people.iter().map(|p| observation(0.9, p)).collect();
            let predictions = Predictions::parse(&line(0, "a.jpg", &people.join(",")), "p");
            let options = EvalOptions {
                min_joints: 1,
                ..EvalOptions::default()
            };
            evaluate(&predictions.unwrap(), &truth, &options).unwrap()
        };
        for found in [report(&[exact()]), report(&[exact(), guess])] {
            let row = found.finding[1];
            assert_eq!(
                (row.people, row.found, row.false_people),
                (1, 1, 0),
                "{labelled:?}"
            );
            near(found.coco.unwrap().ap, 1.0);
        }
        let stranger = exact().map(|[u, v, c]| [u + 150.0, v + 200.0, c]);
        assert_eq!(report(&[exact(), stranger]).finding[1].false_people, 1);
    }
}

#[test]
fn records_that_were_cut_off_are_read_to_their_last_whole_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p");
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        Predictions::read(&path).map(|p| p.frames.len())
    };
    let first = line(0, "straße.jpg", &observation(0.8, &exact())) + "\n";
    let text = first.clone() + &line(1, "straße.jpg", &observation(0.8, &exact()));
    assert_eq!(read(text.as_bytes()).unwrap(), 2);
    for cut in first.len() + 1..text.len() {
        assert_eq!(read(&text.as_bytes()[..cut]).unwrap(), 1, "{cut}");
    }
    // As file systems leave it after a power cut.
    let mut zeros = text.as_bytes()[..first.len() + 30].to_vec();
    zeros.resize(4096, 0);
    assert_eq!(read(&zeros).unwrap(), 1);
    // What is wrong in the middle, or from the first line on, was not cut off.
    let said = read(format!("{}\n{text}", &first[..40]).as_bytes()).unwrap_err();
    assert!(said.to_string().contains("line 1"), "{said}");
    let said = read(format!("{first}{}\n{first}", &first[..40]).as_bytes()).unwrap_err();
    assert!(said.to_string().contains("line 2"), "{said}");
    assert!(read(&first.as_bytes()[..40]).is_err());

    let mut writer =
        RecordWriter::<ObservationsRow>::create(&path, record::Format::Binary).unwrap();
    let mut message = ObservationFrame {
        count: 1,
        ..ObservationFrame::default()
    };
    for k in 0..2 {
        message.sequence = k;
        writer.write(&message, "a.jpg").unwrap();
    }
    writer.finish().unwrap();
    let whole = std::fs::read(&path).unwrap();
    assert_eq!(read(&whole).unwrap(), 2);
    assert_eq!(read(&whole[..whole.len() - 3]).unwrap(), 1);
    let said = read(&whole[..40]).unwrap_err().to_string();
    assert!(said.contains("inside its first frame"), "{said}");
}
