//! What `edgecap run` is told.

use std::path::PathBuf;

use crate::commands::apart::Apart;
use crate::commands::bridges::BridgeArgs;
use crate::commands::infer::{EngineArgs, InferTask, PaceArgs};
use crate::commands::input::{InputArgs, NamedInput};
use crate::commands::outputs::RecordArgs;
use crate::commands::say;
use crate::commands::settings::{ConfigArgs, FittingArgs, MetricsArgs, MultiviewArgs};
use crate::commands::table::TableArgs;
use crate::commands::tally::Tally;
use crate::counted::counted;

/// Options of `edgecap run`. Without a place for a file's bodies they go to edgecap-out/<name>.bodies.jsonl.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct RunArgs {
    #[command(flatten)]
    pub settings: ConfigArgs,
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    #[command(flatten)]
    pub pace: PaceArgs,
    #[command(flatten)]
    pub fitting: FittingArgs,
    #[command(flatten)]
    pub record: RecordArgs,
    /// Write pictures with the fitted skeletons drawn to this folder, or a film where it ends in .avi (files only)
    #[arg(long, value_name = "DIR|FILM.avi")]
    pub overlay: Option<PathBuf>,
    /// Write the bodies as a file of another program, too, as 'edgecap export' does: .bvh, .glb, .trc, .csv, .npz or
    /// .svg (files only); may be given several times
    #[arg(long, value_name = "FILE")]
    pub export: Vec<PathBuf>,
    /// End where the camera is missing or in use at the start, instead of waiting for it
    #[arg(long)]
    pub no_wait: bool,
    /// Publish what the camera sees, made small, and show it on the page (--view, 'edgecap view --show-picture').
    /// Otherwise no picture leaves the process that sees it
    #[arg(long)]
    pub show_picture: bool,
    #[command(flatten)]
    pub metrics: MetricsArgs,
    #[command(flatten)]
    pub bridges: BridgeArgs,
    #[command(flatten)]
    pub multiview: MultiviewArgs,
    #[command(flatten)]
    pub table: TableArgs,
}

impl RunArgs {
    /// Nothing but settings.
    pub fn of_settings(settings: ConfigArgs) -> Self {
        Self {
            settings,
            ..Self::default()
        }
    }

    /// What it reads and writes; of settings the files as they were named.
    pub fn apart(&self) -> Apart {
        Apart::default()
            .reads_input(&self.input)
            .may_read("--model", self.engine.model.as_deref())
            .may_read("--stage2", self.engine.stage2.as_deref())
            .may_read("--config", self.settings.config.as_deref())
            .reads_setting("--fit-config", self.fitting.fit.as_ref())
            .reads_setting("--events", self.fitting.events.as_ref())
            .reads_calibration(self.multiview.calibration.as_deref())
            .writes_records(&self.record)
            .may_write("--overlay", self.overlay.as_deref())
            .writes_exports(&self.export)
    }

    pub(super) fn infer_task(&self, chosen: &NamedInput) -> InferTask {
        InferTask {
            input: self.input.resolved(chosen),
            engine: self.engine.clone(),
            waits: !self.no_wait,
            show_picture: self.show_picture,
            pace: self.pace.clone(),
            cameras: self.engine.cameras,
        }
    }

    /// Says what there is now.
    pub(super) fn conclude(&self, tally: &Tally, words: &[String]) {
        let done = format!(
            "{}, {}",
            counted(tally.frames, "frame", "frames"),
            counted(tally.people, "person", "people")
        );
        let say = if self.record.takes_stdout() {
            say::err
        } else {
            say::out
        };
        say(&say::concluded(&done, words));
    }
}
