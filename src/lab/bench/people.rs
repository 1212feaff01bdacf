//! Speed of what comes after Stage I, by number of people.

use std::hint::black_box;
use std::time::Duration;

use edgecap_kernels::Isa;

use super::sample::Samples;
use super::subject::picture;
use super::{BenchError, PeopleSpeed, Timing, crowd};
use crate::capture::{Frame, Letterbox};
use crate::detect::{AssociationConfig, Associator, Detection};
use crate::engine::model::{Linear, Stage2};
use crate::engine::{Maps, Model};
use crate::lift::{Encodings, Lifter};
use crate::message::{Intrinsics, Observation};

/// A camera's picture is so many times as wide and as high as the network's input, as 1280 pixels are of 512.
const PICTURE: f32 = 2.5;
/// Degrees across the camera's picture.
const VIEW: f32 = 60.0;

/// Association, then Stage II, for `people` people in maps of `width` × `height` cells; `None` where some of them get
/// lost, so that the time of finding them means nothing.
pub(super) fn speed(
    people: usize,
    (width, height): (usize, usize),
    isa: Isa,
    time: Duration,
) -> Result<Option<PeopleSpeed>, BenchError> {
    let maps = crowd::maps(people, width, height);
    let mut associator = Associator::new(AssociationConfig::default());
    let found = associator.associate(&maps).len();
    if found != people {
        return Ok(None);
    }
    let mut association = Samples::default();
    association.add(time, 10, || {
        black_box(associator.associate(black_box(&maps)));
    });
    let detections = associator.associate(&maps).to_vec();
    let size = (width * Maps::STRIDE, height * Maps::STRIDE);
    let (stage2, _) = lifting(&detections, size, isa, time)?;
    Ok(Some(PeopleSpeed {
        people,
        association: association.timing(),
        stage2,
    }))
}

/// Stage II as a run has it, the colours of torsos included: how long it takes, and what it says of people whom the
/// network found at its input's `size`.
fn lifting(
    detections: &[Detection],
    size: (usize, usize),
    isa: Isa,
    time: Duration,
) -> Result<(Timing, Vec<Observation>), BenchError> {
    let mut lifter = Lifter::new(&layers(), Encodings::Read, isa)?;
    let [width, height] = [size.0, size.1].map(|side| (PICTURE * side as f32) as u32);
    let frame = Frame {
        width,
        height,
        rgb: picture((width as usize, height as usize)),
        ..Frame::default()
    };
    let letterbox = Letterbox::fit(width, height, size.0 as u32, size.1 as u32);
    let camera = Intrinsics::from_horizontal_fov(width, height, VIEW);
    let mut stage2 = Samples::default();
    stage2.add(time, 10, || {
        let lifted = lifter.lift(black_box(detections), &frame, &letterbox, &camera);
        black_box(lifted.map(<[_]>::len)).ok();
    });
    Ok((stage2.timing(), lifter.lifted().to_vec()))
}

/// The shipped layers, whose zeros save time; in a build without weights layers of the same widths in which every input
/// counts.
fn layers() -> Vec<Linear> {
    if let Some(stage2) = Model::shipped().ok().and_then(|model| model.stage2) {
        return stage2.layers;
    }
    let widths = Stage2::WIDTHS.windows(2);
    let last = Stage2::WIDTHS.len() - 2;
    let layer = |(i, w): (usize, &[usize])| Linear {
        inputs: w[0],
        outputs: w[1],
        weight: vec![1.0 / w[0] as f32; w[0] * w[1]],
        bias: vec![0.01; w[1]],
        relu: i != last,
    };
    widths.enumerate().map(layer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crowd_that_a_small_picture_cannot_show_has_no_speed() {
        let speed = |people: usize| {
            let time = Duration::ZERO;
            speed(people, (16, 16), Isa::Scalar, time).unwrap()
        };
        assert!(speed(1).is_some() && speed(20).is_none());
    }

    #[test]
    fn stage_ii_is_timed_with_the_colours_of_everybody() {
        let (width, height) = (64, 40);
        for people in [1, 10, 20] {
            let mut associator = Associator::new(AssociationConfig::default());
            let found = associator.associate(&crowd::maps(people, width, height));
            let size = (width * Maps::STRIDE, height * Maps::STRIDE);
            let (_, said) = lifting(found, size, Isa::Scalar, Duration::ZERO).unwrap();
            assert_eq!(said.len(), people);
            for o in said {
                for colours in [o.hue, o.saturation] {
                    let sum: f32 = colours.iter().sum();
                    assert!((sum - 1.0).abs() < 1e-3, "{sum}");
                }
            }
        }
    }
}
