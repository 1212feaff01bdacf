//! Optimal one-to-one matching: a table of scores goes in, the pairs with the greatest total come out.
//!
//! The Hungarian algorithm in its shortest-augmenting-path form, O(rows² · (rows + columns)), with scratch memory that
//! is kept between calls.

/// Finds maximum-weight matchings; keep one and reuse it, it stops allocating once it has seen the largest table.
#[derive(Debug, Clone, Default)]
pub struct Matcher {
    row_potential: Vec<f64>,
    column_potential: Vec<f64>,
    row_of_column: Vec<usize>,
    previous: Vec<usize>,
    slack: Vec<f64>,
    done: Vec<bool>,
    column_of_row: Vec<Option<usize>>,
}

impl Matcher {
    /// Column of every row in the matching with the greatest total score.
    ///
    /// `scores` is row-major `[rows, columns]`. A pair whose score is not a finite positive number is forbidden; rows
    /// and columns may stay single, which counts 0.
    ///
    /// # Panics
    /// If `scores` does not hold `rows * columns` values.
    pub fn solve(&mut self, rows: usize, columns: usize, scores: &[f32]) -> &[Option<usize>] {
        assert_eq!(
            scores.len(),
            rows * columns,
            "a score table of {rows} rows and {columns} columns"
        );
        // Every row gets a column of its own that stands for "single": all pairs then exist and cost at most 0.
        let total = columns + rows;
        let cost = |row: usize, column: usize| -> f64 {
            if column >= columns {
                return 0.0;
            }
            let s = scores[row * columns + column];
            // Forbidden pairs cost more than staying single, so no optimum holds one.
            if s.is_finite() && s > 0.0 {
                -f64::from(s)
            } else {
                1.0
            }
        };
        // Index 0 of every array is the usual sentinel; rows and columns are counted from 1.
        reset(&mut self.row_potential, rows + 1, 0.0);
        reset(&mut self.column_potential, total + 1, 0.0);
        reset(&mut self.row_of_column, total + 1, 0);
        reset(&mut self.previous, total + 1, 0);
        for row in 1..=rows {
            self.row_of_column[0] = row;
            reset(&mut self.slack, total + 1, f64::INFINITY);
            reset(&mut self.done, total + 1, false);
            let mut column = 0;
            // The columns of the rows themselves guarantee that a free one is reached.
            while self.row_of_column[column] != 0 {
                self.done[column] = true;
                let from = self.row_of_column[column];
                let (mut delta, mut next) = (f64::INFINITY, 0);
                for c in 1..=total {
                    if self.done[c] {
                        continue;
                    }
                    let reduced =
                        cost(from - 1, c - 1) - self.row_potential[from] - self.column_potential[c];
                    if reduced < self.slack[c] {
                        self.slack[c] = reduced;
                        self.previous[c] = column;
                    }
                    if self.slack[c] < delta {
                        delta = self.slack[c];
                        next = c;
                    }
                }
                for c in 0..=total {
                    if self.done[c] {
                        self.row_potential[self.row_of_column[c]] += delta;
                        self.column_potential[c] -= delta;
                    } else {
                        self.slack[c] -= delta;
                    }
                }
                column = next;
            }
            while column != 0 {
                let from = self.previous[column];
                self.row_of_column[column] = self.row_of_column[from];
                column = from;
            }
        }
        reset(&mut self.column_of_row, rows, None);
        for c in 1..=columns {
            let row = self.row_of_column[c];
            if row != 0 && cost(row - 1, c - 1) < 0.0 {
                self.column_of_row[row - 1] = Some(c - 1);
            }
        }
        &self.column_of_row
    }
}

/// Pairs rows with columns so that the sum of costs is least, where leaving a row or a column alone costs half of
/// `limit` each: no pair dearer than `limit` is made. `costs` is row-major, `rows` × `columns`; NaN and infinity forbid
/// a pair. Returns the column of every row.
///
/// # Panics
/// If `costs` does not hold `rows * columns` values.
pub fn assign(costs: &[f64], rows: usize, columns: usize, limit: f64) -> Vec<Option<usize>> {
    // A pair saves what it costs less than the limit.
    let savings: Vec<f32> = costs.iter().map(|cost| (limit - cost) as f32).collect();
    Matcher::default().solve(rows, columns, &savings).to_vec()
}

fn reset<T: Clone>(values: &mut Vec<T>, len: usize, to: T) {
    values.clear();
    values.resize(len, to);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn total(pairs: &[Option<usize>], columns: usize, scores: &[f32]) -> f64 {
        pairs
            .iter()
            .enumerate()
            .filter_map(|(r, c)| c.map(|c| f64::from(scores[r * columns + c])))
            .sum()
    }

    /// Best total by trying everything.
    fn exhaustive(row: usize, rows: usize, columns: usize, scores: &[f32], taken: u32) -> f64 {
        if row == rows {
            return 0.0;
        }
        let mut best = exhaustive(row + 1, rows, columns, scores, taken);
        for c in 0..columns {
            let s = scores[row * columns + c];
            if taken & (1 << c) == 0 && s.is_finite() && s > 0.0 {
                let rest = exhaustive(row + 1, rows, columns, scores, taken | (1 << c));
                best = best.max(f64::from(s) + rest);
            }
        }
        best
    }

    #[test]
    fn beats_greedy_where_the_best_pair_blocks_two_good_ones() {
        let scores = [0.9, 0.8, 0.85, 0.0];
        assert_eq!(Matcher::default().solve(2, 2, &scores), [Some(1), Some(0)]);
    }

    #[test]
    fn empty_tables_and_forbidden_pairs_leave_rows_single() {
        let mut m = Matcher::default();
        assert!(m.solve(0, 3, &[]).is_empty());
        assert_eq!(m.solve(2, 0, &[]), [None, None]);
        assert_eq!(m.solve(1, 3, &[f32::NAN, f32::INFINITY, -1.0]), [None]);
    }

    proptest! {
        #[test]
        fn total_is_the_greatest_there_is(
            (rows, columns, scores) in (0_usize..6, 0_usize..6).prop_flat_map(|(r, c)| {
                (Just(r), Just(c), prop::collection::vec(-0.5_f32..1.0, r * c))
            })
        ) {
            let mut m = Matcher::default();
            let pairs = m.solve(rows, columns, &scores).to_vec();
            let mut used: Vec<usize> = pairs.iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            prop_assert_eq!(used.len(), pairs.iter().flatten().count());
            let best = exhaustive(0, rows, columns, &scores, 0);
            prop_assert!((total(&pairs, columns, &scores) - best).abs() < 1e-6);
        }
    }

    /// All pairings, one by one.
    fn cheapest(
        costs: &[f64],
        rows: usize,
        columns: usize,
        limit: f64,
        row: usize,
        taken: u32,
    ) -> f64 {
        if row == rows {
            return 0.5 * limit * (columns as f64 - taken.count_ones() as f64);
        }
        let mut least = 0.5 * limit + cheapest(costs, rows, columns, limit, row + 1, taken);
        for c in 0..columns {
            let cost = costs[row * columns + c];
            if taken & (1 << c) == 0 && cost.is_finite() && cost <= limit {
                least = least
                    .min(cost + cheapest(costs, rows, columns, limit, row + 1, taken | 1 << c));
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
            prop_assert!((total - cheapest(costs, rows, columns, 1.0, 0, 0)).abs() < 1e-5);
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
