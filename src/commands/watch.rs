//! `edgecap watch`: shows what a camera's processes publish, without touching them.

use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM};
use edgecap_client::{Subscriber, service_name};

use super::input::DEFAULT_NAME;
use super::say;
use super::stop::Stop;
use super::table::{Table, TableArgs};
use super::tally::Tally;

/// How long to wait for a message before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);
/// How long nothing may come before the user is told.
const QUIET: Duration = Duration::from_secs(3);

/// Options of `edgecap watch`.
#[derive(Debug, clap::Args)]
pub struct WatchArgs {
    /// The camera: the --name of the run that publishes
    #[arg(long, visible_alias = "camera", value_name = "NAME", default_value = DEFAULT_NAME)]
    name: String,
    #[command(flatten)]
    table: TableArgs,
}

/// Shows bodies until the user stops it or the input ends; waits where nobody publishes yet.
///
/// # Errors
/// Names that cannot be, and shared memory that fails.
pub fn watch(args: WatchArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let bodies = Subscriber::<BodyFrame>::open(&args.name)?;
    let mut table = Table::new(args.table);
    table.say(&format!(
        "watching shared memory {} (Ctrl-C stops)",
        service_name::<BodyFrame>(&args.name)
    ));
    let (mut last, mut told) = (Instant::now(), false);
    let mut tally = Tally::default();
    while !stop.requested() {
        if let Some(frame) = bodies.next(LOOK_UP)? {
            if frame.flags & FLAG_END_OF_STREAM != 0 {
                table.finish();
                say::out("the input has ended");
                return Ok(());
            }
            tally.count(&frame);
            table.update(&frame, tally.left_out);
            (last, told) = (Instant::now(), false);
        } else if last.elapsed() > QUIET && !told {
            let why = if bodies.publisher_count() == 0 {
                "nobody publishes there yet: start 'edgecap run', with the same --name; 'edgecap doctor' says where it looks"
            } else {
                "connected, but no frames come: is the camera there?"
            };
            table.say(why);
            told = true;
        }
    }
    table.finish();
    Ok(())
}
