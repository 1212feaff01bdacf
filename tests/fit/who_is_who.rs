//! Detections that are somebody's until the others say where they are.

use edgecap::body::skeleton::{Pose, Posed, Skeleton};
use edgecap::camera::View;
use edgecap::joints::{EVIDENCE_JOINTS, MIRROR};
use edgecap::message::Observation;
use edgecap::multiview::{Detections, Sight, track};
use glam::DVec3;

use crate::scene::ring::views;

type Joints = [DVec3; EVIDENCE_JOINTS];

const ARMS: std::ops::RangeInclusive<usize> = 2..=7;
const FRAMES: usize = 12;

/// Somebody who hovers at this height, metres.
fn hovering(height: f64) -> Joints {
    let mut pose = Pose::facing_camera(4.2);
    pose.position.y = 0.5 - height;
    let (skeleton, mut posed) = (Skeleton::builtin(), Posed::default());
    skeleton.pose(&pose, skeleton.lengths(), &mut posed);
    std::array::from_fn(|j| posed.joints[j])
}

fn sight(view: &View, joints: &Joints) -> Sight {
    let mut seen = Observation::default();
    for (out, joint) in seen.joints2d.iter_mut().zip(joints) {
        let pixel = view.project(*joint).expect("in front");
        *out = [pixel.x as f32, pixel.y as f32, 0.9];
    }
    Sight::new(view, &seen)
}

/// What three views see of somebody who goes up and down by `step` metres: two of them as it is, the third, from the
/// second frame on, by where that was and is. The last frames show nobody.
fn scene(
    views: &[View],
    frames: usize,
    step: f64,
    third: &dyn Fn(f64, f64) -> Joints,
) -> Vec<Vec<Detections>> {
    let height = |f: usize| step * (f % 2) as f64;
    let all = (0..FRAMES).map(|f| {
        let one = |v: usize| match f {
            f if f >= frames => vec![],
            _ if v < 2 => vec![sight(&views[v], &hovering(height(f)))],
            0 => vec![],
            f => vec![sight(&views[v], &third(height(f - 1), height(f)))],
        };
        (0..views.len()).map(one).collect()
    });
    all.collect()
}

#[test]
fn a_view_that_is_about_somebody_else_proves_nobody() {
    let views = views(3);
    let agrees = scene(&views, 4, 0.3, &|_, now| hovering(now));
    assert_eq!(
        track(&views, &agrees, 30.0).len(),
        1,
        "three views and three frames"
    );
    // Near where the others were, far from where they are.
    let other = scene(&views, 4, 0.3, &|was, now| hovering(2.0 * was - now));
    assert_eq!(
        track(&views, &other, 30.0).len(),
        0,
        "two views and four frames"
    );
}

#[test]
fn limbs_of_a_view_that_is_left_out_are_not_healed() {
    let views = views(3);
    // Arms called by the other side's name where they were, all else further off.
    let other = |was: f64, now: f64| {
        let (arms, rest) = (hovering(was), hovering(was + 5.5 * (was - now)));
        std::array::from_fn(|j| match ARMS.contains(&j) {
            true => arms[MIRROR[j]],
            false => rest[j],
        })
    };
    let tracks = track(&views, &scene(&views, FRAMES, 0.1, &other), 30.0);
    assert_eq!(tracks.len(), 1);
    assert_eq!(tracks[0].moments.len(), FRAMES);
    for (frame, moment) in &tracks[0].moments {
        let seen = moment.sights.iter().flatten().count();
        assert_eq!((seen, moment.healed), (2, 0), "frame {frame}");
    }
}
