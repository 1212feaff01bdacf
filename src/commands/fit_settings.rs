//! What the fit goes by: settings given, those of a file, or the usual ones.

use std::path::Path;

use serde::Deserialize;

use crate::bounded;
use crate::commands::exit::Failure;
use crate::config::{Mistake, Setting, Table};
use crate::fit::{FitConfig, Fitter};

/// A fitter with these settings, or those of a file.
///
/// # Errors
/// If the file is wrong.
pub fn fitter(config: Option<&Setting<FitConfig>>, stills: bool) -> anyhow::Result<Fitter> {
    let mut config = self::config(config)?;
    config.stills |= stills;
    Ok(Fitter::new(config).map_err(|e| Failure::config(e.to_string()))?)
}

/// These settings, or those of a file, or the usual ones.
///
/// # Errors
/// If the file is wrong.
pub fn config(config: Option<&Setting<FitConfig>>) -> anyhow::Result<FitConfig> {
    match config {
        None => Ok(FitConfig::default()),
        Some(Setting::Given(config)) => Ok(config.clone()),
        Some(Setting::File(path)) => read_config(path),
    }
}

/// A file that holds the settings below their header, as `edgecap.toml` does.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Section {
    fit: FitConfig,
}

/// Reads a file of settings, with the header `[fit]` or without.
///
/// # Errors
/// If it cannot be read, or what is wrong with it, and where.
pub fn read_config(path: &Path) -> anyhow::Result<FitConfig> {
    let text = bounded::read_text(path, bounded::SETTINGS).map_err(|e| {
        Failure::config(format!(
            "cannot read {}: {e}; expected settings of the fit (TOML)",
            path.display()
        ))
    })?;
    let file = path.display().to_string();
    let has_header = toml::from_str::<toml::Table>(&text).is_ok_and(|t| t.contains_key("fit"));
    let config = match has_header {
        true => toml::from_str::<Section>(&text).map(|section| section.fit),
        false => toml::from_str(&text),
    };
    let config: FitConfig = config.map_err(|e| Mistake::refused(&file, &text, &e))?;
    config.check().map_err(|e| {
        let places = Table::parse(&file, &text).map(|t| t.places());
        let places = places.unwrap_or_default();
        let place = |f: &str| match has_header {
            true => places.get(format!("fit.{f}").as_str()).copied(),
            false => places.get(f).copied(),
        };
        Mistake {
            place: e.field().and_then(place),
            what: e.to_string(),
            file,
        }
    })?;
    Ok(config)
}
