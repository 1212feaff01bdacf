//! `infer --quality`: how many looks a picture gets, and at which size.

use std::path::Path;

use serde_json::Value;

/// People per picture, as `infer` writes them.
fn people(input: &Path, options: &[&str]) -> Vec<Vec<Value>> {
    let result = tempfile::tempdir().unwrap();
    let file = result.path().join("people.jsonl");
    let (input, jsonl) = (input.to_str().unwrap(), file.to_str().unwrap());
    let fixed = [
        "infer",
        "--threads",
        "1",
        "--input",
        input,
        "--jsonl",
        jsonl,
    ];
    let out = crate::program::output(&[&fixed[..], options].concat());
    assert!(out.status.success(), "{}", crate::program::stderr(&out));
    let text = std::fs::read_to_string(file).unwrap();
    let frames = text
        .lines()
        .map(|l| serde_json::from_str::<Value>(l).unwrap());
    frames
        .map(|f| f["people"].as_array().unwrap().clone())
        .collect()
}

/// Pictures of 512×320 with five people each.
fn pictures(folder: &Path) -> std::path::PathBuf {
    let (all, stills) = (folder.join("rendered"), folder.join("stills"));
    let scene = ["synth", "--stills", "--frames", "3", "--people", "5"];
    let out = ["--seed", "8", "--out", all.to_str().unwrap()];
    let made = crate::program::output(&[&scene[..], &out].concat());
    assert!(made.status.success(), "{}", crate::program::stderr(&made));
    std::fs::create_dir(&stills).unwrap();
    for entry in std::fs::read_dir(&all).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "jpg") {
            std::fs::copy(&path, stills.join(path.file_name().unwrap())).unwrap();
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
    assert_eq!(best, people(&stills, &["--quality", "best"]));
    assert_eq!(
        best,
        people(&stills, &["--quality", "best", "--fps", "4"]),
        "films, too"
    );
    assert_eq!(best.len(), 3);
    let mut from = [0, 0];
    for (k, all) in best.iter().enumerate() {
        assert!(all.len() >= near[k].len().min(far[k].len()), "{k}");
        for (n, person) in all.iter().enumerate() {
            assert!(!all[..n].contains(person), "{k}: somebody comes twice");
            let at = [&near[k], &far[k]].map(|look| look.contains(person));
            assert!(at[0] || at[1], "{k}: nobody of either look");
            from[0] += usize::from(at[0]);
            from[1] += usize::from(at[1]);
        }
    }
    assert!(from[0] > 0 && from[1] > 0, "{from:?}");
}

#[test]
fn the_others_look_once() {
    let folder = tempfile::tempdir().unwrap();
    let stills = pictures(folder.path());
    let sized = |size| people(&stills, &["--size", size]);
    let quality = |options: &[&str]| people(&stills, &[&["--quality"], options].concat());
    assert_eq!(quality(&["fast"]), sized("384x240"));
    assert_eq!(quality(&["balanced"]), sized("512x320"));
    // A film whose people stand so far away that no smaller input is wanted.
    assert_eq!(quality(&["fast", "--fps", "4"]), sized("384x240"));
    assert_eq!(quality(&["balanced", "--fps", "4"]), sized("512x320"));
}

#[test]
fn the_input_is_chosen_in_one_way() {
    let args = ["infer", "--input", "demo", "--quality", "best"];
    let both = [&args[..], &["--size", "256x160"]].concat();
    crate::program::assert_fails(&both, 64, &["--quality", "--size", "found both"]);
    let wrong = ["infer", "--input", "demo", "--quality", "superb"];
    crate::program::assert_fails(&wrong, 64, &["superb", "balanced"]);
}
