//! The files that a verb writes, as the user names them, and how a verb ends.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::record::{Format, Row};
use crate::sink::{RecordSink, SinkError, Sinks};

/// Options of what is recorded.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecordArgs {
    /// Write one line of JSON per frame to this file; '-' for standard output
    #[arg(long, value_name = "FILE")]
    pub jsonl: Option<PathBuf>,
    /// Write the same in binary, a third of the size; 'fit --input' and 'eval --predictions' read both
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
}

impl RecordArgs {
    /// Whether nothing is to be recorded.
    pub fn is_empty(&self) -> bool {
        self.jsonl.is_none() && self.record.is_none()
    }

    /// Whether standard output carries results, so that words have to go elsewhere.
    pub fn takes_stdout(&self) -> bool {
        let is_stdout = |p: &PathBuf| p.as_os_str() == crate::output::STDOUT;
        self.jsonl.iter().chain(&self.record).any(is_stdout)
    }

    /// Starts the records.
    ///
    /// # Errors
    /// [`SinkError::Create`].
    pub fn add_to<T: Row + 'static>(&self, sinks: &mut Sinks<T::Message>) -> Result<(), SinkError> {
        if let Some(path) = &self.jsonl {
            sinks.push(RecordSink::<T>::create(path, Format::Jsonl)?);
        }
        if let Some(path) = &self.record {
            sinks.push(RecordSink::<T>::create(path, Format::Binary)?);
        }
        Ok(())
    }
}

/// Ends a verb that has computed `frames`: what was computed is made complete, whatever went wrong, and then it is
/// said. Where nothing was computed and something went wrong, nothing is left. Returns what the sinks say.
///
/// # Errors
/// That of `outcome`, else the first of a sink.
pub fn finish<M>(
    mut sinks: Sinks<M>,
    frames: u64,
    outcome: anyhow::Result<()>,
) -> anyhow::Result<Vec<String>> {
    if frames == 0 {
        outcome?;
        let (words, finished) = sinks.finish();
        finished?;
        return Ok(words);
    }
    if outcome.is_err() {
        sinks.break_off();
    }
    let (words, finished) = sinks.finish();
    outcome?;
    finished?;
    Ok(words)
}
