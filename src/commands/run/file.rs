//! A file from its first picture to its last: seen in one thread, fitted and written in another, which wait for each other.

use std::sync::mpsc::{SyncSender, sync_channel};

use edgecap_client::message::{BodyFrame, ObservationFrame};
use edgecap_client::{LinkError, service_name};

use super::RunArgs;
use crate::camera::monotonic_ns;
use crate::capture::Frame;
use crate::commands::fit::settings::fitter;
use crate::commands::infer::{Limits, Observer, Step};
use crate::commands::input::{self, NamedInput};
use crate::commands::outputs::finish;
use crate::commands::say;
use crate::commands::stop::Stop;
use crate::commands::table::Table;
use crate::commands::tally::Tally;
use crate::record::BodiesRow;
use crate::sink::{OverlaySink, Packet, SharedMemorySink, Sinks};

/// Frames that may be seen before the first of them is written.
const AHEAD: usize = 4;

/// A frame on its way from the one thread to the other.
struct Observed {
    message: Box<ObservationFrame>,
    source: String,
    /// Where somebody wants to draw on it.
    picture: Option<Frame>,
}

/// Runs the whole system on a file.
///
/// # Errors
/// As [`run`](super::run).
pub fn run(args: &RunArgs, chosen: &NamedInput, stop: &Stop) -> anyhow::Result<()> {
    let source = chosen.open(&args.input)?;
    let camera = input::camera_file(&args.input, chosen)?;
    let mut fitter = fitter(args.fitting.fit.as_ref(), source.is_stills())?;
    let mut sinks = Sinks::default();
    args.record.add_to::<BodiesRow>(&mut sinks)?;
    let page = args.bridges.serve()?;
    if let Some(page) = &page {
        say::err(&format!("the page: {}", page.url()));
    }
    let hub = page.as_ref().map(|p| p.hub());
    args.bridges.add_to(&mut sinks, &chosen.name, hub)?;
    if let Some(path) = &args.overlay {
        sinks.push(OverlaySink::create(path, source.fps(), source.is_stills())?);
    }
    let mut table = Table::new(args.table);
    match SharedMemorySink::<BodyFrame>::open(&chosen.name) {
        Ok(stream) => {
            sinks.push(stream);
            let stream = service_name::<BodyFrame>(&chosen.name);
            table.say(&format!(
                "{} → shared memory {stream} (Ctrl-C stops)",
                chosen.spec
            ));
        }
        Err(e @ LinkError::Name(_)) => return Err(e.into()),
        Err(e) if args.input.name.is_some() => return Err(e.into()),
        // The file's result does not need it.
        Err(e) => tracing::warn!("nobody can watch this run: {e}"),
    }

    let mut tally = Tally::default();
    let wants_pictures = args.overlay.is_some();
    let outcome = std::thread::scope(|threads| -> anyhow::Result<()> {
        let (send, receive) = sync_channel(AHEAD);
        let seeing = threads.spawn(move || {
            let mounting = args.input.mounting();
            let limits = Limits::default();
            let mut observer = Observer::new(source, camera, &args.engine, limits, mounting)?;
            see(&mut observer, &send, wants_pictures, stop)
        });
        let mut out = Box::new(BodyFrame::default());
        let mut written = Ok(());
        // Ends with the last frame, or, by dropping its end of the channel, lets the other thread end.
        for observed in receive {
            let Observed {
                message,
                source,
                picture,
            } = observed;
            let start = std::time::Instant::now();
            fitter.update(&message, &mut out);
            out.fit_us = start.elapsed().as_micros() as u32;
            out.publish_ns = monotonic_ns();
            tally.count(&out);
            table.update(&out, tally.lost);
            written = sinks.take(&Packet {
                message: &*out,
                source: &source,
                picture: picture.as_ref(),
            });
            if written.is_err() {
                break;
            }
        }
        let seen = seeing.join();
        let seen = seen.unwrap_or_else(|_| Err(anyhow::anyhow!("the stages ended unexpectedly")));
        written?;
        seen
    });
    table.finish();
    let words = finish(sinks, tally.frames, outcome)?;
    args.conclude(&tally, &words);
    Ok(())
}

/// Sees every picture until the input ends, the user stops it, or nobody wants more.
fn see(
    observer: &mut Observer<'_>,
    send: &SyncSender<Observed>,
    wants_pictures: bool,
    stop: &Stop,
) -> anyhow::Result<()> {
    while !stop.requested() {
        let mut message = Box::new(ObservationFrame::default());
        match observer.step(&mut message)? {
            Step::Nothing | Step::Idle | Step::Silent => continue,
            Step::Ended => break,
            Step::Observed => {}
        }
        let observed = Observed {
            message,
            source: observer.picture_name().to_owned(),
            picture: observer.picture().filter(|_| wants_pictures).cloned(),
        };
        if send.send(observed).is_err() {
            break;
        }
    }
    Ok(())
}
