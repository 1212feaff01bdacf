//! What of a run the settings name and nobody has typed, and what is wrong with it whoever starts the run.

use std::fs::{self, File};
use std::io::Read;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use super::blame::{Fault, is_of_who_asks, told_as};
use super::effective::{Camera, Effective, Origins};
use super::{RunArgs, together};
use crate::camera::{CameraFile, calibration};
use crate::capture::{self, InputSpec};
use crate::commands::exit::{self, Failure};
use crate::commands::views::no_such_camera;
use crate::config::{Mistake, Origin, Setting};
use crate::output;

impl Effective {
    /// The failure of a run, as the mistake in the settings over which it ended, where that is one: started again, it
    /// would come again. What else is wrong with them says nothing of this run.
    pub fn blamed(&self, error: anyhow::Error) -> anyhow::Error {
        if error.is::<Mistake>() || !is_of_who_asks(&error) {
            return error;
        }
        let Ok(runs) = self.runs() else {
            return error;
        };
        let mut faults = self.unreadable();
        faults.extend(self.doubled_inputs(&runs));
        faults.extend(self.films_and_places());
        // These a run finds itself, and no process of it.
        if !exit::is_silent(&error) {
            faults.extend(together::faults(self, &runs));
        }
        let same = faults.into_iter().find(|fault| fault.is(&error));
        match same.map(|fault| self.blame_for(fault).downcast::<Mistake>()) {
            Some(Ok(mistake)) => told_as(&error, mistake),
            _ => error,
        }
    }

    /// Refuses pipes in place of files that the settings name, before one of them is opened: several processes read
    /// them, each time that they start.
    ///
    /// # Errors
    /// The first pipe, with exit code 78.
    pub(super) fn expect_no_pipes(&self) -> anyhow::Result<()> {
        for (camera, key, path) in self.read_files() {
            expect_no_pipe(path).map_err(|e| self.blame(camera, &[key], e))?;
        }
        Ok(())
    }

    /// What the settings name and a run reads, with its key: files, films and folders of photos.
    pub fn reads(&self) -> Vec<(&'static str, PathBuf)> {
        let files = self.read_files().into_iter();
        let files = files.map(|(_, key, path)| (key, path.to_owned()));
        let named = |camera: &&Camera| is_named(&camera.origins, "input");
        let inputs = self.cameras.iter().filter(named).filter_map(|camera| {
            match camera.args.input.input.as_deref()?.parse() {
                Ok(InputSpec::Path(path)) if !capture::is_camera_place(&path) => {
                    Some(("input", path))
                }
                _ => None,
            }
        });
        files.chain(inputs).collect()
    }

    /// The files that the settings name, with the key of each and the camera that it is for.
    fn read_files(&self) -> Vec<(&Camera, &'static str, &Path)> {
        let first = &self.cameras[0];
        let engine = &first.args.engine;
        let mut all = vec![
            (first, &self.network, "model", engine.model.as_deref()),
            (first, &self.network, "stage2", engine.stage2.as_deref()),
        ];
        if self.cameras.len() > 1 {
            let (multiview, origins) = &self.multiview;
            let calibration = multiview.calibration.as_deref();
            all.push((first, origins, "calibration", calibration));
        }
        for camera in &self.cameras {
            let (args, origins) = (&camera.args, &camera.origins);
            all.extend([
                (camera, origins, "lens", file(&args.input.lens)),
                (camera, origins, "fit", file(&args.fitting.fit)),
                (camera, origins, "events", file(&args.fitting.events)),
            ]);
        }
        let named = |(camera, origins, key, path)| {
            let path: Option<&Path> = path;
            Some((camera, key, path.filter(|_| is_named(origins, key))?))
        };
        all.into_iter().filter_map(named).collect()
    }

    /// The cameras whose network's input, or looks, are asked for in ways that do not go together.
    pub(super) fn doubled_inputs(&self, runs: &[RunArgs]) -> Vec<Fault<'_>> {
        let each = self.cameras.iter().zip(runs);
        let doubled = each.filter_map(|(camera, run)| {
            let engine = &run.engine;
            let error = engine.inputs(true).err()?;
            let keys = match engine.size.is_some() {
                true => &["quality", "size"],
                false => &["looks", "quality"],
            };
            Some(Fault::new(camera, keys, error))
        });
        doubled.collect()
    }

    /// Lenses and a calibration that are named and cannot be read or are wrong, and models that cannot be opened.
    pub(super) fn unreadable(&self) -> Vec<Fault<'_>> {
        let mut found = Vec::new();
        for camera in &self.cameras {
            if let Some(Setting::File(lens)) = &camera.args.input.lens {
                let read = match is_named(&camera.origins, "lens") {
                    true => CameraFile::read(lens)
                        .map(drop)
                        .map_err(anyhow::Error::from),
                    false => expect_file(lens).map_err(anyhow::Error::from),
                };
                let fault = |e| Fault::new(camera, &["lens"], e).about(lens.display());
                found.extend(read.err().map(fault));
            }
            let engine = &camera.args.engine;
            let models: [(&'static [_], _); 2] =
                [(&["model"], &engine.model), (&["stage2"], &engine.stage2)];
            for (keys, file) in models {
                let tried = file.as_ref().map(|file| (file, expect_file(file)));
                if let Some((file, Err(e))) = tried {
                    found.push(Fault::new(camera, keys, e).about(file.display()));
                }
            }
        }
        let (multiview, origins) = &self.multiview;
        if let Some(file) = &multiview.calibration
            && self.cameras.len() > 1
            && is_named(origins, "calibration")
        {
            found.extend(self.uncalibrated(file));
        }
        found
    }

    /// The cameras that the calibration does not know, or that it cannot be read.
    fn uncalibrated(&self, file: &Path) -> Vec<Fault<'_>> {
        let views = match calibration::read(file) {
            Ok(read) => read.views,
            Err(e) => {
                let fault = Fault::new(&self.cameras[0], &["calibration"], e);
                return vec![fault.about(file.display())];
            }
        };
        let unknown = self.cameras.iter().filter_map(|camera| {
            let name = camera.args.input.name.as_deref().unwrap_or_default();
            if views.iter().any(|view| view.name == name) {
                return None;
            }
            let unknown = no_such_camera(&views, &format!("of {}", file.display()), name);
            let error = Failure::usage(format!("{unknown}; call it as the calibration does"));
            Some(Fault::new(camera, &["name", "calibration"], error).about(file.display()))
        });
        unknown.collect()
    }

    /// Films that are named and cannot be opened, and places of results where no file can be made.
    fn films_and_places(&self) -> Vec<Fault<'_>> {
        let mut found = Vec::new();
        for camera in &self.cameras {
            let (args, is_named) = (&camera.args, |key| is_named(&camera.origins, key));
            if let Some(Ok(InputSpec::Path(path))) = args.input.input.as_deref().map(str::parse)
                && is_named("input")
                // A camera may come later, and a pipe waits for whoever reads it.
                && !capture::is_camera_place(&path)
                && !fs::metadata(&path).is_ok_and(|there| !there.is_file())
                && let Err(e) = expect_file(&path)
            {
                found.push(Fault::new(camera, &["input"], e).about(path.display()));
            }
            let record = &args.record;
            let places: [(&'static [_], _, _); 2] = [
                (&["jsonl"], is_named("jsonl"), &record.jsonl),
                (&["record"], is_named("record"), &record.record),
            ];
            for (keys, is_named, path) in places {
                let tried = path.as_ref().filter(|_| is_named);
                if let Some((path, Err(e))) = tried.map(|path| (path, expect_place(path))) {
                    found.push(Fault::new(camera, keys, e).about(path.display()));
                }
            }
        }
        let (bridges, origins) = &self.bridges;
        if let Some(folder) = &bridges.flight
            && is_named(origins, "flight")
            && let Err(e) = expect_place(&folder.join("file"))
        {
            found.push(Fault::new(&self.cameras[0], &["flight"], e).about(folder.display()));
        }
        found
    }
}

fn is_named(origins: &Origins, key: &str) -> bool {
    matches!(origins.get(key), Some(Origin::File(_)))
}

/// The file of a setting that is not given as such.
fn file<T>(setting: &Option<Setting<T>>) -> Option<&Path> {
    match setting {
        Some(Setting::File(path)) => Some(path),
        _ => None,
    }
}

/// Refuses a pipe in place of a file: whoever opens it waits for whoever writes. One that this process has open
/// already, such as `<(…)` of a shell, is read.
///
/// # Errors
/// Exit code 78.
pub(super) fn expect_no_pipe(path: &Path) -> Result<(), Failure> {
    let is_open = |at: &&str| path.starts_with(at);
    let is_pipe = fs::metadata(path).is_ok_and(|there| there.file_type().is_fifo());
    if !is_pipe
        || ["/dev/fd", "/dev/stdin", "/proc/self/fd"]
            .iter()
            .any(is_open)
    {
        return Ok(());
    }
    Err(Failure::config(format!(
        "cannot read {}: expected a file, found a pipe, which does not end by itself; name a file",
        path.display()
    )))
}

/// Begins to read a file. A pipe waits for whoever writes, and what is read of it nobody else reads.
fn expect_file(path: &Path) -> Result<(), Failure> {
    if fs::metadata(path).is_ok_and(|there| there.file_type().is_fifo()) {
        return Ok(());
    }
    let begun = File::open(path).and_then(|mut file| file.read(&mut [0]));
    begun.map(drop).map_err(|e| Failure::no_input(path, &e))
}

/// Looks whether a file could be made.
fn expect_place(path: &Path) -> Result<(), Failure> {
    output::try_place(path).map_err(|e| Failure::output(path, &e))
}
