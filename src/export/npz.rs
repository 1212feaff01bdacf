//! NumPy arrays over T frames and P people at the frames' own times; NaN where somebody is not in a frame. Metres and
//! radians in camera axes, pixels, quaternions xyzw.

use std::io::{self, Seek, Write};

use super::error::ExportError;
use super::size;
use super::take::Take;
use crate::joints::{BODY_JOINTS, DOF};
use crate::message::{Body, HUMANOID_BONE_COUNT};
use crate::npz::{Array, Values, Writer};

/// What an array takes of a body, and its shape for one.
type Field = (&'static str, &'static [usize], fn(&Body) -> Vec<f32>);

const FIELDS: [Field; 13] = [
    ("score", &[], |b| vec![b.score]),
    ("state", &[], |b| vec![b.state.code() as f32]),
    ("height", &[], |b| vec![b.height]),
    ("position", &[3], |b| b.position.to_vec()),
    ("orientation", &[4], |b| b.orientation.to_vec()),
    ("velocity", &[3], |b| b.velocity.to_vec()),
    ("angles", &[DOF], |b| b.angles.to_vec()),
    ("joints3d", &[BODY_JOINTS, 3], |b| b.joints3d.concat()),
    ("joints2d", &[BODY_JOINTS, 2], |b| b.joints2d.concat()),
    ("confidence", &[BODY_JOINTS], |b| b.confidence.to_vec()),
    ("joint_states", &[BODY_JOINTS], |b| {
        b.joint_states.map(|s| s.code() as f32).to_vec()
    }),
    ("bone_lengths", &[BODY_JOINTS], |b| b.bone_lengths.to_vec()),
    ("bone_rotations", &[HUMANOID_BONE_COUNT, 4], |b| {
        b.bone_rotations.concat()
    }),
];

/// Refuses a take whose arrays are more numbers than a file may hold.
///
/// # Errors
/// [`ExportError::Format`].
pub fn expect(take: &Take) -> Result<(), ExportError> {
    let (frames, people) = (take.frames.len(), take.people.len());
    let of_one: usize = FIELDS
        .iter()
        .map(|(_, shape, _)| shape.iter().product::<usize>())
        .sum();
    let bytes = frames as f64 * people as f64 * (of_one * size_of::<f32>()) as f64;
    size::expect(bytes, || format!("{frames} frames × {people} people"))
}

/// Writes the archive, one array after the other: `frame` and `time` (T), `person` (P), `world_rotation` (T × 4) and
/// `world_translation` (T × 3), NaN while no floor was known, and T × P × … of every field.
///
/// # Errors
/// Those of what is written into.
pub fn write<W: Write + Seek>(take: &Take, mut archive: Writer<W>) -> io::Result<()> {
    let (frames, people) = (take.frames.len(), take.people.len());
    let mut add =
        |name: &str, shape: &[usize], data: Values<'_>| archive.add(&Array { name, shape, data });
    let numbers: Vec<i64> = take.frames.iter().map(|f| f.sequence as i64).collect();
    let times: Vec<f64> = take.frames.iter().map(|f| f.time).collect();
    let ids: Vec<i64> = take.people.keys().map(|&id| i64::from(id)).collect();
    add("frame", &[frames], Values::I64(&numbers))?;
    add("time", &[frames], Values::F64(&times))?;
    add("person", &[people], Values::I64(&ids))?;
    let mut rotations = vec![f32::NAN; 4 * frames];
    let mut translations = vec![f32::NAN; 3 * frames];
    for (t, frame) in take.frames.iter().enumerate() {
        if frame.world.is_known() {
            rotations[4 * t..4 * t + 4].copy_from_slice(&frame.world.rotation);
            translations[3 * t..3 * t + 3].copy_from_slice(&frame.world.translation);
        }
    }
    add("world_rotation", &[frames, 4], Values::F32(&rotations))?;
    add(
        "world_translation",
        &[frames, 3],
        Values::F32(&translations),
    )?;
    for (name, of_one, value) in FIELDS {
        let size = of_one.iter().product::<usize>();
        let mut data = vec![f32::NAN; frames * people * size];
        for (p, samples) in take.people.values().enumerate() {
            for sample in samples {
                let at = (sample.frame * people + p) * size;
                data[at..at + size].copy_from_slice(&value(&sample.body));
            }
        }
        let shape = [&[frames, people], of_one].concat();
        add(name, &shape, Values::F32(&data))?;
    }
    archive.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_names_every_array() {
        let page = include_str!("../../docs/export.md");
        let (_, arrays) = page.split_once("\n## Arrays of `.npz`\n").unwrap();
        let arrays = arrays.split("\n## ").next().unwrap();
        let of_all = [
            "frame",
            "time",
            "person",
            "world_rotation",
            "world_translation",
        ];
        for name in FIELDS.iter().map(|field| field.0).chain(of_all) {
            assert!(arrays.contains(&format!("`{name}`")), "{name}");
        }
    }
}
