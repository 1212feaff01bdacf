//! Meshes as files: the moving skin is where the still mesh of the same frame is.

use edgecap::camera::calibration::write_pose2sim;
use glam::{DMat3, Mat4, Quat, Vec3};
use gltf::animation::util::ReadOutputs;

use super::many_views::files;
use crate::program::{output, stderr};

const FRAMES: usize = 6;
const SHOWN: usize = 4;

/// Vertices of a skinned file at one of its moments, metres.
fn skinned(file: &[u8], moment: usize) -> Vec<Vec3> {
    let gltf = gltf::Gltf::from_slice(file).unwrap();
    let blob = gltf.blob.as_deref().unwrap();
    let document = &gltf.document;
    let nodes = document.nodes().map(|n| n.transform().decomposed());
    let mut local: Vec<(Vec3, Quat)> = nodes
        .map(|(place, turn, _)| (place.into(), Quat::from_array(turn)))
        .collect();
    for channel in document.animations().next().unwrap().channels() {
        let node = &mut local[channel.target().node().index()];
        match channel.reader(|_| Some(blob)).read_outputs().unwrap() {
            ReadOutputs::Translations(mut all) => node.0 = all.nth(moment).unwrap().into(),
            ReadOutputs::Rotations(all) => {
                node.1 = Quat::from_array(all.into_f32().nth(moment).unwrap());
            }
            _ => {}
        }
    }
    let mut world = vec![Mat4::IDENTITY; local.len()];
    let mut left: Vec<(gltf::Node<'_>, Mat4)> = document
        .default_scene()
        .unwrap()
        .nodes()
        .map(|n| (n, Mat4::IDENTITY))
        .collect();
    while let Some((node, above)) = left.pop() {
        let (place, turn) = local[node.index()];
        let own = above * Mat4::from_rotation_translation(turn, place);
        world[node.index()] = own;
        left.extend(node.children().map(|child| (child, own)));
    }
    let skin = document.skins().next().unwrap();
    let binds = skin.reader(|_| Some(blob)).read_inverse_bind_matrices();
    let moves: Vec<Mat4> = skin
        .joints()
        .zip(binds.unwrap())
        .map(|(joint, bind)| world[joint.index()] * Mat4::from_cols_array_2d(&bind))
        .collect();
    let primitive = document.meshes().next().unwrap().primitives().next();
    let reader = primitive.unwrap();
    let reader = reader.reader(|_| Some(blob));
    let joints = reader.read_joints(0).unwrap().into_u16();
    let weights = reader.read_weights(0).unwrap().into_f32();
    let vertices = reader.read_positions().unwrap().zip(joints.zip(weights));
    vertices
        .map(|(at, (joints, weights))| {
            let each = joints.into_iter().zip(weights);
            each.map(|(j, w)| w * moves[usize::from(j)].transform_point3(at.into()))
                .sum()
        })
        .collect()
}

fn still(text: &str) -> Vec<Vec3> {
    let lines = text.lines().filter_map(|l| l.strip_prefix("v "));
    let number = |n: &str| n.parse::<f32>().unwrap();
    lines
        .map(|l| Vec3::from_slice(&l.split(' ').map(number).collect::<Vec<_>>()))
        .collect()
}

#[test]
fn the_moving_mesh_is_where_the_still_one_is() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    // A calibration whose z points up, as most do; the file's y does.
    let mut views = files(folder.path(), 3, FRAMES);
    let y_to_z = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
    for view in &mut views {
        view.rotation *= y_to_z.transpose();
        view.position = y_to_z * view.position;
    }
    let (calibration, run, shown) = (at("Calib.toml"), at("run"), SHOWN.to_string());
    std::fs::write(&calibration, write_pose2sim(&views)).unwrap();
    let seen = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let mut args = vec!["multiview", "--calibration", &calibration, "--out", &run];
    args.extend(["--obj", &shown]);
    args.extend(seen.iter().flat_map(|v| ["--view", v]));
    let out = output(&args);
    assert!(out.status.success(), "{}", stderr(&out));
    let moving = skinned(&std::fs::read(at("run/meshes.glb")).unwrap(), SHOWN);
    let obj = format!("run/person1_{SHOWN:06}.obj");
    let still = still(&std::fs::read_to_string(at(&obj)).unwrap());
    assert_eq!((moving.len(), still.len()), (6890, 6890));
    let turned = |p: Vec3| y_to_z.transpose().as_mat3() * p;
    let off = moving.iter().zip(&still);
    let off = off.map(|(m, s)| m.distance(turned(*s)));
    let most = off.fold(0.0, f32::max);
    assert!(most < 1e-4, "{most} m off");
    let heights = || moving.iter().map(|p| p.y);
    let tall = heights().fold(f32::MIN, f32::max) - heights().fold(f32::MAX, f32::min);
    assert!(tall > 1.3, "{tall} m tall");
}
