//! Many frames through the real `run`: its memory stays as it is, and every frame is accounted for.
//!
//! A million frames, with the smallest network and a camera that is never late, hours on two cores:
//!
//! ```sh
//! cargo build --release
//! EDGECAP_PROGRAM=target/release/edgecap EDGECAP_FRAMES=1000000 EDGECAP_FPS=1000 \
//!     cargo test --test processes -- --ignored --nocapture soak_frames_without_end
//! ```

use std::time::{Duration, Instant};

use crate::program::eventually;
use crate::program::place::{descriptors, memory, number, own_place};
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
fn soak_frames_without_end() {
    if own_place("soak::soak_frames_without_end").is_none() {
        return;
    }
    let frames = number("EDGECAP_FRAMES", 1000);
    let camera = StandIn::new(number("EDGECAP_FPS", 200) as f64);
    let watched = Watched::start("soak", &camera, &[]);
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
    while published.came < frames {
        if let Some(body) = bodies.next(Duration::from_millis(100)).unwrap() {
            published.count(body.sequence);
            let class = monotonic_ns().saturating_sub(body.capture_ns) / CLASS_NS;
            latency[(class as usize).min(CLASSES - 1)] += 1;
        }
        while let Some(frame) = seen.next(Duration::ZERO).unwrap() {
            observed.count(frame.sequence);
        }
        if settled.is_none() && published.came * 10 >= frames {
            settled = Some(measure());
        }
        if said.elapsed() > Duration::from_secs(60) {
            said = Instant::now();
            println!("{} frames, {:?}", published.came, measure());
        }
    }
    let (before, after) = (settled.unwrap(), measure());
    let seconds = began.elapsed().as_secs_f64();
    println!(
        "camera: {} pictures; observed: {}, left out by the camera: {}; published: {}, lost between: {}",
        observed.span(),
        observed.came,
        observed.span() - observed.came,
        published.came,
        observed.came.abs_diff(published.came)
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
        assert!(after.2 <= before.2, "descriptors: {before:?}, {after:?}");
    }
    // Both readers may be some frames apart; a frame that `infer` published is in a body.
    let apart = observed.came.abs_diff(published.came);
    assert!(
        apart <= 32 + frames / 100,
        "{apart} observations have no body"
    );
    drop((bodies, seen));
    let out = watched.stop();
    assert!(out.status.success(), "{}", crate::program::stderr(&out));
}
