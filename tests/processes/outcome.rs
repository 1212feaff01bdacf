//! Whatever was computed is written and complete; then the exit code says what was wrong.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::program::stand_in::{StandIn, Watched};
use crate::program::{
    Running, assert_fails, edgecap, ends_when_asked, eventually, signal, stderr, stdout, stream,
};
use edgecap::capture::{AviReader, AviWriter, Frame, Source, demo};
use edgecap::message::{BodyFrame, ObservationFrame};
use edgecap_client::{Publisher, Subscriber};

const SMALL: [&str; 4] = ["--size", "256x160", "--threads", "1"];

fn count(path: &Path) -> usize {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.ends_with('\n'));
    let whole = |l: &str| serde_json::from_str::<serde_json::Value>(l).is_ok();
    assert!(text.lines().all(whole), "every line is whole");
    text.lines().count()
}

/// The bundled clip, cut off in the middle.
fn cut_film(folder: &Path) -> PathBuf {
    let path = folder.join("cut.avi");
    std::fs::write(&path, &demo::CLIP[..demo::CLIP.len() / 10]).unwrap();
    path
}

/// A picture of people, as JPEG: the clip's first frame.
fn photo() -> Vec<u8> {
    let at = |needle: &[u8], from: usize| {
        from + demo::CLIP[from..]
            .windows(needle.len())
            .position(|w| w == needle)
            .unwrap()
    };
    let start = at(&[0xFF, 0xD8, 0xFF], 0);
    let end = at(&[0xFF, 0xD9], start) + 2;
    demo::CLIP[start..end].to_vec()
}

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

/// How a program ended that was stopped when it had written `word`, and all that it wrote.
fn stopped_after(command: &mut Command, word: &str) -> (Output, String) {
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    let mut seen = String::new();
    while !seen.contains(word) {
        let n = stdout.read_line(&mut seen).unwrap();
        assert!(n > 0, "'{word}' never comes");
    }
    // All that follows does not fit into the pipe: it cannot have ended.
    signal(child.id(), "TERM");
    stdout.read_to_string(&mut seen).unwrap();
    (child.wait_with_output().unwrap(), seen)
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

#[test]
fn one_bad_picture_among_many_is_left_out_and_the_rest_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos_with_a_damaged_one(folder.path());
    let (drawn, lines) = (folder.path().join("drawn"), folder.path().join("b.jsonl"));
    // As of a whole run before, which this one replaces.
    std::fs::write(&lines, "{}\n".repeat(100_000)).unwrap();
    let out = edgecap()
        .args(["run", "--name", &stream("bad")])
        .args(SMALL)
        .arg("--input")
        .arg(&photos)
        .arg("--overlay")
        .arg(&drawn)
        .arg("--jsonl")
        .arg(&lines)
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(65), "{}", stderr(&out));
    let last = stderr(&out).lines().last().unwrap().to_owned();
    assert!(
        last.contains("left out") && last.contains("2.jpg"),
        "{last}"
    );
    assert_eq!(count(&lines), 2);
    let places = format!(" → {}; 2 pictures → {}", lines.display(), drawn.display());
    assert!(stdout(&out).contains(&places), "{}", stdout(&out));
    // Lines say of which picture they are, and nobody is in two of them.
    let text = std::fs::read_to_string(&lines).unwrap();
    let rows: Vec<serde_json::Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let ids = |row: &serde_json::Value| -> Vec<u64> {
        let people = row["people"].as_array().unwrap();
        people.iter().map(|p| p["id"].as_u64().unwrap()).collect()
    };
    for (row, name) in rows.iter().zip(["1.jpg", "3.jpg"]) {
        assert!(row["source"].as_str().unwrap().ends_with(name), "{row}");
        assert!(!ids(row).is_empty(), "{row}");
    }
    assert!(ids(&rows[0]).iter().all(|id| !ids(&rows[1]).contains(id)));
    let mut names: Vec<_> = std::fs::read_dir(drawn)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["1.png", "3.png"]);
}

/// As by `--jsonl /dev/stdout >> all.txt`.
#[test]
fn standard_output_by_its_name_is_written_on_and_gets_nothing_but_lines() {
    let folder = tempfile::tempdir().unwrap();
    let (all, seen) = (folder.path().join("all.txt"), folder.path().join("1.jpg"));
    std::fs::write(&seen, photo()).unwrap();
    std::fs::write(&all, "a line of before\n").unwrap();
    let added = std::fs::File::options().append(true).open(&all).unwrap();
    let out = edgecap()
        .args(["run", "--jsonl", "/dev/stdout", "--input"])
        .arg(&seen)
        .args(["--name", &stream("stdout")])
        .args(SMALL)
        .stdout(added)
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", stderr(&out));
    assert!(stderr(&out).contains("1 frame, "), "{}", stderr(&out));
    let text = std::fs::read_to_string(&all).unwrap();
    let (before, json) = text.split_once('\n').unwrap();
    assert_eq!(before, "a line of before");
    let row: serde_json::Value = serde_json::from_str(json).unwrap();
    assert!(row["people"].is_array());
}

/// Three photos, of which one is damaged.
fn photos_with_a_damaged_one(folder: &Path) -> PathBuf {
    let photos = folder.join("photos");
    std::fs::create_dir(&photos).unwrap();
    for name in ["1.jpg", "3.jpg"] {
        std::fs::write(photos.join(name), photo()).unwrap();
    }
    std::fs::write(photos.join("2.jpg"), b"\xff\xd8\xff damaged").unwrap();
    photos
}

/// A folder that was read to its end gives a whole record, whatever was left out of it.
#[test]
fn a_bad_picture_leaves_no_older_record_in_place_and_the_new_one_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos_with_a_damaged_one(folder.path());
    let (seen, drawn) = (
        folder.path().join("seen.jsonl"),
        folder.path().join("drawn"),
    );
    std::fs::write(&seen, "{\"a longer line\": 0}\n".repeat(10_000)).unwrap();
    let out = edgecap()
        .args(["infer", "--input"])
        .arg(&photos)
        .arg("--jsonl")
        .arg(&seen)
        .arg("--overlay")
        .arg(&drawn)
        .args(SMALL)
        .output()
        .unwrap();
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(65), "{said}");
    assert_eq!(count(&seen), 2, "{said}");
    assert!(!said.contains("seen-cut"), "{said}");
    let lines: Vec<&str> = said.lines().collect();
    let [.., result, failure] = lines[..] else {
        panic!("{said}")
    };
    let places = format!("→ {}; 2 pictures → {}", seen.display(), drawn.display());
    assert!(result.starts_with("2 frames, 2 with people → "), "{said}");
    assert!(result.ends_with(&places), "{said}");
    assert!(failure.starts_with("edgecap: left out: "), "{said}");
}

/// Of none of them there is a result: what was there stays.
#[test]
fn a_folder_of_bad_pictures_replaces_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos_with_a_damaged_one(folder.path());
    for name in ["1.jpg", "3.jpg"] {
        std::fs::remove_file(photos.join(name)).unwrap();
    }
    std::fs::write(photos.join("4.jpg"), "damaged, too").unwrap();
    let seen = folder.path().join("seen.jsonl");
    std::fs::write(&seen, "{}\n").unwrap();
    let (photos, jsonl) = (photos.to_str().unwrap(), seen.to_str().unwrap());
    let args = ["infer", "--input", photos, "--jsonl", jsonl];
    assert_fails(&[&args[..], &SMALL].concat(), 65, &["left out 2 pictures"]);
    assert_eq!(std::fs::read_to_string(&seen).unwrap(), "{}\n");
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

#[test]
fn a_picture_is_a_still_by_its_bytes_whatever_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let results: Vec<Vec<u8>> = ["a.jpg", "b.jfif", "c"]
        .into_iter()
        .map(|name| {
            let (path, out) = (folder.path().join(name), folder.path().join("out.jsonl"));
            std::fs::write(&path, photo()).unwrap();
            let done = edgecap()
                .args(["run", "--name", &stream("still")])
                .arg("--input")
                .arg(&path)
                .arg("--jsonl")
                .arg(&out)
                .output()
                .unwrap();
            assert!(done.status.success(), "{}", stderr(&done));
            let line: serde_json::Value =
                serde_json::from_slice(&std::fs::read(&out).unwrap()).unwrap();
            serde_json::to_vec(&line["people"]).unwrap()
        })
        .collect();
    assert!(results[0].len() > 100, "somebody is in the picture");
    assert!(results[0] == results[1] && results[1] == results[2]);
}

#[test]
fn nobody_who_listens_is_no_reason_to_end() {
    let folder = tempfile::tempdir().unwrap();
    let film = cut_film(folder.path());
    let lines = folder.path().join("b.jsonl");
    let full = std::fs::File::options()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let status = edgecap()
        .args(["run", "--name", &stream("full")])
        .args(SMALL)
        .arg("--input")
        .arg(&film)
        .arg("--jsonl")
        .arg(&lines)
        .env("EDGECAP_LOG", "debug")
        .stdout(full.try_clone().unwrap())
        .stderr(full)
        .status()
        .unwrap();
    assert_eq!(status.code(), Some(65), "the film is cut, that is all");
    assert!(count(&lines) >= 2);
}

#[test]
fn a_full_disk_under_a_record_does_not_end_a_camera() {
    let camera = StandIn::new(30.0);
    let watched = Watched::start("full-disk", &camera, &["--jsonl", "/dev/full"]);
    let bodies: Subscriber<BodyFrame> = watched.listen();
    for _ in 0..5 {
        eventually("a body", || {
            bodies.next(Duration::from_millis(100)).unwrap()
        });
    }
    drop(bodies);
    let out = watched.stop();
    let said = stderr(&out);
    let lines = said
        .lines()
        .filter(|l| l.contains("everything else goes on"));
    assert_eq!(lines.count(), 1, "{said}");
    // The record is not whole.
    assert_eq!(out.status.code(), Some(74), "{said}");
}

#[test]
fn lines_go_to_standard_output_and_a_reader_that_leaves_is_named() {
    let head = ["infer", "--input", "demo", "--jsonl", "-"];
    let mut child = edgecap()
        .args(head)
        .args(SMALL)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut first = String::new();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    stdout.read_line(&mut first).unwrap();
    assert!(serde_json::from_str::<serde_json::Value>(&first).is_ok());
    drop(stdout);
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(74));
    let said = stderr(&out);
    assert!(
        said.contains("standard output") && said.lines().count() == 1,
        "{said}"
    );
}

#[test]
fn a_full_disk_keeps_what_found_room() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("b.jsonl");
    // The limit of a file's size stands in for a full disk.
    let out = std::process::Command::new("bash")
        .args(["-c", "trap '' XFSZ; ulimit -f 64; exec \"$0\" \"$@\""])
        .arg(env!("CARGO_BIN_EXE_edgecap"))
        .args(["infer", "--input", "demo", "--jsonl"])
        .arg(&result)
        .args(SMALL)
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(74), "{}", stderr(&out));
    assert!(stderr(&out).contains("b.jsonl"), "{}", stderr(&out));
    assert!(count(&result) >= 2);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let readonly = ["infer", "--input", "demo", "--jsonl", "/proc/b.jsonl"];
    assert_fails(&readonly, 73, &["/proc/b.jsonl"]);
}

/// Who redirects a result to a file that has no room must not take half of it for the whole.
#[test]
fn results_on_a_full_disk_are_no_success() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("p.jsonl"),
        "{\"frame\":0,\"people\":[]}\n",
    )
    .unwrap();
    let eval = ["eval", "--predictions", "p.jsonl", "--no-people"];
    for args in [
        &["config", "sample"][..],
        &["config", "print"],
        &["config", "check"],
        &["model", "contract"],
        &["model", "info"],
        &["model", "verify"],
        &[
            "bench",
            "--seconds",
            "0.01",
            "--size",
            "64x64",
            "--save",
            "figures.json",
        ],
        &["completions", "bash"],
        &eval,
        &[&eval[..], &["--json", "-"]].concat(),
    ] {
        let run = || {
            let mut run = edgecap();
            run.current_dir(folder.path()).args(args);
            run
        };
        let full = std::fs::File::create("/dev/full").unwrap();
        let out = run().stdout(full).output().unwrap();
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(74), "{args:?}: {said}");
        assert!(said.starts_with("edgecap: standard output: "), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let out = run().stdout(writer).output().unwrap();
        assert_eq!(out.status.code(), Some(0), "{args:?}: {}", stderr(&out));
    }
}

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

/// The program in `folder`, reading what is written into the pipe.
fn fed(folder: &Path, args: &[&str]) -> (Running, ChildStdin) {
    let mut child = edgecap()
        .current_dir(folder)
        .args(args)
        .args(["--input", "-"])
        .args(SMALL)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let pipe = child.stdin.take().unwrap();
    (Running(child), pipe)
}

#[test]
fn a_silent_pipe_can_be_left() {
    let folder = tempfile::tempdir().unwrap();
    for verb in ["infer", "run"] {
        let name = stream("silent");
        let (run, mut pipe) = fed(folder.path(), &[verb, "--name", &name]);
        pipe.write_all(b"YUV4MPEG2 W640 H480 F30:1\nFRAME\n")
            .unwrap();
        ends_when_asked(run.pid());
        std::thread::sleep(Duration::from_millis(700));
        let asked = Instant::now();
        signal(run.pid(), "TERM");
        let out = run.wait(Duration::from_secs(60));
        assert!(asked.elapsed() < Duration::from_secs(8), "{verb}");
        assert_eq!(out.status.code(), Some(0), "{verb}: {}", stderr(&out));
        drop(pipe);
    }
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
}

#[test]
fn photos_of_another_shape_than_the_lens_are_left_out_aloud() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let text = "fx = 90.0\ncx = 47.5\ncy = 31.5\nwidth = 96\nheight = 64\n";
    std::fs::write(at("lens.toml"), text).unwrap();
    std::fs::create_dir(at("photos")).unwrap();
    for (name, (width, height)) in [("1", (64, 64)), ("2", (96, 64)), ("3", (64, 96))] {
        let photo = image::RgbImage::new(width, height);
        photo
            .save(at("photos").join(format!("{name}.png")))
            .unwrap();
    }
    let look = || {
        let looked = edgecap()
            .args(["infer", "--size", "64x64", "--threads", "1", "--input"])
            .arg(at("photos"))
            .arg("--camera")
            .arg(at("lens.toml"))
            .arg("--jsonl")
            .arg(at("seen.jsonl"))
            .output()
            .unwrap();
        (looked.status.code(), stderr(&looked))
    };
    let (code, said) = look();
    assert_eq!(code, Some(65), "{said}");
    assert_eq!(said.matches("another shape").count(), 3, "{said}");
    assert_eq!(said.matches("; skipped").count(), 2, "{said}");
    assert!(said.contains("left out 2 pictures, the first"), "{said}");
    let seen = std::fs::read_to_string(at("seen.jsonl")).unwrap();
    assert_eq!(seen.lines().count(), 1);
    assert!(seen.contains("2.png"), "{seen}");
    // Where it fits none of them, the lens is what is wrong.
    for gone in ["photos/2.png", "seen.jsonl"] {
        std::fs::remove_file(at(gone)).unwrap();
    }
    let (code, said) = look();
    assert_eq!(code, Some(78), "{said}");
    assert!(
        said.contains("edgecap: ") && said.contains("96x64"),
        "{said}"
    );
    assert!(!at("seen.jsonl").exists());
}

/// As a power cut does after weeks.
#[test]
fn what_a_camera_saw_before_its_process_was_killed_is_there() {
    let folder = tempfile::tempdir().unwrap();
    for verb in ["infer", "run"] {
        let path = folder.path().join(format!("{verb}.jsonl"));
        std::fs::write(&path, "older\n").unwrap();
        let (name, jsonl) = (stream("killed"), path.to_str().unwrap());
        let args = [
            verb, "--input", "demo", "--live", "--name", &name, "--jsonl", jsonl,
        ];
        let run = Running::start(&[&args[..], &SMALL].concat());
        let whole = eventually("frames", || {
            let text = std::fs::read_to_string(&path).ok()?;
            let is_whole = |l: &&str| serde_json::from_str::<serde_json::Value>(l).is_ok();
            let whole = text.lines().filter(is_whole).count();
            (whole > 2).then_some(whole)
        });
        signal(run.pid(), "KILL");
        drop(run);
        let text = std::fs::read_to_string(&path).unwrap();
        // The last line may be cut off.
        for line in text.lines().take(whole) {
            assert!(serde_json::from_str::<serde_json::Value>(line).is_ok());
        }
        let aside = folder.path().join(format!("{verb}-1.jsonl"));
        assert_eq!(std::fs::read_to_string(aside).unwrap(), "older\n");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 4);
}

/// `timeout`, and systemd together with a supervisor, ask twice within a moment.
#[test]
fn to_be_asked_twice_at_once_is_to_be_asked_once() {
    let folder = tempfile::tempdir().unwrap();
    for (turn, asked) in ["TERM", "INT", "HUP", "TERM"].into_iter().enumerate() {
        let seen = folder.path().join(format!("{turn}.jsonl"));
        let name = stream("twice");
        let jsonl = seen.to_str().unwrap();
        let (run, mut pipe) = fed(folder.path(), &["infer", "--name", &name, "--jsonl", jsonl]);
        pipe.write_all(b"YUV4MPEG2 W64 H64 F30:1 C420\n").unwrap();
        for _ in 0..3 {
            pipe.write_all(b"FRAME\n").unwrap();
            pipe.write_all(&[128; 64 * 64 * 3 / 2]).unwrap();
        }
        let pid = run.pid().to_string();
        // The record of a pipe has its name with the first frame that was looked at.
        eventually("the record", || seen.exists().then_some(()));
        let kill = std::process::Command::new("kill")
            .args([&format!("-{asked}"), &pid, &pid])
            .status()
            .unwrap();
        assert!(kill.success());
        let out = run.wait(Duration::from_secs(60));
        assert_eq!(out.status.code(), Some(0), "{asked}: {}", stderr(&out));
        assert!(count(&seen) > 0, "{asked}: what was seen is lost");
        drop(pipe);
    }
}

/// A terminal that is closed asks everybody on it to stop; who was started with `nohup` goes on.
#[test]
fn what_is_to_outlive_its_terminal_does() {
    let folder = tempfile::tempdir().unwrap();
    let (seen, name) = (folder.path().join("seen.jsonl"), stream("nohup"));
    let mut command = Command::new("sh");
    command
        .args(["-c", "trap '' HUP; exec \"$0\" \"$@\""])
        .arg(edgecap().get_program())
        .args(["infer", "--input", "demo", "--live", "--name", &name])
        .args(SMALL)
        .arg("--jsonl")
        .arg(&seen)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let run = Running(command.spawn().unwrap());
    let frames = || std::fs::read_to_string(&seen).map_or(0, |t| t.lines().count());
    eventually("frames", || (frames() > 0).then_some(()));
    signal(run.pid(), "HUP");
    let before = frames();
    eventually("more frames", || (frames() > before + 5).then_some(()));
    signal(run.pid(), "TERM");
    let out = run.wait(Duration::from_secs(60));
    assert_eq!(out.status.code(), Some(0), "{}", stderr(&out));
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
