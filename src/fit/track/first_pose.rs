//! In: evidence of a person nobody knows yet. Out: a first pose, in closed form. XNect §5.2: first the angles from 3D,
//! then the root from 2D; the full energy follows.

use glam::{DMat3, DQuat, DVec3};

use crate::body::skeleton::{ANGLES, Pose, Posed, Skeleton};
use crate::body::skeleton::{LIMBS, Limb};
use crate::joints::{BODY_JOINTS, L_HIP, L_SHOULDER, NECK, PARENTS, R_HIP, R_SHOULDER};

/// A first pose from joints relative to the pelvis at `position`; `None` where the torso has no orientation.
pub fn first_pose(
    skeleton: &Skeleton,
    position: DVec3,
    points: &[DVec3; BODY_JOINTS],
) -> Option<Pose> {
    let mut pose = Pose {
        position,
        rotation: torso_rotation(points)?,
        angles: [0.0; ANGLES],
    };
    let mut posed = Posed::default();
    skeleton.pose(&pose, skeleton.lengths(), &mut posed);
    for limb in LIMBS {
        if let Some(angles) = best_branch(skeleton, limb, &posed, points, &pose.angles) {
            for (k, angle) in limb.angles(skeleton).into_iter().zip(angles) {
                pose.angles[k] = angle;
            }
        }
    }
    pose.is_finite().then_some(pose)
}

/// The branch of a limb's closed form that strains its limits least.
pub fn best_branch(
    skeleton: &Skeleton,
    limb: Limb,
    posed: &Posed,
    points: &[DVec3; BODY_JOINTS],
    current: &[f64; ANGLES],
) -> Option<[f64; 4]> {
    let trunk = posed.frames[PARENTS[limb.middle]];
    let (upper, lower) = limb.bones(points);
    let branches = limb.solve(skeleton, trunk, upper, lower, current)?;
    let strain = |angles: &[f64; 4]| -> f64 {
        limb.angles(skeleton)
            .into_iter()
            .zip(angles)
            .map(|(k, a)| {
                let beyond = skeleton.angles()[k].beyond(*a);
                beyond * beyond + 1e-3 * (a - current[k]).powi(2)
            })
            .sum()
    };
    let [a, b] = branches;
    Some(if strain(&a) <= strain(&b) { a } else { b })
}

/// Rotation of the trunk: x along hips and shoulders to the left, y from pelvis to neck.
fn torso_rotation(points: &[DVec3; BODY_JOINTS]) -> Option<DQuat> {
    let y = points[NECK].try_normalize()?;
    let across = (points[L_HIP] - points[R_HIP]) + 0.5 * (points[L_SHOULDER] - points[R_SHOULDER]);
    let x = (across - y * across.dot(y)).try_normalize()?;
    let q = DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y)));
    q.is_finite().then(|| q.normalize())
}
