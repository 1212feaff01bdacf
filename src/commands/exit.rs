//! Exit codes of `sysexits.h`, and which error earns which.

use edgecap_client::LinkError;

use crate::camera::CameraError;
use crate::capture::CaptureError;
use crate::config::Mistake;
use crate::counted::counted;
use crate::engine::{EngineError, ModelError, NetworkError};
use crate::export::ExportError;
use crate::output::{is_stdout, kept_at, no_room};
use crate::record::{RecordError, no_whole_frame};
use crate::sink::SinkError;

/// The command line was wrong.
pub const USAGE: u8 = 64;
/// The input's content was wrong.
pub const DATA: u8 = 65;
/// The input could not be opened.
pub const NO_INPUT: u8 = 66;
/// A device or service is not there or is taken.
pub const UNAVAILABLE: u8 = 69;
/// Our own fault.
pub const SOFTWARE: u8 = 70;
/// What Rust ends a process with whose main thread panicked.
pub const PANICKED: u8 = 101;
/// The output could not be created.
pub const CANNOT_CREATE: u8 = 73;
/// Reading or writing failed on the way.
pub const IO: u8 = 74;
/// Taken at the moment.
pub const TRY_LATER: u8 = 75;
/// The system does not let this user do it.
pub const NO_PERMISSION: u8 = 77;
/// Ended by the user: 128 + SIGINT, as shells have it.
pub const INTERRUPTED: u8 = 130;
/// A configuration file was wrong.
pub const CONFIG: u8 = 78;

/// An error that carries its exit code.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Failure {
    code: u8,
    message: String,
}

impl Failure {
    /// The user asked for something that does not exist or does not go together.
    pub fn usage(message: impl Into<String>) -> Self {
        Self {
            code: USAGE,
            message: message.into(),
        }
    }

    /// A result could not be written. Of a full disk, and of a reader who has left, the place is not to blame.
    pub fn output(path: &std::path::Path, cause: &std::io::Error) -> Self {
        let name = match is_stdout(path) {
            true => "standard output".to_owned(),
            false => path.display().to_string(),
        };
        if cause.kind() == std::io::ErrorKind::BrokenPipe {
            return Self {
                code: IO,
                message: format!("{name}: writing stopped (nobody reads it any more)"),
            };
        }
        let (at, cause) = match kept_at(cause) {
            Some((at, why)) => (Some(at), why),
            None => (None, cause),
        };
        let (code, why) = match no_room(cause) {
            Some(full) => (IO, full.to_owned()),
            None => (CANNOT_CREATE, cause.to_string()),
        };
        let rest = match at {
            Some(at) => format!("; what was made lies in {}", at.display()),
            None if code == IO => String::new(),
            None => "; choose a writable place".to_owned(),
        };
        Self {
            code,
            message: format!("cannot write {name}: {why}{rest}"),
        }
    }

    /// A result would replace what is there.
    pub fn exists(message: impl Into<String>) -> Self {
        Self {
            code: CANNOT_CREATE,
            message: message.into(),
        }
    }

    /// The system has no thread for what is needed.
    pub fn no_thread(what: &str, cause: &std::io::Error) -> Self {
        Self::unavailable(format!(
            "expected a thread {what}, found none to be had ({cause}): raise TasksMax= of the service, the container's \
             limit of processes or 'ulimit -u'"
        ))
    }

    /// An input file cannot be opened.
    pub fn no_input(path: &std::path::Path, cause: &std::io::Error) -> Self {
        let message = format!(
            "cannot open {}: {cause}; check the path and its permissions",
            path.display()
        );
        Self {
            code: NO_INPUT,
            message,
        }
    }

    /// Somebody else is at it.
    pub fn try_later(message: impl Into<String>) -> Self {
        Self {
            code: TRY_LATER,
            message: message.into(),
        }
    }

    /// What is needed is taken.
    pub fn unavailable(message: impl Into<String>) -> Self {
        Self {
            code: UNAVAILABLE,
            message: message.into(),
        }
    }

    /// An input file's content is wrong.
    pub fn data(message: impl Into<String>) -> Self {
        Self {
            code: DATA,
            message: message.into(),
        }
    }

    /// A record has no frame in it.
    pub fn no_frames(name: &str, what: &str) -> Self {
        Self::data(format!(
            "{name}: expected a record of {what}, found no frame in it; record again"
        ))
    }

    /// A record has no whole frame in it, whether or not it was cut off inside its first.
    pub fn no_whole_frame(name: &str, what: &str, was_cut: bool) -> Self {
        match was_cut {
            false => Self::no_frames(name, what),
            true => Self::data(no_whole_frame(name, what)),
        }
    }

    /// The user stopped the work when `frames` were done.
    pub fn stopped(frames: u64) -> Self {
        let message = match frames {
            0 => "stopped before the first frame; nothing was written".to_owned(),
            n => format!(
                "stopped after {}; there are results of no more",
                counted(n, "frame", "frames")
            ),
        };
        Self {
            code: INTERRUPTED,
            message,
        }
    }

    /// A configuration file is wrong.
    pub fn config(message: impl Into<String>) -> Self {
        Self {
            code: CONFIG,
            message: message.into(),
        }
    }

    /// The user may not do this.
    pub fn permission(message: impl Into<String>) -> Self {
        Self {
            code: NO_PERMISSION,
            message: message.into(),
        }
    }

    /// A child process failed and has already said why.
    pub fn silent(code: u8) -> Self {
        Self {
            code,
            message: String::new(),
        }
    }
}

/// How a verb ended that has computed `frames`: what it broke off at, and what was only left out of an input that it
/// has read to its end. Results of the latter are whole.
pub fn without_left_out(
    outcome: anyhow::Result<()>,
    frames: u64,
) -> (anyhow::Result<()>, anyhow::Result<()>) {
    let is_left_out =
        |e: &anyhow::Error| matches!(e.downcast_ref(), Some(CaptureError::Picture { .. }));
    match outcome {
        Err(e) if frames > 0 && is_left_out(&e) => (Ok(()), Err(e)),
        outcome => (outcome, Ok(())),
    }
}

/// Whether what ended with this code may go well when it is started again.
pub fn may_pass(code: u8) -> bool {
    matches!(code, UNAVAILABLE | SOFTWARE | IO | TRY_LATER)
}

/// An error in one line: what went wrong and why. Causes that a message names already are not said again.
pub fn told(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if line.is_empty() {
            line = cause;
        } else if !line.contains(&cause) {
            line = format!("{line}: {cause}");
        }
    }
    line
}

/// The same, also where the user was told by the process that failed.
pub fn told_again(error: &anyhow::Error) -> String {
    match is_silent(error) {
        true => format!("its process has said why (exit code {})", code(error)),
        false => told(error),
    }
}

/// The exit code for an error: the first cause that knows one, else [`SOFTWARE`].
pub fn code(error: &anyhow::Error) -> u8 {
    error
        .chain()
        .find_map(|cause| {
            if let Some(e) = cause.downcast_ref::<Failure>() {
                return Some(e.code);
            }
            if cause.is::<Mistake>() {
                return Some(CONFIG);
            }
            if let Some(e) = cause.downcast_ref::<CaptureError>() {
                return Some(e.exit_code());
            }
            if let Some(e) = cause.downcast_ref::<CameraError>() {
                return Some(e.exit_code());
            }
            match cause.downcast_ref::<EngineError>() {
                Some(
                    EngineError::Isa(_) | EngineError::Algorithms(_) | EngineError::Size { .. },
                ) => return Some(USAGE),
                Some(EngineError::Model(e)) => return Some(model_code(e)),
                Some(
                    EngineError::NotQuantised
                    | EngineError::Outputs(_)
                    | EngineError::Layer(_)
                    | EngineError::Overflow(_)
                    | EngineError::Wild { .. }
                    | EngineError::Plan(_)
                    | EngineError::Packed { .. }
                    | EngineError::Kernel { .. },
                ) => return Some(DATA),
                _ => {}
            }
            if let Some(e) = cause.downcast_ref::<ModelError>() {
                return Some(model_code(e));
            }
            if let Some(e) = cause.downcast_ref::<NetworkError>() {
                return Some(match e {
                    NetworkError::Unknown { .. } => USAGE,
                    NetworkError::Syntax(_) | NetworkError::Inconsistent { .. } => DATA,
                });
            }
            if let Some(e) = cause.downcast_ref::<RecordError>() {
                return Some(record_code(e));
            }
            if let Some(e) = cause.downcast_ref::<ExportError>() {
                return Some(match e {
                    ExportError::Extension(_) => USAGE,
                    ExportError::Record(e) => record_code(e),
                    _ => DATA,
                });
            }
            if let Some(e) = cause.downcast_ref::<SinkError>() {
                return Some(match e {
                    SinkError::Create { cause, .. } if no_room(cause).is_some() => IO,
                    SinkError::Create { .. } => CANNOT_CREATE,
                    SinkError::Write { cause, .. } | SinkError::Lost { cause, .. }
                        if only_lacks_its_name(cause) =>
                    {
                        CANNOT_CREATE
                    }
                    SinkError::Write { .. } | SinkError::Lost { .. } => IO,
                    SinkError::Kind { .. } => USAGE,
                    SinkError::Picture(e) => e.exit_code(),
                    SinkError::Link(e) => link_code(e),
                });
            }
            if let Some(e) = cause.downcast_ref::<std::io::Error>() {
                return Some(match e.kind() {
                    std::io::ErrorKind::PermissionDenied => NO_PERMISSION,
                    std::io::ErrorKind::NotFound => NO_INPUT,
                    _ => IO,
                });
            }
            cause.downcast_ref::<LinkError>().map(link_code)
        })
        .unwrap_or(SOFTWARE)
}

/// Whether a result is whole and lies under another name.
fn only_lacks_its_name(cause: &std::io::Error) -> bool {
    kept_at(cause).is_some_and(|(_, why)| no_room(why).is_none())
}

/// Whether the user has been told already.
pub fn is_silent(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<Failure>()
        .is_some_and(|f| f.message.is_empty())
}

fn record_code(error: &RecordError) -> u8 {
    match error {
        RecordError::Io { .. } => IO,
        RecordError::Other { .. } | RecordError::Line { .. } | RecordError::Frame { .. } => DATA,
    }
}

fn link_code(error: &LinkError) -> u8 {
    match error {
        LinkError::Name(_) => USAGE,
        LinkError::Busy { .. }
        | LinkError::Version { .. }
        | LinkError::Full { .. }
        | LinkError::NoPlace { .. } => UNAVAILABLE,
        LinkError::Place { .. } | LinkError::Permission { .. } => NO_PERMISSION,
        LinkError::SharedMemory { .. } => IO,
    }
}

fn model_code(error: &ModelError) -> u8 {
    match error {
        ModelError::Io { action: "read", .. } | ModelError::NotShipped => NO_INPUT,
        ModelError::Io { source, .. }
            if no_room(source).is_some() || source.kind() == std::io::ErrorKind::BrokenPipe =>
        {
            IO
        }
        ModelError::Io { .. } => CANNOT_CREATE,
        ModelError::NoRange(_) => USAGE,
        _ => DATA,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;

    /// A supervisor starts what failed on the way again and again, and what is not to be had only where it was before.
    #[test]
    fn no_room_for_messages_is_no_failure_on_the_way() {
        let full = LinkError::Full {
            service: "edgecap/v2/hall/bodies".into(),
            folder: "/dev/shm".into(),
            needed: 10,
            free: 4,
        };
        assert_eq!(code(&full.into()), UNAVAILABLE);
    }

    /// A supervisor would start it for ever.
    #[test]
    fn a_network_that_the_engine_refuses_is_bad_data() {
        for refused in [
            EngineError::NotQuantised,
            EngineError::Outputs("none".into()),
            EngineError::Layer("head2d.out".into()),
            EngineError::Overflow("stem".into()),
        ] {
            let line = refused.to_string();
            assert_eq!(code(&refused.into()), DATA, "{line}");
        }
    }

    #[test]
    fn what_was_left_out_breaks_nothing_off() {
        let bad = || CaptureError::Picture {
            input: "2.jpg".into(),
            reason: "damaged".into(),
        };
        let left_out = || Err(anyhow::Error::from(bad()).context("left out"));
        let (outcome, after) = without_left_out(left_out(), 1);
        assert!(outcome.is_ok());
        assert_eq!(code(&after.unwrap_err()), DATA);
        let (outcome, after) = without_left_out(left_out(), 0);
        assert!(outcome.is_err() && after.is_ok(), "there is no result");
        let cut = CaptureError::data("a.avi", "cut off");
        assert!(without_left_out(Err(cut.into()), 1).0.is_err());
    }

    /// Whichever verb writes, and whether or not it had begun.
    #[test]
    fn a_full_disk_is_told_as_one_and_fails_on_the_way() {
        let path = || std::path::PathBuf::from("a.glb");
        for (errno, words) in [
            (libc::ENOSPC, "the disk is full: make room"),
            (libc::EDQUOT, "the quota on the disk is used up: make room"),
            (
                libc::EFBIG,
                "the system lets no file become longer: raise the limit (ulimit -f, LimitFSIZE=)",
            ),
        ] {
            let full = || std::io::Error::from_raw_os_error(errno);
            let failure = anyhow::Error::from(Failure::output(&path(), &full()));
            assert_eq!(told(&failure), format!("cannot write a.glb: {words}"));
            assert_eq!(code(&failure), IO);
            let record = SinkError::Create {
                path: path(),
                cause: full(),
            };
            assert_eq!(code(&record.into()), IO);
            let model = ModelError::Io {
                action: "write",
                path: path(),
                source: full(),
            };
            assert_eq!(code(&model.into()), IO);
        }
        let closed = std::io::Error::from_raw_os_error(libc::EROFS);
        let failure = anyhow::Error::from(Failure::output(&path(), &closed));
        assert_eq!(code(&failure), CANNOT_CREATE);
        assert!(told(&failure).ends_with("; choose a writable place"));
    }

    #[test]
    fn a_reader_who_has_left_is_no_place_that_cannot_be_written() {
        let left = || std::io::Error::from_raw_os_error(libc::EPIPE);
        for (path, name) in [("-", "standard output"), ("a.npz", "a.npz")] {
            let failure = anyhow::Error::from(Failure::output(path.as_ref(), &left()));
            assert_eq!(code(&failure), IO);
            let words = format!("{name}: writing stopped (nobody reads it any more)");
            assert_eq!(told(&failure), words);
        }
        let model = ModelError::Io {
            action: "write",
            path: "-".into(),
            source: left(),
        };
        assert_eq!(code(&model.into()), IO);
    }

    #[test]
    fn of_a_result_that_lies_elsewhere_the_place_is_told() {
        use std::io::Write;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        let mut file = crate::output::AtomicFile::create(&path).unwrap();
        file.write_all(b"hours of work").unwrap();
        std::fs::create_dir(&path).unwrap();
        let cause = file.finish().unwrap_err();
        let failure = Failure::output(&path, &cause);
        let at = folder.path().join("a-new.glb");
        let words = format!("; what was made lies in {}", at.display());
        assert!(failure.message.ends_with(&words), "{failure}");
        assert_eq!(failure.code, CANNOT_CREATE);
        // Whichever verb has made it.
        let record = SinkError::Write { path, cause };
        assert_eq!(code(&record.into()), CANNOT_CREATE);
    }

    #[test]
    fn what_a_message_names_is_said_once() {
        let gone = || std::io::Error::new(std::io::ErrorKind::NotFound, "no such file");
        let camera = CameraError::read(std::path::Path::new("Calib.toml"), gone());
        let line = told(&camera.into());
        assert_eq!(line.matches("no such file").count(), 1, "{line}");
        let wrapped = Err::<(), _>(gone()).context("cannot start").unwrap_err();
        assert_eq!(told(&wrapped), "cannot start: no such file");
    }
}
