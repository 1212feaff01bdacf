//! Cameras by what views saw that were brought to one time.

use crate::calibrate::{CalibrateError, Room, calibrate as find};
use crate::camera::View;
use crate::commands::common_time::Common;
use crate::commands::exit::Failure;
use crate::message::Observation;
use crate::multiview::{Detections, Sight, agreement};

/// Cameras by views that were brought to one time.
pub struct Found {
    /// The cameras.
    pub room: Room,
    common: Common,
}

impl Found {
    /// Finds them; `stature` is how tall people are taken to be, metres.
    ///
    /// # Errors
    /// What was missing.
    pub fn new(lenses: &[View], common: Common, stature: f64) -> Result<Self, CalibrateError> {
        let room = find(lenses, &sights(lenses, &common), common.rate, stature)?;
        Ok(Self { room, common })
    }

    /// How well the rays of these cameras meet: the better, the more.
    pub fn worth(&self) -> f64 {
        let views = &self.room.views;
        let met = agreement(views, &sights(views, &self.common), self.common.rate);
        met.map_or(0.0, |a| a.confirmed / a.apart.max(1e-6))
    }
}

/// What every view saw, instant by instant.
fn sights(views: &[View], common: &Common) -> Vec<Vec<Detections>> {
    let one = |k: usize, (view, people): (&View, &Vec<Vec<Observation>>)| -> Detections {
        people[k].iter().map(|o| Sight::new(view, o)).collect()
    };
    let all = |k: usize| {
        views
            .iter()
            .zip(&common.people)
            .map(move |pair| one(k, pair))
    };
    (0..common.times.len()).map(|k| all(k).collect()).collect()
}

/// What the user hears where no cameras are found.
pub fn refused(e: CalibrateError) -> anyhow::Error {
    Failure::data(e.to_string()).into()
}
