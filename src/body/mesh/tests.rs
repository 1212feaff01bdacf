//! The mesh body against NumPy, against finite differences, and against files that are none.

use std::io::Cursor;

use glam::{DQuat, DVec3, Vec3};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

use super::*;
use crate::body::model::BodyModel;
use crate::npz::{Archive, Array, Values, write};

static REFERENCE: &[u8] = include_bytes!("../../../tests/reference/mesh_body.npz");

fn random_pose(rng: &mut SmallRng) -> MeshPose {
    let mut draw = || DVec3::from_array(std::array::from_fn(|_| rng.random_range(-0.6..0.6)));
    MeshPose {
        pelvis: draw() + 3.0 * DVec3::Z,
        rotations: std::array::from_fn(|_| DQuat::from_scaled_axis(draw())),
    }
}

fn posed(body: &MeshBody, pose: &MeshPose, person: &Person) -> PosedTree {
    let mut tree = PosedTree::default();
    body.kinematics(pose, person, &mut tree);
    tree
}

/// Made by `models/body/tests/reference.py`.
#[test]
fn agrees_with_numpy() {
    let body = MeshBody::shipped();
    let mut file = Archive::new(Cursor::new(REFERENCE)).unwrap();
    let mut get = |name: &str| file.numbers(name).unwrap().unwrap().data;
    let (beta, theta, pelvis) = (get("beta"), get("theta"), get("pelvis"));
    let (chosen, vertices, joints) = (get("chosen"), get("vertices"), get("joints"));
    let width = body.components();
    let mut worst = (0.0f64, 0.0f64);
    for case in 0..3 {
        let person = body.person(&beta[case * width..][..width]);
        let pose = MeshPose {
            pelvis: DVec3::from_slice(&pelvis[3 * case..]),
            rotations: std::array::from_fn(|j| {
                DQuat::from_scaled_axis(DVec3::from_slice(&theta[72 * case + 3 * j..]))
            }),
        };
        let tree = posed(body, &pose, &person);
        for (j, place) in tree.joints().iter().enumerate() {
            worst.0 = worst
                .0
                .max(place.distance(DVec3::from_slice(&joints[72 * case + 3 * j..])));
        }
        let mut out = Vec::new();
        Skin::new(body, &person).pose(body, &pose, &tree, &mut out);
        assert_eq!(out.len(), body.vertices());
        for (k, &v) in chosen.iter().enumerate() {
            let truth = DVec3::from_slice(&vertices[3 * (case * chosen.len() + k)..]);
            worst.1 = worst.1.max(out[v as usize].as_dvec3().distance(truth));
        }
    }
    assert!(worst.0 < 1e-6, "joints are {} m off", worst.0);
    assert!(worst.1 < 1e-5, "vertices are {} m off", worst.1);
}

#[test]
fn jacobians_agree_with_finite_differences() {
    let body = MeshBody::shipped();
    let mut rng = SmallRng::seed_from_u64(4);
    let person = body.person(&[0.8, -1.2, 0.4, 1.5]);
    let pose = random_pose(&mut rng);
    let tree = posed(body, &pose, &person);
    let h = 1e-5;
    let mut analytic = vec![[DVec3::ZERO; JOINTS + REPORTED]; FREEDOM];
    (0..JOINTS).for_each(|j| body.jacobian(&tree, j, |d, v| analytic[d][j] = v));
    (0..REPORTED).for_each(|j| {
        body.reported_jacobian(&tree, j, |d, v| analytic[d][JOINTS + j] = v);
    });
    for (d, columns) in analytic.iter().enumerate() {
        let at = |by: f64| {
            let mut step = [0.0; FREEDOM];
            step[d] = by;
            posed(body, &body.moved(&pose, &step), &person)
        };
        let (ahead, behind) = (at(h), at(-h));
        let point = |t: &PosedTree, j: usize| {
            if j < JOINTS {
                t.joints()[j]
            } else {
                t.reported()[j - JOINTS]
            }
        };
        for (j, column) in columns.iter().enumerate() {
            let slope = (point(&ahead, j) - point(&behind, j)) / (2.0 * h);
            assert!(
                (slope - *column).length() < 1e-6,
                "freedom {d}, joint {j}: {slope} and {column}"
            );
        }
    }
    for component in 0..4 {
        let at = |by: f64| {
            let mut betas = person.betas().to_vec();
            betas[component] += by;
            posed(body, &pose, &body.person(&betas))
        };
        let (ahead, behind) = (at(h), at(-h));
        for j in 0..JOINTS {
            let slope = (ahead.joints()[j] - behind.joints()[j]) / (2.0 * h);
            assert!((slope - body.joint_by_shape(&tree, j, component)).length() < 1e-6);
        }
        for j in 0..REPORTED {
            let slope = (ahead.reported()[j] - behind.reported()[j]) / (2.0 * h);
            assert!((slope - body.reported_by_shape(&tree, j, component)).length() < 1e-6);
        }
    }
}

/// Files of others tell nothing of edgecap's joints: the head's top is on their mesh.
#[test]
fn a_body_that_does_not_tell_its_head_s_top_has_it_on_its_mesh() {
    let mut file = Archive::new(Cursor::new(SHIPPED)).unwrap();
    let names = [
        "v_template",
        "f",
        "shapedirs",
        "weights",
        "J_regressor",
        "kintree_table",
    ];
    let stripped: Vec<_> = names
        .iter()
        .flat_map(|name| [(*name).to_owned(), format!("{name}_unit")])
        .filter_map(|name| Some((file.numbers(&name).unwrap()?, name)))
        .collect();
    let data: Vec<Vec<f32>> = stripped
        .iter()
        .map(|(array, _)| array.data.iter().map(|x| *x as f32).collect())
        .collect();
    let arrays: Vec<Array<'_>> = stripped
        .iter()
        .zip(&data)
        .map(|((array, name), data)| Array {
            name,
            shape: &array.shape,
            data: Values::F32(data),
        })
        .collect();
    let (own, other) = (MeshBody::shipped(), read(write(&arrays).unwrap()).unwrap());
    let mut rng = SmallRng::seed_from_u64(5);
    for _ in 0..5 {
        let pose = random_pose(&mut rng);
        let betas: [f64; 10] = std::array::from_fn(|_| rng.random_range(-1.5..1.5));
        let [own, other] = [own, &other].map(|body| posed(body, &pose, &body.person(&betas)));
        let off = own.reported()[0].distance(other.reported()[0]);
        assert!(off < 1e-3, "{off} m");
        for (j, carrier) in kinematics::CARRIERS.into_iter().enumerate().skip(1) {
            let off = other.reported()[j].distance(other.joints()[carrier]);
            assert!(off < 1e-9, "joint {j}: {off} m");
        }
    }
}

#[test]
fn columns_come_in_rising_order_and_are_those_of_the_elimination() {
    let body = MeshBody::shipped();
    let tree = posed(body, &body.rest_pose(), &body.person(&[]));
    let mut together = vec![[false; FREEDOM]; FREEDOM];
    for joint in 0..JOINTS {
        let mut seen = Vec::new();
        body.jacobian(&tree, joint, |d, _| seen.push(d));
        assert_eq!(seen, kinematics::moved_by(joint));
        assert!(seen.is_sorted());
        for a in &seen {
            seen.iter().for_each(|b| together[*a][*b] = true);
        }
    }
    let (rows, envelope) = (body.elimination().rows(), body.elimination().envelope());
    let mut sorted = rows.to_vec();
    sorted.sort_unstable();
    assert!(sorted.into_iter().eq(0..FREEDOM), "every row once");
    for (d, (meets, &row)) in together.iter().zip(rows).enumerate() {
        // The first column in which it meets another of the same joint; one that moves no joint meets itself alone.
        let columns = rows.iter().zip(meets).filter(|(_, meets)| **meets);
        let first = columns.fold(row, |first, (column, _)| first.min(*column));
        assert_eq!(envelope[row], first, "freedom {d}");
    }
}

#[test]
fn at_rest_the_body_stands_upright_before_the_camera() {
    let body = MeshBody::shipped();
    let tree = posed(body, &body.rest_pose(), &body.person(&[]));
    let reported = tree.reported();
    let at = |name| {
        reported[crate::joints::JOINT_NAMES
            .iter()
            .position(|n| *n == name)
            .unwrap()]
    };
    assert!(at("head_top").y < -0.6, "y is down: {}", at("head_top"));
    assert!(at("l_ankle").y > 0.7);
    assert!(
        at("l_shoulder").x > at("r_shoulder").x + 0.25,
        "who faces the camera has the left at x > 0"
    );
}

/// A body of four vertices that follows the format.
fn small(change: impl FnOnce(&mut Vec<(&'static str, Vec<usize>, Vec<f32>)>)) -> Vec<u8> {
    let mut weights = vec![0.0; 4 * JOINTS];
    weights.iter_mut().step_by(JOINTS).for_each(|w| *w = 1.0);
    let mut regressor = vec![0.0; 4 * JOINTS];
    regressor.iter_mut().step_by(4).for_each(|w| *w = 1.0);
    let mut tree: Vec<f32> = PARENTS.iter().map(|&p| p as f32).collect();
    tree[0] = u32::MAX as f32;
    tree.extend((0..JOINTS).map(|j| j as f32));
    let mut arrays = vec![
        (
            "v_template",
            vec![4, 3],
            (0..12).map(|x| x as f32 / 8.0).collect(),
        ),
        ("f", vec![2, 3], vec![0., 1., 2., 1., 2., 3.]),
        ("shapedirs", vec![4, 3, 12], vec![0.01; 144]),
        ("weights", vec![4, JOINTS], weights),
        ("J_regressor", vec![JOINTS, 4], regressor),
        ("kintree_table", vec![2, JOINTS], tree),
    ];
    change(&mut arrays);
    let arrays: Vec<Array<'_>> = arrays
        .iter()
        .map(|(name, shape, data)| Array {
            name,
            shape,
            data: Values::F32(data),
        })
        .collect();
    write(&arrays).unwrap()
}

fn read(bytes: Vec<u8>) -> Result<MeshBody, MeshError> {
    MeshBody::read(Cursor::new(bytes))
}

#[test]
fn other_bodies_of_the_format_are_read() {
    let plain = read(small(|_| ())).unwrap();
    assert_eq!((plain.vertices(), plain.components()), (4, 12));
    for shape in [0, CORRECTIVES] {
        let zero = read(small(|a| {
            a.push(("posedirs", vec![4, 3, shape], vec![0.0; 12 * shape]))
        }))
        .unwrap();
        assert!(zero.correctives.is_empty());
    }
    let sparse = read(small(|a| {
        a.retain(|(name, ..)| *name != "J_regressor");
        a.push(("J_regressor_data", vec![JOINTS], vec![1.0; JOINTS]));
        a.push(("J_regressor_indices", vec![JOINTS], vec![0.0; JOINTS]));
        a.push((
            "J_regressor_indptr",
            vec![JOINTS + 1],
            (0..=JOINTS).map(|x| x as f32).collect(),
        ));
    }))
    .unwrap();
    assert_eq!(sparse.joints, plain.joints);
    // As SMPL's own files have it: by columns.
    let by_columns = read(small(|a| {
        a.retain(|(name, ..)| *name != "J_regressor");
        a.push(("J_regressor_data", vec![JOINTS], vec![1.0; JOINTS]));
        let rows = (0..JOINTS).map(|x| x as f32).collect();
        a.push(("J_regressor_indices", vec![JOINTS], rows));
        let all = JOINTS as f32;
        a.push(("J_regressor_indptr", vec![5], vec![0., all, all, all, all]));
    }))
    .unwrap();
    assert_eq!(by_columns.joints, plain.joints);
    for shape in [vec![0], vec![0, 3, CORRECTIVES], vec![CORRECTIVES, 0]] {
        let empty = read(small(|a| a.push(("posedirs", shape, Vec::new())))).unwrap();
        assert!(empty.correctives.is_empty());
    }
}

/// Files of others round their weights.
#[test]
fn a_body_stays_in_its_place_however_its_weights_are_rounded() {
    let mesh = |sum: f32| {
        let body = read(small(|a| {
            let (_, _, weights) = a.iter_mut().find(|(n, ..)| *n == "weights").unwrap();
            // Two joints share the second vertex.
            weights[JOINTS..JOINTS + 2].copy_from_slice(&[0.6 * sum, 0.4 * sum]);
        }));
        let body = body.unwrap();
        let person = body.person(&[]);
        let pose = MeshPose {
            pelvis: DVec3::new(0.0, 0.0, 4.0),
            rotations: [DQuat::IDENTITY; JOINTS],
        };
        let mut out = Vec::new();
        let tree = posed(&body, &pose, &person);
        Skin::new(&body, &person).pose(&body, &pose, &tree, &mut out);
        out
    };
    let exact = mesh(1.0);
    for sum in [0.981, 1.019] {
        for (a, b) in mesh(sum).iter().zip(&exact) {
            assert!(a.distance(*b) < 1e-5, "{sum}: {a} {b}");
        }
    }
}

#[test]
fn pose_correctives_move_the_mesh_as_the_format_says() {
    let mut directions = vec![0.0; 12 * CORRECTIVES];
    // Vertex 2, along y, by the second value (row 0, column 1) of joint 3.
    directions[(2 * 3 + 1) * CORRECTIVES + 9 * 2 + 1] = 0.5;
    let body = read(small(|a| {
        a.push(("posedirs", vec![4, 3, CORRECTIVES], directions))
    }))
    .unwrap();
    let person = body.person(&[]);
    let mut pose = MeshPose {
        pelvis: DVec3::from(body.joints[0]),
        rotations: [DQuat::IDENTITY; JOINTS],
    };
    pose.rotations[3] = DQuat::from_rotation_z(0.3);
    let tree = posed(&body, &pose, &person);
    let mut out = Vec::new();
    let mut skin = Skin::new(&body, &person);
    skin.pose(&body, &pose, &tree, &mut out);
    let moved: Vec<Vec3> = out.iter().zip(skin.rest()).map(|(a, b)| *a - b).collect();
    let expected = -0.5 * 0.3f32.sin(); // row 0, column 1 of a turn about z
    assert!(
        (moved[2] - Vec3::new(0.0, expected, 0.0)).length() < 1e-6,
        "{moved:?}"
    );
    assert!(moved[0].length() < 1e-6 && moved[3].length() < 1e-6);
}

#[test]
fn what_is_no_body_is_refused_with_what_was_expected() {
    type Change = fn(&mut Vec<(&'static str, Vec<usize>, Vec<f32>)>);
    // Joint 15, the head, on another vertex than the ankles; joint 1 on another than joint 2.
    let lying: Change = |a| {
        (a[0].2[3..6]).copy_from_slice(&[0.0, 0.1, 1.6]);
        (a[4].2[4 * 15..][..2]).copy_from_slice(&[0.0, 1.0]);
    };
    let mirrored: Change = |a| {
        (a[0].2[3..6]).copy_from_slice(&[-0.2, 0.1, 0.1]);
        (a[4].2[4..][..2]).copy_from_slice(&[0.0, 1.0]);
    };
    let cases: [(&str, Change); 11] = [
        ("with y up", lying),
        ("with x to its left", mirrored),
        ("joint 0 in place of 5", |a| a[5].2[JOINTS + 5] = 0.0),
        ("an array weights", |a| a.retain(|(n, ..)| *n != "weights")),
        ("joint 5 on 9 instead of 2", |a| a[5].2[5] = 9.0),
        ("finite numbers", |a| a[0].2[3] = f32::NAN),
        ("none beyond 10", |a| a[0].2[3] = 1700.0),
        ("vertices from 0 to 3", |a| a[1].2[5] = 4.0),
        ("sum to 1", |a| a[3].2[0] = 0.5),
        ("4x3x1 to 4x3x300", |a| a[2].1 = vec![3, 4, 12]),
        ("24x4 numbers", |a| a[4].1 = vec![4, JOINTS]),
    ];
    for (words, change) in cases {
        let error = read(small(change)).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
    let pickle = read(b"\x80\x02}q\x00.".to_vec()).unwrap_err();
    assert!(pickle.to_string().contains("from_pickle.py"), "{pickle}");
    let whole = small(|_| ());
    for end in [0, 10, whole.len() / 2, whole.len() - 1] {
        assert!(
            read(whole[..end].to_vec()).is_err(),
            "cut after {end} bytes"
        );
    }
}
