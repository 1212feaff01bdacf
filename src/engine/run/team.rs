//! The threads that share a frame's work.
//!
//! Every step is cut into parts; threads take the next part not taken, and start the next step when all parts are done. A
//! thread that the system suspends holds up only its own part. Between frames everyone sleeps; within a frame waiting is
//! a short spin, then yielding.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::Instant;

use edgecap_kernels::Scratch;

use super::step::{MapPointers, Memory, Step};

/// Spins before a waiting thread yields: some microseconds, longer than the usual difference between two parts' ends.
const SPINS: u32 = 2000;

/// Counters of one step, alone in their cache lines. They count over all frames, so nothing needs resetting and a thread
/// that wakes late finds that its frame is over.
#[repr(align(128))]
#[derive(Default)]
struct Progress {
    taken: AtomicUsize,
    done: AtomicUsize,
    /// When the last part was done in the last frame, nanoseconds since the engine began.
    ended: AtomicU64,
}

#[derive(Default)]
struct Call {
    /// Helpers that have started.
    ready: usize,
    /// Frames begun.
    frame: usize,
    stop: bool,
}

/// What all threads of an engine see.
pub(super) struct Shared {
    pub steps: Vec<Step>,
    pub memory: Memory,
    pub maps: MapPointers,
    progress: Vec<Progress>,
    call: Mutex<Call>,
    called: Condvar,
    readied: Condvar,
    failed: AtomicBool,
    epoch: Instant,
    /// When the last frame began, nanoseconds since `epoch`.
    begun: AtomicU64,
}

/// The calling thread and its helpers.
pub(super) struct Team {
    pub shared: Arc<Shared>,
    helpers: Vec<JoinHandle<()>>,
    scratch: Scratch,
    frame: usize,
}

impl Team {
    /// Starts `threads - 1` helpers and waits until each runs, since a thread allocates when it starts; with `pin`, each on its own core of those the process may use.
    pub fn new(
        steps: Vec<Step>,
        memory: Memory,
        threads: usize,
        pin: bool,
    ) -> std::io::Result<Self> {
        let bytes = steps.iter().map(Step::scratch_bytes).max().unwrap_or(0);
        let shared = Arc::new(Shared {
            progress: steps.iter().map(|_| Progress::default()).collect(),
            steps,
            memory,
            maps: Default::default(),
            call: Mutex::default(),
            called: Condvar::new(),
            readied: Condvar::new(),
            failed: AtomicBool::new(false),
            epoch: Instant::now(),
            begun: AtomicU64::new(0),
        });
        let mut team = Self {
            shared: shared.clone(),
            helpers: Vec::new(),
            scratch: Scratch::new(bytes),
            frame: 0,
        };
        for i in 1..threads {
            let shared = shared.clone();
            let mut scratch = Scratch::new(bytes);
            let helper = std::thread::Builder::new()
                .name(format!("engine-{i}"))
                .spawn(move || {
                    if pin {
                        super::pin::to_core(i);
                    }
                    shared.help(&mut scratch);
                })?;
            team.helpers.push(helper);
        }
        team.shared.wait_for(team.helpers.len());
        Ok(team)
    }

    /// Runs all steps once, with everybody.
    ///
    /// # Panics
    /// When a kernel panicked, on whichever thread.
    pub fn run(&mut self) {
        let frame = self.frame;
        self.frame += 1;
        let shared = &self.shared;
        shared.begun.store(shared.now(), Ordering::Relaxed);
        if !self.helpers.is_empty() {
            self.shared.lock().frame = self.frame;
            self.shared.called.notify_all();
        }
        self.shared.work(frame, &mut self.scratch);
        let failed = self.shared.failed.load(Ordering::Relaxed);
        assert!(!failed, "a kernel failed; its own message is above");
    }

    /// Runs all steps once on this thread alone and calls `seen` after each.
    pub fn run_alone(&mut self, mut seen: impl FnMut(&Step, &Memory)) {
        for (step, progress) in self.shared.steps.iter().zip(&self.shared.progress) {
            for part in &step.parts {
                // SAFETY: helpers sleep, since no frame is begun for them, and `&mut self` keeps other callers out.
                unsafe {
                    step.run(
                        part,
                        &self.shared.memory,
                        &self.shared.maps,
                        &mut self.scratch,
                    );
                }
            }
            // Keep the counters in step with the frames.
            for counter in [&progress.taken, &progress.done] {
                counter.fetch_add(step.parts.len(), Ordering::Relaxed);
            }
            seen(step, &self.shared.memory);
        }
        self.frame += 1;
    }

    /// Threads, the caller's included.
    pub fn threads(&self) -> usize {
        self.helpers.len() + 1
    }

    /// Nanoseconds of a step in the last frame: from the end of the step before it to its own.
    pub fn nanoseconds(&self, step: usize) -> u64 {
        let ended = |i: usize| self.shared.progress[i].ended.load(Ordering::Relaxed);
        let begun = match step {
            0 => self.shared.begun.load(Ordering::Relaxed),
            _ => ended(step - 1),
        };
        ended(step).saturating_sub(begun)
    }
}

impl Drop for Team {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        self.shared.called.notify_all();
        for helper in self.helpers.drain(..) {
            // A helper that panicked has said so, and `run` has too.
            let _ = helper.join();
        }
    }
}

/// Counts a part as done even when its kernel panics, so that nobody waits for ever.
struct Done<'a> {
    shared: &'a Shared,
    progress: &'a Progress,
}

impl Drop for Done<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.shared.failed.store(true, Ordering::Relaxed);
        }
        // Noted before the count, by everyone: the last to finish has the last word, or a word a few nanoseconds older.
        let ended = &self.progress.ended;
        ended.store(self.shared.now(), Ordering::Relaxed);
        // SYNC POINT: pairs with the acquire in `work`: what the part wrote is visible to whoever sees the count.
        self.progress.done.fetch_add(1, Ordering::Release);
    }
}

impl Shared {
    fn lock(&self) -> std::sync::MutexGuard<'_, Call> {
        // Nobody panics while holding it; a poisoned lock still holds a valid call.
        self.call.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// Returns when this many helpers have started.
    fn wait_for(&self, helpers: usize) {
        let mut call = self.lock();
        while call.ready < helpers {
            call = self.readied.wait(call).unwrap_or_else(|e| e.into_inner());
        }
    }

    /// A helper's life.
    fn help(&self, scratch: &mut Scratch) {
        self.lock().ready += 1;
        self.readied.notify_all();
        let mut seen = 0;
        loop {
            {
                let mut call = self.lock();
                while call.frame == seen && !call.stop {
                    call = self.called.wait(call).unwrap_or_else(|e| e.into_inner());
                }
                if call.stop {
                    return;
                }
                seen = call.frame;
            }
            self.work(seen - 1, scratch);
        }
    }

    fn now(&self) -> u64 {
        self.epoch.elapsed().as_nanos() as u64
    }

    /// Takes part in frame number `frame`; returns when all its steps are done.
    fn work(&self, frame: usize, scratch: &mut Scratch) {
        for (step, progress) in self.steps.iter().zip(&self.progress) {
            let (first, end) = (frame * step.parts.len(), (frame + 1) * step.parts.len());
            while let Some(i) = take(&progress.taken, end) {
                let done = Done {
                    shared: self,
                    progress,
                };
                // SAFETY: every part is taken once, by one thread; this step's parts are taken only after all earlier steps'
                // parts were seen to be done (acquire below); the engine touches memory and maps only between frames.
                unsafe {
                    step.run(&step.parts[i - first], &self.memory, &self.maps, scratch);
                }
                drop(done);
            }
            // SYNC POINT: pairs with the release in `Done`.
            let mut spins = 0;
            while progress.done.load(Ordering::Acquire) < end {
                spins += 1;
                if spins < SPINS {
                    std::hint::spin_loop();
                } else {
                    std::thread::yield_now();
                }
            }
        }
    }
}

/// The next number below `end` that nobody has taken. Never takes numbers of a later frame: a thread that wakes late finds
/// the counter at `end` or beyond.
fn take(counter: &AtomicUsize, end: usize) -> Option<usize> {
    let next = |n| (n < end).then_some(n + 1);
    counter
        .fetch_update(Ordering::Relaxed, Ordering::Relaxed, next)
        .ok()
}
