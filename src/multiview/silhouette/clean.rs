//! Specks taken out of a picture of yes and no, gaps closed, holes filled.

/// A picture of yes and no.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Bits {
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Row by row.
    pub on: Vec<bool>,
}

impl Bits {
    /// Specks are what most of nine neighbours are not; gaps up to twice `closed` pixels wide are closed, and holes of
    /// up to `hole` pixels filled.
    pub fn cleaned(self, closed: usize, hole: usize) -> Self {
        let mut out = self.counted(1, |n, all| 2 * n > all);
        out = out.counted(closed, |n, _| n > 0);
        out = out.counted(closed, |n, all| n == all);
        let off = Self {
            size: out.size,
            on: out.on.iter().map(|b| !b).collect(),
        };
        for region in off.regions() {
            let at_edge = |k: &usize| {
                let (x, y) = (k % out.size[0], k / out.size[0]);
                x == 0 || y == 0 || x + 1 == out.size[0] || y + 1 == out.size[1]
            };
            if region.len() <= hole && !region.iter().any(at_edge) {
                region.into_iter().for_each(|k| out.on[k] = true);
            }
        }
        out
    }

    /// Every pixel by how many of the square of `reach` pixels round it are on, and how many there are.
    fn counted(&self, reach: usize, keep: impl Fn(usize, usize) -> bool) -> Self {
        let [w, h] = self.size;
        let mut sums = vec![0_u32; (w + 1) * (h + 1)];
        for y in 0..h {
            let mut row = 0;
            for x in 0..w {
                row += u32::from(self.on[y * w + x]);
                sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
            }
        }
        let mut on = Vec::with_capacity(w * h);
        for y in 0..h {
            let (top, end) = (y.saturating_sub(reach), (y + reach + 1).min(h));
            for x in 0..w {
                let (left, right) = (x.saturating_sub(reach), (x + reach + 1).min(w));
                let at = |x: usize, y: usize| sums[y * (w + 1) + x];
                let n = at(right, end) + at(left, top) - at(left, end) - at(right, top);
                on.push(keep(n as usize, (end - top) * (right - left)));
            }
        }
        Self {
            size: self.size,
            on,
        }
    }

    /// Regions whose pixels touch side by side, as pixel numbers.
    pub fn regions(&self) -> Vec<Vec<usize>> {
        let [w, h] = self.size;
        let mut met = vec![false; self.on.len()];
        let mut regions = Vec::new();
        for start in 0..self.on.len() {
            if met[start] || !self.on[start] {
                continue;
            }
            met[start] = true;
            let mut region = vec![start];
            let mut next = 0;
            while let Some(&k) = region.get(next) {
                next += 1;
                let (x, y) = (k % w, k / w);
                let sides = [
                    (x > 0).then(|| k - 1),
                    (x + 1 < w).then(|| k + 1),
                    (y > 0).then(|| k - w),
                    (y + 1 < h).then(|| k + w),
                ];
                for side in sides.into_iter().flatten() {
                    if self.on[side] && !met[side] {
                        met[side] = true;
                        region.push(side);
                    }
                }
            }
            regions.push(region);
        }
        regions
    }
}
