//! What a camera says of itself: that it is there, away, back, left alone, too slow; and that its process was ended.

use std::time::Duration;

use crate::program::stand_in::{StandIn, Watched};
use crate::program::{Running, edgecap, eventually, signal, stderr, stdout, stream};
use edgecap::camera::monotonic_ns;
use edgecap::message::{
    BodyFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, HealthFrame, HealthPace, HealthState,
};
use edgecap_client::{Publisher, Subscriber};

/// Waits for a message of which this is true.
fn told(
    health: &Subscriber<HealthFrame>,
    what: &str,
    is_it: impl Fn(&HealthFrame) -> bool,
) -> HealthFrame {
    eventually(what, || {
        let told = health.next(Duration::from_millis(100)).unwrap()?;
        is_it(&told).then_some(*told)
    })
}

#[test]
fn a_camera_that_goes_away_and_comes_back_says_so_all_the_while() {
    let camera = StandIn::absent(30.0);
    let watched = Watched::start("health", &camera, &["--no-idle"]);
    let health = watched.listen::<HealthFrame>();
    let away = told(&health, "its absence", |h| h.state == HealthState::AWAY);
    assert_eq!((away.capture_ns, away.observed, away.reconnects), (0, 0, 0));
    assert_eq!((away.cameras, away.cameras_live), (1, 0));
    camera.plug_in();
    let live = told(&health, "pictures", |h| {
        h.state == HealthState::LIVE && h.observed_hz > 0.0
    });
    assert_eq!((live.input_width, live.input_height), (64, 64));
    assert_eq!(
        (live.reconnects, live.restarts, live.cameras_live),
        (0, 0, 1)
    );
    assert!((25.0..=35.0).contains(&live.source_hz), "{live:?}");
    assert!(live.latency_us > 0 && live.capture_ns > live.started_ns);
    camera.unplug();
    let gone = told(&health, "its absence", |h| h.state == HealthState::AWAY);
    let later = told(&health, "its absence again", |h| {
        h.publish_ns >= gone.publish_ns + 500_000_000
    });
    // It is the same absence, and nobody takes it for an empty place.
    assert_eq!((later.state, later.since_ns), (gone.state, gone.since_ns));
    assert_eq!(
        (later.observed_hz, later.source_hz, later.people),
        (0.0, 0.0, 0)
    );
    assert!(later.state_seconds() >= 0.5 && later.observed >= live.observed);
    camera.plug_in();
    let back = told(&health, "pictures", |h| h.state == HealthState::LIVE);
    assert_eq!((back.reconnects, back.started_ns), (1, live.started_ns));
    assert!(back.capture_ns > gone.publish_ns && back.sequence > live.sequence);
    signal(watched.run.pid(), "TERM");
    let end = told(&health, "the end", |h| h.flags & FLAG_END_OF_STREAM != 0);
    assert_eq!(
        (end.state, end.flags),
        (HealthState::ENDED, FLAG_END_OF_STREAM)
    );
    drop(health);
    assert!(watched.run.wait(Duration::from_secs(60)).status.success());
}

#[test]
fn an_infer_that_is_killed_or_hangs_is_told_by_the_next_one() {
    let camera = StandIn::new(30.0);
    let watched = Watched::start("health-killed", &camera, &["--no-idle"]);
    let health = watched.listen::<HealthFrame>();
    let mut before = told(&health, "pictures", |h| h.state == HealthState::LIVE);
    for how in ["KILL", "STOP"] {
        let infer = eventually("infer", || watched.run.child("infer"));
        signal(infer, how);
        let mut newest = before;
        eventually("that nobody tells, or another", || {
            while let Some(told) = health.next(Duration::ZERO).unwrap() {
                newest = *told;
            }
            let is_another = newest.started_ns > before.started_ns;
            let age = monotonic_ns().saturating_sub(newest.publish_ns);
            let is_quiet = health.publisher_count() == 0 || age > 2_000_000_000;
            (is_another || is_quiet).then_some(())
        });
        let again = told(&health, "another infer", |h| {
            h.started_ns > before.started_ns
        });
        assert!(again.restarts > before.restarts, "{how}: {again:?}");
        before = told(&health, "its pictures", |h| h.state == HealthState::LIVE);
    }
    drop(health);
    assert!(watched.stop().status.success());
}

#[test]
fn an_empty_place_is_idle_and_too_many_pictures_are_told() {
    let camera = StandIn::new(10_000.0);
    let watched = Watched::start("health-pace", &camera, &[]);
    let health = watched.listen::<HealthFrame>();
    let behind = told(&health, "that it is too slow", |h| {
        h.pace == HealthPace::BEHIND
    });
    assert_eq!(behind.state, HealthState::LIVE);
    assert!(
        behind.source_hz > behind.observed_hz && behind.left_out > 0,
        "{behind:?}"
    );
    // On a busy machine two glances may come closer to each other.
    let idle = told(&health, "an empty place, glanced at", |h| {
        h.state == HealthState::IDLE && (0.1..5.0).contains(&h.observed_hz)
    });
    assert_eq!((idle.people, idle.pace), (0, HealthPace::UNKNOWN));
    assert_eq!(idle.cameras_live, 1, "{idle:?}");
    drop(health);
    assert!(watched.stop().status.success());
}

#[test]
fn a_film_says_how_far_it_is_and_that_it_has_ended() {
    let name = stream("health-film");
    let folder = tempfile::tempdir().unwrap();
    let health = Subscriber::<HealthFrame>::open(&name).unwrap();
    for verb in ["run", "infer"] {
        let result = folder.path().join("out.jsonl");
        let film = [
            "--input", "demo", "--size", "64x64", "--name", &name, "--jsonl",
        ];
        let args = [&[verb][..], &film, &[result.to_str().unwrap()]].concat();
        let run = Running::start(&args);
        let all: Vec<HealthFrame> = health.messages().map(|m| *m.unwrap()).collect();
        let out = run.wait(Duration::from_secs(120));
        assert!(out.status.success(), "{}", stderr(&out));
        assert_eq!(all[0].state, HealthState::STARTING, "{verb}");
        assert!(all.iter().all(|h| h.flags & FLAG_FILE_TIME != 0));
        let live = all.iter().rfind(|h| h.state == HealthState::LIVE).unwrap();
        assert_eq!((live.latency_us, live.pace), (0, HealthPace::UNKNOWN));
        let end = all.last().unwrap();
        assert_eq!(end.state, HealthState::ENDED);
        assert_eq!((end.input_width, end.input_height), (64, 64));
        let text = std::fs::read_to_string(&result).unwrap();
        assert_eq!(end.observed, text.lines().count() as u64, "{verb}");
        assert_eq!(end.sequence + 1, end.observed);
    }
}

/// As `status` shows it of a camera of which no bodies come.
#[test]
fn status_and_watch_say_why_no_bodies_come() {
    let camera = StandIn::new(30.0);
    let watched = Watched::start("health-shown", &camera, &[]);
    let bodies = watched.listen::<BodyFrame>();
    eventually("bodies", || {
        bodies.next(Duration::from_millis(100)).unwrap().map(|_| ())
    });
    camera.unplug();
    let why = format!("; {}: away for ", watched.name);
    eventually("why in the status", || {
        let out = edgecap().arg("status").output().unwrap();
        let said = stdout(&out);
        let mut lines = said.lines().filter(|l| l.contains(&watched.name));
        let line = lines.find(|l| l.starts_with("NO BODIES"))?;
        line.contains(&why).then_some(())
    });
    let mut watch = Running::start(&["watch", "--name", &watched.name]);
    watch.says("connected, but no frames come: the camera has been away for");
    drop(watch);
    drop(bodies);
    assert!(watched.stop().status.success());
}

/// What was so a while ago is shown to nobody who comes, though its publisher lives.
#[test]
fn what_is_told_is_of_now() {
    let name = stream("health-now");
    let mut publisher = Publisher::<HealthFrame>::open(&name).unwrap();
    let mut publish = |state, ago_ns: u64| {
        let told = HealthFrame {
            publish_ns: monotonic_ns() - ago_ns,
            state,
            ..HealthFrame::default()
        };
        publisher.publish(&told).unwrap();
    };
    publish(HealthState::LIVE, 3_000_000_000);
    let health = Subscriber::<HealthFrame>::open(&name).unwrap();
    assert!(health.next(Duration::ZERO).unwrap().is_none());
    publish(HealthState::AWAY, 0);
    let next = health.next(Duration::from_secs(20)).unwrap().unwrap();
    assert_eq!(next.state, HealthState::AWAY);
}
