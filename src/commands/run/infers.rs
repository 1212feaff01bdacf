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
    /// One for every camera with this name.
    ///
    /// # Errors
    /// If options cannot be written.
    pub fn new(tasks: Vec<(String, InferTask)>) -> anyhow::Result<Self> {
        let each = tasks.into_iter().map(|(camera, task)| {
            Ok(Infer {
                camera,
                child: Child::new("infer", task)?,
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
    /// failed of may pass, such as a stream that another process publishes still, or no room in shared memory.
    ///
    /// # Errors
    /// The failure of the last one.
    pub fn look_after(&mut self, meter: &Meter) -> anyhow::Result<()> {
        for k in 0..self.each.len() {
            if self.each[k].ended {
                continue;
            }
            let Infer { camera, child, .. } = &mut self.each[k];
            match look_after(child, camera, meter) {
                Ok(ended) => self.each[k].ended = ended,
                Err(e) => {
                    let may_pass = exit::may_pass(exit::code(&e));
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
