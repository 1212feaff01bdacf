//! Many frames through the real `run`: its memory stays as it is, and every frame is accounted for.
//!
//! Some thousands by default. A million, with the smallest network and a camera that is never late, hours on two cores
//! (`EDGECAP_MINUTES` ends it before):
//!
//! ```sh
//! cargo build --release
//! EDGECAP_PROGRAM=target/release/edgecap EDGECAP_FRAMES=1000000 EDGECAP_FPS=1000 \
//!     cargo test --test processes -- --ignored --nocapture long_frames_without_end
//! ```

use std::time::{Duration, Instant};

use crate::program::eventually;
use crate::program::place::{descriptors, memory, messages_written, number, own_place};
use crate::program::stand_in::{StandIn, Watched};
use edgecap::camera::monotonic_ns;
use edgecap::message::{BodyFrame, ObservationFrame};

/// Latency is kept in classes of 0.1 ms.
const CLASS_NS: u64 = 100_000;
const CLASSES: usize = 100_000;

/// Sequence numbers of a stream: how many came, and how many were left out between them.
#[derive(Debug, Default)]
struct Account {
    first: Option<u64>,
    last: u64,
    came: u64,
}

impl Account {
    fn count(&mut self, sequence: u64) {
        if self.first.is_none() {
            self.first = Some(sequence);
        } else {
            assert!(sequence > self.last, "{sequence} after {}", self.last);
        }
        self.last = sequence;
        self.came += 1;
    }

    fn span(&self) -> u64 {
        self.first.map_or(0, |first| self.last - first + 1)
    }
}

fn quantile(classes: &[u64], q: f64) -> f64 {
    let total: u64 = classes.iter().sum();
    let mut left = (total as f64 * q) as u64;
    for (class, count) in classes.iter().enumerate() {
        if *count > left {
            return (class as u64 * CLASS_NS) as f64 / 1e6;
        }
        left -= count;
    }
    f64::INFINITY
}

#[test]
#[ignore = "minutes"]
fn long_frames_without_end() {
    let Some(place) = own_place("soak::long_frames_without_end") else {
        return;
    };
    let frames = number("EDGECAP_FRAMES", 3000);
    let minutes = Duration::from_secs(60 * number("EDGECAP_MINUTES", 60));
    let camera = StandIn::new(number("EDGECAP_FPS", 100) as f64);
    // Nobody is in the film: an empty place would be glanced at three times a second.
    let watched = Watched::start("soak", &camera, &["--no-idle"]);
    let seen = watched.listen::<ObservationFrame>();
    let bodies = watched.listen::<BodyFrame>();
    let mut latency = vec![0_u64; CLASSES];
    let (mut observed, mut published) = (Account::default(), Account::default());
    let (began, mut said) = (Instant::now(), Instant::now());
    // Memory counts from the first tenth on: caches are filled then.
    let mut settled: Option<Vec<(u32, u64, usize)>> = None;
    let measure = || {
        let verbs = ["infer", "fit"].map(|v| eventually(v, || watched.run.child(v)));
        let all = [watched.run.pid(), verbs[0], verbs[1]];
        all.map(|p| (p, memory(p), descriptors(p))).to_vec()
    };
    while published.came < frames && began.elapsed() < minutes {
        if let Some(body) = bodies.next(Duration::from_millis(100)).unwrap() {
            published.count(body.sequence);
            let class = monotonic_ns().saturating_sub(body.capture_ns) / CLASS_NS;
            latency[(class as usize).min(CLASSES - 1)] += 1;
        }
        while let Some(frame) = seen.next(Duration::ZERO).unwrap() {
            observed.count(frame.sequence);
        }
        let part =
            (published.came as f64 / frames as f64).max(began.elapsed().div_duration_f64(minutes));
        if settled.is_none() && part >= 0.1 {
            settled = Some(measure());
        }
        if said.elapsed() > Duration::from_secs(60) {
            said = Instant::now();
            println!("{} frames, {:?}", published.came, measure());
        }
    }
    let (before, after) = (settled.unwrap(), measure());
    let fitted = messages_written(&place, &watched.name, "bodies");
    let written = messages_written(&place, &watched.name, "observations");
    let seconds = began.elapsed().as_secs_f64();
    println!(
        "camera: {} pictures; observations: {written} (this reader had {}), bodies: {fitted} (this reader had {})",
        observed.span(),
        observed.came,
        published.came,
    );
    println!(
        "{:.0} bodies a second; capture to reader: {:.1} ms (median), {:.1} ms (99 %)",
        published.came as f64 / seconds,
        quantile(&latency, 0.5),
        quantile(&latency, 0.99)
    );
    println!("(pid, kB, descriptors) of run, infer, fit: {before:?}, at the end {after:?}");
    for (before, after) in before.iter().zip(&after) {
        assert_eq!(before.0, after.0, "a process was replaced");
        assert!(
            after.1 * 100 <= before.1 * 101 + 100 * 512,
            "memory grows by more than 1 % (and half a megabyte): {before:?}, {after:?}"
        );
    }
    // For a moment one more may be open: a leak stays.
    let more = |held: &[(u32, u64, usize)]| held.iter().zip(&before).any(|(a, b)| a.2 > b.2);
    let (resting, mut held) = (Instant::now(), after);
    while more(&held) && resting.elapsed() < Duration::from_secs(10) {
        std::thread::sleep(Duration::from_millis(100));
        held = measure();
    }
    assert!(!more(&held), "descriptors: {before:?}, {held:?}");
    // Every picture was observed or is a gap, every observation has a body: but for those on their way, and what waited
    // for more than 16 messages while others had the machine.
    assert!(written <= observed.span() + 32, "{written} of {observed:?}");
    assert!(published.came <= fitted && fitted <= written);
    assert!(
        written - fitted <= 32 + written / 100,
        "{} observations have no body",
        written - fitted
    );
    drop((bodies, seen));
    let out = watched.stop();
    assert!(out.status.success(), "{}", crate::program::stderr(&out));
}
