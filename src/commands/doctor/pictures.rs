//! Where pictures come from: cameras, and films.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::finding::{Finding, State};
use crate::capture::{CameraInfo, CaptureError, Frame, Source, list_cameras};
use crate::commands::exit;
use crate::commands::input::{self, InputArgs};

/// How long a camera may take for its first picture.
const FIRST_PICTURE: Duration = Duration::from_secs(5);
/// How long a program may take to say its version.
const VERSION: Duration = Duration::from_secs(5);

pub const CAMERA: &str = "camera";
pub const FILMS: &str = "films";

/// The camera that a run takes with these options.
pub fn camera(args: &InputArgs) -> Finding {
    let failed = |e: CaptureError| match e {
        CaptureError::Unavailable { .. } | CaptureError::Busy { .. } => {
            Finding::new(CAMERA, State::Note, e.to_string())
        }
        _ => Finding::failed(CAMERA, e),
    };
    let what = match (&args.input, list_cameras()) {
        (Some(input), _) => {
            let name = args.name.as_deref().unwrap_or_default();
            format!("{name} ({input})")
        }
        (None, Ok(cameras)) => {
            let named = |c: &CameraInfo| format!("{} ({})", c.path.display(), c.name);
            cameras.iter().map(named).collect::<Vec<_>>().join(", ")
        }
        (None, Err(e)) => return failed(e),
    };
    let opened = || -> anyhow::Result<Box<dyn Source>> { input::choose(args)?.open(args) };
    let start = Instant::now();
    let first = opened().and_then(|mut source| Ok(first_picture(&mut *source)?));
    match first {
        Ok(Some(frame)) => {
            let text = format!(
                "{what}; the first picture, {}×{}, after {:.1} s",
                frame.width,
                frame.height,
                start.elapsed().as_secs_f64()
            );
            Finding::new(CAMERA, State::Fine, text)
        }
        Ok(None) => {
            let text = format!(
                "{what}; expected a picture within {} s, got none: plug it in again, or into another socket",
                FIRST_PICTURE.as_secs()
            );
            Finding::new(CAMERA, State::Broken(exit::UNAVAILABLE), text)
        }
        Err(e) => match e.downcast() {
            Ok(e) => failed(e),
            Err(e) => Finding::failed(CAMERA, e),
        },
    }
}

fn first_picture(source: &mut dyn Source) -> Result<Option<Frame>, CaptureError> {
    let start = Instant::now();
    let mut frame = Frame::default();
    while start.elapsed() < FIRST_PICTURE {
        match source.next_into(&mut frame) {
            Ok(true) => return Ok(Some(frame)),
            Ok(false) => break,
            Err(e) if e.is_skippable() => {}
            Err(e) => return Err(e),
        }
    }
    Ok(None)
}

/// Which films play.
pub fn films() -> Finding {
    if answers("ffmpeg") && answers("ffprobe") {
        return Finding::new(FILMS, State::Fine, "ffmpeg plays whatever it can read");
    }
    let text = match cfg!(feature = "mp4") {
        true => {
            "H.264 in mp4, raw Motion-JPEG, Motion-JPEG AVI and y4m only: install ffmpeg for others"
        }
        false => "raw Motion-JPEG, Motion-JPEG AVI and y4m only: install ffmpeg for mp4 and others",
    };
    Finding::new(FILMS, State::Note, text)
}

/// Whether a program is there and says its version; one that hangs is ended.
fn answers(program: &str) -> bool {
    let mut command = Command::new(program);
    command.arg("-version").stdin(Stdio::null());
    let quiet = command.stdout(Stdio::null()).stderr(Stdio::null());
    let Ok(mut process) = quiet.spawn() else {
        return false;
    };
    let start = Instant::now();
    while start.elapsed() < VERSION {
        match process.try_wait() {
            Ok(Some(status)) => return status.success(),
            Ok(None) => std::thread::sleep(Duration::from_millis(10)),
            Err(_) => break,
        }
    }
    let _ = process.kill();
    let _ = process.wait();
    false
}
