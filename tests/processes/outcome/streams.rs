//! Streams that are lost, taken by another process, or not asked for.

use std::io::{BufRead, BufReader, Read};
use std::process::Stdio;
use std::time::Duration;

use edgecap::capture::{AviReader, Source, demo};
use edgecap::message::{BodyFrame, HealthFrame, ObservationFrame};
use edgecap_client::Publisher;

use super::{SMALL, count, photo};
use crate::program::{edgecap, stderr, stream};

/// A user's last session has ended, and with it the folder of the shared memory.
#[test]
fn a_film_is_seen_to_its_end_whatever_becomes_of_its_streams() {
    let clip = AviReader::new(std::io::Cursor::new(demo::CLIP), "demo").unwrap();
    for verb in ["run", "infer"] {
        let folder = crate::program::short_folder();
        let session = folder.path().join("session");
        std::fs::create_dir(&session).unwrap();
        let name = stream("streams-gone");
        let mut child = edgecap()
            .args([verb, "--input", "demo", "--name", &name, "--jsonl", "-"])
            .args(SMALL)
            .env("EDGECAP_RUNTIME_DIR", session.join("edgecap"))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut seen = String::new();
        stdout.read_line(&mut seen).unwrap();
        // All that follows does not fit into the pipe: it is at work yet when it notices the loss.
        std::fs::rename(&session, folder.path().join("ended")).unwrap();
        std::thread::sleep(Duration::from_secs(2));
        stdout.read_to_string(&mut seen).unwrap();
        let out = child.wait_with_output().unwrap();
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(0), "{verb}: {said}");
        let frames = seen.lines().count() as u64;
        assert_eq!(Some(frames), clip.frame_count(), "{verb}: {said}");
        let told = said.matches("nobody can watch this run").count();
        assert_eq!(told, 1, "{verb}: {said}");
    }
}

/// Its own bodies are not what would be seen there.
#[test]
fn a_run_whose_name_is_taken_says_so_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let seen = folder.path().join("seen.jsonl");
    let name = stream("run-name-taken");
    let _first = Publisher::<BodyFrame>::open(&name).unwrap();
    for live in [&[][..], &["--live"]] {
        let out = edgecap()
            .args(["run", "--input", "demo", "--name", &name])
            .args(["--view", "127.0.0.1:0"])
            .args(live)
            .args(SMALL)
            .arg("--jsonl")
            .arg(&seen)
            .output()
            .unwrap();
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(69), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(said.contains("another process already publishes"), "{said}");
        assert!(out.stdout.is_empty() && !seen.exists(), "{said}");
    }
}

/// Of a `run` and an `infer` of one name each says how it is doing, though only one has bodies.
#[test]
fn a_name_of_whose_health_another_process_tells_is_refused_before_anything_else() {
    let folder = tempfile::tempdir().unwrap();
    let seen = folder.path().join("seen.jsonl");
    let name = stream("health-taken");
    let _first = Publisher::<HealthFrame>::open(&name).unwrap();
    for verb in [&["infer"][..], &["infer", "--live"], &["run"]] {
        let out = edgecap()
            .args(verb)
            .args(["--input", "demo", "--name", &name])
            .args(SMALL)
            .arg("--jsonl")
            .arg(&seen)
            .output()
            .unwrap();
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(69), "{said}");
        assert_eq!(said.lines().count(), 1, "{verb:?}: {said}");
        let wanted = format!("another process already publishes edgecap/v1/{name}/health");
        assert!(said.contains(&wanted), "{said}");
        assert!(out.stdout.is_empty() && !seen.exists(), "{said}");
    }
}

/// Nobody has asked for a stream of it.
#[test]
fn a_file_without_a_name_needs_no_stream() {
    let folder = crate::program::short_folder();
    let name = stream("name-taken");
    let input = folder.path().join(format!("{name}.jpg"));
    std::fs::write(&input, photo()).unwrap();
    let _other = Publisher::<ObservationFrame>::open(&name).unwrap();
    let absent = folder.path().join("absent/edgecap");
    for place in [None, Some(absent)] {
        let mut infer = edgecap();
        infer.current_dir(folder.path()).args(["infer", "--input"]);
        infer.arg(&input).args(SMALL);
        infer.envs(place.map(|place| ("EDGECAP_RUNTIME_DIR", place)));
        let out = infer.output().unwrap();
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(0), "{said}");
        let told = said.matches("nobody can watch this run").count();
        assert_eq!(told, 1, "{said}");
        let seen = format!("edgecap-out/{name}.observations.jsonl");
        assert_eq!(count(&folder.path().join(seen)), 1);
    }
    // None is announced that would end at once.
    let _health = Publisher::<HealthFrame>::open(&name).unwrap();
    let mut run = edgecap();
    run.current_dir(folder.path()).args(["run", "--input"]);
    let out = run.arg(&input).args(SMALL).output().unwrap();
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(0), "{said}");
    assert_eq!(
        said.matches("nobody can watch this run").count(),
        1,
        "{said}"
    );
    assert!(!said.contains("→ shared memory"), "{said}");
}
