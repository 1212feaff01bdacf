//! The frames of records, as their own numbers, times and ids have them.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;

use edgecap_client::message::{BodyFrame, ObservationFrame};

use crate::camera::DEFAULT_FOV;
use crate::commands::exit::Failure;
use crate::record::{self, BodiesRow, CameraSource, ObservationReader, RowReader};

/// Calls `take` with every frame of a record of bodies, ends of its stream included, until that says `false`; whether
/// the record ends inside a frame.
///
/// # Errors
/// Those of `take`; a record that cannot be read, or is damaged before its end.
pub fn bodies(
    record: &Path,
    take: &mut dyn FnMut(&BodyFrame) -> anyhow::Result<bool>,
) -> anyhow::Result<bool> {
    let name = record.display().to_string();
    let mut rows = RowReader::<_, BodiesRow>::new(open(record)?, &name);
    while let Some(row) = rows.read()? {
        if !take(&row.message())? {
            break;
        }
    }
    Ok(rows.was_cut())
}

/// The same of a record of observations.
///
/// # Errors
/// As [`bodies`].
pub fn observations(
    record: &Path,
    take: &mut dyn FnMut(&ObservationFrame) -> anyhow::Result<bool>,
) -> anyhow::Result<bool> {
    let camera = CameraSource::Recorded {
        fov_degrees: DEFAULT_FOV,
    };
    let name = record.display().to_string();
    let mut rows = ObservationReader::new(open(record)?, &name, camera);
    let mut frame = Box::new(ObservationFrame::default());
    while rows.read(&mut frame)? {
        if !take(&frame)? {
            break;
        }
    }
    Ok(rows.was_cut())
}

/// Opens a record.
///
/// # Errors
/// Exit code 66 where it cannot be read.
pub fn open(path: &Path) -> anyhow::Result<BufReader<File>> {
    let file = record::open(path).map_err(|e| Failure::no_input(path, &e))?;
    Ok(BufReader::new(file))
}

/// What is wrong with a file that is of no kind of record.
pub fn no_record(path: &Path) -> Failure {
    let found = match fs::metadata(path).is_ok_and(|file| file.len() == 0) {
        true => "an empty file",
        false => "something else",
    };
    Failure::data(format!(
        "{}: expected a record of bodies or observations, found {found}; 'edgecap record' makes one",
        path.display()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_file_is_called_so() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.record");
        for (holds, found) in [("", "an empty file"), ("a film", "something else")] {
            fs::write(&path, holds).unwrap();
            let said = no_record(&path).to_string();
            assert!(said.contains(&format!("found {found};")), "{said}");
        }
    }
}
