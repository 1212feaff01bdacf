//! The fit to several cameras while it happens, against people whose truth is known.

mod accuracy;
mod identities;
mod looks;
mod sides;
mod times;

use edgecap::camera::View;
use edgecap::fit::FitConfig;
use edgecap::message::{APPEARANCE_BINS, BodyFrame};
use edgecap::multiview::live::{FrameSet, LiveFit, Synchroniser};
use rand::SeedableRng;
use rand::rngs::SmallRng;

use crate::scene::people::{Activity, Person, walk};
use crate::scene::ring::{Spoil, error, observe};

const NOISY: Spoil = Spoil {
    pixels: 4.0,
    space: 0.05,
    unseen: 0.08,
    outliers: 0.03,
    exchanged: false,
    arms_exchanged: false,
    colourless: false,
};

/// One camera: frames a second, and how much later its first frame comes, seconds.
type Shutter = (f64, f64);

fn walker(seed: u64) -> Person {
    let legs = walk(
        0.3,
        1.1,
        &[(-0.9, 3.6), (0.9, 4.6), (-0.6, 5.0), (0.5, 3.8)],
    );
    Person::new(seed, legs, Activity::Wave)
}

/// Every published frame with its time, seconds. `spoil` tells what a view sees at a time; none where it is silent.
fn run(
    views: &[View],
    shutters: &[Shutter],
    people: &[Person],
    seconds: f64,
    spoil: &dyn Fn(usize, f64) -> Option<Spoil>,
) -> Vec<(f64, BodyFrame)> {
    let mut rng = SmallRng::seed_from_u64(7);
    // What every camera shows, in the order in which it arrives, 30 ms later.
    let mut frames: Vec<(u64, usize, f64)> = Vec::new();
    for (v, (rate, offset)) in shutters.iter().enumerate() {
        for k in 0..(seconds * rate) as usize {
            let t = offset + k as f64 / rate;
            frames.push(((t * 1e9) as u64 + 30_000_000, v, t));
        }
    }
    frames.sort_by_key(|f| f.0);
    let mut together = Synchroniser::new(views.len());
    let mut fit = LiveFit::new(views.to_vec(), FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut all = Vec::new();
    for (now, v, t) in frames {
        if let Some(spoil) = spoil(v, t) {
            together.push(v, &observe(&views[v], people, t, spoil, &mut rng), now);
        }
        while let Some(set) = together.next(now) {
            fit.update(&set, &mut out);
            assert_eq!(out.pose_ns, set.capture_ns);
            all.push(((out.pose_ns - 1_000_000_000) as f64 * 1e-9, out));
        }
    }
    all
}

/// Mean error after the first second, of the one person there is, who keeps one identity; metres.
fn of_one(frames: &[(f64, BodyFrame)], person: &Person) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for (t, frame) in frames.iter().filter(|(t, _)| *t > 1.0) {
        assert_eq!(frame.count, 1, "at {t:.2} s");
        assert_eq!(frame.bodies[0].id, 1, "at {t:.2} s");
        sum += error(&frame.bodies[0].joints3d, person, *t);
        count += 1.0;
    }
    assert!(count > 30.0);
    sum / count
}

/// What all views show at `seconds`, at one instant.
fn instant(views: &[View], person: &Person, seconds: f64, rng: &mut SmallRng) -> FrameSet {
    let people = std::slice::from_ref(person);
    let frames = views
        .iter()
        .map(|view| observe(view, people, seconds, Spoil::default(), rng));
    let frames: Vec<_> = frames.collect();
    FrameSet {
        capture_ns: frames[0].capture_ns,
        file_time: false,
        stage_times: frames[0].stage_times,
        views: frames.iter().map(|f| Some(f.people().to_vec())).collect(),
    }
}

/// Somebody who stands at (x, z), metres; equal seeds are built and dressed alike.
fn standing(seed: u64, x: f64, z: f64) -> Person {
    Person::new(seed, walk(0.0, 1.0, &[(x, z), (x, z)]), Activity::Stand)
}

/// The same person as a camera without colours shows them.
fn grey(mut person: Person) -> Person {
    person.clothes[1] = [0.0; APPEARANCE_BINS];
    person.clothes[1][0] = 1.0;
    person
}

/// What is published after every one of `rate` instants a second. `show` says whom a view sees at a time.
fn instants<'a>(
    views: &[View],
    rate: f64,
    seconds: f64,
    show: &dyn Fn(usize, f64) -> Vec<&'a Person>,
) -> Vec<(f64, BodyFrame)> {
    let mut rng = SmallRng::seed_from_u64(3);
    let mut fit = LiveFit::new(views.to_vec(), FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut all = Vec::new();
    for k in 0..(seconds * rate) as usize {
        let t = k as f64 / rate;
        let seen = views.iter().enumerate().map(|(v, view)| {
            let each = show(v, t).into_iter().flat_map(|person| {
                let person = std::slice::from_ref(person);
                let frame = observe(view, person, t, Spoil::default(), &mut rng);
                frame.people().to_vec()
            });
            Some(each.collect())
        });
        let set = FrameSet {
            capture_ns: 1_000_000_000 + (t * 1e9) as u64,
            file_time: false,
            stage_times: Default::default(),
            views: seen.collect(),
        };
        fit.update(&set, &mut out);
        all.push((t, out));
    }
    all
}

fn ids(frame: &BodyFrame) -> Vec<u32> {
    frame.bodies().iter().map(|b| b.id).collect()
}
