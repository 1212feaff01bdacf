//! What is logged, and for whom: lines for a person, or records for the journal, which has its own clock and wants to
//! know how serious a line is.

use std::io::{self, IsTerminal};
use std::os::unix::fs::MetadataExt;
use std::sync::OnceLock;

use tracing::{Event, Level, Subscriber};
use tracing_subscriber::filter::{ParseError, Targets};
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{self, FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::layer::{Layer, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt;

use super::stderr::Stderr;

/// Who logs, where several processes write into one journal.
static NAME: OnceLock<String> = OnceLock::new();

/// Starts logging on stderr.
pub fn start() {
    // A journal is read when something went wrong: then it should say when the camera went and came back.
    let by_default = if to_journal() {
        Level::INFO
    } else {
        Level::WARN
    };
    let wanted = std::env::var_os("EDGECAP_LOG").unwrap_or_default();
    let words = wanted.to_str().ok_or_else(|| "not in UTF-8".to_owned());
    let (chosen, misread) = match words.and_then(|words| chosen(words, by_default)) {
        Ok(chosen) => (chosen, None),
        Err(e) => (of_default(by_default), Some(e)),
    };
    let log = fmt::layer()
        .with_writer(Stderr::new)
        // Colours are noise in a file.
        .with_ansi(io::stderr().is_terminal())
        .with_target(false)
        // Where stderr cannot be written, saying so there would end the program.
        .log_internal_errors(false);
    let log = if to_journal() {
        log.event_format(Journal).boxed()
    } else {
        log.boxed()
    };
    tracing_subscriber::registry().with(chosen).with(log).init();
    if let Some(e) = misread {
        tracing::warn!(
            "EDGECAP_LOG={}: {e}; expected error, warn, info, debug, trace or off; goes on without it",
            wanted.display()
        );
    }
}

/// What is logged where nobody says how much.
fn of_default(level: Level) -> Targets {
    Targets::new()
        .with_default(level)
        // A picture without a board is told by 'calibrate' in its own words.
        .with_target("calib_targets_charuco", Level::ERROR)
}

/// What `wanted` lets through: a level, or levels of parts of the program (`warn,edgecap::capture=debug`). Parts alone,
/// or a level that does not exist, which reads like a part's name, leave the others as they are by default.
fn chosen(wanted: &str, by_default: Level) -> Result<Targets, String> {
    // Nothing between two commas would be read as the level of errors, and so would nothing behind a part.
    let parts = wanted.split(',').map(str::trim).filter(|p| !p.is_empty());
    let wanted = parts.collect::<Vec<_>>().join(",");
    if wanted.is_empty() {
        return Ok(of_default(by_default));
    }
    if let Some(part) = wanted.split(',').find(|part| part.ends_with('=')) {
        return Err(format!("'{part}' has no level"));
    }
    let asked: Targets = wanted.parse().map_err(|e: ParseError| e.to_string())?;
    Ok(match asked.default_level() {
        Some(_) => asked,
        None => of_default(by_default).with_targets(asked),
    })
}

/// Names this process in the journal.
pub fn name(name: String) {
    // Whoever came first stays.
    let _ = NAME.set(name);
}

/// Whether stderr is the journal itself, not a file or terminal that a process below a service writes to.
pub fn to_journal() -> bool {
    static JOURNAL: OnceLock<bool> = OnceLock::new();
    *JOURNAL.get_or_init(|| {
        let named = std::env::var("JOURNAL_STREAM").ok();
        let found = std::fs::metadata("/proc/self/fd/2").ok();
        matches!((named, found), (Some(named), Some(m)) if named == format!("{}:{}", m.dev(), m.ino()))
    })
}

/// How syslog numbers a level.
fn priority(level: Level) -> u8 {
    match level {
        Level::ERROR => 3,
        Level::WARN => 4,
        Level::INFO => 6,
        _ => 7,
    }
}

/// A line of words as the journal takes it.
pub fn record(level: Level, words: &str) -> String {
    let name = NAME.get().map_or(String::new(), |name| format!("{name}: "));
    // Every line would be a record of its own, all but the first without its priority.
    let words = words.trim_end().replace('\n', " ");
    format!("<{}>{name}{words}", priority(level))
}

/// Records for the journal.
struct Journal;

impl<S, N> FormatEvent<S, N> for Journal
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut to: Writer<'_>,
        event: &Event<'_>,
    ) -> std::fmt::Result {
        let mut words = String::new();
        context.format_fields(Writer::new(&mut words), event)?;
        writeln!(to, "{}", record(*event.metadata().level(), &words))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lets_through(wanted: &str, target: &str, level: Level) -> bool {
        chosen(wanted, Level::WARN)
            .unwrap()
            .would_enable(target, &level)
    }

    #[test]
    fn a_level_is_of_everything_and_a_part_of_itself_alone() {
        assert!(lets_through("", "edgecap::capture", Level::WARN));
        assert!(!lets_through("", "edgecap::capture", Level::INFO));
        assert!(!lets_through("", "calib_targets_charuco", Level::WARN));
        assert!(lets_through("debug", "edgecap::capture", Level::DEBUG));
        assert!(!lets_through("off", "edgecap::capture", Level::ERROR));
        let part = "edgecap::capture=debug";
        assert!(lets_through(part, "edgecap::capture", Level::DEBUG));
        assert!(!lets_through(part, "edgecap::fit", Level::INFO));
        assert!(lets_through(part, "edgecap::fit", Level::WARN));
        assert!(!lets_through(part, "calib_targets_charuco", Level::WARN));
    }

    #[test]
    fn a_comma_too_many_silences_nothing() {
        for wanted in ["info,", ",info", "info, ,"] {
            assert!(
                lets_through(wanted, "edgecap::capture", Level::INFO),
                "{wanted}"
            );
        }
        assert!(lets_through(",", "edgecap::capture", Level::WARN));
    }

    #[test]
    fn a_level_that_does_not_exist_silences_nothing() {
        assert!(lets_through("inof", "edgecap::capture", Level::WARN));
        assert!(chosen("edgecap=inof", Level::WARN).is_err());
        for wanted in ["edgecap=", "info, edgecap= ,warn"] {
            let told = chosen(wanted, Level::WARN).unwrap_err();
            assert!(told.contains("'edgecap=' has no level"), "{told}");
        }
    }
}
