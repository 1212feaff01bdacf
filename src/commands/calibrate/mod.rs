//! `edgecap calibrate`: pictures of a board in, lenses and places of cameras out; or what several cameras saw of people
//! who walk about in, the cameras' places and directions out.

mod boards;
mod lenses;
mod people;
mod shots;

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use self::lenses::Lenses;
use super::apart::Apart;
use super::exit::Failure;
use super::say;
use super::threads::ThreadsArgs;
use super::views::{named as one_named, told};
use crate::board::Board;
use crate::camera::View;
use crate::camera::calibration::{check, read_pose2sim, write_doubtful, write_measured};
use crate::output;

/// Options of `edgecap calibrate`.
#[derive(Debug, Clone, clap::Args)]
pub struct CalibrateArgs {
    /// What a camera saw of somebody who walked about: the JSON lines or record of 'infer', or a film; once for every
    /// camera, of the same time: live cameras of one machine go by its clock, films must start together. With --board:
    /// a folder of photos, or a film; one camera for its lens, several for their places too. A camera is called like
    /// its file or folder, or CAMERA=FILE says how
    #[arg(long, value_name = "[CAMERA=]FILE", required = true)]
    pub view: Vec<String>,
    /// Calibrate by pictures of a board: a chessboard by its inner corners, as in 9x6, or a ChArUco board by its
    /// squares and dictionary, as in charuco:8x6:DICT_5X5_100
    #[arg(long, value_name = "BOARD", conflicts_with_all = ["stature", "distance", "fps"])]
    pub board: Option<Board>,
    /// Side of a square of the board, metres
    #[arg(long, value_name = "METRES", requires = "board", value_parser = side)]
    pub square: Option<f64>,
    /// Side of a marker of a ChArUco board, metres [default: three quarters of a square]
    #[arg(long, value_name = "METRES", requires = "square", value_parser = side)]
    pub marker: Option<f64>,
    /// Picture in which the board lies on the floor, face up: its name without ending, of a film its moment, such as
    /// 2.5s; the world's z points up from there [default: from the first board that two cameras see]
    #[arg(long, value_name = "PICTURE", requires = "board")]
    pub floor: Option<String>,
    /// Lens of all cameras, or of one: a camera.toml, or a calibration of another program whose places are not believed
    /// [default: that of the record; of a film a field of view of 60 degrees]
    #[arg(long, value_name = "[CAMERA=]FILE")]
    pub lens: Vec<String>,
    /// Height of the tallest person of those who are seen at least half as long as the longest stay of anybody, visits
    /// of one height together, metres: it gives the room its size [default: 1.7, where --distance is not given either]
    #[arg(long, value_name = "METRES", value_parser = stature)]
    pub stature: Option<f64>,
    /// Distance between two cameras, as in left,right=3.2; it gives the room its size, more exactly than a height
    #[arg(long, value_name = "A,B=METRES", conflicts_with = "stature")]
    pub distance: Option<String>,
    /// Frames a second [default: by the times in the files]
    #[arg(long, value_name = "RATE", value_parser = super::multiview::rate)]
    pub fps: Option<f64>,
    /// File to write: Pose2Sim's Calib.toml, as 'multiview' reads it; of one camera's lens a camera.toml, as 'infer
    /// --camera' and --lens read it
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    #[command(flatten)]
    pub threads: ThreadsArgs,
}

/// A camera that comes out less far below the floor is not spoken of, metres: it stands on it.
const ON_FLOOR: f64 = 0.05;
/// How tall somebody may be, metres.
const STATURES: RangeInclusive<f64> = 0.5..=2.6;

fn stature(text: &str) -> Result<f64, String> {
    let metres = text
        .parse()
        .map_err(|_| "expected metres, such as 1.78".to_owned())?;
    if STATURES.contains(&metres) {
        Ok(metres)
    } else {
        let (least, most) = (STATURES.start(), STATURES.end());
        Err(format!("expected {least} to {most} metres"))
    }
}

fn side(text: &str) -> Result<f64, String> {
    let metres = text
        .parse()
        .map_err(|_| "expected metres, such as 0.025".to_owned())?;
    if (0.001..=2.0).contains(&metres) {
        Ok(metres)
    } else {
        Err("expected 0.001 to 2 metres".into())
    }
}

/// Runs the verb.
///
/// # Errors
/// When a file cannot be read, views do not go together, or too little was seen of anybody or of the board.
pub fn calibrate(args: &CalibrateArgs) -> anyhow::Result<()> {
    let files = named(&args.view)?;
    let mut apart = Apart::default().writes("--out", &args.out);
    for (_, file) in &files {
        apart = apart.reads("--view", file);
    }
    for lens in &args.lens {
        let file = Path::new(told(lens).map_or(lens.as_str(), |(_, file)| file));
        apart = apart.reads("--lens", file).reads_cameras_in("--lens", file);
    }
    apart.check()?;
    // Before films are looked at, which takes minutes.
    output::try_place(&args.out).map_err(|e| Failure::output(&args.out, &e))?;
    args.threads.run(|| match &args.board {
        Some(board) => boards::by_board(args, *board, &files),
        None => people::by_people(args, &files),
    })
}

/// Names and files of `NAME=FILE`, or of files that are called like their camera.
fn named(given: &[String]) -> anyhow::Result<Vec<(String, PathBuf)>> {
    let mut all: Vec<(String, PathBuf)> = Vec::new();
    for text in given {
        let (name, file) = one_named(text);
        if let Some((_, other)) = all.iter().find(|(n, _)| *n == name) {
            return Err(Failure::usage(format!(
                "expected every camera once, found {name} in {} and {}; name them by CAMERA=FILE",
                other.display(),
                file.display()
            ))
            .into());
        }
        let place = file.canonicalize().ok();
        let is_same = |other: &PathBuf| place.is_some() && other.canonicalize().ok() == place;
        if let Some((other, _)) = all.iter().find(|(_, f)| is_same(f)) {
            return Err(Failure::usage(format!(
                "expected a file or folder of its own for every camera, found {} for {other} and {name}",
                file.display()
            ))
            .into());
        }
        all.push((name, file));
    }
    Ok(all)
}

/// Writes a calibration, if it is one that is read again, which says that edgecap wrote it; where the files of all
/// lenses can be read in the same two ways, so can this one.
///
/// # Errors
/// When `multiview` would refuse the cameras, or the file cannot be written.
fn write(out: &Path, views: &[View], lenses: &Lenses) -> anyhow::Result<()> {
    let name = out.display().to_string();
    let scales = views.iter().map(|view| lenses.other_scale(&view.name));
    let scales: Vec<Option<f64>> = scales.collect();
    let is_one = scales.windows(2).all(|pair| pair[0] == pair[1]);
    let text = match scales.first() {
        Some(Some(scale)) if is_one => write_doubtful(views, *scale),
        // One scale for all would change lenses of which nobody doubts.
        _ => {
            let doubtful = views.iter().zip(&scales).filter(|(_, s)| s.is_some());
            for (view, _) in doubtful {
                say::err(&as_taken(&view.name));
            }
            write_measured(views)
        }
    };
    let again = read_pose2sim(&text, &name).and_then(|views| check(&name, views));
    again.map_err(|e| Failure::data(e.to_string()))?;
    output::write(out, text.as_bytes()).map_err(|e| Failure::output(out, &e).into())
}

/// What is said of a camera whose lens may be meant in another scale, where those of others may not.
fn as_taken(camera: &str) -> String {
    format!(
        "camera {camera}: the second reading of its lens is not written, as it is not that of all cameras; if places are wrong, give --lens {camera}=FILE with its distortion in the other scale"
    )
}

/// Prints the report for people, where it does not mix with the result.
///
/// # Errors
/// When standard output cannot be written.
fn report(out: &Path, table: &str) -> anyhow::Result<()> {
    if output::is_stdout(out) {
        say::err(table.trim_end());
        return Ok(());
    }
    say::whole(table)
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2, DVec3};

    use super::*;
    use crate::camera::Brown;
    use crate::camera::calibration::write_pose2sim;

    fn views(names: [&str; 2]) -> Vec<View> {
        let one = |(k, name): (usize, &str)| View {
            name: name.to_owned(),
            size: [640, 480],
            focal: DVec2::splat(600.0),
            centre: DVec2::new(319.5, 239.5),
            distortion: Brown::default(),
            rotation: DMat3::IDENTITY,
            position: DVec3::X * k as f64,
        };
        names.into_iter().enumerate().map(one).collect()
    }

    #[test]
    fn what_is_written_is_read_again_whatever_cameras_are_called() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("Calib.toml");
        let cameras = views(["metadata", "metadata camera"]);
        write(&out, &cameras, &Lenses::read(&[], &[]).unwrap()).unwrap();
        let read = crate::camera::calibration::read(&out).unwrap().views;
        let names = |all: &[View]| all.iter().map(|v| v.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&read), names(&cameras));
    }

    #[test]
    fn a_calibration_that_nobody_would_read_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("Calib.toml");
        let mut same = views(["a", "b"]);
        same[1].position = same[0].position;
        let lenses = Lenses::read(&[], &[]).unwrap();
        let said = write(&out, &same, &lenses).unwrap_err().to_string();
        assert!(said.contains("every camera once"), "{said}");
        assert!(!out.exists());
    }

    #[test]
    fn lenses_of_qtm_keep_their_second_reading() {
        let folder = tempfile::tempdir().unwrap();
        let [lens, out] = ["lens.qca.txt", "Calib.toml"].map(|name| folder.path().join(name));
        let text = r#"<calibration><cameras><camera active="1" serial="a" viewrotation="0">
            <fov_video_max left="0" top="0" right="639" bottom="479"/>
            <transform r11="0" r12="1" r13="0" r21="0" r22="0" r23="1" r31="1" r32="0" r33="0" x="3000" y="0" z="1500"/>
            <intrinsic centerPointU="20448" centerPointV="15328" focalLengthU="38400" focalLengthV="38400"
              radialDistortion1="-0.2" radialDistortion2="0" tangentalDistortion1="0" tangentalDistortion2="0"/>
            </camera></cameras></calibration>"#;
        std::fs::write(&lens, text).unwrap();
        let cameras = ["a", "b"].map(|name| (name.to_owned(), PathBuf::from("none")));
        let lenses = Lenses::read(&[lens.display().to_string()], &cameras).unwrap();
        let mut cameras = views(["a", "b"]);
        for view in &mut cameras {
            view.distortion = lenses.of(&view.name, view.size).unwrap().distortion;
        }
        write(&out, &cameras, &lenses).unwrap();
        let read = crate::camera::calibration::read(&out).unwrap();
        let (other, what) = read.alternative.unwrap();
        assert_eq!(what, "distortion divided by 64");
        assert!((other[0].distortion.radial[0] + 0.2 / 64.0).abs() < 1e-12);
    }

    /// Of two cameras one is of QTM's file, which can be read two ways; that of a third is not used.
    #[test]
    fn lenses_with_one_reading_get_no_second_one() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let mut cameras = views(["a", "b"]);
        for view in &mut cameras {
            // As QTM would have it, -0.19.
            view.distortion.radial[0] = -0.003;
        }
        let third = View {
            name: "c".into(),
            position: DVec3::X * 2.0,
            ..cameras[0].clone()
        };
        let of_three = [&cameras[..], &[third]].concat();
        std::fs::write(at("other.toml"), write_pose2sim(&of_three)).unwrap();
        std::fs::write(at("own.toml"), write_measured(&of_three)).unwrap();
        let given = |lens: &str, of: &str| format!("{of}={}", at(lens).display());
        let all = ["a", "b", "c"].map(|name| (name.to_owned(), PathBuf::from("none")));
        for (of, has_both) in [("b", false), ("a", false), ("c", false), ("both", true)] {
            let lens = match of {
                "both" => vec![at("other.toml").display().to_string()],
                of => vec![
                    at("own.toml").display().to_string(),
                    given("other.toml", of),
                ],
            };
            let lenses = Lenses::read(&lens, &all).unwrap();
            write(&at("Calib.toml"), &cameras, &lenses).unwrap();
            let read = crate::camera::calibration::read(&at("Calib.toml")).unwrap();
            assert_eq!(read.alternative.is_some(), has_both, "{of}");
            assert_eq!(
                lenses.other_scale("c").is_some(),
                ["c", "both"].contains(&of)
            );
        }
    }

    #[test]
    fn a_file_is_of_one_camera() {
        let folder = tempfile::tempdir().unwrap();
        let film = folder.path().join("film.mp4").display().to_string();
        let given = [format!("a={film}"), format!("b={film}")];
        // Films that are not there are told by whoever opens them.
        assert_eq!(named(&given).unwrap().len(), 2);
        std::fs::write(&film, "").unwrap();
        let said = named(&given).unwrap_err().to_string();
        assert!(said.contains("for a and b"), "{said}");
    }
}
