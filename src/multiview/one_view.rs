//! One view alone: the bodies of Stage III say who is who and where joints are in space; the mesh body is fitted to these and to
//! what the view saw.

use glam::DVec3;

use super::people::{Detections, Track, nearest_sight};
use super::stage_one::Moment;
use crate::camera::View;
use crate::joints::EVIDENCE_JOINTS;
use crate::message::{Body, BodyState};

/// People of Stage III over time, as the fit wants them. `bodies` and `seen` are by frame; bodies in camera axes, metres.
pub fn one_view(view: &View, bodies: &[Vec<Body>], seen: &[Detections]) -> Vec<Track> {
    let mut tracks: Vec<Track> = Vec::new();
    for (frame, (bodies, seen)) in bodies.iter().zip(seen).enumerate() {
        for body in bodies.iter().filter(|b| b.state == BodyState::TRACKED) {
            let joints: [DVec3; EVIDENCE_JOINTS] = std::array::from_fn(|j| {
                let p = DVec3::from(body.joints3d[j].map(f64::from));
                view.position + view.rotation.transpose() * p
            });
            let moment = Moment {
                sights: vec![nearest_sight(view, seen, &joints)],
                joints: joints.map(Some),
                healed: 0,
                lifted: true,
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
