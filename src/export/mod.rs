//! Recorded bodies as the files of other programs. A record goes in as a [`Take`]; each format is a file here and gives
//! bytes.
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

/// The files of a take, by name: `to`, or where a format holds one person only and there are several, `to` with each
/// one's id before the extension.
///
/// # Errors
/// [`ExportError::Format`] where the numbers do not fit the format.
pub fn encode(
    take: &Take,
    format: Format,
    to: &Path,
) -> Result<Vec<(PathBuf, Vec<u8>)>, ExportError> {
    if !format.is_of_one() {
        let bytes = match format {
            Format::Glb => gltf::encode(take)?,
            Format::Svg => plot::encode(take).into_bytes(),
            Format::Npz => npz::encode(take)?,
            _ => csv::encode(take).into_bytes(),
        };
        return Ok(vec![(to.to_owned(), bytes)]);
    }
    let is_alone = take.people.len() == 1;
    let files = Motion::all(take)?.map(|motion| {
        let path = match is_alone {
            true => to.to_owned(),
            false => with_id(to, motion.id),
        };
        let text = match format {
            Format::Bvh => bvh::encode(&motion),
            _ => trc::encode(&motion, &path),
        };
        (path, text.into_bytes())
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
