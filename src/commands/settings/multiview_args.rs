//! Whether several cameras see the same people.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::commands::input::path_in_words;

/// Options of cameras that see the same people.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MultiviewArgs {
    /// All cameras see the same people, and this is their calibration, in which they have the same names: one body a
    /// person comes of all of them
    #[arg(long, value_name = "FILE", value_parser = path_in_words())]
    pub calibration: Option<PathBuf>,
    /// Name under which these bodies are published [default: room]
    #[arg(long, value_name = "NAME")]
    pub room: Option<String>,
}
