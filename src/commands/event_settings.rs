//! What counts as an event: settings given, those of a file, or the usual ones.

use std::path::Path;

use super::exit::Failure;
use crate::bounded;
use crate::config::{Mistake, Setting};
use crate::events::EventConfig;

/// These settings, or those of a file, or the usual ones.
///
/// # Errors
/// If the file cannot be read, or what is wrong with them.
pub fn config(setting: Option<&Setting<EventConfig>>) -> anyhow::Result<EventConfig> {
    match setting {
        None => Ok(EventConfig::default()),
        Some(Setting::Given(config)) => match config.mistake() {
            Some(mistake) => Err(Failure::config(format!("events: {mistake}")).into()),
            None => Ok(config.clone()),
        },
        Some(Setting::File(path)) => read(path),
    }
}

/// Reads a file of settings.
///
/// # Errors
/// If it cannot be read, or what is wrong with it.
pub fn read(path: &Path) -> anyhow::Result<EventConfig> {
    let name = path.display().to_string();
    let text = bounded::read_text(path, bounded::SETTINGS).map_err(|e| {
        Failure::config(format!(
            "cannot read {name}: {e}; expected settings of events (--events; --settings of 'edgecap events'), check the path"
        ))
    })?;
    let config: EventConfig =
        toml::from_str(&text).map_err(|e| Mistake::refused(&name, &text, &e))?;
    match config.mistake() {
        Some(mistake) => Err(Failure::config(format!("{name}: {mistake}")).into()),
        None => Ok(config),
    }
}
