//! What all threads of a team see: which frame is worked on, by whom, and how a thread takes part in it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};

use edgecap_kernels::Scratch;

use super::track::{Track, Work};

/// Spins before a waiting thread yields: 49 µs on Zen 4, longer where a `pause` takes longer, as on Intel since
/// Skylake. More than the usual difference between two parts' ends.
const SPINS: u32 = 2000;

/// A frame of a track.
#[derive(Clone)]
struct Frame {
    track: Arc<Track<dyn Work>>,
    number: usize,
}

#[derive(Default)]
struct Call {
    /// Helpers that have started.
    ready: usize,
    /// Frames begun by this team.
    begun: usize,
    /// The frame that is being worked on.
    frame: Option<Frame>,
    /// Helpers that take part in a frame; the others sleep on.
    wanted: usize,
    /// Helpers that are at work on a frame, this one or one before.
    working: usize,
    /// Helpers that stay: who has a greater number leaves.
    kept: usize,
}

/// What all threads of a team see.
#[derive(Default)]
pub struct Shared {
    call: Mutex<Call>,
    /// A frame begins, or helpers are to leave.
    called: Condvar,
    /// A helper is ready, or has left a frame.
    settled: Condvar,
    /// A frame was left unfinished; none begins any more.
    failed: AtomicBool,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Call> {
        // Nobody panics while holding it; a poisoned lock still holds a valid call.
        self.call.lock().unwrap_or_else(|e| e.into_inner())
    }

    fn wait<'a>(&self, until: &Condvar, call: MutexGuard<'a, Call>) -> MutexGuard<'a, Call> {
        until.wait(call).unwrap_or_else(|e| e.into_inner())
    }

    /// Whether a frame was left unfinished.
    pub fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Relaxed)
    }

    fn fail(&self) {
        self.failed.store(true, Ordering::Relaxed);
    }

    /// Helpers with greater numbers leave as soon as they see it; none is before its start.
    pub fn keep(&self, helpers: usize) {
        self.lock().kept = helpers;
        self.called.notify_all();
    }

    /// So many helpers take part in frames that begin from now on.
    pub fn want(&self, helpers: usize) {
        self.lock().wanted = helpers;
    }

    /// Waits until so many helpers run.
    pub fn wait_for(&self, helpers: usize) {
        let mut call = self.lock();
        while call.ready < helpers {
            call = self.wait(&self.settled, call);
        }
    }

    /// Begins a frame of `track`, to which helpers come if any are wanted; ends with what is returned.
    pub fn begin(&self, track: &Arc<Track<dyn Work>>, number: usize) -> FrameEnd<'_> {
        let end = self.begin_alone();
        let mut call = self.lock();
        if call.wanted > 0 {
            call.begun += 1;
            call.frame = Some(Frame {
                track: track.clone(),
                number,
            });
            drop(call);
            self.called.notify_all();
        }
        end
    }

    /// Begins a frame to which nobody comes; ends with what is returned.
    pub fn begin_alone(&self) -> FrameEnd<'_> {
        FrameEnd {
            shared: self,
            finished: false,
        }
    }

    /// The life of a helper; they count from 1.
    pub fn help(&self, number: usize, scratch: &mut Scratch) {
        let mut call = self.lock();
        call.ready += 1;
        self.settled.notify_all();
        let mut seen = 0;
        loop {
            while call.begun == seen && number <= call.kept {
                call = self.wait(&self.called, call);
            }
            if number > call.kept {
                return;
            }
            seen = call.begun;
            let Some(frame) = call.frame.clone().filter(|_| number <= call.wanted) else {
                continue;
            };
            call.working += 1;
            drop(call);
            let at_work = AtWork(self);
            self.work(&frame.track, frame.number, scratch);
            drop(frame);
            drop(at_work);
            call = self.lock();
        }
    }

    /// Takes part in a frame; returns when all its steps are done, or when a part failed.
    pub fn work(&self, track: &Track<dyn Work>, frame: usize, scratch: &mut Scratch) {
        for (step, progress) in track.progress.iter().enumerate() {
            while !self.has_failed()
                && let Some(part) = progress.take(frame)
            {
                let mut done = Done {
                    shared: self,
                    track,
                    step,
                    finished: false,
                };
                // SAFETY: step < steps() and part < parts (`take`), as `Track::new` found them. All threads have the
                // same parts, so that every part is taken once, by one thread; this step's parts are taken only after
                // all earlier steps' parts were seen to be done (`is_done` below, without a failure); nobody else uses
                // the work's memory until the frame has ended (`Team::run`'s contract), and it ends only when no
                // thread runs a part (`FrameEnd`).
                unsafe { track.work.run(step, part, scratch) };
                done.finished = true;
            }
            let mut spins = 0;
            while !progress.is_done(frame) {
                if self.has_failed() {
                    return;
                }
                spins += 1;
                if spins < SPINS {
                    std::hint::spin_loop();
                } else {
                    std::thread::yield_now();
                }
            }
            if self.has_failed() {
                return;
            }
        }
    }
}

/// The end of a frame, however the caller leaves it: when it unwinds, helpers stop at their next part and are waited
/// for.
pub struct FrameEnd<'a> {
    shared: &'a Shared,
    finished: bool,
}

impl FrameEnd<'_> {
    /// The caller has come to the end.
    pub fn finish(mut self) {
        self.finished = true;
    }
}

impl Drop for FrameEnd<'_> {
    fn drop(&mut self) {
        if !self.finished {
            self.shared.fail();
        }
        let mut call = self.shared.lock();
        // Who has not come yet need not.
        call.frame = None;
        // Without a failure all parts are done, and helpers touch nothing but counters.
        while self.shared.has_failed() && call.working > 0 {
            call = self.shared.wait(&self.shared.settled, call);
        }
    }
}

/// Counts a part as done even when its kernel panics, and says so.
struct Done<'a> {
    shared: &'a Shared,
    track: &'a Track<dyn Work>,
    step: usize,
    finished: bool,
}

impl Drop for Done<'_> {
    fn drop(&mut self) {
        if !self.finished {
            self.shared.fail();
        }
        // Whoever sees the count sees the failure, too.
        self.track.progress[self.step].count(self.track.now());
    }
}

/// A helper at work on a frame.
struct AtWork<'a>(&'a Shared);

impl Drop for AtWork<'_> {
    fn drop(&mut self) {
        self.0.lock().working -= 1;
        self.0.settled.notify_all();
    }
}
