//! `edgecap record`: writes what a running camera publishes to a file, until the user stops it or a film ends.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, ObservationFrame};
use edgecap_client::{Message, Subscriber};

use super::exit::Failure;
use super::input::DEFAULT_NAME;
use super::say;
use super::stop::Stop;
use crate::counted::counted;
use crate::output;
use crate::record::{BodiesRow, Format, GrowingRecord, ObservationsRow, Row, Times};
use crate::sink::SinkError;

/// How long to wait for a message before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);
/// How long an ended film may take to begin anew: a process that is started again ends its stream, too.
const COMES_BACK: Duration = Duration::from_secs(3);

/// Options of `edgecap record`.
#[derive(Debug, clap::Args)]
pub struct RecordVerb {
    /// The file to write, JSON lines where it ends in .jsonl, else binary; it must not be there yet. Whatever ends the
    /// recording, it plays to its last whole frame
    #[arg(value_name = "FILE")]
    to: PathBuf,
    /// The camera: the --name of the run that publishes
    #[arg(long = "camera", visible_alias = "name", value_name = "NAME", default_value = DEFAULT_NAME)]
    camera: String,
    /// Record observations, from which 'fit' makes bodies, instead of bodies
    #[arg(long)]
    observations: bool,
    /// Stop so long after the start of this command, whether or not somebody published
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(1..))]
    seconds: Option<u32>,
}

/// Records; waits where nobody publishes yet.
///
/// # Errors
/// Names that cannot be, files that cannot be written, and shared memory that fails. What was recorded before is kept.
pub fn record(args: RecordVerb) -> anyhow::Result<()> {
    if args.observations {
        run::<ObservationsRow, ObservationFrame>(&args)
    } else {
        run::<BodiesRow, BodyFrame>(&args)
    }
}

fn run<T: Row<Message = M>, M: Message + Times>(args: &RecordVerb) -> anyhow::Result<()> {
    if output::is_stdout(&args.to) {
        return Err(Failure::usage(
            "a record grows under its name: expected that of a file, found standard output; \
             'edgecap record hall.jsonl' and 'tail -f hall.jsonl' show it on the way",
        )
        .into());
    }
    let stop = Stop::on_signals()?;
    let stream = Subscriber::<M>::open(&args.camera)?;
    let mut file = create::<T>(&args.to)?;
    say::err(&format!(
        "recording {} (Ctrl-C stops)",
        edgecap_client::service_name::<M>(&args.camera)
    ));
    let taken = take(args, &stop, &stream, &mut file);
    let frames = file.frames();
    if frames == 0 {
        file.give_up();
        taken?;
        return Err(Failure::unavailable(format!(
            "{}: nobody published, nothing was recorded; 'edgecap status' says which cameras run",
            edgecap_client::service_name::<M>(&args.camera)
        ))
        .into());
    }
    taken?;
    let bytes = file.bytes();
    let finished = file.finish().and_then(|is_there| match is_there {
        true => Ok(()),
        false => Err(std::io::Error::other(
            "somebody removed, moved or cut the record",
        )),
    });
    finished.map_err(|cause| SinkError::Write {
        path: args.to.clone(),
        cause,
    })?;
    say::out(&format!(
        "{}, {:.1} MB → {}",
        counted(frames, "frame", "frames"),
        bytes as f64 / 1e6,
        args.to.display()
    ));
    Ok(())
}

/// Takes frames until the user stops it, a film ends, or the time is over. A camera that ends is waited for.
fn take<T: Row<Message = M>, M: Message + Times>(
    args: &RecordVerb,
    stop: &Stop,
    stream: &Subscriber<M>,
    file: &mut GrowingRecord<T>,
) -> anyhow::Result<()> {
    let (mut ended, mut end) = (None, None::<Box<M>>);
    let began = Instant::now();
    let is_over =
        |since: Option<Instant>, limit| since.is_some_and(|t: Instant| t.elapsed() >= limit);
    let limit = args.seconds.map(|s| Duration::from_secs(s.into()));
    // A frame from before the recording; that a film has ended is still so.
    if stream
        .next(Duration::ZERO)?
        .is_some_and(|f| f.is_film_end())
    {
        ended = Some(began);
    }
    while !stop.requested() && !is_over(ended, COMES_BACK) {
        if limit.is_some_and(|limit| began.elapsed() >= limit) {
            break;
        }
        if let Some(frame) = stream.next(LOOK_UP)? {
            if frame.is_end() {
                ended = frame.is_film_end().then(Instant::now);
                if ended.is_none() {
                    let synced = file.sync();
                    synced.map_err(|cause| SinkError::Write {
                        path: args.to.clone(),
                        cause,
                    })?;
                    say::err(
                        "the camera has ended; the record goes on when it is back (Ctrl-C stops)",
                    );
                }
                end = (T::HAS_IDS && file.frames() > 0).then(|| Box::new(*frame));
                continue;
            }
            ended = None;
            // Numbers and times need not show that another publisher's frames follow.
            let written = match end.take() {
                Some(end) => file.write_end(&end, &args.camera),
                None => Ok(()),
            };
            let written = written.and_then(|()| file.write(&frame, &args.camera));
            written.map_err(|cause| SinkError::Write {
                path: args.to.clone(),
                cause,
            })?;
        }
    }
    Ok(())
}

fn create<T: Row>(path: &Path) -> anyhow::Result<GrowingRecord<T>> {
    let format = match path.extension() {
        Some(e) if e == "jsonl" => Format::Jsonl,
        _ => Format::Binary,
    };
    GrowingRecord::create(path, format).map_err(|e| match e.kind() {
        ErrorKind::AlreadyExists => {
            let message = format!(
                "{}: there is a file already; choose another name",
                path.display()
            );
            Failure::exists(message).into()
        }
        _ => Failure::output(path, &e).into(),
    })
}
