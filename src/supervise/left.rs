//! Processes that were ended by force and are not gone yet: one that waits for a device does not hear of its end before
//! the device answers.

use std::process::Child;
use std::time::{Duration, Instant};

/// How often is looked whether one is gone.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Waits for a process until a time at most; the process, where it is not gone by then.
pub fn wait(mut process: Child, until: Instant) -> Option<Child> {
    while matches!(process.try_wait(), Ok(None)) {
        if Instant::now() >= until {
            return Some(process);
        }
        std::thread::sleep(LOOK_EVERY);
    }
    None
}

/// Those that did not go in time.
#[derive(Debug, Default)]
pub struct Left(Vec<Child>);

impl Left {
    /// Kills a process and waits so long for its end; whoever comes next need not wait for it.
    pub fn kill(&mut self, mut process: Child, patience: Duration) {
        // Fails for one that is gone already.
        let _ = process.kill();
        if let Some(process) = wait(process, Instant::now() + patience) {
            tracing::warn!(
                "process {} was killed and does not end: it waits for a device; it is left behind",
                process.id()
            );
            self.0.push(process);
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Forgets those that are gone, so that the system can, too.
    pub fn look(&mut self) {
        self.0.retain_mut(|p| matches!(p.try_wait(), Ok(None)));
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::process::{ChildStdin, Command, Stdio};

    /// One that ends when its input does: until then it is as one that no signal reaches.
    pub fn one_left() -> (Left, Option<ChildStdin>) {
        let mut cat = Command::new("cat");
        let cat = cat.stdin(Stdio::piped()).stdout(Stdio::null());
        let mut process = cat.spawn().unwrap();
        let input = process.stdin.take();
        let process = wait(process, Instant::now()).expect("it goes on");
        (Left(vec![process]), input)
    }

    #[test]
    fn nobody_waits_for_one_that_does_not_end() {
        let (mut left, input) = one_left();
        left.look();
        assert_eq!(left.0.len(), 1);
        drop(input);
        while !left.0.is_empty() {
            left.look();
            std::thread::sleep(LOOK_EVERY);
        }
    }

    #[test]
    fn one_that_is_killed_is_waited_for() {
        let process = Command::new("sleep").arg("1000").spawn().unwrap();
        let mut left = Left::default();
        left.kill(process, Duration::from_secs(60));
        assert!(left.0.is_empty());
    }
}
