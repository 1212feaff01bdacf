//! `infer --size auto`: the input follows the people in view.

use std::path::Path;

use crate::program::looking::{close_up, people, rendered};

/// A picture of one person, rendered, and the same from a third of the distance.
fn far_and_near(folder: &Path) -> [image::DynamicImage; 2] {
    let scene = ["--frames", "1", "--people", "1", "--seed", "4"];
    let (files, truth) = rendered(&folder.join("rendered"), &scene);
    let far = image::open(&files[0]).unwrap();
    let near = close_up(&far, &truth[0]["people"][0]);
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
    let auto = people(&film, &["--fps", "4"]);
    let sized = |size| people(&film, &["--fps", "4", "--size", size]);
    let large = sized("512x320");
    // Which of the smaller ones it is depends on how tall the weights take this person to be.
    let smaller = ["384x240", "256x160"].map(sized);
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
    let demo = Path::new("demo");
    assert_eq!(people(demo, &[]), people(demo, &["--size", "512x320"]));
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
