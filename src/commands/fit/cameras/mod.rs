//! `edgecap fit --cameras`: what several `infer` processes publish becomes one body a person, in the calibration's
//! axes.

mod camera;
mod presence;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM, ObservationFrame};
use edgecap_client::{LinkError, Priority, Subscriber};

use self::presence::Cameras;
use super::numbers::Succession;
use super::pace::{Fresh, Pace};
use super::{FitTask, STEP};
use crate::camera::{Sleep, monotonic_ns};
use crate::commands::exit::Failure;
use crate::commands::health::HealthStream;
use crate::commands::outputs::finish;
use crate::commands::stop::Stop;
use crate::metrics::About;
use crate::multiview::live::{LiveFit, Synchroniser};
use crate::multiview::to_view;
use crate::sink::{Packet, Sinks, Streams};
use crate::supervise::{Beat, Heartbeat, has_worked_before, restarts};

/// Observations that may wait while one instant is fitted.
const WAITING: usize = 64;
/// How soon it is looked again whether a camera that is waited for has dropped out.
const LOOK_AGAIN: Duration = Duration::from_millis(10);

/// Fits until the user stops it or all cameras have ended. One that is not there is waited for.
///
/// # Errors
/// Shared memory, pictures of sizes that the calibration is not for, a thread that cannot be had, and outputs; what was
/// fitted before is complete.
pub fn live(
    fit: LiveFit,
    names: &[String],
    task: &FitTask,
    mut sinks: Sinks<BodyFrame>,
    stop: &Stop,
    heart: &Heartbeat,
) -> anyhow::Result<()> {
    let over = AtomicBool::new(false);
    let (mut frames, mut succession) = (0, Succession::after(task.before));
    let mut health = health_of(names, task)?;
    let outcome = std::thread::scope(|threads| {
        let _ends = Ends(&over);
        let (to, news) = sync_channel(WAITING);
        for (camera, name) in names.iter().enumerate() {
            let (to, over) = (to.clone(), &over);
            let work = move || {
                if let Err(e) = read(camera, name, &to, over) {
                    let _ = to.send(Err(e));
                }
            };
            std::thread::Builder::new()
                .spawn_scoped(threads, work)
                .map_err(|e| Failure::no_thread("for each camera", &e))?;
        }
        drop(to);
        let mut publish = |out: Option<&mut BodyFrame>, come: usize| -> anyhow::Result<()> {
            let Some(out) = out else {
                health.look(|health, now| {
                    health.come(come);
                    health.waits(now);
                })?;
                return Ok(());
            };
            frames += 1;
            succession.go_on(out);
            out.publish_ns = monotonic_ns();
            sinks.take(&Packet {
                message: out,
                source: "",
                picture: None,
            })?;
            heart.beat(Beat::Step);
            health.look(|health, now| {
                health.come(come);
                health.observed(now, &(&*out).into(), false);
            })?;
            Ok(())
        };
        fit_all(
            fit,
            names,
            Pace::new(task.rate),
            &news,
            stop,
            heart,
            &mut publish,
        )
    });
    health.end();
    let ended = finish(sinks, frames, outcome).1;
    health.finish();
    ended
}

/// What is said of a room whose bodies have this task's name; nothing where a camera says it of itself under that.
fn health_of(names: &[String], task: &FitTask) -> Result<HealthStream, LinkError> {
    let about = About {
        is_sequence: false,
        restarts: restarts(),
        cameras: names.len() as u32,
        ..About::default()
    };
    let streams = Streams::of_camera(task.name());
    let is_free = names.iter().all(|name| name != task.name());
    HealthStream::open(about, is_free.then_some(&streams))
}

/// Ends the readers, however the fit ends.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// An observation with its camera, or why there are none any more.
type News = Result<(usize, Box<ObservationFrame>), LinkError>;

/// Hands on what one camera publishes.
fn read(
    camera: usize,
    name: &str,
    to: &SyncSender<News>,
    over: &AtomicBool,
) -> Result<(), LinkError> {
    let observations = Subscriber::<ObservationFrame>::open_with(name, Priority::Reserved)?;
    let mut fresh = Fresh::of(name);
    while !over.load(Ordering::Relaxed) {
        if let Some(frame) = observations.next(STEP)? {
            let ended = frame.flags & FLAG_END_OF_STREAM != 0;
            if (ended || fresh.is_news(&frame)) && to.send(Ok((camera, Box::new(*frame)))).is_err()
            {
                break;
            }
        }
    }
    Ok(())
}

/// Fits until all cameras have ended or the user stops it. `publish` gets bodies as they come, or nothing where there
/// are none yet, and how many cameras send.
fn fit_all(
    mut fit: LiveFit,
    names: &[String],
    mut pace: Pace,
    news: &Receiver<News>,
    stop: &Stop,
    heart: &Heartbeat,
    publish: &mut dyn FnMut(Option<&mut BodyFrame>, usize) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let mut cameras = Cameras::new(names);
    cameras.are_awaited = heart.is_supervised();
    cameras.have_fitted = has_worked_before();
    let mut together = Synchroniser::new(names.len());
    let mut out = Box::new(BodyFrame::default());
    let mut fit_us = 0;
    let mut sleep = Sleep::default();
    heart.beat(Beat::Idle);
    while !stop.requested() {
        let longest = if together.is_waiting() {
            LOOK_AGAIN
        } else {
            STEP
        };
        let mut next = match news.recv_timeout(pace.patience(longest, Instant::now())) {
            Ok(next) => Some(next),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => break,
        };
        let now = monotonic_ns();
        while let Some(came) = next {
            let (camera, mut frame) = came?;
            let view = &fit.views()[camera];
            next = news.try_recv().ok();
            if !cameras.check(camera, view, &frame, Instant::now())? {
                continue;
            }
            // Who publishes observations need not know the calibrated lens.
            let (lens, count) = (frame.intrinsics, frame.people().len());
            to_view(view, &lens, &mut frame.people[..count]);
            together.push(camera, &frame, now);
        }
        cameras.say(&together, now);
        let come = cameras.come(Instant::now());
        let mut is_idle = true;
        while let Some(set) = together.next(now) {
            let slept = sleep.seconds();
            if !set.file_time {
                fit.slept(slept);
            }
            let start = Instant::now();
            fit.update(&set, &mut out);
            fit_us = start.elapsed().as_micros() as u32;
            out.fit_us = fit_us;
            if pace.fitted(&out, Instant::now()) {
                publish(Some(&mut out), come)?;
            }
            is_idle = false;
        }
        if pace.is_due(Instant::now()) {
            fit.predict(monotonic_ns(), &mut out);
            out.fit_us = fit_us;
            publish(Some(&mut out), come)?;
            is_idle = false;
        }
        if is_idle {
            publish(None, come)?;
            let beat = match cameras.are_of_no_use(Instant::now()) {
                true => Beat::Away,
                false => Beat::Idle,
            };
            heart.beat(beat);
        }
        if together.has_ended() {
            break;
        }
    }
    Ok(())
}
