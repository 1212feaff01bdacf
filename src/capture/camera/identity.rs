//! Whether the camera behind a device file is the one that was there before: after a hub was reset, numbers are given
//! anew, and links name cameras without serial numbers all alike.

use std::path::PathBuf;

use super::list::CameraInfo;

/// So often another camera is not taken for the one that was there, which may come a few seconds later: with the waits
/// of [`Live`](super::Live) 12 s.
const PATIENCE: u32 = 8;

/// Who was there.
#[derive(Debug, Default)]
pub struct Identity {
    camera: Option<CameraInfo>,
    /// How often another one was met since.
    others: u32,
}

/// Who is there now.
#[derive(Debug, PartialEq, Eq)]
pub enum Who {
    /// The one that was there, or the first.
    Same,
    /// Another one; the one that was there is at this device file now.
    At(PathBuf),
    /// Another one, where this one may come yet.
    Early(CameraInfo),
    /// Another one, for good.
    Another,
}

impl Identity {
    /// Who was there.
    pub fn camera(&self) -> Option<&CameraInfo> {
        self.camera.as_ref()
    }

    /// Whether nobody else was there than this one.
    pub fn may_be(&self, here: &CameraInfo) -> bool {
        self.camera.as_ref().is_none_or(|c| c.is_same_camera(here))
    }

    /// From now on it is this one. Returns who was there, where that is another one.
    pub fn remember(&mut self, camera: CameraInfo) -> Option<CameraInfo> {
        let is_known = self.may_be(&camera);
        self.others = 0;
        self.camera.replace(camera).filter(|_| !is_known)
    }

    /// Compares who is `here` with who was; `all` lists the cameras that there are.
    pub fn compare(&mut self, here: &CameraInfo, all: impl FnOnce() -> Vec<CameraInfo>) -> Who {
        let Some(camera) = self.camera.as_ref().filter(|c| !c.is_same_camera(here)) else {
            return Who::Same;
        };
        if let Some(same) = all().into_iter().find(|other| other.is_same_camera(camera)) {
            return Who::At(same.path);
        }
        self.others += 1;
        match self.others < PATIENCE {
            true => Who::Early(camera.clone()),
            false => Who::Another,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(path: &str, bus: &str) -> CameraInfo {
        CameraInfo {
            path: path.into(),
            name: "Webcam".into(),
            driver: "uvcvideo".into(),
            bus: bus.into(),
            index: None,
        }
    }

    /// Two sensors of one device, whose files have changed numbers.
    #[test]
    fn sensors_of_one_device_are_not_taken_for_each_other() {
        let sensor = |path: &str, index| CameraInfo {
            index,
            ..camera(path, "usb-1")
        };
        let mut first = Identity::default();
        assert_eq!(first.remember(sensor("/dev/video0", Some(0))), None);
        let other = sensor("/dev/video0", Some(2));
        let all = vec![other.clone(), sensor("/dev/video2", Some(0))];
        let there = first.compare(&other, || all);
        assert_eq!(there, Who::At("/dev/video2".into()));
        let unknown = sensor("/dev/video0", None);
        assert_eq!(first.compare(&unknown, || panic!("it is here")), Who::Same);
    }

    #[test]
    fn cameras_that_have_changed_places_are_not_taken_for_each_other() {
        let mut left = Identity::default();
        let first = camera("/dev/video0", "usb-1");
        assert_eq!(left.compare(&first, || panic!("the first")), Who::Same);
        left.remember(first);
        let again = camera("/dev/video2", "usb-1");
        assert_eq!(left.compare(&again, || panic!("it is here")), Who::Same);
        // After the reset.
        let right = camera("/dev/video0", "usb-2");
        let all = vec![right.clone(), camera("/dev/video1", "usb-1")];
        let there = left.compare(&right, || all);
        assert_eq!(there, Who::At("/dev/video1".into()));
    }

    #[test]
    fn another_camera_is_taken_only_where_the_one_before_does_not_come() {
        let mut identity = Identity::default();
        let before = camera("/dev/video0", "usb-1");
        identity.remember(before.clone());
        let new = camera("/dev/video0", "usb-2");
        for _ in 1..PATIENCE {
            let early = Who::Early(before.clone());
            assert_eq!(identity.compare(&new, || vec![new.clone()]), early);
        }
        // One that cannot be used is met again and again.
        for _ in 0..2 {
            let who = identity.compare(&new, || vec![new.clone()]);
            assert_eq!(who, Who::Another);
            assert!(identity.may_be(&before) && !identity.may_be(&new));
        }
        assert_eq!(identity.remember(new.clone()), Some(before));
        assert_eq!(identity.compare(&new, Vec::new), Who::Same);
        assert_eq!(identity.remember(new), None, "it is no news any more");
    }
}
