//! A source's pictures go in, [`ObservationFrame`]s come out.

use std::time::{Duration, Instant};

use edgecap_client::message::{FLAG_FILE_TIME, MAX_PEOPLE, ObservationFrame};

use super::engine_args::EngineArgs;
use super::feed::{Delivery, Feed, Order, Picture};
use super::pipelines::{Pipelines, Way};
use crate::camera::{CameraFile, monotonic_ns};
use crate::capture::{Brightness, CaptureError, Frame, Mounting, Source};
use crate::commands::exit::Failure;
use crate::lift::FrameObservations;
use crate::schedule::mean::bounded;
use crate::schedule::pace::{Limits, Pace, Plan};
use crate::supervise::has_worked_before;

/// Share of a new measurement in what a picture takes.
const SMOOTH: f32 = 0.2;
/// What a picture takes at most where it has not taken long before, seconds: what takes longer is a stall, and the next
/// picture shall not wait for another.
const STALL: f32 = 0.25;

/// A source, its lens and the stages.
pub struct Observer {
    feed: Feed,
    is_live: bool,
    is_stills: bool,
    mounting: Mounting,
    camera: CameraFile,
    pipelines: Pipelines,
    pace: Pace,
    /// What the next order gives along: the picture that others are compared with, and a buffer.
    reference: Option<Brightness>,
    spare: Frame,
    plan: Plan,
    /// What the stages take for a picture, by the [`Way`] it is gone through, seconds.
    busy: [f32; 3],
    picture: Frame,
    /// Whether `picture` is the one that was observed last.
    has_picture: bool,
    /// Whether the lens has fitted a picture, of a camera also before this process was started in another's place.
    has_fitted: bool,
    /// Whether it was said that pictures of another shape are left out.
    has_told_of_shape: bool,
    /// Pictures of a file that were left out: how many, and what was wrong with the first.
    damage: Option<(u64, CaptureError)>,
    /// How many of them the lens does not fit.
    misfits: u64,
    picture_name: String,
}

/// What a step brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// A picture, observed.
    Observed,
    /// None at the moment: the next one has not come yet, or what came was damaged.
    Nothing,
    /// None: the source is away, and looked for, or sends pictures that the lens does not fit.
    Away,
    /// None is wanted yet.
    Idle,
    /// The source does not answer.
    Silent,
    /// There are no more.
    Ended,
}

impl Observer {
    /// Builds the stages.
    ///
    /// # Errors
    /// As [`Pipelines::new`].
    pub fn new(
        source: Box<dyn Source>,
        camera: CameraFile,
        engine: &EngineArgs,
        limits: Limits,
        mounting: Mounting,
    ) -> anyhow::Result<Self> {
        let mut pace = Pace::new(limits);
        let live = source.is_live().then_some(limits.interval_ns);
        Ok(Self {
            pipelines: Pipelines::new(engine, !source.is_stills(), live)?,
            is_live: source.is_live(),
            has_fitted: source.is_live() && has_worked_before(),
            is_stills: source.is_stills(),
            picture_name: source.picture(),
            feed: Feed::start(source, mounting)
                .map_err(|e| Failure::no_thread("that takes pictures", &e))?,
            mounting,
            camera,
            plan: pace.plan(0),
            pace,
            reference: None,
            spare: Frame::default(),
            busy: [0.0; 3],
            picture: Frame::default(),
            has_picture: false,
            has_told_of_shape: false,
            damage: None,
            misfits: 0,
        })
    }

    /// The picture observed last, unless it was not decoded because it shows what the one before showed: nobody.
    pub fn picture(&self) -> Option<&Frame> {
        self.has_picture.then_some(&self.picture)
    }

    /// Whether nobody is in view, nor was lately: pictures are only glanced at.
    pub fn is_idle(&self) -> bool {
        self.pace.is_idle()
    }

    /// The network's input of the last look for all of a picture, pixels across and down; zeros before the first.
    pub fn input(&self) -> (usize, usize) {
        self.pipelines.input()
    }

    /// Where it comes from.
    pub fn picture_name(&self) -> &str {
        &self.picture_name
    }

    /// Observes the next picture. Damaged ones among many are skipped, as are photos of another shape than the lens,
    /// and those of a file told at its end.
    ///
    /// # Errors
    /// When the source has ended in the middle or with pictures left out, when the lens does not fit the picture (of a
    /// camera the first one, of photos any); what was observed before stands.
    pub fn step(&mut self, message: &mut ObservationFrame) -> anyhow::Result<Step> {
        if !self.feed.is_pending() {
            self.order(Duration::ZERO);
        }
        match self.feed.receive()? {
            None => Ok(Step::Silent),
            Some(Delivery::NotDue) => Ok(Step::Idle),
            Some(Delivery::Ended) => match self.damage.take() {
                None => Ok(Step::Ended),
                // The lens is what is wrong.
                Some((n, e)) if n == self.misfits && !self.has_fitted => {
                    Err(Failure::config(e.to_string()).into())
                }
                Some((1, e)) => Err(anyhow::Error::from(e).context("left out")),
                Some((n, e)) => {
                    Err(anyhow::Error::from(e).context(format!("left out {n} pictures, the first")))
                }
            },
            Some(Delivery::Failed(e)) => match e {
                // The source has logged what is wrong and looks for the camera again.
                CaptureError::NoPictureYet { is_away: true, .. } => Ok(Step::Away),
                CaptureError::NoPictureYet { .. } => Ok(Step::Nothing),
                e if e.is_skippable() => {
                    match self.is_live {
                        true => tracing::debug!("{e}"),
                        false => self.leave_out(e),
                    }
                    Ok(Step::Nothing)
                }
                e => Err(e.into()),
            },
            Some(Delivery::Unchanged(time_ns, sequence, buffer)) => {
                self.spare = buffer;
                self.has_picture = false;
                self.pace.unchanged(time_ns);
                self.plan = self.pace.plan(time_ns);
                (message.sequence, message.capture_ns) = (sequence, time_ns);
                message.count = 0;
                message.without_neck = 0;
                message.stage_times = Default::default();
                message.publish_ns = monotonic_ns();
                Ok(Step::Observed)
            }
            Some(Delivery::Picture(picture)) => self.observe(*picture, message),
        }
    }

    /// What to say of a lens that does not fit the first picture: started again, this would come again.
    fn misfit(&self, reason: &str) -> Failure {
        let advice = match self.camera {
            CameraFile::Calibrated { width, height, .. } if self.is_live => {
                format!("; --capture-size {width}x{height} asks a camera for that shape")
            }
            _ => String::new(),
        };
        Failure::config(format!("{}: {reason}{advice}", self.picture_name))
    }

    /// Goes on without a picture of a file.
    fn leave_out(&mut self, why: CaptureError) {
        tracing::warn!("{why}; skipped");
        let (count, first) = self.damage.take().unwrap_or((0, why));
        self.damage = Some((count + 1, first));
    }

    fn order(&mut self, busy: Duration) {
        self.feed.order(Order {
            from_ns: self.plan.from_ns,
            wanted: self.plan.wanted,
            ready_at: Instant::now() + busy,
            reference: self.reference.take(),
            buffer: std::mem::take(&mut self.spare),
        });
    }

    fn observe(
        &mut self,
        picture: Picture,
        message: &mut ObservationFrame,
    ) -> anyhow::Result<Step> {
        self.spare = std::mem::replace(&mut self.picture, picture.frame);
        self.has_picture = true;
        self.picture_name = picture.name;
        let now = self.picture.time_ns;
        // The lens is that of the picture as the camera gives it.
        let (width, height) = self.mounting.size(self.picture.width, self.picture.height);
        let lens = match self.camera.for_frame(width, height) {
            Ok(lens) => lens,
            // A camera that has come back in another mode may come back in its own.
            Err(reason) if self.is_live && self.has_fitted => {
                if !std::mem::replace(&mut self.has_told_of_shape, true) {
                    tracing::warn!("pictures of another shape are left out: {reason}");
                }
                self.has_picture = false;
                return Ok(Step::Away);
            }
            // Photos have nothing to do with each other.
            Err(reason) if self.is_stills && picture.total.is_some_and(|n| n > 1) => {
                let input = self.picture_name.clone();
                self.leave_out(CaptureError::Picture { input, reason });
                self.misfits += 1;
                self.has_picture = false;
                return Ok(Step::Nothing);
            }
            Err(reason) => return Err(self.misfit(&reason).into()),
        };
        self.has_fitted = true;
        let intrinsics = self.mounting.intrinsics(lens, width, height);
        let idle = self.pace.is_idle();
        // The next one is taken and decoded while this one is gone through.
        if !self.is_live {
            self.order(Duration::ZERO);
        }
        let way = match idle {
            true => Way::Whole,
            false => self.pipelines.choose(&self.picture)?,
        };
        let kind = way as usize;
        if !idle && self.is_live {
            self.plan = self.pace.plan(now);
            self.order(Duration::from_secs_f32(self.busy[kind]));
        }
        let start = Instant::now();
        let seen = if idle {
            let look = self.pace.look(now);
            let seen = self
                .pipelines
                .look(&self.picture, &intrinsics, look.large)?;
            if self.pace.looked(now, look, seen.people.len()) {
                self.reference = picture.brightness;
            }
            seen
        } else {
            let seen = self.pipelines.process(&self.picture, &intrinsics)?;
            if self.is_live {
                self.pace.seen(now, seen.people.len());
            }
            seen
        };
        fill(message, &self.picture, &seen);
        took(&mut self.busy[kind], start.elapsed().as_secs_f32());
        message.intrinsics = intrinsics;
        message.flags = if self.is_live { 0 } else { FLAG_FILE_TIME };
        let total = picture.total.unwrap_or(0);
        message.frame_total = u32::try_from(total).unwrap_or(u32::MAX);
        if self.is_live && !self.feed.is_pending() {
            self.plan = self.pace.plan(now);
        }
        message.publish_ns = monotonic_ns();
        Ok(Step::Observed)
    }
}

/// Takes in what a picture took, seconds.
fn took(busy: &mut f32, seconds: f32) {
    *busy += SMOOTH * (bounded(seconds, *busy, STALL) - *busy);
}

/// What was seen in a picture, as a message.
fn fill(message: &mut ObservationFrame, picture: &Frame, seen: &FrameObservations<'_>) {
    message.sequence = picture.sequence;
    message.capture_ns = picture.time_ns;
    message.width = picture.width;
    message.height = picture.height;
    message.stage_times = seen.times;
    message.without_neck = seen.without_neck;
    message.count = seen.people.len().min(MAX_PEOPLE) as u32;
    for (slot, o) in message.people.iter_mut().zip(seen.people) {
        *slot = *o;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_stall_pictures_are_taken_as_often_as_before() {
        let mut busy = 0.0;
        let mut after = |seconds, n| {
            for _ in 0..n {
                took(&mut busy, seconds);
            }
            busy
        };
        assert!((after(0.03, 60) - 0.03).abs() < 1e-3);
        assert!(after(5.0, 1) < 0.08);
        assert!(after(0.03, 10) < 0.04);
        // Where every picture takes as long, the next one is taken when there is time for it.
        assert!((after(5.0, 60) - 5.0).abs() < 0.1);
    }
}
