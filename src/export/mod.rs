//! Recorded bodies as the files of other programs. A record goes in as a [`Take`]; each format is a file here and gives
//! bytes, or writes them.
//!
//! Axes of BVH, glTF and TRC: the floor's of the record's last frame that knows one (x to the camera's right, y up, z
//! towards the viewer). Where none does, the camera's axes set upright, with the feet that stand lowest at height 0.

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
mod trc;

pub use error::ExportError;
pub use gltf::{MeshTrack, encode_meshes};
pub use motion::{Axes, Motion};
pub use plot::title as plot_title;
pub use take::Take;

use std::io::{self, Seek, Write};
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
    /// Arrays, each of which is made as it is written.
    Arrays(&'a Take),
    /// One person's motion, which is made as it is written: those of all need not be held at once.
    Motion {
        take: &'a Take,
        id: u32,
        /// Steps a second.
        rate: f64,
        axes: Axes,
        kind: Kind,
    },
}

/// A format of one person.
#[derive(Debug, Clone, Copy)]
enum Kind {
    /// With the first pose held for so many steps.
    Bvh(usize),
    Trc,
}

impl Exported<'_> {
    /// Steps for which its first pose is held.
    fn held(&self) -> usize {
        match self.content {
            Content::Motion {
                kind: Kind::Bvh(held),
                ..
            } => held,
            _ => 0,
        }
    }

    /// Writes what is in it into a file, which may be written over.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_into(&self, out: &mut (impl Write + Seek)) -> io::Result<()> {
        match &self.content {
            Content::Arrays(take) => npz::write(take, crate::npz::Writer::new(out)),
            _ => self.write(out),
        }
    }

    /// Writes what is in it, as into a pipe.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        match &self.content {
            Content::Bytes(bytes) => out.write_all(bytes),
            Content::Rows(take) => csv::write(take, out),
            Content::Arrays(take) => npz::write(take, crate::npz::Writer::in_stream(out)),
            Content::Motion {
                take,
                id,
                rate,
                axes,
                kind,
            } => {
                let motion = Motion::of(take, *id, *rate, axes);
                match kind {
                    Kind::Bvh(held) => bvh::write(&motion, *held, out),
                    Kind::Trc => trc::write(&motion, &self.path, out),
                }
            }
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
            Format::Npz => {
                npz::expect(take)?;
                Content::Arrays(take)
            }
            _ => Content::Rows(take),
        };
        return Ok(vec![Exported {
            path: to.to_owned(),
            content,
            late: None,
        }]);
    }
    let is_alone = take.people.len() == 1;
    // They take a look at every frame: not again for each.
    let (start, rate, axes) = (take.start(), take.rate(), Axes::of(take));
    let files = take.people.iter().map(|(&id, samples)| {
        let path = match is_alone {
            true => to.to_owned(),
            false => with_id(to, id),
        };
        let first = samples.first().map_or(0, |s| s.frame);
        let late = take.frames[first].time - start;
        let (kind, late) = match format {
            Format::Bvh if late > LONGEST_HELD => (Kind::Bvh(0), Some(late)),
            Format::Bvh => (Kind::Bvh((late * rate).round() as usize), None),
            _ => (Kind::Trc, None),
        };
        Exported {
            path,
            content: Content::Motion {
                take,
                id,
                rate,
                axes,
                kind,
            },
            late,
        }
    });
    let files: Vec<_> = files.collect();
    let held = files.iter().map(Exported::held).sum::<usize>();
    Motion::expect(take, rate, held as f64)?;
    Ok(files)
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
