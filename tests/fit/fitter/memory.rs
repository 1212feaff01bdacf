//! Memory that stays bounded, whoever comes and leaves.

use edgecap::fit::{FitConfig, Fitter};
use edgecap::message::{BodyFrame, ObservationFrame};

use super::{FPS, dress, standing};
use crate::scene::people;
use crate::scene::{Noise, Scene};

#[test]
fn memory_of_those_who_left_is_bounded() {
    // A newcomer as soon as the last one has a name, each in new clothes and never seen again.
    let mut config = FitConfig::default();
    config.identity.memory = 3600.0;
    let mut fitter = Fitter::new(config).unwrap();
    let mut out = BodyFrame::default();
    let mut clock = 0;
    let mut update = |frame: &ObservationFrame| {
        clock += 33_333_333;
        let mut frame = *frame;
        (frame.capture_ns, frame.sequence) = (clock, clock);
        fitter.update(&frame, &mut out);
        (fitter.counters().births, fitter.remembered())
    };
    for person in 0..90 {
        let x = if person % 2 == 0 { -1.2 } else { 1.2 };
        let cast = vec![standing(person as u64, x, 4.0)];
        let mut scene = Scene::new(cast, Noise::NONE, FPS, 1);
        for _ in 0..10 {
            let (mut frame, _) = scene.next();
            // All 90 pairs; those of one hue come so far apart that the first has left.
            let (hue, saturation) = (person % 10 * 3, 3 + person % 9 * 3);
            dress(&mut frame.people[0], Some(hue), saturation);
            update(&frame);
        }
    }
    let nobody = ObservationFrame::default();
    let left = (0..90).map(|_| update(&nobody)).last();
    assert_eq!(left, Some((90, 64)));
}

/// Resident memory of this process, bytes; `None` where the system does not tell.
fn resident() -> Option<u64> {
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    Some(statm.split(' ').nth(1)?.parse::<u64>().ok()? * 4096)
}

#[test]
#[ignore = "long: 300,000 frames"]
fn long_memory_stays_flat() {
    let noise = Noise {
        phantom: 0.3,
        ..Noise::REAL
    };
    let cast = people::everyday().into_iter().skip(1).take(1).collect();
    let mut scene = Scene::new(cast, noise, FPS, 3);
    let frames: Vec<ObservationFrame> = (0..1000).map(|_| scene.next().0).collect();
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut clock = 1;
    let mut early = None;
    for n in 0..300_000usize {
        let mut frame = frames[n % 1000];
        clock += 33_333_333;
        (frame.capture_ns, frame.sequence) = (clock, n as u64);
        fitter.update(&frame, &mut out);
        if n == 50_000 {
            early = resident();
        }
    }
    println!("{early:?} → {:?}, {:?}", resident(), fitter.counters());
    if let (Some(early), Some(late)) = (early, resident()) {
        assert!(
            late < early + (1 << 18),
            "grew from {early} to {late} bytes"
        );
    }
}
