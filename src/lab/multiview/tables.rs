//! The experiments: trials by number of views and by what the fit does, means over seeds.

use std::sync::Mutex;

use rayon::prelude::*;
use rustix::time::{ClockId, clock_gettime};

use super::own::{own, steady};
use super::report::AS_MEASURED;
use super::{Errors, Line, Tables, Times, Trial, studio};
use crate::lab::synth::detector::{ARMS, Flaws, LEGS, exchange};
use crate::multiview::{Mask, Masks, MultiviewOptions, Step, windows};

/// Share of one view's frames in which limbs are exchanged.
const EXCHANGED: f64 = 0.3;
/// Most views.
const VIEWS: usize = 4;
/// Views of the experiments that do not vary them.
const THREE: usize = 3;

/// Frames by which masks are timed: they are all in memory.
const MASKED: usize = 12;

/// How much is tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TablesOptions {
    /// People, each with a motion of their own.
    pub seeds: u64,
    /// Frames of each.
    pub frames: u64,
}

/// Runs all experiments. `progress` hears of every trial that is done, out of how many.
pub fn tables(options: TablesOptions, progress: &(dyn Fn(u64, u64) + Sync)) -> Tables {
    let done = Mutex::new(0);
    // Hierarchy, masks, paths.
    let ways = [
        [false, false, false],
        [false, false, true],
        [true, false, false],
        [true, false, true],
        [true, true, false],
        [true, true, true],
    ];
    // The model's own bodies: two detectors with the hierarchy; and with exchanges none, legs, arms, both.
    let total = options.seeds * (6 * VIEWS as u64 + 8 + 4);
    let mean = |title: String,
                views: usize,
                [hierarchy, masks, paths]: [bool; 3],
                trial: &(dyn Fn(u64) -> Trial + Sync)| {
        let errors = (1..=options.seeds).into_par_iter().map(|seed| {
            let trial = trial(seed);
            let options = MultiviewOptions {
                rate: trial.rate,
                paths,
                hierarchy,
            };
            let drawn = |frame: usize, view: usize| Some(trial.mask(frame, view));
            let shown: Option<&Masks<'_>> = masks.then_some(&drawn);
            let errors = trial.errors(&trial.fit(options, shown, &|_| ()));
            let mut done = done.lock().unwrap_or_else(|e| e.into_inner());
            *done += 1;
            progress(*done, total);
            errors
        });
        Line {
            what: title,
            views,
            hierarchy,
            paths,
            masks,
            errors: average(&errors.collect::<Vec<_>>()),
        }
    };
    let mut synth = Vec::new();
    for views in 1..=VIEWS {
        for way in ways {
            synth.push(mean("people of synth".into(), views, way, &|seed| {
                studio(seed, views, options.frames, Flaws::MEASURED)
            }));
        }
    }
    let frames = options.frames as usize;
    let mut model = Vec::new();
    for way in ways.into_iter().filter(|way| way[0]) {
        model.push(mean(
            "errors new in every frame".into(),
            THREE,
            way,
            &|seed| own(seed, THREE, frames, steady(seed)),
        ));
        model.push(mean(AS_MEASURED.into(), THREE, way, &|seed| {
            own(seed, THREE, frames, Flaws::MEASURED)
        }));
    }
    let limbs: [(&str, &[_]); 4] = [
        ("nothing", &[]),
        ("legs", &[LEGS]),
        ("arms", &[ARMS]),
        ("arms and legs", &[ARMS, LEGS]),
    ];
    let exchanged = limbs
        .into_iter()
        .map(|(name, limbs)| {
            mean(name.into(), THREE, [true, false, true], &|seed| {
                let mut trial = own(seed, THREE, frames, steady(seed));
                let first = frames / 4;
                let run = (EXCHANGED * frames as f64).round() as usize;
                for views in trial.seen.iter_mut().skip(first).take(run) {
                    for seen in &mut views[0] {
                        limbs.iter().for_each(|limb| exchange(seen, *limb));
                    }
                }
                trial
            })
        })
        .collect();
    Tables {
        seeds: options.seeds,
        frames: options.frames,
        synth,
        model,
        exchanged,
        times: times(frames.max(60)),
    }
}

fn average(all: &[Errors]) -> Errors {
    // Where nobody was found there is no distance.
    let met: Vec<&Errors> = all.iter().filter(|e| e.found > 0.0).collect();
    if met.is_empty() {
        return Errors::NOBODY;
    }
    let mean =
        |of: &dyn Fn(&Errors) -> f64| met.iter().map(|e| of(e)).sum::<f64>() / met.len() as f64;
    Errors {
        found: all.iter().map(|e| e.found).sum::<f64>() / all.len() as f64,
        joints: mean(&|e| e.joints),
        aligned: mean(&|e| e.aligned),
        shape: each(&met, |e| e.shape.map(|s| [s])).map(|[s]| s),
        stature: mean(&|e| e.stature),
        rest: each(&met, |e| e.rest),
        parts: each(&met, |e| e.parts),
    }
}

/// Mean of every figure, where all have them.
fn each<const N: usize>(
    all: &[&Errors],
    of: impl Fn(&Errors) -> Option<[f64; N]>,
) -> Option<[f64; N]> {
    let known: Vec<[f64; N]> = all.iter().map(|e| of(e)).collect::<Option<_>>()?;
    let sum = |k: usize| known.iter().map(|figures| figures[k]).sum::<f64>();
    (!known.is_empty()).then(|| std::array::from_fn(|k| sum(k) / known.len() as f64))
}

/// Time on one core, of the processor and not of the clock, so that other programs do not count.
fn times(frames: usize) -> Option<Times> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .ok()?;
    let trial = own(1, THREE, frames, steady(1));
    let first = |frames: usize| Trial {
        seen: trial.seen[..frames].to_vec(),
        ..trial.clone()
    };
    // The second time everything that is made once is there.
    pool.install(|| timed(&first(10), None));
    let all = pool.install(|| timed(&trial, None));
    let masks: Vec<Vec<Mask>> = (0..MASKED)
        .map(|k| (0..THREE).map(|v| trial.mask(k, v)).collect())
        .collect();
    let at_hand = |frame: usize, view: usize| Some(masks[frame][view].clone());
    let few = first(MASKED);
    let [without, with] = [None, Some(&at_hand as &Masks<'_>)]
        .map(|masks| pool.install(|| timed(&few, masks).stage_one));
    Some(Times {
        views: THREE,
        stage_one_ms: 1e3 * all.stage_one / frames as f64,
        masks_ms: 1e3 * (with - without) / MASKED as f64,
        window_s: all.stage_two / windows(frames, trial.rate).len() as f64,
    })
}

/// Seconds of processor that one fit takes.
struct Timed {
    /// Until every body is placed, tried again from its neighbours and, where there are masks, outlined.
    stage_one: f64,
    /// From there to the end.
    stage_two: f64,
}

/// Fits on one thread, which is this one.
fn timed(trial: &Trial, masks: Option<&Masks<'_>>) -> Timed {
    let options = MultiviewOptions {
        rate: trial.rate,
        paths: true,
        hierarchy: true,
    };
    let begin = spent();
    let last = Mutex::new(begin);
    trial.fit(options, masks, &|step| {
        if matches!(step, Step::Settled | Step::Outlined) {
            *last.lock().unwrap_or_else(|e| e.into_inner()) = spent();
        }
    });
    let middle = last.into_inner().unwrap_or_else(|e| e.into_inner());
    Timed {
        stage_one: middle - begin,
        stage_two: spent() - middle,
    }
}

/// Seconds of processor that this thread has used.
fn spent() -> f64 {
    let t = clock_gettime(ClockId::ThreadCPUTime);
    t.tv_sec as f64 + 1e-9 * t.tv_nsec as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_of_stage_one_ends_before_that_of_stage_two() {
        let trial = own(1, THREE, 6, steady(1));
        let masks = |frame: usize, view: usize| Some(trial.mask(frame, view));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.unwrap();
        for masks in [None, Some(&masks as &Masks<'_>)] {
            let time = pool.install(|| timed(&trial, masks));
            assert!(time.stage_one > 0.0 && time.stage_two > 0.0);
        }
    }

    #[test]
    fn where_nobody_is_found_there_is_no_distance() {
        let found = Errors {
            found: 1.0,
            joints: 0.02,
            aligned: 0.01,
            shape: Some(0.005),
            stature: 0.03,
            ..Errors::NOBODY
        };
        let half = average(&[found, Errors::NOBODY]);
        assert_eq!(
            half,
            Errors {
                found: 0.5,
                ..found
            }
        );
        for nobody in [average(&[Errors::NOBODY; 2]), average(&[])] {
            assert_eq!((nobody.found, nobody.shape), (0.0, None));
            let distances = [nobody.joints, nobody.aligned, nobody.stature];
            assert!(distances.iter().all(|d| d.is_nan()), "{nobody:?}");
        }
    }
}
