//! Which cameras send, which of these go with the calibration, and what is said of the others.

use std::time::Instant;

use edgecap_client::message::{FLAG_END_OF_STREAM, FLAG_FILE_TIME, ObservationFrame};

use super::camera::{AWAITED, Camera};
use crate::camera::View;
use crate::commands::exit::{Failure, told};
use crate::commands::views::pictured;
use crate::multiview::live::{LeftOut, Synchroniser};

/// What is known of every camera besides what it sees.
pub struct Cameras<'a> {
    began: Instant,
    names: &'a [String],
    each: Vec<Camera>,
    /// Somebody starts what they come from, and any that has not come yet may.
    pub are_awaited: bool,
    /// One has fitted the calibration, if not in this process.
    pub have_fitted: bool,
}

impl<'a> Cameras<'a> {
    /// None of which has sent anything.
    pub fn new(names: &'a [String]) -> Self {
        Self {
            began: Instant::now(),
            names,
            each: vec![Camera::default(); names.len()],
            are_awaited: false,
            have_fitted: false,
        }
    }

    /// Whether a frame that came `now` counts: not where a running camera shows another shape or size than the
    /// calibration's, and another camera has fitted that, or may.
    ///
    /// # Errors
    /// Where it does not go with the calibration, or not with the other cameras.
    pub fn check(
        &mut self,
        camera: usize,
        view: &View,
        frame: &ObservationFrame,
        now: Instant,
    ) -> anyhow::Result<bool> {
        let name = &self.names[camera];
        let own = &mut self.each[camera];
        own.rhythm.hear(now);
        own.ended = frame.flags & FLAG_END_OF_STREAM != 0;
        if own.ended {
            return Ok(true);
        }
        if std::mem::take(&mut own.said) {
            tracing::info!("{name} sends observations again");
        }
        own.is_file = frame.flags & FLAG_FILE_TIME != 0;
        let is_file = own.is_file;
        let size = [frame.width, frame.height];
        if own.size != Some(size) {
            match pictured(view, size, name).map_err(|e| advised(e, view, frame)) {
                Ok(_) => own.size = Some(size),
                Err(e) if is_file => return Err(e),
                Err(e) => return self.leave_out(camera, e, now).map(|()| false),
            }
        }
        (own.other, own.is_other) = (None, false);
        // One that was killed does not come any more, though it has not said so.
        let comes = |c: &Camera| c.size.is_some() && !c.ended && !c.is_silent(self.began, now);
        let is_other = |c: &Camera| comes(c) && c.is_file != is_file;
        let other = self.each.iter().position(is_other);
        if let Some(other) = other {
            let [film, camera] = if is_file {
                [camera, other]
            } else {
                [other, camera]
            };
            return Err(Failure::data(format!(
                "expected the times of one clock, found a file's of {} and a camera's of {}; replay records of one kind",
                self.names[film], self.names[camera]
            ))
            .into());
        }
        Ok(true)
    }

    /// Leaves a camera out that does not go with the calibration, which is said once.
    ///
    /// # Errors
    /// `why`, where none has ever fitted: at once where all have come, else after [`AWAITED`], unless the others are
    /// awaited for longer.
    fn leave_out(&mut self, camera: usize, why: anyhow::Error, now: Instant) -> anyhow::Result<()> {
        let own = &mut self.each[camera];
        let since = *own.other.get_or_insert(now);
        let is_long = now.saturating_duration_since(since) >= AWAITED;
        self.have_fitted |= self.each.iter().any(|c| c.size.is_some());
        let may_fit = self.each.iter().any(|c| c.other.is_none() && !c.ended);
        let is_awaited = may_fit && (self.are_awaited || !is_long);
        if !self.have_fitted && !is_awaited {
            return Err(why);
        }
        // Which of several comes first is chance: one that fits may be about to.
        let is_sure = self.have_fitted || is_long;
        if is_sure && !std::mem::replace(&mut self.each[camera].is_other, true) {
            tracing::warn!("{}; until then it is left out", told(&why));
        }
        Ok(())
    }

    /// How many come `now` and go with the calibration.
    pub fn come(&self, now: Instant) -> usize {
        let come = self.each.iter().filter(|c| c.counts(self.began, now));
        come.count()
    }

    /// Whether some camera is left out, and none comes `now` that goes with the calibration.
    pub fn are_of_no_use(&self, now: Instant) -> bool {
        let mut going_on = self.each.iter().filter(|c| !c.ended);
        going_on.clone().any(|c| c.other.is_some()) && !going_on.any(|c| c.counts(self.began, now))
    }

    /// What becomes of bodies without a camera. `left_out`: why each is in no instant though it comes.
    fn without(&self, camera: usize, left_out: &[Option<LeftOut>], now: Instant) -> &'static str {
        let each = self.each.iter().zip(left_out).enumerate();
        let others = each.filter(|(k, _)| *k != camera);
        let combined = others.filter(|(_, (c, why))| why.is_none() && c.counts(self.began, now));
        // Two find people; one alone follows them.
        match combined.count() {
            0 | 1 => "there are no new bodies until two cameras can be combined",
            _ => "bodies come of the other cameras",
        }
    }

    /// Says which cameras are missing or cannot be combined, once. `now`: nanoseconds, on the clock of `together`.
    pub fn say(&mut self, together: &Synchroniser, now: u64) {
        let instant = Instant::now();
        let all = 0..self.each.len();
        let left_out: Vec<Option<LeftOut>> =
            all.clone().map(|k| together.left_out(k, now)).collect();
        let without: Vec<&str> = all.map(|k| self.without(k, &left_out, instant)).collect();
        let each = self.names.iter().zip(&mut self.each);
        for ((name, camera), (why, without)) in each.zip(left_out.into_iter().zip(without)) {
            let silent = camera.is_silent(self.began, instant);
            if silent && !camera.said && !camera.ended {
                camera.said = true;
                tracing::warn!("{name} sends no observations; {without}");
            }
            match camera.apart.look(why, instant) {
                Some(LeftOut::Slow(interval)) => tracing::warn!(
                    "{name} sends observations too seldom to be combined, every {interval:.1} s where {:.1} s is the most; {without}",
                    LeftOut::MOST_APART
                ),
                Some(LeftOut::Late(late)) => tracing::warn!(
                    "{name} sends observations too late to be combined, {late:.1} s after another camera where {:.1} s is the most; {without}",
                    LeftOut::LATEST
                ),
                None => {}
            }
        }
    }
}

/// What to say of a frame whose size is not the calibration's: a camera may be asked for that.
fn advised(error: anyhow::Error, view: &View, frame: &ObservationFrame) -> anyhow::Error {
    let is_turned = view.for_pictures([frame.height, frame.width]).is_some();
    if is_turned || frame.flags & FLAG_FILE_TIME != 0 {
        return error;
    }
    let told = told(&error);
    Failure::data(format!(
        "{told}; --capture-size asks the camera for the calibration's, where it has that"
    ))
    .into()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_camera_of_another_size_may_be_asked_for_the_right_one() {
        let (names, view) = (["hall".to_owned()], View::around(0.0));
        let refused = |[width, height]: [u32; 2], flags| {
            let frame = ObservationFrame {
                width,
                height,
                flags,
                ..ObservationFrame::default()
            };
            let checked = Cameras::new(&names).check(0, &view, &frame, Instant::now());
            told(&checked.unwrap_err())
        };
        let small = refused([540, 960], 0);
        assert!(small.starts_with("hall: expected pictures of 1080x1920 pixels"));
        assert!(small.contains("--capture-size asks"), "{small}");
        for (size, flags) in [([540, 960], FLAG_FILE_TIME), ([1920, 1080], 0)] {
            let other = refused(size, flags);
            assert!(!other.contains("--capture-size"), "{other}");
        }
    }

    /// Whether a frame of this camera counts that fits the calibration or not, seconds after the start; else the exit
    /// code.
    fn checked(
        cameras: &mut Cameras<'_>,
        camera: usize,
        fits: bool,
        after: f64,
    ) -> Result<bool, u8> {
        let view = View::around(0.0);
        let [width, height] = [[540, 960], [1080, 1920]][usize::from(fits)];
        let frame = ObservationFrame {
            width,
            height,
            ..ObservationFrame::default()
        };
        let now = cameras.began + Duration::from_secs_f64(after);
        let counts = cameras.check(camera, &view, &frame, now);
        counts.map_err(|e| crate::commands::exit::code(&e))
    }

    #[test]
    fn a_camera_of_another_size_is_left_out_beside_one_that_fits() {
        let names = ["hall".to_owned(), "yard".to_owned()];
        // Whichever comes first.
        for other_first in [false, true] {
            let mut cameras = Cameras::new(&names);
            if other_first {
                assert_eq!(checked(&mut cameras, 1, false, 0.0), Ok(false));
                assert!(!cameras.each[1].is_other, "said when it is sure");
            }
            assert_eq!(checked(&mut cameras, 0, true, 0.1), Ok(true));
            assert_eq!(checked(&mut cameras, 1, false, 0.2), Ok(false));
            assert!(cameras.each[1].is_other);
            assert_eq!(checked(&mut cameras, 1, false, 3600.0), Ok(false));
            assert_eq!(checked(&mut cameras, 1, true, 3600.1), Ok(true));
            assert!(!cameras.each[1].is_other, "it is back");
        }
        let mut again = Cameras {
            have_fitted: true,
            ..Cameras::new(&names)
        };
        for camera in 0..2 {
            assert_eq!(checked(&mut again, camera, false, 60.0), Ok(false));
        }
    }

    #[test]
    fn where_no_camera_fits_the_calibration_is_wrong() {
        use crate::commands::exit::DATA;
        let names = ["hall".to_owned(), "yard".to_owned()];
        for are_awaited in [false, true] {
            let new = || Cameras {
                are_awaited,
                ..Cameras::new(&names)
            };
            let mut cameras = new();
            assert_eq!(checked(&mut cameras, 0, false, 0.0), Ok(false));
            assert_eq!(checked(&mut cameras, 1, false, 0.1), Err(DATA));
            // The other one may be plugged in later where somebody waits for it.
            let mut cameras = new();
            assert_eq!(checked(&mut cameras, 0, false, 0.0), Ok(false));
            let later = checked(&mut cameras, 0, false, 5.1);
            assert_eq!(later, if are_awaited { Ok(false) } else { Err(DATA) });
        }
    }

    #[test]
    fn cameras_that_are_all_left_out_are_of_no_use() {
        let names = ["hall".to_owned(), "yard".to_owned()];
        let mut cameras = Cameras {
            are_awaited: true,
            ..Cameras::new(&names)
        };
        let began = cameras.began;
        let are_of_no_use = |cameras: &Cameras<'_>, after: f64| {
            cameras.are_of_no_use(began + Duration::from_secs_f64(after))
        };
        assert!(!are_of_no_use(&cameras, 0.0), "none has come");
        let come = |cameras: &Cameras<'_>, after: f64| {
            cameras.come(began + Duration::from_secs_f64(after))
        };
        assert_eq!(come(&cameras, 0.0), 0);
        assert_eq!(checked(&mut cameras, 0, false, 0.1), Ok(false));
        assert!(are_of_no_use(&cameras, 0.1), "the other one has not come");
        assert_eq!(checked(&mut cameras, 1, true, 1.0), Ok(true));
        assert_eq!(checked(&mut cameras, 0, false, 1.1), Ok(false));
        assert!(!are_of_no_use(&cameras, 1.1));
        assert_eq!((come(&cameras, 1.1), come(&cameras, 9.0)), (1, 0));
        // The one that fits is unplugged.
        assert_eq!(checked(&mut cameras, 0, false, 9.0), Ok(false));
        assert!(are_of_no_use(&cameras, 9.0));
        assert_eq!(checked(&mut cameras, 0, true, 9.1), Ok(true));
        assert!(!are_of_no_use(&cameras, 9.1));
    }

    #[test]
    fn without_a_camera_bodies_come_of_two_others_at_least() {
        let names = ["hall", "yard", "door"].map(str::to_owned);
        let mut cameras = Cameras::new(&names);
        let comes = |cameras: &Cameras<'_>, left_out: [Option<LeftOut>; 3], after: f64| {
            let now = cameras.began + Duration::from_secs_f64(after);
            cameras.without(0, &left_out, now).starts_with("bodies")
        };
        assert!(!comes(&cameras, [None; 3], 6.0), "none has come");
        assert_eq!(checked(&mut cameras, 0, true, 7.0), Ok(true));
        assert_eq!(checked(&mut cameras, 1, true, 7.0), Ok(true));
        assert!(!comes(&cameras, [None; 3], 7.1), "one other");
        assert_eq!(checked(&mut cameras, 2, true, 7.0), Ok(true));
        assert!(comes(&cameras, [None; 3], 7.1));
        let slow = Some(LeftOut::Slow(0.6));
        assert!(!comes(&cameras, [None, None, slow], 7.1));
        assert!(!comes(&cameras, [None; 3], 20.0), "all are silent");
    }

    #[test]
    fn a_file_that_does_not_come_any_more_lets_a_camera_come() {
        use crate::commands::exit::{DATA, code};
        let names = ["hall".to_owned(), "yard".to_owned()];
        let view = View::around(0.0);
        for (after, expected) in [(0.1, Err(DATA)), (10.0, Ok(true))] {
            let mut cameras = Cameras::new(&names);
            let film = ObservationFrame {
                width: 1080,
                height: 1920,
                flags: FLAG_FILE_TIME,
                ..ObservationFrame::default()
            };
            let began = cameras.began;
            assert!(cameras.check(0, &view, &film, began).unwrap());
            let camera = checked(&mut cameras, 1, true, after);
            assert_eq!(camera, expected, "{after} s later");
            // One that comes again beside the camera is none of the same clock.
            if expected.is_ok() {
                let now = began + Duration::from_secs_f64(after + 0.1);
                let again = cameras.check(0, &view, &film, now);
                assert_eq!(again.map_err(|e| code(&e)), Err(DATA));
            }
        }
    }
}
