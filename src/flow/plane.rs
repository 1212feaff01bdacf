//! Brightness at one scale.

/// Brightness, row by row, 0 to 255. Pixel centres are integers.
#[derive(Debug, Clone, Default)]
pub struct Plane {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `width * height` values.
    pub values: Vec<f32>,
}

impl Plane {
    /// Makes room for so many pixels; what they hold is not said.
    pub fn resize(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.values.resize(width * height, 0.0);
    }

    /// Fills this plane with `from` at half its size.
    pub fn halve(&mut self, from: &Self) {
        self.resize(from.width / 2, from.height / 2);
        if self.values.is_empty() {
            return;
        }
        let rows = self.values.chunks_exact_mut(self.width);
        for (out, pair) in rows.zip(from.values.chunks_exact(2 * from.width)) {
            let (upper, lower) = pair.split_at(from.width);
            let columns = upper.chunks_exact(2).zip(lower.chunks_exact(2));
            for (out, (a, b)) in out.iter_mut().zip(columns) {
                *out = 0.25 * (a[0] + a[1] + b[0] + b[1]);
            }
        }
    }

    /// Fills `out` with `side` × `side` values whose first is at `left`, `top`, interpolated between pixels. Beyond an
    /// edge it goes on as at the edge.
    pub fn patch(&self, left: f32, top: f32, side: usize, out: &mut Vec<f32>) {
        out.clear();
        let (x, y) = (left.floor(), top.floor());
        let (right, low) = (left - x, top - y);
        let weights = [
            (1.0 - right) * (1.0 - low),
            right * (1.0 - low),
            (1.0 - right) * low,
            right * low,
        ];
        let mix = |[a, b, c, d]: [f32; 4]| {
            weights[0] * a + weights[1] * b + weights[2] * c + weights[3] * d
        };
        let (x, y) = (x as isize, y as isize);
        let fits = |at: isize, size: usize| at >= 0 && at as usize + side < size;
        if fits(x, self.width) && fits(y, self.height) {
            let (x, y) = (x as usize, y as usize);
            for row in y..y + side {
                let upper = &self.values[row * self.width + x..][..=side];
                let lower = &self.values[(row + 1) * self.width + x..][..=side];
                let pairs = upper.windows(2).zip(lower.windows(2));
                out.extend(pairs.map(|(a, b)| mix([a[0], a[1], b[0], b[1]])));
            }
            return;
        }
        let value = |x: isize, y: isize| {
            let inside = |at: isize, size: usize| at.clamp(0, size as isize - 1) as usize;
            self.values[inside(y, self.height) * self.width + inside(x, self.width)]
        };
        for row in y..y + side as isize {
            for column in x..x + side as isize {
                let (next, below) = (column + 1, row + 1);
                out.push(mix([
                    value(column, row),
                    value(next, row),
                    value(column, below),
                    value(next, below),
                ]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Brighter to the right and downwards.
    fn slope() -> Plane {
        let mut plane = Plane::default();
        plane.resize(20, 12);
        for (i, value) in plane.values.iter_mut().enumerate() {
            *value = (i % 20) as f32 + 3.0 * (i / 20) as f32;
        }
        plane
    }

    #[test]
    fn patches_are_interpolated_and_go_on_beyond_edges() {
        let (plane, mut patch) = (slope(), Vec::new());
        plane.patch(4.25, 2.5, 3, &mut patch);
        for (i, value) in patch.iter().enumerate() {
            let expected = 4.25 + (i % 3) as f32 + 3.0 * (2.5 + (i / 3) as f32);
            assert!((value - expected).abs() < 1e-4, "{i}: {value}");
        }
        for (left, top, corner) in [(-50.0, -9.0, 0.0), (400.0, 90.0, 19.0 + 33.0)] {
            plane.patch(left, top, 2, &mut patch);
            assert_eq!(patch, [corner; 4]);
        }
        // The last column and row have none beside them.
        plane.patch(17.0, 9.0, 3, &mut patch);
        assert_eq!(patch[8], 19.0 + 33.0);
    }

    #[test]
    fn half_the_size_has_the_mean_of_four() {
        let mut half = Plane::default();
        half.halve(&slope());
        assert_eq!((half.width, half.height), (10, 6));
        assert_eq!(half.values[0], (1.0 + 3.0 + 4.0) / 4.0);
        assert_eq!(half.values[59], 18.5 + 3.0 * 10.5);
    }
}
