//! Processes killed and stopped in every state, again and again: bodies come back in time, and nothing is left behind.
//!
//! A thousand kills of the program that is shipped, about 13 minutes on a machine that does nothing else:
//!
//! ```sh
//! cargo build --release
//! EDGECAP_PROGRAM=target/release/edgecap EDGECAP_KILLS=1000 \
//!     cargo test --test processes -- --ignored --nocapture long_whatever_dies_is_back
//! ```
//!
//! `EDGECAP_MINUTES` ends it earlier, `EDGECAP_SEED` repeats a series. Times are printed; held to are bounds that a
//! machine under load keeps, too.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use crate::program::place::{descriptors, memory, number, objects, own_place};
use crate::program::stand_in::{StandIn, Watched, processes_of, program};
use crate::program::{Running, eventually, signal, stream};
use edgecap::camera::monotonic_ns;
use edgecap::message::{BodyFrame, EventFrame, EventKind};
use edgecap_client::Subscriber;

/// How long the next body may take on any machine.
const PATIENCE: Duration = Duration::from_secs(20);
/// Beyond this a kill counts as late.
const LATE: Duration = Duration::from_secs(2);

/// Who is killed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Victim {
    Infer,
    Fit,
    Reader,
    Run,
}

/// Waits for a body of a picture taken after `from`; how long that took since `began`.
fn next_body(bodies: &Subscriber<BodyFrame>, from: u64, began: Instant) -> Duration {
    while began.elapsed() < PATIENCE {
        if let Some(body) = bodies.next(Duration::from_millis(20)).unwrap()
            && body.capture_ns > from
        {
            return began.elapsed();
        }
    }
    panic!("no body {PATIENCE:?} after a kill")
}

fn reader(name: &str) -> std::process::Child {
    program()
        .args(["watch", "--name", name])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap()
}

/// Descriptors, kilobytes and files.
type Held = (usize, u64, usize);

fn most_of(a: Held, b: Held) -> Held {
    (a.0.max(b.0), a.1.max(b.1), a.2.max(b.2))
}

fn grown(settled: Held, held: Held) -> bool {
    held.0 > settled.0 + 8 || held.1 > settled.1 + settled.1 / 4 + 2048 || held.2 > settled.2 + 40
}

fn quantile(sorted: &[Duration], q: f64) -> Duration {
    sorted[((sorted.len() - 1) as f64 * q).round() as usize]
}

/// Whoever reads on when `fit` has crashed must not take somebody for another one.
#[test]
fn a_fit_that_was_killed_gives_no_id_again() {
    let name = stream("no-id-again");
    let events = Subscriber::<EventFrame>::open(&name).unwrap();
    let run = Running::start(&[
        "run", "--live", "--input", "demo", "--size", "256x160", "--name", &name,
    ]);
    let mut entered = Vec::new();
    for fits in 1..=3 {
        // The first events of each `fit` tell of somebody who enters.
        eventually("somebody", || {
            let frame = events.next(Duration::from_millis(100)).unwrap()?;
            let enter = |kind| kind == EventKind::ENTERED;
            let them = frame.events().iter().filter(|e| enter(e.kind));
            entered.extend(them.map(|e| e.person));
            (frame.first == 0 && frame.count > 0).then_some(())
        });
        assert!(entered.len() >= fits, "{entered:?}");
        if fits < 3 {
            let pid = eventually("fit", || run.child("fit"));
            signal(pid, "KILL");
        }
    }
    let mut others = entered.clone();
    others.sort_unstable();
    others.dedup();
    assert_eq!(others.len(), entered.len(), "{entered:?}");
}

#[test]
#[ignore = "minutes"]
fn long_whatever_dies_is_back() {
    let Some(place) = own_place("faults::long_whatever_dies_is_back") else {
        return;
    };
    let (kills, seed) = (number("EDGECAP_KILLS", 24), number("EDGECAP_SEED", 1));
    let (minutes, began) = (number("EDGECAP_MINUTES", 60), Instant::now());
    let mut random = StdRng::seed_from_u64(seed);
    let camera = StandIn::new(30.0);
    let mut watched = Watched::start("faults", &camera, &[]);
    let name = watched.name.clone();
    let bodies = watched.listen::<BodyFrame>();
    next_body(&bodies, 0, Instant::now());
    let mut reading = reader(&name);
    let mut times: BTreeMap<(Victim, &str), Vec<Duration>> = BTreeMap::new();
    // What a run holds when it has been through some of it: from then on nothing may grow.
    let mut settled: Option<Held> = None;
    let mut most = (0, 0, 0);
    for kill in 0..kills {
        if began.elapsed() > Duration::from_secs(60 * minutes) {
            println!("time is over");
            break;
        }
        let victim = match random.random_range(0..20) {
            0..8 => Victim::Infer,
            8..15 => Victim::Fit,
            15..19 => Victim::Reader,
            _ => Victim::Run,
        };
        let how = if random.random_bool(0.75) {
            "KILL"
        } else {
            "STOP"
        };
        // Half of them in the first 100 ms of a process that has just been started.
        let early = random.random_bool(0.5);
        let wait = Duration::from_millis(random.random_range(0..if early { 100 } else { 1000 }));
        let pid = match victim {
            Victim::Run => watched.run.pid(),
            Victim::Reader => reading.id(),
            Victim::Infer | Victim::Fit => {
                let verb = if victim == Victim::Fit {
                    "fit"
                } else {
                    "infer"
                };
                let old = eventually(verb, || watched.run.child(verb));
                if early {
                    signal(old, "KILL");
                    eventually(verb, || watched.run.child(verb).filter(|p| *p != old))
                } else {
                    old
                }
            }
        };
        std::thread::sleep(wait);
        let (mut from, began) = (monotonic_ns(), Instant::now());
        signal(pid, how);
        match victim {
            Victim::Run => {
                // A stopped supervisor is the service manager's to kill; either way it starts another one.
                signal(pid, "KILL");
                watched.run.0.wait().unwrap();
                eventually("the end of all", || {
                    processes_of(&name, &[reading.id()])
                        .is_empty()
                        .then_some(())
                });
                // Bodies of the old run are no news of the new one.
                from = monotonic_ns();
                watched = Watched::start("faults", &camera, &[]);
                settled = None;
            }
            Victim::Reader => {
                let body = next_body(&bodies, from, began);
                signal(pid, "KILL");
                reading.wait().unwrap();
                reading = reader(&name);
                times.entry((victim, how)).or_default().push(body);
                continue;
            }
            Victim::Infer | Victim::Fit => {}
        }
        let body = next_body(&bodies, from, began);
        if body > LATE {
            println!(
                "kill {kill}: {victim:?} {how}, early {early}, after {wait:.0?}: next body after {body:.2?}"
            );
        }
        times.entry((victim, how)).or_default().push(body);
        let run = watched.run.pid();
        let hold = || (descriptors(run), memory(run), objects(&place).len());
        let mut held = hold();
        if kill % 8 == 7 {
            match settled {
                None => {
                    // Between the dead one's and the new one's it has neither.
                    for _ in 0..20 {
                        std::thread::sleep(Duration::from_millis(100));
                        held = most_of(held, hold());
                    }
                    settled = Some(held);
                }
                Some(settled) => {
                    // For a moment it has both the dead one's and the new one's: a leak stays.
                    let resting = Instant::now();
                    while grown(settled, held) && resting.elapsed() < PATIENCE {
                        std::thread::sleep(Duration::from_millis(100));
                        held = hold();
                    }
                    assert!(!grown(settled, held), "{settled:?}, now {held:?}");
                }
            }
        }
        most = most_of(most, held);
    }
    println!("descriptors, kB and files of the run: settled {settled:?}, most {most:?}");
    let mut all: Vec<Duration> = Vec::new();
    for ((victim, how), mut times) in times {
        times.sort();
        println!(
            "{victim:?} {how}: {} times, next body after {:.2?} (median), {:.2?} (90 %), {:.2?} (most)",
            times.len(),
            quantile(&times, 0.5),
            quantile(&times, 0.9),
            quantile(&times, 1.0)
        );
        all.extend(times);
    }
    all.sort();
    let late = all.iter().filter(|t| **t > LATE).count();
    println!(
        "{} kills (seed {seed}): next body after {:.2?} (median), {:.2?} (most); {late} later than {LATE:?}",
        all.len(),
        quantile(&all, 0.5),
        quantile(&all, 1.0)
    );
    reading.kill().unwrap();
    reading.wait().unwrap();
    drop(bodies);
    let out = watched.stop();
    assert!(out.status.success(), "{}", crate::program::stderr(&out));
    assert_eq!(processes_of(&name, &[]), [0; 0], "orphans");
    // One more start and end clears what the last kill left; then only what every end leaves may be there.
    let watched = Watched::start("faults", &camera, &[]);
    let bodies = watched.listen::<BodyFrame>();
    next_body(&bodies, monotonic_ns(), Instant::now());
    drop(bodies);
    assert!(watched.stop().status.success());
    let left = objects(&place);
    println!("left: {} files", left.len());
    assert!(left.len() <= 8, "left behind: {left:#?}");
}
