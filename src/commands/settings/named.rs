//! What of a run the settings name and nobody has typed, and what is wrong with it whoever starts the run.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use super::effective::{Effective, Origins};
use crate::camera::{CameraFile, calibration};
use crate::capture::InputSpec;
use crate::commands::exit::{self, Failure};
use crate::config::{Origin, Setting};
use crate::output;

impl Effective {
    /// The failure of a run, as a mistake in the settings where it is one: started again, it would come again.
    pub fn blamed(&self, error: anyhow::Error) -> anyhow::Error {
        if !is_of_a_file(&error) {
            return error;
        }
        let looked = self
            .expect_readable()
            .and_then(|()| self.expect_films_and_places());
        match looked {
            Ok(()) => error,
            Err(_) if exit::is_silent(&error) => Failure::silent(exit::CONFIG).into(),
            Err(_) => Failure::config(exit::told(&error)).into(),
        }
    }

    /// Reads lenses and the calibration that are named, and begins to read models.
    ///
    /// # Errors
    /// The first mistake; exit code 78 where there is no such file, or this user may not read it.
    pub(super) fn expect_readable(&self) -> anyhow::Result<()> {
        for camera in &self.cameras {
            if let Some(Setting::File(lens)) = &camera.args.input.lens
                && is_named(&camera.origins, "lens")
            {
                CameraFile::read(lens).map_err(mistake)?;
            }
            let engine = &camera.args.engine;
            for (key, file) in [("model", &engine.model), ("stage2", &engine.stage2)] {
                if let Some(file) = file.as_ref().filter(|_| is_named(&self.network, key)) {
                    expect_file(file).map_err(mistake)?;
                }
            }
        }
        let (multiview, origins) = &self.multiview;
        match &multiview.calibration {
            Some(file) if self.cameras.len() > 1 && is_named(origins, "calibration") => {
                calibration::read(file).map(drop).map_err(mistake)
            }
            _ => Ok(()),
        }
    }

    /// Begins to read films, and files where results are to go.
    fn expect_films_and_places(&self) -> anyhow::Result<()> {
        for camera in &self.cameras {
            let (args, is_named) = (&camera.args, |key| is_named(&camera.origins, key));
            if let Some(Ok(InputSpec::Path(path))) = args.input.input.as_deref().map(str::parse)
                && is_named("input")
                // A camera may come later, and a pipe waits for whoever reads it.
                && !path.starts_with("/dev")
                && !fs::metadata(&path).is_ok_and(|there| !there.is_file())
            {
                expect_file(&path)?;
            }
            let record = &args.record;
            for (key, path) in [("jsonl", &record.jsonl), ("record", &record.record)] {
                if let Some(path) = path.as_ref().filter(|_| is_named(key)) {
                    output::try_place(path)?;
                }
            }
        }
        let (bridges, origins) = &self.bridges;
        if let Some(folder) = bridges
            .flight
            .as_ref()
            .filter(|_| is_named(origins, "flight"))
        {
            output::try_place(&folder.join("file"))?;
        }
        Ok(())
    }
}

/// Whether what failed did so of a file that it could not have.
fn is_of_a_file(error: &anyhow::Error) -> bool {
    let codes = [exit::NO_INPUT, exit::CANNOT_CREATE, exit::NO_PERMISSION];
    codes.contains(&exit::code(error))
}

fn is_named(origins: &Origins, key: &str) -> bool {
    matches!(origins.get(key), Some(Origin::File(_)))
}

/// What is wrong with a file; a mistake of whoever named it where it cannot be had.
fn mistake(error: impl Into<anyhow::Error>) -> anyhow::Error {
    let error = error.into();
    match is_of_a_file(&error) {
        true => Failure::config(exit::told(&error)).into(),
        false => error,
    }
}

/// Begins to read a file.
fn expect_file(path: &Path) -> Result<(), Failure> {
    let begun = File::open(path).and_then(|mut file| file.read(&mut [0]));
    begun.map(drop).map_err(|e| Failure::no_input(path, &e))
}
