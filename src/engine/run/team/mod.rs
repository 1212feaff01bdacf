//! The threads that share a frame's work.
//!
//! Every step is cut into parts; threads take the next part not taken, and start the next step when all parts are done.
//! A thread that the system suspends holds up only its own part. Between frames everyone sleeps; within a frame waiting
//! is a short spin, then yielding. One team serves any number of tracks, one frame at a time.

mod shared;
mod track;

use std::sync::Arc;
use std::thread::JoinHandle;

use edgecap_kernels::Scratch;

use shared::Shared;
pub use track::{Track, Work};

/// Threads that a team leaves to the rest of the program where the system refuses more: for pictures, records, what is
/// served, and programs that decode. Where one of those cannot start, the program ends; a team of fewer is only slower.
const SPARE: usize = 8;

/// The calling thread and its helpers.
pub struct Team {
    shared: Arc<Shared>,
    helpers: Vec<JoinHandle<()>>,
    scratch: Scratch,
}

impl Team {
    /// Starts `threads - 1` helpers and waits until each runs, since a thread allocates when it starts. With them start
    /// [`SPARE`] more, which show that the system has room for the rest of the program, and leave again; where it
    /// refuses one, the last [`SPARE`] of those that there are do. Every thread has `scratch` bytes for the work's
    /// parts.
    ///
    /// # Errors
    /// The system's, where it refuses a thread for another reason.
    pub fn new(scratch: usize, threads: usize) -> std::io::Result<Self> {
        Self::start(scratch, threads, |helper, work| {
            let named = std::thread::Builder::new().name(format!("engine-{helper}"));
            named.spawn(work)
        })
    }

    fn start(
        scratch: usize,
        threads: usize,
        spawn: impl Fn(usize, Box<dyn FnOnce() + Send>) -> std::io::Result<JoinHandle<()>>,
    ) -> std::io::Result<Self> {
        let mut team = Self {
            shared: Arc::default(),
            helpers: Vec::new(),
            scratch: Scratch::new(scratch),
        };
        let all = if threads > 1 {
            threads + SPARE
        } else {
            threads
        };
        team.shared.keep(all);
        for i in 1..all {
            let shared = team.shared.clone();
            let mut scratch = Scratch::new(if i < threads { scratch } else { 0 });
            match spawn(i, Box::new(move || shared.help(i, &mut scratch))) {
                Ok(helper) => team.helpers.push(helper),
                Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => break,
                Err(e) => return Err(e),
            }
        }
        team.shared.wait_for(team.helpers.len());
        team.keep(team.helpers.len().saturating_sub(SPARE));
        team.use_threads(team.threads());
        Ok(team)
    }

    /// Helpers with greater numbers leave, and have left when this returns.
    fn keep(&mut self, helpers: usize) {
        self.shared.keep(helpers);
        for helper in self.helpers.drain(helpers.min(self.helpers.len())..) {
            // A helper that panicked has said so, and `run` has too.
            let _ = helper.join();
        }
    }

    /// Runs all steps of `track` once, with everybody. Whichever way it ends, no thread is at work on the frame any
    /// more.
    ///
    /// # Panics
    /// When a part panicked, on whichever thread, in this frame or in one before.
    ///
    /// # Safety
    /// Until this returns or unwinds nobody else uses what the work reads and writes.
    pub unsafe fn run(&mut self, track: &Arc<Track<impl Work + 'static>>) {
        self.check();
        let track: Arc<Track<dyn Work>> = track.clone();
        let number = track.begin();
        let end = self.shared.begin(&track, number);
        self.shared.work(&track, number, &mut self.scratch);
        end.finish();
        self.check();
    }

    /// Runs all steps of `track` once on this thread alone and calls `seen` after each.
    ///
    /// # Panics
    /// As [`run`](Self::run), and where `seen` does.
    ///
    /// # Safety
    /// As [`run`](Self::run).
    pub unsafe fn run_alone<W: Work>(&mut self, track: &Track<W>, mut seen: impl FnMut(usize)) {
        self.check();
        track.begin();
        // A frame that unwinds leaves the counters behind its number: no other may follow.
        let end = self.shared.begin_alone();
        for (step, progress) in track.progress.iter().enumerate() {
            for part in 0..progress.parts() {
                // SAFETY: step < steps() and part < parts, as `Track::new` found them; no helper is called, so that
                // this thread runs every part, in order; nobody else uses the work's memory (caller).
                unsafe { track.work.run(step, part, &mut self.scratch) };
            }
            progress.count_all(track.now());
            seen(step);
        }
        end.finish();
    }

    /// Threads that there are, the caller's included.
    pub fn threads(&self) -> usize {
        self.helpers.len() + 1
    }

    /// From now on so many threads share a frame, the caller's included: at least that, at most all that there are.
    pub fn use_threads(&self, threads: usize) {
        self.shared.want(threads.clamp(1, self.threads()) - 1);
    }

    fn check(&self) {
        assert!(
            !self.shared.has_failed(),
            "a frame was left unfinished because a kernel failed, whose own message is above; build the engine again"
        );
    }
}

impl Drop for Team {
    fn drop(&mut self) {
        self.keep(0);
    }
}

#[cfg(test)]
mod tests;
