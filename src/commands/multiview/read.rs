//! Views: which file belongs to which camera, what it saw, and whether views go together.

use std::path::{Path, PathBuf};

use super::MultiviewArgs;
use super::order::{self, Reading};
use super::store::Store;
use super::sync::{Together, bring_together};
use crate::camera::calibration::Calibration;
use crate::camera::{DEFAULT_FOV, View};
use crate::commands::common_time::Common;
use crate::commands::exit::Failure;
use crate::commands::say;
use crate::commands::view_file::{Looked, ViewFile, in_part, is_film};
use crate::commands::views::{names, no_such_camera, pictured, told};
use crate::message::Intrinsics;
use crate::multiview::{Agreement, Detections, MOST_VIEWS, Sight, agreement, to_view};
use crate::record::CameraSource;

/// By how much one reading of the lenses must be better than the other to be told apart.
const CLEAR: f64 = 0.99;

/// Rays of a calibration that is right meet within this, metres.
const NEAR: f64 = 0.035;
/// Share of the sights that could confirm others of which more do where nothing is doubtful.
const WELL: f64 = 0.9;
/// Share of them that does at least in the right one of two readings.
const MOSTLY: f64 = 0.6;
/// So many times those of the wrong one, or …
const CLEARLY_MORE: f64 = 1.15;
/// … rays that meet within so many times the distance.
const CLEARLY_NEARER: f64 = 0.6;

/// All views over time.
pub struct Scene {
    /// The cameras as their pictures show them, in the calibration's order, as far as their time can be told.
    pub views: Vec<View>,
    /// The film of every view, where its file is one.
    pub films: Vec<Option<PathBuf>>,
    /// Whether all of every film could be seen.
    pub are_whole: bool,
    /// Per frame, per view, who is seen.
    pub frames: Vec<Vec<Detections>>,
    /// When every frame was taken, nanoseconds, on the first view's clock.
    pub times: Vec<u64>,
    /// Per view, per frame, the number of its picture in the film; empty where nothing tells it.
    pub pictures: Vec<Vec<u64>>,
    /// Whether these are of the machine's clock, not of a film.
    pub of_machine: bool,
    /// Frames a second.
    pub rate: f64,
    /// By how many seconds each view started before the first one, where that was told.
    pub offsets: Vec<Option<f64>>,
    /// Whether frames are the files' own, not made of those before and after.
    pub in_step: bool,
    /// Whether axes are a calibration's, not the camera's own.
    pub in_world: bool,
    /// What was recognised.
    pub notes: Vec<String>,
}

/// Refuses more views than are told apart.
///
/// # Errors
/// Saying how many are too many.
pub fn expect_few(views: usize) -> anyhow::Result<()> {
    if views <= MOST_VIEWS {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "expected at most {MOST_VIEWS} --view, found {views}; leave out those that see the least"
    ))
    .into())
}

/// Reads all views.
///
/// # Errors
/// When a file cannot be read, or views do not go together.
pub fn scene(
    args: &MultiviewArgs,
    calibration: Calibration,
    store: &Store,
) -> anyhow::Result<Scene> {
    let Calibration {
        views,
        mut notes,
        alternative,
    } = calibration;
    let files = assign(&args.view, &views)?;
    held_out(&args.hold_out, &files, &views)?;
    let (mut seen, mut films) = (Vec::new(), Films::default());
    for (v, file) in &files {
        let view = &views[*v];
        seen.push(films.read(&view.name, Some(view), file, store)?);
    }
    if films.found > 0 {
        say::err(&format!(
            "goes on: {} of {} views were looked at before",
            films.found,
            files.len()
        ));
    }
    notes.extend(films.in_part.iter().map(|camera| in_part(camera)));
    let sizes: Vec<[u32; 2]> = seen.iter().map(|s| s.size).collect();
    let one_pictured = |all: &[View], k: usize| -> anyhow::Result<View> {
        let (v, file) = &files[k];
        pictured(&all[*v], sizes[k], &file.display().to_string())
    };
    let every = (0..files.len()).map(|k| one_pictured(&views, k));
    let every = every.collect::<anyhow::Result<Vec<View>>>()?;
    let lenses: Vec<Intrinsics> = seen.iter().map(|s| s.intrinsics).collect();
    let is_held = |view: &View| args.hold_out.contains(&view.name);
    let held: Vec<bool> = every.iter().map(is_held).collect();
    let how = (args.sync, args.fps);
    let Together {
        used,
        common,
        offsets,
        of_machine,
    } = bring_together(how, &every, seen, &held, &mut notes)?;
    let Common {
        people,
        times,
        numbers: pictures,
        rate,
        in_step,
    } = common;
    let mut views: Vec<View> = used.iter().map(|k| every[*k].clone()).collect();
    expect_two_measured(&args.hold_out, &views)?;
    // Joints in space are in axes by the lens that each record tells: its view's may be another.
    let lenses: Vec<Intrinsics> = used.iter().map(|k| lenses[*k]).collect();
    let frames = |which: &[usize], views: &[View]| -> Vec<Vec<Detections>> {
        let one = |k: usize, v: usize, view: &View| -> Detections {
            let mut people = people[v][k].clone();
            to_view(view, &lenses[v], &mut people);
            people.iter().map(|o| Sight::new(view, o)).collect()
        };
        let all = |k: usize| {
            let each = which.iter().zip(views);
            each.map(|(v, view)| one(k, *v, view)).collect()
        };
        (0..times.len()).map(all).collect()
    };
    // Views that are only measured tell nothing of lenses and pictures.
    let told: Vec<usize> = (0..views.len()).filter(|v| !is_held(&views[*v])).collect();
    let of_told = |all: &[View]| -> Vec<View> { told.iter().map(|v| all[*v].clone()).collect() };
    let judged = |views: &[View]| frames(&told, views);
    if let Some((other, what)) = alternative {
        let other = used.iter().map(|k| one_pictured(&other, *k));
        let other = other.collect::<anyhow::Result<Vec<View>>>()?;
        let both = [&views, &other].map(|all| {
            let all = of_told(all);
            agreement(&all, &judged(&all), rate)
        });
        // Where nobody is found in one reading, rays meet nowhere.
        let both = both.map(|found| found.map(|a| a.apart));
        let [as_is, changed] = both.map(|apart| apart.unwrap_or(f64::INFINITY));
        let better = changed < CLEAR * as_is;
        let verdict = match better {
            true => "the second is used",
            false if as_is < CLEAR * changed => "the first is used",
            false => "they cannot be told apart, the first is used",
        };
        let [first, second] = both.map(|apart| match apart {
            Some(apart) => format!("within {:.1} mm", 1e3 * apart),
            None => "nowhere".to_owned(),
        });
        notes.push(format!(
            "lenses as they are written: rays meet {first}; {what}: {second}; {verdict}"
        ));
        if better {
            views = other;
        }
    }
    let own = of_told(&views);
    expect_not_mirrored(&own, &judged(&own), &judged, rate)?;
    let everyone: Vec<usize> = (0..views.len()).collect();
    let sights = frames(&everyone, &views);
    let film = |k: &usize| Some(files[*k].1.clone()).filter(|file| is_film(file));
    Ok(Scene {
        views,
        films: used.iter().map(film).collect(),
        are_whole: films.in_part.is_empty(),
        frames: sights,
        times,
        pictures,
        of_machine,
        rate,
        offsets,
        in_step,
        in_world: true,
        notes,
    })
}

/// Refuses pictures that were flipped left to right against their calibration, as programs show cameras at a desk, and
/// views of which two were exchanged.
fn expect_not_mirrored(
    views: &[View],
    sights: &[Vec<Detections>],
    frames: &impl Fn(&[View]) -> Vec<Vec<Detections>>,
    rate: f64,
) -> anyhow::Result<()> {
    let most = 1.0 - 1.0 / views.len() as f64;
    let as_is = agreement(views, sights, rate);
    let (told, apart) = as_is.map_or((0.0, f64::INFINITY), |a| (a.confirmed, a.apart));
    if told > WELL * most && apart < NEAR {
        return Ok(());
    }
    let fits = |a: &Agreement| {
        let better = a.confirmed > CLEARLY_MORE * told || a.apart < CLEARLY_NEARER * apart;
        better && a.apart < NEAR && a.confirmed > MOSTLY * most
    };
    let other: Vec<View> = views.iter().map(View::mirrored).collect();
    let mirrored = agreement(&other, &frames(&other), rate).filter(fits);
    let mirrored = mirrored.map(|a| Reading {
        words: format!(
            "{:.0} % within {:.0} mm if all pictures are mirrored: flip them (ffmpeg -vf hflip) or calibrate with these",
            100.0 * a.confirmed / most,
            1e3 * a.apart
        ),
        apart: a.apart,
    });
    let exchanged = order::exchanged(views, frames, rate, fits);
    let readings: Vec<Reading> = exchanged.into_iter().chain(mirrored).collect();
    let Some(words) = order::words(&readings) else {
        return Ok(());
    };
    Err(Failure::data(format!(
        "expected pictures as the calibration knows them, found that {:.0} % of detections go together{}, and {words}",
        100.0 * told / most,
        as_is.map_or_else(String::new, |a| format!(" within {:.0} mm", 1e3 * a.apart)),
    ))
    .into())
}

/// Refuses to hold out cameras without a view, and so many that fewer than two are left.
fn held_out(held: &[String], files: &[(usize, PathBuf)], views: &[View]) -> anyhow::Result<()> {
    let given: Vec<&str> = files.iter().map(|(v, _)| views[*v].name.as_str()).collect();
    if let Some(other) = held.iter().find(|h| !given.contains(&h.as_str())) {
        return Err(Failure::usage(format!(
            "expected one of the views {} for --hold-out, found {other}",
            given.join(", ")
        ))
        .into());
    }
    let left = given.iter().filter(|name| !held.iter().any(|h| h == *name));
    let left = left.count();
    if left < 2 {
        return Err(Failure::usage(format!(
            "expected two views or more that are not held out, found {left} of {}",
            given.len()
        ))
        .into());
    }
    Ok(())
}

/// Refuses fewer than two views that are measured by, where the time of others could not be told.
fn expect_two_measured(held: &[String], views: &[View]) -> anyhow::Result<()> {
    let left = views.iter().filter(|v| !held.contains(&v.name)).count();
    if left >= 2 {
        return Ok(());
    }
    Err(Failure::data(format!(
        "expected two views or more that are not held out and whose time can be told beside the others', found {left}; give --sync times or --sync none if they started together"
    ))
    .into())
}

/// What became of the films of views that were read.
#[derive(Default)]
pub struct Films {
    /// How many of them an earlier run had looked at.
    pub found: usize,
    /// Cameras whose film could be seen in part alone.
    pub in_part: Vec<String>,
}

impl Films {
    /// What a camera saw, joints in space by the lens that its file tells; the observations of a film are kept.
    ///
    /// # Errors
    /// When the file cannot be read, or nobody is in it.
    pub fn read(
        &mut self,
        camera: &str,
        calibrated: Option<&View>,
        file: &Path,
        store: &Store,
    ) -> anyhow::Result<ViewFile> {
        let fov = calibrated.map(View::fov_degrees);
        let lens = CameraSource::Recorded {
            fov_degrees: fov.map_or(DEFAULT_FOV, |degrees| degrees as f32),
        };
        if !is_film(file) {
            return ViewFile::of_record(camera, lens, file, file);
        }
        let film = store.film(fov, file)?;
        self.found += usize::from(film.was_there);
        if film.looked == Looked::InPart {
            self.in_part.push(camera.to_owned());
        }
        ViewFile::of_record(camera, lens, &film.record, file)
    }
}

/// The camera of every file, in the calibration's order.
fn assign(given: &[String], views: &[View]) -> anyhow::Result<Vec<(usize, PathBuf)>> {
    let camera = |name: &str| views.iter().position(|v| v.name == name);
    let mut files: Vec<(Option<usize>, PathBuf)> = Vec::new();
    for text in given {
        files.push(match told(text) {
            Some((name, file)) => {
                let found = camera(name).ok_or_else(|| {
                    Failure::usage(no_such_camera(views, &format!("in --view {text}"), name))
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
            let (cameras, file) = (names(views), path.display());
            return Err(match path.metadata() {
                Ok(_) => Failure::usage(format!(
                    "expected views called like the cameras {cameras}, found {file}; say which it is by --view CAMERA={file}"
                )),
                Err(e) => Failure::no_input(path, &e),
            }
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
    for (k, (v, path)) in files.iter().enumerate() {
        let place = path.canonicalize().ok();
        let before = files[..k].iter();
        let mut same = before.filter(|(_, p)| place.is_some() && p.canonicalize().ok() == place);
        if let Some((other, _)) = same.next_back() {
            return Err(Failure::usage(format!(
                "expected a file of its own for every camera, found {} for {} and {}",
                path.display(),
                views[*other].name,
                views[*v].name
            ))
            .into());
        }
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;
    use crate::body::skeleton::{Pose, Posed, Skeleton};
    use crate::camera::Brown;
    use crate::camera::calibration::{self, write_pose2sim};
    use crate::commands::multiview::Sync;
    use crate::commands::threads::ThreadsArgs;
    use crate::joints::{EVIDENCE_JOINTS, PELVIS};
    use crate::message::{Observation, ObservationFrame};
    use crate::record::{Format, ObservationsRow, RecordWriter};

    /// What a view sees of somebody at these joints.
    fn seen(view: &View, joints: &[DVec3]) -> Observation {
        let mut seen = Observation::default();
        for (out, joint) in seen.joints2d.iter_mut().zip(joints) {
            let pixel = view.project(*joint).expect("in front");
            *out = [pixel.x as f32, pixel.y as f32, 0.9];
        }
        for (out, joint) in seen.joints3d.iter_mut().zip(joints) {
            let about = view.rotation * (*joint - joints[PELVIS]);
            *out = about.as_vec3().to_array();
        }
        seen
    }

    /// Somebody beside the middle of one view, recorded by its own lens and by the one that a usual webcam has.
    #[test]
    fn joints_in_space_are_those_of_the_calibrated_lens() {
        let views = [0.0, 90.0].map(View::around);
        let mut pose = Pose::facing_camera(0.0);
        pose.position = DVec3::new(0.6, 0.0, 0.0);
        let (skeleton, mut posed) = (Skeleton::builtin(), Posed::default());
        skeleton.pose(&pose, skeleton.lengths(), &mut posed);
        let [own, usual] = [false, true].map(|by_usual| {
            let folder = tempfile::tempdir().unwrap();
            let at = |name: &str| folder.path().join(name);
            std::fs::write(at("Calib.toml"), write_pose2sim(&views)).unwrap();
            let view = views.iter().map(|view| {
                let path = at(&view.name).with_extension("jsonl");
                let mut file =
                    RecordWriter::<ObservationsRow>::create(&path, Format::Jsonl).unwrap();
                let [width, height] = view.size;
                let mut intrinsics = view.intrinsics();
                let mut people = [seen(view, &posed.joints)];
                if by_usual {
                    let own = intrinsics;
                    intrinsics = Intrinsics::from_horizontal_fov(width, height, 60.0);
                    let [fx, fy, cx, cy] =
                        [intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy].map(f64::from);
                    let lens = View {
                        focal: DVec2::new(fx, fy),
                        centre: DVec2::new(cx, cy),
                        distortion: Brown::default(),
                        ..view.clone()
                    };
                    to_view(&lens, &own, &mut people);
                }
                for k in 0..12 {
                    let mut frame = ObservationFrame {
                        sequence: k,
                        capture_ns: k * 33_333_333,
                        width,
                        height,
                        intrinsics,
                        count: 1,
                        ..ObservationFrame::default()
                    };
                    frame.people[0] = people[0];
                    file.write(&frame, "").unwrap();
                }
                file.finish().unwrap();
                format!("{}={}", view.name, path.display())
            });
            let args = MultiviewArgs {
                calibration: Some(at("Calib.toml")),
                view: view.collect(),
                body: None,
                no_dct: true,
                masks: None,
                film: Vec::new(),
                hold_out: Vec::new(),
                obj: None,
                fps: None,
                sync: Sync::None,
                export: Vec::new(),
                out: at("run"),
                threads: ThreadsArgs::default(),
            };
            let store = Store::open(&args.out, String::new()).unwrap();
            let calibration = calibration::read(&at("Calib.toml")).unwrap();
            let scene = scene(&args, calibration, &store).unwrap();
            assert_eq!(scene.frames.len(), 12);
            scene.frames[0].clone()
        });
        for (own, usual) in own.iter().zip(&usual) {
            let [own, usual] = [own, usual].map(|seen| seen[0].lifted.unwrap());
            let off = (0..EVIDENCE_JOINTS).map(|j| own[j].distance(usual[j]));
            let most = off.fold(0.0, f64::max);
            assert!(most < 1e-3, "{most} m");
        }
    }
}
