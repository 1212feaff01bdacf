//! One view's file: a record, JSON lines, or a film that is looked at first.

use std::fs::File;
use std::io::{BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};

use tempfile::NamedTempFile;

use super::exit::Failure;
use super::say;
use crate::camera::DEFAULT_FOV;
pub use crate::capture::is_film;
use crate::counted::counted;
use crate::export::usual_rate;
use crate::message::{FLAG_FILE_TIME, Intrinsics, Observation, ObservationFrame};
use crate::record::{CameraSource, ObservationReader};
use crate::supervise::tie;

/// Frames a second beyond which times say nothing.
const MOST_RATE: f64 = 10_000.0;
/// Share of a view's rows out of order beyond which its times tell nothing.
const DISORDER: f64 = 0.1;

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
    /// Times are those of the machine's clock, which every frame of a live camera was published by; not of a film.
    pub of_machine: bool,
}

impl ViewFile {
    /// Reads what `camera` saw from JSON lines or a record; a film goes through `edgecap infer` first. `lens` tells its
    /// camera, `fov` its field of view for `infer`, degrees.
    ///
    /// # Errors
    /// When the file cannot be read, its pictures change size, or nobody is in it.
    pub fn read(
        camera: &str,
        lens: CameraSource<'_>,
        fov: f64,
        path: &Path,
    ) -> anyhow::Result<Self> {
        if !is_film(path) {
            return Self::of_record(camera, lens, path, path);
        }
        let folder = tempfile::tempdir()?;
        let record = folder.path().join("observations");
        look(path, Some(fov), &record)?;
        Self::of_record(camera, lens, &record, path)
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
        let file = File::open(record).map_err(|e| Failure::no_input(named, &e))?;
        let name = named.display().to_string();
        let mut reader = ObservationReader::new(BufReader::new(file), &name, lens);
        let mut seen = Self {
            name: camera.to_owned(),
            size: [0; 2],
            intrinsics: Intrinsics::default(),
            frames: Vec::new(),
            times: Vec::new(),
            of_machine: true,
        };
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

    /// Whether every frame was taken after the one before.
    pub fn is_in_order(&self) -> bool {
        self.times.windows(2).all(|w| w[0] < w[1])
    }

    /// How many rows are not later than all before them.
    pub fn disorder(&self) -> usize {
        late(&self.times).iter().filter(|is_late| **is_late).count()
    }

    /// Leaves out rows that are not later than those before them, and says so; tells whether there were any.
    fn leave_out_disorder(&mut self, notes: &mut Vec<String>) -> bool {
        let out = late(&self.times);
        let count = self.disorder();
        if count == 0 {
            return false;
        }
        let mut kept = out.iter().map(|is_out| !is_out);
        self.times.retain(|_| kept.next() == Some(true));
        let mut kept = out.iter().map(|is_out| !is_out);
        self.frames.retain(|_| kept.next() == Some(true));
        notes.push(format!(
            "camera {}: {} not later than those before; left out",
            self.name,
            counted(count as u64, "frame is", "frames are")
        ));
        true
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

    /// Takes its frames to be so many a second, whatever its times say.
    pub fn at_rate(&mut self, rate: f64) {
        let number = |k: usize| (1e9 * k as f64 / rate).round() as u64;
        self.times = (0..self.times.len()).map(number).collect();
    }

    /// Whether it can be told when every frame was taken.
    pub fn tells_times(&self) -> bool {
        self.times.len() > 1 && self.is_in_order()
    }

    /// Frames a second while somebody is in view; steps over frames that the file lacks do not count.
    pub fn rate(&self) -> Option<f64> {
        let each = self.times.windows(2).zip(self.frames.windows(2));
        let steps = each.filter_map(|(times, seen)| {
            let step = times[1].checked_sub(times[0]).filter(|step| *step > 0)?;
            Some((step as f64 * 1e-9, seen.iter().all(|s| !s.is_empty())))
        });
        usual_rate(steps).map(|rate| rate.min(MOST_RATE))
    }
}

/// Which times are not later than all before them.
fn late(times: &[u64]) -> Vec<bool> {
    let mut latest: Option<u64> = None;
    let each = times.iter().map(|t| {
        let is_late = latest.is_some_and(|latest| *t <= latest);
        latest = latest.max(Some(*t));
        is_late
    });
    each.collect()
}

/// Runs a film through `edgecap infer`, which ends with this process, at the best quality: nobody waits for its
/// pictures one by one. `fov` is the lens's horizontal field of view, degrees, where one is known; a whole calibration
/// would refuse pictures of another shape before the caller can say what is wrong with them.
///
/// # Errors
/// When it fails; it has said why.
pub fn look(film: &Path, fov: Option<f64>, record: &Path) -> anyhow::Result<()> {
    let lens = fov.map(|degrees| lens_file(degrees, record)).transpose()?;
    let mut command = Command::new(std::env::current_exe()?);
    command
        .arg("infer")
        .arg("--input")
        .arg(film)
        .arg("--record")
        .arg(record)
        // Without a name there is no stream, which nobody would read and which not every machine has room for.
        .args(["--quality", "best", "--asked"]);
    if let Some(lens) = &lens {
        command.arg("--camera").arg(lens.path());
    }
    tie(&mut command);
    let status = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .status()?;
    match status.code() {
        Some(0) => {
            if let Some((seen, told)) = missing(record)? {
                say::err(&format!(
                    "{}: expected {}, as the film says, found {seen}; if it plays longer, copy it again",
                    film.display(),
                    counted(told, "frame", "frames")
                ));
            }
            Ok(())
        }
        // It has said why.
        code => Err(Failure::silent(
            code.and_then(|c| u8::try_from(c).ok())
                .unwrap_or(super::exit::SOFTWARE),
        )
        .into()),
    }
}

/// How many frames a record of a film reaches to, and how many the film says it has, where these are more. Some films
/// tell wrong numbers.
///
/// # Errors
/// If the record cannot be read.
fn missing(record: &Path) -> anyhow::Result<Option<(u64, u64)>> {
    let name = record.display().to_string();
    let file = File::open(record).map_err(|e| Failure::no_input(record, &e))?;
    let lens = CameraSource::Recorded {
        fov_degrees: DEFAULT_FOV,
    };
    let mut reader = ObservationReader::new(BufReader::new(file), &name, lens);
    let mut frame = ObservationFrame::default();
    let (mut seen, mut told) = (0, 0);
    while reader.read(&mut frame)? {
        // Films repeat pictures by frames without bytes, which are numbered and not seen.
        (seen, told) = (frame.sequence + 1, u64::from(frame.frame_total));
    }
    Ok((seen < told).then_some((seen, told)))
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
