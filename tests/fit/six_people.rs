//! Six people before four cameras, offline: which detection is whose.

use std::collections::BTreeMap;

use edgecap::camera::View;
use edgecap::lab::multiview::own::{RATE, Walker, observe, ring};
use edgecap::lab::synth::detector::Flaws;
use edgecap::multiview::{Detections, Sight, track};
use glam::DVec3;

const PEOPLE: usize = 6;
const FRAMES: usize = 60;

/// Who of them a detection is of: whose middle is nearest to its own.
fn whose(people: &[Walker], frame: usize, view: &View, sight: &Sight) -> usize {
    let off = |person: &Walker| -> f64 {
        let seen = sight.rays.iter().zip(&person.joints[frame]);
        let (sum, count) = seen.fold((glam::DVec2::ZERO, 0.0_f64), |(s, n), (ray, joint)| match (
            ray,
            view.project(*joint),
        ) {
            (Some(ray), Some(at)) => (s + ray.pixel - at, n + 1.0),
            _ => (s, n),
        });
        (sum / count.max(1.0)).length()
    };
    let all = people.iter().map(off).enumerate();
    all.min_by(|a, b| a.1.total_cmp(&b.1)).expect("people").0
}

#[test]
fn six_people_before_four_cameras_are_told_apart() {
    let views = ring(4);
    let (mut right, mut all) = (0, 0);
    for seed in 0..3u64 {
        let people: Vec<Walker> = (0..PEOPLE)
            .map(|k| {
                let a = k as f64 * std::f64::consts::TAU / PEOPLE as f64;
                let place = 1.1 * DVec3::new(a.sin(), 0.0, a.cos());
                Walker::new(FRAMES, 10 * seed + k as u64, place)
            })
            .collect();
        let frames: Vec<Vec<Detections>> = observe(&views, &people, Flaws::MEASURED, seed)
            .iter()
            .map(|frame| {
                let each = views.iter().zip(frame);
                each.map(|(view, seen)| seen.iter().map(|o| Sight::new(view, o)).collect())
                    .collect()
            })
            .collect();
        all += frames.iter().flatten().map(Vec::len).sum::<usize>();
        for found in track(&views, &frames, RATE) {
            let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
            for (frame, moment) in &found.moments {
                for (view, sight) in views.iter().zip(&moment.sights) {
                    if let Some(sight) = sight {
                        *counts
                            .entry(whose(&people, *frame, view, sight))
                            .or_default() += 1;
                    }
                }
            }
            right += counts.values().max().copied().unwrap_or(0);
        }
    }
    let share = right as f64 / all as f64;
    println!(
        "{right} of {all} detections are with their person, {:.2} %",
        100.0 * share
    );
    assert!(share >= 0.98, "{right} of {all}");
}
