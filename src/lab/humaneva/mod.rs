//! Bodies from several views against HumanEva-I: true joints and 2D of real people go in, how far fitted bodies are
//! from them comes out, by number of views and by whose 2D it is.
//!
//! Sigal, Balan and Black, HumanEva (IJCV 2010). The data lie outside of the project: two NumPy archives without
//! pictures ([`archive`]). Cameras are found by what is known of points ([`cameras`]), the joints of the set are not
//! those of the fitted body ([`evidence`] on the way in, [`compare`] on the way out).

pub mod archive;
pub mod cameras;
pub mod compare;
pub mod evidence;
mod report;
mod tables;
mod trial;

pub use archive::{FILES, HumanEva, HumanEvaError, Piece};
pub use cameras::{FittedCamera, resect};
pub use report::{CameraLine, HumanEvaTables, Line, Spread};
pub use tables::{HumanEvaOptions, tables, tables_by};
