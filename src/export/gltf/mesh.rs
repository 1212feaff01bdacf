//! Fitted mesh bodies over time: the mesh of their shape on SMPL's tree.

use glam::{DQuat, Vec3};

use super::document::Document;
use super::figure::{Bone, Figure, FigureSkin, presence};
use crate::body::mesh::{JOINTS, MeshBody, MeshPose, NAMES, PARENTS, Person, Skin};
use crate::export::error::ExportError;
use crate::export::motion::Axes;

/// Influences of a vertex that the format's readers agree on.
const INFLUENCES: usize = 4;

/// A person's mesh body over time.
#[derive(Debug, Clone)]
pub struct MeshTrack<'a> {
    /// Who.
    pub id: u32,
    /// The shape.
    pub person: &'a Person,
    /// Rising seconds after the record's first frame, and the pose at each; the record's axes, metres.
    pub poses: Vec<(f64, &'a MeshPose)>,
}

/// The file of mesh bodies in the axes of the export. A pause of more than one and a half of the `rate`'s frames is
/// time in which somebody is away; whoever has a pose at the record's `end`, seconds after its first frame, stays. Pose
/// correctives are left out, the format's skins have none.
///
/// # Errors
/// [`ExportError::Format`] beyond 4 GiB.
pub fn encode_meshes(
    body: &MeshBody,
    tracks: &[MeshTrack<'_>],
    axes: &Axes,
    rate: f64,
    end: f64,
) -> Result<Vec<u8>, ExportError> {
    let mut document = Document::default();
    let firsts = tracks.iter().filter_map(|t| t.poses.first());
    let start = firsts.map(|(t, _)| *t).fold(f64::INFINITY, f64::min);
    for track in tracks.iter().filter(|t| !t.poses.is_empty()) {
        document.figure(&figure(body, track, axes, rate, [start, end]));
    }
    document.finish()
}

/// `start`: the record's time that is the file's 0; `end`: that of its last frame; seconds.
fn figure(
    body: &MeshBody,
    track: &MeshTrack<'_>,
    axes: &Axes,
    rate: f64,
    [start, end]: [f64; 2],
) -> Figure {
    let joints = track.person.joints();
    let bones = NAMES.into_iter().enumerate().map(|(j, name)| Bone {
        name,
        parent: (j > 0).then(|| PARENTS[j]),
        start: joints[j].as_vec3(),
    });
    let poses = &track.poses;
    let turn = |joint: usize, pose: &MeshPose| -> DQuat {
        let own = pose.rotations[joint];
        if joint == 0 { axes.turned(own) } else { own }
    };
    let frame = 1.0 / rate;
    let there = poses.iter().enumerate().flat_map(|(k, (time, _))| {
        let next = poses.get(k + 1).map(|(t, _)| *t);
        let pauses = next.is_some_and(|t| t - time > 1.5 * frame);
        let left = pauses.then_some(((time + frame - start) as f32, false));
        std::iter::once(((time - start) as f32, true)).chain(left)
    });
    let last = poses.last().map_or(0.0, |(t, _)| *t);
    let leaves = last < end;
    Figure {
        id: track.id,
        what: "body",
        bones: bones.collect(),
        skin: skin(body, track.person),
        times: poses.iter().map(|(t, _)| (t - start) as f32).collect(),
        places: poses
            .iter()
            .map(|(_, p)| axes.placed(p.pelvis).as_vec3())
            .collect(),
        turns: (0..JOINTS)
            .map(|j| poses.iter().map(|(_, p)| turn(j, p)).collect())
            .collect(),
        presence: presence(there, leaves.then_some((last + frame - start) as f32)),
    }
}

fn skin(body: &MeshBody, person: &Person) -> FigureSkin {
    let positions: Vec<Vec3> = Skin::new(body, person).rest().collect();
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for face in body.faces() {
        let [a, b, c] = face.map(|i| positions[i as usize]);
        // As long as the face is large: large ones count more.
        let normal = (b - a).cross(c - a);
        face.iter().for_each(|&i| normals[i as usize] += normal);
    }
    let (bones, weights) = (0..positions.len())
        .map(|v| influences(body.influences(v)))
        .unzip();
    FigureSkin {
        positions: positions.iter().map(Vec3::to_array).collect(),
        normals: normals
            .iter()
            .map(|n| n.try_normalize().unwrap_or(Vec3::Y).to_array())
            .collect(),
        bones,
        weights,
        triangles: body.faces().as_flattened().to_vec(),
    }
}

/// The strongest four, 1 in all.
fn influences(all: &[(u8, f32)]) -> ([u8; INFLUENCES], [f32; INFLUENCES]) {
    let mut all = all.to_vec();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all.truncate(INFLUENCES);
    let sum: f32 = all.iter().map(|(_, w)| w).sum();
    let (mut bones, mut weights) = ([0; INFLUENCES], [0.0; INFLUENCES]);
    for (k, (joint, weight)) in all.into_iter().enumerate() {
        bones[k] = joint;
        weights[k] = weight / sum;
    }
    (bones, weights)
}
