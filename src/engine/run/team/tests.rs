//! Frames that fail on either side, systems without threads, and how many threads take part.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
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
