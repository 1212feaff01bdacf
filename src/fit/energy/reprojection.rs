//! In: a joint in camera axes, and where a picture shows it. Out: how far they are apart at the person's distance, and
//! how that changes with the joint. The term E2D of XNect §5.2, of one camera or of each of several.

use glam::{DVec2, DVec3};

/// Joints nearer to the camera than this (metres) have no useful projection.
pub const MIN_DEPTH: f64 = 0.2;

/// Metres at a distance of `depth` (metres) between a joint and where it was seen on the plane z = 1; `None` where it
/// has no projection.
pub fn residual(joint: DVec3, seen: DVec2, depth: f64) -> Option<DVec2> {
    (joint.z > MIN_DEPTH).then(|| (joint.truncate() / joint.z - seen) * depth)
}

/// Derivatives of both numbers of the [`residual`] by the joint, metres per metre, camera axes.
pub fn rows(joint: DVec3, depth: f64) -> [DVec3; 2] {
    let s = depth / joint.z;
    [
        DVec3::new(s, 0.0, -s * joint.x / joint.z),
        DVec3::new(0.0, s, -s * joint.y / joint.z),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_match_finite_differences() {
        let (joint, seen, depth) = (DVec3::new(0.4, -0.7, 2.5), DVec2::new(0.1, 0.2), 3.0);
        let at = |joint: DVec3| residual(joint, seen, depth).unwrap();
        for axis in DVec3::AXES {
            let h = 1e-6;
            let numeric = (at(joint + h * axis) - at(joint - h * axis)) / (2.0 * h);
            let analytic = rows(joint, depth).map(|row| row.dot(axis));
            assert!(
                numeric.distance(DVec2::from(analytic)) < 1e-6,
                "{axis}: {numeric} {analytic:?}"
            );
        }
        assert_eq!(residual(joint.with_z(MIN_DEPTH), seen, depth), None);
    }
}
