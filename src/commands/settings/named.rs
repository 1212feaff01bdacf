//! What of a run the settings name and nobody has typed, and what is wrong with it whoever starts the run.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use super::blame::{is_of_who_asks, told_as};
use super::effective::{Effective, Origins};
use crate::camera::{CameraFile, calibration};
use crate::capture::InputSpec;
use crate::commands::exit::Failure;
use crate::commands::multiview::names;
use crate::config::{Mistake, Origin, Setting};
use crate::output;

impl Effective {
    /// The failure of a run, as a mistake in the settings where it is one: started again, it would come again.
    pub fn blamed(&self, error: anyhow::Error) -> anyhow::Error {
        if !is_of_who_asks(&error) {
            return error;
        }
        let looked = self
            .expect_readable()
            .and_then(|()| self.expect_options())
            .and_then(|()| self.expect_films_and_places());
        match looked.map_err(|e| e.downcast::<Mistake>()) {
            Err(Ok(mistake)) => told_as(&error, mistake),
            _ => error,
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
                CameraFile::read(lens).map_err(|e| self.blame(camera, &["lens"], e))?;
            }
            let engine = &camera.args.engine;
            for (key, file) in [("model", &engine.model), ("stage2", &engine.stage2)] {
                if let Some(file) = file.as_ref().filter(|_| is_named(&self.network, key)) {
                    expect_file(file).map_err(|e| self.blame(camera, &[key], e))?;
                }
            }
        }
        let (multiview, origins) = &self.multiview;
        match &multiview.calibration {
            Some(file) if self.cameras.len() > 1 && is_named(origins, "calibration") => {
                self.expect_calibrated(file)
            }
            _ => Ok(()),
        }
    }

    /// Looks for every camera in the calibration.
    fn expect_calibrated(&self, file: &Path) -> anyhow::Result<()> {
        let read = calibration::read(file);
        let views = read
            .map_err(|e| self.blame(&self.cameras[0], &["calibration"], e))?
            .views;
        for camera in &self.cameras {
            let name = camera.args.input.name.as_deref().unwrap_or_default();
            if !views.iter().any(|view| view.name == name) {
                let what = format!(
                    "expected one of the cameras {} of {}, found {name}; call it as the calibration does",
                    names(&views),
                    file.display()
                );
                return Err(self.blame(camera, &["name", "calibration"], Failure::usage(what)));
            }
        }
        Ok(())
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
                expect_file(&path).map_err(|e| self.blame(camera, &["input"], e))?;
            }
            let record = &args.record;
            for (key, path) in [("jsonl", &record.jsonl), ("record", &record.record)] {
                if let Some(path) = path.as_ref().filter(|_| is_named(key)) {
                    expect_place(path).map_err(|e| self.blame(camera, &[key], e))?;
                }
            }
        }
        let (bridges, origins) = &self.bridges;
        if let Some(folder) = bridges
            .flight
            .as_ref()
            .filter(|_| is_named(origins, "flight"))
        {
            let expected = expect_place(&folder.join("file"));
            expected.map_err(|e| self.blame(&self.cameras[0], &["flight"], e))?;
        }
        Ok(())
    }
}

fn is_named(origins: &Origins, key: &str) -> bool {
    matches!(origins.get(key), Some(Origin::File(_)))
}

/// Begins to read a file.
fn expect_file(path: &Path) -> Result<(), Failure> {
    let begun = File::open(path).and_then(|mut file| file.read(&mut [0]));
    begun.map(drop).map_err(|e| Failure::no_input(path, &e))
}

/// Looks whether a file could be made.
fn expect_place(path: &Path) -> Result<(), Failure> {
    output::try_place(path).map_err(|e| Failure::output(path, &e))
}
