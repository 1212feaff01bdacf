//! The processes on the bundled clip: the way through, crashes, and what is left behind.

use std::path::PathBuf;
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

use crate::program::{self, Running, eventually, signal, stream};
use edgecap::camera::monotonic_ns;
use edgecap::joints::{NECK, PELVIS};
use edgecap::lab::synth::Truth;
use edgecap::lab::synth::truth::VISIBLE;
use edgecap::message::{BodyFrame, FLAG_END_OF_STREAM, ObservationFrame};
use edgecap_client::{Message, Publisher, Subscriber};

const WHOLE_CLIP: Duration = Duration::from_secs(240);

/// `edgecap run` on the bundled clip played like a camera, with its bodies in a file of a folder of its own.
struct Camera {
    run: Running,
    name: String,
    folder: tempfile::TempDir,
}

impl Camera {
    fn start(test: &str, more: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let name = stream(test);
        let result = folder.path().join("bodies.jsonl");
        let args = [
            "run", "--live", "--input", "demo", "--size", "256x160", "--name", &name,
        ];
        let bodies = ["--jsonl", result.to_str().unwrap()];
        Self {
            run: Running::start(&[&args[..], &bodies, more].concat()),
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

    /// Ends it; the folder stays until the second is dropped.
    fn stop(self) -> (Output, tempfile::TempDir) {
        signal(self.run.pid(), "TERM");
        (self.run.wait(Duration::from_secs(60)), self.folder)
    }

    /// Both processes below the supervisor, once they run.
    fn children(&self) -> [u32; 2] {
        eventually("both processes", || {
            Some([self.run.child("infer")?, self.run.child("fit")?])
        })
    }

    /// Another process of the verb than this one.
    fn replaced(&self, verb: &str, old: u32) -> u32 {
        eventually("a new process", || {
            self.run.child(verb).filter(|&p| p != old)
        })
    }
}

fn some_body(bodies: &Subscriber<BodyFrame>) -> u64 {
    eventually("bodies", || {
        bodies
            .next(Duration::from_millis(100))
            .unwrap()
            .map(|b| b.publish_ns)
    })
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
fn a_file_travels_through_one_process_and_none_of_it_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("bodies.jsonl");
    let args = [
        "run",
        "--input",
        "demo",
        "--name",
        &stream("demo"),
        "--jsonl",
    ];
    let run = Running::start(&[&args[..], &[result.to_str().unwrap()]].concat());
    let mut helpers = 0;
    let out = loop {
        helpers += usize::from(run.child("infer").or(run.child("fit")).is_some());
        if run.has_ended() {
            break run.wait(WHOLE_CLIP);
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    assert_eq!(helpers, 0);
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
fn without_arguments_and_camera_the_bundled_clip_plays_until_it_is_stopped() {
    if edgecap::capture::list_cameras().is_ok() {
        eprintln!("skipped: this machine has a camera");
        return;
    }
    let place = crate::program::short_folder();
    let child = program::edgecap()
        .env("EDGECAP_RUNTIME_DIR", place.path())
        .args(["--size", "64x64", "--threads", "1"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let run = Running(child);
    // Under the name that every example reads.
    let bodies = Subscriber::<BodyFrame>::open_at(place.path(), "camera0").unwrap();
    let frame = eventually("a frame", || {
        bodies.next(Duration::from_millis(500)).unwrap()
    });
    assert_eq!(frame.flags, 0, "it is live, and goes on");
    drop((frame, bodies));
    signal(run.pid(), "INT");
    let out = run.wait(Duration::from_secs(60));
    let said = program::stderr(&out);
    assert!(out.status.success(), "{said}");
    assert!(said.contains("edgecap.bodies('camera0')"), "{said}");
    assert!(said.contains(" view --camera camera0"), "{said}");
    let folder = format!("EDGECAP_RUNTIME_DIR={} ", place.path().display());
    assert_eq!(said.matches(&folder).count(), 2, "{said}");
}

#[test]
fn killing_fit_does_not_stop_infer() {
    let camera = Camera::start("kill-fit", &[]);
    let observations = camera.listen::<ObservationFrame>();
    let bodies = camera.listen::<BodyFrame>();
    some_body(&bodies);
    let [infer, fit] = camera.children();
    signal(fit, "KILL");
    camera.replaced("fit", fit);
    while bodies.next(Duration::ZERO).unwrap().is_some() {}
    some_body(&bodies);
    assert_eq!(camera.run.child("infer"), Some(infer), "infer goes on");
    let wait = Duration::from_millis(500);
    eventually("observations", || {
        observations.next(wait).unwrap().map(|_| ())
    });
    drop((observations, bodies));
    let (out, folder) = camera.stop();
    assert!(out.status.success(), "{}", program::stderr(&out));
    // How many depends on the machine.
    assert!(!lines(&folder.path().join("bodies.jsonl")).is_empty());
}

/// With a rate, bodies keep coming however infer does: for a second those of what it saw last.
#[test]
fn a_dead_infer_is_replaced_while_bodies_keep_coming() {
    let camera = Camera::start("kill-infer", &["--rate", "240"]);
    let bodies = camera.listen::<BodyFrame>();
    some_body(&bodies);
    let [infer, fit] = camera.children();
    // Stopped, the supervisor does not start another one.
    signal(camera.run.pid(), "STOP");
    while bodies.next(Duration::ZERO).unwrap().is_some() {}
    some_body(&bodies);
    signal(infer, "KILL");
    let killed = monotonic_ns();
    let mut published = killed;
    for _ in 0..3 {
        published = eventually("bodies of the dead one's pictures", || {
            let body = bodies.next(Duration::from_millis(100)).unwrap()?;
            assert!(body.capture_ns <= killed, "nobody sees anything");
            (body.publish_ns > published).then_some(body.publish_ns)
        });
    }
    signal(camera.run.pid(), "CONT");
    camera.replaced("infer", infer);
    let mut shown = monotonic_ns();
    for _ in 0..3 {
        shown = eventually("bodies of the new one's pictures", || {
            let body = bodies.next(Duration::from_millis(100)).unwrap()?;
            (body.capture_ns > shown).then_some(body.capture_ns)
        });
    }
    assert_eq!(camera.run.child("fit"), Some(fit));
    assert!(camera.stop().0.status.success());
}

/// What its children have open, they have opened.
#[test]
fn children_have_nothing_open_of_their_supervisor() {
    let camera = Camera::start("open", &[]);
    let bodies = camera.listen::<BodyFrame>();
    some_body(&bodies);
    let open = |pid: u32| -> Vec<PathBuf> {
        let fds = std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap();
        let names = fds
            .flatten()
            .filter_map(|fd| std::fs::read_link(fd.path()).ok());
        names
            .filter(|n| n.to_string_lossy().starts_with("socket:"))
            .collect()
    };
    // It listens to bodies, and begins when it comes to it.
    let supervisors = eventually("a socket of the supervisor's", || {
        Some(open(camera.run.pid())).filter(|sockets| !sockets.is_empty())
    });
    // Those that are started now could have what the supervisor has opened.
    for verb in ["infer", "fit"] {
        let old = eventually(verb, || camera.run.child(verb));
        signal(old, "KILL");
        camera.replaced(verb, old);
        while bodies.next(Duration::ZERO).unwrap().is_some() {}
        some_body(&bodies);
    }
    for child in camera.children() {
        let both: Vec<PathBuf> = open(child)
            .into_iter()
            .filter(|s| supervisors.contains(s))
            .collect();
        assert!(both.is_empty(), "{both:?}");
    }
    camera.stop();
}

/// Only the supervisor's own signal, or the end of the input, ends a run.
#[test]
fn a_child_that_is_asked_to_end_is_replaced() {
    let camera = Camera::start("asked", &[]);
    let bodies = camera.listen::<BodyFrame>();
    for (verb, name) in [("infer", "TERM"), ("fit", "TERM"), ("infer", "INT")] {
        some_body(&bodies);
        let old = eventually(verb, || camera.run.child(verb));
        signal(old, name);
        camera.replaced(verb, old);
        assert!(!camera.run.has_ended());
        while bodies.next(Duration::ZERO).unwrap().is_some() {}
    }
    some_body(&bodies);
    drop(bodies);
    let (out, _folder) = camera.stop();
    assert!(out.status.success(), "{}", program::stderr(&out));
    assert!(
        program::stderr(&out).contains("infer ended with exit code 130; starting it again"),
        "{}",
        program::stderr(&out)
    );
}

#[test]
fn a_child_that_hangs_is_replaced() {
    let camera = Camera::start("hang", &[]);
    let bodies = camera.listen::<BodyFrame>();
    for verb in ["infer", "fit"] {
        some_body(&bodies);
        let old = eventually(verb, || camera.run.child(verb));
        signal(old, "STOP");
        camera.replaced(verb, old);
        while bodies.next(Duration::ZERO).unwrap().is_some() {}
    }
    some_body(&bodies);
    let (out, _folder) = camera.stop();
    assert!(
        program::stderr(&out).contains("infer hangs"),
        "{}",
        program::stderr(&out)
    );
}

#[test]
fn a_reader_notices_within_a_second_that_the_publisher_has_gone_and_is_back() {
    let camera = Camera::start("presence", &[]);
    let bodies = camera.listen::<BodyFrame>();
    some_body(&bodies);
    let mut took = Vec::new();
    for _ in 0..3 {
        // On a busy machine signs of life may come late.
        eventually("its presence", || {
            (bodies.publisher_count() == 1).then_some(())
        });
        let fit = camera.children()[1];
        // Stopped, the supervisor does not start another one.
        signal(camera.run.pid(), "STOP");
        signal(fit, "KILL");
        let killed = Instant::now();
        eventually("its absence", || {
            (bodies.publisher_count() == 0).then_some(())
        });
        took.push(killed.elapsed());
        signal(camera.run.pid(), "CONT");
        eventually("its return", || {
            (bodies.publisher_count() == 1).then_some(())
        });
    }
    // The shortest: this process may have waited for the processor.
    let shortest = took.into_iter().min().unwrap();
    assert!(shortest < Duration::from_secs(1), "{shortest:?}");
    drop(bodies);
    camera.stop();
}

/// Processes find each other, too, when the folder that they would take has come since they began.
#[test]
fn a_session_that_begins_later_parts_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("bodies.jsonl");
    let session = folder.path().join("session");
    let run = program::edgecap()
        .args(["run", "--live", "--input", "demo", "--size", "256x160"])
        .args(["--name", &stream("session"), "--jsonl"])
        .arg(&result)
        .env_remove("EDGECAP_RUNTIME_DIR")
        .env("XDG_RUNTIME_DIR", &session)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let run = Running(run.unwrap());
    let frames = || std::fs::read_to_string(&result).map_or(0, |t| t.lines().count());
    eventually("frames", || (frames() > 0).then_some(()));
    std::fs::create_dir(&session).unwrap();
    let infer = eventually("infer", || run.child("infer"));
    signal(infer, "KILL");
    eventually("another infer", || {
        run.child("infer").filter(|p| *p != infer)
    });
    let before = frames();
    eventually("more frames", || (frames() > before + 10).then_some(()));
    assert_eq!(std::fs::read_dir(&session).unwrap().count(), 0);
    signal(run.pid(), "TERM");
    assert!(run.wait(Duration::from_secs(60)).status.success());
}

#[test]
fn nothing_follows_the_end_of_the_stream() {
    let name = stream("end");
    let mut observations = Publisher::<ObservationFrame>::open(&name).unwrap();
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    let fit = Running::start(&["fit", "--name", &name, "--rate", "100"]);
    eventually("fit", || {
        (observations.subscriber_count() > 0).then_some(())
    });
    let mut frame = ObservationFrame {
        width: 640,
        height: 480,
        capture_ns: monotonic_ns(),
        // Fresh for as long as this test may take.
        publish_ns: monotonic_ns() + 60_000_000_000,
        ..ObservationFrame::default()
    };
    observations.publish(&frame).unwrap();
    some_body(&bodies);
    // Stopped, it wakes with the end of the stream before it and a tick behind it.
    signal(fit.pid(), "STOP");
    frame.flags |= FLAG_END_OF_STREAM;
    observations.publish(&frame).unwrap();
    std::thread::sleep(Duration::from_millis(50));
    signal(fit.pid(), "CONT");
    let mut last = 0;
    eventually("the end", || {
        while let Some(frame) = bodies.next(Duration::ZERO).unwrap() {
            last = frame.flags;
        }
        fit.has_ended().then_some(())
    });
    while let Some(frame) = bodies.next(Duration::ZERO).unwrap() {
        last = frame.flags;
    }
    assert_ne!(last & FLAG_END_OF_STREAM, 0, "the end comes last");
}

#[test]
fn a_stopped_run_leaves_no_process_and_no_half_written_file() {
    let camera = Camera::start("stop", &[]);
    let bodies = camera.listen::<BodyFrame>();
    some_body(&bodies);
    let children = camera.children();
    drop(bodies);
    let result = camera.result();
    let (out, folder) = camera.stop();
    assert_eq!(out.status.code(), Some(0), "{}", program::stderr(&out));
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
    let camera = Camera::start("orphans", &[]);
    let children = camera.children();
    signal(camera.run.pid(), "KILL");
    for pid in children {
        let gone = || (!std::path::Path::new(&format!("/proc/{pid}/exe")).exists()).then_some(());
        eventually("the child's end", gone);
    }
}
