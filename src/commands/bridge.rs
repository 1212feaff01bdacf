//! `edgecap bridge`: hands on what a camera publishes that already runs elsewhere.

use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM};
use edgecap_client::{Priority, Subscriber};

use super::bridges::BridgeArgs;
use super::exit::Failure;
use super::input::DEFAULT_NAME;
use super::relay::{EventRelay, HealthRelay};
use super::say;
use super::stop::Stop;
use super::watch::Absence;
use crate::sink::{Packet, Silence, Sinks};

/// How long to wait for a message before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);

/// Options of `edgecap bridge`.
#[derive(Debug, clap::Args)]
pub struct BridgeVerb {
    /// The camera: the --name of the run that publishes
    #[arg(long = "camera", visible_alias = "name", value_name = "NAME", default_value = DEFAULT_NAME)]
    camera: String,
    #[command(flatten)]
    bridges: BridgeArgs,
}

/// Hands on frames until the user stops it; the camera may come and go.
///
/// # Errors
/// Names that cannot be, no bridge named, addresses that are taken, and shared memory that fails.
pub fn bridge(args: BridgeVerb) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    if args.bridges.is_empty() {
        return Err(
            Failure::usage("expected where bodies go: --osc, --vmc, --view or --flight").into(),
        );
    }
    args.bridges.expect_page()?;
    let bodies = Subscriber::<BodyFrame>::open(&args.camera)?;
    let page = args.bridges.serve(false)?;
    let mut sinks = Sinks::default();
    let hub = page.as_ref().map(|p| p.hub());
    let flight = args.bridges.add_to(&mut sinks, &args.camera, hub)?;
    let priority = Priority::Reader;
    let mut events = EventRelay::to_bridges(&args.bridges, &args.camera, hub, priority)?;
    let mut health = HealthRelay::to_bridges(&args.bridges, &args.camera, hub, priority)?;
    // Before anybody is told: where the camera is away this is somebody who was there hours ago.
    bodies.next(Duration::ZERO)?;
    let at = page
        .as_ref()
        .map_or_else(String::new, |p| format!(" at {}", p.url_for_log()));
    say::out(&format!("handing on {}{at} (Ctrl-C stops)", args.camera));
    let (mut is_running, mut silence) = (false, Silence::default());
    let mut absence = Absence::since(Instant::now());
    while !stop.requested() {
        // Who is behind sends the newest, and the end in any case.
        let mut waiting = bodies.next(LOOK_UP)?.map(|frame| Box::new(*frame));
        if waiting.is_none()
            && let Some(line) = absence.look(&args.camera, &bodies, Instant::now())
        {
            say::err(&line);
        }
        while let Some(frame) = waiting {
            absence.hear(frame.flags, Instant::now());
            waiting = bodies.next(Duration::ZERO)?.map(|frame| Box::new(*frame));
            let is_end = |frame: &BodyFrame| frame.flags & FLAG_END_OF_STREAM != 0;
            if is_end(&frame) {
                is_running = false;
                sinks.end()?;
                continue;
            }
            is_running = true;
            silence.hear(Instant::now());
            if waiting.as_ref().is_none_or(|next| is_end(next)) {
                sinks.take(&Packet {
                    message: &*frame,
                    source: "",
                    picture: None,
                })?;
            }
        }
        if let Some(events) = &mut events {
            events.look()?;
        }
        if let Some(health) = &mut health {
            health.look();
        }
        if silence.begins(Instant::now()) {
            sinks.quiet();
        }
        // One that goes without saying so has crashed.
        let crashed = is_running && bodies.publisher_count() == 0;
        if crashed {
            is_running = false;
            sinks.end()?;
        }
        if let Some(flight) = &flight {
            flight.look(crashed);
        }
    }
    sinks.finish().1?;
    Ok(())
}
