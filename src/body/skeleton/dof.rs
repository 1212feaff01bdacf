//! The 29 degrees of freedom of the skeleton, and which of their numbers is what.

use std::ops::Range;

use super::ANGLES;
use crate::joints::DOF;

/// A degree of freedom. Wherever there are [`DOF`] numbers of a pose, its steps, velocities and weights among them,
/// they come in this order: three of the root's position, three of its rotation, the joint angles.
///
/// Position and rotation are of the pelvis, in the axes that the pose is in: a camera's, or the world's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dof {
    /// The root's position along axis 0 to 2, metres.
    Position(usize),
    /// The root's rotation vector along axis 0 to 2, radians: a step of it turns the pose about the pose's axes, not
    /// about the pelvis' own.
    Rotation(usize),
    /// A joint angle, in the order of `models/skeleton.toml`, radians.
    Angle(usize),
}

impl Dof {
    /// Numbers of the root's position.
    pub const POSITION: Range<usize> = 0..3;
    /// Numbers of the root's rotation.
    pub const ROTATION: Range<usize> = 3..6;
    /// Numbers of all that the root has, which moves every joint.
    pub const ROOT: Range<usize> = 0..DOF - ANGLES;
    /// Numbers of the joint angles.
    pub const ANGLES: Range<usize> = DOF - ANGLES..DOF;

    /// The degree of freedom of this number, below [`DOF`].
    pub const fn of(number: usize) -> Self {
        match number {
            0..3 => Self::Position(number),
            3..6 => Self::Rotation(number - Self::ROTATION.start),
            _ => Self::Angle(number - Self::ANGLES.start),
        }
    }

    /// Its number.
    pub const fn number(self) -> usize {
        match self {
            Self::Position(axis) => axis,
            Self::Rotation(axis) => Self::ROTATION.start + axis,
            Self::Angle(angle) => Self::ANGLES.start + angle,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_of_one_degree_of_freedom() {
        for number in 0..DOF {
            let dof = Dof::of(number);
            assert_eq!(dof.number(), number);
            let range = match dof {
                Dof::Position(axis) if axis < 3 => Dof::POSITION,
                Dof::Rotation(axis) if axis < 3 => Dof::ROTATION,
                Dof::Angle(angle) if angle < ANGLES => Dof::ANGLES,
                other => panic!("{other:?} is none"),
            };
            assert!(range.contains(&number), "{dof:?}");
            assert_eq!(Dof::ROOT.contains(&number), !Dof::ANGLES.contains(&number));
        }
    }
}
