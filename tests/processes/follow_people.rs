//! `infer --size auto`: the input follows the people in view.

use std::path::Path;

use serde_json::Value;

use crate::program::looking::{close_up, joints, people, rendered};

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
    let film = |name: &str, pictures: &[&image::DynamicImage]| {
        let film = folder.path().join(name);
        std::fs::create_dir(&film).unwrap();
        for (k, picture) in pictures.iter().enumerate() {
            picture.save(film.join(format!("{k:02}.png"))).unwrap();
        }
        film
    };
    let comes: Vec<_> = (0..24)
        .map(|k| if (8..16).contains(&k) { &near } else { &far })
        .collect();
    // So seldom that all of every picture is looked at.
    let auto = people(&film("comes", &comes), &["--fps", "1"]);
    // A fixed input sees the same in the same picture, whatever came before.
    let both = film("both", &[&far, &near]);
    let sized = |size| people(&both, &["--fps", "1", "--size", size]);
    let large = sized("512x320");
    // Which of the smaller ones it is depends on how tall the weights take this person to be.
    let smaller = ["384x240", "256x160"].map(sized);
    let all = |seen: &[Vec<Value>], expected: &Vec<Value>| seen.iter().all(|s| s == expected);
    assert!(all(&auto[..8], &large[0]));
    // a second, and half a second of patience
    assert!(
        smaller.iter().any(|s| all(&auto[14..16], &s[1])),
        "expected an input of 384x240 or 256x160 for who is close"
    );
    assert!(!auto[14..16].contains(&large[1]));
    assert!(all(&auto[22..], &large[0]));
}

/// How far apart two people's joints that both were seen for sure are on average, pixels.
fn apart(a: &Value, b: &Value) -> f64 {
    let (a, b): (Vec<[f64; 3]>, Vec<[f64; 3]>) = (joints(a), joints(b));
    let both = a.iter().zip(&b).filter(|(a, b)| a[2].min(b[2]) > 0.3);
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in both {
        sum += (a[0] - b[0]).hypot(a[1] - b[1]);
        count += 1.0;
    }
    if count > 3.0 {
        sum / count
    } else {
        f64::INFINITY
    }
}

#[test]
#[ignore = "long: the demo twice at full size on one thread"]
fn long_the_demo_is_seen_in_crops_as_it_is_in_whole_pictures() {
    let demo = Path::new("demo");
    let whole = people(demo, &["--size", "512x320"]);
    let crops = people(demo, &[]);
    assert_ne!(crops, whole, "expected crops");
    for (k, (crop, whole)) in crops.iter().zip(&whole).enumerate() {
        assert_eq!(crop.len(), whole.len(), "frame {k}");
        for person in crop {
            let nearest = whole.iter().map(|other| apart(person, other));
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            assert!(nearest < 1.0, "frame {k}: {nearest} px");
        }
    }
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
