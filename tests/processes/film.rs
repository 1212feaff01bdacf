//! A film of a few pictures: its bodies as files of other programs at once, and how long it still takes.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use edgecap::capture::{self, AviWriter, Frame, demo};

use crate::program::{assert_fails, edgecap, output, stderr, stream, tools};

const PICTURES: usize = 4;

/// The first pictures of the bundled clip.
fn film(folder: &Path) -> PathBuf {
    let mut clip = capture::open_bytes("demo", demo::CLIP).unwrap();
    let mut picture = Frame::default();
    let path = folder.join("few.avi");
    let mut film = None;
    for _ in 0..PICTURES {
        assert!(clip.next_into(&mut picture).unwrap());
        let (width, height) = (picture.width, picture.height);
        let film = film.get_or_insert_with(|| {
            AviWriter::new(fs::File::create(&path).unwrap(), width, height, (10, 1)).unwrap()
        });
        film.write_frame(&picture, 90).unwrap();
    }
    film.unwrap().finish().unwrap();
    path
}

#[test]
fn a_run_exports_what_export_makes_of_its_record() {
    let folder = tempfile::tempdir().unwrap();
    let film = film(folder.path());
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (input, name) = (film.to_str().unwrap(), stream("export-run"));
    let record = at("bodies.record");
    let run = [
        "run", "--input", input, "--name", &name, "--size", "256x160",
    ];
    let more = [
        "--record",
        &record,
        "--export",
        &at("a.csv"),
        "--export",
        &at("a.glb"),
    ];
    let out = output(&[&run[..], &more].concat());
    assert!(out.status.success(), "{}", stderr(&out));
    let said = String::from_utf8(out.stdout).unwrap();
    for name in ["bodies.record", "a.csv", "a.glb"] {
        assert_eq!(said.matches(name).count(), 1, "{said}");
    }
    for kind in ["csv", "glb"] {
        let again = at(&format!("again.{kind}"));
        let out = output(&["export", &record, "--to", &again]);
        assert!(out.status.success(), "{}", stderr(&out));
        assert_eq!(
            fs::read(at(&format!("a.{kind}"))).unwrap(),
            fs::read(again).unwrap(),
            "{kind}"
        );
    }
    // Said before anything is computed.
    let wrong = at("a.fbx");
    assert_fails(&[&run[..], &["--export", &wrong]].concat(), 64, &["a.fbx"]);
    let whole = at("b.csv");
    let live = [&run[..], &["--live", "--export", &whole]].concat();
    assert_fails(&live, 64, &["--export", "edgecap record"]);
}

/// Films are looked at for verbs that read no stream, and say themselves what has come of it.
#[test]
fn views_are_looked_at_where_no_stream_can_be() {
    let folder = crate::program::short_folder();
    let film = film(folder.path());
    let at = |name: &str| folder.path().join(name).display().to_string();
    let again = folder.path().join("again.avi");
    std::fs::copy(&film, &again).unwrap();
    let [a, b] = [("a", &film), ("b", &again)]
        .map(|(name, film)| format!("--view={name}={}", film.display()));
    let (found, run) = (at("Calib.toml"), at("run"));
    for (args, code) in [
        // Four frames are looked at, and are too few.
        (&["calibrate", "--out", &found, &a, &b][..], &[65][..]),
        (&["multiview", "--out", &run, &a], &[0, 65]),
    ] {
        let out = edgecap()
            .args(args)
            .env("EDGECAP_RUNTIME_DIR", folder.path().join("absent/edgecap"))
            .output()
            .unwrap();
        let said = stderr(&out);
        assert!(code.contains(&out.status.code().unwrap()), "{said}");
        assert!(!said.contains("runtime folder"), "{said}");
        assert!(!said.contains("with people"), "{said}");
    }
}

/// What is given to `infer` in turn is no option, whatever it is called.
#[test]
fn a_view_may_be_called_like_an_option() {
    let folder = crate::program::short_folder();
    std::fs::rename(film(folder.path()), folder.path().join("-take.avi")).unwrap();
    let out = edgecap()
        .args(["multiview", "--out", "run", "--view=a=-take.avi"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    // Its few frames may be too few.
    let said = stderr(&out);
    assert!(matches!(out.status.code(), Some(0 | 65)), "{said}");
    assert!(!said.contains("argument"), "{said}");
}

#[test]
fn a_terminal_is_told_how_long_a_film_takes_and_a_pipe_is_not() {
    if !tools::has("script") {
        return;
    }
    let folder = crate::program::short_folder();
    let film = film(folder.path());
    for verb in ["run", "infer"] {
        let arguments = format!(
            "{verb} --input {} --size 256x160 --record {}",
            film.display(),
            folder.path().join(verb).display()
        );
        let program = edgecap();
        let typed = format!(
            "stty cols 200; {} {arguments}",
            program.get_program().display()
        );
        let settings = program
            .get_envs()
            .filter_map(|(key, value)| Some((key, value?)));
        let shown = Command::new("script")
            .args(["-qec", &typed, "/dev/null"])
            .envs(settings)
            .env("EDGECAP_RUNTIME_DIR", folder.path().join("place"))
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let shown = String::from_utf8_lossy(&shown.stdout).into_owned();
        let all = format!("/{PICTURES} frames, ");
        assert!(shown.contains(&all) && shown.contains(" left"), "{shown}");
        let piped = edgecap()
            .args(arguments.split(' '))
            .env("EDGECAP_RUNTIME_DIR", folder.path().join("place"))
            .output()
            .unwrap();
        assert!(piped.status.success(), "{}", stderr(&piped));
        assert!(!stderr(&piped).contains(" left"), "{}", stderr(&piped));
    }
}
