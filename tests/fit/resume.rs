//! Work that was broken off goes on, and ends where work that was not broken off does.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use edgecap::body::mesh::MeshBody;
use edgecap::lab::multiview::own::{own, steady};
use edgecap::multiview::{
    Detections, Kept, Mask, Masks, MultiviewFit, MultiviewOptions, Run, Sight, Step, fit,
};

use crate::many_views::files;
use crate::program::{assert_fails, edgecap, output, signal, stderr};

/// Keeps parts in memory, up to so many of them.
#[derive(Default)]
struct Memory {
    parts: Mutex<BTreeMap<String, Vec<u8>>>,
    /// Names in the order in which they came.
    order: Mutex<Vec<String>>,
}

impl Kept for Memory {
    fn get(&self, part: &str) -> Option<Vec<u8>> {
        self.parts.lock().unwrap().get(part).cloned()
    }

    fn put(&self, part: &str, bytes: &[u8]) {
        self.order.lock().unwrap().push(part.to_owned());
        let before = self
            .parts
            .lock()
            .unwrap()
            .insert(part.to_owned(), bytes.to_vec());
        assert!(before.is_none(), "{part} was there");
    }
}

/// Everything of a fit that results are made of, bit by bit.
fn bits(found: &MultiviewFit) -> Vec<u64> {
    let mut all: Vec<u64> = found.weights.iter().map(|w| w.to_bits()).collect();
    for person in &found.people {
        all.extend(person.betas.iter().map(|b| b.to_bits()));
        for f in &person.frames {
            all.extend([f.frame as u64, f.moment.healed as u64]);
            all.extend(f.body.pose.pelvis.to_array().map(f64::to_bits));
            let turns = f.body.pose.rotations.iter().flat_map(|q| q.to_array());
            all.extend(turns.map(f64::to_bits));
            let joints = f.body.posed.joints().iter().flat_map(|j| j.to_array());
            all.extend(joints.map(f64::to_bits));
            for sight in f.moment.sights.iter().flatten() {
                let seen = sight.rays.iter().flatten();
                all.extend(seen.flat_map(|r| r.pixel.to_array()).map(f64::to_bits));
            }
        }
    }
    all
}

/// Fits a person, with and without masks, again and again with what had been kept after each `every`-th part.
fn goes_on_anywhere(frames: usize, paths: bool, masked: bool, every: usize) {
    let trial = own(3, 3, frames, steady(3));
    let seen: Vec<Vec<Detections>> = trial
        .seen
        .iter()
        .map(|views| {
            let each = trial.views.iter().zip(views);
            each.map(|(view, seen)| seen.iter().map(|o| Sight::new(view, o)).collect())
                .collect()
        })
        .collect();
    let options = MultiviewOptions {
        rate: trial.rate,
        paths,
        hierarchy: true,
    };
    let masks: Vec<Vec<Mask>> = match masked {
        true => (0..frames)
            .map(|k| (0..3).map(|v| trial.mask(k, v)).collect())
            .collect(),
        false => Vec::new(),
    };
    let drawn = |frame: usize, view: usize| Some(masks[frame][view].clone());
    let shown: Option<&Masks<'_>> = masked.then_some(&drawn);
    let with = |kept: &dyn Kept| -> (MultiviewFit, [usize; 2]) {
        let steps = Mutex::new([0, 0]);
        let count = |step| match step {
            Step::Planned(_) | Step::Settled => {}
            Step::Restored(n) => steps.lock().unwrap()[0] += n,
            Step::Placed | Step::Outlined | Step::Smoothed => steps.lock().unwrap()[1] += 1,
        };
        let run = Run {
            masks: shown,
            progress: &count,
            kept,
        };
        let used = [true; 3];
        let body = MeshBody::shipped();
        let found = fit(body, &trial.views, &used, &seen, options, run);
        (found, steps.into_inner().unwrap())
    };
    let whole = Memory::default();
    let (found, steps) = with(&whole);
    let expected = bits(&found);
    assert_eq!(steps[0], 0);
    let (parts, order) = (
        whole.parts.into_inner().unwrap(),
        whole.order.into_inner().unwrap(),
    );
    println!("{order:?}");
    for kept in (1..=order.len()).step_by(every) {
        let memory = Memory::default();
        for name in &order[..kept] {
            let part = parts[name].clone();
            memory.parts.lock().unwrap().insert(name.clone(), part);
        }
        let (found, again) = with(&memory);
        assert!(again[0] > 0 || again[1] < steps[1], "{kept}: {again:?}");
        assert!(bits(&found) == expected, "with {:?}", &order[..kept]);
    }
    // Parts that are cut, and parts that are too long.
    let memory = Memory::default();
    for (k, name) in order.iter().enumerate() {
        let part = &parts[name];
        let part = match k % 2 {
            0 => part[..part.len() / 2].to_vec(),
            _ => [part, &b"."[..]].concat(),
        };
        memory.parts.lock().unwrap().insert(name.clone(), part);
    }
    let refused = Unwilling(memory);
    let (found, again) = with(&refused);
    assert!(bits(&found) == expected && again == steps, "{again:?}");
}

/// Gives what it has, takes nothing.
struct Unwilling(Memory);

impl Kept for Unwilling {
    fn get(&self, part: &str) -> Option<Vec<u8>> {
        self.0.get(part)
    }

    fn put(&self, _: &str, _: &[u8]) {}
}

#[test]
fn a_fit_goes_on_from_any_part() {
    goes_on_anywhere(260, true, false, 3);
    goes_on_anywhere(10, false, false, 1);
}

#[test]
fn a_fit_with_masks_goes_on_from_any_part() {
    goes_on_anywhere(6, true, true, 1);
}

/// Arguments of the verb for the files of [`files`].
fn arguments(folder: &Path, run: &str, more: &[&str]) -> Vec<String> {
    let at = |name: &str| folder.join(name).display().to_string();
    let mut args = vec![
        "multiview".to_owned(),
        "--calibration".into(),
        at("Calib.toml"),
    ];
    for view in ["0", "120", "240"] {
        args.extend(["--view".to_owned(), at(&format!("{view}.jsonl"))]);
    }
    args.extend(["--out".to_owned(), at(run)]);
    args.extend(more.iter().map(|m| (*m).to_owned()));
    args
}

fn started(args: &[String]) -> Child {
    let mut command = edgecap();
    command
        .args(args)
        .stderr(Stdio::null())
        .stdout(Stdio::null());
    command.spawn().unwrap()
}

/// Kills what was started when files of its store are as wanted.
fn killed(args: &[String], store: &Path, wanted: impl Fn(&[PathBuf]) -> bool) {
    let mut process = started(args);
    let began = Instant::now();
    loop {
        let entries = fs::read_dir(store).into_iter().flatten().flatten();
        let found: Vec<PathBuf> = entries.map(|e| e.path()).collect();
        if wanted(&found) {
            break;
        }
        assert!(process.try_wait().unwrap().is_none(), "it ended too soon");
        assert!(began.elapsed() < Duration::from_secs(240), "{found:?}");
        std::thread::sleep(Duration::from_millis(1));
    }
    process.kill().unwrap();
    process.wait().unwrap();
    assert!(store.exists(), "it was done before it was killed");
}

/// The last command to its end; what it said.
fn done(args: &[String]) -> String {
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let out = output(&args);
    assert!(out.status.success(), "{}", stderr(&out));
    stderr(&out)
}

fn assert_same(a: &Path, b: &Path) {
    let names = |folder: &Path| {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names(a), names(b));
    for name in names(a) {
        let [a, b] = [a, b].map(|folder| fs::read(folder.join(&name)).unwrap());
        assert!(a == b, "{} differs", name.display());
    }
}

#[test]
fn a_killed_run_goes_on_and_ends_as_one_that_was_not() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files(folder, 3, 300);
    done(&arguments(folder, "whole", &[]));
    let parts = folder.join("run/resume/parts");
    let run = arguments(folder, "run", &[]);
    let part = |name: &str| parts.join(name);
    let has = |name: &'static str| move |found: &[PathBuf]| found.iter().any(|f| f.ends_with(name));
    killed(&run, &parts, has("joints-1-0"));
    let said = done(&run);
    assert!(
        said.contains("goes on: ") && said.contains(" of 600 steps"),
        "{said}"
    );
    assert_same(&folder.join("whole"), &folder.join("run"));

    // One part is cut, one is damaged, one is as it was.
    fs::remove_dir_all(folder.join("run")).unwrap();
    killed(&run, &parts, has("placed-1"));
    let bytes = fs::read(part("placed-1")).unwrap();
    fs::write(part("placed-1"), &bytes[..bytes.len() / 3]).unwrap();
    let mut other = fs::read(part("joints-1-0")).unwrap();
    let middle = other.len() / 2;
    other[middle] ^= 1;
    fs::write(part("joints-1-0"), other).unwrap();
    let said = done(&run);
    assert!(said.contains("goes on: 44 of 600 steps"), "{said}");
    assert_same(&folder.join("whole"), &folder.join("run"));

    // Another option, another file.
    fs::remove_dir_all(folder.join("run")).unwrap();
    killed(&run, &parts, has("joints-1-0"));
    done(&arguments(folder, "plain", &["--no-dct"]));
    let said = done(&arguments(folder, "run", &["--no-dct"]));
    let lines: Vec<&str> = said.lines().filter(|l| l.contains("afresh")).collect();
    assert!(
        matches!(lines[..], [line] if line.contains("--no-dct true")),
        "{said}"
    );
    assert_same(&folder.join("plain"), &folder.join("run"));
    fs::remove_dir_all(folder.join("run")).unwrap();
    killed(&run, &parts, has("joints-1-0"));
    let view = folder.join("120.jsonl");
    fs::write(&view, fs::read(&view).unwrap()).unwrap();
    let said = done(&run);
    assert!(
        said.contains("afresh") && said.contains("120.jsonl"),
        "{said}"
    );
    assert_same(&folder.join("whole"), &folder.join("run"));
}

#[test]
fn a_command_that_names_a_wrong_file_leaves_what_was_kept() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files(folder, 3, 300);
    let parts = folder.join("run/resume/parts");
    let run = arguments(folder, "run", &[]);
    killed(&run, &parts, |found| {
        found.iter().any(|f| f.ends_with("joints-1-0"))
    });
    let mistyped = |name: &str| -> Vec<String> {
        let other = |a: &String| a.replace(name, &format!("gone-{name}"));
        run.iter().map(other).collect()
    };
    let masks = folder.join("gone").display().to_string();
    let masks = arguments(folder, "run", &["--masks", &masks]);
    for (args, code) in [
        (mistyped("120.jsonl"), 66),
        (mistyped("Calib.toml"), 66),
        (masks, 65),
        (arguments(folder, "run", &["--hold-out", "gone"]), 64),
        (arguments(folder, "run", &["--obj", "300"]), 64),
    ] {
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        assert_fails(&args, code, &[]);
    }
    let said = done(&run);
    assert!(
        said.contains("goes on: ") && !said.contains("afresh"),
        "{said}"
    );
}

/// Somebody puts files into the folder while the bodies are computed.
#[test]
fn results_come_into_a_folder_that_is_no_longer_empty() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files(folder, 3, 40);
    let whole = folder.join("whole");
    done(&arguments(folder, "whole", &[]));
    for (name, is_taken) in [("letter.txt", false), ("report.json", true)] {
        let run = folder.join("run");
        let mut process = started(&arguments(folder, "run", &[]));
        let pid = process.id();
        let began = Instant::now();
        while !run.join("resume/lock").exists() {
            assert!(process.try_wait().unwrap().is_none(), "it ended too soon");
            assert!(began.elapsed() < Duration::from_secs(240));
            std::thread::sleep(Duration::from_millis(1));
        }
        signal(pid, "STOP");
        assert!(run.join("resume").exists(), "it was done before");
        fs::write(run.join(name), "Dear").unwrap();
        signal(pid, "CONT");
        let ended = process.wait().unwrap();
        assert_eq!(fs::read_to_string(run.join(name)).unwrap(), "Dear");
        let made = match is_taken {
            false => {
                assert!(ended.success());
                fs::remove_file(run.join(name)).unwrap();
                run.clone()
            }
            true => {
                assert_eq!(ended.code(), Some(73));
                let kept = fs::read_dir(run.join("resume")).unwrap();
                let mut kept = kept.map(|e| e.unwrap().path());
                kept.find(|p| p.extension().is_some_and(|e| e == "part"))
                    .expect("the results")
            }
        };
        assert_same(&whole, &made);
        fs::remove_dir_all(run).unwrap();
    }
}

#[test]
fn a_run_that_was_only_begun_had_no_other_inputs() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files(folder, 3, 10);
    let resume = folder.join("run/resume");
    fs::create_dir_all(&resume).unwrap();
    // As a power cut leaves it.
    fs::write(resume.join(".edgecap-aaaaaa.part"), "edge").unwrap();
    let said = done(&arguments(folder, "run", &[]));
    assert!(!said.contains("afresh"), "{said}");
    assert!(!resume.exists());
}

#[test]
fn a_folder_in_which_somebody_works_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files(folder, 3, 300);
    let run = arguments(folder, "run", &[]);
    let store = folder.join("run/resume");
    killed(&run, &store, |found| {
        found.iter().any(|f| f.ends_with("parts"))
    });
    let lock = fs::File::open(store.join("lock")).unwrap();
    lock.lock().unwrap();
    let args: Vec<&str> = run.iter().map(String::as_str).collect();
    assert_fails(&args, 75, &["nobody else", "run"]);
    drop(lock);
    // A folder of this name that is the user's.
    let own = folder.join("own/resume");
    fs::create_dir_all(&own).unwrap();
    fs::write(own.join("letter.txt"), "Dear").unwrap();
    let other = arguments(folder, "own", &[]);
    let args: Vec<&str> = other.iter().map(String::as_str).collect();
    assert_fails(&args, 73, &["holds files"]);
    assert!(own.join("letter.txt").exists());
}

#[test]
fn films_are_looked_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let at = |name: &str| folder.join(name).display().to_string();
    let hall = at("hall");
    let synth = [
        "synth", "--views", "2", "--people", "1", "--frames", "6", "--fps", "10",
    ];
    let synth = [
        &synth[..],
        &[
            "--width", "640", "--height", "400", "--seed", "2", "--out", &hall,
        ],
    ]
    .concat();
    let out = output(&synth);
    assert!(out.status.success(), "{}", stderr(&out));
    let (calibration, films) = (
        at("hall/Calib.toml"),
        ["01", "02"].map(|k| at(&format!("hall/cam{k}.avi"))),
    );
    let of = |out: &str| -> Vec<String> {
        let args = ["multiview", "--calibration", &calibration, "--sync", "none"];
        let more = [
            "--masks",
            "background",
            "--view",
            &films[0],
            "--view",
            &films[1],
            "--out",
            out,
        ];
        args.iter().chain(&more).map(|a| (*a).to_owned()).collect()
    };
    let said = done(&of(&at("whole")));
    assert!(!said.contains("no lens"), "the calibration has it: {said}");
    let run = of(&at("run"));
    let store = folder.join("run/resume");
    let sealed = |found: &[PathBuf]| {
        found
            .iter()
            .any(|f| f.extension().is_some_and(|e| e == "seal"))
    };
    killed(&run, &store, sealed);
    let said = done(&run);
    assert!(said.contains("goes on: 1 of 2 views"), "{said}");
    assert_same(&folder.join("whole"), &folder.join("run"));
    // Masks of one camera are whole, those of the other not; an observation is damaged.
    fs::remove_dir_all(folder.join("run")).unwrap();
    killed(&run, &store.join("masks"), sealed);
    let records = fs::read_dir(&store).unwrap().map(|e| e.unwrap().path());
    let record = records
        .filter(|p| p.extension().is_none())
        .find(|p| {
            p.file_name()
                .unwrap()
                .display()
                .to_string()
                .starts_with("film-")
        })
        .unwrap();
    let bytes = fs::read(&record).unwrap();
    fs::write(&record, &bytes[..bytes.len() - 9]).unwrap();
    let said = done(&run);
    assert!(said.contains("goes on: 1 of 2 views"), "{said}");
    assert_same(&folder.join("whole"), &folder.join("run"));
    // A camera's name is no place in the file system.
    let own = folder.join("own");
    fs::create_dir(&own).unwrap();
    fs::write(own.join("letter.txt"), "Dear").unwrap();
    let text = fs::read_to_string(&calibration).unwrap();
    assert!(text.contains("\"cam01\""), "{text}");
    let text = text.replace("\"cam01\"", "\"../../../own\"");
    let text = text.replace("\"cam02\"", "\"../../../other\"");
    fs::write(&calibration, text).unwrap();
    done(&of(&at("named")));
    assert!(own.join("letter.txt").exists());
    assert_eq!(fs::read_dir(&own).unwrap().count(), 1);
    assert!(!folder.join("other").exists());
}
