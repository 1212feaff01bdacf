//! Silhouettes: where a person's mask ends and where the body's outline is should be one line in every view.
//!
//! Huang et al., MuVS (3DV 2017), equation 5, in both directions: the body's rim is drawn to the nearest contour of the
//! mask, and the mask's contour draws the nearest rim, squared at first, then absolute. Pairs are found again a few
//! times; between, pose and shape are solved for with the joints. Pose correctives of a body model move no rim.
//!
//! Of a camera that stands still, `background` tells what differs from where nobody is, `owners` whose that is.

mod background;
mod clean;
mod contour;
mod figure;
mod outline;
mod owners;
mod picture;
mod rim;

pub use background::{Background, Pixel};
pub use contour::{Contour, Mask};
pub use figure::Figure;
pub use outline::Outline;
pub use owners::{UNKNOWN, mask};
pub use picture::{Small, squares};
pub use rim::Rim;

/// Masks by frame and view; `None` where there is none.
pub type Masks<'a> = dyn Fn(usize, usize) -> Option<Mask> + Sync + 'a;
