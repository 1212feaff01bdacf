//! Recorded observations, fitted again.

use std::io::Read;
use std::process::Stdio;

use super::{SMALL, cut_film};
use crate::program::{assert_fails, edgecap, stderr};

#[test]
fn an_endless_line_is_refused_before_it_fills_the_memory() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("b.jsonl");
    assert_fails(
        &[
            "fit",
            "--input",
            "/dev/zero",
            "--jsonl",
            out.to_str().unwrap(),
        ],
        65,
        &["/dev/zero", "a line of more than"],
    );
    assert!(!out.exists());
}

#[test]
fn recorded_observations_come_in_both_formats_and_from_a_pipe() {
    let folder = tempfile::tempdir().unwrap();
    let film = cut_film(folder.path());
    let path = |name: &str| folder.path().join(name);
    let seen = edgecap()
        .args(["infer", "--input"])
        .arg(&film)
        .args(SMALL)
        .arg("--jsonl")
        .arg(path("o.jsonl"))
        .arg("--record")
        .arg(path("o.ecr"))
        .output()
        .unwrap();
    assert_eq!(seen.status.code(), Some(65), "{}", stderr(&seen));
    let mut people = Vec::new();
    for input in ["o.jsonl", "o.ecr"] {
        let mut fit = edgecap()
            .args(["fit", "--input", "-", "--jsonl", "-"])
            .stdin(std::fs::File::open(path(input)).unwrap())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut text = String::new();
        fit.stdout
            .take()
            .unwrap()
            .read_to_string(&mut text)
            .unwrap();
        assert!(fit.wait().unwrap().success());
        let rows = text.lines().map(|l| {
            let row: serde_json::Value = serde_json::from_str(l).unwrap();
            row["people"].to_string()
        });
        people.push(rows.collect::<Vec<_>>());
    }
    assert!(people[0].len() >= 2 && people[0] == people[1]);
}
