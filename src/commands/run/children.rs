//! The two processes under supervision: started, watched, restarted after a crash, stopped.

use std::ffi::OsString;
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, ExitStatus};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// A process that ran this long has recovered: its next crash is a first one again.
const STABLE: Duration = Duration::from_secs(30);
/// Time to end after SIGTERM.
const GRACE: Duration = Duration::from_secs(3);

/// One verb of this program, running as a process of its own.
#[derive(Debug)]
pub struct Supervised {
    verb: &'static str,
    args: Vec<OsString>,
    state: State,
    pause: Duration,
    /// How often it was started again.
    pub restarts: u32,
}

#[derive(Debug)]
enum State {
    Running { child: Child, since: Instant },
    Waiting { until: Instant },
    Ended,
}

impl Supervised {
    /// Starts `edgecap VERB ARGS`; it ends when this process ends.
    ///
    /// # Errors
    /// If the process cannot be started.
    pub fn start(verb: &'static str, mut args: Vec<OsString>) -> std::io::Result<Self> {
        args.extend(["--supervisor".into(), std::process::id().to_string().into()]);
        let child = spawn(verb, &args)?;
        let state = State::Running {
            child,
            since: Instant::now(),
        };
        Ok(Self {
            verb,
            args,
            state,
            pause: FIRST_PAUSE,
            restarts: 0,
        })
    }

    /// The exit status if it has ended since the last call.
    ///
    /// # Errors
    /// If the operating system cannot tell.
    pub fn ended(&mut self) -> std::io::Result<Option<ExitStatus>> {
        let State::Running { child, since } = &mut self.state else {
            return Ok(None);
        };
        let Some(status) = child.try_wait()? else {
            return Ok(None);
        };
        if since.elapsed() > STABLE {
            self.pause = FIRST_PAUSE;
        }
        self.state = State::Ended;
        Ok(Some(status))
    }

    /// Lets it start again after a pause that doubles from crash to crash.
    pub fn restart_later(&mut self) {
        self.state = State::Waiting {
            until: Instant::now() + self.pause,
        };
        self.pause = (self.pause * 2).min(LONGEST_PAUSE);
    }

    /// Starts it again when its pause is over.
    ///
    /// # Errors
    /// If the process cannot be started.
    pub fn revive(&mut self) -> std::io::Result<()> {
        if let State::Waiting { until } = self.state
            && Instant::now() >= until
        {
            let child = spawn(self.verb, &self.args)?;
            self.state = State::Running {
                child,
                since: Instant::now(),
            };
            self.restarts += 1;
        }
        Ok(())
    }

    fn terminate(&self) {
        if let State::Running { child, .. } = &self.state
            && let Some(pid) = Pid::from_raw(child.id() as i32)
        {
            // It may have ended meanwhile; then there is nobody to tell.
            let _ = kill_process(pid, Signal::TERM);
        }
    }

    fn reap(&mut self, until: Instant) {
        if let State::Running { child, .. } = &mut self.state {
            while matches!(child.try_wait(), Ok(None)) && Instant::now() < until {
                std::thread::sleep(Duration::from_millis(5));
            }
            let _ = child.kill();
            let _ = child.wait();
        }
        self.state = State::Ended;
    }
}

/// Ends all of them: politely, then by force.
pub fn stop_all(children: &mut [&mut Supervised]) {
    for c in children.iter() {
        c.terminate();
    }
    let until = Instant::now() + GRACE;
    for c in children.iter_mut() {
        c.reap(until);
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

fn spawn(verb: &str, args: &[OsString]) -> std::io::Result<Child> {
    Command::new(std::env::current_exe()?)
        .arg(verb)
        .args(args)
        .spawn()
}
