//! Bodies from several views, against bodies of the same model whose shape and pose are known: noise, a detector's
//! bias, outliers, joints not seen, and sides exchanged are put in.

mod bodies;
mod doubted;
mod lenses;
mod rays;
mod refused;
mod written;

use std::path::Path;

use edgecap::camera::View;
use edgecap::camera::calibration::write_pose2sim;
use edgecap::lab::multiview::Trial;
use edgecap::lab::multiview::own::{own, steady};
use edgecap::message::{Observation, ObservationFrame};
use edgecap::record::{Format, ObservationsRow, RecordWriter};

use crate::program::{output, stderr};

/// Calibration and records of `frames` frames of one person, as files.
pub fn files(folder: &Path, count: usize, frames: usize) -> Vec<View> {
    let Trial { views, seen, .. } = own(5, count, frames, steady(5));
    std::fs::write(folder.join("Calib.toml"), write_pose2sim(&views)).unwrap();
    record(folder, &views, &seen);
    views
}

/// Frame `k` of 30 a second as a view saw it.
pub fn seen_by(view: &View, k: usize, people: &[Observation]) -> ObservationFrame {
    let mut message = ObservationFrame {
        sequence: k as u64,
        capture_ns: k as u64 * 33_333_333,
        width: view.size[0],
        height: view.size[1],
        intrinsics: view.intrinsics(),
        count: people.len() as u32,
        ..ObservationFrame::default()
    };
    message.people[..people.len()].copy_from_slice(people);
    message
}

/// A record of every view, called like it.
fn record(folder: &Path, views: &[View], seen: &[Vec<Vec<Observation>>]) {
    for (v, view) in views.iter().enumerate() {
        let path = folder.join(format!("{}.jsonl", view.name));
        let mut file = RecordWriter::<ObservationsRow>::create(&path, Format::Jsonl).unwrap();
        for (k, frame) in seen.iter().enumerate() {
            let mut message = seen_by(view, k, &frame[v]);
            // As of live cameras of one machine.
            message.publish_ns = message.capture_ns + 40_000_000;
            file.write(&message, "").unwrap();
        }
        file.finish().unwrap();
    }
}

/// Arguments of the verb for the records of these cameras in a folder; what it writes is in the folder's `run`.
fn arguments(folder: &Path, calibration: &str, views: &[View]) -> Vec<String> {
    let at = |name: &str| folder.join(name).display().to_string();
    let records = views.iter().map(|v| at(&format!("{}.jsonl", v.name)));
    let views = records.flat_map(|record| ["--view".to_owned(), record]);
    let first = [
        "multiview",
        "--calibration",
        &at(calibration),
        "--out",
        &at("run"),
    ];
    first.map(str::to_owned).into_iter().chain(views).collect()
}

/// Runs the verb, which succeeds.
fn run(folder: &Path, calibration: &str, views: &[View]) -> std::process::Output {
    let args = arguments(folder, calibration, views);
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let out = output(&args);
    assert!(out.status.success(), "{}", stderr(&out));
    out
}
