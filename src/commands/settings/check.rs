//! Values that have the right type and yet cannot be.

use std::collections::BTreeMap;
use std::error::Error;
use std::ffi::OsStr;

use clap::error::{ContextKind, ContextValue};
use serde_json::Value;

use super::FittingArgs;
use crate::config::{Mistake, Place, Section, Setting, Table};
use crate::fit::FitConfig;

/// Holds every value against what the flag of the same name takes.
///
/// # Errors
/// The first that the flag would refuse, or that is no finite number.
pub fn ranges<T: Section + clap::Args>(
    table: &Table<'_>,
    places: &BTreeMap<String, Place>,
    section: &T,
) -> Result<(), Mistake> {
    let command = T::augment_args(clap::Command::new("edgecap").no_binary_name(true));
    let Ok(Value::Object(fields)) = serde_json::to_value(section) else {
        return Ok(());
    };
    for (key, value) in fields {
        let text = match value {
            Value::String(text) => text,
            Value::Number(number) => number.to_string(),
            // TOML has no null: it was a number that JSON cannot hold.
            Value::Null if places.contains_key(&key) => {
                let what = format!("{key}: expected a finite number, found nan or inf");
                return Err(table.mistake(places.get(&key).copied(), what));
            }
            _ => continue,
        };
        if let Some(why) = refusal(&command, &key, &text) {
            return Err(table.mistake(places.get(&key).copied(), why));
        }
    }
    Ok(())
}

/// Takes a section out of a table; a whole number that its type cannot hold is told as the flag of the same name does.
///
/// # Errors
/// As [`Table::take`].
pub fn take<T: Section + clap::Args>(table: &mut Table<'_>) -> Result<T, Mistake> {
    let numbers = table.integers();
    table.take().map_err(|mistake| {
        let command = T::augment_args(clap::Command::new("edgecap").no_binary_name(true));
        let mut found = numbers
            .iter()
            .filter(|(_, at, _)| Some(*at) == mistake.place);
        match found.find_map(|(key, _, text)| refusal(&command, key, text)) {
            Some(what) => Mistake { what, ..mistake },
            None => mistake,
        }
    })
}

/// Why the flag of this key refuses a value, if there is such a flag and it does.
fn refusal(command: &clap::Command, key: &str, text: &str) -> Option<String> {
    let flag = command.get_arguments().find(|a| a.get_id() == key)?;
    if !flag.get_action().takes_values() {
        return None;
    }
    let typed = [format!("--{}={text}", flag.get_long()?)];
    let e = command.clone().try_get_matches_from(typed).err()?;
    let why = match (e.source(), e.get(ContextKind::ValidValue)) {
        (Some(why), _) => why.to_string(),
        // What clap says itself is several lines, and about a flag.
        (None, Some(ContextValue::Strings(known))) => {
            format!("expected one of {}, found {text}", known.join(", "))
        }
        (None, _) => format!("found {text}, which it cannot be"),
    };
    Some(format!("{key}: {why}"))
}

/// Names of files and devices.
///
/// # Errors
/// The first that names nothing.
pub fn names<'a>(
    table: &Table<'_>,
    places: &BTreeMap<String, Place>,
    given: impl IntoIterator<Item = (&'a str, Option<&'a OsStr>)>,
) -> Result<(), Mistake> {
    let empty = given
        .into_iter()
        .find(|(_, n)| n.is_some_and(OsStr::is_empty));
    empty.map_or(Ok(()), |(key, _)| {
        let what = format!("{key}: expected a name, found none: leave the line out");
        Err(table.mistake(places.get(key).copied(), what))
    })
}

/// Numbers of the fit, whose keys stand below `path`.
///
/// # Errors
/// The first that is out of its range.
pub fn fit(
    table: &Table<'_>,
    places: &BTreeMap<String, Place>,
    path: &str,
    config: &FitConfig,
) -> Result<(), Mistake> {
    config.check().map_err(|e| {
        let at = e.field().and_then(|f| places.get(&format!("{path}{f}")));
        table.mistake(at.copied(), e.to_string())
    })
}

/// The fit as a camera has it.
///
/// # Errors
/// As [`fit`].
pub fn fitting(
    table: &Table<'_>,
    places: &BTreeMap<String, Place>,
    fitting: &FittingArgs,
) -> Result<(), Mistake> {
    if let Some(Setting::Given(config)) = &fitting.fit {
        fit(table, places, "fit.", config)?;
    }
    if let Some(Setting::Given(events)) = &fitting.events
        && let Some(mistake) = events.mistake()
    {
        let what = format!("events: {mistake}");
        return Err(table.mistake(places.get("events").copied(), what));
    }
    let known = FitConfig {
        height: fitting.height,
        ground: fitting.floor,
        ..FitConfig::default()
    };
    known.check().map_err(|e| {
        let key = match e.field() {
            Some("height") => "height",
            _ => "floor",
        };
        table.mistake(places.get(key).copied(), e.to_string())
    })
}
