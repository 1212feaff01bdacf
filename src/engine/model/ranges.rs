//! Activations seen on calibration pictures go in, ranges and channel means come out.

use serde::{Deserialize, Serialize};

/// How the range of an activation is chosen from what calibration saw.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RangeChoice {
    /// The greatest value seen.
    Max,
    /// This share of values lies within the range, e.g. 0.9999.
    Percentile(f64),
    /// Least mean square error of rounding and clipping together.
    Mse,
}

impl std::fmt::Display for RangeChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Max => f.write_str("max"),
            Self::Percentile(p) => write!(f, "percentile:{p}"),
            Self::Mse => f.write_str("mse"),
        }
    }
}

impl std::str::FromStr for RangeChoice {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        match s {
            "max" => return Ok(Self::Max),
            "mse" => return Ok(Self::Mse),
            _ => {}
        }
        let share = s.strip_prefix("percentile:").and_then(|p| p.parse().ok());
        match share {
            Some(p) if p > 0.5 && p <= 1.0 => Ok(Self::Percentile(p)),
            _ => Err(format!(
                "expected max, mse or percentile:SHARE with SHARE in 0.5..1, found `{s}`"
            )),
        }
    }
}

/// Magnitudes of one value of the network: histograms of all of it and of every channel, and the mean of every channel.
#[derive(Debug, Clone)]
pub struct Observed {
    all: Histogram,
    channels: Vec<Histogram>,
    sums: Vec<f64>,
    pixels: u64,
}

/// Bins of a whole value: fine, since its range decides most.
const VALUE_BINS: usize = 4096;
/// Bins of one channel: there are thousands of channels.
const CHANNEL_BINS: usize = 256;

impl Observed {
    /// Nothing seen of a value with `channels` channels.
    pub fn new(channels: usize) -> Self {
        Self {
            all: Histogram::new(VALUE_BINS),
            channels: vec![Histogram::new(CHANNEL_BINS); channels],
            sums: vec![0.0; channels],
            pixels: 0,
        }
    }

    /// Adds one pixel, all its channels.
    pub fn add(&mut self, pixel: &[f32]) {
        let channels = self.channels.iter_mut().zip(&mut self.sums);
        for (&x, (channel, sum)) in pixel.iter().zip(channels) {
            *sum += f64::from(x);
            self.all.add(x.abs());
            channel.add(x.abs());
        }
        self.pixels += 1;
    }

    /// The greatest magnitude seen; infinite when something was no number.
    pub fn max(&self) -> f32 {
        self.all.max
    }

    /// Mean of every channel.
    pub fn means(&self) -> Vec<f32> {
        let n = self.pixels.max(1) as f64;
        self.sums.iter().map(|s| (s / n) as f32).collect()
    }

    /// The chosen range for `levels` steps above zero; never 0.
    pub fn range(&self, choice: RangeChoice, levels: u32) -> f32 {
        self.all.range(choice, levels).max(1e-6)
    }

    /// A range for every channel: the geometric mean of the value's range and the channel's own, weighted by `own`.
    ///
    /// At 0 all channels share one range, and weights are rounded best; at 1 every channel fills its steps, and weights
    /// of narrow channels suffer, because a channel's range moves into the weights that read it.
    pub fn channel_ranges(&self, choice: RangeChoice, levels: u32, own: f32) -> Vec<f32> {
        let all = self.range(choice, levels);
        let range = |channel: &Histogram| {
            // A channel that hardly fires tells little about its range.
            let r = channel.range(choice, levels).max(all * 0.01);
            r.powf(own) * all.powf(1.0 - own)
        };
        self.channels.iter().map(range).collect()
    }
}

/// Counts of magnitudes; its range doubles when a greater one comes.
#[derive(Debug, Clone)]
struct Histogram {
    bins: Vec<u32>,
    /// Upper end.
    top: f32,
    zeros: u64,
    max: f32,
}

impl Histogram {
    fn new(bins: usize) -> Self {
        Self {
            bins: vec![0; bins],
            top: 1.0,
            zeros: 0,
            max: 0.0,
        }
    }

    fn add(&mut self, x: f32) {
        if x == 0.0 {
            self.zeros += 1;
            return;
        }
        if !x.is_finite() {
            self.max = f32::INFINITY;
            return;
        }
        while x >= self.top {
            self.double();
        }
        self.max = self.max.max(x);
        let bin = (x / self.top * self.bins.len() as f32) as usize;
        self.bins[bin] = self.bins[bin].saturating_add(1);
    }

    /// Twice the range in the same number of bins.
    fn double(&mut self) {
        let half = self.bins.len() / 2;
        for i in 0..half {
            self.bins[i] = self.bins[2 * i].saturating_add(self.bins[2 * i + 1]);
        }
        self.bins[half..].fill(0);
        self.top *= 2.0;
    }

    fn range(&self, choice: RangeChoice, levels: u32) -> f32 {
        match choice {
            RangeChoice::Max => self.max,
            RangeChoice::Percentile(share) => self.percentile(share),
            RangeChoice::Mse => self.least_error(levels),
        }
    }

    fn bin_width(&self) -> f32 {
        self.top / self.bins.len() as f32
    }

    fn percentile(&self, share: f64) -> f32 {
        let total = self.zeros + self.bins.iter().map(|&n| u64::from(n)).sum::<u64>();
        let mut left = (total as f64 * (1.0 - share)) as u64;
        let mut range = self.max;
        // Where fewer values than may lie beyond it are not 0, the range is that of the smallest of them.
        for (i, &n) in self.bins.iter().enumerate().rev().filter(|(_, n)| **n > 0) {
            range = ((i + 1) as f32 * self.bin_width()).min(self.max);
            if u64::from(n) > left {
                break;
            }
            left -= u64::from(n);
        }
        range
    }

    fn least_error(&self, levels: u32) -> f32 {
        let used = self.bins.iter().rposition(|&n| n > 0).map_or(0, |i| i + 1);
        let width = f64::from(self.bin_width());
        let error = |clip: f64| -> f64 {
            let step = clip / f64::from(levels);
            let of = |(i, &n): (usize, &u32)| {
                let x = (i as f64 + 0.5) * width;
                let e = if x > clip + step / 2.0 {
                    x - clip
                } else if step > 2.0 * width {
                    x - (x / step).round() * step
                } else {
                    // The histogram is too coarse to see single steps: rounding spreads evenly.
                    step / 12f64.sqrt()
                };
                f64::from(n) * e * e
            };
            self.bins[..used].iter().enumerate().map(of).sum()
        };
        let mut best = (f64::INFINITY, f64::from(self.max));
        // Down to a hundredth of the greatest value: some networks have long tails.
        for i in 0..90 {
            let clip = f64::from(self.max) * 0.95f64.powi(i);
            let e = error(clip);
            if e < best.0 {
                best = (e, clip);
            }
        }
        best.1 as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(values: impl Iterator<Item = f32>) -> Observed {
        let mut o = Observed::new(1);
        values.for_each(|v| o.add(&[v]));
        o
    }

    #[test]
    fn ranges_of_a_ramp_with_one_outlier() {
        let ramp = (0..100_000).map(|i| i as f32 / 100_000.0);
        let o = seen(ramp.chain([50.0]));
        assert_eq!(o.range(RangeChoice::Max, 127), 50.0);
        let p = o.range(RangeChoice::Percentile(0.9999), 127);
        assert!((p - 1.0).abs() < 0.03, "{p}");
        assert!(o.range(RangeChoice::Mse, 127) < 50.0);
    }

    #[test]
    fn a_channel_that_hardly_fires_has_not_the_range_of_its_outlier() {
        let zeros = || std::iter::repeat_n(0.0, 100_000);
        // About as many values that are not 0 as may lie beyond the range, all but one of them small.
        for small in [98, 99, 100, 101] {
            let o = seen(zeros().chain(std::iter::repeat_n(0.2, small)).chain([50.0]));
            let range = o.range(RangeChoice::Percentile(0.999), 127);
            assert!((range - 0.2).abs() < 0.02, "{small}: {range}");
        }
        assert_eq!(
            seen(zeros()).range(RangeChoice::Percentile(0.999), 127),
            1e-6
        );
    }

    #[test]
    fn rounding_decides_without_outliers() {
        let o = seen((0..100_000).map(|i| i as f32 / 100_000.0));
        let r = o.range(RangeChoice::Mse, 127);
        assert!(r > 0.97, "{r}");
        assert!((o.means()[0] - 0.5).abs() < 1e-3);
    }

    #[test]
    fn growth_keeps_counts() {
        let mut o = seen([0.3, 0.9, 7.0, 0.0].into_iter());
        assert_eq!(u64::from(o.all.bins.iter().sum::<u32>()) + o.all.zeros, 4);
        assert!(o.all.top >= 7.0 && o.all.max == 7.0);
        o.add(&[-9.0]);
        assert_eq!(o.range(RangeChoice::Max, 127), 9.0);
    }

    #[test]
    fn channels_meet_their_value_halfway() {
        let mut o = Observed::new(3);
        o.add(&[16.0, 1.0, 0.0]);
        let ranges = |own| o.channel_ranges(RangeChoice::Max, 127, own);
        assert_eq!(ranges(0.0), [16.0; 3]);
        assert!((ranges(0.5)[1] - 4.0).abs() < 1e-5);
        assert_eq!(ranges(1.0)[..2], [16.0, 1.0]);
        assert!((ranges(1.0)[2] - 0.16).abs() < 1e-6);
    }

    #[test]
    fn choices_parse_as_they_print() {
        for c in [
            RangeChoice::Max,
            RangeChoice::Mse,
            RangeChoice::Percentile(0.999),
        ] {
            assert_eq!(c.to_string().parse::<RangeChoice>().unwrap(), c);
        }
        assert!(
            "percentile:7"
                .parse::<RangeChoice>()
                .unwrap_err()
                .contains("0.5..1")
        );
    }
}
