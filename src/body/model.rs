//! What a body model is to a solver: a tree of bones, parameters, kinematics, Jacobians.

use glam::DVec3;

/// An articulated body with a fixed tree of bones.
pub trait BodyModel {
    /// The parameters of a posture, without what stays a person's own.
    type Pose: Copy;
    /// What stays a person's own: bone lengths, shape coefficients.
    type Shape;
    /// What forward kinematics makes of both.
    type Posed;

    /// The pose with all angles 0, at the origin. How its root is turned is the model's own.
    fn rest_pose(&self) -> Self::Pose;
    /// `pose` moved by a step: metres and radians, rotations of the root as a rotation vector in camera axes.
    fn moved(&self, pose: &Self::Pose, step: &[f64]) -> Self::Pose;
    /// Forward kinematics.
    fn kinematics(&self, pose: &Self::Pose, shape: &Self::Shape, out: &mut Self::Posed);
    /// Calls `column` with every degree of freedom that moves a joint, in rising order, and the joint's derivative by
    /// it: metres per metre or radian.
    fn jacobian(&self, posed: &Self::Posed, joint: usize, column: impl FnMut(usize, DVec3));
    /// The order in which a solver eliminates the degrees of freedom, and what stays zero.
    fn elimination(&self) -> &Elimination;
}

/// An order of elimination: ends of limbs first, so that the factor of the normal matrix stays as sparse as the matrix.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Elimination {
    row: Vec<usize>,
    first: Vec<usize>,
}

impl Elimination {
    /// The last degree of freedom first. `together` names, joint by joint, the degrees of freedom that move it: two
    /// that move no joint together do not meet in the normal matrix. In a tree whose parameters are numbered from the
    /// root outwards the factor then has no entry that the matrix has not.
    pub fn from_the_last<'a>(size: usize, together: impl Iterator<Item = &'a [usize]>) -> Self {
        let row: Vec<usize> = (0..size).map(|d| size - 1 - d).collect();
        let mut first: Vec<usize> = (0..size).collect();
        for all in together {
            let Some(least) = all.iter().map(|&d| row[d]).min() else {
                continue;
            };
            for &d in all {
                first[row[d]] = first[row[d]].min(least);
            }
        }
        Self { row, first }
    }

    /// Row of every degree of freedom.
    pub fn rows(&self) -> &[usize] {
        &self.row
    }

    /// First column of every row of the lower triangle that may differ from zero.
    pub fn envelope(&self) -> &[usize] {
        &self.first
    }
}
