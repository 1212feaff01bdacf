//! The threads that share a frame's work.
//!
//! Every step is cut into parts; threads take the next part not taken, and start the next step when all parts are done.
//! A thread that the system suspends holds up only its own part. Between frames everyone sleeps; within a frame waiting
//! is a short spin, then yielding. One team serves any number of tracks, one frame at a time.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Instant;

use edgecap_kernels::Scratch;

/// Spins before a waiting thread yields: 49 µs on Zen 4, longer where a `pause` takes longer, as on Intel since
/// Skylake. More than the usual difference between two parts' ends.
const SPINS: u32 = 2000;
/// Threads that a team leaves to the rest of the program where the system refuses more: for pictures, records, what is
/// served, and programs that decode. Where one of those cannot start, the program ends; a team of fewer is only slower.
const SPARE: usize = 8;

/// What a frame is made of: steps in order, each of parts that may run at the same time.
pub(super) trait Work: Send + Sync {
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
struct Progress {
    /// Parts of the step: the same for every thread and frame, or a part could be taken twice.
    parts: usize,
    taken: AtomicUsize,
    done: AtomicUsize,
    /// When the last part was done in the last frame, nanoseconds since the track was made.
    ended: AtomicU64,
}

/// Work that comes again with every frame, and how far it is.
pub(super) struct Track<W: ?Sized> {
    progress: Box<[Progress]>,
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
    fn now(&self) -> u64 {
        self.epoch.elapsed().as_nanos() as u64
    }

    /// Begins a frame: its number.
    fn begin(&self) -> usize {
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
struct Shared {
    call: Mutex<Call>,
    /// A frame begins, or helpers are to leave.
    called: Condvar,
    /// A helper is ready, or has left a frame.
    settled: Condvar,
    /// A frame was left unfinished; none begins any more.
    failed: AtomicBool,
}

/// The calling thread and its helpers.
pub(super) struct Team {
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
        team.shared.lock().kept = all;
        for i in 1..all {
            let shared = team.shared.clone();
            let mut scratch = Scratch::new(if i < threads { scratch } else { 0 });
            match spawn(i, Box::new(move || shared.help(i, &mut scratch))) {
                Ok(helper) => team.helpers.push(helper),
                Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => break,
                Err(e) => return Err(e),
            }
        }
        let mut call = team.shared.lock();
        while call.ready < team.helpers.len() {
            call = team.shared.wait(&team.shared.settled, call);
        }
        drop(call);
        team.keep(team.helpers.len().saturating_sub(SPARE));
        team.use_threads(team.threads());
        Ok(team)
    }

    /// Helpers with greater numbers leave, and have left when this returns.
    fn keep(&mut self, helpers: usize) {
        self.shared.lock().kept = helpers;
        self.shared.called.notify_all();
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
        let shared = &self.shared;
        let mut end = FrameEnd {
            shared,
            finished: false,
        };
        let mut call = shared.lock();
        if call.wanted == 0 {
            drop(call);
        } else {
            call.begun += 1;
            call.frame = Some(Frame {
                track: track.clone(),
                number,
            });
            drop(call);
            shared.called.notify_all();
        }
        shared.work(&track, number, &mut self.scratch);
        end.finished = true;
        drop(end);
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
        let mut end = FrameEnd {
            shared: &self.shared,
            finished: false,
        };
        for (step, progress) in track.progress.iter().enumerate() {
            let parts = progress.parts;
            for part in 0..parts {
                // SAFETY: step < steps() and part < parts, as `Track::new` found them; no helper is called, so that
                // this thread runs every part, in order; nobody else uses the work's memory (caller).
                unsafe { track.work.run(step, part, &mut self.scratch) };
            }
            // Keep the counters in step with the frames.
            for counter in [&progress.taken, &progress.done] {
                counter.fetch_add(parts, Ordering::Relaxed);
            }
            seen(step);
        }
        end.finished = true;
    }

    /// Threads that there are, the caller's included.
    pub fn threads(&self) -> usize {
        self.helpers.len() + 1
    }

    /// From now on so many threads share a frame, the caller's included: at least that, at most all that there are.
    pub fn use_threads(&self, threads: usize) {
        self.shared.lock().wanted = threads.clamp(1, self.threads()) - 1;
    }

    fn check(&self) {
        let failed = self.shared.failed.load(Ordering::Relaxed);
        assert!(
            !failed,
            "a frame was left unfinished because a kernel failed, whose own message is above; build the engine again"
        );
    }
}

impl Drop for Team {
    fn drop(&mut self) {
        self.keep(0);
    }
}

/// The end of a frame, however the caller leaves it: when it unwinds, helpers stop at their next part and are waited
/// for.
struct FrameEnd<'a> {
    shared: &'a Shared,
    finished: bool,
}

impl Drop for FrameEnd<'_> {
    fn drop(&mut self) {
        if !self.finished {
            self.shared.failed.store(true, Ordering::Relaxed);
        }
        let mut call = self.shared.lock();
        // Who has not come yet need not.
        call.frame = None;
        // Without a failure all parts are done, and helpers touch nothing but counters.
        while self.shared.failed.load(Ordering::Relaxed) && call.working > 0 {
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
            self.shared.failed.store(true, Ordering::Relaxed);
        }
        let progress = &self.track.progress[self.step];
        // Noted before the count, by everyone: the last to finish has the last word, or a word a few nanoseconds older.
        progress.ended.store(self.track.now(), Ordering::Relaxed);
        // SYNC POINT: pairs with the acquire in `work`: what the part wrote is visible to whoever sees the count.
        progress.done.fetch_add(1, Ordering::Release);
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

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Call> {
        // Nobody panics while holding it; a poisoned lock still holds a valid call.
        self.call.lock().unwrap_or_else(|e| e.into_inner())
    }

    fn wait<'a>(&self, until: &Condvar, call: MutexGuard<'a, Call>) -> MutexGuard<'a, Call> {
        until.wait(call).unwrap_or_else(|e| e.into_inner())
    }

    /// The life of a helper; they count from 1.
    fn help(&self, number: usize, scratch: &mut Scratch) {
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
    fn work(&self, track: &Track<dyn Work>, frame: usize, scratch: &mut Scratch) {
        let failed = || self.failed.load(Ordering::Relaxed);
        for (step, progress) in track.progress.iter().enumerate() {
            let parts = progress.parts;
            let (first, end) = (frame * parts, (frame + 1) * parts);
            while !failed()
                && let Some(i) = take(&progress.taken, end)
            {
                let mut done = Done {
                    shared: self,
                    track,
                    step,
                    finished: false,
                };
                // SAFETY: step < steps() and i - first < parts (`take`), as `Track::new` found them. All threads have
                // the same parts, so that every part is taken once, by one thread; this step's parts are taken only
                // after all earlier steps' parts were seen to be done (acquire below, without a failure); nobody else
                // uses the work's memory until the frame has ended (`Team::run`'s contract), and it ends only when no
                // thread runs a part (`FrameEnd`).
                unsafe { track.work.run(step, i - first, scratch) };
                done.finished = true;
            }
            // SYNC POINT: pairs with the release in `Done`.
            let mut spins = 0;
            while progress.done.load(Ordering::Acquire) < end {
                if failed() {
                    return;
                }
                spins += 1;
                if spins < SPINS {
                    std::hint::spin_loop();
                } else {
                    std::thread::yield_now();
                }
            }
            if failed() {
                return;
            }
        }
    }
}

/// The next number below `end` that nobody has taken. Never takes numbers of a later frame: a thread that wakes late
/// finds the counter at `end` or beyond.
fn take(counter: &AtomicUsize, end: usize) -> Option<usize> {
    let next = |n| (n < end).then_some(n + 1);
    counter
        .fetch_update(Ordering::Relaxed, Ordering::Relaxed, next)
        .ok()
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::thread::ThreadId;
    use std::time::Duration;

    use super::*;

    /// Two steps of two parts. In frame 1 the caller's part, or the helper's, panics while the other is at work.
    struct Failing {
        caller: ThreadId,
        caller_fails: bool,
        /// Threads that have begun a part of the first step.
        met: AtomicUsize,
        inside: AtomicUsize,
        second_step: AtomicUsize,
    }

    impl Work for Failing {
        fn steps(&self) -> usize {
            2
        }

        fn parts(&self, _step: usize) -> usize {
            2
        }

        /// # Safety
        /// None: atomics and locks only.
        unsafe fn run(&self, step: usize, _part: usize, _scratch: &mut Scratch) {
            if step == 1 {
                self.second_step.fetch_add(1, Ordering::SeqCst);
                return;
            }
            self.inside.fetch_add(1, Ordering::SeqCst);
            // Both threads are within a part from here on.
            self.met.fetch_add(1, Ordering::SeqCst);
            while self.met.load(Ordering::SeqCst) < 2 {
                std::thread::yield_now();
            }
            let is_caller = std::thread::current().id() == self.caller;
            if is_caller == self.caller_fails {
                self.inside.fetch_sub(1, Ordering::SeqCst);
                // Without the panic hook, which may take longer than the other part.
                std::panic::resume_unwind(Box::new("a kernel's failure"));
            }
            std::thread::sleep(Duration::from_millis(100));
            self.inside.fetch_sub(1, Ordering::SeqCst);
        }
    }

    #[test]
    fn nobody_is_at_work_when_a_failed_frame_has_been_left() {
        for caller_fails in [true, false] {
            let track = Arc::new(Track::new(Failing {
                caller: std::thread::current().id(),
                caller_fails,
                met: AtomicUsize::new(0),
                inside: AtomicUsize::new(0),
                second_step: AtomicUsize::new(0),
            }));
            let mut team = Team::new(0, 2).unwrap();
            // SAFETY: this work shares nothing but atomics.
            let mut run = || catch_unwind(AssertUnwindSafe(|| unsafe { team.run(&track) }));
            assert!(run().is_err());
            assert_eq!(track.work.inside.load(Ordering::SeqCst), 0);
            let again = run().unwrap_err();
            let text = again.downcast_ref::<&str>().unwrap();
            assert!(text.contains("build the engine again"), "{text}");
            assert_eq!(track.work.second_step.load(Ordering::SeqCst), 0);
            assert_eq!(track.work.met.load(Ordering::SeqCst), 2);
        }
    }

    /// Two steps of one part; the second fails.
    struct Broken;

    impl Work for Broken {
        fn steps(&self) -> usize {
            2
        }

        fn parts(&self, _step: usize) -> usize {
            1
        }

        /// # Safety
        /// None: nothing is touched.
        unsafe fn run(&self, step: usize, _part: usize, _scratch: &mut Scratch) {
            if step == 1 {
                std::panic::resume_unwind(Box::new("a kernel's failure"));
            }
        }
    }

    #[test]
    fn no_frame_follows_one_that_failed_on_the_caller_alone() {
        let track = Arc::new(Track::new(Broken));
        let mut team = Team::new(0, 2).unwrap();
        // SAFETY: this work shares nothing.
        let alone = |team: &mut Team| unsafe { team.run_alone(&track, |_| {}) };
        // SAFETY: as above.
        let together = |team: &mut Team| unsafe { team.run(&track) };
        let said = |run: &dyn Fn(&mut Team), team: &mut Team| {
            let panic = catch_unwind(AssertUnwindSafe(|| run(team))).unwrap_err();
            (*panic.downcast_ref::<&str>().unwrap()).to_owned()
        };
        assert_eq!(said(&alone, &mut team), "a kernel's failure");
        for run in [&together as &dyn Fn(&mut Team), &alone] {
            let text = said(run, &mut team);
            assert!(text.contains("build the engine again"), "{text}");
        }
    }

    /// Counts every part.
    struct Counting(Vec<AtomicUsize>);

    impl Work for Counting {
        fn steps(&self) -> usize {
            self.0.len()
        }

        fn parts(&self, step: usize) -> usize {
            step + 1
        }

        /// # Safety
        /// None: atomics and locks only.
        unsafe fn run(&self, step: usize, _part: usize, _scratch: &mut Scratch) {
            self.0[step].fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Notes which threads run its parts, each of which waits until so many threads have come.
    struct Meeting {
        wanted: usize,
        came: AtomicUsize,
        threads: Mutex<Vec<ThreadId>>,
    }

    impl Work for Meeting {
        fn steps(&self) -> usize {
            1
        }

        fn parts(&self, _step: usize) -> usize {
            4
        }

        /// # Safety
        /// None: atomics and locks only.
        unsafe fn run(&self, _step: usize, _part: usize, _scratch: &mut Scratch) {
            let me = std::thread::current().id();
            let mut threads = self.threads.lock().unwrap();
            if !threads.contains(&me) {
                threads.push(me);
                self.came.fetch_add(1, Ordering::SeqCst);
            }
            drop(threads);
            while self.came.load(Ordering::SeqCst) < self.wanted {
                std::thread::yield_now();
            }
        }
    }

    /// Counts its parts, and says at every question that there is one more.
    struct Growing {
        asked: AtomicUsize,
        ran: AtomicUsize,
    }

    impl Work for Growing {
        fn steps(&self) -> usize {
            1
        }

        fn parts(&self, _step: usize) -> usize {
            self.asked.fetch_add(1, Ordering::Relaxed) + 1
        }

        /// # Safety
        /// None: atomics and locks only.
        unsafe fn run(&self, _step: usize, _part: usize, _scratch: &mut Scratch) {
            self.ran.fetch_add(1, Ordering::Relaxed);
        }
    }

    #[test]
    fn a_step_has_as_many_parts_in_every_frame_and_for_every_thread() {
        let track = Arc::new(Track::new(Growing {
            asked: AtomicUsize::new(0),
            ran: AtomicUsize::new(0),
        }));
        let mut team = Team::new(0, 3).unwrap();
        for _ in 0..20 {
            // SAFETY: this work shares nothing but atomics.
            unsafe { team.run(&track) };
        }
        // SAFETY: as above.
        unsafe { team.run_alone(&track, |_| {}) };
        assert_eq!(track.work.ran.load(Ordering::Relaxed), 21);
    }

    /// Has room for `most` threads at once.
    struct System {
        live: Arc<AtomicUsize>,
        most: usize,
    }

    impl System {
        fn spawn(&self, work: impl FnOnce() + Send + 'static) -> std::io::Result<JoinHandle<()>> {
            if self.live.fetch_add(1, Ordering::SeqCst) >= self.most {
                self.live.fetch_sub(1, Ordering::SeqCst);
                return Err(std::io::ErrorKind::WouldBlock.into());
            }
            let live = self.live.clone();
            std::thread::Builder::new().spawn(move || {
                work();
                live.fetch_sub(1, Ordering::SeqCst);
            })
        }
    }

    #[test]
    fn where_the_system_has_no_more_threads_the_rest_of_the_program_still_has_some() {
        for (wanted, most, helpers) in [
            (64, 0, 0),
            (64, 3, 0),
            (64, SPARE, 0),
            (64, SPARE + 3, 3),
            // All would fit, and leave no room for others.
            (4, 3, 0),
            (4, SPARE + 2, 2),
            (4, SPARE + 3, 3),
        ] {
            let live = Arc::default();
            let system = System { live, most };
            let team = Team::start(0, wanted, |_, work| system.spawn(work));
            let mut team = team.unwrap();
            assert_eq!(team.threads(), helpers + 1, "{most}");
            let (ends, others): (Vec<_>, Vec<_>) = (helpers..most)
                .map(|_| {
                    let (end, ended) = std::sync::mpsc::channel::<()>();
                    let waits = move || {
                        let _ = ended.recv();
                    };
                    (end, system.spawn(waits).unwrap())
                })
                .unzip();
            assert!(others.len() >= SPARE.min(most), "{most}");
            assert!(system.spawn(|| ()).is_err(), "{most}");
            let track = Arc::new(Track::new(Meeting {
                wanted: helpers + 1,
                came: AtomicUsize::new(0),
                threads: Mutex::default(),
            }));
            // SAFETY: this work shares nothing but atomics and a lock.
            unsafe { team.run(&track) };
            drop((ends, team));
            others.into_iter().for_each(|other| other.join().unwrap());
            assert_eq!(system.live.load(Ordering::SeqCst), 0, "{most}");
        }
    }

    #[test]
    fn what_else_the_system_refuses_is_said() {
        let refused = Team::start(0, 4, |helper, work| match helper {
            3 => Err(std::io::ErrorKind::PermissionDenied.into()),
            _ => std::thread::Builder::new().spawn(work),
        });
        let kind = refused.err().unwrap().kind();
        assert_eq!(kind, std::io::ErrorKind::PermissionDenied);
    }

    #[test]
    fn as_many_threads_take_part_as_are_wanted() {
        let mut team = Team::new(0, 4).unwrap();
        for wanted in [1, 3, 2, 4, 1] {
            team.use_threads(wanted);
            for _ in 0..20 {
                let track = Arc::new(Track::new(Meeting {
                    wanted,
                    came: AtomicUsize::new(0),
                    threads: Mutex::default(),
                }));
                // SAFETY: this work shares nothing but atomics and a lock.
                unsafe { team.run(&track) };
                assert_eq!(track.work.threads.lock().unwrap().len(), wanted);
            }
        }
        assert_eq!(team.threads(), 4);
    }

    #[test]
    fn one_team_serves_tracks_in_turn() {
        let new = |steps| {
            let counters = (0..steps).map(|_| AtomicUsize::new(0)).collect();
            Arc::new(Track::new(Counting(counters)))
        };
        let tracks = [new(3), new(5)];
        let mut team = Team::new(0, 3).unwrap();
        for i in 0..200 {
            // SAFETY: this work shares nothing but atomics.
            unsafe { team.run(&tracks[i % 3 % 2]) };
        }
        for (track, frames) in tracks.iter().zip([133, 67]) {
            for (step, counter) in track.work.0.iter().enumerate() {
                assert_eq!(counter.load(Ordering::Relaxed), frames * (step + 1));
            }
        }
    }
}
