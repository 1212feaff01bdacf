//! One view's file: a record, JSON lines, or a film that is looked at first.

use std::ffi::OsString;
use std::io::{BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};

use tempfile::NamedTempFile;

use super::exit::{self, Failure};
use super::{say, threads};
use crate::camera::DEFAULT_FOV;
pub use crate::capture::is_film;
use crate::counted::counted;
use crate::message::{FLAG_FILE_TIME, Intrinsics, Observation, ObservationFrame};
use crate::record::clock::usual_rate;
use crate::record::{self, CameraSource, ObservationReader};
use crate::supervise::tie;

/// Frames a second beyond which times say nothing.
const MOST_RATE: f64 = 10_000.0;
/// Share of a view's rows out of order beyond which its times tell nothing.
const DISORDER: f64 = 0.1;
/// Pictures beyond which numbers are no film's: four days at 30 a second.
const MOST_PICTURES: u64 = 10_000_000;

/// One view over time.
#[derive(Clone)]
pub struct ViewFile {
    /// The camera.
    pub name: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// The pinhole of the first picture.
    pub intrinsics: Intrinsics,
    /// Everyone seen, by frame.
    pub frames: Vec<Vec<Observation>>,
    /// When every frame was taken, nanoseconds.
    pub times: Vec<u64>,
    /// The film's number of every frame's picture, rising; empty where frames are of no film. Numbers that lack are of
    /// pictures without a frame: damaged ones, and repetitions of the one before.
    pub numbers: Vec<u64>,
    /// Times are those of the machine's clock, which every frame of a live camera was published by; not of a film.
    pub of_machine: bool,
}

impl ViewFile {
    /// Reads what `camera` saw from JSON lines or a record; a film goes through `edgecap infer` first. `lens` tells its
    /// camera, `fov` its field of view for `infer`, degrees. Also how much of a film could be seen.
    ///
    /// # Errors
    /// When the file cannot be read, its pictures change size, or nobody is in it.
    pub fn read(
        camera: &str,
        lens: CameraSource<'_>,
        fov: f64,
        path: &Path,
    ) -> anyhow::Result<(Self, Looked)> {
        if !is_film(path) {
            let seen = Self::of_record(camera, lens, path, path)?;
            return Ok((seen, Looked::Whole));
        }
        let folder = tempfile::tempdir()?;
        let record = folder.path().join("observations");
        let looked = look(path, Some(fov), &record)?;
        if looked == Looked::InPart {
            say::err(&in_part(camera));
        }
        Ok((Self::of_record(camera, lens, &record, path)?, looked))
    }

    /// Reads what `camera` saw from JSON lines or a record, which is called `named` where something is wrong with it.
    ///
    /// # Errors
    /// When the file cannot be read, its pictures change size, or nobody is in it.
    pub fn of_record(
        camera: &str,
        lens: CameraSource<'_>,
        record: &Path,
        named: &Path,
    ) -> anyhow::Result<Self> {
        let file = record::open(record).map_err(|e| Failure::no_input(named, &e))?;
        let name = named.display().to_string();
        let mut reader = ObservationReader::new(BufReader::new(file), &name, lens);
        let mut seen = Self {
            name: camera.to_owned(),
            size: [0; 2],
            intrinsics: Intrinsics::default(),
            frames: Vec::new(),
            times: Vec::new(),
            numbers: Vec::new(),
            of_machine: true,
        };
        let mut is_of_film = true;
        let mut frame = ObservationFrame::default();
        while reader.read(&mut frame)? {
            let size = [frame.width, frame.height];
            if seen.frames.is_empty() {
                (seen.size, seen.intrinsics) = (size, frame.intrinsics);
            } else if seen.size != size {
                return Err(Failure::data(format!(
                    "{name}: expected pictures of one size, found {}x{} and {}x{}",
                    seen.size[0], seen.size[1], size[0], size[1]
                ))
                .into());
            }
            seen.frames.push(frame.people().to_vec());
            seen.times.push(frame.capture_ns);
            is_of_film &= frame.flags & FLAG_FILE_TIME != 0;
            is_of_film &= seen.numbers.last().is_none_or(|n| *n < frame.sequence);
            seen.numbers.push(frame.sequence);
            // Rows of other programs may tell neither flags nor when they were published.
            let is_live = frame.flags & FLAG_FILE_TIME == 0;
            seen.of_machine &= is_live && frame.publish_ns > frame.capture_ns;
        }
        match (seen.frames.is_empty(), reader.was_cut()) {
            (true, true) => {
                return Err(Failure::no_whole_frame(&name, "observations", true).into());
            }
            (true, false) => {
                return Err(Failure::data(format!(
                    "{name}: expected the frames of camera {camera}, found none"
                ))
                .into());
            }
            (false, true) => {
                tracing::warn!("{name}: cut off inside a frame; the frames before it are used");
            }
            (false, false) => {}
        }
        let [first, last] = [seen.numbers[0], seen.numbers[seen.numbers.len() - 1]];
        if !is_of_film || last - first > MOST_PICTURES {
            seen.numbers.clear();
        } else if is_film(named) {
            seen.begin_with_film();
        }
        if seen.frames.iter().all(Vec::is_empty) {
            return Err(Failure::data(format!(
                "{name}: expected people in the view of camera {}, found nobody in {}; leave the view out",
                camera,
                counted(seen.frames.len() as u64, "frame", "frames")
            ))
            .into());
        }
        Ok(seen)
    }

    /// Puts rows of nobody before the first one for the film's pictures there: by them it began.
    fn begin_with_film(&mut self) {
        let lacking = self.numbers[0];
        let (first, next) = (self.times[0], self.times.get(1).copied().unwrap_or(0));
        let pictures = self.numbers.get(1).map_or(1, |n| n - lacking);
        let step = next.saturating_sub(first) / pictures;
        let time = |k: u64| first.saturating_sub((lacking - k).saturating_mul(step));
        self.numbers.splice(0..0, 0..lacking);
        self.times.splice(0..0, (0..lacking).map(time));
        let nobody = (0..lacking).map(|_| Vec::new());
        self.frames.splice(0..0, nobody);
    }

    /// Puts a row of nobody, at a time between its neighbours, for every picture of its film that has no frame: frames
    /// of several views that go by number, and masks, are those of the films' pictures.
    pub fn fill(&mut self) {
        let numbers = std::mem::take(&mut self.numbers);
        if numbers.is_empty() {
            return;
        }
        let frames = std::mem::take(&mut self.frames);
        let times = std::mem::take(&mut self.times);
        for ((number, people), time) in numbers.into_iter().zip(frames).zip(times) {
            if let (Some(&before), Some(&since)) = (self.numbers.last(), self.times.last()) {
                let pictures = u128::from(number - before);
                let apart = u128::from(time.saturating_sub(since));
                for k in 1..number - before {
                    self.numbers.push(before + k);
                    self.frames.push(Vec::new());
                    self.times
                        .push(since + (apart * u128::from(k) / pictures) as u64);
                }
            }
            self.numbers.push(number);
            self.frames.push(people);
            self.times.push(time);
        }
    }

    /// Whether every frame was taken after the one before.
    pub fn is_in_order(&self) -> bool {
        self.times.windows(2).all(|w| w[0] < w[1])
    }

    /// How many rows are out of the order of the others' times.
    pub fn disorder(&self) -> usize {
        out_of_order(&self.times).iter().filter(|is| **is).count()
    }

    /// Leaves out rows that are out of order, and says so; tells whether there were any.
    fn leave_out_disorder(&mut self, notes: &mut Vec<String>) -> bool {
        let out = out_of_order(&self.times);
        let (mut late, mut early) = (0_u64, 0_u64);
        let mut newest = None;
        for (time, is_out) in self.times.iter().zip(&out) {
            match is_out {
                false => newest = Some(time),
                true if newest.is_some_and(|newest| time <= newest) => late += 1,
                true => early += 1,
            }
        }
        let mut kept = out.iter().map(|is_out| !is_out);
        self.times.retain(|_| kept.next() == Some(true));
        let mut kept = out.iter().map(|is_out| !is_out);
        self.frames.retain(|_| kept.next() == Some(true));
        let mut kept = out.iter().map(|is_out| !is_out);
        self.numbers.retain(|_| kept.next() == Some(true));
        for (count, what) in [
            (late, "not later than those before"),
            (early, "not earlier than those after"),
        ] {
            if count > 0 {
                notes.push(format!(
                    "camera {}: {} {what}; left out",
                    self.name,
                    counted(count, "frame is", "frames are")
                ));
            }
        }
        late + early > 0
    }

    /// Puts the times of views in order where in every one few rows are out of it: these are left out, which is said.
    /// Tells whether there were any. Where times of one view tell nothing all stay as they are: frames then go by
    /// number.
    pub fn put_in_order(views: &mut [Self], notes: &mut Vec<String>) -> bool {
        let tells = |v: &Self| v.disorder() as f64 <= DISORDER * v.times.len() as f64;
        if !views.iter().all(tells) {
            return false;
        }
        let mut any = false;
        for view in views {
            any |= view.leave_out_disorder(notes);
        }
        any
    }

    /// Why frames of views go by number where those of this one are in no order.
    pub fn by_number(&self) -> String {
        format!(
            "camera {}: its times do not tell when frames were taken; all views go by number, as if they started together",
            self.name
        )
    }

    /// What is said of views that go by number, as if they started together, while they begin with other pictures of
    /// their films: records may be cut so that they do start together, or lack pictures that could not be read.
    pub fn begin_apart<'a>(views: impl Iterator<Item = &'a Self> + Clone) -> Option<String> {
        let begins = |view: &Self| view.numbers.first().copied();
        let of_films = || views.clone().filter(|view| begins(view).is_some());
        let (first, last) = (
            of_films().min_by_key(|v| begins(v))?,
            of_films().max_by_key(|v| begins(v))?,
        );
        let [least, most] = [first, last].map(|view| begins(view).unwrap_or(0));
        (least < most).then(|| {
            format!(
                "camera {} begins with picture {most} of its film, {} with {least}: taken as cut to start together; if pictures before could not be read, give the film in place of the record",
                last.name, first.name
            )
        })
    }

    /// Takes its frames to be so many a second from 0 on, whatever its times say; of a film, its pictures.
    pub fn at_rate(&mut self, rate: f64) {
        self.fill();
        self.of_machine = false;
        let number = |k: usize| (1e9 * k as f64 / rate).round() as u64;
        self.times = (0..self.times.len()).map(number).collect();
    }

    /// Whether it can be told when every frame was taken.
    pub fn tells_times(&self) -> bool {
        self.times.len() > 1 && self.is_in_order()
    }

    /// Frames a second while somebody is in view; steps over frames that the file lacks do not count.
    pub fn rate(&self) -> Option<f64> {
        self.rate_of(|_| 1)
    }

    /// The same by number: of a film, pictures a second.
    pub fn rate_by_number(&self) -> Option<f64> {
        self.rate_of(|k| match self.numbers.get(k..k + 2) {
            Some(pair) => pair[1] - pair[0],
            None => 1,
        })
    }

    /// The usual rate where `frames` tells of how many frames the step after a row is.
    fn rate_of(&self, frames: impl Fn(usize) -> u64) -> Option<f64> {
        let each = self.times.windows(2).zip(self.frames.windows(2));
        let steps = each.enumerate().filter_map(|(k, (times, seen))| {
            let step = times[1].checked_sub(times[0]).filter(|step| *step > 0)?;
            let step = step as f64 * 1e-9 / frames(k) as f64;
            Some((step, seen.iter().all(|s| !s.is_empty())))
        });
        usual_rate(steps).map(|rate| rate.min(MOST_RATE))
    }
}

/// Which times are out of order: all but the most that rise from row to row, so that one wild time costs its own row
/// alone. Where as many rise in several ways the earlier rows stay.
fn out_of_order(times: &[u64]) -> Vec<bool> {
    // From the last row to the first: of the ways in which n + 1 rows rise, `begins[n]` begins the one that begins with
    // the latest time, and `next` goes on with it.
    let mut begins: Vec<usize> = Vec::new();
    let mut next = vec![None; times.len()];
    for k in (0..times.len()).rev() {
        let longer = begins.partition_point(|begin| times[*begin] > times[k]);
        next[k] = longer.checked_sub(1).map(|n| begins[n]);
        match begins.get_mut(longer) {
            Some(begin) => *begin = k,
            None => begins.push(k),
        }
    }
    let mut is_out = vec![true; times.len()];
    let mut row = begins.last().copied();
    while let Some(k) = row {
        is_out[k] = false;
        row = next[k];
    }
    is_out
}

/// How much of a film could be seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Looked {
    /// All of it.
    Whole,
    /// Pictures are damaged, or it is cut off; `infer` has said which, or where.
    InPart,
}

/// What becomes of a camera's film that was seen in part.
pub fn in_part(camera: &str) -> String {
    format!(
        "camera {camera}: its film is damaged or cut off; the pictures that could be read are used"
    )
}

/// Runs a film through `edgecap infer`, which ends with this process, at the best quality: nobody waits for its
/// pictures one by one. `fov` is the lens's horizontal field of view, degrees, where one is known; a whole calibration
/// would refuse pictures of another shape before the caller can say what is wrong with them. It has as many threads as
/// are [given](threads::given) to the caller. The record is complete, whatever is wrong with the film.
///
/// # Errors
/// When it fails, or has seen no picture of a damaged film; it has said why.
pub fn look(film: &Path, fov: Option<f64>, record: &Path) -> anyhow::Result<Looked> {
    let lens = fov.map(|degrees| lens_file(degrees, record)).transpose()?;
    let mut command = Command::new(std::env::current_exe()?);
    command
        .arg("infer")
        .arg(option("--input", film))
        .arg(option("--record", record))
        // Without a name there is no stream, which nobody would read and which not every machine has room for.
        .args(["--quality", "best", "--asked"]);
    if let Some(lens) = &lens {
        command.arg(option("--camera", lens.path()));
    }
    if let Some(threads) = threads::given() {
        command.args(["--threads", &threads.to_string()]);
    }
    tie(&mut command);
    let status = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .status()?;
    let code = status.code().and_then(|c| u8::try_from(c).ok());
    let looked = match code {
        Some(0) => Looked::Whole,
        Some(exit::DATA) if reach(record).is_ok_and(|r| r.is_some()) => Looked::InPart,
        // It has said why.
        code => return Err(Failure::silent(code.unwrap_or(exit::SOFTWARE)).into()),
    };
    if let Some((seen, told)) = missing(record)? {
        say::err(&format!(
            "{}: expected {}, as the film says, found {seen}; if it plays longer, copy it again",
            film.display(),
            counted(told, "frame", "frames")
        ));
    }
    Ok(looked)
}

/// An option and its file as one argument: a file whose name begins with '-' would be taken for another option.
fn option(name: &str, file: &Path) -> OsString {
    let mut option = OsString::from(name);
    option.push("=");
    option.push(file);
    option
}

/// How many frames a record of a film reaches to, and how many the film says it has, where these are more. Some films
/// tell wrong numbers.
///
/// # Errors
/// If the record cannot be read.
fn missing(record: &Path) -> anyhow::Result<Option<(u64, u64)>> {
    Ok(reach(record)?.filter(|(seen, told)| seen < told))
}

/// How many frames a record of a film reaches to, and how many the film says it has; `None` where no frame is in it.
///
/// # Errors
/// If the record cannot be read.
fn reach(record: &Path) -> anyhow::Result<Option<(u64, u64)>> {
    let name = record.display().to_string();
    let file = record::open(record).map_err(|e| Failure::no_input(record, &e))?;
    let lens = CameraSource::Recorded {
        fov_degrees: DEFAULT_FOV,
    };
    let mut reader = ObservationReader::new(BufReader::new(file), &name, lens);
    let mut frame = ObservationFrame::default();
    let mut reach = None;
    while reader.read(&mut frame)? {
        // Films repeat pictures by frames without bytes, which are numbered and not seen.
        reach = Some((frame.sequence + 1, u64::from(frame.frame_total)));
    }
    Ok(reach)
}

/// A `camera.toml` beside a record, for as long as it is held.
fn lens_file(degrees: f64, record: &Path) -> anyhow::Result<NamedTempFile> {
    let folder = record.parent().unwrap_or(Path::new("."));
    let mut file = NamedTempFile::new_in(folder)?;
    writeln!(file, "fov_degrees = {:?}", degrees.clamp(1.0, 179.0))?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Format, ObservationsRow, RecordWriter};

    /// A view with these times; every frame shows as many people as its number.
    fn timed(times: Vec<u64>) -> ViewFile {
        ViewFile {
            name: "hall".to_owned(),
            size: [640, 480],
            intrinsics: Intrinsics::default(),
            frames: (0..times.len())
                .map(|k| vec![Observation::default(); k])
                .collect(),
            times,
            numbers: Vec::new(),
            of_machine: true,
        }
    }

    #[test]
    fn a_wild_time_costs_its_own_row_alone() {
        let hour = 3_600_000_000_000;
        let even = |count: u64| (0..count).map(|k| 7 + 33_333_333 * k);
        for (wild, time, word) in [
            (10, 7 + hour, "1 frame is not earlier than those after"),
            (0, 7 + hour, "1 frame is not earlier than those after"),
            (10, 0, "1 frame is not later than those before"),
            (
                10,
                7 + 33_333_333 * 9,
                "1 frame is not later than those before",
            ),
        ] {
            let mut times: Vec<u64> = even(40).collect();
            times[wild] = time;
            let mut views = [timed(times)];
            assert_eq!(views[0].disorder(), 1, "{time} in row {wild}");
            let mut notes = Vec::new();
            assert!(ViewFile::put_in_order(&mut views, &mut notes));
            assert!(notes.len() == 1 && notes[0].contains(word), "{notes:?}");
            assert!(views[0].is_in_order());
            let left = views[0].frames.iter().map(Vec::len);
            assert!(left.eq((0..40).filter(|k| *k != wild)), "row {wild}");
        }
        assert_eq!(timed(even(40).collect()).disorder(), 0);
        assert_eq!(timed(vec![7; 40]).disorder(), 39);
    }

    /// A machine that started again counts from 0: two recordings in one file.
    #[test]
    fn of_two_recordings_in_one_file_the_longer_one_stays_where_the_other_is_short() {
        let recording = |from: u64, count: u64| (from..from + count).collect::<Vec<u64>>();
        for (first, second, left) in [(100, 5, 0..100), (5, 100, 5..105)] {
            let times = [recording(9000, first), recording(10, second)].concat();
            let mut views = [timed(times)];
            assert!(ViewFile::put_in_order(&mut views, &mut Vec::new()));
            assert!(views[0].frames.iter().map(Vec::len).eq(left));
        }
        // Which of two halves is meant nobody can tell.
        let mut views = [timed([recording(9000, 50), recording(10, 50)].concat())];
        assert_eq!(views[0].disorder(), 50);
        assert!(!ViewFile::put_in_order(&mut views, &mut Vec::new()));
        assert_eq!(views[0].times.len(), 100);
    }

    #[test]
    fn rows_of_a_film_are_its_pictures_where_it_goes_by_number() {
        let numbers = [2, 3, 4, 7, 8];
        let mut view = timed(numbers.map(|n| 40_000_000 * n).to_vec());
        view.numbers = numbers.to_vec();
        view.begin_with_film();
        view.fill();
        assert_eq!(view.numbers, (0..9).collect::<Vec<_>>());
        let even: Vec<u64> = (0..9).map(|n| 40_000_000 * n).collect();
        assert_eq!(view.times, even);
        let people: Vec<usize> = view.frames.iter().map(Vec::len).collect();
        assert_eq!(people, [0, 0, 0, 1, 2, 0, 0, 3, 4]);
        view.fill();
        assert_eq!(view.times, even, "nothing lacks");

        // One that repeats every other picture.
        let mut view = timed((0..20).map(|k| 80_000_000 * k).collect());
        view.numbers = (0..20).map(|k| 2 * k).collect();
        assert!((view.rate().unwrap() - 12.5).abs() < 1e-6);
        assert!((view.rate_by_number().unwrap() - 25.0).abs() < 1e-6);
        view.at_rate(25.0);
        assert_eq!(view.times.len(), 39);
        assert_eq!(view.frames[38].len(), 19);
        assert_eq!(view.times[38], 38 * 40_000_000);
    }

    #[test]
    fn views_that_begin_with_other_pictures_of_their_films_are_named() {
        let of_film = |name: &str, first: u64| {
            let numbers: Vec<u64> = (first..first + 9).collect();
            let mut view = timed(numbers.iter().map(|n| 40_000_000 * n).collect());
            (view.name, view.numbers) = (name.to_owned(), numbers);
            view
        };
        let live = timed((0..9).map(|n| 40_000_000 * n).collect());
        for (begins, said) in [([0, 2, 1], true), ([0, 2, 0], true), ([7, 7, 7], false)] {
            let [a, b, c] = begins;
            let views = [
                live.clone(),
                of_film("a", a),
                of_film("b", b),
                of_film("c", c),
            ];
            let note = ViewFile::begin_apart(views.iter());
            assert_eq!(note.is_some(), said, "{begins:?}");
            let names = note.is_none_or(|n| {
                n.starts_with("camera b begins with picture 2 of its film, a with 0:")
            });
            assert!(names, "{begins:?}");
        }
        assert_eq!(
            ViewFile::begin_apart([live.clone(), of_film("b", 5)].iter()),
            None
        );
        assert_eq!(ViewFile::begin_apart([live].iter()), None);
    }

    #[test]
    fn numbers_are_kept_of_frames_of_a_film_alone() {
        let folder = tempfile::tempdir().unwrap();
        let record = folder.path().join("seen");
        let numbers = |all: &[u64], flags: u32, named: &str| {
            let mut file =
                RecordWriter::<ObservationsRow>::create(&record, Format::Binary).unwrap();
            for &sequence in all {
                let frame = ObservationFrame {
                    sequence,
                    capture_ns: 1000 * sequence,
                    flags,
                    width: 640,
                    height: 480,
                    intrinsics: Intrinsics::from_horizontal_fov(640, 480, 60.0),
                    count: 1,
                    ..ObservationFrame::default()
                };
                file.write(&frame, "").unwrap();
            }
            file.finish().unwrap();
            let lens = CameraSource::Recorded {
                fov_degrees: DEFAULT_FOV,
            };
            let seen = ViewFile::of_record("hall", lens, &record, named.as_ref()).unwrap();
            (seen.numbers, seen.times)
        };
        let at = |all: &[u64]| (all.to_vec(), all.iter().map(|n| 1000 * n).collect());
        assert_eq!(
            numbers(&[2, 3, 5], FLAG_FILE_TIME, "a.jsonl"),
            at(&[2, 3, 5])
        );
        assert_eq!(
            numbers(&[2, 3, 5], FLAG_FILE_TIME, "a.avi"),
            at(&[0, 1, 2, 3, 5])
        );
        for (all, flags) in [
            (&[2, 3, 5], 0),
            (&[2, 2, 5], FLAG_FILE_TIME),
            (&[2, 3, u64::MAX >> 12], FLAG_FILE_TIME),
        ] {
            assert!(numbers(all, flags, "a.jsonl").0.is_empty());
        }
    }

    #[test]
    fn a_record_of_fewer_frames_than_the_film_has_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let record = folder.path().join("seen");
        let intrinsics = Intrinsics {
            fx: 600.0,
            fy: 600.0,
            cx: 320.0,
            cy: 240.0,
        };
        let of = |numbers: &[u64], frame_total| {
            let mut file =
                RecordWriter::<ObservationsRow>::create(&record, Format::Binary).unwrap();
            for &sequence in numbers {
                let frame = ObservationFrame {
                    sequence,
                    frame_total,
                    width: 640,
                    height: 480,
                    intrinsics,
                    ..ObservationFrame::default()
                };
                file.write(&frame, "").unwrap();
            }
            file.finish().unwrap();
            missing(&record).unwrap()
        };
        assert_eq!(of(&[0, 1, 2], 3), None);
        assert_eq!(of(&[0, 2], 3), None, "one was a repetition");
        assert_eq!(of(&[0, 1], 3), Some((2, 3)));
        assert_eq!(of(&[0, 1], 0), None, "not every film tells");
    }
}
