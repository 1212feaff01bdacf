//! `infer --quality` and `--looks`: how many looks a picture gets, and at which size; which pictures get none.

use std::path::Path;

use serde_json::Value;

use crate::program::looking::{close_up, people, rendered};

/// Pictures of 512×320: three with up to five people each, and everybody's head and chest, three times as large.
fn pictures(folder: &Path) -> std::path::PathBuf {
    let stills = folder.join("stills");
    let scene = ["--frames", "3", "--people", "5", "--seed", "8"];
    let (files, truth) = rendered(&folder.join("rendered"), &scene);
    std::fs::create_dir(&stills).unwrap();
    for (k, (file, frame)) in files.iter().zip(&truth).enumerate() {
        let far = image::open(file).unwrap();
        far.save(stills.join(format!("{k}-far.png"))).unwrap();
        for (n, person) in frame["people"].as_array().unwrap().iter().enumerate() {
            let near = close_up(&far, person);
            near.save(stills.join(format!("{k}-near-{n}.png"))).unwrap();
        }
    }
    stills
}

#[test]
fn the_best_quality_takes_everybody_once_from_one_of_two_looks() {
    let folder = tempfile::tempdir().unwrap();
    let stills = pictures(folder.path());
    let [near, far] = ["384x240", "768x480"].map(|size| people(&stills, &["--size", size]));
    let best = people(&stills, &[]);
    let few = folder.path().join("few");
    std::fs::create_dir(&few).unwrap();
    for name in ["0-far.png", "0-near-0.png"] {
        std::fs::copy(stills.join(name), few.join(name)).unwrap();
    }
    for options in [
        &["--quality", "best"][..],
        &["--quality", "best", "--fps", "4"],
    ] {
        assert_eq!(
            best[..2],
            people(&few, options),
            "photos and films: {options:?}"
        );
    }
    assert!(best.len() > 6, "{}", best.len());
    // In 2D they may be between the looks.
    let is = |a: &Value, b: &Value| a["joints3d"] == b["joints3d"] && a["score"] == b["score"];
    let (mut from, mut between) = ([0, 0], 0);
    for (k, all) in best.iter().enumerate() {
        assert!(all.len() >= near[k].len().min(far[k].len()), "{k}");
        for (n, person) in all.iter().enumerate() {
            let is_told = all[..n].iter().any(|p| is(p, person));
            assert!(!is_told, "{k}: somebody comes twice");
            let looks = [&near[k], &far[k]];
            let at = looks.map(|look| look.iter().any(|p| is(p, person)));
            assert!(at[0] || at[1], "{k}: nobody of either look");
            from[0] += usize::from(at[0]);
            from[1] += usize::from(at[1]);
            between += usize::from(!looks.iter().any(|look| look.contains(person)));
        }
    }
    assert!(
        between > 0,
        "who is seen twice is where both looks put them"
    );
    assert!(
        from[0] > 0 && from[1] > 0,
        "small people from afar, large ones from near: {from:?}"
    );
}

#[test]
fn the_others_look_once() {
    let folder = tempfile::tempdir().unwrap();
    let stills = pictures(folder.path());
    let sized = |size| people(&stills, &["--size", size]);
    let quality = |options: &[&str]| people(&stills, &[&["--quality"], options].concat());
    assert_eq!(quality(&["fast"]), sized("384x240"));
    assert_eq!(quality(&["balanced"]), sized("512x320"));
    // Films begin with the largest input that they may take.
    let first = |people: Vec<Vec<Value>>| people.into_iter().next().unwrap();
    let film = |options: &[&str]| first(quality(&[options, &["--fps", "4"]].concat()));
    assert_eq!(film(&["fast"]), first(sized("384x240")));
    assert_eq!(film(&["balanced"]), first(sized("512x320")));
}

#[test]
fn with_fewer_looks_everybody_is_in_every_picture_all_the_same() {
    let demo = Path::new("demo");
    let (all, fewer) = (people(demo, &[]), people(demo, &["--looks", "4"]));
    let count = |of: &[Vec<Value>]| of.iter().map(Vec::len).sum::<usize>();
    // Who is new is looked at twice.
    assert_eq!((all.len(), &all[..2]), (fewer.len(), &fewer[..2]));
    let followed = all.iter().zip(&fewer).filter(|(a, b)| a != b).count();
    assert!(5 * followed > all.len(), "{followed} of {}", all.len());
    let missed = count(&all).abs_diff(count(&fewer));
    assert!(20 * missed < count(&all), "{missed} of {}", count(&all));
}

#[test]
fn looks_are_counted_where_pictures_follow_each_other_and_each_gets_one() {
    let folder = tempfile::tempdir().unwrap();
    let stills = pictures(folder.path());
    let photos = [
        "infer",
        "--looks",
        "15",
        "--input",
        stills.to_str().unwrap(),
    ];
    crate::program::assert_fails(&photos, 64, &["--looks", "found photos"]);
    let twice = [
        "infer",
        "--input",
        "demo",
        "--quality",
        "best",
        "--looks",
        "15",
    ];
    crate::program::assert_fails(&twice, 64, &["--looks", "--quality best"]);
    for wrong in ["0", "0.5", "nan", "many"] {
        let args = ["infer", "--input", "demo", "--looks", wrong];
        crate::program::assert_fails(&args, 64, &[wrong, "expected looks per second"]);
    }
}

#[test]
fn the_input_is_chosen_in_one_way() {
    let args = ["infer", "--input", "demo", "--quality", "best"];
    let both = [&args[..], &["--size", "256x160"]].concat();
    crate::program::assert_fails(&both, 64, &["--quality", "--size", "found both"]);
    let wrong = ["infer", "--input", "demo", "--quality", "superb"];
    crate::program::assert_fails(&wrong, 64, &["superb", "balanced"]);
}
