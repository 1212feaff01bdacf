//! Views that see nobody of the others' people, or too little of them, and those that only seem to.

use edgecap::camera::calibration::write_pose2sim;
use edgecap::lab::multiview::Trial;
use edgecap::lab::multiview::own::{Walker, observe, own};
use edgecap::lab::synth::detector::Flaws;
use glam::{DMat3, DVec3};

use super::{arguments, files, record, run};
use crate::program::assert_fails;

/// A camera that was moved far after its calibration: none of its sights is anybody's.
#[test]
fn a_view_that_sees_nobody_of_the_others_people_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let mut views = files(folder.path(), 4, 12);
    views[1].rotation = DMat3::from_rotation_y(0.3) * views[1].rotation;
    std::fs::write(at("Calib.toml"), write_pose2sim(&views)).unwrap();
    let out = run(folder.path(), "Calib.toml", &views);
    let table = String::from_utf8(out.stdout).unwrap();
    let line = table
        .lines()
        .find(|l| l.starts_with(&views[1].name))
        .unwrap();
    assert!(line.contains("check its place"), "{table}");
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(at("run/report.json")).unwrap()).unwrap();
    assert_eq!(
        (&report["views"][1]["sights"], &report["views"][1]["told"]),
        (&0.into(), &12.into())
    );
}

/// Twelve people walk by far behind, whom one view shows and the others do not.
#[test]
fn a_view_that_sees_bystanders_behind_the_others_people_is_not_doubted() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let Trial {
        views, mut seen, ..
    } = own(5, 3, 12, Flaws::NONE);
    std::fs::write(at("Calib.toml"), write_pose2sim(&views)).unwrap();
    let behind = |k: usize| DVec3::new(0.9 * (k as f64 - 5.5), 0.0, -14.0 - 0.7 * k as f64);
    let crowd: Vec<Walker> = (0..12)
        .map(|k| Walker::new(12, 40 + k as u64, behind(k)))
        .collect();
    let beside = observe(&views[..1], &crowd, Flaws::NONE, 6);
    for (frame, more) in seen.iter_mut().zip(beside) {
        frame[0].extend(more.into_iter().flatten());
    }
    record(folder.path(), &views, &seen);
    let out = run(folder.path(), "Calib.toml", &views);
    let table = String::from_utf8(out.stdout).unwrap();
    assert!(!table.contains("check its place"), "{table}");
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(at("run/report.json")).unwrap()).unwrap();
    let of = |name: &str| report["views"][0][name].as_u64().unwrap();
    assert_eq!((of("sights"), of("shown")), (12, 12));
    assert!(of("told") > 120, "{report}");
}

/// Cameras that show people down to the belt.
#[test]
fn upper_bodies_alone_are_said_to_be_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let Trial {
        views, mut seen, ..
    } = own(5, 3, 12, Flaws::NONE);
    std::fs::write(at("Calib.toml"), write_pose2sim(&views)).unwrap();
    for seen in seen.iter_mut().flatten().flatten() {
        seen.joints2d[8..].fill([0.0; 3]);
    }
    record(folder.path(), &views, &seen);
    let args = arguments(folder.path(), "Calib.toml", &views);
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    assert_fails(&args, 65, &["neck and hips", "12 frames"]);
}
