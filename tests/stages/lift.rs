//! Stage II: against a plain reference with random weights, and against PyTorch where its answers are at hand.

use edgecap::camera::translation::least_squares;
use edgecap::capture::{Frame, Letterbox};
use edgecap::detect::Detection;
use edgecap::engine::HEAD3D_CHANNELS;
use edgecap::engine::model::{Linear, Stage2};
use edgecap::joints::{EVIDENCE_JOINTS, LIMBS, NECK};
use edgecap::lift::{Encodings, INPUTS, JOINT_INPUTS, LiftError, Lifter, OUTPUTS};
use edgecap::message::Intrinsics;
use edgecap_kernels::Isa;
use glam::{DVec2, DVec3};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

const WIDTHS: [usize; 6] = Stage2::WIDTHS;

fn random_layers(rng: &mut SmallRng) -> Vec<Linear> {
    let layer = |(i, w): (usize, &[usize])| {
        let scale = (3.0 / w[0] as f32).sqrt();
        Linear {
            inputs: w[0],
            outputs: w[1],
            weight: (0..w[0] * w[1])
                .map(|_| rng.random_range(-scale..scale))
                .collect(),
            bias: (0..w[1]).map(|_| rng.random_range(-0.1..0.1)).collect(),
            relu: i + 2 < WIDTHS.len(),
        }
    };
    WIDTHS.windows(2).enumerate().map(layer).collect()
}

fn random_detection(rng: &mut SmallRng) -> Detection {
    let mut d = Detection {
        joints: [[0.0; 3]; EVIDENCE_JOINTS],
        confidence: [0.0; EVIDENCE_JOINTS],
        encodings: [[0.0; HEAD3D_CHANNELS]; EVIDENCE_JOINTS],
        limbs: [0.0; LIMBS],
        score: 0.5,
    };
    for j in 0..EVIDENCE_JOINTS {
        if j == NECK || rng.random_bool(0.8) {
            d.joints[j] = [
                rng.random_range(100.0..200.0),
                rng.random_range(50.0..250.0),
                rng.random_range(0.3..1.0),
            ];
            d.confidence[j] = d.joints[j][2];
            d.encodings[j].fill_with(|| rng.random_range(-0.5..0.5));
        }
    }
    d
}

/// Stage II in double precision, written as the formula reads.
fn plain(layers: &[Linear], d: &Detection, encodings: bool) -> Vec<f64> {
    let seen: Vec<usize> = (0..EVIDENCE_JOINTS)
        .filter(|&j| d.joints[j][2] > 0.0)
        .collect();
    let at = |j: usize, k: usize| f64::from(d.joints[j][k]) - f64::from(d.joints[NECK][k]);
    let square: f64 = seen
        .iter()
        .map(|&j| at(j, 0).powi(2) + at(j, 1).powi(2))
        .sum();
    let radius = (square / seen.len() as f64).sqrt();
    let mut x = vec![0.0; INPUTS];
    for &j in &seen {
        let row = &mut x[j * JOINT_INPUTS..];
        row[0] = at(j, 0) / radius;
        row[1] = at(j, 1) / radius;
        row[2] = f64::from(d.joints[j][2]);
        if encodings {
            for (k, e) in d.encodings[j].iter().enumerate() {
                row[3 + k] = f64::from(*e);
            }
        }
    }
    for l in layers {
        let output = |o: usize| {
            let row = &l.weight[o * l.inputs..(o + 1) * l.inputs];
            let dot: f64 = row.iter().zip(&x).map(|(w, x)| f64::from(*w) * x).sum();
            let y = dot + f64::from(l.bias[o]);
            if l.relu { y.max(0.0) } else { y }
        };
        x = (0..l.outputs).map(output).collect();
    }
    x
}

trait FillWith {
    fn fill_with(&mut self, f: impl FnMut() -> f32);
}

impl FillWith for [f32; HEAD3D_CHANNELS] {
    fn fill_with(&mut self, mut f: impl FnMut() -> f32) {
        self.iter_mut().for_each(|v| *v = f());
    }
}

#[test]
fn batches_of_any_size_match_the_plain_formula() {
    let mut rng = SmallRng::seed_from_u64(1);
    let layers = random_layers(&mut rng);
    for encodings in [Encodings::Read, Encodings::Zero] {
        let mut lifter = Lifter::new(&layers, encodings, Isa::Scalar).unwrap();
        for count in [0, 1, 3, 4, 5, 8, 11] {
            let people: Vec<_> = (0..count).map(|_| random_detection(&mut rng)).collect();
            let lifted: Vec<_> = lifter.lift_aligned(&people).unwrap().collect();
            assert_eq!(lifted.len(), count);
            for (d, joints) in people.iter().zip(lifted) {
                let expected = plain(&layers, d, encodings == Encodings::Read);
                for (a, b) in joints.as_flattened().iter().zip(expected) {
                    assert!((f64::from(*a) - b).abs() < 1e-4, "{a} instead of {b}");
                }
            }
        }
    }
}

#[test]
fn size_and_place_in_the_network_input_do_not_matter() {
    let mut rng = SmallRng::seed_from_u64(2);
    let layers = random_layers(&mut rng);
    let near = random_detection(&mut rng);
    let mut far = near.clone();
    for j in far.joints.iter_mut().filter(|j| j[2] > 0.0) {
        *j = [0.5 * j[0] + 31.0, 0.5 * j[1] - 7.0, j[2]];
    }
    let mut lifter = Lifter::new(&layers, Encodings::Read, Isa::detect().unwrap()).unwrap();
    let lifted: Vec<_> = lifter.lift_aligned(&[near, far]).unwrap().collect();
    for (a, b) in lifted[0]
        .as_flattened()
        .iter()
        .zip(lifted[1].as_flattened())
    {
        assert!((a - b).abs() < 1e-4);
    }
}

#[test]
fn observations_are_in_original_pixels_and_camera_axes() {
    let mut rng = SmallRng::seed_from_u64(3);
    let layers = random_layers(&mut rng);
    let mut lifter = Lifter::new(&layers, Encodings::Read, Isa::detect().unwrap()).unwrap();
    let d = random_detection(&mut rng);
    let aligned = lifter
        .lift_aligned(std::slice::from_ref(&d))
        .unwrap()
        .next()
        .unwrap();
    let letterbox = Letterbox {
        scale: 0.25,
        offset_u: 10.0,
        offset_v: 20.0,
    };
    let intrinsics = Intrinsics::from_horizontal_fov(1920, 1080, 60.0);
    let frame = Frame {
        width: 1920,
        height: 1080,
        rgb: vec![128; 1920 * 1080 * 3],
        ..Default::default()
    };
    let seen = lifter
        .lift(std::slice::from_ref(&d), &frame, &letterbox, &intrinsics)
        .unwrap()[0];
    let plane = |[u, v, _]: [f32; 3]| {
        let ray = DVec2::new((u - intrinsics.cx).into(), (v - intrinsics.cy).into());
        ray / f64::from(intrinsics.fx)
    };
    let point = |j: usize| DVec3::from(seen.joints3d[j].map(f64::from));
    let root = least_squares(
        &seen.joints2d.map(plane),
        &std::array::from_fn::<_, EVIDENCE_JOINTS, _>(point),
        &d.joints.map(|j| j[2].into()),
    );
    for (j, (from, to)) in d.joints.iter().zip(seen.joints2d).enumerate() {
        assert_eq!(from[2], to[2]);
        if from[2] > 0.0 {
            assert_eq!([to[0], to[1]], letterbox.to_original(from[0], from[1]));
        } else if let Some(at) = root.map(|r| r + point(j)).filter(|at| at.z > 0.1) {
            let off = plane(to) - at.truncate() / at.z;
            assert!(off.length() < 1e-3, "{to:?}, {off} off its place");
        } else {
            assert_eq!(to, [0.0; 3]);
        }
    }
    // What lies along z in view-aligned axes lies along the neck's ray in camera axes, and lengths stay.
    let ray = intrinsics.ray(seen.joints2d[NECK][0], seen.joints2d[NECK][1]);
    for (a, c) in aligned.iter().zip(seen.joints3d) {
        let depth: f32 = c.iter().zip(ray).map(|(c, r)| c * r).sum();
        assert!((depth - a[2]).abs() < 1e-5);
        let norm = |p: &[f32; 3]| p.iter().map(|x| x * x).sum::<f32>().sqrt();
        assert!((norm(a) - norm(&c)).abs() < 1e-5);
    }
}

#[test]
fn weights_that_do_not_fit_are_refused() {
    let mut rng = SmallRng::seed_from_u64(4);
    let good = random_layers(&mut rng);
    let with = |change: &dyn Fn(&mut Vec<Linear>)| {
        let mut layers = good.clone();
        change(&mut layers);
        let Err(error) = Lifter::new(&layers, Encodings::Read, Isa::Scalar) else {
            panic!("layers that do not fit were taken")
        };
        error
    };
    assert!(matches!(
        with(&|l| drop(l.remove(3))),
        LiftError::Layer { index: 4, .. }
    ));
    assert!(matches!(
        with(&|l| l[2].weight.truncate(9)),
        LiftError::Layer { index: 3, .. }
    ));
    assert_eq!(
        with(&|l| drop(l.pop())),
        LiftError::Outputs { found: WIDTHS[4] }
    );
    assert_eq!(
        with(&|l| l[0].bias[3] = f32::NAN),
        LiftError::NotFinite { index: 1 }
    );
    assert_eq!(with(&|l| l.clear()), LiftError::Outputs { found: INPUTS });
}

#[test]
fn pytorch_gives_the_same_joints() {
    let Some(folder) = std::env::var_os("EDGECAP_DATA") else {
        println!("skipped: EDGECAP_DATA does not name a folder with stage2-reference.safetensors");
        return;
    };
    let path = std::path::Path::new(&folder).join("stage2-reference.safetensors");
    let Ok(bytes) = std::fs::read(&path) else {
        println!(
            "skipped: no {}; tests/reference/stage2.py writes it",
            path.display()
        );
        return;
    };
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let floats = |name: &str| -> Vec<f32> {
        let view = file.tensor(name).unwrap();
        let (values, _) = view.data().as_chunks::<4>();
        values.iter().map(|b| f32::from_le_bytes(*b)).collect()
    };
    let layers: Vec<Linear> = (1..WIDTHS.len())
        .map(|i| {
            let bias = floats(&format!("fc{i}.bias"));
            let weight = floats(&format!("fc{i}.weight"));
            Linear {
                inputs: weight.len() / bias.len(),
                outputs: bias.len(),
                weight,
                bias,
                relu: i + 1 < WIDTHS.len(),
            }
        })
        .collect();
    let (uv, conf, enc) = (floats("uv"), floats("conf"), floats("enc"));
    let people: Vec<Detection> = (0..conf.len() / EVIDENCE_JOINTS)
        .map(|n| {
            let at = |j: usize| n * EVIDENCE_JOINTS + j;
            Detection {
                joints: std::array::from_fn(|j| [uv[2 * at(j)], uv[2 * at(j) + 1], conf[at(j)]]),
                confidence: std::array::from_fn(|j| conf[at(j)]),
                encodings: std::array::from_fn(|j| {
                    std::array::from_fn(|k| enc[at(j) * HEAD3D_CHANNELS + k])
                }),
                limbs: [1.0; LIMBS],
                score: 1.0,
            }
        })
        .collect();
    let worst = |ours: Vec<f32>, theirs: &str| {
        let theirs = floats(theirs);
        assert_eq!(ours.len(), theirs.len());
        let d = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs());
        d.fold(0.0, f32::max)
    };
    let mut lifter = Lifter::new(&layers, Encodings::Read, Isa::detect().unwrap()).unwrap();
    let aligned = lifter
        .lift_aligned(&people)
        .unwrap()
        .flatten()
        .flatten()
        .collect();
    let error = worst(aligned, "aligned");
    let mut blind = Lifter::new(&layers, Encodings::Zero, Isa::detect().unwrap()).unwrap();
    let aligned = blind
        .lift_aligned(&people)
        .unwrap()
        .flatten()
        .flatten()
        .collect();
    let blind_error = worst(aligned, "aligned_without_encodings");
    // Only people with a neck: the reference turns by the neck's ray.
    let necks = people
        .iter()
        .take_while(|p| p.joints[NECK][2] > 0.0)
        .count();
    let intrinsics = Intrinsics {
        fx: 400.0,
        fy: 400.0,
        cx: 255.5,
        cy: 159.5,
    };
    let letterbox = Letterbox {
        scale: 1.0,
        offset_u: 0.0,
        offset_v: 0.0,
    };
    let seen = lifter
        .lift(&people, &Frame::default(), &letterbox, &intrinsics)
        .unwrap();
    let expected = floats("camera");
    let mut camera_error = 0.0_f32;
    for (o, e) in seen.iter().zip(expected.chunks_exact(OUTPUTS)).take(necks) {
        for (a, b) in o.joints3d.as_flattened().iter().zip(e) {
            camera_error = camera_error.max((a - b).abs());
        }
    }
    println!(
        "largest difference: {error:e} m, without encodings {blind_error:e} m, in camera axes {camera_error:e} m"
    );
    assert!(error < 1e-4 && blind_error < 1e-4 && camera_error < 1e-4);
}
