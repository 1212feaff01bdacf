//! Cauchy's loss, by which single observations that are all wrong lose their pull.

/// Residuals beyond this many standard deviations lose their pull.
const SIGMAS: f64 = 2.5;
const SQUARED: f64 = SIGMAS * SIGMAS;

/// Energy of a residual, squared and in standard deviations.
pub fn robust_cost(squared: f64) -> f64 {
    SQUARED * (squared / SQUARED).ln_1p()
}

/// Its weight in reweighted least squares.
pub fn robust_weight(squared: f64) -> f64 {
    SQUARED / (SQUARED + squared)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_outlier_moves_little() {
        assert!(robust_cost(1.0) > 0.9 && robust_cost(1e4) < 100.0);
        assert!(robust_weight(0.0) == 1.0 && robust_weight(1e4) < 1e-3);
    }
}
