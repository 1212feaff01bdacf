//! The two processes and their supervisor on the bundled clip: the way through, crashes, and what is left behind.

use std::path::PathBuf;
use std::process::Output;
use std::time::Duration;

use crate::program::{Running, eventually, signal, stream};
use edgecap::joints::{NECK, PELVIS};
use edgecap::lab::synth::Truth;
use edgecap::lab::synth::truth::VISIBLE;
use edgecap::message::{BodyFrame, ObservationFrame};
use edgecap_client::{Message, Subscriber};

const WHOLE_CLIP: Duration = Duration::from_secs(240);

/// `edgecap run` on the bundled clip, with its bodies in a file of a folder of its own.
struct Demo {
    run: Running,
    name: String,
    folder: tempfile::TempDir,
}

impl Demo {
    fn start(test: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let name = stream(test);
        let result = folder.path().join("bodies.jsonl");
        let bodies = ["--jsonl", result.to_str().unwrap()];
        let args = [&["run", "--input", "demo", "--name", &name], &bodies[..]].concat();
        Self {
            run: Running::start(&args),
            name,
            folder,
        }
    }

    fn result(&self) -> PathBuf {
        self.folder.path().join("bodies.jsonl")
    }

    fn listen<T: Message>(&self) -> Subscriber<T> {
        Subscriber::open(&self.name).unwrap()
    }

    /// Waits for its end; the folder stays until the second is dropped.
    fn wait(self, patience: Duration) -> (Output, tempfile::TempDir) {
        (self.run.wait(patience), self.folder)
    }

    /// Both processes below the supervisor, once they run.
    fn children(&self) -> [u32; 2] {
        eventually("both processes", || {
            Some([self.run.child("infer")?, self.run.child("fit")?])
        })
    }
}

fn lines(path: &std::path::Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(path).expect("the result");
    text.lines()
        .map(|l| serde_json::from_str(l).expect("a line of JSON"))
        .collect()
}

/// Of the necks in sight, how many have a body's neck within a quarter of the head's distance from the pelvis.
fn necks_found(frames: &[serde_json::Value], truth: &Truth) -> (usize, usize) {
    let (mut seen, mut shown) = (0, 0);
    for (frame, truth) in frames.iter().zip(&truth.frames) {
        for person in truth
            .people
            .iter()
            .filter(|p| p.visibility[NECK] == VISIBLE)
        {
            let at = |j: usize| {
                [
                    f64::from(person.joints2d[j][0]),
                    f64::from(person.joints2d[j][1]),
                ]
            };
            let far = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
            let reach = 0.25 * far(at(0), at(PELVIS));
            let near = |body: &serde_json::Value| {
                let uv = &body["joints2d"][NECK];
                far(at(NECK), [uv[0].as_f64().unwrap(), uv[1].as_f64().unwrap()]) < reach
            };
            shown += 1;
            seen += usize::from(frame["people"].as_array().unwrap().iter().any(near));
        }
    }
    (seen, shown)
}

#[test]
fn the_demo_travels_through_both_processes() {
    let demo = Demo::start("demo");
    let result = demo.result();
    let [infer, fit] = demo.children();
    assert_ne!(infer, fit);
    let (out, _folder) = demo.wait(WHOLE_CLIP);
    assert!(out.status.success(), "{}", crate::program::stderr(&out));
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(
        said.contains(result.to_str().unwrap()),
        "the last words name the result: {said}"
    );

    let frames = lines(&result);
    assert_eq!(
        frames.len(),
        edgecap::lab::synth::demo::truth().frames.len(),
        "no frame is lost"
    );
    let (seen, shown) = necks_found(&frames, &edgecap::lab::synth::demo::truth());
    assert!(
        seen * 5 > shown * 2,
        "{seen} of {shown} necks in sight have a body's neck near them"
    );
    for person in frames.iter().flat_map(|f| f["people"].as_array().unwrap()) {
        assert_eq!(person["angles"].as_array().unwrap().len(), 29);
        assert_eq!(person["joints3d"].as_array().unwrap().len(), 21);
        assert!(
            person["position"][2].as_f64().unwrap() > 0.0,
            "people stand before the camera"
        );
    }
}

#[test]
fn without_arguments_and_camera_the_bundled_clip_plays() {
    if edgecap::capture::list_cameras().is_ok() {
        eprintln!("skipped: this machine has a camera");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let out = crate::program::edgecap()
        .current_dir(folder.path())
        .args(["--name", &stream("bare")])
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", crate::program::stderr(&out));
    let result = folder
        .path()
        .join(format!("edgecap-out/{}.bodies.jsonl", stream("bare")));
    assert!(!lines(&result).is_empty());
}

#[test]
fn killing_fit_does_not_stop_infer() {
    let demo = Demo::start("kill-fit");
    let observations = demo.listen::<ObservationFrame>();
    let bodies = demo.listen::<BodyFrame>();
    let wait = Duration::from_millis(100);
    let before = eventually("bodies", || bodies.next(wait).unwrap().map(|b| b.sequence));
    let [infer, fit] = demo.children();
    signal(fit, "KILL");
    let again = eventually("a new fit", || {
        demo.run.child("fit").filter(|&pid| pid != fit)
    });
    assert_ne!(again, fit);
    assert_eq!(demo.run.child("infer"), Some(infer), "infer goes on");
    let after = eventually("bodies of the new fit", || {
        bodies
            .next(wait)
            .unwrap()
            .map(|b| b.sequence)
            .filter(|&s| s > before + 3)
    });
    assert!(after > before);
    assert!(
        eventually("observations", || observations
            .newest(wait)
            .unwrap()
            .map(|o| o.sequence))
            >= after
    );
    drop((observations, bodies));
    let result = demo.result();
    let (out, _folder) = demo.wait(WHOLE_CLIP);
    assert!(out.status.success(), "{}", crate::program::stderr(&out));
    assert!(lines(&result).len() > 10);
}

#[test]
fn a_stopped_run_leaves_no_process_and_no_half_written_file() {
    let demo = Demo::start("stop");
    let bodies = demo.listen::<BodyFrame>();
    eventually("bodies", || {
        bodies.next(Duration::from_millis(100)).unwrap().map(|_| ())
    });
    let children = demo.children();
    drop(bodies);
    let result = demo.result();
    signal(demo.run.pid(), "TERM");
    let (out, folder) = demo.wait(Duration::from_secs(20));
    assert_eq!(
        out.status.code(),
        Some(0),
        "{}",
        crate::program::stderr(&out)
    );
    for pid in children {
        assert!(
            !std::path::Path::new(&format!("/proc/{pid}")).exists(),
            "process {pid} is left"
        );
    }
    let left: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert_eq!(
        left,
        ["bodies.jsonl"],
        "what was received is kept, whole lines only"
    );
    assert!(!lines(&result).is_empty());
}

#[test]
fn children_end_when_their_supervisor_is_killed() {
    let demo = Demo::start("orphans");
    let children = demo.children();
    signal(demo.run.pid(), "KILL");
    for pid in children {
        let gone = || (!std::path::Path::new(&format!("/proc/{pid}/exe")).exists()).then_some(());
        eventually("the child's end", gone);
    }
}
