//! What is read is never what is written, and no two results have one file.

use std::os::unix::fs::symlink;
use std::path::Path;

use crate::program::{assert_fails, edgecap, output, stderr};
use edgecap::capture::{AviWriter, Frame};

#[test]
fn an_input_is_not_replaced_by_a_result() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    for name in ["y.avi", "o.jsonl", "lens.toml", "w.ecm"] {
        std::fs::write(at(name), name).unwrap();
    }
    let archives = ["humaneva1_gt.npz", "humaneva1_alphapose_aligned.npz"];
    std::fs::create_dir(at("set")).unwrap();
    for name in archives {
        std::fs::write(at(&format!("set/{name}")), name).unwrap();
    }
    let [truth, detected] = archives.map(|name| at(&format!("set/{name}")));
    std::fs::create_dir(at("photos")).unwrap();
    std::fs::write(at("photos/a.png"), "photo").unwrap();
    let (film, seen, photos) = (at("y.avi"), at("o.jsonl"), at("photos"));
    let same = &at("./y.avi");
    for args in [
        &["run", "--input", &film, "--overlay", &film][..],
        &["run", "--input", &film, "--jsonl", &film],
        &["run", "--input", &film, "--record", same],
        &["run", "--input", &film, "--live", "--record", same],
        &[
            "run",
            "--input",
            "demo",
            "--camera",
            &at("lens.toml"),
            "--jsonl",
            &at("lens.toml"),
        ],
        &["infer", "--input", &film, "--jsonl", &film],
        &["infer", "--input", &photos, "--overlay", &photos],
        &["infer", "--input", &photos, "--jsonl", &at("photos/a.png")],
        &[
            "infer",
            "--input",
            &at("photos/a.png"),
            "--overlay",
            &photos,
        ],
        &["fit", "--input", &seen, "--jsonl", &seen],
        &[
            "calibrate",
            "--view",
            &seen,
            "--view",
            &film,
            "--out",
            &seen,
        ],
        &[
            "eval",
            "--predictions",
            &seen,
            "--truth",
            &film,
            "--json",
            &seen,
        ],
        &["eval", "--humaneva", &at("set"), "--json", &truth],
        &["eval", "--humaneva", &at("set"), "--json", &detected],
        &["bench", "--model", &at("w.ecm"), "--save", &at("w.ecm")],
    ] {
        assert_fails(args, 64, &["would replace", "choose another name"]);
    }
    for name in ["y.avi", "o.jsonl", "lens.toml", "w.ecm"] {
        assert_eq!(std::fs::read_to_string(at(name)).unwrap(), name);
    }
    for name in archives {
        let kept = std::fs::read_to_string(at(&format!("set/{name}"))).unwrap();
        assert_eq!(kept, name);
    }
    assert_eq!(
        std::fs::read_to_string(at("photos/a.png")).unwrap(),
        "photo"
    );
}

/// A folder with a photo and a film, and one for each with a link to it that is called as a picture of it would be.
fn linked(folder: &Path) -> [String; 3] {
    let folders = ["real", "lnk", "ol"].map(|name| {
        let path = folder.join(name);
        std::fs::create_dir(&path).unwrap();
        path
    });
    let photo = image::RgbImage::from_pixel(64, 48, image::Rgb([90, 80, 70]));
    photo.save(folders[0].join("a.png")).unwrap();
    let film = std::fs::File::create(folders[0].join("c.avi")).unwrap();
    let mut film = AviWriter::new(film, 64, 48, (12, 1)).unwrap();
    let picture = Frame {
        width: 64,
        height: 48,
        rgb: photo.into_raw(),
        ..Frame::default()
    };
    film.write_frame(&picture, 85).unwrap();
    film.finish().unwrap();
    symlink("../real/a.png", folders[1].join("a.png")).unwrap();
    symlink("../real/c.avi", folders[2].join("000000.png")).unwrap();
    folders.map(|path| path.to_str().unwrap().to_owned())
}

#[test]
fn photos_and_films_behind_links_are_not_drawn_over() {
    let folder = tempfile::tempdir().unwrap();
    let [real, lnk, ol] = linked(folder.path());
    let (photo, film) = (format!("{real}/a.png"), format!("{real}/c.avi"));
    let linked = format!("{lnk}/a.png");
    let read = || [&photo, &film].map(|path| std::fs::read(path).unwrap());
    let before = read();
    let small = ["--size", "256x160", "--threads", "1"];
    for verb in ["infer", "run"] {
        for (input, to) in [(&linked, &lnk), (&lnk, &real), (&linked, &real)] {
            let args = [verb, "--input", input, "--overlay", to];
            assert_fails(&args, 64, &["would replace", "choose another name"]);
        }
    }
    let args = ["infer", "--input", &lnk, "--jsonl", &photo];
    assert_fails(&args, 64, &["would replace"]);
    for (input, to) in [(&real, &lnk), (&film, &ol)] {
        let args = [&["infer", "--input", input, "--overlay", to], &small[..]].concat();
        let done = output(&args);
        assert!(done.status.success(), "{}", stderr(&done));
        assert!(read() == before, "{input} is drawn over");
        let mut drawn = std::fs::read_dir(to).unwrap().map(|e| e.unwrap().path());
        assert!(drawn.all(|p| !p.is_symlink() && image::open(p).is_ok()));
    }
}

#[test]
fn settings_are_not_replaced_by_a_result() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (fit, events, all, seen) = (
        at("fit.toml"),
        at("events.toml"),
        at("edgecap.toml"),
        at("o.jsonl"),
    );
    let demo = ["run", "--input", "demo"];
    for (verb, option, file) in [
        (&demo[..], "--fit-config", &fit),
        (&demo, "--events", &events),
        (&demo, "--config", &all),
        (&["run", "--input", "demo", "--live"], "--fit-config", &fit),
        (&["fit", "--input", &seen], "--fit-config", &fit),
        (&["fit"], "--fit-config", &fit),
        (&["fit"], "--events", &events),
    ] {
        for to in ["--jsonl", "--record"] {
            std::fs::write(file, "# Mine.\n").unwrap();
            let args = [verb, &[option, file, to, file]].concat();
            assert_fails(&args, 64, &["would replace", option, to]);
            assert_eq!(std::fs::read_to_string(file).unwrap(), "# Mine.\n");
        }
    }
    // Files that the settings name, and a file of settings that is found.
    let own = at("edgecap/edgecap.toml");
    std::fs::create_dir(folder.path().join("edgecap")).unwrap();
    let camera = "[[camera]]\ninput = \"demo\"\n";
    for (text, to, code, place) in [
        (
            format!("{camera}fit = \"{fit}\"\njsonl = \"{fit}\"\n"),
            &fit,
            78,
            "edgecap.toml:4:1: 'jsonl' ",
        ),
        (camera.to_owned(), &own, 64, "--jsonl "),
    ] {
        std::fs::write(&own, &text).unwrap();
        let mut run = edgecap();
        run.env("XDG_CONFIG_HOME", folder.path()).arg("run");
        if *to == own {
            run.args(["--jsonl", to]);
        }
        let run = run.output().unwrap();
        let said = stderr(&run);
        assert_eq!(run.status.code(), Some(code), "{said}");
        assert!(
            said.contains("would replace") && said.contains(&format!("{place}{to}")),
            "{said}"
        );
        assert_eq!(std::fs::read_to_string(&own).unwrap(), text);
    }
}

#[test]
fn an_export_is_not_written_to_a_result_of_multiview() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (absent, out) = (at("absent"), at("mv"));
    for name in ["bodies.npz", "joints.trc", "./meshes.glb"] {
        let to = at(&format!("mv/{name}"));
        let views = ["--view", &absent, "--view", &absent];
        let args = ["multiview", "--calibration", &absent, "--out", &out];
        let args = [&args[..], &views, &["--export", &to]].concat();
        assert_fails(&args, 64, &["--export", "--out", "a file for each"]);
    }
    assert!(!Path::new(&out).exists());
}

#[test]
fn two_results_are_not_written_to_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("same.out");
    let to = to.to_str().unwrap();
    for verb in ["run", "infer"] {
        let args = [verb, "--input", "demo", "--jsonl", to, "--record", to];
        assert_fails(&args, 64, &["--jsonl", "--record", "a file for each"]);
    }
    assert!(!Path::new(to).exists());
    let clip = folder.path().join("truth.json");
    let place = folder.path().to_str().unwrap();
    let args = ["synth", "--frames", "1", "--out", place, "--clip"];
    let args = [&args[..], &[clip.to_str().unwrap()]].concat();
    assert_fails(&args, 64, &["--clip", "its truth", "a file for each"]);
    assert!(!clip.exists());
    let settings = folder.path().join("edgecap.toml");
    let camera = |name: &str| {
        format!("[[camera]]\nname = \"{name}\"\ninput = \"/dev/{name}\"\njsonl = \"{to}\"\n")
    };
    std::fs::write(&settings, camera("one") + &camera("two")).unwrap();
    for verb in [&["run"][..], &["config", "check"]] {
        let run = edgecap()
            .args(verb)
            .arg("--config")
            .arg(&settings)
            .output()
            .unwrap();
        let said = stderr(&run);
        assert_eq!(run.status.code(), Some(78), "{verb:?}: {said}");
        let told = format!("edgecap.toml:8:1: one: 'jsonl' {to} and two: 'jsonl' {to}: ");
        assert!(said.contains(&told), "{verb:?}: {said}");
    }
}
