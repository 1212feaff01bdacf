//! `edgecap replay`: publishes a record as if its camera ran again, at the times at which it was published. Several are
//! played on one clock: what their cameras saw at one instant has one time again.

mod clock;
mod head;
mod records;
mod take;
mod target;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use std::{fs, io, thread};

use self::head::{Head, detached};
use self::take::Take;
use super::exit::Failure;
use super::input::DEFAULT_NAME;
use super::stop::Stop;
use crate::config::Setting;
use crate::counted::counted;
use crate::events::EventConfig;
use crate::record::{Kind, expect_no_folder};

/// Options of `edgecap replay`.
#[derive(Debug, clap::Args)]
pub struct ReplayArgs {
    /// A record of bodies or observations, of 'record', 'run --record' or '--jsonl'; or several, of the cameras of one
    /// room: their times of capture stay
    #[arg(value_name = "FILE", required = true)]
    records: Vec<PathBuf>,
    /// Name under which it is published; of several records one each, in their order
    #[arg(long = "name", visible_alias = "camera", value_name = "NAME", default_value = DEFAULT_NAME)]
    names: Vec<String>,
    /// So many times as fast
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = parse_speed)]
    speed: f64,
    /// What counts as an event, and zones of the floor (TOML); of a record of bodies
    #[arg(long, value_name = "FILE")]
    events: Option<Setting<EventConfig>>,
    /// Over and over, until stopped; one record alone
    #[arg(long = "loop")]
    again: bool,
}

fn parse_speed(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(speed) if (0.01..=100.0).contains(&speed) => Ok(speed),
        _ => Err(format!("'{text}': expected a factor from 0.01 to 100")),
    }
}

/// Publishes the records until their ends, or until the user stops it.
///
/// # Errors
/// Records that cannot be read or hold nothing, names that are taken, and shared memory that fails.
pub fn replay(args: ReplayArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let (records, names) = (args.records.len(), args.names.len());
    if records != names {
        return Err(Failure::usage(format!(
            "expected a --name for each of {}, found {}; give as many",
            counted(records as u64, "record", "records"),
            counted(names as u64, "name", "names"),
        ))
        .into());
    }
    let is_again = |(k, name): &(usize, &String)| args.names[..*k].contains(name);
    if let Some((_, name)) = args.names.iter().enumerate().find(is_again) {
        return Err(Failure::usage(format!(
            "--name {name}: expected a name for each record, found it given twice; only one record can have it",
        ))
        .into());
    }
    if records > 1 && args.again {
        return Err(Failure::usage("--loop plays one record: give one, or leave it out").into());
    }
    for record in &args.records {
        let no_input = |e: io::Error| Failure::no_input(record, &e);
        let found = fs::metadata(record).map_err(no_input)?;
        expect_no_folder(&found).map_err(no_input)?;
        if !found.is_file() {
            return Err(Failure::usage(format!(
                "{}: expected a file, which is read from its start more than once, found something else; \
                 write what a pipe brings to a file first",
                record.display()
            ))
            .into());
        }
    }
    let are_together = records > 1;
    let heads = args.records.iter().map(|r| Head::read(r, are_together));
    let heads: Vec<Head> = heads.collect::<Result<_, _>>()?;
    let seen = args.records.iter().zip(&heads);
    let mut seen = seen.filter(|(_, head)| head.kind == Some(Kind::Observations));
    if let (Some(_), Some((record, _))) = (&args.events, seen.next()) {
        return Err(Failure::usage(format!(
            "{}: --events looks at bodies, found observations; give the zones to 'edgecap fit --events', which makes \
             bodies of them",
            record.display()
        ))
        .into());
    }
    let firsts = heads.iter().filter_map(|head| head.first);
    let together = firsts.min().filter(|_| are_together);
    if are_together {
        let ends =
            |n: usize, time: u64| heads[n].ends_before(&args.records[n], time, || stop.requested());
        for (record, seconds) in detached(&heads, ends) {
            tracing::warn!(
                "{}: begins {seconds:.0} s after the first record, when those before it have ended; where that is of \
                 another clock, replay it alone",
                args.records[record].display()
            );
        }
    }
    let (began, has_failed) = (Instant::now(), AtomicBool::new(false));
    let takes = args.records.iter().zip(&args.names).zip(heads);
    let takes = takes.map(|((record, name), head)| Take {
        args: &args,
        record,
        name,
        step: head.step,
        about: head.about,
        stop: &stop,
        has_failed: &has_failed,
        began,
        together,
    });
    thread::scope(|scope| {
        let playing = takes.map(|take| {
            let play = move || {
                let played = take.publish();
                // Of a room that lacks a camera the others are no replay.
                take.has_failed.fetch_or(played.is_err(), Ordering::Relaxed);
                played
            };
            let started = thread::Builder::new()
                .name("take".into())
                .spawn_scoped(scope, play);
            // Nor of one for which the system has no thread.
            has_failed.fetch_or(started.is_err(), Ordering::Relaxed);
            started
        });
        let playing: Vec<_> = playing.collect();
        let ends = playing.into_iter().map(|started| -> anyhow::Result<()> {
            let thread = started.map_err(|e| Failure::no_thread("for each record", &e))?;
            thread
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        });
        let ends: Vec<_> = ends.collect();
        ends.into_iter().collect()
    })
}
