//! The same mistake in any verb: one line, the same code, no fault of the program.

use super::observations_of_nobody;
use crate::program::{assert_fails, edgecap, stderr};

/// Whichever verb meets it.
#[test]
fn the_same_mistake_has_the_same_code() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (full, none, out) = (at("full"), at("none"), at("out"));
    std::fs::create_dir(&full).unwrap();
    std::fs::write(at("full/mine.txt"), "keep").unwrap();
    for args in [
        &["synth", "--out", &full][..],
        &["synth", "--views", "2", "--out", &full],
        &["multiview", "--view", "a", "--out", &full],
    ] {
        assert_fails(args, 73, &["expected a new or empty folder", &full]);
    }
    for model in [&none, &full] {
        for args in [
            &["model", "info", model][..],
            &["model", "verify", model],
            &["model", "import", model, "-o", &out],
            &["model", "import", model, "--check"],
            &[
                "model",
                "run",
                model,
                "--image",
                "docs/demo.jpg",
                "--npz",
                &out,
            ],
            &["bench", "--model", model, "--threads", "1"],
            &[
                "infer", "--input", "demo", "--model", model, "--jsonl", &out,
            ],
        ] {
            assert_fails(args, 66, &[model]);
        }
    }
    let left = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 1, "only the folder is left");
}

#[test]
fn what_the_user_can_mend_is_no_fault_of_the_program() {
    for variable in ["EDGECAP_ISA", "EDGECAP_ALGORITHM"] {
        let out = edgecap()
            .args(["infer", "--input", "demo", "--jsonl", "/dev/null"])
            .env(variable, "abacus")
            .output()
            .unwrap();
        let text = stderr(&out);
        assert_eq!(out.status.code(), Some(64), "{text}");
        assert!(text.contains(variable), "{text}");
    }
    assert_fails(
        &["synth", "--frames", "1", "--out", "/dev/full"],
        73,
        &["/dev/full"],
    );
    assert_fails(
        &[
            "infer",
            "--input",
            "demo",
            "--size",
            "64x64",
            "--jsonl",
            "/dev/full",
        ],
        74,
        &["/dev/full", "full"],
    );
}

#[test]
fn what_was_asked_for_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    // Names of other films and of pictures are no folders.
    for name in ["x.mp4", "x.webm", "x.png"] {
        let to = path(name);
        let args = ["infer", "--input", "demo", "--overlay", &to];
        assert_fails(&args, 64, &[name, "ends in .avi"]);
        assert!(!folder.path().join(name).exists());
    }
    let empty = path("empty.jsonl");
    std::fs::write(&empty, "").unwrap();
    let to = path("bodies.jsonl");
    let no_bodies = "expected a record of bodies, found no frame in it";
    assert_fails(&["events", "--input", &empty], 65, &[no_bodies]);
    let args = ["fit", "--input", &empty, "--jsonl", &to];
    assert_fails(
        &args,
        65,
        &["expected a record of observations, found no frame"],
    );
    // Observations are no bodies.
    let seen = path("seen.record");
    observations_of_nobody(&seen);
    let args = ["export", &seen, "--to", &path("x.csv")];
    assert_fails(&args, 65, &["found observations", "edgecap fit --input"]);
    let png = path("x.png");
    assert_fails(&["plot", &to, "--to", &png], 64, &["ends in .svg"]);
    assert_fails(&["run", "--sise", "64x64"], 64, &["--sise", "'--size'"]);
    assert_fails(&["infer", "--threads", "no"], 64, &["'no'", "--threads"]);
}
