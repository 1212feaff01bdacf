//! Every way of going away, and of coming back: a camera that follows a script, on a clock of its own.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use edgecap::camera::{Clock, monotonic_ns};
use edgecap::capture::PixelFormat;
use edgecap::capture::camera::{CameraPort, CameraStream, Live, Step};
use edgecap::capture::{CameraSource, CaptureError, Frame, RawPicture, Source};

use super::layout;
use crate::said::said;

/// What the fake camera does next.
#[derive(Debug)]
enum Act {
    /// A picture with this count.
    Picture(u32),
    /// One with this count that cannot be decoded.
    Damaged(u32),
    /// Nothing for as long as the step waits.
    Silence,
    /// This system error.
    Fail(i32),
}

/// What opening does next.
enum Opening {
    Works(Vec<Act>),
    Fails,
    /// Not permitted, for this reason.
    Forbidden(&'static str),
}

#[derive(Clone)]
struct FakeClock(Arc<Mutex<Instant>>);

impl FakeClock {
    fn new() -> Self {
        Self(Arc::new(Mutex::new(Instant::now())))
    }
}

impl Clock for FakeClock {
    fn now(&self) -> Instant {
        *self.0.lock().unwrap()
    }

    fn sleep(&self, duration: Duration) {
        *self.0.lock().unwrap() += duration;
    }
}

struct FakePort {
    openings: VecDeque<Opening>,
    /// Pictures a second that it promises.
    fps: f64,
    clock: FakeClock,
    /// When each opening was tried, and how many streams are open.
    log: Arc<Mutex<Vec<Instant>>>,
    alive: Arc<Mutex<i32>>,
}

struct FakeStream {
    acts: VecDeque<Act>,
    fps: f64,
    clock: FakeClock,
    alive: Arc<Mutex<i32>>,
}

impl Drop for FakeStream {
    fn drop(&mut self) {
        *self.alive.lock().unwrap() -= 1;
    }
}

impl CameraPort for FakePort {
    fn open(&mut self) -> Result<Box<dyn CameraStream>, CaptureError> {
        self.log.lock().unwrap().push(self.clock.now());
        assert_eq!(*self.alive.lock().unwrap(), 0, "opened while still open");
        match self.openings.pop_front() {
            Some(Opening::Works(acts)) => {
                *self.alive.lock().unwrap() += 1;
                Ok(Box::new(FakeStream {
                    acts: acts.into(),
                    fps: self.fps,
                    clock: self.clock.clone(),
                    alive: self.alive.clone(),
                }))
            }
            Some(Opening::Forbidden(remedy)) => Err(CaptureError::Permission {
                input: "fake".into(),
                remedy: remedy.into(),
            }),
            _ => Err(CaptureError::Unavailable {
                what: "fake".into(),
                reason: "not there".into(),
            }),
        }
    }

    fn name(&self) -> &str {
        "fake"
    }
}

impl CameraStream for FakeStream {
    fn newest(&mut self, timeout: Duration, raw: &mut RawPicture) -> io::Result<Option<u32>> {
        match self.acts.pop_front() {
            Some(Act::Picture(count)) => {
                self.clock.sleep(Duration::from_millis(33));
                raw.take_over(&mut Frame {
                    rgb: vec![count as u8; 3],
                    width: 1,
                    height: 1,
                    ..Frame::default()
                });
                Ok(Some(count))
            }
            Some(Act::Damaged(count)) => {
                self.clock.sleep(Duration::from_millis(33));
                raw.layout = layout(PixelFormat::Mjpeg, 1, 1, 0);
                raw.bytes = vec![0xFF, 0xD8, 0, 0, 0, 0];
                Ok(Some(count))
            }
            Some(Act::Fail(code)) => Err(io::Error::from_raw_os_error(code)),
            Some(Act::Silence) | None => {
                self.clock.sleep(timeout);
                Ok(None)
            }
        }
    }

    fn fps(&self) -> Option<f64> {
        Some(self.fps)
    }
}

/// A state machine over a script, its clock, and the times of its openings.
fn live(
    openings: Vec<Opening>,
) -> (
    Live<FakePort, FakeClock>,
    FakeClock,
    Arc<Mutex<Vec<Instant>>>,
) {
    live_at(30.0, openings)
}

/// The same of a camera that promises so many pictures a second.
fn live_at(
    fps: f64,
    openings: Vec<Opening>,
) -> (
    Live<FakePort, FakeClock>,
    FakeClock,
    Arc<Mutex<Vec<Instant>>>,
) {
    let clock = FakeClock::new();
    let log = Arc::new(Mutex::new(Vec::new()));
    let port = FakePort {
        openings: openings.into(),
        fps,
        clock: clock.clone(),
        log: log.clone(),
        alive: Arc::default(),
    };
    (Live::new(port, clock.clone()).unwrap(), clock, log)
}

/// Steps until a picture comes; its sequence and the reasons before it.
fn next_picture(live: &mut Live<FakePort, FakeClock>) -> (u64, Vec<String>) {
    let mut raw = RawPicture::default();
    let mut reasons = Vec::new();
    for _ in 0..1000 {
        match live.step(&mut raw) {
            Step::Picture => return (raw.sequence, reasons),
            Step::Waiting(reason) => reasons.push(reason),
        }
    }
    panic!("no picture: {reasons:?}");
}

#[test]
fn unplugged_then_back() {
    let (mut live, _, log) = live(vec![
        Opening::Works(vec![
            Act::Picture(0),
            Act::Picture(1),
            Act::Fail(libc::ENODEV),
        ]),
        Opening::Fails,
        Opening::Fails,
        Opening::Works(vec![Act::Silence, Act::Picture(0), Act::Picture(1)]),
    ]);
    assert_eq!(next_picture(&mut live).0, 0);
    assert_eq!(next_picture(&mut live).0, 1);
    assert!(live.is_streaming() && live.fps() == Some(30.0));
    assert!(
        matches!(live.step(&mut RawPicture::default()), Step::Waiting(r) if r.contains("unplugged"))
    );
    assert!(!live.is_streaming() && live.fps().is_none());
    let (sequence, reasons) = next_picture(&mut live);
    assert!(
        reasons.iter().any(|r| r.contains("unplugged")),
        "{reasons:?}"
    );
    assert_eq!(sequence, 3, "the gap shows as one lost picture");
    assert_eq!(next_picture(&mut live).0, 4);
    assert_eq!(log.lock().unwrap().len(), 4);
}

#[test]
fn every_error_leads_to_reopening() {
    for code in [
        libc::EIO,
        libc::EINVAL,
        libc::EPROTO,
        libc::ENODEV,
        libc::EPIPE,
    ] {
        let (mut live, _, _) = live(vec![
            Opening::Works(vec![Act::Fail(code)]),
            Opening::Works(vec![Act::Picture(7)]),
        ]);
        assert_eq!(next_picture(&mut live).0, 0, "error {code}");
    }
}

#[test]
fn why_a_camera_cannot_be_opened_again_is_said_once_and_when_it_changes() {
    let text = said(|| {
        let (mut live, _, _) = live(vec![
            Opening::Works(vec![Act::Fail(libc::ENODEV)]),
            Opening::Fails,
            Opening::Fails,
            Opening::Forbidden("ask"),
            Opening::Forbidden("ask"),
            Opening::Forbidden("ask again"),
            Opening::Works(vec![Act::Picture(0)]),
        ]);
        next_picture(&mut live);
    });
    let why = text
        .lines()
        .filter(|l| l.contains("cannot be opened again"));
    let why: Vec<&str> = why.collect();
    assert_eq!(why.len(), 2, "{text}");
    assert!(why[0].ends_with("; ask") && why[1].ends_with("; ask again"));
}

#[test]
fn waits_grow_to_a_limit() {
    let mut openings = vec![Opening::Works(vec![Act::Fail(libc::ENODEV)])];
    openings.extend((0..8).map(|_| Opening::Fails));
    openings.push(Opening::Works(vec![Act::Picture(0)]));
    let (mut live, _, log) = live(openings);
    next_picture(&mut live);
    let log = log.lock().unwrap();
    let waits: Vec<u128> = log.windows(2).map(|w| (w[1] - w[0]).as_millis()).collect();
    assert_eq!(waits, [250, 500, 1000, 2000, 2000, 2000, 2000, 2000, 2000]);
}

/// A camera whose cable or driver is at fault: it opens, and that is all.
#[test]
fn a_camera_that_opens_and_sends_nothing_is_opened_less_and_less_often() {
    let mut openings = vec![Opening::Works(vec![Act::Picture(0)])];
    openings.extend((0..6).map(|_| Opening::Works(vec![])));
    openings.push(Opening::Works(vec![Act::Picture(0)]));
    openings.push(Opening::Works(vec![Act::Picture(0)]));
    let (mut live, _, log) = live(openings);
    for _ in 0..3 {
        next_picture(&mut live);
    }
    let log = log.lock().unwrap();
    let waits = log.windows(2).map(|w| (w[1] - w[0]).as_millis() - 3000);
    // The first picture took 33 ms. After a picture all is as at first.
    let expected = [283, 500, 1000, 2000, 2000, 2000, 2000, 283];
    assert_eq!(waits.collect::<Vec<_>>(), expected);
}

#[test]
fn no_step_takes_long() {
    let (mut live, clock, _) = live(vec![Opening::Works(vec![]), Opening::Fails, Opening::Fails]);
    for _ in 0..100 {
        let before = clock.now();
        live.step(&mut RawPicture::default());
        assert!(clock.now() - before <= Duration::from_millis(250));
    }
}

#[test]
fn a_silent_camera_is_opened_again() {
    let (mut live, clock, _) = live(vec![
        Opening::Works(vec![Act::Picture(0)]),
        Opening::Works(vec![Act::Picture(0)]),
    ]);
    next_picture(&mut live);
    let before = clock.now();
    let (_, reasons) = next_picture(&mut live);
    let waited = clock.now() - before;
    assert!(
        reasons.iter().any(|r| r == "no picture for 3 s"),
        "{reasons:?}"
    );
    assert!(
        (Duration::from_secs(3)..Duration::from_secs(4)).contains(&waited),
        "{waited:?}"
    );
}

/// Silence for 5 s, as steps of a quarter of a second find it.
fn five_seconds() -> impl Iterator<Item = Act> {
    (0..20).map(|_| Act::Silence)
}

#[test]
fn a_slow_camera_is_not_silent_between_its_pictures() {
    let acts = (0..4).flat_map(|n| [Act::Picture(n)].into_iter().chain(five_seconds()));
    let again = Opening::Works(vec![Act::Picture(0)]);
    let (mut live, clock, log) = live_at(0.2, vec![Opening::Works(acts.collect()), again]);
    for n in 0..4 {
        assert_eq!(next_picture(&mut live).0, n);
    }
    assert_eq!(log.lock().unwrap().len(), 1, "never opened again");
    let before = clock.now();
    next_picture(&mut live);
    let waited = (clock.now() - before).as_secs_f64();
    assert!((12.5..13.5).contains(&waited), "2.5 intervals: {waited}");
}

#[test]
fn rates_that_are_none_leave_the_usual_patience() {
    for fps in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let again = Opening::Works(vec![Act::Picture(0)]);
        let (mut live, clock, _) = live_at(fps, vec![Opening::Works(vec![]), again]);
        let before = clock.now();
        next_picture(&mut live);
        let waited = (clock.now() - before).as_secs_f64();
        assert!((3.0..4.0).contains(&waited), "{fps}: {waited}");
    }
}

#[test]
fn a_few_damaged_pictures_of_a_slow_camera_do_not_close_it() {
    let acts = (0..9).flat_map(|n| {
        let act = match n % 3 {
            2 => Act::Picture(n),
            _ => Act::Damaged(n),
        };
        [act].into_iter().chain(five_seconds())
    });
    let (live, _, log) = live_at(0.2, vec![Opening::Works(acts.collect())]);
    take_good(&mut CameraSource::new(live), 3);
    assert_eq!(log.lock().unwrap().len(), 1, "never opened again");
}

/// With a small `--max-fps` few pictures are asked for, however many come.
#[test]
fn two_damaged_pictures_close_no_camera_that_is_seldom_asked() {
    let acts = vec![Act::Damaged(0), Act::Damaged(1), Act::Picture(2)];
    let (live, clock, log) = live(vec![Opening::Works(acts)]);
    let mut source = CameraSource::new(live);
    for _ in 0..2 {
        assert!(source.next_into(&mut Frame::default()).is_err());
        clock.sleep(Duration::from_secs(10));
    }
    take_good(&mut source, 1);
    assert_eq!(log.lock().unwrap().len(), 1, "never opened again");
}

/// With a small `--max-fps` nobody asks for seconds, and buffers that have been full for long are no news.
#[test]
fn a_camera_that_nobody_asks_is_not_silent() {
    let (mut live, clock, log) = live(vec![Opening::Works(vec![
        Act::Picture(0),
        Act::Silence,
        Act::Picture(1),
    ])]);
    next_picture(&mut live);
    clock.sleep(Duration::from_secs(10));
    let (_, reasons) = next_picture(&mut live);
    assert_eq!(reasons, ["no picture yet"]);
    assert_eq!(log.lock().unwrap().len(), 1, "never opened again");
}

/// Takes this many pictures that can be decoded.
fn take_good(source: &mut CameraSource<FakePort, FakeClock>, pictures: usize) {
    let (mut good, mut frame) = (0, Frame::default());
    for _ in 0..10_000 {
        match source.next_into(&mut frame) {
            Ok(more) => {
                assert!(more);
                good += 1;
            }
            Err(e) => assert!(e.is_skippable(), "{e}"),
        }
        if good == pictures {
            return;
        }
    }
    panic!("{good} of {pictures} pictures");
}

#[test]
fn a_camera_whose_pictures_cannot_be_decoded_is_opened_again() {
    let damaged = || (0..200).map(Act::Damaged).collect::<Vec<_>>();
    let mut first = vec![Act::Picture(0)];
    first.extend(damaged());
    let mut openings = vec![Opening::Works(first)];
    openings.extend((0..3).map(|_| Opening::Works(damaged())));
    openings.push(Opening::Works(vec![Act::Picture(0)]));
    openings.push(Opening::Works(vec![Act::Picture(0)]));
    let (live, _, log) = live(openings);
    let text = said(|| take_good(&mut CameraSource::new(live), 3));
    let log = log.lock().unwrap();
    let waits = log.windows(2).map(|w| (w[1] - w[0]).as_millis());
    let waits: Vec<u128> = waits.collect();
    // 3 s of pictures, of 33 ms each, then as after silence; with the good one all is as at first.
    for (wait, expected) in waits.iter().zip([3250, 3500, 4000, 5000, 3250]) {
        assert!(wait.abs_diff(expected) < 100, "{waits:?}");
    }
    assert_eq!(waits.len(), 5);
    let told = |words: &str| text.lines().filter(|l| l.contains(words)).count();
    assert_eq!(told("sends pictures that cannot be decoded"), 1, "{text}");
    assert_eq!(told("camera is back"), 2, "{text}");
}

#[test]
fn a_few_pictures_that_cannot_be_decoded_are_left_out() {
    let acts = (0..400).map(|n| match n % 50 {
        0 => Act::Picture(n),
        _ => Act::Damaged(n),
    });
    let (live, _, log) = live(vec![Opening::Works(acts.collect())]);
    take_good(&mut CameraSource::new(live), 8);
    assert_eq!(log.lock().unwrap().len(), 1, "never opened again");
}

#[test]
fn counts_that_wrap_or_start_anew_only_grow() {
    let counts = [u32::MAX - 2, u32::MAX, 1, 4, 2, 3, 0, 1_000_000];
    let acts = counts.into_iter().map(Act::Picture).collect();
    let (mut live, _, _) = live(vec![Opening::Works(acts)]);
    let seen: Vec<u64> = counts.iter().map(|_| next_picture(&mut live).0).collect();
    // Two lost at the wrap; backwards and absurd jumps count as one.
    assert_eq!(seen, [0, 2, 4, 7, 8, 9, 10, 11]);
}

#[test]
fn a_camera_that_is_absent_at_first_is_an_error() {
    let clock = FakeClock::new();
    let port = FakePort {
        openings: VecDeque::new(),
        fps: 30.0,
        clock: clock.clone(),
        log: Arc::default(),
        alive: Arc::default(),
    };
    assert_eq!(Live::new(port, clock).err().unwrap().exit_code(), 69);
}

#[test]
fn a_source_says_when_there_is_no_picture() {
    let (live, _, _) = live(vec![
        Opening::Works(vec![
            Act::Picture(0),
            Act::Silence,
            Act::Picture(1),
            Act::Fail(libc::ENODEV),
        ]),
        Opening::Fails,
        Opening::Works(vec![Act::Silence, Act::Picture(0), Act::Silence]),
    ]);
    let mut source = CameraSource::new(live);
    assert!(source.is_live() && source.frame_count().is_none());
    assert_eq!(source.next().unwrap().unwrap().rgb, [0; 3]);
    // Away from when it fails until its first picture, also while it is open again and sends nothing.
    let mut away_until_picture = || {
        let mut away = Vec::new();
        loop {
            match source.next() {
                Ok(picture) => break assert!(picture.is_some()),
                Err(CaptureError::NoPictureYet { is_away, .. }) => away.push(is_away),
                Err(e) => panic!("{e}"),
            }
        }
        away
    };
    assert_eq!(away_until_picture(), [false], "slow, and there");
    let away = away_until_picture();
    assert!(away.len() > 2 && away.iter().all(|a| *a), "{away:?}");
    let Err(slow) = source.next() else {
        panic!("a picture");
    };
    assert!(slow.is_skippable(), "{slow}");
    assert!(matches!(
        slow,
        CaptureError::NoPictureYet { is_away: false, .. }
    ));
}

#[test]
fn the_clock_runs_forward() {
    let a = monotonic_ns();
    let b = monotonic_ns();
    assert!(a > 0 && b >= a);
}
