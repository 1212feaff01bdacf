//! Recorded bodies as the files of other programs. A record goes in as a [`Take`]; each format is a file here and gives
//! bytes, or writes them.
//!
//! Axes of BVH, glTF and TRC: the floor's of the record's last frame that knows one (x to the camera's right, y up, z
//! towards the viewer). Where none does, the camera's axes set upright, with the lowest foot at height 0.

mod bvh;
mod csv;
mod error;
mod gltf;
mod mannequin;
mod motion;
mod npz;
mod plot;
mod size;
mod take;
mod times;
mod trc;

pub use error::ExportError;
pub use gltf::{MeshTrack, encode_meshes};
pub use motion::{Axes, Motion};
pub use take::Take;
pub use times::{Clock, usual_rate};

use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// What a file is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Skeletons with constant bone lengths, one person a file: animation programs.
    Bvh,
    /// glTF 2.0 in one binary file, everybody as a moving mannequin: viewers, engines.
    Glb,
    /// Marker positions, one person a file: OpenSim, Pose2Sim.
    Trc,
    /// A row for every joint of every person and frame: spreadsheets.
    Csv,
    /// Arrays over frames and people: NumPy.
    Npz,
    /// Heights and angles over time, to look at.
    Svg,
}

impl Format {
    /// Of a file's extension.
    ///
    /// # Errors
    /// [`ExportError::Extension`].
    pub fn of(path: &Path) -> Result<Self, ExportError> {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("bvh") => Ok(Self::Bvh),
            Some("glb") => Ok(Self::Glb),
            Some("trc") => Ok(Self::Trc),
            Some("csv") => Ok(Self::Csv),
            Some("npz") => Ok(Self::Npz),
            Some("svg") => Ok(Self::Svg),
            _ => Err(ExportError::Extension(path.to_owned())),
        }
    }

    /// Whether a file holds one person only.
    pub fn is_of_one(self) -> bool {
        matches!(self, Self::Bvh | Self::Trc)
    }
}

/// Longest that a first pose is held in a `.bvh`, seconds: of a week's visitors each would be a week long.
const LONGEST_HELD: f64 = 600.0;

/// A file of a take.
#[derive(Debug)]
pub struct Exported<'a> {
    /// Where it goes.
    pub path: PathBuf,
    content: Content<'a>,
    /// How long after the first of all people it begins, seconds, where it does not say so itself.
    pub late: Option<f64>,
}

/// What is in a file.
#[derive(Debug)]
enum Content<'a> {
    Bytes(Vec<u8>),
    /// Rows of CSV, which are made as they are written.
    Rows(&'a Take),
}

impl Exported<'_> {
    /// Writes what is in it.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        match &self.content {
            Content::Bytes(bytes) => out.write_all(bytes),
            Content::Rows(take) => csv::write(take, out),
        }
    }
}

/// The files of a take, by name: `to`, or where a format holds one person only and there are several, `to` with each
/// one's id before the extension. Those of `.bvh` begin together, so that people stay together in other programs:
/// whoever comes later stands still until then. Who comes much later does not, and is told.
///
/// # Errors
/// [`ExportError::Format`] where the numbers do not fit the format.
pub fn encode<'a>(
    take: &'a Take,
    format: Format,
    to: &Path,
) -> Result<Vec<Exported<'a>>, ExportError> {
    if !format.is_of_one() {
        let content = match format {
            Format::Glb => Content::Bytes(gltf::encode(take)?),
            Format::Svg => Content::Bytes(plot::encode(take).into_bytes()),
            Format::Npz => Content::Bytes(npz::encode(take)?),
            _ => Content::Rows(take),
        };
        return Ok(vec![Exported {
            path: to.to_owned(),
            content,
            late: None,
        }]);
    }
    let is_alone = take.people.len() == 1;
    let start = take.start();
    let files = Motion::all(take)?.map(|motion| {
        let path = match is_alone {
            true => to.to_owned(),
            false => with_id(to, motion.id),
        };
        let late = motion.start - start;
        let (text, late) = match format {
            Format::Bvh if late > LONGEST_HELD => (bvh::encode(&motion, 0), Some(late)),
            Format::Bvh => {
                let held = (late * motion.rate).round() as usize;
                (bvh::encode(&motion, held), None)
            }
            _ => (trc::encode(&motion, &path), None),
        };
        Exported {
            path,
            content: Content::Bytes(text.into_bytes()),
            late,
        }
    });
    Ok(files.collect())
}

fn with_id(path: &Path, id: u32) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!(".{id}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

#[cfg(test)]
mod tests;
