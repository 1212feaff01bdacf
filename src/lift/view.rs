//! View-aligned axes to camera axes.

/// Rotation matrix, row-major, from view-aligned axes (z along the ray through the neck) to camera axes: the least
/// rotation that takes +z to `ray`, a unit vector with positive z.
///
/// A convolution sees a person's surroundings but not where in the frame they stand, so Stage I and Stage II speak in
/// axes that turn with the ray; this turns them back.
pub(crate) fn to_camera(ray: [f32; 3]) -> [[f32; 3]; 3] {
    let [x, y, z] = ray;
    let s = (1.0 + z).recip();
    [
        [1.0 - x * x * s, -x * y * s, x],
        [-x * y * s, 1.0 - y * y * s, y],
        [-x, -y, z],
    ]
}

/// Matrix times vector.
pub(crate) fn rotate(m: &[[f32; 3]; 3], p: [f32; 3]) -> [f32; 3] {
    m.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: [f32; 3], b: [f32; 3]) {
        let d = a.iter().zip(b).map(|(a, b)| (a - b).abs());
        assert!(d.fold(0.0, f32::max) < 1e-6, "{a:?} {b:?}");
    }

    #[test]
    fn z_becomes_the_ray_and_the_axis_of_the_turn_stays() {
        for ray in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.48, 0.6, 0.64]] {
            let m = to_camera(ray);
            close(rotate(&m, [0.0, 0.0, 1.0]), ray);
            // The least rotation turns about z × ray.
            let axis = [-ray[1], ray[0], 0.0];
            close(rotate(&m, axis), axis);
        }
    }

    #[test]
    fn lengths_and_handedness_are_kept() {
        let m = to_camera([-0.48, 0.6, 0.64]);
        let column = |i: usize| [m[0][i], m[1][i], m[2][i]];
        let (a, b, c) = (column(0), column(1), column(2));
        let cross = [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ];
        close(cross, c);
        let dot = |p: [f32; 3], q: [f32; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
        assert!((dot(a, a) - 1.0).abs() < 1e-6 && dot(a, b).abs() < 1e-6);
    }
}
