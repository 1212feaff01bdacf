//! A camera, or several that see the same people: `infer` and `fit` under supervision, and what they publish.

use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM};
use edgecap_client::{Priority, Subscriber, service_name};

use super::RunArgs;
use super::flow::{Flow, Remedy};
use super::hints;
use super::infers::Infers;
use super::mend::look_after;
use super::pulse::Pulse;
use crate::bridge::websocket::Hub;
use crate::commands::bridges::Flight;
use crate::commands::exit::Failure;
use crate::commands::fit::FitTask;
use crate::commands::fit::numbers::Before;
use crate::commands::infer::InferTask;
use crate::commands::input::NamedInput;
use crate::commands::outputs::finish;
use crate::commands::relay::{EventRelay, HealthRelay, PictureRelay, hush};
use crate::commands::stop::Stop;
use crate::commands::table::Table;
use crate::commands::tally::Tally;
use crate::metrics::Meter;
use crate::record::BodiesRow;
use crate::sink::{Packet, Silence, Sinks};
use crate::supervise::{Beat, Child, Progress, stop_all};

/// How long the last bodies may take after `infer` has ended.
const LAST_BODIES: Duration = Duration::from_secs(3);
/// How often the children are looked at, whatever comes from them.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// What sees, and what becomes of it.
pub struct Plan {
    /// Name under which bodies are published.
    pub name: String,
    /// What is opened.
    pub source: String,
    /// The bundled clip plays because there is no camera.
    pub stands_in: bool,
    /// It was begun before, and what is said at the start has been said.
    pub is_again: bool,
    /// One process a camera, with its name.
    pub infers: Vec<(String, InferTask)>,
    /// What is fitted.
    pub fit: FitTask,
}

impl Plan {
    /// Of one camera.
    pub fn of_camera(args: &RunArgs, chosen: &NamedInput) -> Self {
        Self {
            name: chosen.name.clone(),
            source: chosen.spec.to_string(),
            stands_in: chosen.stands_in,
            is_again: false,
            infers: vec![(chosen.name.clone(), args.infer_task(chosen))],
            fit: FitTask {
                name: Some(chosen.name.clone()),
                cameras: Vec::new(),
                calibration: None,
                config: args.fitting.fit.clone(),
                stills: false,
                rate: args.fitting.rate,
                events: args.fitting.events.clone(),
                before: Before::default(),
            },
        }
    }
}

/// Runs the whole system on a camera, or on several that see the same people.
///
/// # Errors
/// As [`run`](super::run).
pub fn run(
    args: &RunArgs,
    plan: Plan,
    mut table: Table,
    meter: &Meter,
    pulse: &Pulse<'_>,
    page: Option<&Hub>,
    stop: &Stop,
) -> anyhow::Result<()> {
    let mut sinks = Sinks::default();
    args.record.add_patient_to::<BodiesRow>(&mut sinks)?;
    let flight = args.bridges.add_to(&mut sinks, &plan.name, page)?;
    let bodies = Subscriber::<BodyFrame>::open_with(&plan.name, Priority::Reserved)?;
    let priority = Priority::Reserved;
    let mut events = EventRelay::to_bridges(&args.bridges, &plan.name, page, priority)?;
    let cameras = plan.infers.iter().map(|(camera, _)| camera);
    let others = cameras.filter(|camera| **camera != plan.name);
    let mut health = Vec::new();
    for name in std::iter::once(&plan.name).chain(others) {
        health.extend(HealthRelay::to_bridges(
            &args.bridges,
            name,
            page,
            priority,
        )?);
    }
    let mut pictures = Vec::new();
    for (camera, _) in &plan.infers {
        pictures.extend(PictureRelay::to_page(camera, camera, page, priority)?);
    }
    if let Some(camera) = shown_of_room(&plan.name, plan.infers.iter().map(|(name, _)| &**name)) {
        pictures.extend(PictureRelay::to_page(camera, &plan.name, page, priority)?);
    }
    if !plan.is_again {
        say_what_begins(&plan, &table);
    }
    let mut task = plan.fit;
    let mut fit = Child::new("fit", &task)?.after(meter.starts("fit"));
    let mut infers = Infers::new(plan.infers, meter.starts("infer"))?;
    let (mut tally, mut silence) = (Tally::default(), Silence::default());
    let told = Told {
        meter,
        pulse,
        flight: flight.as_ref(),
    };
    let outcome = watch(&bodies, stop, &mut infers, &mut fit, told, &mut |news| {
        let frame = match news {
            News::Bodies(frame) => frame,
            News::NoFit(fit) => {
                // Whoever reads on, and records that go on, would take others for those before.
                let (number, id) = meter.newest();
                let before = Before { number, id };
                if task.before != before {
                    task.before = before;
                    sinks.everybody_leaves();
                    fit.give(&task)?;
                }
                return Ok(());
            }
            News::Look => {
                hush(&mut silence, &mut sinks, &mut pictures);
                events.as_mut().map_or(Ok(()), EventRelay::look)?;
                health.iter_mut().for_each(HealthRelay::look);
                return Ok(pictures.iter_mut().try_for_each(PictureRelay::look)?);
            }
        };
        silence.hear(Instant::now());
        meter.published(frame);
        tally.count(frame);
        table.update(frame, tally.left_out);
        Ok(sinks.take(&Packet {
            message: frame,
            source: &plan.source,
            picture: None,
        })?)
    });
    // Publishers wait a little for those who still read.
    drop((bodies, events, health, pictures));
    let mut children: Vec<&mut Child> = infers.children().collect();
    children.push(&mut fit);
    stop_all(&mut children);
    table.finish();
    let (words, ended) = finish(sinks, tally.frames, outcome);
    if ended.is_ok() || !words.is_empty() {
        args.conclude(&tally, &words);
    }
    ended
}

/// Whose pictures the page shows besides under a room's name, since it shows the pictures of whose bodies it shows: its
/// first camera's. `None` where one camera has that name and is shown under it.
fn shown_of_room<'a>(room: &str, mut cameras: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let first = cameras.next().filter(|first| *first != room)?;
    cameras.all(|camera| camera != room).then_some(first)
}

/// Says what is published where, and how to look at it.
fn say_what_begins(plan: &Plan, table: &Table) {
    let stream = service_name::<BodyFrame>(&plan.name);
    table.say(&format!(
        "{} → shared memory {stream} (Ctrl-C stops)",
        plan.source
    ));
    if plan.stands_in {
        table.say("there is no camera: the bundled clip plays over and over in its place");
    }
    if plan.stands_in || table.is_on_terminal() {
        for line in hints::lines(&plan.name) {
            table.say(&line);
        }
    }
}

/// Who hears how the cameras are doing.
#[derive(Clone, Copy)]
struct Told<'a> {
    meter: &'a Meter,
    pulse: &'a Pulse<'a>,
    flight: Option<&'a Flight>,
}

/// What a camera's stream and its processes bring.
enum News<'a> {
    Bodies(&'a BodyFrame),
    /// There is no `fit` at the moment: it may be started at once.
    NoFit(&'a mut Child),
    /// It is time to look what has happened.
    Look,
}

/// Hands every message to `take` until the input ends, the user stops, or a process fails for good.
fn watch(
    bodies: &Subscriber<BodyFrame>,
    stop: &Stop,
    infers: &mut Infers,
    fit: &mut Child,
    Told {
        meter,
        pulse,
        flight,
    }: Told<'_>,
    take: &mut dyn FnMut(News<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let mut infers_done: Option<Instant> = None;
    let mut end_seen = false;
    let mut flow = Flow::default();
    let mut starts = 0;
    while !stop.requested() {
        let looked = Instant::now();
        let mut received = false;
        while let Some(frame) = bodies.next(LOOK_EVERY.saturating_sub(looked.elapsed()))? {
            // A fit that somebody ended says so, too, and is started again.
            end_seen = frame.flags & FLAG_END_OF_STREAM != 0;
            if !end_seen {
                take(News::Bodies(&frame))?;
                received = true;
            }
            // What a `fit` that is not there any more has published counts for the one after it, all of it.
            if looked.elapsed() >= LOOK_EVERY && fit.is_there() {
                break;
            }
        }
        take(News::Look)?;
        meter.looked();
        // Whoever ends a whole group of processes ends the children, too.
        if stop.requested() {
            break;
        }
        infers.look_after(meter)?;
        if infers.have_ended() {
            let since = infers_done.get_or_insert_with(Instant::now);
            if end_seen || since.elapsed() > LAST_BODIES {
                return Ok(());
            }
        } else {
            if !fit.is_there() {
                take(News::NoFit(fit))?;
            }
            look_after(fit, meter.name(), meter)?;
        }
        meter.started(fit.verb(), fit.starts());
        let now = infers.starts() + fit.starts();
        if let Some(flight) = flight {
            // Each was started once; more is again.
            flight.look(now > starts && now > 1 + infers.count() as u64);
        }
        starts = now;
        if received {
            pulse.beat(Progress::Bodies);
        } else if infers.heard(Beat::Away)
            || infers.have_left_one()
            || fit.heard() == Some(Beat::Away)
        {
            // To start everything anew would leave more behind, of other cameras too.
            pulse.beat(Progress::Waiting);
        } else if infers.heard(Beat::Waiting) {
            pulse.beat(Progress::Still);
        }
        let published = infers.heard(Beat::Step);
        match flow.look(Instant::now(), received, published, fit.heard()) {
            Remedy::Wait => {}
            Remedy::Fit => fit.replace("publishes nothing"),
            Remedy::Both => {
                fit.replace("publishes nothing");
                infers.replace("reaches nobody");
            }
            Remedy::GiveUp => {
                return Err(Failure::unavailable(
                    "observations are published, but no bodies arrive through shared memory: 'edgecap doctor' looks why",
                )
                .into());
            }
        }
    }
    pulse.stopping();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_shows_one_cameras_pictures_under_one_name() {
        let shown = |room| shown_of_room(room, ["hall", "yard"].into_iter());
        assert_eq!(shown("room"), Some("hall"));
        for camera in ["hall", "yard"] {
            assert_eq!(shown(camera), None, "{camera} is shown under it");
        }
    }
}
