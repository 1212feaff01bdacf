//! Recorded observations and bodies. Messages go in and come out as they were; one [schema](rows) in two formats:
//!
//! - **JSON lines**: one object a frame, for people and scripts;
//! - **binary**: the magic `EDGECAP` and `O` (observations) or `B` (bodies), then a frame as its length (u32,
//!   little-endian) and that many bytes of [postcard](https://postcard.jamesmunns.com/wire-format). A third of the
//!   size.
//!
//! Readers tell the two apart by the first bytes. A file that was cut off, or that ends in zeros as after a power cut,
//! plays to its last whole frame. Every finite number comes back with the same bits.
//!
//! A publisher that is recorded may end and come back, with ids from 1 anew: [`BodyReader`] gives everybody an id of
//! their own, and [`clock`] the times of all on one clock.

mod append;
mod binary;
mod camera;
pub mod clock;
mod error;
mod flight;
mod kind;
mod lives;
mod open;
mod other;
mod reader;
pub mod rows;
mod syncer;
mod times;
mod writer;

pub use append::GrowingRecord;
pub use camera::CameraSource;
pub use error::RecordError;
pub(crate) use error::no_whole_frame;
pub use flight::FlightRecorder;
pub use kind::Kind;
pub use lives::Lives;
pub use open::{expect_no_folder, open};
pub use reader::{BodyReader, ObservationReader, RowReader, lines};
pub use rows::{BodiesRow, ObservationsRow, Row};
pub use times::Times;
pub(crate) use writer::encode;
pub use writer::{Format, RecordWriter};
