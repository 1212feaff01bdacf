//! Speed of what comes after Stage I, by number of people.

use std::hint::black_box;
use std::time::Duration;

use edgecap_kernels::Isa;

use super::sample::Samples;
use super::{BenchError, PeopleSpeed, crowd};
use crate::detect::{AssociationConfig, Associator};
use crate::engine::Model;
use crate::engine::model::{Linear, Stage2};
use crate::lift::{Encodings, Lifter};

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
    let mut lifter = Lifter::new(&layers(), Encodings::Read, isa)?;
    let mut stage2 = Samples::default();
    stage2.add(time, 10, || {
        let lifted = lifter.lift_aligned(black_box(&detections));
        black_box(lifted.map(|l| l.len())).ok();
    });
    Ok(Some(PeopleSpeed {
        people,
        association: association.timing(),
        stage2: stage2.timing(),
    }))
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
}
