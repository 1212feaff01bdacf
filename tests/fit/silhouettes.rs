//! Masks beside joints: how broad somebody is, and that bad masks are refused.

use std::path::Path;

use edgecap::body::BodyModel;
use edgecap::body::mesh::{FREEDOM, MeshBody, PosedTree, Surface};
use edgecap::lab::multiview::own::{Walker, own, steady};
use edgecap::multiview::{Masks, MultiviewOptions};
use glam::DVec3;

use crate::many_views::files;
use crate::program::{assert_fails, output, stderr};

#[test]
fn vertices_move_as_their_derivatives_say() {
    let body = MeshBody::shipped();
    let walker = Walker::new(4, 3, DVec3::ZERO);
    let (pose, betas) = (walker.poses[3], walker.betas);
    let at = |step: &[f64; FREEDOM], betas: &[f64], vertex: usize| -> DVec3 {
        let person = body.person(betas);
        let mut posed = PosedTree::default();
        body.kinematics(&body.moved(&pose, step), &person, &mut posed);
        Surface::new(body, &person, &posed).vertex(vertex)
    };
    let person = body.person(&betas);
    let mut posed = PosedTree::default();
    body.kinematics(&pose, &person, &mut posed);
    let mut surface = Surface::new(body, &person, &posed);
    surface.prepare(10);
    for vertex in (0..body.vertices()).step_by(977) {
        let mut columns = vec![DVec3::ZERO; FREEDOM + 10];
        surface.jacobian(vertex, |k, c| columns[k] = c);
        for (k, found) in columns.into_iter().enumerate() {
            let ahead = |by: f64| {
                let (mut step, mut betas) = ([0.0; FREEDOM], betas.clone());
                if k < FREEDOM {
                    step[k] = by;
                } else {
                    betas[k - FREEDOM] += by;
                }
                at(&step, &betas, vertex)
            };
            let slope = (ahead(1e-5) - ahead(-1e-5)) / 2e-5;
            assert!(
                slope.distance(found) < 1e-6,
                "vertex {vertex}, {k}: {found}, not {slope}"
            );
        }
    }
}

#[test]
fn masks_tell_how_broad_somebody_is() {
    let (mut with, mut without) = (0.0, 0.0);
    for seed in 4..6 {
        let trial = own(seed, 3, 6, steady(seed));
        let options = MultiviewOptions {
            rate: trial.rate,
            paths: false,
            hierarchy: true,
        };
        let drawn = |frame: usize, view: usize| Some(trial.mask(frame, view));
        let shape = |masks: Option<&Masks<'_>>| {
            let errors = trial.errors(&trial.fit(options, masks, &|_| ()));
            assert!(errors.found == 1.0 && errors.joints < 0.05, "{errors:?}");
            1e3 * errors.shape.expect("of the same model")
        };
        without += shape(None);
        with += shape(Some(&drawn));
    }
    println!("shape at rest: {without:.1} mm by joints, {with:.1} mm with masks, of two people");
    assert!(
        with < 0.95 * without,
        "{with} mm, not less than {without} mm"
    );
}

#[test]
fn the_verb_reads_masks_and_refuses_others() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let views = files(folder.path(), 3, 6);
    let trial = own(5, 3, 6, steady(5));
    let masks = folder.path().join("masks");
    for (v, view) in views.iter().enumerate() {
        let own = masks.join(&view.name);
        std::fs::create_dir_all(&own).unwrap();
        for k in 0..6 {
            let mask = trial.mask(k, v);
            let [w, h] = mask.size;
            let picture = image::GrayImage::from_raw(w, h, mask.owners).unwrap();
            picture.save(own.join(format!("{k:06}.png"))).unwrap();
        }
    }
    let (calibration, run) = (at("Calib.toml"), at("run"));
    let records = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let args = |masks: &Path| -> Vec<String> {
        let mut args: Vec<String> = ["multiview", "--calibration", &calibration, "--sync", "none"]
            .map(String::from)
            .to_vec();
        let path = masks.display().to_string();
        args.extend(["--no-dct", "--out", &run, "--masks", &path].map(String::from));
        for record in &records {
            args.extend(["--view".to_owned(), record.clone()]);
        }
        args
    };
    let bodies = Path::new(&run).join("bodies.npz");
    let fails = |masks: &Path, words: &[&str]| {
        let args = args(masks);
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        assert_fails(&args, 65, words);
    };
    let refused = |masks: &Path, words: &[&str]| {
        fails(masks, words);
        assert!(!Path::new(&run).exists(), "a failed run leaves no folder");
    };
    refused(
        &folder.path().join("nowhere"),
        &["folder of masks", "nowhere"],
    );
    let misnamed = folder.path().join("misnamed");
    std::fs::create_dir_all(misnamed.join("0")).unwrap();
    std::fs::copy(masks.join("0/000000.png"), misnamed.join("0/frame0.png")).unwrap();
    refused(&misnamed, &["000000.png", "none of 6 frames", "misnamed"]);
    let first = masks.join("0/000000.png");
    let whole = std::fs::read(&first).unwrap();
    std::fs::write(&first, &whole[..40]).unwrap();
    refused(&masks, &["PNG", "000000.png"]);
    image::GrayImage::new(20, 10).save(&first).unwrap();
    refused(&masks, &["1080x1080", "20x10"]);
    std::fs::write(&first, &whole).unwrap();
    // A later one that is none: the rest was fitted, and is kept.
    let later = masks.join("120/000003.png");
    let good = std::fs::read(&later).unwrap();
    std::fs::write(&later, &good[..40]).unwrap();
    fails(&masks, &["PNG", "000003.png"]);
    assert!(bodies.exists(), "what was computed is kept");
    std::fs::remove_dir_all(&run).unwrap();
    std::fs::write(&later, good).unwrap();
    let all = args(&masks);
    let all: Vec<&str> = all.iter().map(String::as_str).collect();
    let out = output(&all);
    assert!(out.status.success(), "{}", stderr(&out));
    assert!(bodies.exists());
    let table = String::from_utf8(out.stdout).unwrap();
    assert!(
        table.lines().next().unwrap().ends_with("contours"),
        "{table}"
    );
    let report = || -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(at("run/report.json")).unwrap()).unwrap()
    };
    let whole = report();
    for view in whole["views"].as_array().unwrap() {
        assert!(view["contours"].as_u64().unwrap() > 0, "{view}");
    }
    // Masks of nobody.
    std::fs::remove_dir_all(&run).unwrap();
    for k in 0..6 {
        let empty = image::GrayImage::new(1080, 1080);
        empty.save(masks.join(format!("120/{k:06}.png"))).unwrap();
    }
    let out = output(&all);
    let said = stderr(&out);
    assert!(out.status.success(), "{said}");
    assert!(
        said.contains("no mask of camera 120 is of anybody"),
        "{said}"
    );
    assert_eq!(report()["views"][1]["contours"], 0);
}
