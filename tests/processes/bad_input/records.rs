//! Records that are none, are cut off, hold nobody, or whose times do not rise.

use edgecap::message::{BodyFrame, Intrinsics, ObservationFrame};
use edgecap::record::{BodiesRow, Format, ObservationsRow, RecordWriter};

use super::observations_of_nobody;
use crate::program::{assert_fails, output, stderr, stream};

/// A folder opens as a file does: without a look at what was opened it fails as a disk would.
#[test]
fn a_folder_is_no_record() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let take = at("take");
    std::fs::create_dir(&take).unwrap();
    let name = stream("folder");
    for args in [
        &["events", "--input", &take][..],
        &["view", "--record", &take, "--listen", "127.0.0.1:0"],
        &["plot", &take, "--to", &at("plot.svg")],
        &["export", &take, "--to", &at("take.bvh")],
        &["fit", "--input", &take, "--jsonl", &at("bodies.jsonl")],
        &["multiview", "--view", &take, "--out", &at("shapes")],
        &["replay", &take, "--name", &name],
    ] {
        let expected =
            format!("cannot open {take}: expected a record, found a folder; check the path");
        assert_fails(args, 66, &[&expected]);
    }
    let left = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 1, "only the folder is left");
}

#[test]
fn a_record_that_is_cut_off_inside_its_first_frame_holds_none() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (seen, bodies, to) = (at("seen.record"), at("bodies.record"), at("to.jsonl"));
    observations_of_nobody(&seen);
    let mut writer = RecordWriter::<BodiesRow>::create(bodies.as_ref(), Format::Binary).unwrap();
    writer.write(&BodyFrame::default(), "").unwrap();
    writer.finish().unwrap();
    for record in [&seen, &bodies] {
        let bytes = std::fs::read(record).unwrap();
        std::fs::write(record, &bytes[..bytes.len() - 1]).unwrap();
    }
    let fit = ["fit", "--input", &seen, "--jsonl", &to];
    assert_fails(&fit, 65, &["seen.record", "cut off inside its first frame"]);
    assert!(!folder.path().join("to.jsonl").exists());
    let export = ["export", &bodies, "--to", &at("x.csv")];
    assert_fails(&export, 65, &["bodies.record"]);
    let view = ["view", "--record", &bodies, "--listen", "127.0.0.1:0"];
    let cut = "cut off inside its first frame";
    assert_fails(&view, 65, &["bodies.record", cut]);
    let again = at("again.record");
    std::fs::copy(&seen, &again).unwrap();
    let views = [("a", &seen), ("b", &again)].map(|(name, file)| format!("--view={name}={file}"));
    let calibrate = ["calibrate", "--out", &to, &views[0], &views[1]];
    assert_fails(&calibrate, 65, &["seen.record", cut]);
    let multiview = ["multiview", "--out", &at("run"), "--view", &seen];
    assert_fails(&multiview, 65, &["seen.record", cut]);
}

#[test]
fn times_that_do_not_rise_are_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (seen, to) = (at("seen.jsonl"), at("to.jsonl"));
    let mut writer = RecordWriter::<ObservationsRow>::create(seen.as_ref(), Format::Jsonl).unwrap();
    for sequence in 0..4 {
        let frame = ObservationFrame {
            sequence,
            width: 640,
            height: 480,
            intrinsics: Intrinsics::from_horizontal_fov(640, 480, 60.0),
            ..ObservationFrame::default()
        };
        writer.write(&frame, "").unwrap();
    }
    writer.finish().unwrap();
    let fit = ["fit", "--input", &seen, "--jsonl", &to];
    for (more, warnings) in [(&[][..], 1), (&["--stills"], 0)] {
        let out = output(&[&fit[..], more].concat());
        let said = stderr(&out);
        assert!(out.status.success(), "{said}");
        let told = said
            .matches("expected times that rise, found frame 2")
            .count();
        assert_eq!(told, warnings, "{said}");
        assert!(said.contains(&format!("4 frames → {to}")), "{said}");
        let lines = std::fs::read_to_string(&to).unwrap();
        assert_eq!(lines.lines().count(), 4);
    }
}

#[test]
fn a_recording_of_nobody_ends_in_time_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("x.record");
    let name = stream("record-nobody");
    let args = [
        "record",
        to.to_str().unwrap(),
        "--camera",
        &name,
        "--seconds",
        "1",
    ];
    assert_fails(&args, 69, &[&name, "nothing was recorded"]);
    assert!(!to.exists());
}
