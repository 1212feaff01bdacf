//! Calibrations that can be read in two ways.

use edgecap::camera::View;
use edgecap::camera::calibration::write_pose2sim;

use super::{files, run};
use crate::program::{output, stderr};

/// A calibration as Qualisys writes it; all lenses with `k1`.
fn qualisys(views: &[View], k1: f64) -> String {
    let camera = |v: &View| {
        let rows = (0..3).map(|r| {
            let row = v.rotation.row(r) * if r == 0 { 1.0 } else { -1.0 };
            (1..4)
                .zip(row.to_array())
                .fold(String::new(), |text, (c, x)| {
                    format!("{text} r{}{c}=\"{x}\"", r + 1)
                })
        });
        let (place, focal, centre) = (1e3 * v.position, 64.0 * v.focal, 64.0 * v.centre);
        let [right, bottom] = v.size.map(|s| s - 1);
        format!(
            "<camera active=\"1\" serial=\"{}\"><fov_video_max left=\"0\" top=\"0\" right=\"{right}\" \
             bottom=\"{bottom}\"/><transform x=\"{}\" y=\"{}\" z=\"{}\"{}/><intrinsic focalLengthU=\"{}\" \
             focalLengthV=\"{}\" centerPointU=\"{}\" centerPointV=\"{}\" radialDistortion1=\"{k1}\" \
             radialDistortion2=\"0\" tangentalDistortion1=\"0\" tangentalDistortion2=\"0\"/></camera>",
            v.name,
            place.x,
            place.y,
            place.z,
            rows.collect::<String>(),
            focal.x,
            focal.y,
            centre.x,
            centre.y,
        )
    };
    let all: String = views.iter().map(camera).collect();
    format!("<?xml version=\"1.0\"?><calibration><cameras>{all}</cameras></calibration>")
}

/// Distortion 64 times too strong: as it is written nobody is found at all.
#[test]
fn lenses_in_which_nobody_is_found_are_read_the_other_way() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let views = files(folder.path(), 3, 12);
    std::fs::write(at("all.qca.txt"), qualisys(&views, -64.0 * 0.1)).unwrap();
    let out = run(folder.path(), "all.qca.txt", &views);
    let said = stderr(&out);
    assert!(
        said.contains("divided by 64") && said.contains("the second is used"),
        "{said}"
    );
}

/// With one view, and live, rays do not tell which reading is right.
#[test]
fn a_second_reading_of_lenses_is_said_where_it_cannot_be_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let mut views = files(folder.path(), 3, 12);
    let (calibration, millimetres) = (at("all.qca.txt"), at("mm.toml"));
    std::fs::write(&calibration, qualisys(&views, -64.0 * 0.1)).unwrap();
    views.iter_mut().for_each(|v| v.position *= 1e3);
    std::fs::write(&millimetres, write_pose2sim(&views)).unwrap();
    let live = [
        "fit",
        "--cameras",
        "0,nowhere",
        "--calibration",
        &calibration,
    ];
    let live = output(&live);
    assert_eq!(live.status.code(), Some(64), "{}", stderr(&live));
    let of_one = |calibration: &str, run: &str| {
        let (first, out) = (at("0.jsonl"), at(run));
        let args = [
            "--view",
            &first,
            "--calibration",
            calibration,
            "--out",
            &out,
        ];
        output(&[&["multiview"][..], &args].concat())
    };
    let one = of_one(&calibration, "run");
    for said in [&live, &one].map(stderr) {
        assert!(
            said.contains("all.qca.txt") && said.contains("distortion divided by 64"),
            "{said}"
        );
    }
    let said = stderr(&of_one(&millimetres, "other"));
    assert!(said.contains("taken for millimetres"), "{said}");
}
