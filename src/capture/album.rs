//! A folder goes in; its photos come out, and words for what looks like photos and cannot be read.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::natural::natural_order;
use super::signature::{is_jpeg, is_png};

/// Names that are listed of each kind.
const MOST_NAMED: usize = 3;
/// Endings of pictures of other kinds, among them those of cameras.
const OTHER_ENDINGS: [&str; 16] = [
    "webp", "bmp", "tif", "tiff", "gif", "avif", "heic", "heif", "jxl", "jp2", "dng", "cr2", "cr3",
    "nef", "arw", "raf",
];

/// Endings of films that begin as a photo does.
pub(super) const MOTION_JPEG: [&str; 3] = ["mjpeg", "mjpg", "mjp"];

/// What lies in a folder of photos.
#[derive(Debug, Default)]
pub struct Album {
    /// JPEG and PNG files in order of their names, numbers in names by value (`2.jpg` before `10.jpg`).
    pub photos: Vec<PathBuf>,
    others: Vec<String>,
    links: Vec<String>,
    folders: Vec<String>,
}

impl Album {
    /// Looks at everything in `folder` that is not hidden.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn of(folder: &Path) -> std::io::Result<Self> {
        let mut paths = entries(folder)?;
        paths.sort_by(|a, b| {
            natural_order(&a.to_string_lossy(), &b.to_string_lossy()).then_with(|| a.cmp(b))
        });
        let mut album = Self::default();
        for path in paths {
            let name = path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            if is_photo(&path) {
                album.photos.push(path);
            } else if path.is_dir() {
                let inside = entries(&path).unwrap_or_default();
                if inside.iter().any(|p| is_photo(p)) {
                    album.folders.push(name);
                }
            } else if path.is_symlink() && !path.exists() {
                album.links.push(name);
            } else if is_other_picture(&path) {
                album.others.push(name);
            }
        }
        Ok(album)
    }

    /// What was left out and what to do about it; `None` where that is nothing.
    pub fn left_out(&self) -> Option<String> {
        let kinds = [
            (
                &self.others,
                ["picture", "pictures"],
                "of another kind",
                "convert to JPEG or PNG",
            ),
            (
                &self.links,
                ["link", "links"],
                "to nothing",
                "mend or remove",
            ),
            (
                &self.folders,
                ["folder", "folders"],
                "with photos",
                "each is an --input of its own",
            ),
        ];
        let told = kinds.iter().filter(|(names, ..)| !names.is_empty());
        let told = told.map(|(names, words, what, remedy)| {
            let word = words[usize::from(names.len() > 1)];
            format!("{} {word} {what} ({}: {remedy})", names.len(), some(names))
        });
        let told: Vec<String> = told.collect();
        (!told.is_empty()).then(|| told.join(", "))
    }
}

/// Whether a file is a photo by its first bytes, or ought to be one by its name: one that is named so and is none
/// counts as a damaged photo.
pub fn is_photo(path: &Path) -> bool {
    path.is_file()
        && !ends_in(path, &MOTION_JPEG)
        && (ends_in(path, &["jpg", "jpeg", "png"]) || {
            let head = head(path);
            is_jpeg(&head) || is_png(&head)
        })
}

fn is_other_picture(path: &Path) -> bool {
    path.is_file() && (ends_in(path, &OTHER_ENDINGS) || other_kind(&head(path)).is_some())
}

/// Which kind of picture begins so, of those that are not read.
pub fn other_kind(head: &[u8]) -> Option<&'static str> {
    let at = |from: usize, bytes: &[u8]| head.get(from..from + bytes.len()) == Some(bytes);
    let is = |brands: &[&[u8]]| at(4, b"ftyp") && brands.iter().any(|b| at(8, b));
    match () {
        () if at(0, b"RIFF") && at(8, b"WEBP") => Some("WebP"),
        () if at(0, b"BM") && at(6, &[0; 4]) => Some("BMP"),
        () if at(0, b"II*\0") || at(0, b"MM\0*") => Some("TIFF"),
        () if is(&[b"heic", b"heix", b"mif1"]) => Some("HEIC"),
        () if is(&[b"avif"]) => Some("AVIF"),
        () if at(4, b"JXL ") || at(0, b"\xFF\x0A") => Some("JPEG XL"),
        () => None,
    }
}

/// Whether a name has one of these endings, in letters of any size.
pub(super) fn ends_in(path: &Path, endings: &[&str]) -> bool {
    path.extension()
        .is_some_and(|e| endings.iter().any(|k| e.eq_ignore_ascii_case(k)))
}

/// Everything in a folder that is not hidden.
fn entries(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let hidden = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default();
        name.as_encoded_bytes().starts_with(b".")
    };
    let all = std::fs::read_dir(folder)?.map(|entry| entry.map(|e| e.path()));
    let mut all = all.collect::<std::io::Result<Vec<_>>>()?;
    all.retain(|path| !hidden(path));
    Ok(all)
}

/// A file's first bytes; of one that cannot be read none.
pub(super) fn head(path: &Path) -> Vec<u8> {
    let mut head = Vec::new();
    // What cannot be read is of no kind.
    let _ = File::open(path).and_then(|file| file.take(16).read_to_end(&mut head));
    head
}

fn some(names: &[String]) -> String {
    let shown = names.len().min(MOST_NAMED);
    let more = match names.len() - shown {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    names[..shown].join(", ") + &more
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_is_counted_and_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in [
            "10.jpg",
            "2.JPEG",
            "a.webp",
            "b.HEIC",
            "c.gif",
            "d.avif",
            "notes.txt",
            ".e.webp",
        ] {
            std::fs::write(at(name), "bytes").unwrap();
        }
        std::fs::write(at("named-otherwise"), b"RIFF\x10\0\0\0WEBPVP8 ").unwrap();
        std::fs::write(at("film.MJPEG"), b"\xFF\xD8\xFF\xE0").unwrap();
        std::os::unix::fs::symlink("gone.jpg", at("link.jpg")).unwrap();
        for (sub, file) in [("more", "f.png"), ("other", "f.txt")] {
            std::fs::create_dir(at(sub)).unwrap();
            std::fs::write(at(sub).join(file), "bytes").unwrap();
        }
        let album = Album::of(folder.path()).unwrap();
        assert_eq!(album.photos, [at("2.JPEG"), at("10.jpg")]);
        assert_eq!(
            album.left_out().unwrap(),
            "5 pictures of another kind (a.webp, b.HEIC, c.gif and 2 more: convert to JPEG or PNG), \
             1 link to nothing (link.jpg: mend or remove), \
             1 folder with photos (more: each is an --input of its own)"
        );
        assert_eq!(Album::of(&at("more")).unwrap().left_out(), None);
    }
}
