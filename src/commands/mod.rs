//! One file per verb of the command line; the only place that joins stages, threads and processes.

#![deny(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "these panic where nobody listens: say::out and say::err do not"
)]

mod apart;
mod bench;
mod bridge;
mod bridges;
mod calibrate;
mod closed;
mod common_time;
mod config;
mod doctor;
mod empty;
mod eval;
mod event_settings;
mod events;
mod exit;
mod export;
mod fit;
mod fit_settings;
mod followed;
mod health;
mod infer;
mod input;
mod install;
mod job;
mod log;
mod mistyped;
mod model;
mod multiview;
mod outputs;
mod picture;
mod pipeline;
mod progress;
mod record;
mod relay;
mod replay;
mod result;
mod run;
mod say;
mod serve;
mod settings;
mod status;
mod stderr;
mod stop;
pub mod synth;
mod table;
mod taken;
mod tally;
mod threads;
mod view;
mod view_file;
mod views;
mod watch;

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::OsStrExt;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

/// Motion capture of everyone in front of ordinary cameras, on a CPU, into shared memory.
#[derive(Debug, Parser)]
#[command(
    name = "edgecap",
    version = crate::BUILD,
    about,
    args_conflicts_with_subcommands = true
)]
struct Cli {
    #[command(subcommand)]
    verb: Option<Verb>,
    #[command(flatten)]
    run: settings::RunArgs,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Start and supervise infer and fit; the default
    Run(Box<settings::RunArgs>),
    /// Show the bodies that a running camera publishes
    Watch(watch::WatchArgs),
    /// Show the bodies that running cameras publish in three dimensions on a page in the browser, and hand them on over
    /// WebSocket
    View(view::ViewArgs),
    /// Find people in pictures: a camera, a film or photos in, observations out
    Infer(infer::InferArgs),
    /// Follow people and their poses over time: observations in, bodies out
    Fit(Box<fit::FitArgs>),
    /// Say what happens in front of a camera: who enters and leaves, zones, raised and waving hands
    Events(events::EventsArgs),
    /// Hand on the bodies of a running camera as OSC, as VMC, or over WebSocket
    Bridge(bridge::BridgeVerb),
    /// Record what a running camera publishes
    Record(record::RecordVerb),
    /// Publish a record as if its camera ran again
    Replay(replay::ReplayArgs),
    /// Write recorded bodies as BVH, glTF, TRC, CSV, NumPy arrays or SVG curves
    Export(export::ExportArgs),
    /// Draw heights and angles of recorded bodies over time
    Plot(export::PlotArgs),
    /// Make bodies with shape and mesh of what several calibrated cameras saw
    Multiview(Box<multiview::MultiviewArgs>),
    /// Find where several cameras stand by people who walk before them, or lenses and places by pictures of a board
    Calibrate(calibrate::CalibrateArgs),
    /// Render synthetic people with exact truth
    Synth(synth::SynthArgs),
    /// Measure predictions against ground truth
    Eval(eval::EvalArgs),
    /// Measure the speed of this machine, of both networks and of the stages after them
    Bench(bench::BenchArgs),
    /// Check and show settings
    Config(config::ConfigVerb),
    /// Say which cameras run on this machine, and how they are doing
    Status(status::StatusArgs),
    /// Install edgecap as a service, or take it away
    Install(install::InstallArgs),
    /// Print a script that completes commands of edgecap in a shell
    Completions {
        /// The shell
        shell: install::Shell,
    },
    /// Look whether this machine has what a run needs
    Doctor(doctor::DoctorArgs),
    /// Import, inspect, verify and run models
    Model(model::ModelArgs),
}

/// Runs the command line; the exit code.
pub fn main() -> u8 {
    crate::supervise::remember_permissions();
    let words = words(std::env::args_os());
    let cli = match parse(&words) {
        Ok(cli) => cli,
        Err(e) if e.use_stderr() => {
            let told = match e.kind() {
                ErrorKind::InvalidUtf8 => other_bytes(&words),
                _ => None,
            };
            let told = told.unwrap_or_else(|| one_line(&e));
            say::failure(&format!("edgecap: {told}"));
            return exit::USAGE;
        }
        Err(help) => {
            let _ = help.print();
            return 0;
        }
    };
    log::start();
    // What shared memory has to say comes back as errors.
    iceoryx2::prelude::set_log_level(iceoryx2::prelude::LogLevel::Fatal);
    tracing::info!("edgecap {}", crate::BUILD);
    let done = match cli.verb.unwrap_or(Verb::Run(Box::new(cli.run))) {
        Verb::Run(args) => run::run(*args),
        Verb::Watch(args) => watch::watch(args),
        Verb::View(args) => view::view(args),
        Verb::Infer(args) => infer::infer(args),
        Verb::Fit(args) => fit::fit(*args),
        Verb::Events(args) => events::events(args),
        Verb::Bridge(args) => bridge::bridge(args),
        Verb::Record(args) => record::record(args),
        Verb::Replay(args) => replay::replay(args),
        Verb::Export(args) => export::export(args),
        Verb::Plot(args) => export::plot(args),
        Verb::Multiview(args) => multiview::multiview(*args),
        Verb::Calibrate(args) => calibrate::calibrate(&args),
        Verb::Synth(args) => synth::synth(args),
        Verb::Eval(args) => eval::eval(args),
        Verb::Bench(args) => bench::bench(args),
        Verb::Config(args) => config::config(args),
        Verb::Status(args) => status::status(args),
        Verb::Install(args) => install::install(args),
        Verb::Completions { shell } => install::completions(shell).and_then(|s| say::whole(&s)),
        Verb::Doctor(args) => doctor::doctor(args),
        Verb::Model(args) => model::model(args),
    };
    match done {
        Ok(()) => 0,
        Err(e) => {
            if !exit::is_silent(&e) {
                say::failure(&format!("edgecap: {}", exit::told(&e)));
            }
            exit::code(&e)
        }
    }
}

/// What the command line takes.
fn program() -> clap::Command {
    lenient(Cli::command())
}

/// The same command, whose options take a number below zero as their value: what is wrong with it is said by who knows
/// what was expected, not that there is no option `-1`.
fn lenient(command: clap::Command) -> clap::Command {
    let takes_numbers = |arg: clap::Arg| match arg.get_long() {
        Some(_) if arg.get_action().takes_values() => arg.allow_negative_numbers(true),
        _ => arg,
    };
    command.mut_args(takes_numbers).mut_subcommands(lenient)
}

/// Reads a command line.
///
/// # Errors
/// What is wrong with it, or the help that was asked for.
fn parse(words: &[OsString]) -> Result<Cli, clap::Error> {
    let mut program = program();
    let mut found = program.try_get_matches_from_mut(words)?;
    Cli::from_arg_matches_mut(&mut found).map_err(|e| e.format(&mut program))
}

/// A command line as it is meant: `help --help` asks for help, not for that about a verb of this name.
fn words(given: impl Iterator<Item = OsString>) -> Vec<OsString> {
    let mut words: Vec<OsString> = given.collect();
    if words.get(1).is_some_and(|word| word == "help") {
        words.retain(|word| word != "--help" && word != "-h");
    }
    words
}

/// What to say of a command line that is refused for a word which is not UTF-8: clap does not name it.
fn other_bytes(words: &[OsString]) -> Option<String> {
    let is_refused = |words: &[OsString]| {
        let parsed = parse(words);
        parsed.is_err_and(|e| e.kind() == ErrorKind::InvalidUtf8)
    };
    // Most paths may be of any bytes: it is the word without which all others are taken.
    let mut mended = words.to_vec();
    let at = (0..words.len()).find(|&k| {
        mended[k] = words[k].to_string_lossy().into_owned().into();
        words[k].to_str().is_none() && !is_refused(&mended)
    })?;
    let given = words[at].as_bytes();
    let option = |word: &[u8]| String::from_utf8_lossy(word).into_owned();
    let (option, given) = match given.iter().position(|&b| b == b'=') {
        Some(end) if given.starts_with(b"--") => (option(&given[..end]), &given[end + 1..]),
        _ => {
            let before = words[..at].iter().map(|word| word.as_bytes());
            let before = before.rev().find(|word| word.starts_with(b"-"));
            (option(before.unwrap_or(b"edgecap")), given)
        }
    };
    Some(input::other_bytes(
        &option,
        "text",
        OsStr::from_bytes(given),
    ))
}

/// What is wrong with a command line, without how it is used.
fn one_line(error: &clap::Error) -> String {
    let text = error.to_string();
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let told = lines.take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more"));
    let told = told.fold(String::new(), |told, line| match told.ends_with(':') {
        _ if told.is_empty() => line.to_owned(),
        // What follows is the list of what was spoken of.
        true => format!("{told} {line}"),
        false => format!("{told}; {line}"),
    });
    let told = told.strip_prefix("error: ").unwrap_or(&told);
    match mistyped::advice(error, &program()) {
        Some(advice) => format!("{told}; {advice}"),
        None => format!("{told}; --help lists what there is"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `verb` and the verbs below it, each as the words that call it.
    fn verbs(verb: &clap::Command, called: &[String]) -> Vec<(Vec<String>, clap::Command)> {
        let mut all = vec![(called.to_vec(), verb.clone())];
        for below in verb.get_subcommands() {
            let called = [called, &[below.get_name().to_owned()]].concat();
            all.extend(verbs(below, &called));
        }
        all
    }

    #[test]
    fn a_number_below_zero_is_a_value_of_the_option_before_it() {
        let mut tried = 0;
        for (called, verb) in verbs(&program(), &["edgecap".to_owned()]) {
            let options = verb.get_arguments();
            let options = options.filter(|arg| arg.get_action().takes_values());
            for option in options.filter_map(|arg| arg.get_long()) {
                let words = [&called[..], &[format!("--{option}"), "-1".to_owned()]].concat();
                let words: Vec<OsString> = words.into_iter().map(OsString::from).collect();
                if let Err(e) = parse(&words) {
                    assert_ne!(e.kind(), ErrorKind::UnknownArgument, "{words:?}: {e}");
                }
                tried += 1;
            }
        }
        assert!(tried > 100, "{tried}");
    }

    #[test]
    fn what_is_wrong_with_a_number_below_zero_is_said_by_its_option() {
        for words in [
            &["run", "--threads", "-1"][..],
            &["infer", "--looks", "-1"],
            &["run", "--max-fps", "-1"],
            &["multiview", "--fps", "-1"],
            &["doctor", "--threads", "-1"],
            &["export", "--person", "-1"],
        ] {
            let given = std::iter::once(&"edgecap").chain(words);
            let given: Vec<OsString> = given.map(OsString::from).collect();
            let told = one_line(&parse(&given).unwrap_err());
            let option = words[1];
            assert!(
                told.contains("-1") && told.contains(option),
                "{words:?}: {told}"
            );
            assert!(!told.contains("unexpected"), "{words:?}: {told}");
        }
    }
}
