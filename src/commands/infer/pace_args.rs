//! How fast pictures may come, as the user says it.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::commands::exit::Failure;
use crate::commands::input::NamedInput;
use crate::schedule::pace::Limits;

/// Options of the pace, shared by the verbs that run the network on a camera.
#[derive(Debug, Clone, Default, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PaceArgs {
    /// Look at no more pictures of a camera than these, per second; the others are not even decoded
    #[arg(long, value_name = "FPS", value_parser = parse_rate)]
    pub max_fps: Option<f64>,
    /// Look at every picture of a camera also while nobody is in view [default: three a second, and all again within
    /// 0.4 s of somebody entering]
    #[arg(long)]
    pub no_idle: bool,
}

fn parse_rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(fps) if (0.1..=1000.0).contains(&fps) => Ok(fps),
        _ => Err(format!(
            "'{text}': expected pictures per second, such as 15"
        )),
    }
}

impl PaceArgs {
    /// How far apart pictures are wanted; nothing where as many as come are.
    pub fn interval(&self) -> Duration {
        self.max_fps
            .map_or(Duration::ZERO, |fps| Duration::from_secs_f64(1.0 / fps))
    }

    /// The limits for this input; all its pictures are wanted where they are `drawn_on`.
    ///
    /// # Errors
    /// For a rate that a file, of which no picture is left out, cannot have.
    pub fn limits(&self, chosen: &NamedInput, drawn_on: bool) -> anyhow::Result<Limits> {
        if self.max_fps.is_some() && !chosen.is_live() {
            return Err(Failure::usage(
                "--max-fps leaves pictures of a camera out: expected a camera or --live, found a file, of which none is left out",
            )
            .into());
        }
        Ok(Limits {
            interval_ns: self.interval().as_nanos() as u64,
            never_idle: self.no_idle || drawn_on,
        })
    }
}
