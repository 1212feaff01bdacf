//! How bright each part of a picture is: what tells whether anything in it has changed.

/// Parts that a picture is cut into, across; as many down as make them about square.
const COLUMNS: usize = 80;

/// Mean brightness of the parts of a picture, row by row, 0 to 255.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Brightness {
    /// Parts across.
    pub columns: usize,
    /// Parts down.
    pub rows: usize,
    /// `columns * rows` means.
    pub cells: Vec<f32>,
    sums: Vec<u32>,
}

impl Brightness {
    /// Measures a plane of `width` × `height` samples, `step` bytes from one to the next and `stride` from row to row.
    ///
    /// # Panics
    /// When `plane` is shorter than the rows need.
    pub fn measure(
        &mut self,
        plane: &[u8],
        [width, height]: [usize; 2],
        stride: usize,
        step: usize,
    ) {
        self.columns = COLUMNS.min(width);
        self.rows = (self.columns * height / width.max(1)).clamp(1, height);
        self.cells.clear();
        let edge = |i: usize, size: usize, parts: usize| i * size / parts;
        for r in 0..self.rows {
            let (top, bottom) = (edge(r, height, self.rows), edge(r + 1, height, self.rows));
            self.sums.clear();
            self.sums.resize(self.columns, 0);
            for y in top..bottom {
                let row = &plane[y * stride..][..(width - 1) * step + 1];
                for (c, sum) in self.sums.iter_mut().enumerate() {
                    let (left, right) = (
                        edge(c, width, self.columns),
                        edge(c + 1, width, self.columns),
                    );
                    let part = &row[left * step..(right - 1) * step + 1];
                    *sum += if step == 1 {
                        part.iter().map(|v| u32::from(*v)).sum::<u32>()
                    } else {
                        part.iter().step_by(step).map(|v| u32::from(*v)).sum()
                    };
                }
            }
            let columns = self.columns;
            self.cells
                .extend(self.sums.iter().enumerate().map(|(c, sum)| {
                    let across = edge(c + 1, width, columns) - edge(c, width, columns);
                    *sum as f32 / (across * (bottom - top)) as f32
                }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_has_its_mean() {
        let (width, height) = (163, 90);
        let plane: Vec<u8> = (0..width * height).map(|i| (i % width) as u8).collect();
        let mut b = Brightness::default();
        b.measure(&plane, [width, height], width, 1);
        assert_eq!((b.columns, b.rows), (80, 44));
        assert_eq!(b.cells.len(), 80 * 44);
        // The last part: samples 160, 161, 162.
        assert_eq!((b.cells[0], b.cells[79]), (0.5, 161.0));
        // The same as every second byte of another plane.
        let spread: Vec<u8> = plane.iter().flat_map(|v| [*v, 99]).collect();
        let mut other = Brightness::default();
        other.measure(&spread, [width, height], 2 * width, 2);
        assert_eq!(b.cells, other.cells);
    }

    #[test]
    fn the_smallest_pictures_have_parts_too() {
        for size in [[1, 1], [1, 50], [50, 1], [3, 2]] {
            let mut b = Brightness::default();
            b.measure(&vec![7; size[0] * size[1]], size, size[0], 1);
            assert_eq!(b.cells.len(), b.columns * b.rows);
            assert!(
                !b.cells.is_empty() && b.cells.iter().all(|c| *c == 7.0),
                "{size:?}"
            );
        }
    }
}
