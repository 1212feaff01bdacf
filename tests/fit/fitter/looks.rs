//! What colours of clothes tell of who somebody is, and what they do not.

use super::{FPS, Stage, dress, standing, undress};

/// So many frames of `who` alone, or of nobody, in clothes of that hue and of no saturation. Who everybody is published
/// as in the last of them.
fn shown(
    stage: &mut Stage,
    hue: Option<usize>,
    count: usize,
    who: Option<usize>,
) -> Vec<Option<u32>> {
    let mut last = Vec::new();
    for _ in 0..count {
        last = stage.frame(|k, seen| {
            dress(seen, hue, 0);
            who == Some(k)
        });
    }
    last
}

#[test]
fn without_colour_somebody_else_is_not_who_left() {
    // Before a grey camera, and in clothes that have nothing but the colour of the light.
    for hue in [None, Some(3)] {
        let mut stage = Stage::new(vec![standing(3, -1.5, 4.0), standing(4, 1.5, 4.0)]);
        let mut frames = |count: usize, who: Option<usize>| {
            let last = shown(&mut stage, hue, count, who);
            (last, stage.fitter.counters().births)
        };
        assert_eq!(frames(60, Some(0)), (vec![Some(1), None], 1));
        // Who comes back soon, and where they left, is the same.
        frames(80, None);
        assert_eq!(frames(60, Some(0)), (vec![Some(1), None], 1), "{hue:?}");
        frames(600, None);
        assert_eq!(frames(30, Some(1)), (vec![None, Some(2)], 2), "{hue:?}");
    }
    // A moment later on the other side: nobody walks three metres meanwhile, even if expected on the way.
    for away in [15, 30, 60] {
        for hue in [None, Some(3)] {
            let mut stage = Stage::new(vec![standing(3, -1.5, 4.0), standing(4, 1.5, 4.0)]);
            let mut frames = |count: usize, who: Option<usize>| shown(&mut stage, hue, count, who);
            frames(60, Some(0));
            frames(away, None);
            let case = (away, hue);
            assert_eq!(frames(30, Some(1)), [None, Some(2)], "{case:?}");
        }
    }
}

#[test]
fn looks_are_learnt_for_as_long_at_any_frame_rate() {
    for fps in [6.0, 15.0, FPS, 60.0] {
        // For the first half second, on the way in, another colour.
        for seconds in [0.2, 0.5] {
            let mut stage = Stage::at(fps, vec![standing(3, 0.0, 4.0)]);
            let mut frames = |seconds: f64, hue: Option<usize>| {
                let mut last = Vec::new();
                for _ in 0..(seconds * fps) as usize {
                    last = stage.frame(|_, seen| {
                        dress(seen, hue, 20);
                        hue.is_some()
                    });
                }
                last
            };
            frames(seconds, Some(25));
            frames(10.0, Some(10));
            frames(5.0, None);
            let case = (fps, seconds);
            assert_eq!(frames(2.0, Some(10)), [Some(1)], "{case:?}");
        }
    }
}

#[test]
fn looks_are_waited_for_only_where_they_may_tell() {
    // Somebody of that saturation is away, and then the camera, for so long, seconds, when a newcomer who shows no hips
    // comes to the other side; frames in which the newcomer has no name.
    for (saturation, away, pause, unnamed) in [
        (20, 0.0, 0.0, 6),
        (20, 5.0, 0.0, 60),
        (20, 0.1, 1.5, 60),
        (0, 5.0, 0.0, 6),
    ] {
        let mut stage = Stage::new(vec![standing(3, -2.3, 4.0), standing(4, 2.3, 4.0)]);
        for _ in 0..60 {
            stage.frame(|k, seen| {
                dress(seen, Some(10), saturation);
                k == 0
            });
        }
        let nobody = |count: usize, stage: &mut Stage| {
            for _ in 0..count {
                stage.frame(|_, _| false);
            }
        };
        nobody((away * FPS) as usize, &mut stage);
        stage.paused = (pause * 1e9) as u64;
        nobody(usize::from(pause > 0.0), &mut stage);
        assert_eq!(stage.fitter.counters().births, 1);
        let named = (0..90).find(|_| {
            stage.frame(|k, seen| {
                undress(seen);
                k == 1
            });
            stage.fitter.counters().births > 1
        });
        let case = (saturation, away, pause);
        assert_eq!(named, Some(unnamed), "{case:?}");
    }
}
