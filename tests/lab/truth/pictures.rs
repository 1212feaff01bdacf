//! Which row of an archive is of which picture, sequence and frame.

use edgecap::lab::eval::{EvalOptions, ReadOptions, TruthSet, evaluate};

use super::{Arrays, DHP_28, FIGURE, at, crowd, h36m, measure, observed, predicted, toolbox};

#[test]
fn a_picture_of_another_folder_is_another_picture() {
    let left = at(&FIGURE, [-1.0, 0.0, 4.0]);
    let folders = [
        "TS1/img_000000.jpg",
        "TS2/img_000000.jpg",
        "TS3/img_000000.jpg",
    ];
    let truth = crowd(&DHP_28, &folders.map(|name| (name, [Some(left), None]))).truth();
    let seen = vec![observed(FIGURE, &left)];
    let report = measure(
        &predicted(vec![("mupots/TS2/img_000000.jpg", seen.clone())]),
        &truth,
    );
    assert_eq!((report.frames, report.frames_without_prediction), (3, 2));
    let twice = predicted(vec![
        ("old/TS2/img_000000.jpg", seen.clone()),
        ("new/TS2/img_000000.jpg", seen),
    ]);
    let said = evaluate(&twice, &truth, &EvalOptions::default()).unwrap_err();
    let said = said.to_string();
    assert!(
        said.contains("old/TS2") && said.contains("new/TS2"),
        "{said}"
    );
}

#[test]
fn frames_are_numbered_in_their_own_video() {
    let here = at(&FIGURE, [0.0, 0.0, 4.0]);
    let archive = |names: &[&str]| {
        let mut arrays = toolbox(&vec![("a.jpg", here); names.len()]);
        arrays.0.retain(|(n, _)| n != "imgname");
        arrays.texts("sequence", names)
    };
    let split = |name: &str| ReadOptions {
        split: Some(name.into()),
        ..h36m()
    };
    let indices = |arrays: Arrays, name: &str| -> Vec<u64> {
        let truth = arrays.read(&split(name)).unwrap();
        truth.frames.iter().filter_map(|f| f.frame).collect()
    };
    let names = ["walk", "walk", "run", "walk", "run"];
    assert_eq!(indices(archive(&names), "walk"), [0, 1, 2]);
    assert_eq!(indices(archive(&names), "run"), [0, 1]);
    let numbers = [7_i64, 9, 0, 10, 4];
    let numbered = || archive(&names).array("frames", &[5], &numbers);
    assert_eq!(indices(numbered(), "walk"), [7, 9, 10]);
    assert_eq!(indices(numbered(), "run"), [0, 4]);
    let falling = archive(&names).array("frames", &[5], &[7_i64, 6, 0, 10, 4]);
    let said = falling.read(&split("run")).unwrap_err();
    assert!(said.contains("rise in every sequence"), "{said}");
    // Frame 0 of which of them?
    let said = archive(&names).read(&h36m()).unwrap_err();
    assert!(
        said.contains("--split") && said.contains("'walk', 'run'"),
        "{said}"
    );
    assert!(archive(&["walk"; 3]).read(&h36m()).is_ok());
}

#[test]
fn rows_of_one_picture_are_people_in_it() {
    let (left, right) = (at(&FIGURE, [-1.0, 0.0, 4.0]), at(&FIGURE, [1.0, 0.0, 4.0]));
    let truth = toolbox(&[("a.jpg", left), ("b.jpg", left), ("a.jpg", right)]);
    let truth = truth.read(&h36m()).unwrap();
    let people: Vec<_> = truth
        .frames
        .iter()
        .map(|f| (&f.source[..], f.people.len()))
        .collect();
    assert_eq!(people, [("a.jpg", 2), ("b.jpg", 1)]);
    assert!(!truth.single);
}

#[test]
fn pictures_of_one_name_in_two_sequences_are_two() {
    let here = at(&FIGURE, [0.0, 0.0, 4.0]);
    let archive = || toolbox(&[("a.jpg", here), ("a.jpg", here)]).texts("sequence", &["S1", "S2"]);
    let sources = |truth: &TruthSet| -> Vec<String> {
        let frames = truth.frames.iter();
        frames.map(|f| f.source.clone()).collect()
    };
    let truth = archive().read(&h36m()).unwrap();
    assert_eq!(sources(&truth), ["S1/a.jpg", "S2/a.jpg"]);
    assert!(truth.single);
    let predictions = predicted(vec![("photos/S2/a.jpg", vec![observed(FIGURE, &here)])]);
    let report = measure(&predictions, &truth);
    assert_eq!((report.frames, report.frames_without_prediction), (2, 1));
    let second = ReadOptions {
        split: Some("S2".into()),
        ..h36m()
    };
    assert_eq!(sources(&archive().read(&second).unwrap()), ["a.jpg"]);
}
