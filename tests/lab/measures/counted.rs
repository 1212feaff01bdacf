//! Who counts: people cut off, beyond the picture, or labelled without a size.

use edgecap::joints::BODY_JOINTS;
use edgecap::lab::eval::{EvalOptions, Predictions, TruthFrame, TruthPerson, TruthSet, evaluate};

use super::{Joints2d, body, exact, line, observation, person, synthetic};
use crate::near;

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

/// As the training kit writes photos: no 3D, and joints that are nowhere.
#[test]
fn a_joint_without_a_place_makes_nobody_larger() {
    let flat = |change: fn(&mut serde_json::Value)| {
        let truth = synthetic(|p| {
            p["joints3d"] = vec![[0.0; 3]; BODY_JOINTS].into();
            p["visibility"][0] = 0.into();
            p["joints2d"][0] = p["joints2d"][1].clone();
            change(p);
        });
        truth.unwrap().frames.remove(0).people.remove(0)
    };
    let (known, nowhere) = (
        flat(|_| ()),
        flat(|p| p["joints2d"][0] = [-900.0, -900.0].into()),
    );
    assert_eq!((known.area, known.bbox), (nowhere.area, nowhere.bbox));
    let hidden = flat(|p| {
        p["joints2d"][0] = [-900.0, -900.0].into();
        p["visibility"][0] = 3.into();
    });
    assert!(
        hidden.area > 10.0 * known.area,
        "a place behind something counts"
    );
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
fn a_phantom_in_the_corner_is_not_on_somebody_beyond_the_picture() {
    let mut truth = synthetic(|p| {
        for joint in p["joints2d"].as_array_mut().unwrap() {
            joint[0] = (joint[0].as_f64().unwrap() + 600.0).into();
        }
        p["visibility"] = vec![0; BODY_JOINTS].into();
        p["box"] = serde_json::json!([590.0, -10.0, 740.0, 80.0]);
    })
    .unwrap();
    let mut there = synthetic(|_| ()).unwrap().frames[0].people[0].clone();
    there.id = Some(2);
    there.points.iter_mut().for_each(|k| k.u += 300.0);
    truth.frames[0].people.push(there);
    let own = exact().map(|[u, v, c]| [u + 300.0, v, c]);
    let phantom = exact().map(|[u, v, c]| [0.1 * u, 0.1 * v, c]);
    let people = [own, phantom].map(|joints| observation(0.9, &joints));
    let predictions = Predictions::parse(&line(0, "", &people.join(",")), "p").unwrap();
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    for row in report.finding {
        assert_eq!((row.found, row.false_people), (1, 1), "{row:?}");
    }
}

#[test]
fn neither_a_crowd_nor_a_person_without_labels_takes_a_report_away() {
    let labelled = TruthPerson {
        joints3d: Some(body().map(Some)),
        ..person(5000.0)
    };
    let near_labels = exact().map(|[u, v, c]| [u + 4.0, v, c]);
    let text = line(0, "a.jpg", &observation(0.9, &near_labels));
    let predictions = Predictions::parse(&text, "p").unwrap();
    for crowd in [true, false] {
        let mut unlabelled = person(20_000.0);
        unlabelled.points.iter_mut().for_each(|k| k.visibility = 0);
        unlabelled.bbox = [0.0, 0.0, 512.0, 320.0];
        unlabelled.crowd = crowd;
        let truth = TruthSet {
            frames: vec![TruthFrame {
                source: "a.jpg".into(),
                people: vec![unlabelled, labelled.clone()],
                ..TruthFrame::default()
            }],
            ..TruthSet::default()
        };
        let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
        for row in report.finding {
            let counts = (row.people, row.found, row.false_people);
            assert_eq!(counts, (1, 1, 0), "crowd {crowd}");
        }
        near(report.pck.unwrap(), 1.0);
        assert_eq!(report.pose3d.unwrap().people, 1);
    }
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
