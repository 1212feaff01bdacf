//! Processes that hang, and what of them is said to the service manager.

use std::io::Write;
use std::os::unix::net::UnixDatagram;
use std::time::{Duration, Instant};

use crate::program::stand_in::{StandIn, Watched, processes_of, program};
use crate::program::{Running, eventually, script, signal, stderr, stream};
use edgecap::camera::monotonic_ns;
use edgecap::message::{BodyFrame, ObservationFrame};
use edgecap_client::{Publisher, Subscriber};
use std::process::Stdio;
use tempfile::TempDir;

fn some_body(bodies: &Subscriber<BodyFrame>) {
    eventually("bodies", || {
        bodies.next(Duration::from_millis(100)).unwrap().map(|_| ())
    });
}

#[test]
fn one_that_is_stopped_in_its_start_is_replaced() {
    let camera = StandIn::new(30.0);
    let watched = Watched::start("stopped-early", &camera, &[]);
    let infer = eventually("infer", || watched.run.child("infer"));
    signal(infer, "STOP");
    eventually("another infer", || {
        watched.run.child("infer").filter(|p| *p != infer)
    });
    some_body(&watched.listen::<BodyFrame>());
    assert!(watched.stop().status.success());
}

/// ffprobe lists all packets of a film, and ffmpeg may be slow to start each time that the film begins anew.
#[test]
#[ignore = "half a minute"]
fn long_a_film_whose_reader_is_slow_is_no_hang() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("clip.ts"), "a film").unwrap();
    script(
        &at("ffprobe"),
        "#!/bin/sh\nsleep 12\nfor t in 0 1 2 3 4 5 6 7 8 9; do echo packet,0.$t; done\necho stream,10/1,10\n",
    );
    let slow = "#!/bin/sh\n\
        if [ \"$1\" = -version ]; then echo 'ffmpeg version 5.1.9-0 x'; exit; fi\n\
        sleep 1.6\n\
        for t in 0 1 2 3 4 5 6 7 8 9; do printf 'P6\\n96 64\\n255\\n'; head -c 18432 /dev/zero; done\n";
    script(&at("ffmpeg"), slow);
    let path = std::env::var("PATH").unwrap();
    let name = stream("slow-film");
    let run = program()
        .args(["run", "--live", "--name", &name, "--input"])
        .arg(at("clip.ts"))
        .args(["--size", "64x64", "--threads", "1"])
        .env("PATH", format!("{}:{path}", folder.path().display()))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let run = Running(run);
    let observations = Subscriber::<ObservationFrame>::open(&name).unwrap();
    // It has begun anew twice.
    eventually("the film a third time", || {
        let seen = observations.next(Duration::from_millis(100)).unwrap()?;
        (seen.sequence >= 20).then_some(())
    });
    signal(run.pid(), "TERM");
    let out = run.wait(Duration::from_secs(60));
    let said = stderr(&out);
    assert!(
        out.status.success() && !said.contains("started again"),
        "{said}"
    );
}

#[test]
fn a_log_that_nobody_reads_holds_nothing_up() {
    let (_reader, mut log) = std::io::pipe().unwrap();
    let flags = rustix::fs::fcntl_getfl(&log).unwrap();
    rustix::fs::fcntl_setfl(&log, flags | rustix::fs::OFlags::NONBLOCK).unwrap();
    while log.write(&[b'.'; 4096]).is_ok() {}
    // Whoever writes to it from now on waits for ever.
    rustix::fs::fcntl_setfl(&log, flags).unwrap();
    let camera = StandIn::new(30.0);
    let name = stream("full-log");
    let run = program()
        .args(["run", "--input", &camera.input(), "--name", &name])
        .args(["--size", "64x64", "--threads", "1"])
        .env("EDGECAP_LOG", "info")
        .stdout(Stdio::null())
        .stderr(log)
        .spawn()
        .unwrap();
    let run = Running(run);
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    some_body(&bodies);
    // Its children are looked after all the same, and it ends when it should.
    for verb in ["infer", "fit"] {
        let child = eventually(verb, || run.child(verb));
        signal(child, "KILL");
        eventually("another", || run.child(verb).filter(|p| *p != child));
    }
    let from = monotonic_ns();
    eventually("a new body", || {
        let body = bodies.next(Duration::from_millis(100)).unwrap()?;
        (body.capture_ns >= from).then_some(())
    });
    drop(bodies);
    signal(run.pid(), "TERM");
    eventually("its end", || run.has_ended().then_some(()));
}

#[test]
fn children_that_are_stopped_end_with_their_supervisor_too() {
    let camera = StandIn::new(30.0);
    let watched = Watched::start("stopped-orphans", &camera, &[]);
    some_body(&watched.listen::<BodyFrame>());
    let children = ["infer", "fit"].map(|v| eventually(v, || watched.run.child(v)));
    // Stopped itself, the supervisor cannot replace them.
    signal(watched.run.pid(), "STOP");
    for child in children {
        signal(child, "STOP");
    }
    signal(watched.run.pid(), "KILL");
    eventually("the end of all", || {
        processes_of(&watched.name, &[watched.run.pid()])
            .is_empty()
            .then_some(())
    });
}

/// What the stand-in of the service manager hears until `done`.
fn heard(manager: &UnixDatagram, mut done: impl FnMut(&str) -> bool) {
    let start = Instant::now();
    let mut buffer = [0; 4096];
    loop {
        assert!(start.elapsed() < Duration::from_secs(60), "nothing came");
        if let Ok(n) = manager.recv(&mut buffer)
            && done(&String::from_utf8_lossy(&buffer[..n]))
        {
            return;
        }
    }
}

#[test]
fn the_service_manager_hears_of_progress_only() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notify");
    let manager = UnixDatagram::bind(&path).unwrap();
    manager
        .set_read_timeout(Some(Duration::from_millis(100)))
        .unwrap();
    let camera = StandIn::new(30.0);
    let variables = [
        ("NOTIFY_SOCKET", path.to_str().unwrap()),
        ("WATCHDOG_USEC", "400000"),
    ];
    let watched = Watched::start_with("notify", &camera, &[], &variables);
    heard(&manager, |m| m.contains("READY=1"));
    heard(&manager, |m| m.contains("WATCHDOG=1"));
    let children = ["infer", "fit"].map(|v| eventually(v, || watched.run.child(v)));
    for child in children {
        let environment = std::fs::read(format!("/proc/{child}/environ")).unwrap();
        assert!(
            !String::from_utf8_lossy(&environment).contains("NOTIFY_SOCKET"),
            "a child could speak for the service"
        );
    }
    for child in children {
        signal(child, "STOP");
    }
    // Until they are replaced nothing goes on, so nothing may be heard; then it is again.
    let mut last = Instant::now();
    let mut longest = Duration::ZERO;
    heard(&manager, |m| {
        if m.contains("WATCHDOG=1") {
            longest = longest.max(last.elapsed());
            last = Instant::now();
        }
        longest > Duration::from_millis(600)
    });
    camera.unplug();
    heard(&manager, |m| m.contains("STATUS=waiting for the camera"));
    for _ in 0..3 {
        heard(&manager, |m| m.contains("WATCHDOG=1"));
    }
    signal(watched.run.pid(), "TERM");
    heard(&manager, |m| m.contains("STOPPING=1"));
    assert!(watched.run.wait(Duration::from_secs(60)).status.success());
}

/// The processes of one of several cameras.
fn children_of(run: &Running, camera: &str) -> Vec<u32> {
    eventually("both processes of a camera", || {
        let found = processes_of(camera, &[run.pid()]);
        (found.len() == 2).then_some(found)
    })
}

/// A run of two cameras, and what hears of it in the service manager's place. The folder holds settings and socket.
fn of_two_cameras(
    cameras: &[StandIn; 2],
    names: &[String; 2],
    run: &[&str],
) -> (UnixDatagram, Running, TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notify");
    let manager = UnixDatagram::bind(&path).unwrap();
    manager
        .set_read_timeout(Some(Duration::from_millis(100)))
        .unwrap();
    let mut settings = "[network]\nsize = \"64x64\"\nthreads = 1\n".to_owned();
    for (camera, name) in cameras.iter().zip(names) {
        settings += &format!(
            "[[camera]]\nname = {name:?}\ninput = {:?}\n",
            camera.input()
        );
    }
    let file = folder.path().join("edgecap.toml");
    std::fs::write(&file, settings).unwrap();
    let run = crate::program::edgecap()
        .args(run)
        .args(["--config", file.to_str().unwrap()])
        .env("NOTIFY_SOCKET", &path)
        .env("WATCHDOG_USEC", "400000")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    (manager, Running(run.unwrap()), folder)
}

#[test]
fn a_camera_that_is_stuck_is_not_hidden_by_one_that_goes_well() {
    let cameras = [StandIn::new(30.0), StandIn::new(30.0)];
    let names = [stream("well"), stream("stuck")];
    let (manager, run, _folder) = of_two_cameras(&cameras, &names, &["run"]);
    heard(&manager, |m| m.contains("READY=1"));
    heard(&manager, |m| m.contains("WATCHDOG=1"));
    for child in children_of(&run, &names[1]) {
        signal(child, "STOP");
    }
    // The other goes on; until these are replaced nothing may be heard all the same.
    let mut last = Instant::now();
    let mut longest = Duration::ZERO;
    heard(&manager, |m| {
        if m.contains("WATCHDOG=1") {
            longest = longest.max(last.elapsed());
            last = Instant::now();
        }
        longest > Duration::from_millis(600)
    });
    cameras[1].unplug();
    let waits = format!("{}: waiting for the camera", names[1]);
    heard(&manager, |m| m.contains(&waits));
    for _ in 0..3 {
        heard(&manager, |m| m.contains("WATCHDOG=1"));
    }
    signal(run.pid(), "TERM");
    heard(&manager, |m| m.contains("STOPPING=1"));
    eventually("the end", || run.has_ended().then_some(()));
}

/// The service manager would end it again and again, and with it the one that goes well.
#[test]
fn a_camera_that_has_ended_keeps_the_service_of_the_others_from_nothing() {
    let cameras = [StandIn::new(30.0), StandIn::absent(30.0)];
    let names = [stream("goes-on"), stream("not-there")];
    let (manager, run, _folder) = of_two_cameras(&cameras, &names, &["run", "--no-wait"]);
    heard(&manager, |m| m.contains("READY=1"));
    let ended = format!("{}: ended", names[1]);
    heard(&manager, |m| m.contains(&ended));
    for _ in 0..3 {
        heard(&manager, |m| m.contains("WATCHDOG=1"));
    }
    signal(run.pid(), "TERM");
    heard(&manager, |m| m.contains("STOPPING=1"));
    eventually("the end", || run.has_ended().then_some(()));
}

fn observation(sequence: u64) -> ObservationFrame {
    let now = monotonic_ns();
    ObservationFrame {
        sequence,
        width: 640,
        height: 480,
        capture_ns: now,
        publish_ns: now,
        ..ObservationFrame::default()
    }
}

#[test]
fn what_waited_while_fit_stood_still_is_not_published_as_new() {
    let name = stream("stale");
    let mut observations = Publisher::<ObservationFrame>::open(&name).unwrap();
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    let fit = Running::start(&["fit", "--name", &name]);
    eventually("fit", || {
        (observations.subscriber_count() > 0).then_some(())
    });
    // Fresh for as long as this test may take.
    let mut first = observation(0);
    first.publish_ns += 60_000_000_000;
    observations.publish(&first).unwrap();
    some_body(&bodies);
    signal(fit.pid(), "STOP");
    for sequence in 1..5 {
        observations.publish(&observation(sequence)).unwrap();
    }
    std::thread::sleep(Duration::from_millis(1500));
    // Fresh for as long as this test may take.
    let mut fresh = observation(5);
    fresh.publish_ns += 60_000_000_000;
    observations.publish(&fresh).unwrap();
    signal(fit.pid(), "CONT");
    let next = eventually("a body", || {
        let body = bodies.next(Duration::from_millis(100)).unwrap()?;
        Some(body.sequence)
    });
    assert_eq!(next, 5);
}

#[test]
fn bodies_count_on_where_another_infer_begins_anew() {
    let name = stream("count-on");
    let mut observations = Publisher::<ObservationFrame>::open(&name).unwrap();
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    let _fit = Running::start(&["fit", "--name", &name]);
    eventually("fit", || {
        (observations.subscriber_count() > 0).then_some(())
    });
    let published = [6, 7, 0, 1, 3].map(|sequence| {
        // Fresh for as long as this test may take.
        let mut fresh = observation(sequence);
        fresh.publish_ns += 60_000_000_000;
        observations.publish(&fresh).unwrap();
        eventually("a body", || {
            let body = bodies.next(Duration::from_millis(100)).unwrap()?;
            Some(body.sequence)
        })
    });
    assert_eq!(published, [6, 7, 8, 9, 11]);
}

#[test]
fn extrapolation_ends_when_nothing_was_seen_for_long() {
    let name = stream("extrapolation");
    let mut observations = Publisher::<ObservationFrame>::open(&name).unwrap();
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    let fit = Running::start(&["fit", "--name", &name, "--rate", "50"]);
    eventually("fit", || {
        (observations.subscriber_count() > 0).then_some(())
    });
    // Fresh for as long as this test may take.
    let mut first = observation(0);
    first.publish_ns += 60_000_000_000;
    observations.publish(&first).unwrap();
    some_body(&bodies);
    some_body(&bodies);
    std::thread::sleep(Duration::from_millis(1500));
    eventually("silence", || {
        while bodies.next(Duration::ZERO).unwrap().is_some() {}
        bodies
            .next(Duration::from_millis(300))
            .unwrap()
            .is_none()
            .then_some(())
    });
    drop(fit);
}
