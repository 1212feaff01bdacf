//! Whether files belong to other cameras than they were given for.

use super::read::names;
use crate::camera::View;
use crate::commands::exit::Failure;
use crate::multiview::{Agreement, Detections, agreement};

/// Of more views there are too many pairs to try.
const MOST_VIEWS: usize = 6;
/// Rays of a calibration that is right meet within this, metres.
const NEAR: f64 = 0.035;
/// Share of the sights that could confirm others of which that many do in the right order.
const MOSTLY: f64 = 0.6;
/// Rays meet within so many times the distance that they do as told.
const CLEARLY_NEARER: f64 = 0.8;

/// Refuses views of which two are exchanged, where that explains them better than `as_told`; `frames` are the sights by
/// these cameras.
///
/// # Errors
/// Saying which two.
pub fn expect(
    views: &[View],
    frames: &impl Fn(&[View]) -> Vec<Vec<Detections>>,
    rate: f64,
    as_told: Option<&Agreement>,
) -> anyhow::Result<()> {
    if views.len() > MOST_VIEWS {
        return Ok(());
    }
    let most = 1.0 - 1.0 / views.len() as f64;
    let (told, apart) = as_told.map_or((0.0, f64::INFINITY), |a| (a.confirmed, a.apart));
    let pairs = (0..views.len()).flat_map(|a| (0..a).map(move |b| (b, a)));
    let exchanged = pairs.filter(|(a, b)| views[*a].size == views[*b].size);
    let found = exchanged.filter_map(|(a, b)| {
        let mut other = views.to_vec();
        other.swap(a, b);
        let found = agreement(&other, &frames(&other), rate)?;
        let fits = found.apart < NEAR && found.confirmed > MOSTLY * most;
        let better = found.confirmed > told && found.apart < CLEARLY_NEARER * apart;
        (fits && better).then_some((a, b, found))
    });
    let best = found.min_by(|x, y| x.2.apart.total_cmp(&y.2.apart));
    let Some((a, b, found)) = best else {
        return Ok(());
    };
    Err(Failure::usage(format!(
        "expected every view to be that of its camera of {}, found that those of {} and {} go together within {:.0} mm if exchanged; name them by --view CAMERA=FILE",
        names(views),
        views[a].name,
        views[b].name,
        1e3 * found.apart
    ))
    .into())
}
