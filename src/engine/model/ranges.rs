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

const BINS: usize = 4096;

/// Magnitudes of one value of the network: a histogram that grows with what it sees, and the mean of every channel.
#[derive(Debug, Clone)]
pub struct Observed {
    bins: Vec<u64>,
    /// Upper end of the histogram.
    top: f32,
    zeros: u64,
    max: f32,
    sums: Vec<f64>,
    pixels: u64,
}

impl Observed {
    /// Nothing seen of a value with `channels` channels.
    pub fn new(channels: usize) -> Self {
        Self {
            bins: vec![0; BINS],
            top: 1.0,
            zeros: 0,
            max: 0.0,
            sums: vec![0.0; channels],
            pixels: 0,
        }
    }

    /// Adds one pixel, all its channels.
    pub fn add(&mut self, pixel: &[f32]) {
        for (channel, &x) in pixel.iter().enumerate() {
            self.sums[channel] += f64::from(x);
            let x = x.abs();
            if x == 0.0 {
                self.zeros += 1;
                continue;
            }
            while x >= self.top {
                self.double();
            }
            self.max = self.max.max(x);
            self.bins[(x / self.top * BINS as f32) as usize] += 1;
        }
        self.pixels += 1;
    }

    /// Twice the range in the same number of bins.
    fn double(&mut self) {
        for i in 0..BINS / 2 {
            self.bins[i] = self.bins[2 * i] + self.bins[2 * i + 1];
        }
        self.bins[BINS / 2..].fill(0);
        self.top *= 2.0;
    }

    /// Mean of every channel.
    pub fn means(&self) -> Vec<f32> {
        let n = self.pixels.max(1) as f64;
        self.sums.iter().map(|s| (s / n) as f32).collect()
    }

    /// The chosen range for `levels` steps above zero; never 0.
    pub fn range(&self, choice: RangeChoice, levels: u32) -> f32 {
        let range = match choice {
            RangeChoice::Max => self.max,
            RangeChoice::Percentile(share) => self.percentile(share),
            RangeChoice::Mse => self.least_error(levels),
        };
        range.max(1e-6)
    }

    fn bin_width(&self) -> f32 {
        self.top / BINS as f32
    }

    fn percentile(&self, share: f64) -> f32 {
        let total = self.zeros + self.bins.iter().sum::<u64>();
        let mut left = (total as f64 * (1.0 - share)) as u64;
        for (i, &n) in self.bins.iter().enumerate().rev() {
            if n > left {
                return ((i + 1) as f32 * self.bin_width()).min(self.max);
            }
            left -= n;
        }
        self.max
    }

    fn least_error(&self, levels: u32) -> f32 {
        let used = self.bins.iter().rposition(|&n| n > 0).map_or(0, |i| i + 1);
        let width = f64::from(self.bin_width());
        let error = |clip: f64| -> f64 {
            let step = clip / f64::from(levels);
            let of = |(i, &n): (usize, &u64)| {
                let x = (i as f64 + 0.5) * width;
                let e = if x > clip + step / 2.0 {
                    x - clip
                } else if step > 2.0 * width {
                    x - (x / step).round() * step
                } else {
                    // The histogram is too coarse to see single steps: rounding spreads evenly.
                    step / 12f64.sqrt()
                };
                n as f64 * e * e
            };
            self.bins[..used].iter().enumerate().map(of).sum()
        };
        let mut best = (f64::INFINITY, f64::from(self.max));
        for i in 20..=100 {
            let clip = f64::from(self.max) * f64::from(i) / 100.0;
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
    fn rounding_decides_without_outliers() {
        let o = seen((0..100_000).map(|i| i as f32 / 100_000.0));
        let r = o.range(RangeChoice::Mse, 127);
        assert!(r > 0.97, "{r}");
        assert!((o.means()[0] - 0.5).abs() < 1e-3);
    }

    #[test]
    fn growth_keeps_counts() {
        let mut o = seen([0.3, 0.9, 7.0, 0.0].into_iter());
        assert_eq!(o.bins.iter().sum::<u64>() + o.zeros, 4);
        assert!(o.top >= 7.0 && o.max == 7.0);
        o.add(&[-9.0]);
        assert_eq!(o.range(RangeChoice::Max, 127), 9.0);
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
