//! `infer --flip-test` on pictures and their mirror images: it sees the same people in both.

use std::path::Path;

use edgecap::joints::MIRROR;

use crate::program::looking;

/// (u, v, confidence) of the joints of everybody in a picture, best first.
type People = Vec<Vec<[f64; 3]>>;

const WIDTH: u32 = 256;

/// What `infer` with these options reports about the pictures of a folder.
fn people(pictures: &Path, options: &[&str]) -> Vec<People> {
    let size = ["--size", "256x160"];
    let all = looking::people(pictures, &[&size[..], options].concat());
    all.iter()
        .map(|of| of.iter().map(looking::joints).collect())
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
    let scene = ["--frames", "2", "--people", "3", "--seed", "4"];
    let size = ["--width", "256", "--height", "160"];
    let (files, _) = looking::rendered(&rendered, &[&scene[..], &size].concat());
    std::fs::create_dir(&pictures).unwrap();
    for (k, file) in files.iter().enumerate() {
        let picture = image::open(file).unwrap();
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
