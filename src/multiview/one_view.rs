//! One view alone: the bodies of Stage III say who is who and where joints are in space; the mesh body is fitted to
//! these and to what the view saw.

use glam::{DVec2, DVec3};

use super::moment::{Lifted, Moment};
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

/// What a pinhole would have seen in a view's place: Stage III knows no other lens. Joints where the lens shows nothing
/// are not seen.
fn by_pinhole(view: &View, seen: &Observation) -> Observation {
    let joints2d = seen.joints2d.map(|[u, v, confidence]| {
        let pixel = DVec2::new(u.into(), v.into());
        if view.shown(pixel).is_none() {
            return [0.0; 3];
        }
        let [u, v] = view.by_pinhole(pixel).as_vec2().to_array();
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
                lifted: Some(Lifted {
                    joints: lifted,
                    confidence: body.confidence,
                }),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::{Pose, Posed, Skeleton};
    use crate::camera::Brown;
    use crate::fit::FitConfig;
    use crate::joints::{ANKLES, L_ANKLE, PELVIS, R_ANKLE};

    /// Ankles are told of beyond the fold of the lens, once surely and once not at all.
    #[test]
    fn joints_where_the_lens_shows_nothing_change_no_body() {
        // r·(1 − 0.3·r²) is 0.7027 at most.
        let view = View {
            size: [720, 1280],
            focal: DVec2::splat(640.0),
            centre: DVec2::new(359.5, 639.5),
            distortion: Brown {
                radial: [-0.3, 0.0, 0.0],
                tangential: [0.0; 2],
            },
            ..View::around(0.0)
        };
        let mut posed = Posed::default();
        let pose = Pose::facing_camera(2.2);
        Skeleton::builtin().pose(&pose, Skeleton::builtin().lengths(), &mut posed);
        let mut told = Observation {
            score: 0.95,
            joints3d: posed
                .joints
                .map(|p| (p - posed.joints[PELVIS]).as_vec3().to_array()),
            ..Observation::default()
        };
        let pixel = |plane: DVec2| {
            let pixel = view.distortion.distort(plane) * view.focal + view.centre;
            pixel.as_vec2().to_array()
        };
        for (out, p) in told.joints2d.iter_mut().zip(posed.joints) {
            let [u, v] = pixel(p.truncate() / p.z);
            *out = [u, v, 0.9];
        }
        for (ankle, x) in [(R_ANKLE, -0.3), (L_ANKLE, 0.3)] {
            let beyond = (view.centre + DVec2::new(x, 0.9) * view.focal).as_vec2();
            told.joints2d[ankle] = [beyond.x, beyond.y, 0.9];
        }
        let mut unseen = told;
        for ankle in ANKLES {
            unseen.joints2d[ankle] = [0.0; 3];
        }
        let bodies = [told, unseen].map(|seen| {
            let frames = vec![vec![seen]; 10];
            let times = (1..).map(|k| 33_000_000 * k);
            let mut fitter = Fitter::new(FitConfig::default()).unwrap();
            let each = times.zip(frames.iter().map(Vec::as_slice));
            stage_three(&mut fitter, &view, each)
        });
        assert_eq!(bodies[0][9].len(), 1, "somebody is found");
        assert_eq!(bodies[0], bodies[1]);
    }
}
