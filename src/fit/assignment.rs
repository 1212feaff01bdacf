//! In: a table of costs. Out: the cheapest pairing of rows and columns.

use crate::assignment::Matcher;

/// Pairs rows with columns so that the sum of costs is least, where leaving a row or a column alone costs half of `limit`
/// each: no pair dearer than `limit` is made. `costs` is row-major, `rows` × `columns`; NaN and infinity forbid a pair.
/// Returns the column of every row.
///
/// # Panics
/// If `costs` does not hold `rows * columns` values.
pub fn assign(costs: &[f64], rows: usize, columns: usize, limit: f64) -> Vec<Option<usize>> {
    // A pair saves what it costs less than the limit.
    let savings: Vec<f32> = costs.iter().map(|cost| (limit - cost) as f32).collect();
    Matcher::default().solve(rows, columns, &savings).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// All pairings, one by one.
    fn best(costs: &[f64], rows: usize, columns: usize, limit: f64, row: usize, taken: u32) -> f64 {
        if row == rows {
            return 0.5 * limit * (columns as f64 - taken.count_ones() as f64);
        }
        let mut least = 0.5 * limit + best(costs, rows, columns, limit, row + 1, taken);
        for c in 0..columns {
            let cost = costs[row * columns + c];
            if taken & (1 << c) == 0 && cost.is_finite() && cost <= limit {
                least =
                    least.min(cost + best(costs, rows, columns, limit, row + 1, taken | 1 << c));
            }
        }
        least
    }

    proptest! {
        #[test]
        fn is_the_cheapest_of_all(
            rows in 0usize..5,
            columns in 0usize..5,
            values in prop::collection::vec(prop_oneof![4 => 0.0..2.0f64, 1 => Just(f64::INFINITY), 1 => Just(f64::NAN)], 25),
        ) {
            let costs = &values[..rows * columns];
            let pairs = assign(costs, rows, columns, 1.0);
            let mut taken = 0u32;
            let mut total = 0.0;
            for (row, pair) in pairs.iter().enumerate() {
                match pair {
                    Some(c) => {
                        prop_assert_eq!(taken & (1 << c), 0);
                        taken |= 1 << c;
                        prop_assert!(costs[row * columns + c] <= 1.0);
                        total += costs[row * columns + c];
                    }
                    None => total += 0.5,
                }
            }
            total += 0.5 * (columns as f64 - taken.count_ones() as f64);
            prop_assert!((total - best(costs, rows, columns, 1.0, 0, 0)).abs() < 1e-5);
        }
    }

    #[test]
    fn thirty_two_of_each() {
        let costs: Vec<f64> = (0..32 * 32)
            .map(|i| {
                if (i / 32 * 7 + 3) % 32 == i % 32 {
                    0.1
                } else {
                    0.5
                }
            })
            .collect();
        let pairs = assign(&costs, 32, 32, 1.0);
        for (row, column) in pairs.iter().enumerate() {
            assert_eq!(*column, Some((row * 7 + 3) % 32));
        }
    }
}
