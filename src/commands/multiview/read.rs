//! Views: which file belongs to which camera, what it saw, and whether views go together.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::MultiviewArgs;
use crate::camera::View;
use crate::camera::calibration::Calibration;
use crate::commands::exit::Failure;
use crate::message::ObservationFrame;
use crate::multiview::{Detections, Sight, agreement};
use crate::record::{CameraSource, ObservationReader};

/// Seconds that views may differ in length: who stops cameras one after the other.
const SPARE: f64 = 0.5;
/// How much rates may differ.
const RATE_TOLERANCE: f64 = 0.03;
/// Rate of views whose files tell no times.
const USUAL_RATE: f64 = 30.0;
/// By how much one reading of the lenses must be better than the other to be told apart.
const CLEAR: f64 = 0.99;

/// All views over time.
pub struct Scene {
    /// The cameras as their pictures show them, in the calibration's order.
    pub views: Vec<View>,
    /// Per frame, per view, who is seen.
    pub frames: Vec<Vec<Detections>>,
    /// When every frame was taken, nanoseconds, by the first view.
    pub times: Vec<u64>,
    /// Frames a second.
    pub rate: f64,
    /// What was recognised.
    pub notes: Vec<String>,
}

/// Reads all views.
///
/// # Errors
/// When a file cannot be read, or views do not go together.
pub fn scene(args: &MultiviewArgs, calibration: Calibration) -> anyhow::Result<Scene> {
    let Calibration {
        views,
        mut notes,
        alternative,
    } = calibration;
    let files = assign(&args.view, &views)?;
    for name in &args.hold_out {
        if !files.iter().any(|(v, _)| views[*v].name == *name) {
            return Err(Failure::usage(format!(
                "expected one of the cameras {} for --hold-out, found {name}",
                names(&views)
            ))
            .into());
        }
    }
    let mut seen = Vec::new();
    for (v, file) in &files {
        seen.push(Seen::read(&views[*v], file)?);
    }
    let (rate, count) = together(args.fps, &views, &files, &seen, &mut notes)?;
    let pictured = |all: &[View]| -> anyhow::Result<Vec<View>> {
        let each = files.iter().zip(&seen);
        each.map(|((v, file), s)| s.pictured(&all[*v], file))
            .collect()
    };
    let mut views = pictured(&views)?;
    let frames = |views: &[View]| -> Vec<Vec<Detections>> {
        let one = |k: usize, (view, s): (&View, &Seen)| {
            s.frames[k].iter().map(|o| Sight::new(view, o)).collect()
        };
        (0..count)
            .map(|k| views.iter().zip(&seen).map(|pair| one(k, pair)).collect())
            .collect()
    };
    let mut sights = frames(&views);
    if let Some((other, what)) = alternative {
        let other = pictured(&other)?;
        let theirs = frames(&other);
        let both = (
            agreement(&views, &sights, rate),
            agreement(&other, &theirs, rate),
        );
        if let (Some(as_is), Some(changed)) = both {
            let better = changed < CLEAR * as_is;
            let verdict = match better {
                true => "the second is used",
                false if as_is < CLEAR * changed => "the first is used",
                false => "they cannot be told apart, the first is used",
            };
            notes.push(format!(
                "lenses as they are written: rays meet within {:.1} mm; {what}: {:.1} mm; {verdict}",
                1e3 * as_is,
                1e3 * changed,
            ));
            if better {
                (views, sights) = (other, theirs);
            }
        }
    }
    let times = seen[0].times[..count].to_vec();
    Ok(Scene {
        views,
        frames: sights,
        times,
        rate,
        notes,
    })
}

fn names(views: &[View]) -> String {
    views
        .iter()
        .map(|v| v.name.as_str())
        .collect::<Vec<_>>()
        .join(", ")
}

/// The camera of every file, in the calibration's order.
fn assign(given: &[String], views: &[View]) -> anyhow::Result<Vec<(usize, PathBuf)>> {
    if given.len() < 2 {
        return Err(Failure::usage(
            "expected at least two --view, found 1; one camera alone is fitted by 'run' and 'fit'",
        )
        .into());
    }
    let camera = |name: &str| views.iter().position(|v| v.name == name);
    let mut files: Vec<(Option<usize>, PathBuf)> = Vec::new();
    for text in given {
        let told = text
            .split_once('=')
            .filter(|(name, _)| !Path::new(text).exists() && !name.contains('/'));
        files.push(match told {
            Some((name, file)) => {
                let found = camera(name).ok_or_else(|| {
                    Failure::usage(format!(
                        "expected one of the cameras {} in --view {text}, found {name}",
                        names(views)
                    ))
                })?;
                (Some(found), file.into())
            }
            None => {
                let path = PathBuf::from(text);
                let stem = path
                    .file_stem()
                    .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
                (camera(&stem), path)
            }
        });
    }
    if files.iter().any(|(v, _)| v.is_none()) {
        if files.iter().any(|(v, _)| v.is_some()) || files.len() != views.len() {
            let (_, path) = files
                .iter()
                .find(|(v, _)| v.is_none())
                .expect("one has none");
            return Err(Failure::usage(format!(
                "expected views called like the cameras {}, found {}; say which it is by --view CAMERA={0}",
                names(views),
                path.display()
            ))
            .into());
        }
        for (k, (v, _)) in files.iter_mut().enumerate() {
            *v = Some(k);
        }
    }
    let mut files: Vec<(usize, PathBuf)> = files
        .into_iter()
        .filter_map(|(v, p)| Some((v?, p)))
        .collect();
    files.sort();
    for pair in files.windows(2) {
        if pair[0].0 == pair[1].0 {
            return Err(Failure::usage(format!(
                "expected one view of camera {}, found {} and {}",
                views[pair[0].0].name,
                pair[0].1.display(),
                pair[1].1.display()
            ))
            .into());
        }
    }
    Ok(files)
}

/// One view over time.
struct Seen {
    size: [u32; 2],
    frames: Vec<Vec<crate::message::Observation>>,
    times: Vec<u64>,
}

impl Seen {
    fn read(view: &View, path: &Path) -> anyhow::Result<Self> {
        let folder;
        let mut record = path.to_owned();
        if is_film(path) {
            folder = tempfile::tempdir()?;
            record = folder.path().join("observations");
            look(path, &view.name, &record)?;
        }
        let file = File::open(&record).map_err(|e| Failure::no_input(path, &e))?;
        // Distances are told by the calibration, not by the record's lens.
        let lens = view.intrinsics();
        let given = |_: u32, _: u32| Ok(lens);
        let name = path.display().to_string();
        let mut reader =
            ObservationReader::new(BufReader::new(file), &name, CameraSource::Given(&given));
        let mut seen = Self {
            size: [0; 2],
            frames: Vec::new(),
            times: Vec::new(),
        };
        let mut frame = ObservationFrame::default();
        while reader.read(&mut frame)? {
            let size = [frame.width, frame.height];
            if seen.frames.is_empty() {
                seen.size = size;
            } else if seen.size != size {
                return Err(Failure::data(format!(
                    "{name}: expected pictures of one size, found {}x{} and {}x{}",
                    seen.size[0], seen.size[1], size[0], size[1]
                ))
                .into());
            }
            seen.frames.push(frame.people().to_vec());
            seen.times.push(frame.capture_ns);
        }
        if seen.frames.is_empty() {
            return Err(Failure::data(format!(
                "{name}: expected the frames of camera {}, found none",
                view.name
            ))
            .into());
        }
        if seen.frames.iter().all(Vec::is_empty) {
            return Err(Failure::data(format!(
                "{name}: expected people in the view of camera {}, found nobody in {} frames; leave the view out",
                view.name,
                seen.frames.len()
            ))
            .into());
        }
        Ok(seen)
    }

    /// The camera as the pictures show it.
    fn pictured(&self, view: &View, path: &Path) -> anyhow::Result<View> {
        view.for_pictures(self.size).ok_or_else(|| {
            let ([w, h], [found_w, found_h]) = (view.size, self.size);
            let turned = if view.for_pictures([found_h, found_w]).is_some() {
                ", turned by 90 degrees; turn pictures or calibration"
            } else {
                "; calibrate with pictures of this size"
            };
            Failure::data(format!(
                "{}: expected pictures of {w}x{h} pixels as camera {} is calibrated for, found {found_w}x{found_h}{turned}",
                path.display(),
                view.name
            ))
            .into()
        })
    }

    fn rate(&self) -> Option<f64> {
        let span = self.times.last()?.checked_sub(*self.times.first()?)? as f64 * 1e-9;
        (span > 0.0).then(|| (self.times.len() - 1) as f64 / span)
    }
}

fn is_film(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    ending.is_some_and(|e| ["mp4", "avi", "mov", "mkv", "webm", "y4m", "m4v"].contains(&e.as_str()))
}

/// Runs a film through `edgecap infer`.
fn look(film: &Path, camera: &str, record: &Path) -> anyhow::Result<()> {
    let mut command = Command::new(std::env::current_exe()?);
    command
        .arg("infer")
        .arg("--input")
        .arg(film)
        .arg("--record")
        .arg(record);
    command.args([
        "--name",
        &format!("multiview-{camera}-{}", std::process::id()),
    ]);
    let status = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .status()?;
    match status.code() {
        Some(0) => Ok(()),
        // It has said why.
        code => Err(Failure::silent(
            code.and_then(|c| u8::try_from(c).ok())
                .unwrap_or(crate::commands::exit::SOFTWARE),
        )
        .into()),
    }
}

/// Rate and number of frames that all views have.
fn together(
    given: Option<f64>,
    views: &[View],
    files: &[(usize, PathBuf)],
    seen: &[Seen],
    notes: &mut Vec<String>,
) -> anyhow::Result<(f64, usize)> {
    let name = |k: usize| &views[files[k].0].name;
    let rates: Vec<Option<f64>> = seen.iter().map(Seen::rate).collect();
    let rate = given.or(rates[0]).unwrap_or(USUAL_RATE);
    if given.is_none()
        && let Some(k) = rates
            .iter()
            .position(|r| r.is_some_and(|r| (r / rate - 1.0).abs() > RATE_TOLERANCE))
    {
        return Err(Failure::data(format!(
            "expected views of one rate, found {:.2} frames a second of camera {} and {:.2} of {}; bring them to one rate, or give --fps if they are",
            rate,
            name(0),
            rates[k].unwrap_or(rate),
            name(k)
        ))
        .into());
    }
    let lengths: Vec<usize> = seen.iter().map(|s| s.frames.len()).collect();
    let least = (0..lengths.len()).min_by_key(|k| lengths[*k]).unwrap_or(0);
    let most = (0..lengths.len()).max_by_key(|k| lengths[*k]).unwrap_or(0);
    let difference = lengths[most] - lengths[least];
    if difference as f64 > SPARE * rate {
        return Err(Failure::data(format!(
            "expected views of one length, found {} frames of camera {} and {} of {}; cut them to the same time",
            lengths[most],
            name(most),
            lengths[least],
            name(least)
        ))
        .into());
    }
    if difference > 0 {
        notes.push(format!(
            "camera {} has {difference} frames less than {}; these are left out",
            name(least),
            name(most)
        ));
    }
    Ok((rate, lengths[least]))
}
