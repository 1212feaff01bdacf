//! A share of an operation's work for one thread.

use std::ops::Range;

/// Output rows × groups. Parts that differ in rows or in groups write disjoint elements.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Output rows.
    pub rows: Range<usize>,
    /// Groups of the convolution (0..1 for everything else).
    pub groups: Range<usize>,
}

impl Part {
    /// All the work of an operation with `rows` output rows and `groups` groups.
    pub fn whole(rows: usize, groups: usize) -> Self {
        Self {
            rows: 0..rows,
            groups: 0..groups,
        }
    }

    /// Share `index` of `count` of the work, as even as it gets: by rows in multiples of `row_block`, or by groups when
    /// they divide more evenly.
    pub(crate) fn share(
        rows: usize,
        groups: usize,
        row_block: usize,
        index: usize,
        count: usize,
    ) -> Self {
        assert!(index < count, "share {index} of {count}");
        let blocks = rows.div_ceil(row_block);
        // The slowest share decides: compare its part of the whole either way.
        let by_rows = blocks.div_ceil(count) * groups;
        let by_groups = groups.div_ceil(count) * blocks;
        if by_groups < by_rows {
            Self {
                rows: 0..rows,
                groups: groups * index / count..groups * (index + 1) / count,
            }
        } else {
            let edge = |i: usize| (blocks * i / count * row_block).min(rows);
            Self {
                rows: edge(index)..edge(index + 1),
                groups: 0..groups,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_cover_everything_once() {
        for (rows, groups, block) in [
            (20, 4, 4),
            (20, 1, 4),
            (40, 2, 1),
            (1, 1, 4),
            (3, 3, 2),
            (0, 2, 4),
        ] {
            for count in 1..6 {
                let mut seen = vec![0; rows * groups];
                for index in 0..count {
                    let part = Part::share(rows, groups, block, index, count);
                    for row in part.rows {
                        for group in part.groups.clone() {
                            seen[row * groups + group] += 1;
                        }
                    }
                }
                assert!(
                    seen.iter().all(|&n| n == 1),
                    "{rows} rows, {groups} groups, {count} shares"
                );
            }
        }
    }

    #[test]
    fn groups_are_split_when_bands_are_uneven() {
        let part = Part::share(20, 4, 4, 0, 2);
        assert_eq!(
            part,
            Part {
                rows: 0..20,
                groups: 0..2
            }
        );
    }
}
