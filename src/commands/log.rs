//! What is logged, and for whom: lines for a person, or records for the journal, which has its own clock and wants to
//! know how serious a line is.

use std::fmt;
use std::io::{self, IsTerminal};
use std::os::unix::fs::MetadataExt;
use std::sync::OnceLock;

use tracing::{Event, Level, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

use super::stderr::Stderr;

/// Who logs, where several processes write into one journal.
static NAME: OnceLock<String> = OnceLock::new();

/// Starts logging on stderr.
pub fn start() {
    // A journal is read when something went wrong: then it should say when the camera went and came back.
    let by_default = if to_journal() { "info" } else { "warn" };
    // A picture without a board is told by 'calibrate' in its own words.
    let by_default = format!("{by_default},calib_targets_charuco=error");
    let filter = EnvFilter::try_from_env("EDGECAP_LOG").unwrap_or_else(|_| by_default.into());
    let log = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(Stderr::new)
        // Colours are noise in a file.
        .with_ansi(io::stderr().is_terminal())
        .with_target(false)
        // Where stderr cannot be written, saying so there would end the program.
        .log_internal_errors(false);
    if to_journal() {
        log.event_format(Journal).init();
    } else {
        log.init();
    }
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
    ) -> fmt::Result {
        let mut words = String::new();
        context.format_fields(Writer::new(&mut words), event)?;
        writeln!(to, "{}", record(*event.metadata().level(), &words))
    }
}
