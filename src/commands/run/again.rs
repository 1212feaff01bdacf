//! One of several cameras, run again for as long as others run where it failed of what may pass.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use edgecap_client::LinkError;

use super::pulse::Pulse;
use crate::commands::exit::{self, told_again};
use crate::commands::stop::Stop;
use crate::commands::taken;
use crate::metrics::Meter;
use crate::sink::SinkError;
use crate::supervise::Progress;

/// So soon a camera is tried again that failed of what may pass; twice as late each time, …
const FIRST_PAUSE: Duration = Duration::from_millis(500);
/// … and no later than this.
const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// How often one that waits looks whether the others go on.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// One of several cameras, and what it shares with the others.
pub struct OneOfSeveral<'a> {
    /// What happens to it.
    pub meter: &'a Meter,
    /// Its signs of life.
    pub pulse: &'a Pulse<'a>,
    /// How many run at this moment; this one is counted at first.
    pub running: &'a AtomicUsize,
    /// When the user has enough.
    pub stop: &'a Stop,
    /// It is to be there at the start.
    pub no_wait: bool,
}

/// Counts a camera among those that run, from when it was counted to where this is dropped.
struct Runs<'a>(&'a AtomicUsize);

impl Drop for Runs<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

impl OneOfSeveral<'_> {
    /// Runs it until it ends or the user stops it, where its name is `free`; again where it failed of what may pass,
    /// such as a name that another process has still. `run` hears whether it was called before. Between two tries the
    /// camera counts as one that is waited for: it must not end the others.
    ///
    /// # Errors
    /// What it failed of, where that would come again, where it was to be there at the start and has published nothing,
    /// or where no other camera runs.
    pub fn run_again(
        &self,
        mut free: Result<(), LinkError>,
        run: &mut dyn FnMut(bool) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let (name, frames) = (self.meter.name(), || self.meter.snapshot().frames);
        let (mut pause, mut said, mut was_run) = (FIRST_PAUSE, String::new(), false);
        loop {
            let before = frames();
            let counted = Runs(self.running);
            let ended = free
                .map_err(anyhow::Error::from)
                .and_then(|()| run(std::mem::replace(&mut was_run, true)));
            drop(counted);
            let Err(e) = ended else {
                return Ok(());
            };
            if !passes(&e) || (self.no_wait && frames() == 0) {
                return Err(e);
            }
            if self.stop.requested() {
                return Ok(());
            }
            if !self.others_run() {
                return Err(e);
            }
            if frames() > before {
                (pause, said) = (FIRST_PAUSE, String::new());
            }
            let why = told_again(&e);
            if said != why {
                tracing::warn!("{name}: ended, the others go on; starting it again: {why}");
                self.meter.failed(&why);
                said = why;
            }
            let failed = Instant::now();
            while failed.elapsed() < pause {
                if self.stop.requested() {
                    return Ok(());
                }
                if !self.others_run() {
                    return Err(e);
                }
                self.meter.looked();
                self.pulse.beat(Progress::Waiting);
                sleep(LOOK_EVERY);
            }
            pause = LONGEST_PAUSE.min(2 * pause);
            self.running.fetch_add(1, Ordering::AcqRel);
            self.meter.begins_anew();
            free = taken::are_free([name]).into_iter().collect();
        }
    }

    fn others_run(&self) -> bool {
        self.running.load(Ordering::Acquire) > 0
    }
}

/// Whether another try may go well. The camera's own files and pipes do not come back: each try would begin one more
/// record, and end at the same place.
fn passes(error: &anyhow::Error) -> bool {
    let by_sinks = matches!(
        error.downcast_ref(),
        Some(SinkError::Create { .. } | SinkError::Write { .. } | SinkError::Lost { .. })
    );
    !by_sinks && exit::may_pass(exit::code(error))
}

#[cfg(test)]
mod tests {
    use std::io;

    use super::*;
    use crate::commands::exit::Failure;
    use crate::message::BodyFrame;
    use crate::supervise::ServiceManager;

    const NAME: &str = "nobody-publishes-this";

    fn failed(code: u8) -> anyhow::Error {
        Failure::silent(code).into()
    }

    fn taken() -> Result<(), LinkError> {
        Err(LinkError::Busy {
            service: "hall".into(),
        })
    }

    /// Runs one beside so many others with `run`, which hears what number its call has.
    fn beside(
        others: usize,
        no_wait: bool,
        free: Result<(), LinkError>,
        run: &mut dyn FnMut(u32, &Meter, &ServiceManager) -> anyhow::Result<()>,
    ) -> (Result<(), u8>, u32, Meter) {
        let meter = Meter::new(NAME, "camera", &["infer"]);
        let manager = ServiceManager::from_env([NAME]);
        let (running, mut times) = (AtomicUsize::new(1 + others), 0);
        let one = OneOfSeveral {
            meter: &meter,
            pulse: &Pulse::new(&manager, 0),
            running: &running,
            stop: &Stop::never(),
            no_wait,
        };
        let ended = one.run_again(free, &mut |was_run| {
            assert_eq!(was_run, times > 0);
            times += 1;
            run(times, &meter, &manager)
        });
        assert_eq!(running.into_inner(), others, "the others");
        (ended.map_err(|e| exit::code(&e)), times, meter)
    }

    #[test]
    fn one_of_several_that_fails_of_what_may_pass_is_tried_again() {
        let (ended, times, meter) = beside(1, false, taken(), &mut |times, meter, manager| {
            assert!(manager.is_ready(), "its wait ends no other");
            meter.started("infer", 1);
            match times {
                1 => Err(failed(exit::UNAVAILABLE)),
                _ => Ok(()),
            }
        });
        assert_eq!((ended, times), (Ok(()), 2));
        let told = meter.snapshot();
        assert!(told.last_error.is_some());
        assert_eq!(told.restarts, [("infer".to_owned(), 1)]);
    }

    #[test]
    fn one_that_would_fail_again_or_is_the_last_ends() {
        for (others, code) in [(1, exit::CONFIG), (0, exit::UNAVAILABLE)] {
            let (ended, times, _) = beside(others, false, Ok(()), &mut |_, _, _| Err(failed(code)));
            assert_eq!((ended, times), (Err(code), 1));
        }
        // The other one ends while it waits.
        let meter = Meter::new(NAME, "camera", &[]);
        let manager = ServiceManager::from_env([NAME]);
        let running = AtomicUsize::new(2);
        let one = OneOfSeveral {
            meter: &meter,
            pulse: &Pulse::new(&manager, 0),
            running: &running,
            stop: &Stop::never(),
            no_wait: false,
        };
        let ended = std::thread::scope(|threads| {
            let waits =
                threads.spawn(|| one.run_again(Ok(()), &mut |_| Err(failed(exit::UNAVAILABLE))));
            while meter.snapshot().last_error.is_none() {
                std::thread::yield_now();
            }
            drop(Runs(&running));
            waits.join().unwrap()
        });
        assert!(ended.is_err());
    }

    /// Each try would leave one more record.
    #[test]
    fn one_whose_own_output_fails_is_not_tried_again() {
        let cause = || io::Error::from(io::ErrorKind::BrokenPipe);
        let path = || std::path::PathBuf::from("hall.jsonl");
        let written = || SinkError::Write {
            path: path(),
            cause: cause(),
        };
        let lost = || SinkError::Lost {
            path: path(),
            cause: cause(),
        };
        for error in [&written as &dyn Fn() -> SinkError, &lost] {
            let (ended, times, _) = beside(1, false, Ok(()), &mut |_, meter, _| {
                meter.published(&BodyFrame::default());
                Err(error().into())
            });
            assert_eq!((ended, times), (Err(exit::IO), 1));
        }
        let link = SinkError::Link(taken().unwrap_err());
        assert!(passes(&link.into()), "shared memory has no room, say");
    }

    #[test]
    fn one_that_is_not_waited_for_is_tried_again_once_it_was_there() {
        let (ended, times, _) = beside(1, true, Ok(()), &mut |_, _, _| {
            Err(failed(exit::UNAVAILABLE))
        });
        assert_eq!((ended, times), (Err(exit::UNAVAILABLE), 1));
        let (ended, times, _) = beside(1, true, Ok(()), &mut |times, meter, _| {
            meter.published(&BodyFrame::default());
            match times {
                1 => Err(failed(exit::UNAVAILABLE)),
                _ => Ok(()),
            }
        });
        assert_eq!((ended, times), (Ok(()), 2));
    }
}
