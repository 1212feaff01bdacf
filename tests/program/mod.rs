//! Running the built program and looking at its processes.
#![allow(dead_code, reason = "every test file uses its own part")]

pub mod browser;
pub mod looking;
pub mod place;
mod script;
pub mod stand_in;
pub mod tools;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Output, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use rustix::fs::OFlags;
use rustix::process::{Pid, Signal, kill_process};

#[allow(unused_imports, reason = "every test file uses its own part")]
pub use script::script;

/// The built program.
pub fn edgecap() -> Command {
    command_of(env!("CARGO_BIN_EXE_edgecap").as_ref())
}

/// A program that behaves alike on every machine.
fn command_of(program: &OsStr) -> Command {
    let mut command = Command::new(program);
    command
        .stdin(Stdio::null())
        .env_remove("EDGECAP_LOG")
        .env("XDG_CONFIG_HOME", empty_settings());
    command
}

/// The program as another than root, who may pass to a copy of it in this folder; only root becomes another.
pub fn as_stranger(folder: &Path) -> Command {
    let open = std::fs::Permissions::from_mode(0o755);
    std::fs::set_permissions(folder, open).expect("a folder of the test's own");
    let program = folder.join("edgecap");
    if !program.exists() {
        // By a child: what this process holds open for writing cannot be run while a neighbour's fork holds it, too.
        let mut copy = Command::new("cp");
        copy.arg(env!("CARGO_BIN_EXE_edgecap")).arg(&program);
        assert!(copy.status().expect("cp").success(), "room for the program");
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755))
            .expect("a file of the test's own");
    }
    let mut command = Command::new("setpriv");
    command
        .args(["--reuid=54321", "--regid=54321", "--clear-groups"])
        .arg(program);
    command
}

/// A folder of settings that say nothing. Whoever tests may have some; where they have none, the machine's would hold.
fn empty_settings() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("empty-settings");
    let file = folder.join("edgecap/edgecap.toml");
    std::fs::create_dir_all(folder.join("edgecap")).expect("target takes folders");
    std::fs::write(file, "").expect("target takes files");
    folder
}

/// A folder for shared memory, whose path may have few characters: it is short, whatever TMPDIR says.
pub fn short_folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/tmp").expect("/tmp takes folders")
}

/// Runs it to its end.
pub fn output(args: &[&str]) -> Output {
    edgecap().args(args).output().expect("the program starts")
}

/// A stream name that no other test uses. One test may ask for it again; each has a thread of its own.
pub fn stream(test: &str) -> String {
    static OWNERS: Mutex<BTreeMap<String, Option<String>>> = Mutex::new(BTreeMap::new());
    let this = std::thread::current().name().map(ToOwned::to_owned);
    let mut owners = OWNERS.lock().expect("nobody panics with it");
    let owner = owners
        .entry(test.to_owned())
        .or_insert(this.clone())
        .clone();
    drop(owners);
    assert_eq!(this, owner, "'{test}' is the name of another test's stream");
    format!("test-{test}-{}", std::process::id())
}

/// The program's own lines on stderr.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// What it wrote to standard output.
pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// How many people `infer` finds in a photo.
pub fn people_in(photo: &str, options: &[&str]) -> usize {
    let infer = ["infer", "--input", photo, "--jsonl", "/dev/stdout"];
    let run = output(&[&infer[..], options].concat());
    assert!(run.status.success(), "{}", stderr(&run));
    let row: serde_json::Value = serde_json::from_str(stdout(&run).trim()).unwrap();
    row["people"].as_array().unwrap().len()
}

/// Asserts one clear line and the exit code.
pub fn assert_fails(args: &[&str], code: i32, words: &[&str]) {
    let out = output(args);
    let err = stderr(&out);
    assert_eq!(out.status.code(), Some(code), "{args:?}: {err}");
    let lines: Vec<&str> = err.lines().filter(|l| l.starts_with("edgecap: ")).collect();
    assert_eq!(lines.len(), 1, "{args:?} should say one line, said: {err}");
    for word in words {
        assert!(
            lines[0].contains(word),
            "{args:?}: '{word}' is missing in: {}",
            lines[0]
        );
    }
}

/// A child process that is killed when the test ends early.
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
        if let Some(stderr) = self.0.stderr.take().filter(|_| std::thread::panicking()) {
            eprintln!("what it said: {}", lines_so_far(stderr));
        }
    }
}

/// What lies in a pipe that others may still hold open.
fn lines_so_far(mut pipe: ChildStderr) -> String {
    let mut said = Vec::new();
    read_so_far(&mut pipe, &mut said);
    String::from_utf8_lossy(&said).into_owned()
}

/// Adds what lies in a pipe; whether that was the end of it.
fn read_so_far(pipe: &mut ChildStderr, said: &mut Vec<u8>) -> bool {
    // Not to be waited for: reading ends with an error where nothing more lies there.
    let flags = rustix::fs::fcntl_getfl(&*pipe).expect("a pipe has flags");
    let _ = rustix::fs::fcntl_setfl(&*pipe, flags | OFlags::NONBLOCK);
    let is_end = pipe.read_to_end(said).is_ok();
    let _ = rustix::fs::fcntl_setfl(&*pipe, flags);
    is_end
}

impl Running {
    /// Starts the program.
    pub fn start(args: &[&str]) -> Self {
        Self(
            edgecap()
                .args(args)
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .expect("the program starts"),
        )
    }

    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.0.id()
    }

    /// Whether it has ended.
    pub fn has_ended(&self) -> bool {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.pid()));
        // A zombie, until it is waited for.
        stat.is_ok_and(|s| {
            s.rsplit(')')
                .next()
                .is_some_and(|s| s.trim_start().starts_with('Z'))
        })
    }

    /// Waits until it has said `words` on stderr; the line that holds them.
    pub fn says(&mut self, words: &str) -> String {
        let pipe = self.0.stderr.as_mut().expect("piped");
        let mut said = Vec::new();
        eventually(words, || {
            let has_ended = read_so_far(pipe, &mut said);
            let text = String::from_utf8_lossy(&said);
            let mut whole = text.split_inclusive('\n').filter(|l| l.ends_with('\n'));
            let line = whole.find(|l| l.contains(words)).map(ToOwned::to_owned);
            assert!(line.is_some() || !has_ended, "no '{words}' in: {text}");
            line
        })
    }

    /// Waits for its end.
    pub fn wait(mut self, patience: Duration) -> Output {
        let start = Instant::now();
        while self.0.try_wait().expect("its state").is_none() {
            assert!(
                start.elapsed() < patience,
                "still running after {patience:?}"
            );
            std::thread::sleep(Duration::from_millis(20));
        }
        let status = self.0.wait().expect("its status");
        let mut out = Output {
            status,
            stdout: Vec::new(),
            stderr: Vec::new(),
        };
        use std::io::Read;
        self.0
            .stdout
            .take()
            .expect("piped")
            .read_to_end(&mut out.stdout)
            .expect("stdout");
        self.0
            .stderr
            .take()
            .expect("piped")
            .read_to_end(&mut out.stderr)
            .expect("stderr");
        out
    }

    /// The process of `verb` below it, once there is one.
    pub fn child(&self, verb: &str) -> Option<u32> {
        // Each camera of a run has a thread, which has the children.
        let threads = std::fs::read_dir(format!("/proc/{}/task", self.pid())).ok()?;
        let of_thread = |t: std::fs::DirEntry| std::fs::read_to_string(t.path().join("children"));
        let children: String = threads
            .flatten()
            .filter_map(|t| of_thread(t).ok())
            .collect();
        children
            .split_whitespace()
            .filter_map(|p| p.parse().ok())
            .find(|&p| verb_of(p).as_deref() == Some(verb))
    }
}

fn verb_of(pid: u32) -> Option<String> {
    let line = std::fs::read(PathBuf::from(format!("/proc/{pid}/cmdline"))).ok()?;
    line.split(|&b| b == 0)
        .nth(1)
        .map(|v| String::from_utf8_lossy(v).into_owned())
}

/// Waits until `found` finds something.
pub fn eventually<T>(what: &str, mut found: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(t) = found() {
            return t;
        }
        assert!(
            start.elapsed() < Duration::from_secs(120),
            "waited in vain for {what}"
        );
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Sends a signal by name, at once: on a busy machine a program that sends it would come late.
pub fn signal(pid: u32, name: &str) {
    let signal = match name {
        "CONT" => Signal::CONT,
        "HUP" => Signal::HUP,
        "INT" => Signal::INT,
        "KILL" => Signal::KILL,
        "STOP" => Signal::STOP,
        "TERM" => Signal::TERM,
        "USR1" => Signal::USR1,
        other => panic!("no signal of these tests: {other}"),
    };
    let process = Pid::from_raw(pid.cast_signed()).expect("the number of a process");
    kill_process(process, signal).expect("the process is there");
    if name == "STOP" {
        // Until the first of its threads has heard of it the others go on.
        eventually("its standstill", || stands_still(pid).then_some(()));
    }
}

/// Whether no thread of a process can run, or it has gone.
fn stands_still(pid: u32) -> bool {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task"));
    let threads = threads.into_iter().flatten().flatten();
    let mut stats = threads.filter_map(|t| std::fs::read_to_string(t.path().join("stat")).ok());
    let is_still = |stat: String| {
        let state = stat.rsplit(')').next().unwrap_or_default();
        state.trim_start().starts_with(['T', 'Z', 'X'])
    };
    stats.all(is_still)
}

/// Waits until a process ends in its own way where it is asked to; before that the signal itself would end it.
pub fn ends_when_asked(pid: u32) {
    const TERM: u64 = 1 << (15 - 1);
    eventually("its own end at SIGTERM", || {
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let caught = status.lines().find_map(|l| l.strip_prefix("SigCgt:"))?;
        let caught = u64::from_str_radix(caught.trim(), 16).ok()?;
        (caught & TERM != 0).then_some(())
    });
}

/// The end of a named pipe to write to, once somebody reads from it; to open it would wait for ever for one who never
/// does.
pub fn pipe_to_reader(path: &Path) -> File {
    let mut options = File::options();
    options
        .write(true)
        .custom_flags(OFlags::NONBLOCK.bits().cast_signed());
    let pipe = eventually("who reads the pipe", || options.open(path).ok());
    let flags = rustix::fs::fcntl_getfl(&pipe).expect("a pipe has flags");
    rustix::fs::fcntl_setfl(&pipe, flags - OFlags::NONBLOCK).expect("it takes them");
    pipe
}
