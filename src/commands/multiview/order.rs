//! Views of which two may have been given for each other's cameras.

use crate::camera::View;
use crate::multiview::{Agreement, Detections, agreement};

/// Of more views there are too many pairs to try.
const MOST_VIEWS: usize = 6;
/// Two readings of which one brings rays so many times as near as the other cannot be told apart: where cameras stand
/// in a ring, to exchange two of them mirrors the ring.
const ALIKE: f64 = 1.25;

/// A reading of views that `fits`.
pub struct Reading {
    /// What is to be done, and that it fits.
    pub words: String,
    /// Mean distance of rays, metres.
    pub apart: f64,
}

/// Two views, or one pair of several, that `fits` finds to go together once exchanged; `frames` are the sights by these
/// cameras.
pub fn exchanged(
    views: &[View],
    frames: &impl Fn(&[View]) -> Vec<Vec<Detections>>,
    rate: f64,
    fits: impl Fn(&Agreement) -> bool,
) -> Option<Reading> {
    if views.len() > MOST_VIEWS {
        return None;
    }
    let pairs = (0..views.len()).flat_map(|a| (0..a).map(move |b| (b, a)));
    let same_size = pairs.filter(|(a, b)| views[*a].size == views[*b].size);
    let found = same_size.filter_map(|(a, b)| {
        let mut other = views.to_vec();
        other.swap(a, b);
        let found = agreement(&other, &frames(&other), rate).filter(&fits)?;
        Some((a, b, found.apart))
    });
    let found: Vec<(usize, usize, f64)> = found.collect();
    let apart = found.iter().map(|f| f.2).min_by(f64::total_cmp)?;
    // In a ring of equal steps any two may be the ones.
    let alike = found.iter().filter(|f| f.2 <= ALIKE * apart);
    let pairs = alike.map(|(a, b, _)| format!("{} and {}", views[*a].name, views[*b].name));
    let pairs: Vec<String> = pairs.collect();
    Some(Reading {
        words: format!(
            "within {:.0} mm if the files of two cameras are exchanged ({}): name them by --view CAMERA=FILE",
            1e3 * apart,
            pairs.join(", or ")
        ),
        apart,
    })
}

/// What is to be done: by the nearest reading, and by those that cannot be told from it.
pub fn words(readings: &[Reading]) -> Option<String> {
    let nearest = readings.iter().map(|r| r.apart).min_by(f64::total_cmp)?;
    let alike = readings.iter().filter(|r| r.apart <= ALIKE * nearest);
    let alike: Vec<&str> = alike.map(|r| r.words.as_str()).collect();
    Some(alike.join(", or "))
}
