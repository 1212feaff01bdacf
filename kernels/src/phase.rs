//! A convolution as a set of phases, each a list of taps: the one form that every kernel runs.

use crate::ConvShape;

/// One phase: output pixels `(first_row + i * out_step, first_column + j * out_step)` sum, for every tap, the input
/// pixel `(i * in_step + tap.dy, j * in_step + tap.dx)` times the weights at `(tap.ky, tap.kx)`.
///
/// A plain convolution is one phase; a transposed one with stride s is s² phases of its own few taps.
#[derive(Debug, Clone)]
pub(crate) struct Phase {
    pub first_row: usize,
    pub first_column: usize,
    pub out_step: usize,
    pub in_step: usize,
    pub taps: Vec<Tap>,
}

/// One kernel element of a phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Tap {
    pub ky: usize,
    pub kx: usize,
    pub dy: isize,
    pub dx: isize,
}

impl Phase {
    /// The phases of `shape`, row-major.
    pub fn of(shape: &ConvShape) -> Vec<Phase> {
        let (kernel, stride, padding) = (shape.kernel(), shape.stride(), shape.padding());
        if !shape.transposed() {
            let taps = (0..kernel * kernel)
                .map(|i| Tap {
                    ky: i / kernel,
                    kx: i % kernel,
                    dy: (i / kernel) as isize - padding as isize,
                    dx: (i % kernel) as isize - padding as isize,
                })
                .collect();
            return vec![Phase {
                first_row: 0,
                first_column: 0,
                out_step: 1,
                in_step: stride,
                taps,
            }];
        }
        // Output o takes input i through kernel element o + padding - i * stride.
        let along = |first: usize| {
            (0..kernel).filter_map(move |k| {
                let reach = (first + padding) as isize - k as isize;
                (reach.rem_euclid(stride as isize) == 0)
                    .then(|| (k, reach.div_euclid(stride as isize)))
            })
        };
        (0..stride * stride)
            .map(|i| {
                let (first_row, first_column) = (i / stride, i % stride);
                let taps = along(first_row)
                    .flat_map(|(ky, dy)| {
                        along(first_column).map(move |(kx, dx)| Tap { ky, kx, dy, dx })
                    })
                    .collect();
                Phase {
                    first_row,
                    first_column,
                    out_step: stride,
                    in_step: 1,
                    taps,
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ConvDims;

    #[test]
    fn every_tap_is_in_the_phase_that_its_shape_names() {
        for (kernel, stride, padding, transposed) in [
            (4, 2, 1, true),
            (5, 3, 1, true),
            (3, 3, 0, true),
            (3, 1, 1, true),
            (7, 4, 3, true),
            (3, 2, 1, false),
        ] {
            let shape = ConvShape::new(ConvDims {
                kernel,
                stride,
                padding,
                transposed,
                ..ConvDims::default()
            })
            .unwrap();
            let phases = Phase::of(&shape);
            assert_eq!(phases.len(), shape.phases());
            let taps = phases.iter().map(|phase| phase.taps.len());
            assert_eq!(taps.sum::<usize>(), kernel * kernel);
            for (p, phase) in phases.iter().enumerate() {
                for tap in &phase.taps {
                    assert_eq!(shape.phase_of(tap.ky, tap.kx), p, "{shape:?} {tap:?}");
                }
            }
        }
    }

    #[test]
    fn transposed_4x4_has_four_phases_of_four_taps() {
        let shape = ConvShape::new(ConvDims {
            kernel: 4,
            stride: 2,
            padding: 1,
            transposed: true,
            ..ConvDims::default()
        })
        .unwrap();
        let phases = Phase::of(&shape);
        assert_eq!(phases.len(), 4);
        assert!(phases.iter().all(|phase| phase.taps.len() == 4));
        assert_eq!(
            phases[0].taps[0],
            Tap {
                ky: 1,
                kx: 1,
                dy: 0,
                dx: 0
            }
        );
        assert_eq!(
            phases[3].taps[0],
            Tap {
                ky: 0,
                kx: 0,
                dy: 1,
                dx: 1
            }
        );
    }
}
