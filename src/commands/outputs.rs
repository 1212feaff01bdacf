//! The files that a verb writes, as the user names them, and how a verb ends.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::exit::Failure;
use super::input::path_in_words;
use super::say;
use crate::output;
use crate::record::{Format, Row};
use crate::sink::{PatientRecord, RecordSink, SinkError, Sinks, is_full_or_away};

/// Options of what is recorded.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecordArgs {
    /// Write one line of JSON per frame to this file; '-' for standard output [default, where --record is not given
    /// either: of a film, photos or a pipe edgecap-out/NAME.bodies.jsonl of 'run', and of 'infer' without --name and
    /// --overlay edgecap-out/NAME.observations.jsonl]
    #[arg(long, value_name = "FILE", value_parser = path_in_words())]
    pub jsonl: Option<PathBuf>,
    /// Write the same in binary, a third of the size; what reads one reads the other: of bodies (run, fit) 'export',
    /// 'plot', 'replay', 'events', 'eval' and 'view --record', of observations (infer) 'fit --input', 'multiview',
    /// 'calibrate', 'replay' and 'eval'
    #[arg(long, value_name = "FILE", value_parser = path_in_words())]
    pub record: Option<PathBuf>,
}

impl RecordArgs {
    /// Whether nothing is to be recorded.
    pub fn is_empty(&self) -> bool {
        self.jsonl.is_none() && self.record.is_none()
    }

    /// Whether standard output carries results, so that words have to go elsewhere.
    pub fn takes_stdout(&self) -> bool {
        let mut all = self.jsonl.iter().chain(&self.record);
        all.any(|path| output::is_stdout(path))
    }

    /// Starts the records. Those of an input with an end appear whole; others grow under their names: a power cut after
    /// weeks must not take the weeks.
    ///
    /// # Errors
    /// [`SinkError::Create`].
    pub fn add_to<T: Row + 'static>(
        &self,
        has_end: bool,
        sinks: &mut Sinks<T::Message>,
    ) -> Result<(), SinkError> {
        for (path, format) in self.each() {
            let record = RecordSink::<T>::create(path, format)?;
            sinks.push(if has_end { record } else { record.growing() });
        }
        Ok(())
    }

    /// Starts the records of a camera that is watched for weeks: where one cannot be written any more, everything else
    /// goes on. Only who reads standard output and leaves wants the end.
    ///
    /// # Errors
    /// [`SinkError::Create`].
    pub fn add_patient_to<T: Row + 'static>(
        &self,
        sinks: &mut Sinks<T::Message>,
    ) -> Result<(), SinkError> {
        for (path, format) in self.each() {
            sinks.push(PatientRecord::<T>::create(path, format)?);
        }
        Ok(())
    }

    /// Looks whether the records could be made, without making any. Where a relative path begins only the run knows.
    ///
    /// # Errors
    /// Exit code 78; what this user may not do another may, and a disk may come back: that is only said.
    pub fn expect_place(&self, camera: &str) -> anyhow::Result<()> {
        for path in self.jsonl.iter().chain(&self.record) {
            let tried = match path.is_absolute() {
                true => output::try_place(path),
                false => Ok(()),
            };
            if let Some(line) = told_of_place(camera, path, tried)? {
                say::err(&line);
            }
        }
        Ok(())
    }

    /// What is recorded, and how, where what killed processes left is cleared away.
    fn each(&self) -> impl Iterator<Item = (&PathBuf, Format)> {
        let lines = self.jsonl.iter().map(|path| (path, Format::Jsonl));
        let all = lines.chain(self.record.iter().map(|path| (path, Format::Binary)));
        all.inspect(|(path, _)| output::sweep(path))
    }
}

/// What is only said of a place for a record that was `tried`.
///
/// # Errors
/// As [`RecordArgs::expect_place`].
fn told_of_place(
    camera: &str,
    path: &Path,
    tried: io::Result<()>,
) -> Result<Option<String>, Failure> {
    let Err(e) = tried else {
        return Ok(None);
    };
    let name = path.display();
    if e.kind() == ErrorKind::PermissionDenied {
        return Ok(Some(format!(
            "[[camera]] {camera}: {name}: this user may not write there; who runs it has to"
        )));
    }
    if is_full_or_away(path, &e) {
        return Ok(Some(format!(
            "[[camera]] {camera}: {name}: {e}: the disk is full or away; the run of a camera goes on, and tries it again every minute"
        )));
    }
    Err(Failure::config(format!(
        "expected a place for a record, found {name}: {e}; choose a writable one"
    )))
}

/// Ends a verb that has computed `frames`: what was computed is made complete, whatever went wrong, and then it is
/// said. Where nothing was computed and something went wrong, nothing is left. Returns what the sinks say of what there
/// is, and how it ended: with the error of `outcome`, else with the first of a sink.
pub fn finish<M>(
    mut sinks: Sinks<M>,
    frames: u64,
    outcome: anyhow::Result<()>,
) -> (Vec<String>, anyhow::Result<()>) {
    if frames == 0 && outcome.is_err() {
        return (Vec::new(), outcome);
    }
    if outcome.is_err() {
        sinks.break_off();
    }
    let (words, finished) = sinks.finish();
    (words, outcome.and_then(|()| Ok(finished?)))
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File};
    use std::os::unix::fs::symlink;
    use std::time::{Duration, SystemTime};

    use super::*;
    use crate::commands::exit;
    use crate::record::BodiesRow;

    #[test]
    fn a_disk_that_is_full_or_away_is_no_mistake_of_the_settings() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        let told = |errno: i32| {
            let tried = Err(io::Error::from_raw_os_error(errno));
            told_of_place("hall", &path, tried)
        };
        for errno in [libc::ENOSPC, libc::EIO, libc::ESTALE] {
            let line = told(errno).unwrap().unwrap();
            assert!(
                line.contains("hall.jsonl: ") && line.contains("full or away"),
                "{line}"
            );
        }
        let line = told(libc::EACCES).unwrap().unwrap();
        assert!(line.contains("this user may not write there"), "{line}");
        let refused = told(libc::ENOTDIR).unwrap_err().into();
        assert_eq!(exit::code(&refused), exit::CONFIG);
        assert!(told_of_place("hall", &path, Ok(())).unwrap().is_none());
    }

    #[test]
    fn what_was_left_goes_where_the_record_lies_and_not_its_link() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("disk")).unwrap();
        symlink("disk/hall.record", at("hall.record")).unwrap();
        let long_ago = SystemTime::now() - Duration::from_secs(2 * 24 * 60 * 60);
        let left = at("disk/.edgecap-left.part");
        File::create(&left).unwrap().set_modified(long_ago).unwrap();
        let args = RecordArgs {
            record: Some(at("hall.record")),
            ..RecordArgs::default()
        };
        let mut sinks = Sinks::default();
        args.add_to::<BodiesRow>(false, &mut sinks).unwrap();
        assert!(!left.exists());
        sinks.finish().1.unwrap();
        assert_eq!(fs::read_dir(at("disk")).unwrap().count(), 0);
    }
}
