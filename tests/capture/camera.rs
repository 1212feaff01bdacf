//! Cameras without a camera: formats, modes, the lock, the lens, and every way of going away.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use edgecap::camera::{CameraFile, Clock, monotonic_ns};
use edgecap::capture::camera::{
    CameraPort, CameraStream, InstanceLock, Live, Mode, PictureDecoder, PixelFormat, RawLayout,
    Step, choose_mode,
};
use edgecap::capture::{
    AviWriter, Brightness, CameraSource, CaptureError, Frame, InputSpec, Matrix, OpenOptions,
    Range, RawDecoder, RawPicture, Source, open,
};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use proptest::prelude::*;

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

/// What is said while `work` is done.
fn said(work: impl FnOnce()) -> String {
    #[derive(Clone, Default)]
    struct Said(Arc<Mutex<Vec<u8>>>);
    impl io::Write for Said {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().extend(bytes);
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let said = Said::default();
    let to = said.clone();
    let log = tracing_subscriber::fmt()
        .with_writer(move || to.clone())
        .finish();
    tracing::subscriber::with_default(log, work);
    let said = said.0.lock().unwrap();
    String::from_utf8(said.clone()).unwrap()
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
fn devices_that_are_no_camera_are_refused() {
    for (path, code) in [("/dev/null", 65), ("/dev/video4095", 69)] {
        let error = open(&InputSpec::Path(path.into()), &OpenOptions::default())
            .err()
            .unwrap();
        assert_eq!(error.exit_code(), code, "{error}");
        assert!(error.to_string().contains(path));
    }
}

#[test]
fn one_program_per_camera() {
    let folder = tempfile::tempdir().unwrap();
    let acquire = |key| InstanceLock::acquire_in(folder.path(), key);
    let first = acquire("/dev/video0").unwrap();
    assert!(first.is_held());
    let error = acquire("/dev/video0").unwrap_err();
    assert_eq!(error.exit_code(), 75);
    let text = error.to_string();
    assert!(
        text.contains("/dev/video0") && text.contains(&format!("process {}", std::process::id())),
        "{text}"
    );
    assert!(acquire("/dev/video1").unwrap().is_held());
    drop(first);
    assert!(acquire("/dev/video0").unwrap().is_held());
}

/// Where everybody may write, anybody could keep a camera from its owner for ever.
#[test]
fn a_lock_that_others_can_take_is_none() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let everyones = std::fs::Permissions::from_mode(0o777);
    std::fs::set_permissions(folder.path(), everyones).unwrap();
    let path = folder.path().join("edgecap-dev-video0.lock");
    let strangers = std::fs::File::create(path).unwrap();
    strangers.lock().unwrap();
    let lock = InstanceLock::acquire_in(folder.path(), "/dev/video0").unwrap();
    assert!(!lock.is_held());
}

#[test]
fn a_lock_given_back_is_free_while_a_neighbour_starts_programs() {
    let folder = tempfile::tempdir().unwrap();
    let started = std::sync::atomic::AtomicBool::new(true);
    std::thread::scope(|s| {
        s.spawn(|| {
            // A child has all open files of its parent until it becomes another program.
            for _ in 0..100 {
                std::process::Command::new("true").status().unwrap();
            }
            started.store(false, std::sync::atomic::Ordering::Relaxed);
        });
        while started.load(std::sync::atomic::Ordering::Relaxed) {
            let lock = InstanceLock::acquire_in(folder.path(), "/dev/video0").unwrap();
            assert!(lock.is_held());
        }
    });
}

#[test]
fn a_lock_file_that_is_a_link_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let victim = folder.path().join("victim");
    std::fs::write(&victim, "precious").unwrap();
    std::os::unix::fs::symlink(&victim, folder.path().join("edgecap-dev-video0.lock")).unwrap();
    let lock = InstanceLock::acquire_in(folder.path(), "/dev/video0").unwrap();
    assert!(!lock.is_held());
    assert_eq!(std::fs::read_to_string(&victim).unwrap(), "precious");
}

fn mode(format: PixelFormat, width: u32, height: u32, fps: f64) -> Mode {
    Mode {
        format,
        fourcc: *b"....",
        width,
        height,
        fps,
    }
}

#[test]
fn modes_are_chosen_for_rate_size_and_cost() {
    use PixelFormat::{Mjpeg, Nv12, Yuyv};
    // A common USB 2 webcam: large pictures are fast with MJPEG only.
    let webcam = [
        mode(Yuyv, 640, 480, 30.0),
        mode(Yuyv, 1280, 720, 10.0),
        mode(Yuyv, 160, 120, 60.0),
        mode(Mjpeg, 640, 480, 30.0),
        mode(Mjpeg, 1280, 720, 30.0),
        mode(Mjpeg, 1920, 1080, 30.0),
    ];
    assert_eq!(choose_mode(&webcam, (1280, 720), 30.0), Some(webcam[4]));
    assert_eq!(choose_mode(&webcam, (640, 480), 30.0), Some(webcam[0]));
    assert_eq!(choose_mode(&webcam, (1280, 720), 10.0), Some(webcam[1]));
    assert_eq!(choose_mode(&webcam, (4000, 3000), 30.0), Some(webcam[5]));
    // Without MJPEG a smaller picture at full rate is better than a slide show.
    assert_eq!(
        choose_mode(&webcam[..3], (1280, 720), 30.0),
        Some(webcam[0])
    );
    // A driver that keeps its rates to itself is not passed over.
    let silent = [mode(Nv12, 1280, 720, 0.0), mode(Yuyv, 1280, 720, 15.0)];
    assert_eq!(choose_mode(&silent, (1280, 720), 30.0), Some(silent[0]));
    assert_eq!(choose_mode(&[], (1280, 720), 30.0), None);
}

fn layout(format: PixelFormat, width: u32, height: u32, stride: u32) -> RawLayout {
    RawLayout {
        format,
        width,
        height,
        stride,
        matrix: Matrix::Bt601,
        range: Range::Limited,
    }
}

const FORMATS: [PixelFormat; 8] = [
    PixelFormat::Yuyv,
    PixelFormat::Uyvy,
    PixelFormat::Nv12,
    PixelFormat::Yu12,
    PixelFormat::Grey,
    PixelFormat::Rgb24,
    PixelFormat::Bgr24,
    PixelFormat::Mjpeg,
];

#[test]
fn raw_buffers_have_a_brightness_without_being_decoded() {
    let mut decoder = RawDecoder::default();
    for format in FORMATS.into_iter().filter(|f| *f != PixelFormat::Mjpeg) {
        for (w, h) in [(1, 1), (3, 5), (200, 100)] {
            let layout = PictureDecoder::new(layout(format, w, h, 0)).unwrap();
            let mut raw = RawPicture {
                layout: layout.layout(),
                // Chroma, red, blue and what follows a row's last pixel are no brightness.
                bytes: vec![33; layout.needed_bytes()],
                ..RawPicture::default()
            };
            let (first, step) = match format {
                PixelFormat::Yuyv => (0, 2),
                PixelFormat::Uyvy => (1, 2),
                PixelFormat::Rgb24 | PixelFormat::Bgr24 => (1, 3),
                _ => (0, 1),
            };
            let stride = raw.layout.stride as usize;
            for row in raw.bytes.chunks_mut(stride).take(h as usize) {
                for pixel in 0..w as usize {
                    row[first + step * pixel] = 90;
                }
            }
            let mut brightness = Brightness::default();
            decoder.brightness(&raw, &mut brightness).unwrap();
            assert!(
                brightness.cells.iter().all(|c| *c == 90.0),
                "{format:?} {w}x{h}"
            );
            raw.bytes.pop();
            let error = decoder.brightness(&raw, &mut brightness).unwrap_err();
            assert!(error.contains("bytes of a picture"), "{error}");
        }
    }
}

#[test]
fn raw_buffers_become_pictures() {
    let mut frame = Frame::default();
    // Rows with padding, the last one cut after its pixels, as drivers may do.
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Rgb24, 2, 2, 8)).unwrap();
    let bytes = [1, 2, 3, 4, 5, 6, 0, 0, 7, 8, 9, 10, 11, 12];
    decoder.decode(&bytes, &mut frame).unwrap();
    assert_eq!(frame.rgb, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);

    // White, black; without chroma.
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Yuyv, 2, 1, 0)).unwrap();
    decoder.decode(&[235, 128, 16, 128], &mut frame).unwrap();
    assert_eq!(frame.rgb, [255, 255, 255, 0, 0, 0]);
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Nv12, 2, 2, 2)).unwrap();
    decoder
        .decode(&[235, 16, 16, 235, 128, 128], &mut frame)
        .unwrap();
    assert_eq!(frame.rgb[..6], [255, 255, 255, 0, 0, 0]);
    assert_eq!(decoder.layout().stride, 2);

    let mut decoder = PictureDecoder::new(layout(PixelFormat::Uyvy, 2, 1, 0)).unwrap();
    decoder.decode(&[128, 235, 128, 16], &mut frame).unwrap();
    assert_eq!(frame.rgb, [255, 255, 255, 0, 0, 0]);
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Yu12, 2, 2, 4)).unwrap();
    let planes = [235, 16, 0, 0, 16, 235, 0, 0, 128, 0, 128, 0];
    decoder.decode(&planes, &mut frame).unwrap();
    assert_eq!(frame.rgb, [255, 255, 255, 0, 0, 0, 0, 0, 0, 255, 255, 255]);
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Grey, 2, 2, 3)).unwrap();
    decoder.decode(&[235, 16, 9, 16, 235], &mut frame).unwrap();
    assert_eq!(frame.rgb, [255, 255, 255, 0, 0, 0, 0, 0, 0, 255, 255, 255]);
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Bgr24, 2, 1, 0)).unwrap();
    decoder.decode(&[1, 2, 3, 4, 5, 6], &mut frame).unwrap();
    assert_eq!(frame.rgb, [3, 2, 1, 6, 5, 4]);

    for format in FORMATS {
        for (w, h) in [(1, 1), (3, 5), (6, 2)] {
            let mut decoder = PictureDecoder::new(layout(format, w, h, 0)).unwrap();
            let needed = decoder.needed_bytes();
            for bytes in 0..needed {
                let error = decoder.decode(&vec![0; bytes], &mut frame).unwrap_err();
                assert!(error.contains("bytes"), "{error}");
            }
            let whole = decoder.decode(&vec![0; needed], &mut frame);
            assert_eq!(
                whole.is_ok(),
                format != PixelFormat::Mjpeg,
                "{format:?} {w}x{h}"
            );
        }
    }
    assert!(PictureDecoder::new(layout(PixelFormat::Yuyv, 640, 480, 640)).is_err());
    assert!(PictureDecoder::new(layout(PixelFormat::Yuyv, 0, 480, 0)).is_err());
    assert_eq!(PixelFormat::from_fourcc(*b"H264"), None);
}

/// A small JPEG, as a camera would send it.
fn jpeg() -> Vec<u8> {
    let picture = Frame {
        width: 16,
        height: 8,
        rgb: vec![90; 3 * 16 * 8],
        ..Frame::default()
    };
    let mut writer = AviWriter::new(io::Cursor::new(Vec::new()), 16, 8, (30, 1)).unwrap();
    writer.write_frame(&picture, 90).unwrap();
    let avi = writer.finish().unwrap().into_inner();
    let start = avi.windows(2).position(|w| w == [0xFF, 0xD8]).unwrap();
    let end = avi.windows(2).position(|w| w == [0xFF, 0xD9]).unwrap() + 2;
    avi[start..end].to_vec()
}

#[test]
fn motion_jpeg_with_rubbish_behind_it_is_decoded() {
    let mut buffer = jpeg();
    let end = buffer.len();
    buffer.extend_from_slice(&[0; 5000]);
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Mjpeg, 16, 8, 0)).unwrap();
    let mut frame = Frame::default();
    decoder.decode(&buffer, &mut frame).unwrap();
    assert_eq!((frame.width, frame.height), (16, 8));
    assert!(frame.rgb.iter().all(|v| v.abs_diff(90) < 3));
    // Cut short by a lost packet: the picture is drawn as far as it goes.
    decoder.decode(&buffer[..end - 2], &mut frame).unwrap();
}

#[test]
fn motion_jpeg_of_another_size_than_agreed_is_damaged() {
    let mut frame = Frame::default();
    let of_size = |width: u32, height: u32| {
        let mut bytes = Vec::new();
        let rgb = vec![90; 3 * (width * height) as usize];
        JpegEncoder::new(&mut bytes)
            .encode(&rgb, width, height, ExtendedColorType::Rgb8)
            .unwrap();
        bytes
    };
    let agreed = layout(PixelFormat::Mjpeg, 64, 45, 0);
    let mut decoder = PictureDecoder::new(agreed).unwrap();
    // Of a camera that has never kept to the size all are taken.
    assert!(decoder.decode(&of_size(32, 24), &mut frame).is_ok());
    for (width, height, fits) in [
        (64, 45, true),
        // A camera that sends whole blocks, and one that sends less.
        (64, 48, true),
        (72, 40, true),
        (32, 24, false),
        (64, 480, false),
        (640, 45, false),
        (64, 45, true),
    ] {
        let decoded = decoder.decode(&of_size(width, height), &mut frame);
        assert_eq!(decoded.is_ok(), fits, "{width}x{height}");
        if fits {
            let size = (frame.width, frame.height);
            assert_eq!(size, (width.min(64), height.min(45)));
            assert_eq!(frame.rgb.len(), 3 * (size.0 * size.1) as usize);
        }
        if let Err(why) = decoded {
            let expected = format!("expected a picture of 64x45, found one of {width}x{height}");
            assert!(why.contains(&expected), "{why}");
        }
    }
}

#[test]
fn what_fills_up_the_blocks_of_motion_jpeg_is_cut_off() {
    let mut bytes = Vec::new();
    let dark_outside = |k: u32| match k % 48 < 40 && k / 48 < 24 {
        true => [200; 3],
        false => [0; 3],
    };
    let rgb: Vec<u8> = (0..48 * 32).flat_map(dark_outside).collect();
    JpegEncoder::new_with_quality(&mut bytes, 95)
        .encode(&rgb, 48, 32, ExtendedColorType::Rgb8)
        .unwrap();
    let agreed = layout(PixelFormat::Mjpeg, 40, 24, 0);
    let mut frame = Frame::default();
    let mut decoder = PictureDecoder::new(agreed).unwrap();
    decoder.decode(&bytes, &mut frame).unwrap();
    assert_eq!((frame.width, frame.height), (40, 24));
    assert_eq!(frame.rgb.len(), 3 * 40 * 24);
    assert!(frame.rgb.iter().all(|v| *v > 150), "{:?}", frame.rgb);
}

#[test]
fn the_matrix_of_a_layout_is_used() {
    let of = |matrix| {
        let layout = RawLayout {
            matrix,
            ..layout(PixelFormat::Yuyv, 2, 1, 0)
        };
        let mut frame = Frame::default();
        let mut decoder = PictureDecoder::new(layout).unwrap();
        decoder.decode(&[80, 90, 80, 200], &mut frame).unwrap();
        frame.rgb
    };
    let (sd, hd) = (of(Matrix::Bt601), of(Matrix::Bt709));
    // Red by 1.596 and 1.793 times the chroma's 72.
    assert!(
        sd[0].abs_diff(190) <= 1 && hd[0].abs_diff(204) <= 1,
        "{sd:?} {hd:?}"
    );
}

#[test]
fn the_lens_scales_with_the_picture() {
    let default = CameraFile::default().for_frame(640, 480).unwrap();
    assert!((default.fx - 320.0 / 30f32.to_radians().tan()).abs() < 1e-2);
    assert_eq!((default.cx, default.cy), (319.5, 239.5));

    let file = CameraFile::parse(
        "fx = 1000.0\nfy = 990.0\ncx = 639.5\ncy = 359.5\nwidth = 1280\nheight = 720\n",
    )
    .unwrap();
    let same = file.for_frame(1280, 720).unwrap();
    assert_eq!(
        (same.fx, same.fy, same.cx, same.cy),
        (1000.0, 990.0, 639.5, 359.5)
    );
    let half = file.for_frame(640, 360).unwrap();
    assert_eq!(
        (half.fx, half.fy, half.cx, half.cy),
        (500.0, 495.0, 319.5, 179.5)
    );
    // A ray through the same point of the scene stays the same ray.
    let (a, b) = (
        same.ray(200.0, 100.0),
        half.ray(200.5 / 2.0 - 0.5, 100.5 / 2.0 - 0.5),
    );
    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6));
    assert!(file.for_frame(640, 480).unwrap_err().contains("1280x720"));

    let wide = CameraFile::parse("fov_degrees = 90.0")
        .unwrap()
        .for_frame(200, 100)
        .unwrap();
    assert!((wide.fx - 100.0).abs() < 1e-3);
}

#[test]
fn a_lens_keeps_its_distortion_in_the_file() {
    let plain = "fx = 900.0\ncx = 300.0\ncy = 200.0\nwidth = 640\nheight = 480\n";
    let bent = format!("{plain}k1 = -0.2\nk2 = 0.1\np1 = 0.001\np2 = -0.002\nk3 = 0.01\n");
    let lens = CameraFile::parse(&bent).unwrap();
    assert_eq!(lens.distortion().radial, [-0.2, 0.1, 0.01]);
    assert_eq!(lens.distortion().tangential, [0.001, -0.002]);
    assert_eq!(
        CameraFile::parse(&toml::to_string(&lens).unwrap()),
        Ok(lens)
    );
    let straight = CameraFile::parse(plain).unwrap();
    assert!(!toml::to_string(&straight).unwrap().contains("k1"));
    for wrong in [
        format!("{plain}k1 = nan"),
        "fov_degrees = 60.0\nk1 = 0.1".into(),
    ] {
        CameraFile::parse(&wrong).unwrap_err();
    }
}

#[test]
fn the_help_names_what_a_camera_file_may_hold() {
    let keys = [
        ("fov_degrees", "fov_degrees = 70.0"),
        (
            "fx, fy, cx, cy, width, height",
            "fx = 9.0\nfy = 9.0\ncx = 3.0\ncy = 2.0\nwidth = 8\nheight = 6",
        ),
    ];
    for verb in ["run", "infer", "fit"] {
        let help = std::process::Command::new(env!("CARGO_BIN_EXE_edgecap"))
            .args([verb, "--help"])
            .output()
            .unwrap();
        let words: Vec<String> = String::from_utf8(help.stdout)
            .unwrap()
            .split_whitespace()
            .map(String::from)
            .collect();
        let help = words.join(" ");
        for (named, text) in keys {
            assert!(help.contains(named), "{verb} --help does not name {named}");
            CameraFile::parse(text).unwrap();
        }
    }
}

#[test]
fn wrong_camera_files_are_refused_with_a_reason() {
    for (text, word) in [
        ("", "either fov_degrees"),
        ("fov_degrees = 200.0", "1 to 179"),
        ("fov_degrees = 60.0\nfx = 3.0", "either fov_degrees"),
        ("fx = 1000.0\ncx = 1.0\ncy = 1.0", "width"),
        (
            "fx = 1000.0\ncx = 9999.0\ncy = 1.0\nwidth = 100\nheight = 100",
            "principal point",
        ),
        (
            "fx = nan\ncx = 9.0\ncy = 1.0\nwidth = 100\nheight = 100",
            "focal",
        ),
        ("fov_degrees = 60.0\nzoom = 2", "line 2"),
        ("fov_degrees = \"wide\"", "line 1"),
        ("][", "line 1"),
    ] {
        let error = CameraFile::parse(text).unwrap_err();
        assert!(
            error.contains(word) && !error.contains('\n'),
            "{text:?}: {error}"
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.toml");
    assert_eq!(CameraFile::read(&path).unwrap_err().exit_code(), 66);
    std::fs::write(&path, "nothing = true").unwrap();
    let error = CameraFile::read(&path).unwrap_err();
    assert_eq!(error.exit_code(), 78);
    assert!(error.to_string().contains("camera.toml"));
}

#[test]
fn the_clock_runs_forward() {
    let a = monotonic_ns();
    let b = monotonic_ns();
    assert!(a > 0 && b >= a);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn damaged_motion_jpeg_never_panics(
        cut in 0usize..2000,
        hits in prop::collection::vec((0usize..2000, any::<u8>()), 0..8),
    ) {
        let mut bytes = jpeg();
        let n = bytes.len();
        for (at, value) in hits {
            bytes[at % n] = value;
        }
        bytes.truncate(cut.clamp(4, n));
        let mut decoder = PictureDecoder::new(layout(PixelFormat::Mjpeg, 16, 8, 0)).unwrap();
        let mut frame = Frame::default();
        if decoder.decode(&bytes, &mut frame).is_ok() {
            prop_assert_eq!(frame.rgb.len(), 3 * (frame.width * frame.height) as usize);
        }
    }
}
