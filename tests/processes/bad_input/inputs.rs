//! Films, photos, cameras and pipes: that are not there, hold something else, or cannot play over and over.

use crate::program::{assert_fails, edgecap, stream};

#[test]
fn inputs_that_are_not_there() {
    let empty = tempfile::tempdir().unwrap();
    let folder = empty.path().to_str().unwrap();
    for verb in ["infer", "run"] {
        assert_fails(
            &[
                verb,
                "--input",
                "/nowhere/clip.y4m",
                "--name",
                &stream("none"),
            ],
            66,
            &["/nowhere/clip.y4m"],
        );
        assert_fails(
            &[verb, "--input", folder, "--name", &stream("empty")],
            66,
            &[folder],
        );
        let name = stream("camera");
        let mut args = vec![verb, "--input", "/dev/video97", "--name", &name];
        if verb == "run" {
            // Else it waits for the camera.
            args.push("--no-wait");
        }
        assert_fails(&args, 69, &["/dev/video97"]);
    }
    // No camera comes below /dev/shm, nor under the name of a film.
    for film in ["/dev/shm/none.avi", "/dev/shm/none", "/dev/none.avi"] {
        let args = ["run", "--input", film, "--name", &stream("no-film")];
        assert_fails(&args, 66, &[film, "no such file"]);
    }
    let here = tempfile::tempdir().unwrap();
    let out = edgecap()
        .current_dir(here.path())
        .args([
            "run",
            "--input",
            "/nowhere/clip.y4m",
            "--name",
            &stream("here"),
        ])
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(66));
    let left = std::fs::read_dir(here.path()).unwrap().count();
    assert_eq!(left, 0, "a failed run leaves no folder");
}

/// Tried again, it would lead nowhere again.
#[test]
fn an_input_that_cannot_exist_ends_a_film_that_would_play_without_end() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let below = file.join("clip.y4m");
    let below = below.to_str().unwrap();
    let args = ["--input", below, "--name", &stream("nowhere")];
    for verb in [
        &["run"][..],
        &["infer"],
        &["run", "--live"],
        &["infer", "--live"],
    ] {
        assert_fails(&[verb, &args].concat(), 66, &[below, "check the path"]);
    }
}

#[test]
fn content_that_is_no_picture() {
    let folder = tempfile::tempdir().unwrap();
    for (file, bytes) in [
        ("a.jpg", &b"not a picture"[..]),
        ("b.png", b"\x89PNG\r\n\x1a\n"),
        ("c.y4m", b"YUV4MPEG2 W16 H"),
        ("d.avi", b"RIFF"),
    ] {
        let path = folder.path().join(file);
        std::fs::write(&path, bytes).unwrap();
        let out = folder.path().join("out.jsonl");
        assert_fails(
            &[
                "infer",
                "--input",
                path.to_str().unwrap(),
                "--jsonl",
                out.to_str().unwrap(),
            ],
            65,
            &[file],
        );
        assert!(!out.exists(), "{file}: half a result is left");
    }
    let left = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 4, "only the inputs are left");
}

/// A pipe can be read once, so that nothing on it plays over and over.
#[test]
fn a_pipe_does_not_play_like_a_camera() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe").to_str().unwrap().to_owned();
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    for verb in ["run", "infer"] {
        let args = [verb, "--live", "--input", &pipe];
        assert_fails(&args, 64, &["--live", "expected a file, found the pipe"]);
        assert_fails(
            &[verb, "--live", "--input", "-"],
            64,
            &["found standard input"],
        );
    }
}
