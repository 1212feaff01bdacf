//! Results that cannot be written, or not to their end.

use crate::program::{assert_fails, edgecap, stderr, stream};

/// The system would end the process with a signal.
#[test]
fn a_file_that_may_not_grow_any_further_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("bodies.jsonl");
    let run = edgecap();
    let mut limited = std::process::Command::new("sh");
    limited.envs(
        run.get_envs()
            .filter_map(|(key, value)| Some((key, value?))),
    );
    let script =
        "ulimit -f 20; exec \"$0\" run --input demo --size 256x160 --threads 1 --jsonl \"$1\"";
    limited.args(["-c", script]).arg(run.get_program()).arg(&to);
    let out = limited.output().unwrap();
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(74), "{said}");
    let told: Vec<&str> = said
        .lines()
        .filter(|l| l.starts_with("edgecap: "))
        .collect();
    assert_eq!(told.len(), 1, "{said}");
    assert!(told[0].contains("bodies.jsonl: writing stopped"), "{said}");
    let kept = std::fs::read_to_string(&to).unwrap();
    assert!(kept.ends_with("}\n"), "whole lines are kept");
}

#[test]
fn outputs_that_cannot_be_written() {
    let out = ["--jsonl", "/proc/nowhere/out.jsonl"];
    assert_fails(
        &["infer", "--input", "demo", out[0], out[1]],
        73,
        &["/proc/nowhere/out.jsonl"],
    );
    assert_fails(
        &[
            "run",
            "--input",
            "demo",
            "--name",
            &stream("out"),
            out[0],
            out[1],
        ],
        73,
        &["/proc/nowhere/out.jsonl"],
    );
}
