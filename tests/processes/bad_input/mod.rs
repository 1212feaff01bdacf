//! Wrong input gets one clear line and a sysexits code, and nothing is left behind.

mod inputs;
mod models;
mod options;
mod outputs;
mod records;
mod text;
mod verbs;

use edgecap::message::ObservationFrame;
use edgecap::record::{Format, ObservationsRow, RecordWriter};

/// Writes a record of observations, with one frame in which nobody is.
fn observations_of_nobody(path: &str) {
    let mut writer =
        RecordWriter::<ObservationsRow>::create(path.as_ref(), Format::Binary).unwrap();
    writer.write(&ObservationFrame::default(), "").unwrap();
    writer.finish().unwrap();
}
