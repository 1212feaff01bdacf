//! In which order public sets list the joints of a person.

use clap::ValueEnum;
use edgecap_client::joints::{
    HEAD, HEAD_TOP, L_ANKLE, L_ELBOW, L_FOOT_TIP, L_HAND, L_HIP, L_KNEE, L_SHOULDER, L_WRIST, NECK,
    PELVIS, R_ANKLE, R_ELBOW, R_FOOT_TIP, R_HAND, R_HIP, R_KNEE, R_SHOULDER, R_WRIST, SPINE,
};
use serde::Deserialize;

/// A public joint order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, clap::ValueEnum)]
pub enum JointOrder {
    /// Human3.6M: 17 joints from the pelvis (index 0) over the legs to the arms, or the 32 of its motion capture.
    #[value(name = "h36m")]
    #[serde(rename = "h36m")]
    H36m,
    /// MPI-INF-3DHP and MuPoTS-3D: the 17 of the test sets from the head top (index 0) to the head, or all 28.
    #[value(name = "mpi-inf-3dhp", alias = "mpi_inf_3dhp")]
    #[serde(rename = "mpi_inf_3dhp")]
    MpiInf3dhp,
    /// SMPL, and so 3DPW: 24 joints of the body model's skeleton, from the pelvis (index 0) to the hands.
    #[value(name = "smpl")]
    #[serde(rename = "smpl")]
    Smpl,
    /// SPIN's own 24, in which it exports Human3.6M and MPI-INF-3DHP: from the right ankle (index 0) to the right ear.
    #[value(name = "spin")]
    #[serde(rename = "spin")]
    Spin,
}

/// pelvis, right leg, left leg, spine, thorax, nose, head top, left arm, right arm; the nose is none of ours.
const H36M_17: [Option<usize>; 17] = [
    Some(PELVIS),
    Some(R_HIP),
    Some(R_KNEE),
    Some(R_ANKLE),
    Some(L_HIP),
    Some(L_KNEE),
    Some(L_ANKLE),
    Some(SPINE),
    Some(NECK),
    None,
    Some(HEAD_TOP),
    Some(L_SHOULDER),
    Some(L_ELBOW),
    Some(L_WRIST),
    Some(R_SHOULDER),
    Some(R_ELBOW),
    Some(R_WRIST),
];

/// Those of Human3.6M's 32 joints that move, which are its 17.
const H36M_MOVING: [usize; 17] = [0, 1, 2, 3, 6, 7, 8, 12, 13, 14, 15, 17, 18, 19, 25, 26, 27];

/// Of all 28: the upper spine, neck, head, head top, left and right arm with collarbone and hand, left and right leg
/// with foot (the ball, none of ours) and toe.
const DHP_28: [Option<usize>; 28] = [
    None,
    None,
    None,
    Some(SPINE),
    Some(PELVIS),
    Some(NECK),
    Some(HEAD),
    Some(HEAD_TOP),
    None,
    Some(L_SHOULDER),
    Some(L_ELBOW),
    Some(L_WRIST),
    Some(L_HAND),
    None,
    Some(R_SHOULDER),
    Some(R_ELBOW),
    Some(R_WRIST),
    Some(R_HAND),
    Some(L_HIP),
    Some(L_KNEE),
    Some(L_ANKLE),
    None,
    Some(L_FOOT_TIP),
    Some(R_HIP),
    Some(R_KNEE),
    Some(R_ANKLE),
    None,
    Some(R_FOOT_TIP),
];

/// pelvis, hips, spine, knees, spine, ankles, spine, feet, neck, collarbones, head, shoulders, elbows, wrists, hands.
/// SMPL's spine, head, feet and hands lie elsewhere than ours, and it has no head top.
const SMPL_24: [Option<usize>; 24] = [
    Some(PELVIS),
    Some(L_HIP),
    Some(R_HIP),
    None,
    Some(L_KNEE),
    Some(R_KNEE),
    None,
    Some(L_ANKLE),
    Some(R_ANKLE),
    None,
    None,
    None,
    Some(NECK),
    None,
    None,
    None,
    Some(L_SHOULDER),
    Some(R_SHOULDER),
    Some(L_ELBOW),
    Some(R_ELBOW),
    Some(L_WRIST),
    Some(R_WRIST),
    None,
    None,
];

/// The second half of SPIN's `JOINT_NAMES`: right leg upwards, left leg downwards, right arm upwards, left arm
/// downwards, neck, the head's top of photos, pelvis, thorax, spine, jaw, the head's top of sets in 3D, face. No set
/// has both tops; the jaw is Human3.6M's nose and MPI-INF-3DHP's head, so that it is none of ours.
const SPIN_24: [Option<usize>; 24] = [
    Some(R_ANKLE),
    Some(R_KNEE),
    Some(R_HIP),
    Some(L_HIP),
    Some(L_KNEE),
    Some(L_ANKLE),
    Some(R_WRIST),
    Some(R_ELBOW),
    Some(R_SHOULDER),
    Some(L_SHOULDER),
    Some(L_ELBOW),
    Some(L_WRIST),
    Some(NECK),
    None,
    Some(PELVIS),
    None,
    Some(SPINE),
    None,
    Some(HEAD_TOP),
    None,
    None,
    None,
    None,
    None,
];

impl JointOrder {
    /// The body joint that each of `count` joints is, `None` for those that are none of ours; `None` when the order
    /// does not come with so many.
    pub fn body_joints(self, count: usize) -> Option<Vec<Option<usize>>> {
        match (self, count) {
            (Self::H36m, 17) => Some(H36M_17.to_vec()),
            (Self::H36m, 32) => {
                let mut all = vec![None; 32];
                for (moving, joint) in H36M_MOVING.into_iter().zip(H36M_17) {
                    all[moving] = joint;
                }
                Some(all)
            }
            // The first 17 of ours are in this order.
            (Self::MpiInf3dhp, 17) => Some((0..17).map(Some).collect()),
            (Self::MpiInf3dhp, 28) => Some(DHP_28.to_vec()),
            (Self::Smpl, 24) => Some(SMPL_24.to_vec()),
            (Self::Spin, 24) => Some(SPIN_24.to_vec()),
            _ => None,
        }
    }

    /// The orders that come with so many joints.
    pub fn of_count(count: usize) -> Vec<Self> {
        let all = Self::value_variants().iter().copied();
        all.filter(|order| order.body_joints(count).is_some())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use edgecap_client::joints::JOINT_NAMES;

    use super::*;

    /// MPI-INF-3DHP's own names of its 28 joints, in its words for ours.
    const NAMES: [&str; 28] = [
        "spine3",
        "spine4",
        "spine2",
        "spine",
        "pelvis",
        "neck",
        "head",
        "head_top",
        "l_clavicle",
        "l_shoulder",
        "l_elbow",
        "l_wrist",
        "l_hand",
        "r_clavicle",
        "r_shoulder",
        "r_elbow",
        "r_wrist",
        "r_hand",
        "l_hip",
        "l_knee",
        "l_ankle",
        "l_foot",
        "l_foot_tip",
        "r_hip",
        "r_knee",
        "r_ankle",
        "r_foot",
        "r_foot_tip",
    ];

    #[test]
    fn the_28_joints_go_by_their_names() {
        let map = JointOrder::MpiInf3dhp.body_joints(28).unwrap();
        for (name, joint) in NAMES.iter().zip(map) {
            let ours = JOINT_NAMES.iter().position(|n| n == name);
            assert_eq!(joint, ours, "{name}");
        }
    }

    #[test]
    fn the_test_set_is_the_named_selection_of_the_28() {
        // `mpii_get_joints('relevant')` of the data set's own tools, from 1.
        let relevant = [
            8, 6, 15, 16, 17, 10, 11, 12, 24, 25, 26, 19, 20, 21, 5, 4, 7,
        ];
        let all = JointOrder::MpiInf3dhp.body_joints(28).unwrap();
        let chosen: Vec<_> = relevant.iter().map(|&k| all[k - 1]).collect();
        assert_eq!(JointOrder::MpiInf3dhp.body_joints(17), Some(chosen));
    }

    /// SMPL's own names of its joints, those that are ours in our words.
    const SMPL_NAMES: [&str; 24] = [
        "pelvis",
        "l_hip",
        "r_hip",
        "spine1",
        "l_knee",
        "r_knee",
        "spine2",
        "l_ankle",
        "r_ankle",
        "spine3",
        "l_foot",
        "r_foot",
        "neck",
        "l_collar",
        "r_collar",
        "skull",
        "l_shoulder",
        "r_shoulder",
        "l_elbow",
        "r_elbow",
        "l_wrist",
        "r_wrist",
        "l_palm",
        "r_palm",
    ];

    #[test]
    fn smpl_s_joints_go_by_their_names() {
        let map = JointOrder::Smpl.body_joints(24).unwrap();
        for (name, joint) in SMPL_NAMES.iter().zip(&map) {
            let ours = JOINT_NAMES.iter().position(|n| n == name);
            assert_eq!(*joint, ours, "{name}");
        }
        assert_eq!(map.iter().flatten().count(), 14);
    }

    #[test]
    fn spin_s_joints_are_where_its_converters_put_them() {
        let spin = JointOrder::Spin.body_joints(24).unwrap();
        assert_eq!(spin.iter().flatten().count(), 16);
        // Where each of the 17 joints goes, of both sets in Human3.6M's order: `global_idx` and `joints_idx` there.
        let to = [14, 3, 4, 5, 2, 1, 0, 16, 12, 17, 18, 9, 10, 11, 8, 7, 6];
        // Human3.6M's 17 there begin with the left leg.
        let human = JointOrder::H36m.body_joints(17).unwrap();
        let human = [0, 4, 5, 6, 1, 2, 3, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16].map(|k| human[k]);
        // `joints17_idx` of MPI-INF-3DHP's test set, and of its 28.
        let test = JointOrder::MpiInf3dhp.body_joints(17).unwrap();
        let test = [14, 11, 12, 13, 8, 9, 10, 15, 1, 16, 0, 5, 6, 7, 2, 3, 4].map(|k| test[k]);
        let training = JointOrder::MpiInf3dhp.body_joints(28).unwrap();
        let training =
            [4, 18, 19, 20, 23, 24, 25, 3, 5, 6, 7, 9, 10, 11, 14, 15, 16].map(|k| training[k]);
        for (set, joints) in [("h36m", human), ("test", test), ("training", training)] {
            for (place, joint) in to.into_iter().zip(joints) {
                // Each calls another joint the jaw.
                let wanted = joint.filter(|_| place != 17);
                assert_eq!(spin[place], wanted, "{set}, place {place}");
            }
        }
    }

    #[test]
    fn a_count_tells_the_order_where_only_one_comes_with_it() {
        for (count, orders) in [
            (16, &[][..]),
            (17, &[JointOrder::H36m, JointOrder::MpiInf3dhp]),
            (24, &[JointOrder::Smpl, JointOrder::Spin]),
            (28, &[JointOrder::MpiInf3dhp]),
            (32, &[JointOrder::H36m]),
        ] {
            assert_eq!(JointOrder::of_count(count), orders, "{count}");
        }
    }

    #[test]
    fn every_order_names_every_joint_once() {
        let orders = [
            (JointOrder::H36m, 17),
            (JointOrder::H36m, 32),
            (JointOrder::MpiInf3dhp, 17),
            (JointOrder::MpiInf3dhp, 28),
            (JointOrder::Spin, 24),
        ];
        for (order, count) in orders {
            let map = order.body_joints(count).unwrap();
            assert_eq!(map.len(), count);
            let mut joints: Vec<usize> = map.into_iter().flatten().collect();
            joints.sort_unstable();
            let before = joints.len();
            joints.dedup();
            assert_eq!(joints.len(), before, "{order:?} {count}");
            assert!(joints.starts_with(&[0, 1, 2]) && joints.contains(&14));
        }
        assert_eq!(JointOrder::H36m.body_joints(28), None);
    }
}
