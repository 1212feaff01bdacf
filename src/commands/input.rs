//! Which input a verb reads: what the user named, else the first camera, else the bundled clip.

use std::convert::Infallible;
use std::ffi::OsStr;
use std::fmt;
use std::io::ErrorKind;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::Context;
use clap::builder::TypedValueParser;
use serde::{Deserialize, Serialize};

use super::exit::Failure;
use crate::camera::{CameraError, CameraFile, DEFAULT_FOV, SystemClock};
use crate::capture::camera::ControlSetting;
use crate::capture::demo;
use crate::capture::{
    self, AwaitedSource, CaptureError, InputSpec, Mounting, OpenOptions, PacedSource, Source,
};
use crate::config::Setting;
use crate::supervise::{has_worked_before, is_service};

/// Stream name of a camera or pipe when the user gives none.
pub const DEFAULT_NAME: &str = "camera0";

/// Options that choose the input.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InputArgs {
    /// Photo (JPEG or PNG), folder of photos, video, '-' for y4m on stdin, camera (/dev/video0, 'camera' for the
    /// first), or 'demo' [default: the first camera, else the bundled demo clip, over and over]
    #[arg(long, value_name = "INPUT", value_parser = Words)]
    pub input: Option<String>,
    /// Name under which observations and bodies are published [default: camera0 where no input is given, of 'camera'
    /// and of '-'; else the file's or device's name without its ending, such as clip or video0]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// The lens (TOML): fov_degrees across, or a calibration's fx, fy, cx, cy, width, height; 60 degrees when not given
    #[arg(long = "camera", value_name = "FILE")]
    pub lens: Option<Setting<CameraFile>>,
    /// Picture size to ask a camera for
    #[arg(long, value_name = "WxH")]
    pub capture_size: Option<CaptureSize>,
    /// Frame rate to ask a camera for, or at which a folder's photos or a raw film (Motion-JPEG, H.264, H.265) were
    /// taken
    #[arg(long, value_name = "FPS", value_parser = parse_fps)]
    pub fps: Option<f64>,
    /// Set a control of the camera, may be given several times, in this order; 'infer --list-controls' shows what there
    /// is
    #[arg(long = "control", value_name = "NAME=VALUE")]
    pub controls: Vec<ControlSetting>,
    /// Turn the picture clockwise by so many degrees: for a camera mounted on its side (90, 270) or upside down (180)
    #[arg(long, value_name = "DEGREES", value_parser = parse_turn)]
    pub rotate: Option<u16>,
    /// Mirror the picture, because the camera shows a mirror image: else left and right of people are exchanged
    #[arg(long)]
    pub mirror: bool,
    /// Play a film as a camera would show it, over and over: at its own rate, frames dropped when they come too late
    #[arg(long)]
    pub live: bool,
}

/// Names in UTF-8: settings, records and the tasks of children hold them as text.
#[derive(Debug, Clone)]
struct Words;

impl TypedValueParser for Words {
    type Value = String;

    fn parse_ref(
        &self,
        command: &clap::Command,
        option: Option<&clap::Arg>,
        given: &OsStr,
    ) -> Result<String, clap::Error> {
        given.to_str().map(str::to_owned).ok_or_else(|| {
            let option = option.and_then(clap::Arg::get_long).unwrap_or_default();
            let message = other_bytes(&format!("--{option}"), "a path", given);
            clap::Error::raw(clap::error::ErrorKind::ValueValidation, message).with_cmd(command)
        })
    }
}

/// What to say of a name that is not UTF-8 where only such a one will do.
pub fn other_bytes(option: &str, expected: &str, given: &OsStr) -> String {
    format!(
        "{option}: expected {expected} in UTF-8, found {}; name it otherwise, or give a link to it (ln -s)",
        given.display()
    )
}

/// Reads the path of an option that settings hold, too.
pub fn path_in_words() -> impl TypedValueParser<Value = PathBuf> {
    Words.try_map(|path| match path.is_empty() {
        true => Err("expected a path, found none"),
        false => Ok(PathBuf::from(path)),
    })
}

fn parse_fps(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(fps) if (0.1..=1000.0).contains(&fps) => Ok(fps),
        _ => Err(format!(
            "'{text}': expected pictures per second, such as 30"
        )),
    }
}

fn parse_turn(text: &str) -> Result<u16, String> {
    match text.parse() {
        Ok(degrees @ (0 | 90 | 180 | 270)) => Ok(degrees),
        _ => Err(format!(
            "'{text}': expected 0, 90, 180 or 270 degrees clockwise"
        )),
    }
}

/// Width and height of a camera's pictures, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct CaptureSize(pub u32, pub u32);

impl FromStr for CaptureSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("'{text}': expected WIDTHxHEIGHT, such as 1280x720");
        let (w, h) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
        match (w.parse(), h.parse()) {
            (Ok(w), Ok(h)) if (16..=8192).contains(&w) && (16..=8192).contains(&h) => {
                Ok(Self(w, h))
            }
            _ => Err(wrong()),
        }
    }
}

impl TryFrom<String> for CaptureSize {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<CaptureSize> for String {
    fn from(size: CaptureSize) -> Self {
        size.to_string()
    }
}

impl fmt::Display for CaptureSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.0, self.1)
    }
}

/// An input, named.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedInput {
    /// What to open.
    pub spec: InputSpec,
    /// Stream name.
    pub name: String,
    is_camera: bool,
    plays_live: bool,
    /// The bundled clip, because there is no camera.
    pub stands_in: bool,
}

impl InputArgs {
    fn wishes(&self) -> OpenOptions {
        OpenOptions {
            size: self.capture_size.map(|CaptureSize(w, h)| (w, h)),
            fps: self.fps,
            controls: self.controls.clone(),
        }
    }

    /// The arguments that name `chosen`, whatever the machine has when they are read.
    pub fn resolved(&self, chosen: &NamedInput) -> Self {
        Self {
            input: Some(chosen.spec.to_string()),
            name: Some(chosen.name.clone()),
            live: chosen.plays_live,
            ..self.clone()
        }
    }
}

impl InputArgs {
    /// Refuses what was typed for a camera, or for pictures without times, and means nothing for this input. Settings
    /// are of all inputs that a user has.
    ///
    /// # Errors
    /// Exit code 64.
    pub fn expect_use(&self, chosen: &NamedInput) -> Result<(), Failure> {
        // A camera that is away is asked when it comes.
        if chosen.is_camera || chosen.stands_in {
            return Ok(());
        }
        let asked = [
            ("--capture-size", self.capture_size.is_some()),
            ("--control", !self.controls.is_empty()),
        ];
        if let Some((option, _)) = asked.iter().find(|(_, is_typed)| *is_typed) {
            return Err(Failure::usage(format!(
                "{option} is asked of a camera: expected a camera, found {}; leave it out",
                chosen.spec
            )));
        }
        match self.fps {
            Some(fps) if !chosen.takes_rate(fps) => Err(Failure::usage(format!(
                "--fps says when pictures without times were taken: expected a camera, photos or a raw film, found {}, \
                 which has a rate of its own; leave it out",
                chosen.spec
            ))),
            _ => Ok(()),
        }
    }

    /// How the camera is mounted.
    pub fn mounting(&self) -> Mounting {
        Mounting {
            quarter_turns: (self.rotate.unwrap_or(0) / 90) as u8,
            mirrored: self.mirror,
        }
    }
}

impl NamedInput {
    /// Whether this input, which is no camera, has the rate that is asked for, frames per second, to within a
    /// hundredth. What cannot be opened is not to blame for it.
    fn takes_rate(&self, fps: f64) -> bool {
        match &self.spec {
            InputSpec::Path(path) if path.is_dir() => true,
            InputSpec::Path(path) if !is_pipe(path) => {
                let options = OpenOptions {
                    fps: Some(fps),
                    ..OpenOptions::default()
                };
                let opened = capture::open(&self.spec, &options);
                let is_taken = |rate: f64| (rate / fps - 1.0).abs() < 0.01;
                opened
                    .ok()
                    .is_none_or(|source| source.fps().is_some_and(is_taken))
            }
            _ => false,
        }
    }

    /// Whether pictures are lost when nobody asks for them: a camera, or a film played like one.
    pub fn is_live(&self) -> bool {
        self.is_camera || self.plays_live
    }

    /// Whether it ends by itself: a film or photos. Of a pipe nobody knows.
    pub fn has_end(&self) -> bool {
        !self.is_live()
            && match &self.spec {
                InputSpec::Path(path) => !is_pipe(path),
                InputSpec::Demo => true,
                InputSpec::Stdin | InputSpec::FirstCamera | InputSpec::StandIn(_) => false,
            }
    }

    /// Opens it, a camera as soon as it is there.
    ///
    /// # Errors
    /// As [`capture::open`], except that a camera may be missing or in use, and lack what one in its place had.
    pub fn open_when_there(&self, args: &InputArgs) -> anyhow::Result<Box<dyn Source>> {
        if !self.is_camera {
            return self.open(args);
        }
        let (spec, options) = (self.spec.clone(), args.wishes());
        let open = move || capture::open(&spec, &options);
        let source = AwaitedSource::new(self.spec.to_string(), open, SystemClock);
        Ok(Box::new(source.knowing(has_worked_before())))
    }

    /// Opens it.
    ///
    /// # Errors
    /// As [`capture::open`].
    pub fn open(&self, args: &InputArgs) -> anyhow::Result<Box<dyn Source>> {
        let options = args.wishes();
        let spec = self.spec.clone();
        let open = move || match &spec {
            InputSpec::Demo => capture::open_bytes("demo", demo::CLIP),
            spec => capture::open(spec, &options),
        };
        if !self.plays_live {
            return Ok(open()?);
        }
        Ok(Box::new(PacedSource::new(open, SystemClock)?))
    }
}

/// Whether pictures can be read there once, from front to back.
fn is_pipe(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|m| m.file_type().is_fifo())
}

/// Whether an input is a stream of the network, whose name is no path.
pub fn is_network(input: &str) -> bool {
    input.contains("://")
}

/// Decides which input the arguments mean.
///
/// # Errors
/// If a pipe is to be played like a camera: it has a pace of its own. Network streams.
pub fn choose(args: &InputArgs) -> anyhow::Result<NamedInput> {
    if let Some(url) = args.input.as_ref().filter(|text| is_network(text)) {
        return Err(Failure::usage(format!(
            "{url}: expected a file or a camera, found a network stream, which is not read: hand it on by ffmpeg -i '{url}' -f yuv4mpegpipe -pix_fmt yuv420p - | edgecap --input -"
        ))
        .into());
    }
    let spec = match &args.input {
        Some(text) => text
            .parse()
            .unwrap_or_else(|never: Infallible| match never {}),
        None => match capture::list_cameras() {
            // Who reads a service's bodies takes them for people who are there.
            Err(CaptureError::Unavailable { .. }) if !is_service() => InputSpec::Demo,
            // Also a camera that this user may not open: opening it says what to do.
            _ => InputSpec::FirstCamera,
        },
    };
    let is_camera = match &spec {
        InputSpec::FirstCamera | InputSpec::StandIn(_) => true,
        InputSpec::Path(path) => std::fs::metadata(path).map_or_else(
            |_| capture::is_camera_place(path),
            |m| m.file_type().is_char_device(),
        ),
        InputSpec::Demo | InputSpec::Stdin => false,
    };
    let pipe = match &spec {
        InputSpec::Stdin => Some("standard input".to_owned()),
        InputSpec::Path(path) if is_pipe(path) => Some(format!("the pipe {}", path.display())),
        _ => None,
    };
    if let Some(pipe) = pipe.filter(|_| args.live) {
        return Err(Failure::usage(format!(
            "--live plays a film from its start: expected a file, found {pipe}; leave --live out"
        ))
        .into());
    }
    let name = args.name.clone().unwrap_or_else(|| match &spec {
        InputSpec::Demo if args.input.is_some() => "demo".to_owned(),
        InputSpec::Path(path) => stream_name(path),
        // The clip in place of a camera is read as the camera would be.
        InputSpec::Demo | InputSpec::Stdin | InputSpec::FirstCamera | InputSpec::StandIn(_) => {
            DEFAULT_NAME.to_owned()
        }
    });
    let stands_in = args.input.is_none() && spec == InputSpec::Demo;
    Ok(NamedInput {
        spec,
        name,
        is_camera,
        plays_live: (args.live || stands_in) && !is_camera,
        stands_in,
    })
}

/// The lens that a file describes.
///
/// # Errors
/// If it cannot be read or is wrong; where it is not there, somebody may have meant a camera's name.
pub fn lens(file: &Path) -> anyhow::Result<CameraFile> {
    let read = CameraFile::read(file);
    let is_missing = matches!(&read, Err(CameraError::Read { source, .. }) if source.kind() == ErrorKind::NotFound);
    match is_missing {
        true => read.context(
            "--camera (lens in the settings) is the file of the lens, --name the camera's name",
        ),
        false => Ok(read?),
    }
}

/// The camera that the arguments name.
///
/// # Errors
/// If its file is wrong.
pub fn camera_file(args: &InputArgs, chosen: &NamedInput) -> anyhow::Result<CameraFile> {
    Ok(match &args.lens {
        Some(Setting::File(path)) => lens(path)?,
        Some(Setting::Given(lens)) => *lens,
        None if chosen.spec == InputSpec::Demo => demo::camera(),
        None => {
            tracing::warn!(
                "no lens given: {DEFAULT_FOV} degrees across are assumed; with a lens of 75 everybody stands a third too far away, with one of 50 a fifth too near. Give --camera FILE with fov_degrees"
            );
            CameraFile::default()
        }
    })
}

/// Under which name a film's or a device's streams are published where the user gives none.
pub fn stream_name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    service_name(&stem.to_string_lossy())
}

fn service_name(stem: &str) -> String {
    let name: String = stem
        .chars()
        .map(|c| {
            if c.is_ascii_alphanumeric() || c == '-' {
                c
            } else {
                '_'
            }
        })
        .take(64)
        .collect();
    match name.is_empty() {
        true => DEFAULT_NAME.to_owned(),
        false if stem.is_ascii() => name,
        // Names of other alphabets would be one and the same.
        false => {
            let digits = blake3::hash(stem.as_bytes()).to_hex();
            format!("{}-{}", &name[..name.len().min(59)], &digits[..4])
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_streams_are_plain_and_differ() {
        assert_eq!(service_name("my film-2"), "my_film-2");
        assert_eq!(service_name(""), DEFAULT_NAME);
        let names = ["甲", "乙", "Zoë", "Zoé"].map(service_name);
        for (k, name) in names.iter().enumerate() {
            let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
            assert!(name.chars().all(plain), "{name}");
            assert!(!names[..k].contains(name), "{name}");
        }
        assert_eq!(service_name(&"é".repeat(99)).len(), 64);
    }

    #[test]
    fn what_is_typed_for_cameras_or_pictures_without_times_is_not_taken_for_films() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        std::fs::create_dir(at("photos")).unwrap();
        for (name, start) in [
            ("film.y4m", &b"YUV4MPEG2 W16 H16 F30:1 C420jpeg\n"[..]),
            ("photo.jpg", b"\xFF\xD8\xFF\xE0"),
            ("raw.mjpeg", b"\xFF\xD8\xFF\xE0"),
        ] {
            std::fs::write(at(name), start).unwrap();
        }
        let refused = |input: &str, typed: &InputArgs| {
            let args = InputArgs {
                input: Some(input.to_owned()),
                ..typed.clone()
            };
            let refused = args.expect_use(&choose(&args).unwrap()).err();
            refused.map(|e| e.to_string())
        };
        let rate = InputArgs {
            fps: Some(10.0),
            ..InputArgs::default()
        };
        for input in [at("film.y4m").as_str(), "demo", "-"] {
            let said = refused(input, &rate).unwrap();
            assert!(
                said.starts_with("--fps says") && said.contains(input),
                "{said}"
            );
        }
        for input in ["photos", "photo.jpg", "raw.mjpeg", "none.y4m"] {
            assert_eq!(refused(&at(input), &rate), None, "{input}");
        }
        assert_eq!(refused("/dev/video97", &rate), None);
        let same = InputArgs {
            fps: Some(30.0),
            ..InputArgs::default()
        };
        assert_eq!(refused(&at("film.y4m"), &same), None);
        for (option, typed) in [
            (
                "--capture-size",
                InputArgs {
                    capture_size: Some(CaptureSize(64, 64)),
                    ..InputArgs::default()
                },
            ),
            (
                "--control",
                InputArgs {
                    controls: vec!["gain=1".parse().unwrap()],
                    ..InputArgs::default()
                },
            ),
        ] {
            for input in ["film.y4m", "photos"] {
                let said = refused(&at(input), &typed).unwrap();
                assert!(said.starts_with(option), "{said}");
            }
            assert_eq!(refused("/dev/video97", &typed), None);
        }
    }
}
