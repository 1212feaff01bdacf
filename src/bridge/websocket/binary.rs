//! The compact form of a frame, a fifth of the JSON: little-endian, every number at a fixed place, everything a multiple of four.
//!
//! | byte | type | what |
//! |---|---|---|
//! | 0 | 4 bytes | `ECAP` |
//! | 4 | u16, u16 | version of this form, 1; number of bodies |
//! | 8, 16, 24, 32 | u64 | `sequence`, `capture_ns`, `pose_ns`, `publish_ns` |
//! | 40 | 2 u32 | `width`, `height` |
//! | 48 | 4 f32 | `fx`, `fy`, `cx`, `cy` |
//! | 64 | 4 u32 | stage times, µs: letterbox, Stage I, association, Stage II |
//! | 80 | 3 u32 | `fit_us`, `flags`, `frame_total` |
//! | 92 | u32 | state of the world: 0 none, 1 estimated, 2 given |
//! | 96 | 4 f32, 3 f32 | rotation and translation of the world |
//! | 124 | u32 | bytes of the camera's name, which follows, filled up with zeros to a multiple of four |
//! | then | 468 bytes each | bodies |
//!
//! | byte of a body | type | what |
//! |---|---|---|
//! | 0 | u32 | `id` |
//! | 4 | u8 | `state`; three zeros |
//! | 8 | f32, f32 | `score`, `height` |
//! | 16 | 3 f32 | `velocity` |
//! | 28 | 4 f32 | `orientation` |
//! | 44 | 21 × 3 f32 | `joints3d`; joint 14 is `position` |
//! | 296 | 21 u8 | `confidence` × 255 |
//! | 317 | 21 u8 | `joint_states`; two zeros |
//! | 340 | 16 × 4 i16 | `bone_rotations` × 32767 |

use crate::message::{Body, BodyFrame};

/// How a frame begins.
pub const MAGIC: &[u8; 4] = b"ECAP";
/// Version of the form.
pub const VERSION: u16 = 1;
/// Bytes before the camera's name.
pub const HEAD: usize = 128;
/// Bytes of a body.
pub const BODY: usize = 468;

/// Writes a frame.
pub fn encode(camera: &str, frame: &BodyFrame) -> Vec<u8> {
    let bodies = frame.bodies();
    let mut out = Vec::with_capacity(HEAD + camera.len() + 4 + bodies.len() * BODY);
    out.extend(MAGIC);
    out.extend(VERSION.to_le_bytes());
    out.extend((bodies.len() as u16).to_le_bytes());
    for n in [
        frame.sequence,
        frame.capture_ns,
        frame.pose_ns,
        frame.publish_ns,
    ] {
        out.extend(n.to_le_bytes());
    }
    let (i, t, world) = (frame.intrinsics, frame.stage_times, frame.world);
    words(&mut out, [frame.width, frame.height]);
    floats(&mut out, [i.fx, i.fy, i.cx, i.cy]);
    words(
        &mut out,
        [
            t.preprocess_us,
            t.stage1_us,
            t.association_us,
            t.stage2_us,
            frame.fit_us,
            frame.flags,
            frame.frame_total,
            world.state.code(),
        ],
    );
    floats(&mut out, world.rotation);
    floats(&mut out, world.translation);
    words(&mut out, [camera.len() as u32]);
    out.extend(camera.as_bytes());
    out.resize(out.len().next_multiple_of(4), 0);
    for body in bodies {
        encode_body(body, &mut out);
    }
    out
}

fn encode_body(body: &Body, out: &mut Vec<u8>) {
    words(out, [body.id]);
    out.extend([body.state.code().min(255) as u8, 0, 0, 0]);
    floats(out, [body.score, body.height]);
    floats(out, body.velocity);
    floats(out, body.orientation);
    floats(out, body.joints3d.into_iter().flatten());
    out.extend(body.confidence.map(|c| (c * 255.0).round() as u8));
    out.extend(body.joint_states.map(|s| s.code()));
    out.extend([0, 0]);
    for part in body.bone_rotations.into_iter().flatten() {
        out.extend(((part * 32767.0).round() as i16).to_le_bytes());
    }
}

fn words(out: &mut Vec<u8>, all: impl IntoIterator<Item = u32>) {
    for n in all {
        out.extend(n.to_le_bytes());
    }
}

fn floats(out: &mut Vec<u8>, all: impl IntoIterator<Item = f32>) {
    for n in all {
        out.extend(n.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_lies_where_the_table_says() {
        let mut frame = BodyFrame {
            sequence: 7,
            count: 2,
            fit_us: 99,
            ..BodyFrame::default()
        };
        frame.bodies[1].id = 12;
        frame.bodies[1].joints3d[14] = [1.0, 2.0, 3.5];
        frame.bodies[1].confidence[20] = 1.0;
        frame.bodies[1].bone_rotations[15] = [0.0, 0.0, -1.0, 0.5];
        let bytes = encode("hall7", &frame);
        assert_eq!(bytes.len(), HEAD + 8 + 2 * BODY);
        assert_eq!(bytes[8..16], 7u64.to_le_bytes());
        assert_eq!(bytes[80..84], 99u32.to_le_bytes());
        assert_eq!(&bytes[124..136], b"\x05\0\0\0hall7\0\0\0");
        let body = &bytes[HEAD + 8 + BODY..];
        assert_eq!(body[..4], 12u32.to_le_bytes());
        let pelvis = 44 + 14 * 12;
        assert_eq!(body[pelvis + 8..pelvis + 12], 3.5f32.to_le_bytes());
        assert_eq!(body[316], 255);
        assert_eq!(body[BODY - 4..BODY - 2], (-32767i16).to_le_bytes());
    }
}
