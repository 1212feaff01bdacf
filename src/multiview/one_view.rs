//! One view alone: the bodies of Stage III say who is who and where joints are in space; the mesh body is fitted to
//! these and to what the view saw.

use glam::{DVec2, DVec3};

use super::moment::Moment;
use super::people::{Detections, Track, nearest_sight};
use crate::camera::View;
use crate::fit::Fitter;
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use crate::message::{Body, BodyFrame, BodyState, MAX_PEOPLE, Observation, ObservationFrame};

/// Stage III's bodies by frame, of when a view saw whom, nanoseconds, rising; camera axes, metres.
pub fn stage_three<'a>(
    fitter: &mut Fitter,
    view: &View,
    frames: impl Iterator<Item = (u64, &'a [Observation])>,
) -> Vec<Vec<Body>> {
    let mut frame = Box::new(ObservationFrame {
        width: view.size[0],
        height: view.size[1],
        intrinsics: view.intrinsics(),
        ..ObservationFrame::default()
    });
    let mut out = Box::new(BodyFrame::default());
    let each = frames.zip(0..).map(|((time, people), number)| {
        (frame.capture_ns, frame.sequence) = (time, number);
        frame.count = people.len().min(MAX_PEOPLE) as u32;
        for (own, seen) in frame.people.iter_mut().zip(people) {
            *own = by_pinhole(view, seen);
        }
        fitter.update(&frame, &mut out);
        out.bodies().to_vec()
    });
    each.collect()
}

/// What a pinhole would have seen in a view's place: Stage III knows no other lens.
fn by_pinhole(view: &View, seen: &Observation) -> Observation {
    let joints2d = seen.joints2d.map(|[u, v, confidence]| {
        let pixel = view.by_pinhole(DVec2::new(u.into(), v.into()));
        let [u, v] = pixel.as_vec2().to_array();
        [u, v, confidence]
    });
    Observation { joints2d, ..*seen }
}

/// People of Stage III over time, as the fit wants them. `bodies` and `seen` are by frame; bodies in camera axes,
/// metres.
pub fn one_view(view: &View, bodies: &[Vec<Body>], seen: &[Detections]) -> Vec<Track> {
    let mut tracks: Vec<Track> = Vec::new();
    for (frame, (bodies, seen)) in bodies.iter().zip(seen).enumerate() {
        for body in bodies.iter().filter(|b| b.state == BodyState::TRACKED) {
            let lifted: [DVec3; BODY_JOINTS] = std::array::from_fn(|j| {
                let p = DVec3::from(body.joints3d[j].map(f64::from));
                view.position + view.rotation.transpose() * p
            });
            let joints: [DVec3; EVIDENCE_JOINTS] = std::array::from_fn(|j| lifted[j]);
            let moment = Moment {
                sights: vec![nearest_sight(view, seen, &joints)],
                joints: joints.map(Some),
                healed: 0,
                lifted: Some(lifted),
                contours: Vec::new(),
            };
            match tracks.iter_mut().find(|t| t.id == body.id) {
                Some(track) => track.moments.push((frame, moment)),
                None => tracks.push(Track {
                    id: body.id,
                    moments: vec![(frame, moment)],
                }),
            }
        }
    }
    tracks
}
