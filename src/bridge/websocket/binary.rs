//! The compact form of a frame, a sixth of the JSON: little-endian, every number at a fixed place, everything a
//! multiple of four.
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
//!
//! Events have a form of their own, built alike:
//!
//! | byte | type | what |
//! |---|---|---|
//! | 0 | 4 bytes | `EVNT` |
//! | 4 | u16, u16 | version of this form, 1; number of events |
//! | 8, 16, 24, 32 | u64 | `sequence`, `time_ns`, `publish_ns`, `first` |
//! | 40 | 3 u32 | `flags`, `present`, `main_person` |
//! | 52 | u32 | bytes of the camera's name, which follows, filled up with zeros to a multiple of four |
//! | then | 16 bytes each, and the zone's name | events |
//!
//! | byte of an event | type | what |
//! |---|---|---|
//! | 0 | u32, u32, f32 | `kind`, `person`, `seconds` |
//! | 12 | u8, u8 | `hand`; bytes of the zone's name, which follows the two zeros, filled up as above |
//!
//! A picture, where the user shows them:
//!
//! | byte | type | what |
//! |---|---|---|
//! | 0 | 4 bytes | `PICT` |
//! | 4 | u16, u16 | version of this form, 1; zero |
//! | 8, 16 | u64 | `sequence`, `capture_ns` |
//! | 24 | 2 u32 | pixels across and down |
//! | 32 | u32 | bytes of the camera's name, which follows, filled up as above |
//! | then | | JPEG |

use crate::message::{Body, BodyFrame, EventFrame, PictureFrame};

/// How a frame begins.
pub const MAGIC: &[u8; 4] = b"ECAP";
/// How events begin.
pub const EVENTS_MAGIC: &[u8; 4] = b"EVNT";
/// How a picture begins.
pub const PICTURE_MAGIC: &[u8; 4] = b"PICT";
/// Version of all forms.
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
    text(&mut out, camera);
    for body in bodies {
        encode_body(body, &mut out);
    }
    out
}

/// Writes what has happened.
pub fn encode_events(camera: &str, frame: &EventFrame) -> Vec<u8> {
    let events = frame.events();
    let mut out = Vec::with_capacity(HEAD + camera.len() + events.len() * 32);
    out.extend(EVENTS_MAGIC);
    out.extend(VERSION.to_le_bytes());
    out.extend((events.len() as u16).to_le_bytes());
    for n in [frame.sequence, frame.time_ns, frame.publish_ns, frame.first] {
        out.extend(n.to_le_bytes());
    }
    words(&mut out, [frame.flags, frame.present, frame.main_person]);
    words(&mut out, [camera.len() as u32]);
    text(&mut out, camera);
    for event in events {
        words(&mut out, [event.kind.code(), event.person]);
        floats(&mut out, [event.seconds]);
        let (hand, zone) = (event.hand.code().min(255) as u8, event.zone());
        out.extend([hand, zone.len() as u8, 0, 0]);
        text(&mut out, zone);
    }
    out
}

/// Writes a picture.
pub fn encode_picture(camera: &str, picture: &PictureFrame) -> Vec<u8> {
    let mut out = Vec::with_capacity(HEAD + camera.len() + picture.jpeg().len());
    out.extend(PICTURE_MAGIC);
    out.extend(VERSION.to_le_bytes());
    out.extend([0, 0]);
    out.extend(picture.sequence.to_le_bytes());
    out.extend(picture.capture_ns.to_le_bytes());
    words(&mut out, [picture.width, picture.height]);
    words(&mut out, [camera.len() as u32]);
    text(&mut out, camera);
    out.extend(picture.jpeg());
    out
}

/// A text, filled up with zeros to a multiple of four.
fn text(out: &mut Vec<u8>, text: &str) {
    out.extend(text.as_bytes());
    out.resize(out.len().next_multiple_of(4), 0);
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
    fn events_lie_where_their_table_says() {
        use crate::message::{Event, EventKind, Hand};
        let mut frame = EventFrame {
            sequence: 7,
            first: 40,
            present: 2,
            main_person: 5,
            count: 2,
            ..EventFrame::default()
        };
        frame.events[0] = Event {
            kind: EventKind::ZONE_LEFT,
            person: 3,
            seconds: 1.5,
            ..Event::default()
        };
        frame.events[0].set_zone("porch");
        (frame.events[1].kind, frame.events[1].hand) = (EventKind::WAVED, Hand::RIGHT);
        let bytes = encode_events("hall7", &frame);
        assert_eq!(&bytes[..8], b"EVNT\x01\0\x02\0");
        assert_eq!(bytes[8..16], 7u64.to_le_bytes());
        assert_eq!(bytes[32..40], 40u64.to_le_bytes());
        assert_eq!(bytes[44..52], [2, 0, 0, 0, 5, 0, 0, 0]);
        assert_eq!(&bytes[52..64], b"\x05\0\0\0hall7\0\0\0");
        assert_eq!(bytes[64..72], [4, 0, 0, 0, 3, 0, 0, 0]);
        assert_eq!(bytes[72..76], 1.5f32.to_le_bytes());
        assert_eq!(&bytes[76..88], b"\0\x05\0\0porch\0\0\0");
        assert_eq!(
            bytes[88..],
            [8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0]
        );
    }

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
