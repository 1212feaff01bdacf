//! Ground truth in public formats goes in, labelled people per picture come out.

mod annotations;
mod coco;
mod joint_order;
mod mpii;
mod npz;
mod synth;

use std::io;
use std::path::{Component, Path, PathBuf};

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS};

pub use self::joint_order::JointOrder;
pub use self::npz::Units;
use super::{EvalError, HeadSize, Keypoint, bounding_box};

/// Area of a person over that of the box of its joints, where the format gives no area (COCO's mean; CrowdPose uses the
/// same).
pub(super) const AREA_OF_BOX: f64 = 0.53;

/// How a truth file is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Format {
    /// Whichever of the others the file looks like.
    #[default]
    Auto,
    /// COCO keypoints (`images`, `annotations`, `categories`); also CrowdPose, OCHuman and MPII. Keypoints of other
    /// names count with `--joints all` alone.
    Coco,
    /// A list of people with `image`, `joints` and `joints_vis` in MPII's 16 joints; with `headbox`, the head's
    /// rectangle (x, y, x, y), where it is known.
    Mpii,
    /// A list of pictures of one person each with `file`, `joints` and `split` in the 14 evidence joints (Leeds Sports
    /// Pose).
    People2d,
    /// A list of pictures of one person each with `file`, `joints2d` and `joints3d_camera_m`, in the order of joints
    /// that `set` names (`h36m`, `mpi_inf_3dhp`, `smpl`, `spin`).
    Real3d,
    /// `truth.json` of `edgecap synth`.
    Synth,
    /// A NumPy archive of 3D joints as public toolboxes export Human3.6M, MPI-INF-3DHP and MuPoTS-3D: `S` and `part`,
    /// or `positions_3d` and `positions_2d`.
    Npz,
}

/// How to read a truth file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReadOptions {
    /// How it is written.
    pub format: Format,
    /// The part wanted of a format that has parts: a split of Leeds Sports Pose, a sequence of an archive.
    pub split: Option<String>,
    /// Order of an archive's joints; else the archive says, or their number.
    pub joint_order: Option<JointOrder>,
    /// Unit of an archive's 3D joints; else the archive says, or metres.
    pub units: Option<Units>,
}

/// Everyone labelled in one picture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TruthFrame {
    /// Path of the picture, or of its video, as the truth names it; empty where it names none.
    pub source: String,
    /// Index in a film; none where the name tells the picture.
    pub frame: Option<u64>,
    /// When it was taken, seconds from any begin that all frames share, where the truth knows.
    pub seconds: Option<f64>,
    /// Recording it belongs to; empty where the format does not tell recordings apart.
    pub sequence: String,
    /// Width and height of the picture, pixels, where the truth tells.
    pub size: Option<[f64; 2]>,
    /// Some of the people in it are labelled, others may be there: who is reported beside them proves nothing.
    pub partial: bool,
    /// The people.
    pub people: Vec<TruthPerson>,
}

/// One labelled person.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TruthPerson {
    /// Identity, where the truth has one.
    pub id: Option<u64>,
    /// Labelled points.
    pub points: Vec<Keypoint>,
    /// Area, square pixels; 0 where the labels span none.
    pub area: f64,
    /// x, y, width, height, pixels.
    pub bbox: [f64; 4],
    /// A group that is not labelled one by one, or a person not to be asked for.
    pub crowd: bool,
    /// x, y, width, height, pixels, of somebody of whom no joint is in the picture: a hand or a head may be, and
    /// whoever is reported with the middle in it is neither right nor wrong.
    pub beyond: Option<[f64; 4]>,
    /// Body joints in camera space, metres.
    pub joints3d: Option<[Option<[f64; 3]>; BODY_JOINTS]>,
    /// Height, metres.
    pub stature: Option<f64>,
    /// Size of the head, for PCKh; known in MPII alone.
    pub head: Option<HeadSize>,
}

impl TruthPerson {
    /// A person of whom only points are known.
    fn of_points(points: Vec<Keypoint>) -> Self {
        let bbox = bounding_box(&points);
        Self {
            area: AREA_OF_BOX * bbox[2] * bbox[3],
            bbox,
            points,
            ..Self::default()
        }
    }

    /// A person of whom joints are known in the picture (pixels) and in camera space (metres), both asked for by their
    /// place in a public set's order; `order` holds the body joint at each place.
    fn of_joints(
        order: &[Option<usize>],
        flat: impl Fn(usize) -> Option<[f64; 2]>,
        solid: impl Fn(usize) -> Option<[f64; 3]>,
    ) -> Self {
        let (mut points, mut joints3d) = (Vec::new(), [None; BODY_JOINTS]);
        for (k, joint) in order.iter().enumerate() {
            let Some(j) = *joint else { continue };
            joints3d[j] = solid(k);
            if j < EVIDENCE_JOINTS {
                points.push(match flat(k) {
                    Some([u, v]) => Keypoint::at(j, u, v, 2),
                    None => Keypoint::at(j, 0.0, 0.0, 0),
                });
            }
        }
        Self {
            joints3d: Some(joints3d),
            ..Self::of_points(points)
        }
    }

    /// Height of the person's box, pixels.
    pub fn height(&self) -> f64 {
        self.bbox[3]
    }
}

/// A truth file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TruthSet {
    /// In order of the file.
    pub frames: Vec<TruthFrame>,
    /// One labelled person a picture, and bystanders without labels: a prediction too many proves nothing.
    pub single: bool,
    /// The frames follow each other in time.
    pub video: bool,
    /// All of them lie in one film, none in a picture of its own.
    pub clip: bool,
}

impl TruthSet {
    /// Adds the frames of another file of the same kind; `name` is for errors.
    pub fn append(&mut self, more: Self, name: &str) -> Result<(), EvalError> {
        if self.frames.is_empty() {
            *self = more;
            return Ok(());
        }
        if self.video || more.video {
            return Err(EvalError::format(
                name,
                "one truth, as films are measured one at a time",
                "another beside it; give each film's truth and predictions to an `eval` of its own",
            ));
        }
        if self.single != more.single {
            return Err(EvalError::format(
                name,
                "truth of the same kind as the files before it",
                "another kind; measure it on its own",
            ));
        }
        self.frames.extend(more.frames);
        Ok(())
    }

    /// Reads a truth file.
    ///
    /// # Errors
    /// When it cannot be read, or is not what it should be.
    pub fn read(path: &Path, options: &ReadOptions) -> Result<Self, EvalError> {
        let name = path.display().to_string();
        let unreadable = |source| EvalError::Read {
            path: path.into(),
            source,
        };
        let bytes = crate::bounded::read(path, crate::bounded::DATA).map_err(unreadable)?;
        if bytes.trim_ascii().is_empty() {
            return Err(EvalError::format(
                name,
                "ground truth",
                "an empty file; copy it again, or give another with --truth",
            ));
        }
        if options.format == Format::Npz || bytes.starts_with(b"PK") {
            return npz::read(&bytes, &name, options);
        }
        if bytes.starts_with(b"MATLAB") || bytes.starts_with(b"\x89HDF") {
            return Err(EvalError::format(
                name,
                "JSON or a NumPy archive (.npz)",
                "a MATLAB file; turn it into an archive with tests/reference/mat_to_npz.py",
            ));
        }
        // Pickles of protocol 2 and later, and those of protocol 0, which 3DPW uses, begin so.
        if bytes.starts_with(b"\x80") || bytes.starts_with(b"(dp") {
            return Err(EvalError::format(
                name,
                "JSON or a NumPy archive (.npz)",
                "a pickle, which is a program; turn 3DPW's into an archive with tests/reference/threedpw_to_npz.py",
            ));
        }
        if options.joint_order.is_some() || options.units.is_some() {
            return Err(EvalError::format(
                name,
                "a NumPy archive (.npz) with --joint-order or --units",
                "another format, which says both; leave them out",
            ));
        }
        let text = String::from_utf8(bytes)
            .map_err(|_| EvalError::format(&name, "JSON or a NumPy archive (.npz)", "neither"))?;
        // The truth's own place tells its pictures from those of other folders.
        let place = spelled_out(path).map_err(unreadable)?;
        let split = options.split.as_deref();
        Self::parse_in(place.parent(), &text, &name, options.format, split)
    }

    /// Reads the text of a truth file; `name` is for errors.
    pub fn parse(
        text: &str,
        name: &str,
        format: Format,
        split: Option<&str>,
    ) -> Result<Self, EvalError> {
        Self::parse_in(None, text, name, format, split)
    }

    /// The same of a file in `folder`, whose name pictures get that lie beside their truth.
    fn parse_in(
        folder: Option<&Path>,
        text: &str,
        name: &str,
        format: Format,
        split: Option<&str>,
    ) -> Result<Self, EvalError> {
        let value: serde_json::Value = serde_json::from_str(text)
            .map_err(|e| EvalError::format(name, "JSON", e.to_string()))?;
        let format = match format {
            Format::Auto => recognise(&value).ok_or_else(|| {
                EvalError::format(
                    name,
                    "ground truth of a known format (see `edgecap eval --help`)",
                    "none of them; say which with --format",
                )
            })?,
            other => other,
        };
        let unread = |e: serde_json::Error| {
            EvalError::format(
                name,
                format!("ground truth of --format {}", npz::name_of(format)),
                e.to_string(),
            )
        };
        if split.is_some() && format != Format::People2d {
            return Err(EvalError::format(
                name,
                "truth that has parts with --split, a NumPy archive or a list with 'split'",
                format!(
                    "--format {}, which has none; leave it out",
                    npz::name_of(format)
                ),
            ));
        }
        match format {
            Format::Coco => coco::read(serde_json::from_value(value).map_err(unread)?, name),
            Format::Mpii => mpii::read(serde_json::from_value(value).map_err(unread)?, name),
            Format::People2d => Ok(annotations::people2d(
                serde_json::from_value(value).map_err(unread)?,
                split,
            )),
            Format::Real3d => {
                annotations::real3d(serde_json::from_value(value).map_err(unread)?, name)
            }
            Format::Npz => Err(EvalError::format(
                name,
                "a NumPy archive (.npz)",
                "text; name another --format",
            )),
            Format::Synth | Format::Auto => {
                synth::expect_version(&value, name)?;
                let file = serde_json::from_value(value).map_err(unread)?;
                synth::read(file, name, folder)
            }
        }
    }
}

/// The whole path, by the names that links have where it leads through them, without `..`: the folder that a path names
/// in full ends in the name that tells it from others.
fn spelled_out(path: &Path) -> io::Result<PathBuf> {
    let mut out = PathBuf::new();
    for part in std::path::absolute(path)?.components() {
        match part {
            Component::ParentDir => {
                // Above a link is what is above the folder that it leads to.
                if out.is_symlink() {
                    out = out.canonicalize()?;
                }
                out.pop();
            }
            other => out.push(other),
        }
    }
    Ok(out)
}

/// The size of a head by its rectangle in a file; `at` says whose it is.
///
/// # Errors
/// When the rectangle has no extent.
fn head_of_rectangle(
    rectangle: [f64; 4],
    at: impl std::fmt::Display,
) -> Result<HeadSize, EvalError> {
    HeadSize::of_rectangle(rectangle).ok_or_else(|| {
        EvalError::format(
            at,
            "a headbox of x, y of the upper left corner and x, y of the lower right one",
            format!("{rectangle:?}; write the file again, or leave it out"),
        )
    })
}

/// The format by the keys it has.
fn recognise(value: &serde_json::Value) -> Option<Format> {
    let has = |v: &serde_json::Value, keys: &[&str]| keys.iter().all(|k| v.get(k).is_some());
    if has(value, &["images", "annotations"]) {
        return Some(Format::Coco);
    }
    if has(value, &["frames", "fps"]) {
        return Some(Format::Synth);
    }
    let first = value.as_array()?.first()?;
    if has(first, &["image", "joints", "joints_vis"]) {
        Some(Format::Mpii)
    } else if has(first, &["file", "joints2d", "joints3d_camera_m"]) {
        Some(Format::Real3d)
    } else if has(first, &["file", "joints"]) {
        Some(Format::People2d)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_spelled_out_by_the_names_of_links_but_above_them() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        std::fs::create_dir_all(folder.join("real/deep")).unwrap();
        std::os::unix::fs::symlink("real/deep", folder.join("link")).unwrap();
        for (path, whole) in [
            ("real/deep/../t.json", "real/t.json"),
            ("real/./deep/../../t.json", "t.json"),
            ("link/t.json", "link/t.json"),
            ("link/../t.json", "real/t.json"),
        ] {
            assert_eq!(spelled_out(&folder.join(path)).unwrap(), folder.join(whole));
        }
    }
}
