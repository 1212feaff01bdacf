//! In: a [`BodyFrame`]. Out: one line of the bodies file that `run --jsonl` and `fit --jsonl` write.

use std::io::Write;

use serde::Serialize;

use crate::joints::{BODY_JOINTS, DOF};
use crate::message::{
    Body, BodyFrame, BodyState, HUMANOID_BONE_COUNT, JointState, World, WorldState,
};

/// One frame of the bodies file. Metres and radians in camera axes, pixels of the original picture, quaternions xyzw.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BodiesLine {
    /// Sequence number of the frame.
    pub frame: u64,
    /// The time the bodies are given for.
    pub time_ns: u64,
    /// The floor-aligned world; absent while no floor is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub world: Option<WorldLine>,
    /// Everyone with an identity, by rising id.
    pub people: Vec<BodyLine>,
}

/// The floor-aligned world of a [`BodiesLine`]: x to the camera's right, y up, z towards the viewer, metres, origin on the floor
/// below the camera. world = rotation · camera + translation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorldLine {
    /// Camera axes to world axes.
    pub rotation: [f32; 4],
    /// The camera in the world.
    pub translation: [f32; 3],
    /// `estimated` from standing feet, or `given` by the settings.
    pub state: &'static str,
}

/// One person of a [`BodiesLine`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BodyLine {
    /// Identity, from 1.
    pub id: u32,
    /// `tracked` or `predicted`.
    pub state: &'static str,
    /// Pelvis in camera space.
    pub position: [f32; 3],
    /// Rotation of the pelvis, rest axes to camera axes.
    pub orientation: [f32; 4],
    /// Pelvis velocity, metres per second.
    pub velocity: [f32; 3],
    /// Skeleton parameters in the order of `models/skeleton.toml`.
    pub angles: [f32; DOF],
    /// Joints in camera space.
    pub joints3d: [[f32; 3]; BODY_JOINTS],
    /// `joints3d` projected into the picture.
    pub joints2d: [[f32; 2]; BODY_JOINTS],
    /// Overall confidence, 0–1.
    pub confidence: f32,
    /// Probability that each joint is within 150 mm of the truth.
    pub joint_confidence: [f32; BODY_JOINTS],
    /// `observed`, `occluded` or `predicted` per joint.
    pub joint_states: [&'static str; BODY_JOINTS],
    /// Stature.
    pub height: f32,
    /// Length of the bone that ends in each joint.
    pub bone_lengths: [f32; BODY_JOINTS],
    /// Local rotations for [`HUMANOID_BONES`](crate::message::HUMANOID_BONES).
    pub bone_rotations: [[f32; 4]; HUMANOID_BONE_COUNT],
}

impl From<&BodyFrame> for BodiesLine {
    fn from(frame: &BodyFrame) -> Self {
        Self {
            frame: frame.sequence,
            time_ns: frame.pose_ns,
            world: WorldLine::of(&frame.world),
            people: frame.bodies().iter().map(BodyLine::from).collect(),
        }
    }
}

impl WorldLine {
    fn of(world: &World) -> Option<Self> {
        world.is_known().then_some(Self {
            rotation: world.rotation,
            translation: world.translation,
            state: if world.state == WorldState::Given as u32 {
                "given"
            } else {
                "estimated"
            },
        })
    }
}

impl From<&Body> for BodyLine {
    fn from(body: &Body) -> Self {
        Self {
            id: body.id,
            state: match body.state {
                s if s == BodyState::Tracked as u32 => "tracked",
                s if s == BodyState::Predicted as u32 => "predicted",
                _ => "tentative",
            },
            position: body.position,
            orientation: body.orientation,
            velocity: body.velocity,
            angles: body.angles,
            joints3d: body.joints3d,
            joints2d: body.joints2d,
            confidence: body.score,
            joint_confidence: body.confidence,
            joint_states: std::array::from_fn(|j| match body.joint_states[j] {
                s if s == JointState::Observed as u8 => "observed",
                s if s == JointState::Occluded as u8 => "occluded",
                _ => "predicted",
            }),
            height: body.height,
            bone_lengths: body.bone_lengths,
            bone_rotations: body.bone_rotations,
        }
    }
}

/// Writes the frame as one line, newline included.
///
/// # Errors
/// Those of `out`.
pub fn write_bodies<W: Write>(out: &mut W, frame: &BodyFrame) -> std::io::Result<()> {
    serde_json::to_writer(&mut *out, &BodiesLine::from(frame))?;
    out.write_all(b"\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_the_documented_fields() {
        let mut frame = BodyFrame {
            sequence: 3,
            capture_ns: 90,
            pose_ns: 100,
            count: 2,
            ..BodyFrame::default()
        };
        frame.bodies[0].id = 5;
        frame.bodies[0].state = BodyState::Tracked as u32;
        frame.bodies[0].score = 0.75;
        frame.bodies[0].joint_states[20] = JointState::Occluded as u8;
        frame.bodies[1].id = 6;
        frame.bodies[1].state = BodyState::Predicted as u32;
        let mut out = Vec::new();
        write_bodies(&mut out, &frame).unwrap();
        assert_eq!(out.iter().filter(|&&b| b == b'\n').count(), 1);
        let line: serde_json::Value = serde_json::from_slice(&out).unwrap();
        assert_eq!(
            (line["frame"].as_u64(), line["time_ns"].as_u64()),
            (Some(3), Some(100))
        );
        let people = line["people"].as_array().unwrap();
        assert_eq!(people.len(), 2);
        assert_eq!(people[0]["id"], 5);
        assert_eq!(people[0]["state"], "tracked");
        assert_eq!(people[1]["state"], "predicted");
        assert_eq!(people[0]["confidence"], 0.75);
        assert_eq!(people[0]["joint_states"][20], "occluded");
        for (field, length) in [
            ("position", 3),
            ("orientation", 4),
            ("velocity", 3),
            ("angles", 29),
            ("joints3d", 21),
            ("joints2d", 21),
            ("joint_confidence", 21),
            ("bone_lengths", 21),
            ("bone_rotations", 16),
        ] {
            assert_eq!(
                people[0][field].as_array().map(Vec::len),
                Some(length),
                "{field}"
            );
        }
        assert!(people[0]["height"].is_number());
        assert!(line.get("world").is_none(), "no floor, no world");
        frame.world = World {
            rotation: [1.0, 0.0, 0.0, 0.0],
            translation: [0.0, 1.5, 0.0],
            state: WorldState::Estimated as u32,
        };
        let line = serde_json::to_value(BodiesLine::from(&frame)).unwrap();
        assert_eq!(line["world"]["state"], "estimated");
        assert_eq!(line["world"]["translation"][1], 1.5);
        assert_eq!(line["world"]["rotation"].as_array().unwrap().len(), 4);
    }
}
