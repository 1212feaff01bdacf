//! Several calibrated views go in, bodies with a shape, a pose and a mesh come out, frame by frame and smooth over
//! time.
//!
//! Huang et al., Towards Accurate Marker-less Human Shape and Pose Estimation over Time (3DV 2017): `people` tells who
//! is who, `stage_one` fits every frame, with `silhouette` where there are masks, `stage_two` holds the shape and makes
//! paths of few cosines. World axes are those of the calibration, metres.

mod agreement;
mod between;
mod dct;
mod energy;
mod exchange;
mod fit;
mod fitted;
mod groups;
mod kept;
mod lens;
pub mod live;
mod moment;
mod one_body;
mod one_view;
mod over_frames;
mod people;
mod person;
mod points;
mod prior;
mod publish;
mod refine;
mod report;
mod run;
mod sight;
mod silhouette;
mod stage_one;
mod stage_two;
pub mod time;
mod triangulate;
mod world;

pub use agreement::{Agreement, agreement};
pub use between::between;
pub use dct::windows;
pub use exchange::MOST_VIEWS;
pub use fit::{MultiviewFit, MultiviewOptions, fit, fit_tracks};
pub use fitted::Fitted;
pub use kept::{Kept, Nothing};
pub use lens::to_view;
pub use moment::{Lifted, Moment};
pub use one_view::{one_view, stage_three};
pub use people::{Detections, Track, matched, track};
pub use person::{PersonFit, PersonFrame};
pub use points::{all as body_joints, evidence as evidence_joints};
pub use prior::PosePrior;
pub use publish::bodies;
pub use report::{MultiviewReport, Observed, PersonReport, ViewReport, report, stature};
pub use run::{Run, Step};
pub use sight::{Ray, Sight, distance};
pub use silhouette::{
    Background, Contour, Figure, Mask, Masks, Pixel, Small, UNKNOWN, mask, squares,
};
pub use triangulate::{Joints3d, triangulate};
pub use world::world;
