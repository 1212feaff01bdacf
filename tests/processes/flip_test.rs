//! `infer --flip-test` on pictures and their mirror images: it sees the same people in both.

use std::path::Path;

use edgecap::joints::MIRROR;
use serde_json::Value;

/// (u, v, confidence) of the joints of everybody in a picture, best first.
type People = Vec<Vec<[f64; 3]>>;

const WIDTH: u32 = 256;

/// What `infer` with these options reports about the pictures of a folder.
fn people(pictures: &Path, options: &[&str]) -> Vec<People> {
    let result = tempfile::tempdir().unwrap();
    let file = result.path().join("people.jsonl");
    let (input, file) = (pictures.to_str().unwrap(), file.to_str().unwrap());
    let fixed = ["infer", "--input", input, "--jsonl", file];
    let size = ["--size", "256x160", "--threads", "1"];
    let out = crate::program::output(&[&fixed[..], &size, options].concat());
    assert!(out.status.success(), "{}", crate::program::stderr(&out));
    let text = std::fs::read_to_string(file).unwrap();
    let joints = |person: &Value| serde_json::from_value(person["joints2d"].clone()).unwrap();
    text.lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap())
        .map(|frame| {
            frame["people"]
                .as_array()
                .unwrap()
                .iter()
                .map(joints)
                .collect()
        })
        .collect()
}

/// Left and right exchanged.
fn mirrored(person: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let across = |j: usize| {
        let [u, v, confidence] = person[MIRROR[j]];
        let u = if confidence > 0.0 {
            f64::from(WIDTH - 1) - u
        } else {
            u
        };
        [u, v, confidence]
    };
    (0..person.len()).map(across).collect()
}

/// Greatest distance of two people's joints; infinite where one lacks a joint of the other.
fn apart(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let distance = |(p, q): (&[f64; 3], &[f64; 3])| match (p[2] > 0.0, q[2] > 0.0) {
        (true, true) => (p[0] - q[0]).hypot(p[1] - q[1]),
        (false, false) => 0.0,
        _ => f64::INFINITY,
    };
    a.iter().zip(b).map(distance).fold(0.0, f64::max)
}

#[test]
fn a_picture_and_its_mirror_image_show_the_same_people() {
    let folder = tempfile::tempdir().unwrap();
    let (rendered, pictures) = (
        folder.path().join("rendered"),
        folder.path().join("pictures"),
    );
    let out = rendered.to_str().unwrap();
    let scene = ["--frames", "2", "--people", "3", "--seed", "4"];
    let size = ["--width", "256", "--height", "160"];
    let made =
        crate::program::output(&[&["synth", "--stills", "--out", out][..], &scene, &size].concat());
    assert!(made.status.success(), "{}", crate::program::stderr(&made));
    std::fs::create_dir(&pictures).unwrap();
    for k in 0..2 {
        let picture = image::open(rendered.join(format!("00000{k}.jpg"))).unwrap();
        picture.save(pictures.join(format!("{k}.png"))).unwrap();
        picture
            .fliph()
            .save(pictures.join(format!("{k}m.png")))
            .unwrap();
    }

    // How far everybody of a picture is from the nearest person of its mirror image. Scores weigh left and right
    // differently, so people may come in another order.
    let distances = |pair: &[People]| -> Vec<f64> {
        let nearest = |person: &Vec<[f64; 3]>| {
            let others = pair[1].iter().map(|other| apart(person, &mirrored(other)));
            others.fold(f64::INFINITY, f64::min)
        };
        pair[0].iter().map(nearest).collect()
    };
    let same = |pair: &[People]| {
        pair[0].len() == pair[1].len() && distances(pair).iter().all(|d| *d < 0.01)
    };

    let with = people(&pictures, &["--flip-test"]);
    for pair in with.chunks_exact(2) {
        let distances = distances(pair);
        assert!(same(pair), "{distances:?} px apart");
    }
    let total: usize = with.iter().step_by(2).map(Vec::len).sum();
    assert!(total >= 2, "found {total} people");

    // Without it the network judges a picture and its mirror image differently.
    let without = people(&pictures, &[]);
    assert!(!without.chunks_exact(2).all(same));
}
