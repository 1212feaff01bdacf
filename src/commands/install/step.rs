//! One file or one command.

use std::fs::{self, File, Metadata, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use rustix::process::geteuid;

use super::below;
use crate::commands::exit::Failure;
use crate::output::AtomicFile;

/// What is to be done.
#[derive(Debug, Clone)]
pub enum Step {
    /// A file with these bytes. One that the user may have changed is `kept`, and loses what permissions it has beyond
    /// these.
    Write {
        /// Where.
        path: PathBuf,
        /// What.
        bytes: Vec<u8>,
        /// Permissions.
        mode: u32,
        /// Whether an older one stays.
        kept: bool,
    },
    /// No file; one that the user may have changed goes only if it was not.
    Remove {
        /// Where.
        path: PathBuf,
        /// [Digests](digest) of what it may hold unless it was changed.
        unless_changed_from: Option<Vec<String>>,
        /// Its folders below these go with it once nothing is in them.
        emptied_below: Vec<PathBuf>,
    },
    /// No folder where nothing is in it.
    RemoveEmpty {
        /// Where.
        path: PathBuf,
    },
    /// No folder, whatever is in it.
    Clear {
        /// Where.
        path: PathBuf,
    },
    /// A command.
    Run {
        /// Program and arguments.
        line: Vec<String>,
        /// What is lost if it fails.
        loss: Loss,
    },
}

/// What is lost with a command that fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// All that follows.
    Everything,
    /// What the user wants: a service that runs, or one that does not run any more.
    Service,
    /// Nothing that the next start of the machine does not bring.
    Nothing,
}

/// What became of a step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Done {
    /// Made anew.
    Written,
    /// Replaced.
    Replaced,
    /// Was as it should be.
    Unchanged,
    /// Is the user's.
    Kept,
    /// Gone now.
    Removed,
    /// Was not there.
    Absent,
    /// Done.
    Ran,
    /// Failed, which is no reason to stop; why.
    Failed {
        /// In one line.
        why: String,
        /// What is lost.
        loss: Loss,
    },
    /// Not for a folder other than the machine's own.
    Skipped,
}

impl Done {
    /// In a word.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Written => "write",
            Self::Replaced => "replace",
            Self::Unchanged => "unchanged",
            Self::Kept => "keep",
            Self::Removed => "remove",
            Self::Absent => "absent",
            Self::Ran => "run",
            Self::Failed { .. } => "failed",
            Self::Skipped => "skip",
        }
    }
}

impl Step {
    /// A command that is needed.
    pub fn run(line: &[&str]) -> Self {
        Self::command(line, Loss::Everything)
    }

    /// A command without which the files are there and the service is not as it should be.
    pub fn serve(line: &[&str]) -> Self {
        Self::command(line, Loss::Service)
    }

    /// A command that may fail: where there is no systemd running, or nothing to be told.
    pub fn try_run(line: &[&str]) -> Self {
        Self::command(line, Loss::Nothing)
    }

    fn command(line: &[&str], loss: Loss) -> Self {
        Self::Run {
            line: line.iter().map(ToString::to_string).collect(),
            loss,
        }
    }

    /// In words.
    pub fn describe(&self, root: Option<&Path>) -> String {
        match self {
            Self::Write {
                path, mode, kept, ..
            } => {
                let path = below(root, path);
                let found = fs::symlink_metadata(&path).ok().filter(|_| *kept);
                let mode = match &found {
                    None => *mode,
                    Some(found) => narrowed(found, *mode).unwrap_or_else(|| behind(&path, found)),
                };
                format!("{} ({mode:o})", path.display())
            }
            Self::Remove { path, .. } if is_masked(&below(root, path)) => {
                format!("{} (masked)", below(root, path).display())
            }
            Self::Remove { path, .. } | Self::RemoveEmpty { path } | Self::Clear { path } => {
                below(root, path).display().to_string()
            }
            Self::Run { line, .. } => line.join(" "),
        }
    }

    /// What [`take`](Self::take) would do.
    pub fn look(&self, root: Option<&Path>) -> Done {
        match self {
            Self::Write {
                path,
                bytes,
                mode,
                kept,
            } => match fs::symlink_metadata(below(root, path)) {
                Err(_) => Done::Written,
                Ok(_) if *kept => Done::Kept,
                // What a link leads to is not ours.
                Ok(meta) => {
                    let same = meta.is_file()
                        && meta.permissions().mode() & 0o777 == *mode
                        && fs::read(below(root, path)).is_ok_and(|b| b == *bytes);
                    if same {
                        Done::Unchanged
                    } else {
                        Done::Replaced
                    }
                }
            },
            Self::Remove {
                path,
                unless_changed_from,
                ..
            } => {
                let path = below(root, path);
                let ours = match (fs::symlink_metadata(&path), unless_changed_from) {
                    (Err(e), _) => return unseen(&e),
                    (Ok(meta), _) if meta.is_dir() || is_masked(&path) => return Done::Kept,
                    (Ok(_), None) => return Done::Removed,
                    (Ok(_), Some(ours)) => ours,
                };
                match fs::read(&path) {
                    Ok(found) if ours.contains(&digest(&found)) => Done::Removed,
                    Ok(_) => Done::Kept,
                    Err(e) => Done::Failed {
                        why: format!("whether it was changed cannot be seen: {e}"),
                        loss: Loss::Nothing,
                    },
                }
            }
            Self::RemoveEmpty { path } => {
                let path = below(root, path);
                match fs::read_dir(&path).map(|mut entries| entries.next().is_none()) {
                    Err(e) => unseen(&e),
                    Ok(true) if !path.is_symlink() => Done::Removed,
                    Ok(_) => Done::Kept,
                }
            }
            Self::Clear { path } => match fs::symlink_metadata(below(root, path)) {
                Err(e) => unseen(&e),
                Ok(meta) if meta.is_dir() => Done::Removed,
                Ok(_) => Done::Kept,
            },
            Self::Run { .. } => Done::Ran,
        }
    }

    /// Does it.
    ///
    /// # Errors
    /// Files that cannot be written or removed, needed commands that fail.
    pub fn take(&self, root: Option<&Path>) -> anyhow::Result<Done> {
        let done = self.look(root);
        match self {
            Self::Write {
                path, bytes, mode, ..
            } if matches!(done, Done::Written | Done::Replaced) => {
                let path = below(root, path);
                let written = write(&path, bytes)
                    .and_then(|()| fs::set_permissions(&path, Permissions::from_mode(*mode)));
                written.map_err(|e| Failure::output(&path, &e))?;
            }
            Self::Write { path, mode, .. } if done == Done::Kept => {
                if let Err(e) = narrow(&below(root, path), *mode) {
                    return Ok(Done::Failed {
                        why: format!("others may still read it: {e}"),
                        loss: Loss::Nothing,
                    });
                }
            }
            Self::Remove {
                path,
                emptied_below,
                ..
            } if done == Done::Removed => {
                let file = below(root, path);
                fs::remove_file(&file).map_err(|e| Failure::output(&file, &e))?;
                let may_go = |folder: &&Path| {
                    let is_inside = |f: &PathBuf| folder.starts_with(f) && folder != f;
                    folder.ends_with("edgecap") || emptied_below.iter().any(is_inside)
                };
                for folder in path.ancestors().skip(1).take_while(may_go) {
                    // One that holds something else.
                    if fs::remove_dir(below(root, folder)).is_err() {
                        break;
                    }
                }
            }
            Self::RemoveEmpty { path } if done == Done::Removed => {
                return Ok(removed(fs::remove_dir(below(root, path))));
            }
            Self::Clear { path } if done == Done::Removed => {
                return Ok(removed(fs::remove_dir_all(below(root, path))));
            }
            Self::Run { line, loss } => {
                return match ran(line) {
                    Ok(()) => Ok(Done::Ran),
                    Err(why) if *loss == Loss::Everything => {
                        Err(Failure::unavailable(format!("{}: {why}", line.join(" "))).into())
                    }
                    Err(why) => Ok(Done::Failed { why, loss: *loss }),
                };
            }
            _ => {}
        }
        Ok(done)
    }
}

/// The permissions that a kept file has without those beyond `wanted`; `None` of what this user must leave alone: a
/// link, a folder, another user's.
fn narrowed(found: &Metadata, wanted: u32) -> Option<u32> {
    let is_own = found.is_file() && found.uid() == geteuid().as_raw();
    is_own.then(|| found.mode() & wanted)
}

/// The permissions of what is found at `path`; of a link those of the file that it leads to.
fn behind(path: &Path, found: &Metadata) -> u32 {
    let file = fs::metadata(path);
    file.as_ref().unwrap_or(found).mode() & 0o7777
}

/// Takes the permissions beyond `wanted` away from a kept file.
fn narrow(path: &Path, wanted: u32) -> io::Result<()> {
    let is_to_change = |found: &Metadata| {
        narrowed(found, wanted).is_some_and(|mode| mode != found.mode() & 0o7777)
    };
    // A device or pipe is not opened.
    if !is_to_change(&fs::symlink_metadata(path)?) {
        return Ok(());
    }
    let mut options = File::options();
    // Another may have the name by now: of what is open is decided.
    let flags = libc::O_NOFOLLOW | libc::O_NONBLOCK;
    let file = options.read(true).custom_flags(flags).open(path)?;
    let found = file.metadata()?;
    match narrowed(&found, wanted).filter(|_| is_to_change(&found)) {
        Some(mode) => file.set_permissions(Permissions::from_mode(mode)),
        None => Ok(()),
    }
}

/// A file's content, to be known again.
pub fn digest(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Writes a whole file in place of whatever has its name.
fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::replacing_links(path)?;
    file.write_all(bytes)?;
    file.finish()
}

/// Whether somebody wants nobody to have a unit of this name (`systemctl mask`).
pub fn is_masked(path: &Path) -> bool {
    path.canonicalize()
        .is_ok_and(|to| to == Path::new("/dev/null"))
}

/// What became of a folder whose loss is none.
fn removed(result: io::Result<()>) -> Done {
    match result {
        Ok(()) => Done::Removed,
        Err(e) => Done::Failed {
            why: e.to_string(),
            loss: Loss::Nothing,
        },
    }
}

/// What is to be removed and cannot be looked at.
fn unseen(error: &io::Error) -> Done {
    match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => Done::Absent,
        _ => Done::Failed {
            why: error.to_string(),
            loss: Loss::Nothing,
        },
    }
}

/// Runs a command; its last words if it fails.
fn ran(line: &[String]) -> Result<(), String> {
    let mut command = Command::new(&line[0]);
    command.args(&line[1..]).stdin(Stdio::null());
    match command.output() {
        Ok(out) if out.status.success() => Ok(()),
        Ok(out) => {
            let said = String::from_utf8_lossy(&out.stderr);
            let last = said.lines().last().unwrap_or("").trim();
            Err(format!("{}: {last}", out.status))
        }
        Err(e) if e.kind() == ErrorKind::NotFound => Err(format!(
            "{} is not installed: install systemd and udev",
            line[0]
        )),
        Err(e) => Err(e.to_string()),
    }
}
