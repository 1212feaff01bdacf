//! What this machine can do at most, all threads at once.

use std::time::Duration;

use edgecap_kernels::{Isa, KernelError, Peak};

use super::PeakSpeed;

/// Long enough for the clock to settle, short beside the networks.
const TIME: Duration = Duration::from_millis(600);

/// Runs the kernels' own multiply-accumulate chains on `threads` threads at once.
pub(super) fn measure(isa: Isa, threads: usize) -> Result<PeakSpeed, KernelError> {
    let peak = Peak::together(isa, threads, TIME)?;
    Ok(PeakSpeed {
        threads: peak.threads,
        int8_gmacs: peak.int8,
        f32_gmacs: peak.f32,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_tier_of_this_cpu_has_a_peak() {
        for isa in Isa::available() {
            let peak = measure(isa, 1).unwrap();
            assert!(
                peak.int8_gmacs > 0.0 && peak.f32_gmacs > 0.0,
                "{isa}: {peak:?}"
            );
        }
    }
}
