//! How tall people are: most are adults about as tall as assumed, some are children. In: what feet on a floor claim.
//! Out: what to believe of it.

/// Spread of adults' statures, and share, mean and spread of children's: natural logarithms of shares of the assumed
/// stature.
pub const ADULTS: f64 = 0.06;
const CHILDREN: [f64; 3] = [0.1, -0.35, 0.15];
/// One time in twenty feet stand on something else and claim any stature from a third to thrice the assumed one: the
/// density of that, in units of [`gauss`].
const NOTHING: f64 = 0.05 * 2.5 / 2.2;
/// Step of the search for the sizes of all together, natural logarithm.
const STEP: f64 = 0.005;

/// Density of a normal distribution, times √2π.
fn gauss(x: f64, sigma: f64) -> f64 {
    (-0.5 * (x / sigma).powi(2)).exp() / sigma
}

/// How likely somebody measures so tall, adult and child; `spread`: of the measurement. All natural logarithms.
fn likely(stature: f64, spread: f64) -> [f64; 2] {
    let [share, mean, own] = CHILDREN;
    [
        (1.0 - share) * gauss(stature, ADULTS.hypot(spread)),
        share * gauss(stature - mean, own.hypot(spread)),
    ]
}

/// How tall to take somebody for who measures so, `spread` being the measurement's; as tall as assumed where it is not
/// to be believed. Natural logarithms of shares of the assumed stature.
pub fn expected(stature: f64, spread: f64) -> f64 {
    let [_, mean, own] = CHILDREN;
    let shrunk = |mean: f64, own: f64| {
        let share = own * own / (own * own + spread * spread);
        mean + share * (stature - mean)
    };
    let [adult, child] = likely(stature, spread);
    (adult * shrunk(0.0, ADULTS) + child * shrunk(mean, own)) / (adult + child + NOTHING)
}

/// The intercept of somebody of the assumed stature under which these intercepts, each with the spread of its
/// logarithm, are likeliest: whoever has a greater one is smaller.
pub fn common_level(intercepts: &[f64], spreads: &[f64]) -> f64 {
    let logs: Vec<f64> = intercepts.iter().map(|c| c.ln()).collect();
    let least = logs.iter().copied().fold(f64::INFINITY, f64::min) + CHILDREN[1];
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max) - CHILDREN[1];
    let steps = ((most - least) / STEP) as usize;
    let likelihood = |level: f64| -> f64 {
        let each = logs.iter().zip(spreads).map(|(own, spread)| {
            let [adult, child] = likely(level - own, *spread);
            (adult + child + NOTHING).ln()
        });
        each.sum()
    };
    let best = (0..=steps)
        .map(|k| least + STEP * k as f64)
        .map(|level| (likelihood(level), level))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(1.0, |(_, level)| level.exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_measured_is_believed_within_reason() {
        let near = |a: f64, b: f64| assert!((a - b).abs() < 0.02, "{a} instead of {b}");
        near(expected(0.0, 0.05), 0.0);
        // Two thirds of what an adult seems to differ by, nine tenths of what a child does.
        near(expected(0.1, 0.05), 0.06);
        near(expected(-0.1, 0.05), -0.06);
        near(expected(-0.4, 0.05), -0.36);
        near(expected(-0.4, 0.01), -0.37);
        near(expected(0.5, 0.05), 0.0);
        near(expected(-1.5, 0.05), 0.0);
    }

    #[test]
    fn adults_set_the_level() {
        let near = |people: &[f64], level: f64| {
            let found = common_level(people, &vec![0.05; people.len()]);
            assert!((found / level - 1.0).abs() < 0.03, "{people:?}: {found}");
        };
        near(&[1.5], 1.5);
        near(&[1.5, 1.5, 1.6, 1.4], 1.5);
        // A child, a child beside one adult, somebody on a stage.
        near(&[1.5, 1.5, 2.2], 1.5);
        near(&[1.5, 2.2], 1.5);
        near(&[1.5, 1.5, 0.9], 1.5);
    }
}
