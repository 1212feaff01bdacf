//! What `edgecap run` is told.

use std::path::PathBuf;

use super::{ConfigArgs, FittingArgs, MetricsArgs, MultiviewArgs};
use crate::commands::apart::Apart;
use crate::commands::bridges::BridgeArgs;
use crate::commands::infer::{EngineArgs, PaceArgs};
use crate::commands::input::InputArgs;
use crate::commands::outputs::RecordArgs;
use crate::commands::table::TableArgs;

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
}
