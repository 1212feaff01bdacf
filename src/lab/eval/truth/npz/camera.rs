//! The camera of an archive: from world to camera axes, and from there into the picture.

use super::table::Source;
use crate::lab::eval::EvalError;

/// Pose and intrinsics, one for all rows or one per row.
pub(super) struct Camera {
    /// Rotation and translation (metres) from world to camera.
    pose: Option<Vec<[[f64; 4]; 3]>>,
    /// Intrinsics, pixels.
    matrix: Option<Vec<[[f64; 3]; 3]>>,
}

impl Camera {
    /// Reads `camera_pose` and `camera_matrix` of `rows` rows; `metres` is the unit of the pose's translation.
    pub(super) fn read(
        source: &mut Source<'_>,
        rows: usize,
        metres: f64,
    ) -> Result<Self, EvalError> {
        let mut pose = matrices::<4>(source, "camera_pose", rows)?;
        for m in pose.iter_mut().flatten() {
            let rigid = (0..3).all(|i| {
                (0..3).all(|j| {
                    let dot: f64 = (0..3).map(|k| m[i][k] * m[j][k]).sum();
                    (dot - f64::from(u8::from(i == j))).abs() < 1e-3
                })
            });
            // A mirror has right angles, too.
            let is_finite = m.as_flattened().iter().all(|x| x.is_finite());
            if !(rigid && is_finite && determinant(m) > 0.0) {
                return Err(source.wrong(
                    "'camera_pose' to be a rotation and a translation, no mirror",
                    format!("{m:?}"),
                ));
            }
            m.iter_mut().for_each(|row| row[3] *= metres);
        }
        let matrix = matrices::<3>(source, "camera_matrix", rows)?;
        let odd = |m: &&[[f64; 3]; 3]| {
            let is_finite = m.as_flattened().iter().all(|x| x.is_finite());
            !is_finite || m[2] != [0.0, 0.0, 1.0] || m[0][0] <= 0.0 || m[1][1] <= 0.0
        };
        if let Some(m) = matrix.iter().flatten().find(odd) {
            return Err(source.wrong(
                "'camera_matrix' as [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], finite, fx and fy above 0",
                format!("{m:?}"),
            ));
        }
        Ok(Self { pose, matrix })
    }

    /// Whether the intrinsics are known.
    pub(super) fn projects(&self) -> bool {
        self.matrix.is_some()
    }

    /// A point of the archive in camera axes, metres.
    pub(super) fn place(&self, row: usize, at: [f64; 3]) -> [f64; 3] {
        let Some(pose) = &self.pose else { return at };
        let m = &pose[row.min(pose.len() - 1)];
        std::array::from_fn(|i| m[i][0] * at[0] + m[i][1] * at[1] + m[i][2] * at[2] + m[i][3])
    }

    /// Where a point in camera axes is seen, pixels; `None` behind the camera or without intrinsics.
    pub(super) fn project(&self, row: usize, [x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
        let all = self.matrix.as_ref()?;
        let m = &all[row.min(all.len() - 1)];
        let on = |r: [f64; 3]| r[0] * x / z + r[1] * y / z + r[2];
        (z > 0.0).then(|| [on(m[0]), on(m[1])])
    }
}

/// Determinant of the first three columns: 1 for a rotation, −1 for a mirror.
fn determinant(m: &[[f64; 4]; 3]) -> f64 {
    let [[a, b, c, _], [d, e, f, _], [g, h, i, _]] = *m;
    a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
}

/// An array of 3×C matrices, one for all rows or one per row.
fn matrices<const C: usize>(
    source: &mut Source<'_>,
    key: &str,
    rows: usize,
) -> Result<Option<Vec<[[f64; C]; 3]>>, EvalError> {
    let Some(numbers) = source.numbers(key)? else {
        return Ok(None);
    };
    if numbers.shape != [3, C] && numbers.shape != [rows, 3, C] {
        return Err(source.wrong(
            format!("'{key}' of shape [3, {C}] or [{rows}, 3, {C}]"),
            format!("{:?}", numbers.shape),
        ));
    }
    let matrix = |m: &[f64]| std::array::from_fn(|i| std::array::from_fn(|j| m[i * C + j]));
    Ok(Some(numbers.data.chunks_exact(3 * C).map(matrix).collect()))
}
