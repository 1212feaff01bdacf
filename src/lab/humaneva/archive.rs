//! The two archives: true joints with exact 2D, and a real detector's 2D beside truth.

use std::collections::HashMap;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};

use crate::npz::{Archive, NpzError, Numbers};

/// Joints of the set: pelvis, neck, left shoulder, elbow, wrist, right shoulder, elbow, wrist, left hip, knee, ankle,
/// right hip, knee, ankle, head.
pub const JOINTS: usize = 15;
/// Joints of COCO: nose, eyes, ears, then shoulders, elbows, wrists, hips, knees, ankles, each left before right.
pub const COCO_JOINTS: usize = 17;
/// Cameras of every piece.
pub const CAMERAS: usize = 3;
/// Pixels across and down of every camera.
pub const SIZE: [u32; 2] = [640, 480];
/// Frames a second, as the set was filmed; the archives do not tell.
pub const RATE: f64 = 60.0;

/// File of truth and exact 2D.
const TRUTH: &str = "humaneva1_gt.npz";
/// File of the detector's 2D.
const DETECTED: &str = "humaneva1_alphapose_aligned.npz";
/// Both files.
pub const FILES: [&str; 2] = [TRUTH, DETECTED];

/// Consecutive frames of one person.
#[derive(Debug, Clone, PartialEq)]
pub struct Piece {
    /// Name, such as `Train/S1|Box 1 chunk1`.
    pub name: String,
    /// Joints in the world by frame, metres.
    pub joints: Vec<[DVec3; JOINTS]>,
    /// The same in every camera, pixels.
    pub exact: Vec<[[DVec2; JOINTS]; CAMERAS]>,
    /// What a detector told of every camera, pixels; none where it was not run or not kept.
    pub detected: Vec<[Option<[DVec2; COCO_JOINTS]>; CAMERAS]>,
}

impl Piece {
    /// Who it is, such as `S1`: each person was filmed with cameras of their own calibration.
    pub fn subject(&self) -> &str {
        let after = self.name.split_once('/').map_or(&self.name[..], |(_, s)| s);
        after.split_once('|').map_or(after, |(s, _)| s)
    }

    /// Whether a frame's truth can be a body's: in some pieces the set has the head below the neck, within the trunk.
    pub fn is_sound(&self, frame: usize) -> bool {
        let joints = &self.joints[frame];
        let (pelvis, neck, head) = (joints[0], joints[1], joints[14]);
        (head - neck).dot(neck - pelvis) > 0.0
    }
}

/// All pieces.
#[derive(Debug, Clone, PartialEq)]
pub struct HumanEva {
    /// In the archive's order.
    pub pieces: Vec<Piece>,
}

/// The archives cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum HumanEvaError {
    /// A file is not there.
    #[error("cannot read {path}: {source}; expected {TRUTH} and {DETECTED} in the folder")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file holds something else.
    #[error("{file}: {source}")]
    Array {
        /// The file.
        file: String,
        /// What was expected and found.
        source: NpzError,
    },
    /// Cameras cannot be found.
    #[error("expected points of {0} that tell a camera, found too few or all in one plane")]
    Camera(String),
    /// Every piece is too short.
    #[error(
        "expected a piece with {0} frames that all cameras saw, found none; ask for more --frames, or leave it out"
    )]
    Short(usize),
}

impl HumanEva {
    /// Reads both archives of a folder.
    ///
    /// # Errors
    /// [`HumanEvaError`]: which file, and what is wrong with it.
    pub fn read(folder: &Path) -> Result<Self, HumanEvaError> {
        let mut truth = Reader::open(folder, TRUTH)?;
        let names = truth.names("names")?;
        let lengths = truth.numbers("lengths", &[None])?;
        let joints = truth.finite("joints3d_m_world", &[None, Some(JOINTS), Some(3)])?;
        let pixels = [None, Some(CAMERAS), Some(JOINTS), Some(2)];
        let pixels = truth.finite("gt2d_px", &pixels)?;
        let frames = joints.shape[0];
        let total: f64 = lengths.data.iter().sum();
        let countable = lengths.data.iter().all(|n| *n >= 0.0 && n.fract() == 0.0);
        let adds_up = countable && total == frames as f64 && pixels.shape[0] == frames;
        if names.len() != lengths.data.len() || !adds_up {
            return Err(truth.uneven(names.len(), frames));
        }
        let mut detected = Reader::open(folder, DETECTED)?.detected()?;
        let point = |k: usize| DVec3::from_slice(&joints.data[3 * k..3 * k + 3]);
        let pixel = |k: usize| DVec2::from_slice(&pixels.data[2 * k..2 * k + 2]);
        let mut next = 0;
        let pieces = names.into_iter().zip(&lengths.data).map(|(name, length)| {
            let all = next..next + *length as usize;
            next = all.end;
            Piece {
                name,
                joints: all
                    .clone()
                    .map(|f| std::array::from_fn(|j| point(f * JOINTS + j)))
                    .collect(),
                exact: all
                    .clone()
                    .map(|f| {
                        std::array::from_fn(|c| {
                            std::array::from_fn(|j| pixel((f * CAMERAS + c) * JOINTS + j))
                        })
                    })
                    .collect(),
                detected: all
                    .map(|f| {
                        let row = &joints.data[3 * JOINTS * f..3 * JOINTS * (f + 1)];
                        std::array::from_fn(|c| detected.remove(&(key(row), c)))
                    })
                    .collect(),
            }
        });
        Ok(Self {
            pieces: pieces.collect(),
        })
    }
}

/// Joints of a frame as bits: both archives hold the same numbers, and that tells which frame a detection is of.
fn key(joints: &[f64]) -> Vec<u64> {
    joints.iter().map(|x| x.to_bits()).collect()
}

type Detected = HashMap<(Vec<u64>, usize), [DVec2; COCO_JOINTS]>;

struct Reader<R> {
    file: String,
    archive: Archive<R>,
}

impl Reader<BufReader<std::fs::File>> {
    fn open(folder: &Path, name: &str) -> Result<Self, HumanEvaError> {
        let path = folder.join(name);
        let file = std::fs::File::open(&path).map_err(|source| HumanEvaError::Read {
            path: path.clone(),
            source,
        })?;
        let file_name = path.display().to_string();
        let archive = Archive::new(BufReader::new(file));
        Ok(Self {
            archive: archive.map_err(|source| HumanEvaError::Array {
                file: file_name.clone(),
                source,
            })?,
            file: file_name,
        })
    }
}

impl<R: Read + Seek> Reader<R> {
    fn wrong(&self, expected: String, found: String) -> HumanEvaError {
        HumanEvaError::Array {
            file: self.file.clone(),
            source: NpzError { expected, found },
        }
    }

    fn uneven(&self, names: usize, frames: usize) -> HumanEvaError {
        self.wrong(
            "'lengths' to tell every piece's frames".into(),
            format!("{names} names and {frames} frames that they do not add up to"),
        )
    }

    /// An array whose shape is given but for what is `None`.
    fn numbers(&mut self, name: &str, shape: &[Option<usize>]) -> Result<Numbers, HumanEvaError> {
        let read = self.archive.numbers(name);
        let array = read.map_err(|source| HumanEvaError::Array {
            file: self.file.clone(),
            source,
        })?;
        let fits = |a: &Numbers| {
            let alike = a.shape.iter().zip(shape);
            a.shape.len() == shape.len()
                && alike.into_iter().all(|(n, m)| m.is_none_or(|m| m == *n))
        };
        let found = array.as_ref().map_or_else(
            || "none of this name".to_owned(),
            |a| format!("shape {:?}", a.shape),
        );
        array.filter(fits).ok_or_else(|| {
            let sides = shape
                .iter()
                .map(|n| n.map_or("n".to_owned(), |n| n.to_string()));
            let sides: Vec<String> = sides.collect();
            self.wrong(format!("'{name}' of shape [{}]", sides.join(", ")), found)
        })
    }

    /// The same where every number is to be finite.
    fn finite(&mut self, name: &str, shape: &[Option<usize>]) -> Result<Numbers, HumanEvaError> {
        let array = self.numbers(name, shape)?;
        match array.data.iter().find(|x| !x.is_finite()) {
            None => Ok(array),
            Some(other) => Err(self.wrong(
                format!("'{name}' to be finite numbers"),
                format!("{other}; copy the archive again"),
            )),
        }
    }

    fn names(&mut self, name: &str) -> Result<Vec<String>, HumanEvaError> {
        let read = self.archive.texts(name);
        let texts = read.map_err(|source| HumanEvaError::Array {
            file: self.file.clone(),
            source,
        })?;
        texts.ok_or_else(|| self.wrong(format!("an array '{name}'"), "none of this name".into()))
    }

    /// Detections by the true joints of their frame, and camera; none of rows that are not all finite numbers.
    fn detected(&mut self) -> Result<Detected, HumanEvaError> {
        let joints = self.numbers("joints3d_m_world", &[None, Some(JOINTS), Some(3)])?;
        let pixels = self.numbers("alphapose2d_px", &[None, Some(COCO_JOINTS), Some(2)])?;
        let cameras = self.numbers("camera", &[None])?;
        let count = joints.shape[0];
        if pixels.shape[0] != count || cameras.shape[0] != count {
            return Err(self.wrong(
                "as many joints, detections and cameras".into(),
                format!("{count}, {} and {}", pixels.shape[0], cameras.shape[0]),
            ));
        }
        let is_known = |c: &&f64| (0..CAMERAS).any(|k| **c == k as f64);
        if let Some(other) = cameras.data.iter().find(|c| !is_known(c)) {
            return Err(self.wrong(
                format!("'camera' to be whole numbers below {CAMERAS}"),
                other.to_string(),
            ));
        }
        let rows = joints.data.chunks_exact(3 * JOINTS);
        let seen = pixels.data.chunks_exact(2 * COCO_JOINTS);
        let each = rows.zip(seen).zip(&cameras.data);
        let known = each.filter(|((_, seen), _)| seen.iter().all(|x| x.is_finite()));
        Ok(known
            .map(|((row, seen), camera)| {
                let pixel = |j: usize| DVec2::from_slice(&seen[2 * j..2 * j + 2]);
                ((key(row), *camera as usize), std::array::from_fn(pixel))
            })
            .collect())
    }
}
