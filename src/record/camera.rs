//! Which camera a recorded frame was seen by.

use super::rows::ObservationsRow;
use crate::camera::to_lens;
use crate::message::{Intrinsics, ObservationFrame};

/// Where the camera of a recorded frame comes from.
#[derive(Clone, Copy)]
pub enum CameraSource<'a> {
    /// This camera for every frame, whatever the file says: its intrinsics for a picture's width and height, or why
    /// there are none. Joints that were lifted by the file's are turned to this camera's axes.
    Given(&'a dyn Fn(u32, u32) -> Result<Intrinsics, String>),
    /// The file's `intrinsics`; where it has none, a centred camera with this horizontal field of view in degrees.
    Recorded {
        /// Horizontal field of view of frames without `intrinsics`, degrees.
        fov_degrees: f32,
    },
}

impl CameraSource<'_> {
    /// The camera of a row.
    ///
    /// # Errors
    /// Why there is none for pictures of this size, or what is wrong with it.
    pub(super) fn of(self, row: &ObservationsRow) -> Result<Intrinsics, String> {
        if row.width == 0 || row.height == 0 {
            return Err(format!("a picture of {}×{} pixels", row.width, row.height));
        }
        let camera = match (self, row.intrinsics) {
            (Self::Given(camera), _) => camera(row.width, row.height)?,
            (Self::Recorded { .. }, Some(i)) => i.into(),
            (Self::Recorded { fov_degrees }, None) => {
                Intrinsics::from_horizontal_fov(row.width, row.height, fov_degrees)
            }
        };
        let usable = |f: f32| f.is_finite() && f > 0.0;
        if usable(camera.fx) && usable(camera.fy) && camera.cx.is_finite() && camera.cy.is_finite()
        {
            return Ok(camera);
        }
        Err(format!(
            "intrinsics with focal lengths {}, {} and principal point {}, {}",
            camera.fx, camera.fy, camera.cx, camera.cy
        ))
    }

    /// Turns everybody of a row's `frame` to the axes of its camera, which is another one than lifted them.
    pub(super) fn turn(self, row: &ObservationsRow, frame: &mut ObservationFrame) {
        if let (Self::Given(_), Some(told)) = (self, row.intrinsics) {
            let (own, people) = (frame.intrinsics, frame.count as usize);
            to_lens(&told.into(), &own, &mut frame.people[..people]);
        }
    }
}
