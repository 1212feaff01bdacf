//! Folders made for a result, which go again where that never comes.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Folders that were missing, the innermost first; dropped, it removes those in which nothing is.
#[derive(Debug, Default)]
pub struct MadeFolders(Vec<PathBuf>);

impl MadeFolders {
    /// Makes a folder, and those around it that are missing.
    ///
    /// # Errors
    /// If one cannot be made; the others are gone then.
    pub fn make(folder: &Path) -> io::Result<Self> {
        let is_missing = |f: &&Path| !f.as_os_str().is_empty() && !f.exists();
        let missing = folder.ancestors().take_while(is_missing);
        let made = Self(missing.map(Path::to_owned).collect());
        fs::create_dir_all(folder).map_err(|e| {
            let stands = folder.ancestors().find(|f| f.exists() && !f.is_dir());
            stands.map_or(e, |at| {
                let words = format!(
                    "expected a folder, found a file or a device at {}",
                    at.display()
                );
                io::Error::new(io::ErrorKind::NotADirectory, words)
            })
        })?;
        Ok(made)
    }

    /// Lets them stay.
    pub fn keep(&mut self) {
        self.0.clear();
    }
}

impl Drop for MadeFolders {
    fn drop(&mut self) {
        for folder in &self.0 {
            // Of one in which somebody put something meanwhile this fails, and so for those around it.
            let _ = fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_that_hold_something_by_then_stay_and_those_that_were_there() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("old")).unwrap();
        let made = MadeFolders::make(&at("old/a/b/c")).unwrap();
        assert!(at("old/a/b/c").is_dir());
        fs::write(at("old/a/other"), "").unwrap();
        drop(made);
        assert!(!at("old/a/b").exists() && at("old/a/other").exists());
        drop(MadeFolders::make(&at("old/x/y")).unwrap());
        assert!(!at("old/x").exists() && at("old").is_dir());
        MadeFolders::make(&at("kept/deeper")).unwrap().keep();
        assert!(at("kept/deeper").is_dir());
    }

    #[test]
    fn where_one_cannot_be_made_none_is() {
        let folder = tempfile::tempdir().unwrap();
        let long = "n".repeat(300);
        let e = MadeFolders::make(&folder.path().join("new").join(long));
        assert!(e.is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        for place in [file.clone(), file.join("new")] {
            let e = MadeFolders::make(&place).unwrap_err().to_string();
            assert!(
                e.contains("expected a folder, found a file") && e.ends_with("/file"),
                "{e}"
            );
        }
    }
}
