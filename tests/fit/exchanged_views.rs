//! Records that were given for each other's cameras.

use crate::many_views::files;
use crate::program::assert_fails;

#[test]
fn views_that_were_exchanged_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    files(folder.path(), 3, 30);
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
