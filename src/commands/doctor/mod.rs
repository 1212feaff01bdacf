//! `edgecap doctor`: what of this machine works, and what to do about the rest.

mod beyond;
mod finding;
mod memory;
mod patience;
mod pictures;
mod service;
mod speed;

use std::path::PathBuf;
use std::time::Duration;

use edgecap_client::place;

use super::exit::{self, Failure};
use super::fit::ROOM;
use super::input::DEFAULT_NAME;
use super::say;
use super::settings::{self, ConfigArgs, RunArgs, Settings};
use super::status;
pub use beyond::held_back;
use finding::{Finding, State};
pub use memory::is_check;
use patience::{Unanswered, attempt, unanswered, within};

/// How long a check may take.
const LIMIT: Duration = Duration::from_secs(10);
/// How long reading settings may take.
const FILE_LIMIT: Duration = Duration::from_secs(5);
/// How long a camera may take: to open one takes seconds, its first picture as many.
const CAMERA_LIMIT: Duration = Duration::from_secs(20);
/// How long speed may take, and a model that is named: a slow machine packs it first.
const SPEED_LIMIT: Duration = Duration::from_secs(120);

const SETTINGS: &str = "settings";

/// Options of `edgecap doctor`.
#[derive(Debug, clap::Args)]
pub struct DoctorArgs {
    #[command(flatten)]
    settings: ConfigArgs,
    /// Threads for the network; those of the settings, else all cores when not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
    /// Look as the user that the service is, with the machine's settings: what that one may not do is broken (as root)
    #[arg(long)]
    as_service: bool,
    /// Clear what earlier runs left in shared memory, if nobody alive uses it
    #[arg(long, conflicts_with = "as_service")]
    repair: bool,
}

/// Looks at everything that a run needs; prints each finding as soon as it is known. Ends whatever hangs.
///
/// # Errors
/// The exit code of the first thing that is broken.
pub fn doctor(args: DoctorArgs) -> anyhow::Result<()> {
    if args.repair {
        return repair();
    }
    if args.as_service {
        return Err(service::become_service(&args.settings, args.threads));
    }
    let mut broken = None;
    let mut say = |finding: Finding| -> anyhow::Result<()> {
        say::whole(&finding.to_string())?;
        if let State::Broken(code) = finding.state {
            broken = broken.or(Some(code));
        }
        Ok(())
    };
    say(Finding::new("build", State::Fine, crate::BUILD))?;
    say(within(speed::PROCESSOR, LIMIT, speed::processor))?;
    let Settled {
        finding,
        file,
        runs,
        reads,
        same_people,
    } = settled(args.settings);
    say(finding)?;
    for finding in held_back(file.as_deref(), &runs, &reads) {
        say(finding)?;
    }
    let mut engine = runs[0].engine.clone();
    engine.threads = args.threads.or(engine.threads);
    say(within(speed::SPEED, SPEED_LIMIT, move || {
        speed::speed(&engine)
    }))?;
    say(within(memory::MEMORY, LIMIT, memory::shared_memory))?;
    for run in &runs {
        let input = run.input.clone();
        say(within(pictures::CAMERA, CAMERA_LIMIT, move || {
            pictures::camera(&input)
        }))?;
    }
    say(within(pictures::FILMS, 2 * LIMIT, pictures::films))?;
    let names = names(&runs, same_people);
    say(within(memory::RUNNING, LIMIT, move || {
        memory::running(&names)
    }))?;
    match broken {
        Some(code) => Err(Failure::silent(code).into()),
        None => Ok(()),
    }
}

/// The settings.
struct Settled {
    finding: Finding,
    file: Option<PathBuf>,
    /// What a run takes with them: never nothing.
    runs: Vec<RunArgs>,
    /// What it reads of what they name, by key.
    reads: Vec<(&'static str, PathBuf)>,
    /// Whether they are fitted together.
    same_people: bool,
}

impl Settled {
    fn without(finding: Finding) -> Self {
        Self {
            finding,
            file: None,
            runs: vec![RunArgs::default()],
            reads: Vec::new(),
            same_people: false,
        }
    }
}

/// The names under which these runs publish bodies: one for all cameras that see the `same_people`.
fn names(runs: &[RunArgs], same_people: bool) -> Vec<String> {
    if let (true, [first, ..]) = (same_people, runs) {
        let room = first.multiview.room.as_deref();
        return vec![room.unwrap_or(ROOM).to_owned()];
    }
    let name = |run: &RunArgs| run.input.name.clone();
    runs.iter()
        .map(|r| name(r).unwrap_or_else(|| DEFAULT_NAME.into()))
        .collect()
}

fn settled(args: ConfigArgs) -> Settled {
    let read = move || -> anyhow::Result<_> {
        let settings = Settings::load(&args)?;
        let effective = settings::effective(&RunArgs::of_settings(args), &settings)?;
        effective.check()?;
        let same_people = effective.calibration()?.is_some();
        let (runs, reads) = (effective.runs()?, effective.reads());
        Ok((settings.file, effective, runs, reads, same_people))
    };
    let no_answer = |why| match why {
        // A mistake of the file, or of one that it names.
        Unanswered::Hangs => Finding::new(SETTINGS, State::Broken(exit::CONFIG), HANGS),
        why => unanswered(SETTINGS, why, HANGS),
    };
    let (file, effective, runs, reads, same_people) = match attempt(FILE_LIMIT, read) {
        Ok(Ok(read)) => read,
        Ok(Err(e)) => return Settled::without(Finding::failed(SETTINGS, e)),
        Err(why) => return Settled::without(no_answer(why)),
    };
    let finding = match &file {
        Some(file) => match attempt(SPEED_LIMIT, move || effective.expect_start()) {
            Ok(Ok(())) => {
                let text = format!("{}: right; cameras: {}", file.display(), runs.len());
                Finding::new(SETTINGS, State::Fine, text)
            }
            // What the cameras show can be seen all the same.
            Ok(Err(e)) => Finding::failed(SETTINGS, e),
            Err(why) => no_answer(why),
        },
        None => {
            let text = "no edgecap.toml: defaults hold; 'edgecap config sample' is one";
            Finding::new(SETTINGS, State::Note, text)
        }
    };
    Settled {
        finding,
        file,
        runs,
        reads,
        same_people,
    }
}

/// What to say of files that cannot be read to their end.
const HANGS: &str = "reading edgecap.toml, or a file that it names, does not end: expected files, found a pipe or a folder that is away";

/// Clears what the dead left of this user's shared memory, and what they told of themselves.
fn repair() -> anyhow::Result<()> {
    let folder = place::runtime_dir();
    let alive = place::clear()?;
    status::remove_dead(&folder);
    if alive.is_empty() {
        say::out(&format!("{}: cleared; start again", folder.display()));
        return Ok(());
    }
    Err(Failure::unavailable(format!(
        "{}: what the dead left is cleared; {} in use and stayed: stop who publishes there first",
        folder.display(),
        alive.join(", ")
    ))
    .into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_that_see_the_same_people_publish_as_one() {
        let run = |name: Option<&str>, room: Option<&str>| {
            let mut run = RunArgs::default();
            run.input.name = name.map(ToOwned::to_owned);
            run.multiview.room = room.map(ToOwned::to_owned);
            run
        };
        let two = [run(Some("left"), None), run(Some("right"), None)];
        assert_eq!(names(&two, false), ["left", "right"]);
        assert_eq!(names(&two, true), [ROOM]);
        assert_eq!(names(&[run(Some("left"), Some("hall"))], true), ["hall"]);
        assert_eq!(names(&[run(None, None)], false), [DEFAULT_NAME]);
    }
}
