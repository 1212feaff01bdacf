//! `infer --size auto`: the input follows the people in view.

use std::path::Path;

use image::imageops::FilterType;
use serde_json::Value;

/// People per frame as `infer` writes them.
fn people(input: &[&str], options: &[&str]) -> Vec<Value> {
    let result = tempfile::tempdir().unwrap();
    let file = result.path().join("people.jsonl");
    let fixed = ["infer", "--jsonl", file.to_str().unwrap(), "--threads", "1"];
    let out = crate::program::output(&[&fixed[..], input, options].concat());
    assert!(out.status.success(), "{}", crate::program::stderr(&out));
    let text = std::fs::read_to_string(file).unwrap();
    text.lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap()["people"].clone())
        .collect()
}

/// A picture of one person, rendered, and the same from a third of the distance: head and chest, three times as large.
fn far_and_near(folder: &Path) -> [image::DynamicImage; 2] {
    let out = folder.join("rendered");
    let scene = ["--frames", "1", "--people", "1", "--seed", "4"];
    let made = crate::program::output(
        &[
            &["synth", "--stills", "--out", out.to_str().unwrap()][..],
            &scene,
        ]
        .concat(),
    );
    assert!(made.status.success(), "{}", crate::program::stderr(&made));
    let far = image::open(out.join("000000.jpg")).unwrap();
    let truth = std::fs::read_to_string(out.join("truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    let person = &truth["frames"][0]["people"][0];
    let at: Vec<[f64; 2]> = serde_json::from_value(person["joints2d"].clone()).unwrap();
    let (w, h) = (512 / 3, 320 / 3);
    let left = (at[1][0] as u32).saturating_sub(w / 2).min(512 - w);
    let upper = (at[0][1] as u32).saturating_sub(10).min(320 - h);
    let near = far
        .crop_imm(left, upper, w, h)
        .resize_exact(512, 320, FilterType::CatmullRom);
    [far, near]
}

#[test]
fn somebody_who_comes_close_is_looked_at_with_a_smaller_input() {
    let folder = tempfile::tempdir().unwrap();
    let [far, near] = far_and_near(folder.path());
    let film = folder.path().join("film");
    std::fs::create_dir(&film).unwrap();
    for k in 0..24 {
        let picture = if (8..16).contains(&k) { &near } else { &far };
        picture.save(film.join(format!("{k:02}.png"))).unwrap();
    }
    let input = ["--input", film.to_str().unwrap(), "--fps", "4"];
    let auto = people(&input, &[]);
    let large = people(&input, &["--size", "512x320"]);
    // Which of the smaller ones it is depends on how tall the weights take this person to be.
    let smaller = ["384x240", "256x160"].map(|size| people(&input, &["--size", size]));
    assert_eq!(auto[..8], large[..8]);
    // a second, and half a second of patience
    assert!(
        smaller.iter().any(|s| auto[14..16] == s[14..16]),
        "expected an input of 384x240 or 256x160 for who is close"
    );
    assert_ne!(auto[14..16], large[14..16]);
    assert_eq!(auto[22..], large[22..]);
}

#[test]
#[ignore = "long: the demo twice at full size on one thread"]
fn long_the_demo_needs_no_other_input() {
    let demo = ["--input", "demo"];
    assert_eq!(people(&demo, &[]), people(&demo, &["--size", "512x320"]));
}

#[test]
fn photos_have_nothing_before_them() {
    let folder = tempfile::tempdir().unwrap();
    let [far, _] = far_and_near(folder.path());
    let photo = folder.path().join("photo.png");
    far.save(&photo).unwrap();
    let photo = photo.to_str().unwrap();
    let args = [
        "infer",
        "--input",
        photo,
        "--jsonl",
        "/dev/null",
        "--size",
        "auto",
    ];
    crate::program::assert_fails(&args, 64, &["--size auto", "photos", "--size WxH"]);
}
