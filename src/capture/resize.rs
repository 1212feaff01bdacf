//! A picture of any size goes in, the network's input comes out: letterboxed RGB, 8 bits a channel, rows without
//! padding.
//!
//! Shrinking by 2 or more averages the area under each input pixel, exactly; otherwise the picture is sampled
//! bilinearly. Rows are mixed first (weights of 8 bits, 16-bit sums, which vectorise on any machine), then columns
//! (weights of 15 bits). Integer arithmetic throughout: the same bytes on every machine. Nothing is allocated while the
//! picture's size stays the same.

use super::frame::Frame;
use super::letterbox::Letterbox;

/// Grey of the bars beside the picture.
pub const PADDING: u8 = 128;

/// Shrinking factor from which areas are averaged.
const AREA_FROM: f64 = 2.0;

/// Letterboxes pictures into one network input.
#[derive(Debug, Clone)]
pub struct Resizer {
    width: u32,
    height: u32,
    plan: Option<Plan>,
    /// One mixed row of the picture, 8 fractional bits.
    row: Vec<u16>,
}

/// Everything that depends on the picture's size alone.
#[derive(Debug, Clone)]
struct Plan {
    source: (u32, u32),
    letterbox: Letterbox,
    columns: Axis,
    rows: Axis,
}

/// Which source pixels make up each covered pixel along one axis.
#[derive(Debug, Clone)]
struct Axis {
    /// First covered pixel of the output.
    first: usize,
    /// Per covered pixel: first source pixel and where its weights start.
    starts: Vec<(usize, usize)>,
    weights: Vec<u16>,
}

impl Axis {
    /// `total`: what the weights of one pixel sum to.
    fn new(source: u32, target: u32, scale: f64, total: u32) -> Self {
        let (n, m) = (f64::from(source), f64::from(target));
        let pad = 0.5 * (m - n * scale);
        // Covered: pixels whose centre lies in the picture, at least one.
        let first = ((pad - 0.5).ceil().max(0.0) as usize).min(target as usize - 1);
        let end = ((pad + n * scale - 0.5).ceil() as usize).clamp(first + 1, target as usize);
        let mut axis = Self {
            first,
            starts: Vec::with_capacity(end - first),
            weights: Vec::new(),
        };
        let mut exact = Vec::new();
        for i in first..end {
            let start = axis.weights.len();
            let from = if scale * AREA_FROM <= 1.0 {
                area(i, pad, scale, n, &mut exact)
            } else {
                bilinear(i, pad, scale, n, &mut exact)
            };
            quantise(&exact, total, &mut axis.weights);
            axis.starts.push((from, start));
        }
        // A sentinel ends the last pixel's weights.
        axis.starts.push((0, axis.weights.len()));
        axis
    }

    /// Covered pixels.
    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// First source pixel and weights of a covered pixel, counted from the first.
    fn taps(&self, i: usize) -> (usize, &[u16]) {
        let (from, start) = self.starts[i];
        (from, &self.weights[start..self.starts[i + 1].1])
    }
}

/// Overlap of output pixel `i` with each source pixel; returns the first one.
fn area(i: usize, pad: f64, scale: f64, n: f64, weights: &mut Vec<f64>) -> usize {
    let lower = ((i as f64 - pad) / scale).clamp(0.0, n - 1.0);
    let upper = ((i as f64 + 1.0 - pad) / scale).clamp(lower + 0.5, n);
    let from = lower.floor();
    weights.clear();
    let mut edge = from;
    while edge < upper {
        weights.push((edge + 1.0).min(upper) - edge.max(lower));
        edge += 1.0;
    }
    from as usize
}

/// The two source pixels beside the centre of output pixel `i`; returns the first one.
fn bilinear(i: usize, pad: f64, scale: f64, n: f64, weights: &mut Vec<f64>) -> usize {
    let centre = ((i as f64 + 0.5 - pad) / scale - 0.5).clamp(0.0, n - 1.0);
    let from = centre.floor();
    weights.clear();
    weights.push(from + 1.0 - centre);
    if centre > from {
        weights.push(centre - from);
    }
    from as usize
}

/// Rounds weights to integers that sum to `total` exactly: the running sum is rounded, not each weight, so that errors
/// do not add up.
fn quantise(exact: &[f64], total: u32, weights: &mut Vec<u16>) {
    let sum: f64 = exact.iter().sum();
    let (mut running, mut given) = (0.0, 0);
    for (k, w) in exact.iter().enumerate() {
        running += w;
        let upto = if k + 1 == exact.len() {
            total
        } else {
            (running / sum * f64::from(total)).round() as u32
        };
        weights.push((upto - given) as u16);
        given = upto;
    }
}

/// Rows are mixed with weights that sum to 2^8: sums of bytes stay below 2^16.
const ROW_TOTAL: u32 = 1 << 8;
/// Columns are mixed with weights that sum to 2^15: sums of mixed rows stay below 2^31.
const COLUMN_SHIFT: u32 = 15;
/// Fractional bits after both.
const SHIFT: u32 = 8 + COLUMN_SHIFT;

impl Resizer {
    /// For a network input of `width` × `height` pixels.
    ///
    /// # Panics
    /// When a side is 0.
    pub fn new(width: u32, height: u32) -> Self {
        assert!(
            width > 0 && height > 0,
            "expected sides above 0, found {width}x{height}"
        );
        Self {
            width,
            height,
            plan: None,
            row: Vec::new(),
        }
    }

    /// Bytes of the network's input.
    pub fn output_bytes(&self) -> usize {
        3 * self.width as usize * self.height as usize
    }

    /// Fills `out` with the letterboxed picture, grey beside it, and says where the picture lies.
    ///
    /// # Panics
    /// When `out` has not [`output_bytes`](Self::output_bytes), or `frame` has not `3 * width * height` bytes, or has
    /// no pixel.
    pub fn run(&mut self, frame: &Frame, out: &mut [u8]) -> Letterbox {
        assert_eq!(
            out.len(),
            self.output_bytes(),
            "bytes of the network's input"
        );
        let (width, height) = (frame.width as usize, frame.height as usize);
        assert_eq!(frame.rgb.len(), 3 * width * height, "bytes of the picture");
        let plan = match self.plan.take() {
            Some(plan) if plan.source == (frame.width, frame.height) => plan,
            _ => Plan::new((frame.width, frame.height), (self.width, self.height)),
        };
        self.row.resize(3 * width, 0);
        let line = 3 * self.width as usize;
        let (top, bottom) = (plan.rows.first, plan.rows.first + plan.rows.len());
        let (left, right) = (plan.columns.first, plan.columns.first + plan.columns.len());
        out[..top * line].fill(PADDING);
        out[bottom * line..].fill(PADDING);
        for (i, target) in out[top * line..bottom * line]
            .chunks_exact_mut(line)
            .enumerate()
        {
            let (from, weights) = plan.rows.taps(i);
            mix_rows(
                &frame.rgb[3 * width * from..],
                3 * width,
                weights,
                &mut self.row,
            );
            target[..3 * left].fill(PADDING);
            target[3 * right..].fill(PADDING);
            mix_columns(&self.row, &plan.columns, &mut target[3 * left..3 * right]);
        }
        let letterbox = plan.letterbox;
        self.plan = Some(plan);
        letterbox
    }
}

impl Plan {
    fn new(source: (u32, u32), target: (u32, u32)) -> Self {
        let letterbox = Letterbox::fit(source.0, source.1, target.0, target.1);
        let scale = (f64::from(target.0) / f64::from(source.0))
            .min(f64::from(target.1) / f64::from(source.1));
        Self {
            source,
            letterbox,
            columns: Axis::new(source.0, target.0, scale, 1 << COLUMN_SHIFT),
            rows: Axis::new(source.1, target.1, scale, ROW_TOTAL),
        }
    }
}

/// Weighted sum of consecutive rows of `stride` bytes.
fn mix_rows(rows: &[u8], stride: usize, weights: &[u16], out: &mut [u16]) {
    let row = |k: usize| &rows[k * stride..][..stride];
    // Two rows per pass halve the traffic of the sums; the first pass overwrites.
    let mut pairs = weights.chunks_exact(2);
    let mut k = 0;
    for pair in pairs.by_ref() {
        let (a, b) = (row(k), row(k + 1));
        let mixed = a
            .iter()
            .zip(b)
            .map(|(a, b)| u16::from(*a) * pair[0] + u16::from(*b) * pair[1]);
        if k == 0 {
            out.iter_mut().zip(mixed).for_each(|(o, m)| *o = m);
        } else {
            out.iter_mut().zip(mixed).for_each(|(o, m)| *o += m);
        }
        k += 2;
    }
    if let [w] = *pairs.remainder() {
        let mixed = row(k).iter().map(|a| u16::from(*a) * w);
        if k == 0 {
            out.iter_mut().zip(mixed).for_each(|(o, m)| *o = m);
        } else {
            out.iter_mut().zip(mixed).for_each(|(o, m)| *o += m);
        }
    }
}

/// Weighted sums of consecutive pixels of a mixed row, rounded once.
fn mix_columns(row: &[u16], columns: &Axis, out: &mut [u8]) {
    for (i, pixel) in out.chunks_exact_mut(3).enumerate() {
        let (from, weights) = columns.taps(i);
        let taps = &row[3 * from..][..3 * weights.len()];
        let mut sums = [1u32 << (SHIFT - 1); 3];
        for (p, w) in taps.chunks_exact(3).zip(weights) {
            for (sum, v) in sums.iter_mut().zip(p) {
                *sum += u32::from(*v) * u32::from(*w);
            }
        }
        for (o, sum) in pixel.iter_mut().zip(sums) {
            *o = (sum >> SHIFT) as u8;
        }
    }
}
