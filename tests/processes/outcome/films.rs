//! Films: cut off, stopped, drawn; what they replace.

use edgecap::capture::{AviReader, AviWriter, Frame, Source};

use super::{SMALL, count, cut_film, photo, stopped_after};
use crate::program::{assert_fails, edgecap, stderr, stream};

#[test]
fn a_cut_film_gives_what_it_holds() {
    let folder = tempfile::tempdir().unwrap();
    let film = cut_film(folder.path());
    for verb in ["infer", "run"] {
        let out = folder.path().join(format!("{verb}.jsonl"));
        let name = stream("cut");
        let mut args = vec![verb, "--input", film.to_str().unwrap()];
        args.extend(["--jsonl", out.to_str().unwrap()]);
        args.extend(SMALL);
        if verb == "run" {
            args.extend(["--name", &name]);
        }
        assert_fails(&args, 65, &["cut.avi"]);
        assert!(count(&out) >= 2, "{verb}");
    }
}

#[test]
fn a_cut_film_does_not_replace_more() {
    let folder = tempfile::tempdir().unwrap();
    let film = cut_film(folder.path());
    let out = folder.path().join("seen.jsonl");
    let older = "a line of the time before\n".repeat(100_000);
    std::fs::write(&out, &older).unwrap();
    let run = edgecap()
        .args(["infer", "--jsonl", out.to_str().unwrap(), "--input"])
        .arg(&film)
        .args(SMALL)
        .output()
        .unwrap();
    assert_eq!(run.status.code(), Some(65));
    assert!(stderr(&run).contains("seen-cut.jsonl"), "{}", stderr(&run));
    assert_eq!(std::fs::read_to_string(&out).unwrap(), older);
    assert!(count(&folder.path().join("seen-cut.jsonl")) >= 2);

    // The same of what is made of it.
    let exported = folder.path().join("e.csv");
    std::fs::write(&exported, &older).unwrap();
    let run = edgecap()
        .args(["run", "--name", &stream("cut-export"), "--jsonl"])
        .arg(folder.path().join("new.jsonl"))
        .arg("--input")
        .arg(&film)
        .arg("--export")
        .arg(&exported)
        .output()
        .unwrap();
    assert_eq!(run.status.code(), Some(65), "{}", stderr(&run));
    assert!(stderr(&run).contains("e-cut.csv"), "{}", stderr(&run));
    assert_eq!(std::fs::read_to_string(&exported).unwrap(), older);
    assert!(folder.path().join("e-cut.csv").exists());
}

#[test]
fn a_film_that_is_stopped_does_not_replace_more() {
    let older = "a line of the time before\n".repeat(400_000);
    for (verb, names) in [
        ("infer", &["seen.ecr"][..]),
        ("run", &["seen.ecr", "e.csv"]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in names {
            std::fs::write(at(name), &older).unwrap();
        }
        let mut command = edgecap();
        command
            .args([verb, "--input", "demo", "--name", &stream("stopped-short")])
            .args(["--jsonl", "-", "--record"])
            .arg(at("seen.ecr"))
            .args(SMALL);
        if verb == "run" {
            command.arg("--export").arg(at("e.csv"));
        }
        // An export is of somebody.
        let (out, _) = stopped_after(&mut command, "joints3d");
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(130), "{verb}: {said}");
        for name in names {
            assert!(
                std::fs::read_to_string(at(name)).unwrap() == older,
                "{verb}: {said}"
            );
            let cut = at(&name.replace('.', "-cut."));
            assert!(cut.exists(), "{verb}: {said}");
            let word = format!("→ {}", cut.display());
            assert!(verb == "infer" || said.contains(&word), "{word}: {said}");
        }
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            2 * names.len()
        );
    }
}

#[test]
fn a_film_in_gives_a_film_with_skeletons_of_the_same_length_and_rate() {
    let folder = tempfile::tempdir().unwrap();
    let (film, drawn) = (folder.path().join("in.avi"), folder.path().join("seen.avi"));
    let jpeg = photo();
    let size = image::load_from_memory(&jpeg).unwrap().to_rgb8();
    let file = std::fs::File::create(&film).unwrap();
    let mut writer = AviWriter::new(file, size.width(), size.height(), (12, 1)).unwrap();
    for _ in 0..3 {
        writer.write_jpeg(&jpeg).unwrap();
    }
    writer.finish().unwrap();
    for verb in ["run", "infer"] {
        let out = edgecap()
            .current_dir(folder.path())
            .args([verb, "--name", &stream("film")])
            .args(SMALL)
            .arg("--input")
            .arg(&film)
            .arg("--overlay")
            .arg(&drawn)
            .output()
            .unwrap();
        assert!(out.status.success(), "{}", stderr(&out));
        let seen = std::fs::File::open(&drawn).unwrap();
        let mut seen = AviReader::new(seen, "seen").unwrap();
        assert_eq!((seen.frame_count(), seen.fps()), (Some(3), Some(12.0)));
        let mut frame = Frame::default();
        assert!(seen.next_into(&mut frame).unwrap());
        let differs = frame.rgb.iter().zip(size.as_raw());
        let differs = differs.filter(|(a, b)| a.abs_diff(**b) > 60).count();
        assert!(differs > 300, "{verb}: no skeleton was drawn, {differs}");
        std::fs::remove_file(&drawn).unwrap();
    }
}

/// The same film, seen with other settings: as many frames are not fewer for having fewer digits.
#[test]
fn a_cut_film_replaces_as_many_frames() {
    let folder = tempfile::tempdir().unwrap();
    let film = cut_film(folder.path());
    let seen = folder.path().join("seen.jsonl");
    let see = || {
        let args = [
            "infer",
            "--input",
            film.to_str().unwrap(),
            "--jsonl",
            seen.to_str().unwrap(),
        ];
        assert_fails(&[&args[..], &SMALL].concat(), 65, &["cut.avi"]);
        std::fs::read_to_string(&seen).unwrap()
    };
    let wide = see().replace("{\"frame\":", "{                    \"frame\":");
    std::fs::write(&seen, &wide).unwrap();
    let again = see();
    assert!(again.len() < wide.len(), "spaces are no frames");
    assert_eq!(again.lines().count(), wide.lines().count());
    assert!(!folder.path().join("seen-cut.jsonl").exists());
}

/// Half a film must not be taken for the whole of it.
#[test]
fn a_film_that_is_not_seen_to_its_end_says_so() {
    for verb in ["infer", "run"] {
        let name = stream("stopped");
        let args = [verb, "--input", "demo", "--name", &name, "--jsonl", "-"];
        let (out, seen) = stopped_after(edgecap().args(args).args(SMALL), "\n");
        assert_eq!(out.status.code(), Some(130), "{verb}: {}", stderr(&out));
        let said = match seen.lines().count() {
            1 => "stopped after 1 frame;".to_owned(),
            n => format!("stopped after {n} frames;"),
        };
        assert!(stderr(&out).contains(&said), "{verb}: {}", stderr(&out));
    }
}
