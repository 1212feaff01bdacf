//! glTF 2.0 in one binary file: everybody as a skeleton with a skin, and one animation of all. Who is away has the size
//! 0; whoever is in the last frame stays. Times begin with the first person: the format has single floats, which
//! cannot tell pictures of a week's end apart.

mod document;
mod figure;
mod mesh;

pub use mesh::{MeshTrack, encode_meshes};

use self::document::Document;
use self::figure::{Bone, Figure, FigureSkin, presence};
use super::error::ExportError;
use super::mannequin::{Mannequin, starts};
use super::motion::Motion;
use super::take::Take;
use crate::body::skeleton::{RIG_BONES, RIG_NAMES};

/// The file of a take's people as mannequins.
///
/// # Errors
/// [`ExportError::Format`] beyond 4 GiB.
pub fn encode(take: &Take) -> Result<Vec<u8>, ExportError> {
    let mut document = Document::default();
    let start = take.start();
    for motion in Motion::all(take)? {
        let samples = &take.people[&motion.id];
        let heights = samples.iter().map(|s| f64::from(s.body.height));
        let height = heights.fold(0.0, f64::max).clamp(0.5, 2.5);
        let last = samples.last().map_or(0, |s| s.frame);
        let leaves = last + 1 < take.frames.len();
        document.figure(&mannequin(&motion, height, start, leaves));
    }
    document.finish()
}

/// `start`: the record's time that is the file's 0, seconds; `leaves`: whether frames follow their last one.
fn mannequin(motion: &Motion, height: f64, start: f64, leaves: bool) -> Figure {
    let rest = &motion.rest;
    let bones = RIG_NAMES.into_iter().zip(starts(rest)).enumerate();
    let bones = bones.map(|(bone, (name, start))| Bone {
        name,
        parent: rest.parents[bone],
        start: start.as_vec3(),
    });
    let skin = Mannequin::new(rest, height);
    let time = |step: usize| (motion.start - start + step as f64 / motion.rate) as f32;
    let moments = &motion.moments;
    let there = moments.iter().enumerate();
    let there = there.map(|(step, moment)| (time(step), moment.is_there));
    Figure {
        id: motion.id,
        what: "mannequin",
        bones: bones.collect(),
        skin: FigureSkin {
            positions: skin.positions,
            normals: skin.normals,
            bones: skin.bones,
            weights: skin.weights,
            triangles: skin.triangles.into_iter().map(u32::from).collect(),
        },
        times: (0..moments.len()).map(time).collect(),
        places: moments.iter().map(|m| m.position.as_vec3()).collect(),
        turns: (0..RIG_BONES)
            .map(|bone| moments.iter().map(|m| m.rotations[bone]).collect())
            .collect(),
        presence: presence(there, leaves.then(|| time(moments.len()))),
    }
}
