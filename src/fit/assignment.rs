//! In: a table of costs. Out: the cheapest pairing of rows and columns. Hungarian method, O(n³).

/// Pairs rows with columns so that the sum of costs is least, where leaving a row or a column alone costs half of `limit`
/// each: no pair dearer than `limit` is made. `costs` is row-major, `rows` × `columns`; NaN and infinity forbid a pair.
/// Returns the column of every row.
pub fn assign(costs: &[f64], rows: usize, columns: usize, limit: f64) -> Vec<Option<usize>> {
    assert_eq!(costs.len(), rows * columns, "one cost for every pair");
    if rows == 0 || columns == 0 {
        return vec![None; rows];
    }
    // Square problem: every row and every column gets a partner "nobody". Potentials and augmenting paths as in
    // Jonker–Volgenant, rows and columns from 1.
    let n = rows + columns;
    let forbidden = 1e6 * (limit.abs() + 1.0);
    let cost = |i: usize, j: usize| -> f64 {
        match (i < rows, j < columns) {
            (true, true) => {
                let c = costs[i * columns + j];
                if c.is_finite() && c <= limit {
                    c
                } else {
                    forbidden
                }
            }
            (false, false) => 0.0,
            _ => 0.5 * limit,
        }
    };
    let (mut u, mut v) = (vec![0.0; n + 1], vec![0.0; n + 1]);
    let (mut owner, mut way) = (vec![0usize; n + 1], vec![0usize; n + 1]);
    for i in 1..=n {
        owner[0] = i;
        let mut j0 = 0;
        let mut least = vec![f64::INFINITY; n + 1];
        let mut used = vec![false; n + 1];
        loop {
            used[j0] = true;
            let i0 = owner[j0];
            let (mut delta, mut j1) = (f64::INFINITY, 0);
            for j in 1..=n {
                if used[j] {
                    continue;
                }
                let reduced = cost(i0 - 1, j - 1) - u[i0] - v[j];
                if reduced < least[j] {
                    least[j] = reduced;
                    way[j] = j0;
                }
                if least[j] < delta {
                    delta = least[j];
                    j1 = j;
                }
            }
            for j in 0..=n {
                if used[j] {
                    u[owner[j]] += delta;
                    v[j] -= delta;
                } else {
                    least[j] -= delta;
                }
            }
            j0 = j1;
            if owner[j0] == 0 {
                break;
            }
        }
        while j0 != 0 {
            let j1 = way[j0];
            owner[j0] = owner[j1];
            j0 = j1;
        }
    }
    let mut pairs = vec![None; rows];
    for j in 1..=columns {
        let i = owner[j];
        if i >= 1 && i <= rows && cost(i - 1, j - 1) < forbidden {
            pairs[i - 1] = Some(j - 1);
        }
    }
    pairs
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
            prop_assert!((total - best(costs, rows, columns, 1.0, 0, 0)).abs() < 1e-9);
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
