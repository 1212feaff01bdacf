//! `edgecap status`: which cameras run on this machine, and how they are doing.
//!
//! Every run of cameras keeps a file in the runtime folder, renewed once a second: to read it takes no answer from a
//! process that may hang. That the run lives is proved by a lock on a second file: process numbers say nothing of a
//! container's run, nor where they are hidden.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, Read};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use edgecap_client::message::{BodyFrame, ObservationFrame};
use edgecap_client::{Message, Subscriber, place};
use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

use super::closed;
use super::exit::Failure;
use super::health::health_of;
use super::say;
use crate::counted::counted;
use crate::metrics::{Meter, Snapshot};
use crate::supervise::permissions;

const RENEW_EVERY: Duration = Duration::from_secs(1);
/// A file that is older belongs to a supervisor that hangs.
const STALE: f64 = 5.0;
/// A longer file is none of ours.
const MOST_BYTES: u64 = 1 << 20;

/// Options of `edgecap status`.
#[derive(Debug, clap::Args)]
pub struct StatusArgs {
    /// As JSON, for programs
    #[arg(long)]
    json: bool,
}

/// What a run says of itself.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Status {
    /// As the run itself knows it: a container has numbers of its own.
    pid: u32,
    build: String,
    /// Seconds since 1970.
    written: f64,
    cameras: Vec<Snapshot>,
}

/// The file of this process, renewed until this is dropped.
#[derive(Debug)]
pub struct StatusFile {
    ends: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl StatusFile {
    /// Keeps it. Where it cannot be written nobody is told, and the run goes on.
    pub fn keep(meters: Vec<Arc<Meter>>) -> Self {
        let (ends, end) = channel();
        let keep = move || {
            let folder = place::runtime_dir();
            remove_dead(&folder);
            let mut life: Option<NamedTempFile> = None;
            loop {
                if life.as_ref().is_none_or(is_removed) {
                    // The folder is there once the first stream is.
                    life = sign_of_life(&folder).ok();
                }
                if let Some(life) = &life {
                    let status = Status {
                        pid: std::process::id(),
                        build: crate::BUILD.to_owned(),
                        written: now(),
                        cameras: meters.iter().map(|m| m.snapshot()).collect(),
                    };
                    let path = status_of(life.path());
                    if let Ok(text) = serde_json::to_vec(&status)
                        && let Err(e) = renew(&path, &text)
                    {
                        tracing::debug!("{}: {e}", path.display());
                    }
                }
                if end.recv_timeout(RENEW_EVERY) != Err(std::sync::mpsc::RecvTimeoutError::Timeout)
                {
                    break;
                }
            }
            if let Some(life) = life {
                let _ = fs::remove_file(status_of(life.path()));
            }
        };
        Self {
            ends: Some(ends),
            thread: std::thread::Builder::new()
                .name("status".into())
                .spawn(keep)
                .ok(),
        }
    }
}

impl Drop for StatusFile {
    fn drop(&mut self) {
        drop(self.ends.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Says what runs.
///
/// # Errors
/// Exit code 69 where nothing runs, 77 where something may run that this user may not see, 75 where something does and
/// no bodies come.
pub fn status(args: StatusArgs) -> anyhow::Result<()> {
    let all = running();
    let others = others(&all);
    if args.json {
        let mut told = serde_json::to_value(&all)?;
        if let (Some(runs), false) = (told.as_array_mut(), others.is_empty()) {
            runs.push(serde_json::json!({ "cameras": [], "streams": others }));
        }
        say::whole(&serde_json::to_string_pretty(&told)?)?;
    } else {
        for Stream { name, kind } in &others {
            say::whole(&format!(
                "{:9} {name}: {kind} are published, but not by a run of cameras",
                "ok"
            ))?;
        }
        for status in &all {
            for camera in &status.cameras {
                let mut line = line(status, camera);
                if !status.does_well(camera) {
                    line += &said_by_itself(camera);
                }
                say::whole(&line)?;
            }
        }
    }
    if all.is_empty() && others.is_empty() {
        if let Some(advice) = closed::advice() {
            return Err(Failure::permission(format!(
                "no camera runs here that this user may see; {advice}"
            ))
            .into());
        }
        let why = "no camera runs here that this user may see: 'edgecap' starts one, 'edgecap doctor' says what is missing";
        return Err(Failure::unavailable(why).into());
    }
    if all.iter().any(|s| !s.is_healthy()) {
        return Err(Failure::silent(super::exit::TRY_LATER).into());
    }
    Ok(())
}

/// What another verb publishes: `infer`, `fit`, `replay`, or `run` of a file.
#[derive(Debug, PartialEq, Eq, Serialize)]
struct Stream {
    name: String,
    kind: &'static str,
}

/// Streams of which no run of cameras tells; observations only where nobody makes bodies of them.
fn others(runs: &[Status]) -> Vec<Stream> {
    let known: Vec<&str> = runs
        .iter()
        .flat_map(|run| &run.cameras)
        .map(|camera| camera.name.as_str())
        .collect();
    // One of several cameras that see the same people has no bodies of its own.
    let inputs: Vec<&str> = runs
        .iter()
        .flat_map(|run| &run.cameras)
        .flat_map(|camera| camera.input.split(", "))
        .collect();
    let bodies: Vec<String> = published::<BodyFrame>();
    let observations = published::<ObservationFrame>();
    let observations = observations
        .iter()
        .filter(|n| !bodies.contains(n) && !inputs.contains(&n.as_str()));
    let all = bodies.iter().map(|name| (name, "bodies"));
    let all = all.chain(observations.map(|name| (name, "observations")));
    all.filter(|(name, _)| !known.contains(&name.as_str()))
        .map(|(name, kind)| Stream {
            name: name.clone(),
            kind,
        })
        .collect()
}

/// Names under which somebody alive publishes.
pub(super) fn published<M: Message>() -> Vec<String> {
    let lives = |name: &String| {
        let stream = Subscriber::<M>::open(name);
        stream.is_ok_and(|s| s.publisher_count() > 0)
    };
    edgecap_client::cameras::<M>()
        .into_iter()
        .filter(lives)
        .collect()
}

impl Status {
    fn age(&self) -> f64 {
        (now() - self.written).max(0.0)
    }

    fn hangs(&self, camera: &Snapshot) -> bool {
        self.age() > STALE || camera.looked_seconds_ago.is_some_and(|s| s > STALE)
    }

    fn does_well(&self, camera: &Snapshot) -> bool {
        camera.healthy && !camera.ended && !self.hangs(camera)
    }

    fn is_healthy(&self) -> bool {
        self.cameras.iter().all(|camera| self.does_well(camera))
    }
}

fn line(status: &Status, camera: &Snapshot) -> String {
    let state = if status.hangs(camera) {
        "HANGS"
    } else if camera.ended {
        "ENDED"
    } else if camera.healthy {
        "ok"
    } else {
        "NO BODIES"
    };
    let mut line = format!(
        "{state:9} {} ({}), since {}: {:.1} fps, {}",
        camera.name,
        camera.input,
        words((now() - camera.since as f64).max(0.0)),
        camera.fps,
        counted(camera.people, "person", "people")
    );
    if let (Some(median), Some(p99)) = (camera.latency_ms, camera.latency_p99_ms) {
        line += &format!(", capture to publish {median:.0} ms (1 in 100: {p99:.0})");
    }
    let frames = counted(camera.frames, "frame", "frames");
    line += &format!(", {frames}, {} left out", camera.dropped);
    for (process, n) in camera.restarts.iter().filter(|(_, n)| *n > 0) {
        line += &format!(", {process} restarted {}", counted(*n, "time", "times"));
    }
    if camera.reconnects > 0 {
        line += &format!(
            ", camera back {}",
            counted(camera.reconnects, "time", "times")
        );
    }
    if let (Some(error), Some(at)) = (&camera.last_error, camera.last_error_at) {
        let ago = words((now() - at as f64).max(0.0));
        line += &format!("; last error, {ago} ago: {error}");
    }
    line
}

/// What a camera says of itself, or each of several that see the same people; nothing where they say nothing.
fn said_by_itself(camera: &Snapshot) -> String {
    let said = publishers(camera).into_iter().filter_map(|name| {
        let health = health_of(name)?;
        Some(format!("; {name}: {health}"))
    });
    said.collect()
}

/// Who says how this one is doing: itself, and the cameras of a room, each once.
fn publishers(camera: &Snapshot) -> Vec<&str> {
    let inputs: Vec<&str> = camera.input.split(", ").collect();
    // What one camera opens is no name of a stream.
    let of_room = if inputs.len() > 1 { &inputs[..] } else { &[] };
    let others = of_room.iter().filter(|name| **name != camera.name);
    std::iter::once(camera.name.as_str())
        .chain(others.copied())
        .collect()
}

/// A span of time, roughly.
fn words(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.0} h", s / 3600.0),
        s => format!("{:.0} days", s / 86_400.0),
    }
}

/// What this user may see, by the cameras' names.
fn running() -> Vec<Status> {
    let files = folders().into_iter().filter_map(|f| fs::read_dir(f).ok());
    let files = files.flatten().flatten();
    let alive = files.filter_map(|file| {
        let status = read(&file.path())?;
        is_alive(&file.path()).then(|| (file.file_name(), status))
    });
    let each: BTreeMap<OsString, Status> = alive.collect();
    let mut all: Vec<Status> = each.into_values().collect();
    all.sort_by_key(|s| (s.cameras.first().map(|c| c.name.clone()), s.pid));
    all
}

/// Removes the files of runs that were killed.
pub(super) fn remove_dead(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if read(&path).is_some() && !is_alive(&path) {
            let _ = fs::remove_file(&path);
            let _ = fs::remove_file(lock_of(&path));
        }
    }
}

/// A file with a name of its own that this process has locked until it drops it or dies.
fn sign_of_life(folder: &Path) -> io::Result<NamedTempFile> {
    let file = tempfile::Builder::new()
        .prefix("status-")
        .suffix(".lock")
        .tempfile_in(folder)?;
    flock(file.as_file(), FlockOperation::NonBlockingLockExclusive)?;
    // Whoever may look into the folder may try the lock.
    let readable = Permissions::from_mode(0o644);
    file.as_file().set_permissions(readable)?;
    Ok(file)
}

/// Writes a run's file, which whoever may look into the folder may read, if this process is to let others read files.
fn renew(path: &Path, text: &[u8]) -> io::Result<()> {
    crate::output::write_passing(path, text)?;
    // While a thread binds a socket of iceoryx2 files get less, and what replaces a file has its permissions.
    let mode = permissions(0o666);
    match fs::symlink_metadata(path)?.mode() & 0o777 == mode {
        true => Ok(()),
        false => fs::set_permissions(path, Permissions::from_mode(mode)),
    }
}

/// Whether somebody has cleaned the file away.
fn is_removed(file: &NamedTempFile) -> bool {
    file.as_file().metadata().is_ok_and(|m| m.nlink() == 0)
}

/// Whether the run lives that keeps this file.
fn is_alive(status: &Path) -> bool {
    open(&lock_of(status)).is_ok_and(|file| {
        let tried = flock(&file, FlockOperation::NonBlockingLockShared);
        tried == Err(rustix::io::Errno::WOULDBLOCK)
    })
}

fn lock_of(status: &Path) -> PathBuf {
    status.with_extension("lock")
}

fn status_of(lock: &Path) -> PathBuf {
    lock.with_extension("json")
}

/// Where runs that this user may see have their files.
fn folders() -> Vec<PathBuf> {
    place::reading_dirs()
}

/// A file, if it is one of ours. Whatever else lies there is not waited for.
fn read(path: &Path) -> Option<Status> {
    let name = path.file_name()?.to_str()?;
    if !name.starts_with("status-") || !name.ends_with(".json") {
        return None;
    }
    let file = open(path).ok()?;
    if !file.metadata().ok()?.is_file() {
        return None;
    }
    let mut text = Vec::new();
    file.take(MOST_BYTES).read_to_end(&mut text).ok()?;
    serde_json::from_slice(&text).ok()
}

/// Opens a file for reading; where a pipe has its name, nobody is waited for.
fn open(path: &Path) -> io::Result<File> {
    OpenOptions::new()
        .read(true)
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK)
        .open(path)
}

fn now() -> f64 {
    SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .map_or(0.0, |t| t.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(cameras: Vec<Snapshot>) -> Status {
        Status {
            // There is a process of this number, and it is no run.
            pid: 1,
            build: String::new(),
            written: now(),
            cameras,
        }
    }

    #[test]
    fn files_of_killed_runs_are_removed_and_no_others() {
        let folder = tempfile::tempdir().unwrap();
        let text = serde_json::to_vec(&status(Vec::new())).unwrap();
        let [life, end] = [(); 2].map(|()| sign_of_life(folder.path()).unwrap());
        let [alive, dead] = [&life, &end].map(|file| status_of(file.path()));
        let unlocked = folder.path().join("status-4711.json");
        let other = folder.path().join("other.json");
        for path in [&alive, &dead, &unlocked, &other] {
            fs::write(path, &text).unwrap();
        }
        assert!(is_alive(&alive) && is_alive(&dead) && !is_alive(&unlocked));
        // As a process leaves it that is killed.
        let (file, lock) = end.keep().unwrap();
        drop(file);
        remove_dead(folder.path());
        assert!(alive.exists() && life.path().exists() && other.exists());
        assert!(!dead.exists() && !lock.exists() && !unlocked.exists());
        let mode = life.as_file().metadata().unwrap().mode();
        assert_eq!(mode & 0o777, 0o644, "readers try the lock");
        assert!(!is_removed(&life));
        fs::remove_file(life.path()).unwrap();
        assert!(is_removed(&life));
    }

    #[test]
    fn a_file_that_others_could_not_read_once_they_can_read_after_the_next_write() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("status-hall.json");
        let mode = || fs::metadata(&path).unwrap().mode() & 0o777;
        renew(&path, b"{}").unwrap();
        assert_eq!(mode(), permissions(0o666));
        fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
        renew(&path, b"{}").unwrap();
        assert_eq!(mode(), permissions(0o666));
    }

    #[test]
    fn a_camera_or_a_room_and_its_cameras_say_each_once_how_they_do() {
        let of = |name, input| publishers(&Meter::new(name, input, &[]).snapshot()).join(" ");
        assert_eq!(of("hall", "camera"), "hall");
        assert_eq!(of("room", "hall, yard"), "room hall yard");
        assert_eq!(of("hall", "hall, yard"), "hall yard");
    }

    #[test]
    fn a_camera_that_has_ended_for_good_does_not_hang() {
        let meter = Meter::new("hall", "camera", &[]);
        meter.looked();
        meter.ended();
        meter.failed("no such device");
        let status = status(vec![meter.snapshot()]);
        let line = line(&status, &status.cameras[0]);
        assert!(line.starts_with("ENDED     hall (camera)"), "{line}");
        assert!(line.ends_with("ago: no such device"), "{line}");
        assert!(!status.is_healthy());
    }
}
