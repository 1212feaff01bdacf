//! A file from its first picture to its last: seen in one thread, fitted and written in another, which wait for each
//! other.

use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread::Builder;
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, EventFrame, ObservationFrame};
use edgecap_client::{Priority, service_name};

use super::RunArgs;
use crate::camera::monotonic_ns;
use crate::capture::Frame;
use crate::commands::event_settings;
use crate::commands::exit::{self, Failure};
use crate::commands::export::Exports;
use crate::commands::fit_settings::fitter;
use crate::commands::health::HealthStream;
use crate::commands::infer::{Observer, Step};
use crate::commands::input::{self, NamedInput};
use crate::commands::outputs::finish;
use crate::commands::relay::{PictureRelay, hush};
use crate::commands::say;
use crate::commands::stop::Stop;
use crate::commands::table::Table;
use crate::commands::taken::{What, expect_free};
use crate::commands::tally::Tally;
use crate::metrics::About;
use crate::record::BodiesRow;
use crate::schedule::pace::Limits;
use crate::sink::{
    EventSink, OverlaySink, Packet, PictureSink, SharedMemorySink, Silence, Sinks, Streams,
};

/// Frames that may be seen before the first of them is written.
const AHEAD: usize = 4;
/// How long to wait for a frame before looking at what has none.
const LOOK_UP: Duration = Duration::from_millis(200);

/// A frame on its way from the one thread to the other.
struct Observed {
    message: Box<ObservationFrame>,
    source: String,
    /// The network's input, pixels across and down.
    input: (usize, usize),
    /// Where somebody wants to draw on it.
    picture: Option<Frame>,
}

/// Runs the whole system on a file.
///
/// # Errors
/// As [`run`](super::run).
pub fn run(args: &RunArgs, chosen: &NamedInput, stop: &Stop) -> anyhow::Result<()> {
    let streams = Streams::of_file(&chosen.name, args.input.name.is_some());
    streams.expect(expect_free(&chosen.name, &[What::Bodies, What::Health]))?;
    let exports = Exports::new(&args.export)?;
    let source = chosen.open(&args.input)?;
    let camera = input::camera_file(&args.input, chosen)?;
    let mut fitter = fitter(args.fitting.fit.as_ref(), source.is_stills())?;
    let mut sinks = Sinks::default();
    let has_end = chosen.has_end();
    args.record.add_to::<BodiesRow>(has_end, &mut sinks)?;
    let kept = exports.keep(&mut sinks)?;
    let page = args.bridges.serve(args.show_picture)?;
    if let Some(page) = &page {
        say::err(&format!("the page: {}", page.url_for_log()));
    }
    let hub = page.as_ref().map(|p| p.hub());
    let flight = args.bridges.add_to(&mut sinks, &chosen.name, hub)?;
    if let Some(path) = &args.overlay {
        sinks.push(OverlaySink::create(
            path,
            source.rate(),
            source.is_stills(),
        )?);
    }
    let mut happened = Sinks::default();
    let events = event_settings::config(args.fitting.events.as_ref())?;
    args.bridges
        .add_events_to(&mut happened, &chosen.name, hub)?;
    let mut table = Table::new(args.table);
    if streams.add_to(&mut sinks, SharedMemorySink::<BodyFrame>::open)? {
        let stream = service_name::<BodyFrame>(&chosen.name);
        table.say(&format!(
            "{} → shared memory {stream} (Ctrl-C stops)",
            chosen.spec
        ));
    }
    if args.show_picture {
        streams.add_to(&mut sinks, PictureSink::open)?;
    }
    streams.add_to(&mut happened, SharedMemorySink::<EventFrame>::open)?;
    let about = About {
        is_file: true,
        is_sequence: !source.is_stills(),
        ..About::default()
    };
    let mut health = HealthStream::open(about, Some(&streams))?;
    args.bridges
        .add_health_to(health.sinks(), &chosen.name, hub)?;
    health.look(|_, _| ())?;
    let mut pictures = PictureRelay::to_page(&chosen.name, &chosen.name, hub, Priority::Reserved)?;
    if !happened.is_empty() {
        sinks.push(EventSink::new(events, happened));
    }

    let mut tally = Tally::default();
    let wants_pictures = args.overlay.is_some() || args.show_picture;
    let outcome = std::thread::scope(|threads| -> anyhow::Result<bool> {
        let (send, receive) = sync_channel(AHEAD);
        let work = move || {
            let mounting = args.input.mounting();
            let limits = Limits::default();
            let mut observer = Observer::new(source, camera, &args.engine, limits, mounting)?;
            see(&mut observer, &send, wants_pictures, stop)
        };
        let seeing = Builder::new()
            .name("stages".into())
            .spawn_scoped(threads, work)
            .map_err(|e| Failure::no_thread("that looks at pictures", &e))?;
        let mut out = Box::new(BodyFrame::default());
        let mut written = Ok(());
        let mut silence = Silence::default();
        loop {
            match receive.recv_timeout(LOOK_UP) {
                Ok(Observed {
                    message,
                    source,
                    input,
                    picture,
                }) => {
                    silence.hear(Instant::now());
                    let start = Instant::now();
                    fitter.update(&message, &mut out);
                    out.fit_us = start.elapsed().as_micros() as u32;
                    out.publish_ns = monotonic_ns();
                    tally.count(&out);
                    // No picture is left out: a film's own numbers have gaps where it repeats pictures or some are
                    // damaged.
                    table.update(&out, 0);
                    written = sinks.take(&Packet {
                        message: &*out,
                        source: &source,
                        picture: picture.as_ref(),
                    });
                    let told = health.look(|health, now| {
                        health.looks_at(input);
                        health.observed(now, &(&*out).into(), false);
                    });
                    written = written.and(told);
                }
                // A film is as slow as this machine; what has no end may have stalled where it comes from.
                Err(RecvTimeoutError::Timeout) if has_end => written = health.look(|_, _| ()),
                Err(RecvTimeoutError::Timeout) => {
                    hush(&mut silence, &mut sinks, &mut pictures);
                    written = health.look(|health, now| health.waits(now));
                }
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if written.is_err() {
                break;
            }
            if let Some(Err(e)) = pictures.as_mut().map(PictureRelay::look) {
                tracing::debug!("{}: {e}", chosen.name);
            }
            if let Some(flight) = &flight {
                flight.look(false);
            }
        }
        // Ends the other thread, where it still sees.
        drop(receive);
        let seen = seeing.join();
        let seen = seen.unwrap_or_else(|_| Err(anyhow::anyhow!("the stages ended unexpectedly")));
        written?;
        seen
    });
    // Publishers wait a little for those who still read.
    drop(pictures);
    health.end();
    table.finish();
    let is_stopped = matches!(outcome, Ok(false)) && has_end;
    let stopped = || anyhow::Error::from(Failure::stopped(tally.frames));
    let outcome = match is_stopped && tally.frames == 0 {
        true => Err(stopped()),
        false => outcome.map(drop),
    };
    let (outcome, left_out) = exit::without_left_out(outcome, tally.frames);
    if is_stopped {
        sinks.break_off();
    }
    let (mut words, ended) = finish(sinks, tally.frames, outcome);
    health.finish();
    let is_broken = is_stopped || ended.is_err();
    // What was seen before a film broke off is exported, too.
    let (exported, is_exported) = match kept.filter(|_| tally.frames > 0) {
        Some(kept) => kept.write(&chosen.spec.to_string(), is_broken),
        None => (Vec::new(), Ok(())),
    };
    words.extend(exported);
    if ended.is_ok() || !words.is_empty() {
        args.conclude(&tally, &words);
    }
    ended?;
    is_exported?;
    match is_stopped {
        true => Err(stopped()),
        false => left_out,
    }
}

/// Sees every picture until the input ends, the user stops it, or nobody wants more; whether it has ended.
fn see(
    observer: &mut Observer,
    send: &SyncSender<Observed>,
    wants_pictures: bool,
    stop: &Stop,
) -> anyhow::Result<bool> {
    while !stop.requested() {
        let mut message = Box::new(ObservationFrame::default());
        match observer.step(&mut message)? {
            Step::Nothing | Step::Away | Step::Idle | Step::Silent => continue,
            Step::Ended => return Ok(true),
            Step::Observed => {}
        }
        let observed = Observed {
            message,
            source: observer.picture_name().to_owned(),
            input: observer.input(),
            picture: observer.picture().filter(|_| wants_pictures).cloned(),
        };
        if send.send(observed).is_err() {
            break;
        }
    }
    Ok(false)
}
