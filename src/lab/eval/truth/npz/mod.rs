//! NumPy archives of 3D joints go in, labelled people come out.
//!
//! Two layouts are read, and any mixture: that of public toolboxes (mmpose, SPIN: `imgname`, `S`, `part`) and plain
//! arrays (`positions_3d`, `positions_2d`), whose names follow VideoPose3D. N rows, P people a row, J joints:
//!
//! | array | shape | meaning |
//! |---|---|---|
//! | `S` or `positions_3d` | [N, J, 3], [N, P, J, 3] | joints in camera axes (x right, y down, z forward) |
//! | `part` or `positions_2d` | [N, J, 2], [N, P, J, 2] | joints in the picture, pixels; else projected with `camera_matrix` |
//! | `imgname` | [N], strings | picture of every row; rows of one picture are people in it |
//! | `frames` | [N] | without `imgname`: index in the video of its sequence; else 0, 1, 2, … in each |
//! | `valid` | [N], [N, P] | 0: nobody there, or somebody who is not labelled |
//! | `partial` | [1], [N] | 1: others may be in the picture; without it where somebody's `valid` is 0 |
//! | `sequence` | [1], [N], strings | recording of every row; else the folder of `imgname` |
//! | `joint_order` | string | `h36m`, `mpi_inf_3dhp`, `smpl` or `spin`; needed for 17 and 24 joints |
//! | `units` | string | of the 3D joints: `m` (also when it is missing) or `mm` |
//! | `camera_matrix` | [3, 3], [N, 3, 3] | intrinsics, pixels; lenses without distortion |
//! | `camera_pose` | [3, 4], [N, 3, 4] | world to camera; then the 3D joints are in world axes |
//!
//! A last column more (4 in 3D, 3 in 2D) is a flag, 0 where a joint is not known; so is NaN. In a video a person keeps
//! its place along P: it is the identity. Of several videos (`sequence` without `imgname`) one is read, as `--split`
//! says: predictions name none. Where pictures of several sequences have one name, each is taken to be in a folder of
//! its sequence's name.

mod camera;
mod check;
mod table;

use std::collections::HashMap;
use std::io::Cursor;

use clap::ValueEnum;

use self::camera::Camera;
use self::table::{Source, Table};
use super::{JointOrder, ReadOptions, TruthFrame, TruthPerson, TruthSet};
use crate::lab::eval::EvalError;
use crate::npz::Archive;

/// A unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Units {
    /// Metres.
    #[default]
    M,
    /// Millimetres.
    Mm,
}

impl Units {
    fn in_metres(self) -> f64 {
        match self {
            Self::M => 1.0,
            Self::Mm => 1e-3,
        }
    }
}

/// Reads the bytes of an archive; `name` is for errors.
pub(super) fn read(bytes: &[u8], name: &str, options: &ReadOptions) -> Result<TruthSet, EvalError> {
    let archive = Archive::new(Cursor::new(bytes))
        .map_err(|e| EvalError::format(name, e.expected, e.found))?;
    let mut source = Source { archive, name };
    let Some(solid) = Table::<3>::read(&mut source, ["positions_3d", "S"])? else {
        return Err(source.wrong(
            "an array 'positions_3d' or 'S' of 3D joints",
            format!(
                "{}; see \"Measure it yourself\" in docs/accuracy.md",
                source.listed()
            ),
        ));
    };
    let flat = Table::<2>::read(&mut source, ["positions_2d", "part"])?;
    if let Some(flat) = &flat
        && flat.size() != solid.size()
    {
        return Err(source.wrong(
            format!(
                "'{}' and '{}' of as many rows, people and joints",
                solid.key, flat.key
            ),
            format!("{:?} and {:?}", solid.size(), flat.size()),
        ));
    }
    let [rows, people, joints] = solid.size();
    let order = joint_order(&mut source, options, joints)?;
    let units = match options.units {
        Some(units) => units,
        None => named(&mut source, "units")?.unwrap_or_default(),
    };
    let camera = Camera::read(&mut source, rows, units.in_metres())?;
    if flat.is_none() && !camera.projects() {
        return Err(source.wrong(
            "'positions_2d', 'part' or 'camera_matrix': who is who is seen in the picture",
            "none of them; add one",
        ));
    }
    let valid = valid(&mut source, rows, people)?;
    let partial = partial(&mut source, rows, &valid)?;
    let pictures = per_row(&mut source, "imgname", rows)?;
    let sequences = per_row(&mut source, "sequence", rows)?;
    let frames = match pictures {
        Some(_) => None,
        None => Some(frame_numbers(&mut source, rows, sequences.as_deref())?),
    };
    if let (None, None, Some(all)) = (&pictures, &options.split, &sequences)
        && let Some(other) = all.iter().find(|s| **s != all[0])
    {
        return Err(source.wrong(
            "--split with the name of a sequence, as there are several videos",
            format!("'{}', '{other}' and no 'imgname'; name one", all[0]),
        ));
    }

    let mut set = TruthSet {
        video: pictures.is_none(),
        ..TruthSet::default()
    };
    let mut place: HashMap<(&str, &str), usize> = HashMap::new();
    for row in 0..rows {
        let picture = pictures.as_ref().map_or("", |all| &all[row]);
        let sequence = match &sequences {
            Some(all) => all[row].as_str(),
            None => picture.rsplit_once('/').map_or("", |(folder, _)| folder),
        };
        if options.split.as_deref().is_some_and(|s| s != sequence) {
            continue;
        }
        let found = (0..people).filter(|p| valid[row * people + p]).map(|p| {
            let solid = |k: usize| {
                let at = solid.at([row, p, k])?;
                Some(camera.place(row, at.map(|x| x * units.in_metres())))
            };
            let flat = |k: usize| match &flat {
                Some(flat) => flat.at([row, p, k]),
                None => camera.project(row, solid(k)?),
            };
            TruthPerson {
                id: set.video.then_some(p as u64),
                ..TruthPerson::of_joints(&order, flat, solid)
            }
        });
        let found: Vec<TruthPerson> = found.collect();
        match place.get(&(sequence, picture)).filter(|_| !set.video) {
            Some(&k) => {
                set.frames[k].people.extend(found);
                set.frames[k].partial |= partial[row];
            }
            None => {
                place.insert((sequence, picture), set.frames.len());
                set.frames.push(TruthFrame {
                    source: picture.to_owned(),
                    frame: frames.as_ref().map(|f| f[row]),
                    sequence: sequence.to_owned(),
                    partial: partial[row],
                    people: found,
                    ..TruthFrame::default()
                });
            }
        }
    }
    if let Some(part) = options.split.as_ref().filter(|_| set.frames.is_empty()) {
        return Err(source.wrong(
            format!("rows of the sequence '{part}'"),
            "none; name another --split, or none",
        ));
    }
    if pictures.is_some() {
        name_folders(&mut set.frames);
    }
    // A set that never shows two people labels one of perhaps several.
    set.single = people == 1 && set.frames.iter().all(|f| f.people.len() <= 1);
    check::plausible(&set, name)?;
    Ok(set)
}

/// Puts pictures of one name into folders of their sequences' names, by which predictions tell them apart.
fn name_folders(frames: &mut [TruthFrame]) {
    let mut named: HashMap<String, usize> = HashMap::new();
    for f in frames.iter() {
        *named.entry(f.source.clone()).or_default() += 1;
    }
    for f in frames.iter_mut().filter(|f| !f.sequence.is_empty()) {
        if named[&f.source] > 1 {
            f.source = format!("{}/{}", f.sequence, f.source);
        }
    }
}

/// The body joint at each place of the archive's order.
fn joint_order(
    source: &mut Source<'_>,
    options: &ReadOptions,
    joints: usize,
) -> Result<Vec<Option<usize>>, EvalError> {
    let said = match options.joint_order {
        Some(order) => Some(order),
        None => named(source, "joint_order")?,
    };
    let order = match (said, &JointOrder::of_count(joints)[..]) {
        (Some(order), _) => order,
        (None, [only]) => *only,
        (None, []) => return Err(other_count(source, format!("{joints} joints"))),
        (None, several) => {
            let said = |order: &JointOrder| format!("--joint-order {}", name_of(*order));
            let names: Vec<String> = several.iter().map(said).collect();
            return Err(source.wrong(
                "to know the order of the joints",
                format!(
                    "{joints} joints and no array 'joint_order'; say {}",
                    names.join(" or ")
                ),
            ));
        }
    };
    let all = order.body_joints(joints);
    all.ok_or_else(|| other_count(source, format!("{joints} joints for {}", name_of(order))))
}

fn other_count(source: &Source<'_>, found: String) -> EvalError {
    source.wrong(
        "17 or 32 joints of Human3.6M, 17 or 28 of MPI-INF-3DHP, or 24 of SMPL or SPIN",
        found,
    )
}

/// How a choice is written.
pub(super) fn name_of<T: ValueEnum>(choice: T) -> String {
    let value = choice.to_possible_value();
    value.map_or_else(String::new, |v| v.get_name().to_owned())
}

/// The choice that an array of one string names, if there is such an array.
fn named<T: ValueEnum>(source: &mut Source<'_>, key: &str) -> Result<Option<T>, EvalError> {
    let Some(texts) = source.texts(key)? else {
        return Ok(None);
    };
    let choice = match &texts[..] {
        [text] => T::from_str(text, true).ok(),
        _ => None,
    };
    let Some(choice) = choice else {
        let names = T::value_variants().iter().cloned().map(name_of);
        let names: Vec<String> = names.collect();
        let expected = format!("'{key}' to be one string of {}", names.join(", "));
        return Err(source.wrong(expected, format!("{texts:?}")));
    };
    Ok(Some(choice))
}

/// One string for every row; a single one counts for all.
fn per_row(
    source: &mut Source<'_>,
    key: &str,
    rows: usize,
) -> Result<Option<Vec<String>>, EvalError> {
    let Some(mut texts) = source.texts(key)? else {
        return Ok(None);
    };
    if texts.len() == 1 {
        texts = vec![texts.swap_remove(0); rows];
    }
    if texts.len() != rows {
        let found = format!("{} strings", texts.len());
        return Err(source.wrong(
            format!("'{key}' to have {rows} strings, one per row"),
            found,
        ));
    }
    Ok(Some(texts))
}

fn valid(source: &mut Source<'_>, rows: usize, people: usize) -> Result<Vec<bool>, EvalError> {
    let Some(flags) = source.numbers("valid")? else {
        return Ok(vec![true; rows * people]);
    };
    let wide = flags.shape == [rows, people];
    if !wide && flags.shape != [rows] && flags.shape != [rows, 1] {
        return Err(source.wrong(
            format!("'valid' of shape [{rows}] or [{rows}, {people}]"),
            format!("{:?}", flags.shape),
        ));
    }
    let of = |k: usize| flags.data[if wide { k } else { k / people }] > 0.0;
    Ok((0..rows * people).map(of).collect())
}

/// Whether somebody may be in a row's picture who is not labelled: whoever is found beside the labelled proves nothing.
fn partial(source: &mut Source<'_>, rows: usize, valid: &[bool]) -> Result<Vec<bool>, EvalError> {
    let Some(flags) = source.numbers("partial")? else {
        let each = valid.chunks_exact(valid.len() / rows);
        return Ok(each.map(|people| people.contains(&false)).collect());
    };
    match flags.data[..] {
        [all] => Ok(vec![all > 0.0; rows]),
        ref each if each.len() == rows => Ok(each.iter().map(|x| *x > 0.0).collect()),
        _ => Err(source.wrong(
            format!("'partial' of shape [1] or [{rows}]"),
            format!("{:?}", flags.shape),
        )),
    }
}

/// Index of every row in its video, which its sequence tells.
fn frame_numbers(
    source: &mut Source<'_>,
    rows: usize,
    sequences: Option<&[String]>,
) -> Result<Vec<u64>, EvalError> {
    let of = |row: usize| sequences.map_or("", |all| &all[row]);
    let numbers = source.numbers("frames")?;
    let mut next: HashMap<&str, u64> = HashMap::new();
    let mut out = Vec::with_capacity(rows);
    for row in 0..rows {
        let least = next.entry(of(row)).or_default();
        let index = match &numbers {
            None => Some(*least),
            Some(n) if n.data.len() != rows => None,
            Some(n) => Some(n.data[row])
                .filter(|x| x.fract() == 0.0 && *x >= *least as f64)
                .map(|x| x as u64),
        };
        let Some(index) = index else {
            let count = numbers.map_or(0, |n| n.data.len());
            return Err(source.wrong(
                format!("'frames' to be {rows} indices from 0 that rise in every sequence"),
                format!("{count} values of another kind"),
            ));
        };
        *least = index.saturating_add(1);
        out.push(index);
    }
    Ok(out)
}
