//! `edgecap status`: which cameras run on this machine, and how they are doing.
//!
//! Every run of cameras keeps a file in the runtime folder, renewed once a second: to read it takes no answer from a
//! process that may hang.

use std::fs::{self, OpenOptions};
use std::io::Read;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use edgecap_client::message::{BodyFrame, ObservationFrame};
use edgecap_client::{Message, Subscriber, place};
use serde::{Deserialize, Serialize};

use super::closed;
use super::exit::Failure;
use super::say;
use crate::counted::counted;
use crate::metrics::{Meter, Snapshot};

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
    pid: u32,
    /// Of the process, in the kernel's ticks: another process may get the same number later.
    started: u64,
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
            let pid = std::process::id();
            let path = place::runtime_dir().join(format!("status-{pid}.json"));
            let started = started(pid).unwrap_or(0);
            remove_dead(&place::runtime_dir());
            loop {
                let status = Status {
                    pid,
                    started,
                    build: crate::BUILD.to_owned(),
                    written: now(),
                    cameras: meters.iter().map(|m| m.snapshot()).collect(),
                };
                // The folder is there once the first stream is.
                if path.parent().is_some_and(Path::is_dir)
                    && let Ok(text) = serde_json::to_vec(&status)
                    && let Err(e) = crate::output::write(&path, &text)
                {
                    tracing::debug!("{}: {e}", path.display());
                }
                if end.recv_timeout(RENEW_EVERY) != Err(std::sync::mpsc::RecvTimeoutError::Timeout)
                {
                    break;
                }
            }
            let _ = fs::remove_file(path);
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
                "{:9} {name}: {kind} are published, not by 'run'",
                "ok"
            ))?;
        }
        for status in &all {
            for camera in &status.cameras {
                say::whole(&line(status, camera))?;
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
fn published<M: Message>() -> Vec<String> {
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

    fn is_healthy(&self) -> bool {
        self.cameras.iter().all(|c| c.healthy && !self.hangs(c))
    }
}

fn line(status: &Status, camera: &Snapshot) -> String {
    let state = if status.hangs(camera) {
        "HANGS"
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
    let mut all: Vec<Status> = folders()
        .iter()
        .filter_map(|folder| fs::read_dir(folder).ok())
        .flatten()
        .flatten()
        .filter_map(|entry| read(&entry.path()))
        .filter(|status| started(status.pid) == Some(status.started))
        .collect();
    all.sort_by_key(|s| (s.cameras.first().map(|c| c.name.clone()), s.pid));
    all.dedup_by_key(|s| s.pid);
    all
}

/// Removes the files of runs that were killed.
fn remove_dead(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if read(&path).is_some_and(|status| started(status.pid) != Some(status.started)) {
            let _ = fs::remove_file(path);
        }
    }
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
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK)
        .open(path)
        .ok()?;
    if !file.metadata().ok()?.is_file() {
        return None;
    }
    let mut text = Vec::new();
    file.take(MOST_BYTES).read_to_end(&mut text).ok()?;
    serde_json::from_slice(&text).ok()
}

/// When a process was started, in ticks since the machine was.
fn started(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name before may hold anything; the field is the 22nd, and the third follows the name.
    let fields = stat.rsplit(')').next()?;
    fields.split_whitespace().nth(19)?.parse().ok()
}

fn now() -> f64 {
    SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .map_or(0.0, |t| t.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_killed_runs_are_removed_and_no_others() {
        let folder = tempfile::tempdir().unwrap();
        let pid = std::process::id();
        let mut status = Status {
            pid,
            started: started(pid).unwrap(),
            build: String::new(),
            written: 0.0,
            cameras: Vec::new(),
        };
        let [alive, dead, other] =
            ["status-1.json", "status-2.json", "other.json"].map(|name| folder.path().join(name));
        fs::write(&alive, serde_json::to_vec(&status).unwrap()).unwrap();
        status.started += 1;
        fs::write(&dead, serde_json::to_vec(&status).unwrap()).unwrap();
        fs::write(&other, "{}").unwrap();
        remove_dead(folder.path());
        assert!(alive.exists() && other.exists());
        assert!(!dead.exists());
    }
}
