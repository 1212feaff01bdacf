//! One verb of this program as a process of its own.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{self, ChildStdout, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use edgecap_client::place::{self, RUNTIME_DIR_VARIABLE};
use rustix::fs::{MemfdFlags, OFlags, fcntl_setfl, memfd_create};
use rustix::process::{Pid, Signal, kill_process};
use serde::{Deserialize, Serialize};

use super::heartbeat::Beat;
use super::left::{Left, wait};
use super::policy::{Activity, Policy, Verdict};
use super::systemd;
use super::tie::tie;

/// The program that runs, even after an update has replaced its file.
const PROGRAM: &str = "/proc/self/exe";
/// Set for a child in whose place another one has worked.
const WORKED_VARIABLE: &str = "EDGECAP_HAS_WORKED";
/// Tells a child how often it was started again.
const RESTARTS_VARIABLE: &str = "EDGECAP_RESTARTS";
/// Time to end after SIGTERM.
const GRACE: Duration = Duration::from_secs(3);
/// Time to end after SIGKILL: whoever supervises has others to look after.
const PATIENCE: Duration = Duration::from_secs(1);

/// Longest job that is an argument, bytes: Linux takes none of 128 KiB.
const LONGEST_ARGUMENT: usize = 96 << 10;
/// The argument in place of a longer job.
const BY_INPUT: &str = "-";

/// What a child is to do, handed over as one argument, where lists of processes show it; a long one by standard input.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Job<T> {
    /// The process to end with.
    pub supervisor: i32,
    /// The verb's options.
    pub options: T,
}

/// A child, started again as its policy says.
#[derive(Debug)]
pub struct Child {
    program: PathBuf,
    verb: &'static str,
    job: String,
    policy: Policy,
    process: Option<process::Child>,
    /// An earlier one that was ended and is not gone.
    left: Left,
    beats: Option<ChildStdout>,
    /// The newest kind of sign of life that came since the look before the last.
    heard: Option<Beat>,
    has_lived: bool,
    has_worked: bool,
    /// It was said that it is not started before an earlier one has ended.
    said_held: bool,
    /// Starts of the one in whose place it comes.
    before: u64,
    starts: u64,
}

impl Child {
    /// `edgecap VERB` with these options; it starts at the first [`tend`](Self::tend) and ends when this process ends.
    ///
    /// # Errors
    /// If the options cannot be written.
    pub fn new<T: Serialize>(verb: &'static str, options: T) -> io::Result<Self> {
        Ok(Self {
            program: PROGRAM.into(),
            verb,
            job: job(options)?,
            policy: Policy::new(Instant::now()),
            process: None,
            left: Left::default(),
            beats: None,
            heard: None,
            has_lived: false,
            has_worked: false,
            said_held: false,
            before: 0,
            starts: 0,
        })
    }

    /// The same in place of one that was started so often: what its processes hear of [`restarts`] goes on from there.
    #[must_use]
    pub fn after(self, starts: u64) -> Self {
        Self {
            before: starts,
            ..self
        }
    }

    /// Gives it other options, from its next start on.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn give<T: Serialize>(&mut self, options: T) -> io::Result<()> {
        self.job = job(options)?;
        Ok(())
    }

    /// Whether there is a process of it, as far as the last [`tend`](Self::tend) has seen; else the next may start one.
    pub fn is_there(&self) -> bool {
        self.process.is_some()
    }

    /// The verb of another program.
    #[cfg(test)]
    pub(crate) fn of(self, program: impl Into<PathBuf>) -> Self {
        Self {
            program: program.into(),
            ..self
        }
    }

    /// How often it was started, without the one in whose place it comes.
    pub fn starts(&self) -> u64 {
        self.starts
    }

    /// The verb.
    pub fn verb(&self) -> &'static str {
        self.verb
    }

    /// Whether it has ever shown that it works. One that has no picture yet may be about to find that it cannot.
    pub fn has_lived(&self) -> bool {
        self.has_lived
    }

    /// Whether it has ever published a result.
    pub fn has_worked(&self) -> bool {
        self.has_worked
    }

    /// The newest sign of life, if one came between the last two calls of [`tend`](Self::tend).
    pub fn heard(&self) -> Option<Beat> {
        self.heard
    }

    /// Whether an earlier process of it was killed and has not ended: it waits for a device.
    pub fn has_left_one(&self) -> bool {
        !self.left.is_empty()
    }

    /// Starts it when it is time and none that was killed is left behind, ends it when it hangs, and returns how it
    /// ended if it has since the last call: then [`restart`](Self::restart) it or leave it.
    ///
    /// # Errors
    /// If the process cannot be started or asked.
    pub fn tend(&mut self) -> io::Result<Option<ExitStatus>> {
        let now = Instant::now();
        self.heard = None;
        self.left.look();
        if let Some(beat) = self.newest_beat() {
            self.policy.beat(now, beat);
            self.heard = Some(beat);
        }
        if let Some(process) = &mut self.process
            && let Some(ended) = process.try_wait()?
        {
            self.process = None;
            return Ok(Some(ended));
        }
        let pid = self.process.as_ref().map(process::Child::id);
        let activity = || pid.map_or(Activity::Busy, activity);
        match self.policy.look(now, activity) {
            Verdict::Wait => {}
            // It holds its stream and its camera: another would fail of that.
            Verdict::Start if self.has_left_one() => {
                if !std::mem::replace(&mut self.said_held, true) {
                    tracing::warn!(
                        "{} is not started again before the one left behind ends; unplug the camera",
                        self.verb
                    );
                }
            }
            Verdict::Start => {
                self.said_held = false;
                // One that could not be started is one that died: the next try waits.
                self.policy.started(now);
                self.start()?;
            }
            Verdict::Kill => self.replace("hangs"),
        }
        Ok(None)
    }

    /// Ends it by force, to start again, for a reason: what it does, as in "hangs".
    pub fn replace(&mut self, why: &str) {
        if let Some(process) = self.process.take() {
            tracing::warn!("{} {why}; it is ended and started again", self.verb);
            self.left.kill(process, PATIENCE);
            self.policy.restart(Instant::now());
        }
    }

    /// Lets it start again after a pause.
    pub fn restart(&mut self) {
        self.policy.restart(Instant::now());
    }

    /// Leaves it ended.
    pub fn leave(&mut self) {
        self.policy.ended();
    }

    fn start(&mut self) -> io::Result<()> {
        self.starts += 1;
        let (job, input) = hand_over(&self.job)?;
        let mut command = Command::new(&self.program);
        command
            .arg0(std::env::args_os().next().unwrap_or_default())
            .args([self.verb, "--job", job])
            // Whatever sessions begin or end meanwhile.
            .env(RUNTIME_DIR_VARIABLE, place::runtime_dir())
            .env(
                RESTARTS_VARIABLE,
                (self.before + self.starts - 1).to_string(),
            )
            .stdin(input)
            .stdout(Stdio::piped());
        for variable in systemd::VARIABLES {
            command.env_remove(variable);
        }
        match self.has_worked {
            true => command.env(WORKED_VARIABLE, "1"),
            false => command.env_remove(WORKED_VARIABLE),
        };
        tie(&mut command);
        let mut process = command.spawn()?;
        self.beats = process.stdout.take();
        self.process = Some(process);
        if let Some(beats) = &self.beats {
            fcntl_setfl(beats, OFlags::NONBLOCK)?;
        }
        Ok(())
    }

    /// The newest sign of life since the last call.
    fn newest_beat(&mut self) -> Option<Beat> {
        let mut some = [0; 4096];
        let n = self.beats.as_mut()?.read(&mut some).ok()?;
        let mut newest = None;
        for beat in some[..n].iter().filter_map(|byte| Beat::of(*byte)) {
            // Others may follow a result at once.
            self.has_lived |= beat != Beat::Waiting;
            self.has_worked |= beat == Beat::Step;
            newest = Some(beat);
        }
        newest
    }

    fn terminate(&self) {
        if let Some(process) = &self.process
            && let Some(pid) = Pid::from_raw(process.id().cast_signed())
        {
            // It may have ended meanwhile; then there is nobody to tell. One that was stopped must go on to hear it.
            let _ = kill_process(pid, Signal::TERM);
            let _ = kill_process(pid, Signal::CONT);
        }
    }

    fn reap(&mut self, until: Instant) {
        if let Some(process) = self.process.take()
            && let Some(process) = wait(process, until)
        {
            self.left.kill(process, PATIENCE);
        }
        self.policy.ended();
    }
}

/// The job of a child of this process.
fn job<T: Serialize>(options: T) -> io::Result<String> {
    let supervisor = process::id().cast_signed();
    Ok(serde_json::to_string(&Job {
        supervisor,
        options,
    })?)
}

/// The argument and the standard input of a child with this job.
fn hand_over(job: &str) -> io::Result<(&str, Stdio)> {
    if job.len() <= LONGEST_ARGUMENT {
        return Ok((job, Stdio::null()));
    }
    let mut file = File::from(memfd_create("job", MemfdFlags::CLOEXEC)?);
    file.write_all(job.as_bytes())?;
    file.rewind()?;
    Ok((BY_INPUT, file.into()))
}

/// The job that this process has with this argument.
///
/// # Errors
/// Those of standard input, where it comes by that.
pub fn handed_over(argument: &str) -> io::Result<Cow<'_, str>> {
    match argument {
        BY_INPUT => io::read_to_string(io::stdin()).map(Cow::Owned),
        job => Ok(job.into()),
    }
}

/// Whether this process takes the place of one that worked, with the same options and under the same supervisor: where
/// its input does not suit them, that may pass.
pub fn has_worked_before() -> bool {
    std::env::var_os(WORKED_VARIABLE).is_some()
}

/// How often this process's supervisor has started one like it before; 0 without a supervisor.
pub fn restarts() -> u32 {
    let told = std::env::var(RESTARTS_VARIABLE);
    told.ok().and_then(|n| n.parse().ok()).unwrap_or(0)
}

/// Ends all of them: politely, then by force.
pub fn stop_all(children: &mut [&mut Child]) {
    for child in children.iter() {
        child.terminate();
    }
    let until = Instant::now() + GRACE;
    for child in children.iter_mut() {
        child.reap(until);
    }
}

/// What the threads of a process do at this moment.
fn activity(pid: u32) -> Activity {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task"));
    let states: Vec<u8> = threads
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|thread| state(&std::fs::read(thread.path().join("stat")).ok()?))
        .collect();
    match &states[..] {
        // Nothing can be learnt of it.
        [] => Activity::Busy,
        all if all.iter().all(|s| *s == b'T') => Activity::Stopped,
        all if all.iter().all(|s| *s == b'S') => Activity::Still,
        _ => Activity::Busy,
    }
}

/// The letter behind the name, which may hold any character, in a line of `/proc/<pid>/stat`.
fn state(stat: &[u8]) -> Option<u8> {
    let name_ends = stat.iter().rposition(|&b| b == b')')?;
    stat.get(name_ends + 2).copied()
}

/// How a process ended, in words.
pub fn describe(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit code {code}"),
        (None, Some(signal)) => format!("signal {signal}"),
        (None, None) => "an unknown cause".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::left::tests::one_left;
    use super::*;

    /// No program can be started with an argument of 128 KiB.
    #[test]
    fn a_job_of_any_length_arrives() {
        let folder = tempfile::tempdir().unwrap();
        let [program, argument, input] =
            ["program", "argument", "input"].map(|n| folder.path().join(n));
        let text = format!("printf %s \"$2\" > {argument:?}\ncat > {input:?}\n");
        for length in [10, 1 << 20] {
            // Read by a shell, so that nothing runs that is open for writing elsewhere.
            std::fs::write(&program, &text).unwrap();
            let mut child = Child::new("infer", "x".repeat(length)).unwrap();
            child.verb = program.to_str().unwrap().to_owned().leak();
            let mut child = child.of("sh");
            while child.tend().unwrap().is_none() {
                std::thread::yield_now();
            }
            let [argument, input] =
                [&argument, &input].map(|at| std::fs::read_to_string(at).unwrap());
            let job = if argument == BY_INPUT {
                input
            } else {
                argument
            };
            let job: Job<String> = serde_json::from_str(&job).unwrap();
            assert_eq!(job.options.len(), length);
        }
    }

    #[test]
    fn it_starts_with_the_options_that_were_given_last() {
        let folder = tempfile::tempdir().unwrap();
        let [program, argument] = ["program", "argument"].map(|n| folder.path().join(n));
        std::fs::write(&program, format!("printf %s \"$2\" > {argument:?}\n")).unwrap();
        let verb = program.to_str().unwrap().to_owned().leak();
        let mut child = Child::new(verb, 1).unwrap().of("sh");
        child.give(2).unwrap();
        assert!(!child.is_there());
        while child.tend().unwrap().is_none() {
            std::thread::yield_now();
        }
        let job = std::fs::read_to_string(&argument).unwrap();
        let job: Job<u32> = serde_json::from_str(&job).unwrap();
        assert_eq!(job.options, 2);
    }

    #[test]
    fn one_that_is_started_again_knows_how_often() {
        let folder = tempfile::tempdir().unwrap();
        let [program, told] = ["program", "told"].map(|n| folder.path().join(n));
        std::fs::write(&program, format!("echo $EDGECAP_RESTARTS >> {told:?}\n")).unwrap();
        let verb = program.to_str().unwrap().to_owned().leak();
        for before in [0, 2] {
            let mut child = Child::new(verb, ()).unwrap().of("sh").after(before);
            for _ in 0..2 {
                while child.tend().unwrap().is_none() {
                    std::thread::yield_now();
                }
                child.restart();
            }
            assert_eq!(child.starts(), 2);
        }
        assert_eq!(std::fs::read_to_string(&told).unwrap(), "0\n1\n2\n3\n");
    }

    #[test]
    fn none_is_started_while_one_before_it_does_not_end() {
        let mut child = Child::new("infer", ()).unwrap().of("true");
        let (left, input) = one_left();
        child.left = left;
        for _ in 0..3 {
            assert!(child.tend().unwrap().is_none());
        }
        assert!(child.starts() == 0 && child.has_left_one());
        drop(input);
        while child.starts() == 0 {
            child.tend().unwrap();
            std::thread::yield_now();
        }
        assert!(!child.has_left_one());
    }
}
