//! One verb of this program as a process of its own.

use std::io::{self, Read};
use std::os::unix::process::ExitStatusExt;
use std::process::{self, ChildStdout, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::fs::{OFlags, fcntl_setfl};
use rustix::process::{Pid, Signal, kill_process};
use serde::{Deserialize, Serialize};

use super::policy::{Policy, Verdict};

/// Time to end after SIGTERM.
const GRACE: Duration = Duration::from_secs(3);

/// What a child is to do, handed over as one argument.
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
    verb: &'static str,
    job: String,
    policy: Policy,
    process: Option<process::Child>,
    beats: Option<ChildStdout>,
    has_lived: bool,
}

impl Child {
    /// `edgecap VERB` with these options; it starts at the first [`tend`](Self::tend) and ends when this process ends.
    ///
    /// # Errors
    /// If the options cannot be written.
    pub fn new<T: Serialize>(verb: &'static str, options: T) -> io::Result<Self> {
        let supervisor = process::id().cast_signed();
        Ok(Self {
            verb,
            job: serde_json::to_string(&Job {
                supervisor,
                options,
            })?,
            policy: Policy::new(Instant::now()),
            process: None,
            beats: None,
            has_lived: false,
        })
    }

    /// The verb.
    pub fn verb(&self) -> &'static str {
        self.verb
    }

    /// Whether it has ever shown that it works.
    pub fn has_lived(&self) -> bool {
        self.has_lived
    }

    /// Starts it when it is time, ends it when it hangs, and returns how it ended if it has since the last call: then
    /// [`restart`](Self::restart) it or leave it.
    ///
    /// # Errors
    /// If the process cannot be started or asked.
    pub fn tend(&mut self) -> io::Result<Option<ExitStatus>> {
        let now = Instant::now();
        if self.has_beaten() {
            self.policy.beat(now);
            self.has_lived = true;
        }
        match self.policy.look(now) {
            Verdict::Wait => {}
            Verdict::Start => {
                self.start()?;
                self.policy.started(now);
            }
            Verdict::Kill => {
                tracing::warn!("{} hangs; it is ended and started again", self.verb);
                if let Some(process) = &mut self.process {
                    process.kill()?;
                    process.wait()?;
                }
                self.process = None;
                self.policy.restart(now);
            }
        }
        let Some(process) = &mut self.process else {
            return Ok(None);
        };
        let ended = process.try_wait()?;
        if ended.is_some() {
            self.process = None;
        }
        Ok(ended)
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
        let mut process = Command::new(std::env::current_exe()?)
            .args([self.verb, "--job", &self.job])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()?;
        self.beats = process.stdout.take();
        self.process = Some(process);
        if let Some(beats) = &self.beats {
            fcntl_setfl(beats, OFlags::NONBLOCK)?;
        }
        Ok(())
    }

    /// Whether signs of life came since the last call.
    fn has_beaten(&mut self) -> bool {
        let mut some = [0; 4096];
        let read = self.beats.as_mut().map(|b| b.read(&mut some));
        matches!(read, Some(Ok(1..)))
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
        if let Some(mut process) = self.process.take() {
            while matches!(process.try_wait(), Ok(None)) && Instant::now() < until {
                std::thread::sleep(Duration::from_millis(5));
            }
            let _ = process.kill();
            let _ = process.wait();
        }
        self.policy.ended();
    }
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

/// How a process ended, in words.
pub fn describe(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit code {code}"),
        (None, Some(signal)) => format!("signal {signal}"),
        (None, None) => "an unknown cause".to_owned(),
    }
}
