//! Max-pool in plain loops, to be compiled for every tier.

use crate::tensor::Element;
use crate::{Layout, Part};

/// Tensors of one run.
pub(crate) struct Job<'a, T> {
    pub kernel: usize,
    pub stride: usize,
    pub padding: usize,
    pub input: *const T,
    pub in_layout: &'a Layout,
    pub output: *mut T,
    pub out_layout: &'a Layout,
    pub part: &'a Part,
}

/// Channels taken together: one vector of u8.
const LANES: usize = 64;

/// The pool in plain loops, which the compiler turns into vectors of the tier.
///
/// # Safety
/// As [`MaxPool::run_part`](crate::MaxPool::run_part).
#[inline(always)]
pub(crate) unsafe fn pool<T: Element + PartialOrd>(job: &Job<T>) {
    let channels = job.out_layout.channels();
    for oy in job.part.rows.clone() {
        for ox in 0..job.out_layout.width() {
            let to = job.out_layout.index(oy as isize, ox as isize);
            let y = (oy * job.stride) as isize - job.padding as isize;
            let x = (ox * job.stride) as isize - job.padding as isize;
            let from = |tap: usize| {
                let (ky, kx) = ((tap / job.kernel) as isize, (tap % job.kernel) as isize);
                job.in_layout.index(y + ky, x + kx)
            };
            let taps = job.kernel * job.kernel;
            let mut first = 0;
            // SAFETY: row y + ky <= (out_height - 1) · stride + kernel - 1 - padding <= height - 1 + padding, columns
            // likewise, and both are >= -padding: `check` proved padding <= halo and the halo readable. (oy, ox) lies
            // in the output (the part lies within its rows, caller). first + LANES <= channels of both, and channel <
            // channels.
            unsafe {
                while first + LANES <= channels {
                    let mut best = [T::default(); LANES];
                    let load =
                        |tap| std::slice::from_raw_parts(job.input.add(from(tap) + first), LANES);
                    best.copy_from_slice(load(0));
                    for tap in 1..taps {
                        for (best, &value) in best.iter_mut().zip(load(tap)) {
                            *best = if value > *best { value } else { *best };
                        }
                    }
                    let output = job.output.add(to + first);
                    std::ptr::copy_nonoverlapping(best.as_ptr(), output, LANES);
                    first += LANES;
                }
                for channel in first..channels {
                    let mut best = *job.input.add(from(0) + channel);
                    for tap in 1..taps {
                        let value = *job.input.add(from(tap) + channel);
                        best = if value > best { value } else { best };
                    }
                    *job.output.add(to + channel) = best;
                }
            }
        }
    }
}
