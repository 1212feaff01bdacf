//! Files that a verb reads and writes, held against each other before it starts: a result that takes the name of its
//! input replaces it, and two results of one name leave one of them.

use std::collections::HashSet;
use std::fs::{self, Metadata};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use super::exit::Failure;
use super::input::InputArgs;
use super::outputs::RecordArgs;
use crate::camera::calibration;
use crate::capture::{InputSpec, is_photo};
use crate::config::Setting;
use crate::output::{is_stdout, link_steps};

/// What a verb reads and writes.
#[derive(Debug, Default)]
pub struct Apart {
    reads: Vec<Named>,
    writes: Vec<Named>,
}

/// A file as the user named it.
#[derive(Debug)]
struct Named {
    option: String,
    path: PathBuf,
    what: What,
}

/// Which file it is, whatever its name.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum What {
    Stdout,
    /// Device and number of a file or folder.
    There(u64, u64),
    /// A place in which nothing is.
    Free(PathBuf),
}

impl What {
    fn there(found: &Metadata) -> Self {
        Self::There(found.dev(), found.ino())
    }

    /// What has this name: a link, if it is one.
    fn itself(path: &Path) -> Option<Self> {
        fs::symlink_metadata(path).ok().as_ref().map(Self::there)
    }

    /// The same, and what it leads to, link after link.
    fn on_the_way(path: &Path) -> impl Iterator<Item = Self> + use<> {
        link_steps(path).filter_map(|step| Self::itself(&step))
    }
}

impl Apart {
    /// A file or folder that is read.
    #[must_use]
    pub fn reads(mut self, option: &str, path: &Path) -> Self {
        self.reads.extend(Named::new(option, path));
        self
    }

    /// A file that is read where it is given.
    #[must_use]
    pub fn may_read(self, option: &str, path: Option<&Path>) -> Self {
        match path {
            Some(path) => self.reads(option, path),
            None => self,
        }
    }

    /// A file of settings, where they are given as one.
    #[must_use]
    pub fn reads_setting<T>(self, option: &str, setting: Option<&Setting<T>>) -> Self {
        match setting {
            Some(Setting::File(path)) => self.reads(option, path),
            _ => self,
        }
    }

    /// A calibration, where it is given; of a folder, which may hold results, too, the files that tell cameras.
    #[must_use]
    pub fn reads_calibration(self, path: Option<&Path>) -> Self {
        let Some(path) = path else {
            return self;
        };
        self.may_read("--calibration", Some(path).filter(|path| path.is_file()))
            .reads_cameras_in("--calibration", path)
    }

    /// The files of a folder that tell cameras; nothing of what is no folder.
    #[must_use]
    pub fn reads_cameras_in(self, option: &str, folder: &Path) -> Self {
        entries(folder)
            .filter(|file| calibration::is_of_folder(file))
            .fold(self, |apart, file| apart.reads(option, &file))
    }

    /// What a run sees, and the files of its lens.
    #[must_use]
    pub fn reads_input(self, args: &InputArgs) -> Self {
        let all = self.reads_setting("--camera", args.lens.as_ref());
        match args.input.as_deref().map(str::parse) {
            Some(Ok(InputSpec::Path(path))) => all.reads("--input", &path),
            _ => all,
        }
    }

    /// A file or folder that is written.
    #[must_use]
    pub fn writes(mut self, option: &str, path: &Path) -> Self {
        self.writes.extend(Named::new(option, path));
        self
    }

    /// A file that is written where it is given.
    #[must_use]
    pub fn may_write(self, option: &str, path: Option<&Path>) -> Self {
        match path {
            Some(path) => self.writes(option, path),
            None => self,
        }
    }

    /// The records of a verb.
    #[must_use]
    pub fn writes_records(self, args: &RecordArgs) -> Self {
        self.may_write("--jsonl", args.jsonl.as_deref())
            .may_write("--record", args.record.as_deref())
    }

    /// Files of other programs.
    #[must_use]
    pub fn writes_exports(self, all: &[PathBuf]) -> Self {
        all.iter()
            .fold(self, |apart, to| apart.writes("--export", to))
    }

    /// All of another one, too, which is called `of`. Lines of both may share standard output.
    #[must_use]
    pub fn and(mut self, other: Self, of: &str) -> Self {
        let called = |named: Named| Named {
            option: format!("{of}: {}", named.option),
            ..named
        };
        self.reads.extend(other.reads.into_iter().map(called));
        let files = other.writes.into_iter().filter(|w| w.what != What::Stdout);
        self.writes.extend(files.map(called));
        self
    }

    /// Whether every file is one alone.
    ///
    /// # Errors
    /// Exit code 64 with the first two that are the same.
    pub fn check(&self) -> anyhow::Result<()> {
        for (k, to) in self.writes.iter().enumerate() {
            if let Some(from) = self.reads.iter().find(|from| to.replaces(from)) {
                return Err(Failure::usage(format!(
                    "{to}: expected another place than that of the input, found that it would replace {from}; choose another name"
                ))
                .into());
            }
            if let Some(other) = self.writes[..k].iter().find(|other| other.what == to.what) {
                return Err(Failure::usage(format!(
                    "{other} and {to}: expected a file for each, found one for both; choose another name for one of them"
                ))
                .into());
            }
        }
        Ok(())
    }
}

impl Named {
    /// `None` for devices and pipes: what is written there replaces nothing.
    fn new(option: &str, path: &Path) -> Option<Self> {
        let what = match fs::metadata(path) {
            _ if is_stdout(path) => What::Stdout,
            Ok(found) if found.is_file() || found.is_dir() => What::there(&found),
            Ok(_) => return None,
            Err(_) => What::Free(place(path)),
        };
        Some(Self {
            option: option.to_owned(),
            path: path.to_owned(),
            what,
        })
    }

    /// Whether writing this takes `from` away, or a photo in it.
    fn replaces(&self, from: &Self) -> bool {
        // What comes on standard input stays wherever output goes.
        if self.what == What::Stdout {
            return false;
        }
        self.what == from.what || self.is_photo_in(from) || self.hides(from)
    }

    /// Whether this is a photo in that folder, or one to which a link there leads.
    fn is_photo_in(&self, folder: &Self) -> bool {
        let is_this = |entry: PathBuf| What::on_the_way(&entry).any(|what| what == self.what);
        is_photo(&self.path) && entries(&folder.path).any(is_this)
    }

    /// Whether pictures that are written into this folder may take the name of what is read, or of a link that leads
    /// to it. They are PNGs, called like their photos or by numbers, and what links of such names lead to they leave
    /// alone.
    fn hides(&self, from: &Self) -> bool {
        let is_png = |p: &PathBuf| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
        let pictures = entries(&self.path).filter(is_png);
        let pictures: HashSet<What> = pictures.filter_map(|p| What::itself(&p)).collect();
        let read = entries(&from.path).chain([from.path.clone()]);
        !pictures.is_empty()
            && read
                .flat_map(|path| What::on_the_way(&path))
                .any(|what| pictures.contains(&what))
    }
}

/// What lies in a folder; nothing for what is none.
fn entries(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let all = fs::read_dir(folder).into_iter().flatten().flatten();
    all.map(|entry| entry.path())
}

impl std::fmt::Display for Named {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.option.is_empty() {
            true => self.path.display().fmt(f),
            false => write!(f, "{} {}", self.option, self.path.display()),
        }
    }
}

/// Where something would lie that is not there yet: the folder above it that is, without links, and the rest.
fn place(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let there = absolute.ancestors().skip(1).find_map(|above| {
        let rest = absolute.strip_prefix(above).ok()?;
        Some(above.canonicalize().ok()?.join(rest))
    });
    there.unwrap_or(absolute)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_that_would_replace_its_input_is_refused_whatever_it_is_called() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("film.avi"), "film").unwrap();
        fs::hard_link(at("film.avi"), at("other.avi")).unwrap();
        std::os::unix::fs::symlink("film.avi", at("link.avi")).unwrap();
        fs::create_dir(at("photos")).unwrap();
        fs::write(at("photos/a.png"), "photo").unwrap();
        fs::write(at("photos/seen.jsonl"), "of the time before").unwrap();
        let refused = |from: &str, to: &str| {
            let apart = Apart::default()
                .reads("--input", &at(from))
                .writes("--jsonl", &at(to));
            apart.check().is_err()
        };
        for to in [
            "film.avi",
            "./film.avi",
            "other.avi",
            "link.avi",
            "photos/../film.avi",
        ] {
            assert!(refused("film.avi", to), "{to}");
        }
        assert!(refused("photos", "photos") && refused("photos", "photos/a.png"));
        assert!(
            refused("photos/a.png", "photos"),
            "it would be written over"
        );
        for (from, to) in [
            ("film.avi", "new.jsonl"),
            ("film.avi", "photos"),
            ("photos", "photos/seen.jsonl"),
            ("photos", "photos/new.jsonl"),
        ] {
            assert!(!refused(from, to), "{from} {to}");
        }
    }

    #[test]
    fn files_of_a_calibration_that_is_a_folder_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let files = ["intri.yml", "cam01.yaml", "cameras.txt", "images.txt"];
        for name in files.iter().chain(&["seen.jsonl"]) {
            fs::write(at(name), "of the time before").unwrap();
        }
        let refused = |to: &str| {
            let to = at(to);
            let of_lens = Apart::default().reads_cameras_in("--lens", folder.path());
            let of_places = Apart::default().reads_calibration(Some(folder.path()));
            [of_lens, of_places].map(|apart| apart.writes("--out", &to).check().is_err())
        };
        for name in files {
            assert_eq!(refused(name), [true; 2], "{name}");
        }
        for name in ["seen.jsonl", "new.yml"] {
            assert_eq!(refused(name), [false; 2], "{name}");
        }
    }

    #[test]
    fn photos_are_found_behind_links() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["real", "first", "second", "drawn"] {
            fs::create_dir(at(name)).unwrap();
        }
        for name in ["real/a.png", "real/b.jpg", "drawn/b.png"] {
            fs::write(at(name), name).unwrap();
        }
        for (leads_to, link) in [
            ("../second/a.png", "first/a.png"),
            ("../real/a.png", "second/a.png"),
            ("../real/a.png", "drawn/a.png"),
            ("real", "folder"),
        ] {
            std::os::unix::fs::symlink(leads_to, at(link)).unwrap();
        }
        let refused = |from: &str, to: &str| {
            let apart = Apart::default().reads("--input", &at(from));
            apart.writes("--overlay", &at(to)).check().is_err()
        };
        for (from, to) in [
            ("first/a.png", "first"),
            ("first/a.png", "second"),
            ("first/a.png", "real"),
            ("first", "second"),
            ("first", "real"),
            ("first", "folder"),
            ("folder/a.png", "real"),
            ("first", "real/a.png"),
            ("first", "second/a.png"),
        ] {
            assert!(refused(from, to), "{from} {to}");
        }
        for (from, to) in [
            ("real", "drawn"),
            ("real/a.png", "second"),
            ("real/b.jpg", "real"),
            ("first", "drawn"),
            ("first", "new"),
        ] {
            assert!(!refused(from, to), "{from} {to}");
        }
    }

    #[test]
    fn two_results_have_two_files() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let both = |one: &Path, other: &Path| {
            let apart = Apart::default()
                .writes("--jsonl", one)
                .writes("--record", other);
            apart.check().map_err(|e| e.to_string())
        };
        let e = both(&at("new/out"), &at("new/./out")).unwrap_err();
        assert!(e.contains("--jsonl") && e.contains("--record"), "{e}");
        assert!(both(Path::new("-"), Path::new("/dev/stdout")).is_err());
        both(&at("a"), &at("b")).unwrap();
        let nowhere = Path::new("/dev/null");
        both(nowhere, nowhere).unwrap();
        let piped = Apart::default().reads("--input", Path::new("-"));
        piped.writes("--jsonl", Path::new("-")).check().unwrap();
    }
}
