//! Records that were given for each other's cameras.

use edgecap::camera::calibration::write_pose2sim;
use edgecap::lab::multiview::own::{own, steady};
use edgecap::message::ObservationFrame;
use edgecap::record::{Format, ObservationsRow, RecordWriter};

use crate::program::assert_fails;

#[test]
fn views_that_were_exchanged_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let trial = own(5, 3, 30, steady(5));
    std::fs::write(at("Calib.toml"), write_pose2sim(&trial.views)).unwrap();
    for (v, view) in trial.views.iter().enumerate() {
        let path = folder.path().join(format!("{}.jsonl", view.name));
        let mut file = RecordWriter::<ObservationsRow>::create(&path, Format::Jsonl).unwrap();
        for (k, frame) in trial.seen.iter().enumerate() {
            let mut message = ObservationFrame {
                sequence: k as u64,
                capture_ns: k as u64 * 33_333_333,
                width: view.size[0],
                height: view.size[1],
                intrinsics: view.intrinsics(),
                count: frame[v].len() as u32,
                ..ObservationFrame::default()
            };
            message.people[..frame[v].len()].copy_from_slice(&frame[v]);
            file.write(&message, "").unwrap();
        }
        file.finish().unwrap();
    }
    let given = [("0", "120"), ("120", "0"), ("240", "240")];
    let given = given.map(|(camera, file)| format!("{camera}={}", at(&format!("{file}.jsonl"))));
    let (calibration, out) = (at("Calib.toml"), at("out"));
    let mut args = vec!["multiview", "--calibration", &calibration, "--out", &out];
    args.extend(given.iter().flat_map(|view| ["--view", view]));
    assert_fails(
        &args,
        65,
        &["are exchanged (0 and 120", "--view CAMERA=FILE"],
    );
    // A file that is not there is not taken for a camera's name.
    let gone = at("gone.jsonl");
    let args = ["multiview", "--calibration", &calibration, "--out", &out];
    let views = [
        "--view", &gone, "--view", &gone, "--view", &gone, "--view", &gone,
    ];
    assert_fails(&[&args[..], &views].concat(), 66, &["gone.jsonl"]);
}
