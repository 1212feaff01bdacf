//! One camera's signs of life to the service manager.

use crate::supervise::{Progress, ServiceManager};

/// What the service manager hears of one camera.
#[derive(Debug)]
pub struct Pulse<'a> {
    manager: &'a ServiceManager,
    camera: usize,
}

impl<'a> Pulse<'a> {
    /// Of a camera by its place among all.
    pub fn new(manager: &'a ServiceManager, camera: usize) -> Self {
        Self { manager, camera }
    }

    /// Something went on: call it only then.
    pub fn beat(&self, what: Progress) {
        self.manager.progress(self.camera, what);
    }

    /// The camera has ended, and nobody is to miss it.
    pub fn over(&self) {
        self.manager.over(self.camera);
    }

    /// The end of all begins.
    pub fn stopping(&self) {
        self.manager.stopping();
    }
}
