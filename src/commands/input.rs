//! Which input a verb reads: what the user named, else the first camera, else the bundled clip.

use std::io::Cursor;
use std::path::PathBuf;

use super::exit::Failure;
use crate::capture::{self, CameraModel, InputSpec, Source, SourceOptions};
use crate::synth::demo;

/// Stream name of a camera or pipe when the user gives none.
pub const DEFAULT_NAME: &str = "camera0";
/// The word that stands for the bundled clip.
const DEMO: &str = "demo";

/// Options that choose the input.
#[derive(Debug, Clone, clap::Args)]
pub struct InputArgs {
    /// Photo, folder of photos, video, '-' for y4m on stdin, camera (/dev/video0, 'camera' for the first), or 'demo'
    /// [default: the first camera, else the bundled demo clip]
    #[arg(long, value_name = "INPUT")]
    pub input: Option<String>,
    /// Name under which observations and bodies are published [default: camera0, or the file's name]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Camera intrinsics: fx, fy, cx, cy, width, height, or fov_degrees (TOML); 60 degrees across when not given
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Picture size to ask a camera for
    #[arg(long, value_name = "WxH", value_parser = parse_capture_size, default_value = "1280x720")]
    pub capture_size: (u32, u32),
    /// Frame rate to ask a camera for
    #[arg(long, value_name = "FPS", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=240))]
    pub capture_fps: u32,
}

fn parse_capture_size(text: &str) -> Result<(u32, u32), String> {
    let wrong = || format!("'{text}': expected WIDTHxHEIGHT, such as 1280x720");
    let (w, h) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
    match (w.parse(), h.parse()) {
        (Ok(w), Ok(h)) if (16..=8192).contains(&w) && (16..=8192).contains(&h) => Ok((w, h)),
        _ => Err(wrong()),
    }
}

/// An input, named.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    /// What to open.
    pub kind: Kind,
    /// The input in words.
    pub label: String,
    /// Stream name.
    pub name: String,
}

/// Kinds of input a verb distinguishes.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// The bundled clip.
    Demo,
    /// Anything [`capture::open`] opens.
    Spec(InputSpec),
}

impl Chosen {
    /// Whether the input has an end and its own clock.
    pub fn is_file(&self) -> bool {
        match &self.kind {
            Kind::Demo => true,
            Kind::Spec(spec) => !spec.is_camera(),
        }
    }

    /// Whether it can be read a second time.
    pub fn can_reopen(&self) -> bool {
        match &self.kind {
            Kind::Demo => true,
            Kind::Spec(spec) => !spec.is_camera() && !spec.is_stdin(),
        }
    }

    /// Opens it.
    ///
    /// # Errors
    /// As [`capture::open`].
    pub fn open(&self, args: &InputArgs) -> anyhow::Result<Box<dyn Source>> {
        Ok(match &self.kind {
            Kind::Demo => capture::open_clip(Cursor::new(demo::CLIP), DEMO)?,
            Kind::Spec(spec) => {
                let (width, height) = args.capture_size;
                capture::open(spec, &SourceOptions { width, height, fps: args.capture_fps })?
            }
        })
    }
}

/// Decides which input the arguments mean.
///
/// # Errors
/// If the input cannot be understood.
pub fn choose(args: &InputArgs) -> anyhow::Result<Chosen> {
    let text = match &args.input {
        Some(text) => text.clone(),
        None if capture::list_cameras().is_empty() => DEMO.to_owned(),
        None => "camera".to_owned(),
    };
    let kind = if text == DEMO { Kind::Demo } else { Kind::Spec(InputSpec::parse(&text)?) };
    let name = args.name.clone().unwrap_or_else(|| match &kind {
        Kind::Demo => DEMO.to_owned(),
        Kind::Spec(spec) => spec.file_stem().map_or_else(|| DEFAULT_NAME.to_owned(), |stem| service_name(&stem)),
    });
    Ok(Chosen { kind, label: text, name })
}

/// The camera model that the arguments name.
///
/// # Errors
/// If its file is wrong.
pub fn camera_model(args: &InputArgs, chosen: &Chosen) -> anyhow::Result<CameraModel> {
    if args.camera.is_none() && chosen.kind == Kind::Demo {
        return Ok(demo::camera());
    }
    CameraModel::read(args.camera.as_deref()).map_err(|e| Failure::config(e.to_string()).into())
}

fn service_name(stem: &str) -> String {
    let name: String = stem.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).take(64).collect();
    if name.is_empty() { DEFAULT_NAME.to_owned() } else { name }
}
