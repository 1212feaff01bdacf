//! Who is found, by how much of them can be seen and by how many people there are: pictures counted by hand.

use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use edgecap::lab::eval::{
    EvalOptions, Keypoint, Predictions, RecallRow, Report, TruthFrame, TruthPerson, TruthSet,
    evaluate,
};

/// Somebody whose neck is at `x`, with the first `labelled` joints in sight.
fn person(x: f64, labelled: usize) -> TruthPerson {
    let point = |j: usize| {
        let seen = if j < labelled { 2 } else { 0 };
        Keypoint::at(j, x + 3.0 * j as f64, 9.0 * j as f64, seen)
    };
    TruthPerson {
        points: (0..EVIDENCE_JOINTS).map(point).collect(),
        area: 4000.0,
        bbox: [x, 0.0, 40.0, 120.0],
        ..TruthPerson::default()
    }
}

/// A prediction that lies on such a person exactly.
fn found(x: f64) -> serde_json::Value {
    let joints: Vec<[f64; 3]> = (0..EVIDENCE_JOINTS)
        .map(|j| [x + 3.0 * j as f64, 9.0 * j as f64, 1.0])
        .collect();
    serde_json::json!({"score": 0.9, "joints2d": joints, "joints3d": vec![[0.0; 3]; BODY_JOINTS]})
}

/// Pictures of people (place, joints in sight, found, to be ignored).
fn measure(pictures: &[&[(f64, usize, bool, bool)]]) -> Report {
    let (mut frames, mut lines) = (Vec::new(), Vec::new());
    for (k, people) in pictures.iter().enumerate() {
        let source = format!("{k}.jpg");
        let truth = |&(x, labelled, _, crowd): &(f64, usize, bool, bool)| TruthPerson {
            crowd,
            ..person(x, labelled)
        };
        let predicted: Vec<_> = people.iter().filter(|p| p.2).map(|p| found(p.0)).collect();
        lines.push(
            serde_json::json!({"frame": k, "time_ns": 0, "source": source, "width": 512, "height": 320, "people": predicted})
                .to_string(),
        );
        frames.push(TruthFrame {
            people: people.iter().map(truth).collect(),
            source,
            ..TruthFrame::default()
        });
    }
    let truth = TruthSet {
        frames,
        ..TruthSet::default()
    };
    let predictions = Predictions::parse(&lines.join("\n"), "p").unwrap();
    evaluate(&predictions, &truth, &EvalOptions::default()).unwrap()
}

#[test]
fn heights_are_of_one_scale() {
    // Twice the network's input: 120 px are 60 there. One picture is predicted, one is not.
    let size = [1024.0, 640.0];
    let frame = |k: usize, size: Option<[f64; 2]>| TruthFrame {
        people: vec![person(0.0, 14)],
        source: format!("{k}.jpg"),
        size,
        ..TruthFrame::default()
    };
    let line = serde_json::json!({"frame": 0, "time_ns": 0, "source": "0.jpg", "width": size[0], "height": size[1], "people": [found(0.0)]});
    let predictions = Predictions::parse(&line.to_string(), "p").unwrap();
    let report = |sizes: [Option<[f64; 2]>; 2], min_height: f64| {
        let frames = sizes.into_iter().enumerate();
        let truth = TruthSet {
            frames: frames.map(|(k, size)| frame(k, size)).collect(),
            ..TruthSet::default()
        };
        let options = EvalOptions {
            min_height,
            ..EvalOptions::default()
        };
        evaluate(&predictions, &truth, &options).unwrap()
    };
    let known = report([Some(size); 2], 0.0);
    assert_eq!(counts(&known.recall_by_height), [(60.0, 2, 1.0)]);
    // Nothing tells how large the picture is that nobody predicted.
    let unknown = report([None; 2], 0.0);
    assert_eq!(counts(&unknown.recall_by_height), [(60.0, 1, 1.0)]);
    assert_eq!(unknown.finding[1].people, 2);
    let tall = report([None; 2], 50.0);
    assert_eq!(tall.finding[1].people, 1);
    assert_eq!(counts(&tall.recall_by_company), [(1.0, 1, 1.0)]);
    assert_eq!(counts(&tall.recall_by_joints), [(14.0, 1, 1.0)]);
    assert_eq!(report([Some(size); 2], 50.0).finding[1].people, 2);
    // Of nobody there is no share.
    let nobody = report([Some(size); 2], 1000.0);
    let row = nobody.finding[1];
    assert_eq!(
        (row.people, row.recall, row.precision, row.mean_oks),
        (0, None, None, None)
    );
    assert!(nobody.recall_by_company.is_empty() && nobody.recall_by_height.is_empty());
    assert!(nobody.recall_by_joints.is_empty());
    let text = nobody.to_string();
    let said = "recall – of 0, precision –, 0 false, mean OKS –";
    assert!(text.contains(said), "{text}");
    let json = serde_json::to_value(&nobody).unwrap();
    assert!(json["finding"][1]["recall"].is_null(), "{json}");
}

/// From, people, found of every row.
fn counts(rows: &[RecallRow]) -> Vec<(f64, usize, f64)> {
    rows.iter()
        .map(|r| (r.from, r.people, (r.recall * r.people as f64).round()))
        .collect()
}

#[test]
fn rows_hold_the_people_of_their_kind() {
    let report = measure(&[
        // one alone, in sight
        &[(0.0, 14, true, false)],
        // of two one is missed; a third is nobody's to find
        &[
            (0.0, 9, true, false),
            (200.0, 14, false, false),
            (400.0, 14, false, true),
        ],
        // of five two are missed, one of them hardly in sight
        &[
            (0.0, 14, true, false),
            (90.0, 12, true, false),
            (180.0, 5, false, false),
            (270.0, 11, false, false),
            (360.0, 8, true, false),
        ],
    ]);
    assert_eq!(
        counts(&report.recall_by_joints),
        [(1.0, 1, 0.0), (8.0, 2, 2.0), (11.0, 2, 1.0), (14.0, 3, 2.0)]
    );
    assert_eq!(
        counts(&report.recall_by_company),
        [(1.0, 1, 1.0), (2.0, 2, 1.0), (5.0, 4, 3.0)]
    );
    assert_eq!(counts(&report.recall_by_height), [(100.0, 7, 5.0)]);
    let text = report.to_string();
    for row in [
        "  100-150 px tall, OKS 0.50         71.4 % of 7",
        "  1-7 joints in sight, OKS 0.50     0.0 % of 1",
        "  11-13 joints in sight, OKS 0.50   50.0 % of 2",
        "  from 14 joints in sight, OKS 0.50",
        "  1 in the picture, OKS 0.50        100.0 % of 1",
        "  2 in the picture, OKS 0.50        50.0 % of 2",
        "  from 5 in the picture, OKS 0.50   75.0 % of 4",
    ] {
        assert!(text.contains(row), "{row}\n{text}");
    }
}
