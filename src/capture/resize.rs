//! A picture of any size goes in, the network's input or a part of it comes out: letterboxed RGB, 8 bits a channel,
//! rows without padding.
//!
//! Shrinking by 2 or more averages the area under each input pixel, exactly; otherwise the picture is sampled
//! bilinearly. Rows are mixed first (weights of 8 bits, 16-bit sums, which vectorise on any machine), then columns
//! (weights of 15 bits). Integer arithmetic throughout: the same bytes on every machine. Nothing is allocated while the
//! picture's size stays the same.

use std::ops::Range;

use super::frame::Frame;
use super::letterbox::Letterbox;

/// Grey of the bars beside the picture.
pub const PADDING: u8 = 128;

/// Shrinking factor from which areas are averaged.
const AREA_FROM: f64 = 2.0;

/// A part of the network's input, its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crop {
    /// Pixels of the input left of it.
    pub left: usize,
    /// Pixels of the input above it.
    pub top: usize,
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
}

impl Crop {
    /// All of an input of `width` × `height` pixels.
    pub fn whole(width: usize, height: usize) -> Self {
        Self {
            left: 0,
            top: 0,
            width,
            height,
        }
    }

    /// Pixels.
    pub fn area(&self) -> usize {
        self.width * self.height
    }
}

/// Letterboxes pictures into one network input.
#[derive(Debug, Clone)]
pub struct Resizer {
    width: u32,
    height: u32,
    plan: Option<Plan>,
    /// What the output needs of one mixed row of the picture, 8 fractional bits.
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

    /// Whether the picture covers this pixel of the output.
    fn covers(&self, pixel: usize) -> bool {
        (self.first..self.first + self.len()).contains(&pixel)
    }

    /// The covered pixels among these of the output, counted from the first covered one.
    fn within(&self, pixels: Range<usize>) -> Range<usize> {
        let count = |pixel: usize| pixel.saturating_sub(self.first).min(self.len());
        count(pixels.start)..count(pixels.end)
    }

    /// Source pixels that make up these covered pixels, counted from the first.
    fn source(&self, covered: Range<usize>) -> Range<usize> {
        if covered.is_empty() {
            return 0..0;
        }
        let (from, _) = self.taps(covered.start);
        let (last, weights) = self.taps(covered.end - 1);
        from..last + weights.len()
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
        3 * self.whole().area()
    }

    /// All of the network's input.
    pub fn whole(&self) -> Crop {
        Crop::whole(self.width as usize, self.height as usize)
    }

    /// Fills `out` with the letterboxed picture, grey beside it, and says where the picture lies.
    ///
    /// # Panics
    /// As [`run_crop`](Self::run_crop).
    pub fn run(&mut self, frame: &Frame, out: &mut [u8]) -> Letterbox {
        self.run_crop(frame, self.whole(), out)
    }

    /// Fills `out` with a `crop` of what [`run`](Self::run) fills it with, byte for byte, and says where the picture
    /// lies in that crop.
    ///
    /// # Panics
    /// When `crop` is empty or not within the input, `out` has not 3 bytes for every pixel of it, or `frame` has no
    /// pixel or not 3 bytes for every one.
    pub fn run_crop(&mut self, frame: &Frame, crop: Crop, out: &mut [u8]) -> Letterbox {
        let whole = self.whole();
        let (right, bottom) = (crop.left + crop.width, crop.top + crop.height);
        assert!(
            crop.area() > 0 && right <= whole.width && bottom <= whole.height,
            "expected a crop of {}x{}, found {crop:?}",
            whole.width,
            whole.height
        );
        assert_eq!(out.len(), 3 * crop.area(), "bytes of the network's input");
        let (width, height) = (frame.width as usize, frame.height as usize);
        assert_eq!(frame.rgb.len(), 3 * width * height, "bytes of the picture");
        let plan = match self.plan.take() {
            Some(plan) if plan.source == (frame.width, frame.height) => plan,
            _ => Plan::new((frame.width, frame.height), (self.width, self.height)),
        };
        let (rows, columns) = (&plan.rows, &plan.columns);
        let covered = columns.within(crop.left..right);
        let first = columns.source(covered.clone());
        self.row.resize(3 * first.len(), 0);
        for (y, target) in (crop.top..).zip(out.chunks_exact_mut(3 * crop.width)) {
            if !rows.covers(y) || covered.is_empty() {
                target.fill(PADDING);
                continue;
            }
            let (from, weights) = rows.taps(y - rows.first);
            let start = 3 * (width * from + first.start);
            mix_rows(&frame.rgb[start..], 3 * width, weights, &mut self.row);
            let at = |column: usize| 3 * (columns.first + column - crop.left);
            let (before, after) = (at(covered.start), at(covered.end));
            target[..before].fill(PADDING);
            target[after..].fill(PADDING);
            let to = target[before..after].chunks_exact_mut(3);
            for (i, pixel) in covered.clone().zip(to) {
                mix_column(&self.row, first.start, columns.taps(i), pixel);
            }
        }
        let letterbox = plan.letterbox;
        self.plan = Some(plan);
        Letterbox {
            offset_u: letterbox.offset_u - crop.left as f32,
            offset_v: letterbox.offset_v - crop.top as f32,
            ..letterbox
        }
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

/// Weighted sum of what `out` needs of consecutive rows, `stride` bytes apart.
fn mix_rows(rows: &[u8], stride: usize, weights: &[u16], out: &mut [u16]) {
    let length = out.len();
    let row = |k: usize| &rows[k * stride..][..length];
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

/// Weighted sum of consecutive pixels of a mixed row, which begins with the picture's pixel `first`, rounded once.
fn mix_column(row: &[u16], first: usize, (from, weights): (usize, &[u16]), pixel: &mut [u8]) {
    let taps = &row[3 * (from - first)..][..3 * weights.len()];
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
