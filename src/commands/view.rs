//! `edgecap view`: shows what running cameras publish on a page, and hands it on over WebSocket.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM};
use edgecap_client::{Priority, Subscriber, cameras};

use super::exit::Failure;
use super::relay::{EventRelay, PictureRelay};
use super::say;
use super::serve::{PageArgs, PageServer, Past};
use super::stop::Stop;
use crate::bridge::websocket::Hub;
use crate::record::{BodiesRow, RowReader, Times};

/// How long to wait for a message before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);
/// How often new cameras are looked for.
const DISCOVER_EVERY: Duration = Duration::from_millis(500);
const CLEAN_UP_EVERY: Duration = Duration::from_secs(10);

/// Options of `edgecap view`.
#[derive(Debug, clap::Args)]
pub struct ViewArgs {
    /// Show this camera only, the --name of a run; may be given several times [default: every camera that runs]
    #[arg(long = "camera", visible_alias = "name", value_name = "NAME")]
    cameras: Vec<String>,
    /// Show a record of bodies instead, to go through from its first frame to its last
    #[arg(long, value_name = "RECORD", conflicts_with_all = ["cameras", "show_picture"])]
    record: Option<PathBuf>,
    /// Show what the cameras see, too, of runs with --show-picture
    #[arg(long)]
    show_picture: bool,
    #[command(flatten)]
    page: PageArgs,
}

/// Serves the page until the user stops it. Cameras may come and go meanwhile.
///
/// # Errors
/// Names that cannot be, an address that is taken, and shared memory that fails.
pub fn view(args: ViewArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    for name in &args.cameras {
        Subscriber::<BodyFrame>::open(name)?;
    }
    if let Some(path) = &args.record {
        return recorded(path, &args.page, &stop);
    }
    let past = Past::LastMinute;
    let server = PageServer::start("--listen", &args.page, past, args.show_picture)?;
    say::out(&format!("{} (Ctrl-C stops)", server.url()));
    let mut followed: BTreeMap<String, JoinHandle<anyhow::Result<()>>> = BTreeMap::new();
    let mut told = false;
    while !stop.requested() {
        let names = if args.cameras.is_empty() {
            cameras::<BodyFrame>()
        } else {
            args.cameras.clone()
        };
        if names.is_empty() && !told {
            say::err(
                "nobody publishes yet: start 'edgecap'; 'edgecap doctor' says where this looks",
            );
            told = true;
        }
        for name in names {
            if let Entry::Vacant(place) = followed.entry(name) {
                let (hub, stop, camera) = (server.hub().clone(), stop.clone(), place.key().clone());
                let thread = std::thread::Builder::new().name("camera".into());
                place.insert(thread.spawn(move || follow(&camera, &hub, &stop))?);
            }
        }
        let ended = followed.iter().find(|(_, t)| t.is_finished());
        if let Some(name) = ended.map(|(name, _)| name.clone())
            && let Some(thread) = followed.remove(&name)
        {
            joined(thread)?;
        }
        std::thread::sleep(DISCOVER_EVERY);
    }
    followed.into_values().try_for_each(joined)
}

/// Shows a record until the user stops it.
fn recorded(path: &Path, page: &PageArgs, stop: &Stop) -> anyhow::Result<()> {
    let name = path.display().to_string();
    let file = File::open(path).map_err(|e| Failure::no_input(path, &e))?;
    let mut rows = RowReader::<_, BodiesRow>::new(BufReader::new(file), &name);
    let camera = path.file_stem().unwrap_or_default().to_string_lossy();
    let server = PageServer::start("--listen", page, Past::Record, false)?;
    let (mut frames, mut last) = (0_u64, 0);
    while let Some(row) = rows.read()? {
        let mut frame = row.message();
        // The page goes by when frames were published; a record's own times may say nothing, or begin again.
        frame.publish_ns = frame.due_ns().max(last + 1);
        last = frame.publish_ns;
        server.hub().publish(&camera, &frame);
        frames += 1;
    }
    if frames == 0 {
        return Err(Failure::no_frames(&name, "bodies").into());
    }
    if rows.was_cut() {
        tracing::warn!("{name}: cut off inside a frame; the frames before it are shown");
    }
    let every = server.hub().kept_every();
    if every > 1 {
        say::err(&format!(
            "{name}: more than the page can hold; one frame of {every} is shown, from the first of {frames} to the last"
        ));
    }
    say::out(&format!("{} (Ctrl-C stops)", server.url()));
    while !stop.requested() {
        std::thread::sleep(LOOK_UP);
    }
    Ok(())
}

fn joined(thread: JoinHandle<anyhow::Result<()>>) -> anyhow::Result<()> {
    thread
        .join()
        .unwrap_or_else(|_| Err(Failure::unavailable("a camera's thread ended").into()))
}

/// Hands on a camera's frames until the user stops it; the same camera may end and come back.
fn follow(camera: &str, hub: &Hub, stop: &Stop) -> anyhow::Result<()> {
    let bodies = Subscriber::<BodyFrame>::open(camera)?;
    let mut events = EventRelay::to_page(camera, hub)?;
    let pictures = PictureRelay::to_page(camera, camera, Some(hub), Priority::Reader)?;
    let mut told = false;
    let mut cleaned = Instant::now();
    while !stop.requested() {
        // Every frame belongs into the last minute, not the newest only.
        if let Some(frame) = bodies.next(LOOK_UP)? {
            hub.publish(camera, &frame);
            if frame.flags & FLAG_END_OF_STREAM != 0 {
                tracing::info!("{camera}: the input has ended");
            }
        }
        events.look()?;
        if let Some(pictures) = &pictures {
            pictures.look()?;
            if !told && bodies.publisher_count() > 0 && pictures.is_missing() {
                tracing::warn!("{camera} publishes no pictures: 'edgecap run --show-picture' does");
                told = true;
            }
        }
        if cleaned.elapsed() > CLEAN_UP_EVERY {
            bodies.clean_up();
            cleaned = Instant::now();
        }
    }
    Ok(())
}
