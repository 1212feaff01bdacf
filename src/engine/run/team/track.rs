//! Work that comes again with every frame, and how far each of its steps is: all that threads tell each other about
//! memory while they work.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

use edgecap_kernels::Scratch;

/// What a frame is made of: steps in order, each of parts that may run at the same time.
pub trait Work: Send + Sync {
    /// Steps of a frame.
    fn steps(&self) -> usize;

    /// Parts of a step; asked once, when a track is made.
    fn parts(&self, step: usize) -> usize;

    /// Runs one part.
    ///
    /// # Safety
    /// `step < steps()`, `part < parts(step)`. All parts of earlier steps are done and seen by this thread; nobody runs
    /// this part, or a part of another step, or uses what the work reads and writes, at the same time.
    unsafe fn run(&self, step: usize, part: usize, scratch: &mut Scratch);
}

/// Counters of one step, alone in their cache lines. They count over all frames, so nothing needs resetting and a
/// thread that wakes late finds that its frame is over.
#[repr(align(128))]
#[derive(Default)]
pub struct Progress {
    /// Parts of the step: the same for every thread and frame, or a part could be taken twice.
    parts: usize,
    taken: AtomicUsize,
    done: AtomicUsize,
    /// When the last part was done in the last frame, nanoseconds since the track was made.
    ended: AtomicU64,
}

impl Progress {
    /// Parts of the step.
    pub fn parts(&self) -> usize {
        self.parts
    }

    /// The next part of a frame that nobody has taken; nobody else gets it. Never one of a later frame: a thread that
    /// wakes late finds the counter at the frame's end or beyond.
    pub fn take(&self, frame: usize) -> Option<usize> {
        let (first, end) = (frame * self.parts, (frame + 1) * self.parts);
        let next = |n| (n < end).then_some(n + 1);
        let taken = self
            .taken
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, next);
        taken.ok().map(|n| n - first)
    }

    /// A part that was taken is done, at this time, nanoseconds since the track was made.
    pub fn count(&self, now: u64) {
        // Noted before the count, by everyone: the last to finish has the last word, or a word a few nanoseconds older.
        self.ended.store(now, Ordering::Relaxed);
        // SYNC POINT: pairs with the acquire in `is_done`: what the part wrote is visible to whoever sees the count.
        self.done.fetch_add(1, Ordering::Release);
    }

    /// All parts of a frame are done, by this thread alone: counters stay in step with the frames.
    pub fn count_all(&self, now: u64) {
        self.ended.store(now, Ordering::Relaxed);
        for counter in [&self.taken, &self.done] {
            counter.fetch_add(self.parts, Ordering::Relaxed);
        }
    }

    /// Whether all parts of a frame are done, and seen by this thread.
    pub fn is_done(&self, frame: usize) -> bool {
        // SYNC POINT: pairs with the release in `count`.
        self.done.load(Ordering::Acquire) >= (frame + 1) * self.parts
    }
}

/// Work that comes again with every frame, and how far it is.
pub struct Track<W: ?Sized> {
    pub(super) progress: Box<[Progress]>,
    frames: AtomicUsize,
    epoch: Instant,
    /// When the last frame began, nanoseconds since `epoch`.
    begun: AtomicU64,
    pub work: W,
}

impl<W: Work> Track<W> {
    /// Nothing of `work` is done yet.
    pub fn new(work: W) -> Self {
        let progress = |step| Progress {
            parts: work.parts(step),
            ..Progress::default()
        };
        Self {
            progress: (0..work.steps()).map(progress).collect(),
            frames: AtomicUsize::new(0),
            epoch: Instant::now(),
            begun: AtomicU64::new(0),
            work,
        }
    }
}

impl<W: Work + ?Sized> Track<W> {
    pub(super) fn now(&self) -> u64 {
        self.epoch.elapsed().as_nanos() as u64
    }

    /// Begins a frame: its number.
    pub(super) fn begin(&self) -> usize {
        self.begun.store(self.now(), Ordering::Relaxed);
        self.frames.fetch_add(1, Ordering::Relaxed)
    }

    /// Nanoseconds of a step in the last frame: from the end of the step before it to its own.
    pub fn nanoseconds(&self, step: usize) -> u64 {
        let ended = |i: usize| self.progress[i].ended.load(Ordering::Relaxed);
        let begun = match step {
            0 => self.begun.load(Ordering::Relaxed),
            _ => ended(step - 1),
        };
        ended(step).saturating_sub(begun)
    }
}
