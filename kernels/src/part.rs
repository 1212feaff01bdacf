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

    /// Share `index` of `count` of the work, as even as it gets: rows in multiples of `row_block`, groups, or both are
    /// divided. The last shares may be empty.
    pub(crate) fn share(
        rows: usize,
        groups: usize,
        row_block: usize,
        index: usize,
        count: usize,
    ) -> Self {
        assert!(index < count, "share {index} of {count}");
        let blocks = rows.div_ceil(row_block);
        let (bands, by_groups) = cut(blocks, groups, count);
        let (band, slice) = (index / by_groups, index % by_groups);
        if band >= bands {
            return Self {
                rows: 0..0,
                groups: 0..0,
            };
        }
        let row = |band| edge(blocks, band, bands).saturating_mul(row_block);
        Self {
            rows: row(band).min(rows)..row(band + 1).min(rows),
            groups: edge(groups, slice, by_groups)..edge(groups, slice + 1, by_groups),
        }
    }
}

/// Where piece `index` of `pieces` of `whole` begins, for `index <= pieces`; exact for all of them.
fn edge(whole: usize, index: usize, pieces: usize) -> usize {
    (whole as u128 * index as u128 / pieces as u128) as usize
}

/// Into how many bands of blocks, and how many slices of groups, at most `count` shares are cut. The slowest share
/// decides. Of equals the fewest slices: outputs of a slice are apart in memory, those of a band together. More slices
/// than groups are never less work for the slowest.
fn cut(blocks: usize, groups: usize, count: usize) -> (usize, usize) {
    let ways = (1..=count.min(groups)).map(|slices| (count / slices, slices));
    let slowest = |&(bands, slices): &(usize, usize)| {
        let work = blocks
            .div_ceil(bands)
            .saturating_mul(groups.div_ceil(slices));
        (work, slices)
    };
    ways.min_by_key(slowest).unwrap_or((1, 1))
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
            (5, 3, 1),
        ] {
            for count in 1..if cfg!(miri) { 6 } else { 20 } {
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

    #[test]
    fn rows_and_groups_are_split_where_neither_alone_is_even() {
        // Five blocks of four rows, two groups, four shares: by rows the slowest would have two blocks of five.
        let slowest = (0..4)
            .map(|i| Part::share(20, 2, 4, i, 4))
            .map(|part| part.rows.len().div_ceil(4) * part.groups.len())
            .max();
        assert_eq!(slowest, Some(3));
        // Sixteen shares of five blocks in four groups.
        let busy = (0..16)
            .map(|i| Part::share(20, 4, 4, i, 16))
            .filter(|part| !part.rows.is_empty() && !part.groups.is_empty());
        let work: Vec<usize> = busy
            .map(|part| part.rows.len().div_ceil(4) * part.groups.len())
            .collect();
        assert_eq!(work.iter().sum::<usize>(), 20);
        assert_eq!(work.iter().max(), Some(&2));
    }

    #[test]
    fn rows_are_split_where_they_divide_as_well() {
        assert_eq!(cut(40, 2, 2), (2, 1));
        assert_eq!(cut(8, 8, 4), (4, 1));
    }
}
