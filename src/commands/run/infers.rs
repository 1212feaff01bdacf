//! The processes of a run that see pictures, one a camera.

use super::mend::look_after;
use crate::commands::exit::{self, told_again};
use crate::commands::infer::InferTask;
use crate::metrics::Meter;
use crate::supervise::{Beat, Child};

/// One or several `infer`, looked after.
pub struct Infers {
    each: Vec<Infer>,
}

struct Infer {
    camera: String,
    child: Child,
    /// It may come later than the start.
    waits: bool,
    /// Its input has ended, or it failed for good.
    ended: bool,
    /// It failed of what may pass.
    failed: bool,
    /// It looks for its camera, or its pictures are of no use.
    away: bool,
}

impl Infer {
    /// Whether it works, or may yet.
    fn goes_on(&self) -> bool {
        !self.ended && (!self.failed || self.child.has_lived())
    }
}

impl Infers {
    /// One for every camera with this name; `before`: how often a camera's was started before that began anew.
    ///
    /// # Errors
    /// If options cannot be written.
    pub fn new(tasks: Vec<(String, InferTask)>, before: u64) -> anyhow::Result<Self> {
        let each = tasks.into_iter().map(|(camera, task)| {
            Ok(Infer {
                camera,
                waits: task.waits,
                child: Child::new("infer", task)?.after(before),
                ended: false,
                failed: false,
                away: false,
            })
        });
        Ok(Self {
            each: each.collect::<anyhow::Result<_>>()?,
        })
    }

    /// Looks after all of them. One of several that fails leaves the others running, and is started again where what it
    /// failed of may pass, such as a stream that another process publishes still, or no room in shared memory; not one
    /// that was to be there at the start and was not.
    ///
    /// # Errors
    /// The failure of the last one.
    pub fn look_after(&mut self, meter: &Meter) -> anyhow::Result<()> {
        for k in 0..self.each.len() {
            if self.each[k].ended {
                continue;
            }
            let Infer {
                camera,
                child,
                waits,
                ..
            } = &mut self.each[k];
            let may_wait = *waits || child.has_worked();
            match look_after(child, camera, meter) {
                Ok(ended) => self.each[k].ended = ended,
                Err(e) => {
                    let may_pass = may_wait && exit::may_pass(exit::code(&e));
                    self.each[k].failed = may_pass;
                    self.each[k].ended = !may_pass;
                    if !self.each.iter().any(Infer::goes_on) {
                        return Err(e);
                    }
                    let Infer { camera, child, .. } = &mut self.each[k];
                    meter.failed(format!("{camera}: {}", told_again(&e)));
                    if may_pass {
                        let why = told_again(&e);
                        tracing::warn!(
                            "{camera}: ended, the others go on; starting it again: {why}"
                        );
                        child.restart();
                    } else {
                        tracing::error!("{camera}: ended, the others go on: {}", told_again(&e));
                        child.leave();
                    }
                }
            }
        }
        let mut changed = false;
        for infer in self.each.iter_mut() {
            if infer.ended {
                // Its last sign of life is none any more.
                changed |= std::mem::take(&mut infer.away);
                continue;
            }
            let away = match infer.child.heard() {
                Some(Beat::Step) => false,
                Some(Beat::Away) => true,
                // A picture that is not due yet or was damaged says nothing of it.
                _ => continue,
            };
            infer.away = away;
            changed = true;
        }
        if changed {
            meter.camera(!self.each.iter().any(|i| i.away));
        }
        // Of several, too, once is no restart.
        let again: u64 = self.each.iter().map(|i| i.child.starts()).sum();
        meter.started("infer", (again + 1).saturating_sub(self.each.len() as u64));
        Ok(())
    }

    /// Whether none goes on.
    pub fn have_ended(&self) -> bool {
        self.each.iter().all(|i| i.ended)
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.each.len()
    }

    /// How often any of them was started.
    pub fn starts(&self) -> u64 {
        self.each.iter().map(|i| i.child.starts()).sum()
    }

    /// Whether any showed this sign of life since the last look.
    pub fn heard(&self, beat: Beat) -> bool {
        let mut going_on = self.each.iter().filter(|i| !i.ended);
        going_on.any(|i| i.child.heard() == Some(beat))
    }

    /// Whether any has left a process behind that waits for its camera.
    pub fn have_left_one(&self) -> bool {
        let mut going_on = self.each.iter().filter(|i| !i.ended);
        going_on.any(|i| i.child.has_left_one())
    }

    /// Ends all that run, to start again.
    pub fn replace(&mut self, why: &str) {
        for infer in self.each.iter_mut().filter(|i| !i.ended) {
            infer.child.replace(why);
        }
    }

    /// All of them.
    pub fn children(&mut self) -> impl Iterator<Item = &mut Child> {
        self.each.iter_mut().map(|i| &mut i.child)
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;
    use crate::supervise::stop_all;

    /// A busy machine takes its time; one that neither ends nor is tried again would be waited for without end.
    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn one_that_was_to_be_there_at_the_start_is_not_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let infer = |camera: &str, script: &str, waits| {
            let verb = folder.path().join(camera);
            std::fs::write(&verb, script).unwrap();
            let verb = verb.to_str().unwrap().to_owned().leak();
            Infer {
                camera: camera.to_owned(),
                child: Child::new(verb, ()).unwrap().of("/bin/sh"),
                waits,
                ended: false,
                failed: false,
                away: false,
            }
        };
        for waits in [false, true] {
            let missing = infer("hall", "exit 69", waits);
            let there = infer("yard", "exec sleep 1000", waits);
            let each = vec![missing, there];
            let mut infers = Infers { each };
            let (meter, since) = (Meter::new("room", "hall, yard", &["infer"]), Instant::now());
            while !infers.each[0].ended && infers.each[0].child.starts() < 2 {
                infers.look_after(&meter).unwrap();
                assert!(since.elapsed() < PATIENCE);
                std::thread::sleep(Duration::from_millis(1));
            }
            assert_eq!(infers.each[0].ended, !waits);
            assert!(!infers.have_ended());
            stop_all(&mut infers.children().collect::<Vec<_>>());
        }
    }
}
