//! Ground truth as public toolboxes export it: archives of people who stand where they are known to.

mod command;
mod pictures;
mod refused;
mod sets;

use std::io::{Cursor, Write};

use edgecap::joints::BODY_JOINTS;
use edgecap::lab::eval::{
    EvalOptions, JointOrder, Person, PredictedFrame, Predictions, ReadOptions, Report, TruthSet,
    evaluate,
};
use npyz::WriterBuilder;

type Pose = [[f64; 3]; BODY_JOINTS];

/// A man who stands with one arm raised, relative to his pelvis, metres, camera axes.
const FIGURE: Pose = [
    [0.01, -0.80, 0.02],
    [0.00, -0.52, 0.03],
    [-0.18, -0.50, 0.02],
    [-0.40, -0.62, -0.06],
    [-0.45, -0.86, -0.10],
    [0.18, -0.50, 0.04],
    [0.22, -0.22, 0.10],
    [0.25, 0.03, 0.02],
    [-0.12, 0.08, 0.00],
    [-0.14, 0.50, -0.05],
    [-0.15, 0.90, 0.04],
    [0.12, 0.08, 0.01],
    [0.13, 0.50, -0.02],
    [0.14, 0.90, 0.08],
    [0.00, 0.00, 0.00],
    [0.00, -0.25, 0.02],
    [0.00, -0.66, 0.00],
    [-0.47, -0.95, -0.11],
    [0.26, 0.10, 0.00],
    [-0.17, 0.97, -0.12],
    [0.16, 0.97, -0.08],
];

/// Where Human3.6M's 17 joints are among ours; it has a nose, which we have not.
const H36M: [usize; 17] = [14, 8, 9, 10, 11, 12, 13, 15, 1, 16, 0, 5, 6, 7, 2, 3, 4];

const NOSE: usize = 9;

/// The same for MPI-INF-3DHP's 28; 21 stands for those that we have not.
const DHP_28: [usize; 28] = [
    21, 21, 21, 15, 14, 1, 16, 0, 21, 5, 6, 7, 18, 21, 2, 3, 4, 17, 11, 12, 13, 21, 20, 8, 9, 10,
    21, 19,
];

fn at(pose: &Pose, [x, y, z]: [f64; 3]) -> Pose {
    pose.map(|p| [p[0] + x, p[1] + y, p[2] + z])
}

/// Pixels of a camera with a focal length of 500 px and its axis at (256, 160).
fn seen([x, y, z]: [f64; 3]) -> [f64; 2] {
    [256.0 + 500.0 * x / z, 160.0 + 500.0 * y / z]
}

/// A person as `infer` predicts it: relative to the pelvis, seen where the truth is.
fn observed(solid: Pose, pose: &Pose) -> Person {
    Person {
        id: None,
        score: 0.98,
        joints2d: std::array::from_fn(|j| {
            let [u, v] = seen(pose[j]);
            [u as f32, v as f32, 1.0]
        }),
        height: None,
        joints3d: solid,
    }
}

fn predicted(frames: Vec<(&str, Vec<Person>)>) -> Predictions {
    let frames = frames.into_iter().zip(0..);
    let frame = |((source, people), k): ((&str, Vec<Person>), u64)| PredictedFrame {
        frame: k,
        time_ns: 40_000_000 * k,
        source: source.into(),
        size: [512.0, 320.0],
        people,
    };
    Predictions {
        frames: frames.map(frame).collect(),
        ..Predictions::default()
    }
}

/// Arrays of an archive as NumPy would write them, compressed.
#[derive(Default)]
struct Arrays(Vec<(String, Vec<u8>)>);

impl Arrays {
    fn array<T: npyz::AutoSerialize + Copy>(
        mut self,
        name: &str,
        shape: &[u64],
        data: &[T],
    ) -> Self {
        let mut bytes = Vec::new();
        let mut npy = npyz::WriteOptions::new()
            .default_dtype()
            .shape(shape)
            .writer(&mut bytes)
            .begin_nd()
            .unwrap();
        npy.extend(data.iter().copied()).unwrap();
        npy.finish().unwrap();
        self.0.push((name.into(), bytes));
        self
    }

    fn texts(mut self, name: &str, texts: &[&str]) -> Self {
        let longest = texts.iter().map(|t| t.chars().count()).max().unwrap();
        let dtype = npyz::DType::new_scalar(format!("<U{longest}").parse().unwrap());
        let mut bytes = Vec::new();
        let mut npy = npyz::WriteOptions::new()
            .dtype(dtype)
            .shape(&[texts.len() as u64])
            .writer(&mut bytes)
            .begin_nd()
            .unwrap();
        npy.extend(texts.iter().map(|t| (*t).to_owned())).unwrap();
        npy.finish().unwrap();
        self.0.push((name.into(), bytes));
        self
    }

    fn bytes(&self) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in &self.0 {
            let options = zip::write::SimpleFileOptions::default();
            zip.start_file(format!("{name}.npy"), options).unwrap();
            zip.write_all(bytes).unwrap();
        }
        zip.finish().unwrap().into_inner()
    }

    fn read(&self, options: &ReadOptions) -> Result<TruthSet, String> {
        read(&self.bytes(), options)
    }

    fn truth(&self) -> TruthSet {
        self.read(&ReadOptions::default()).unwrap()
    }
}

fn read(bytes: &[u8], options: &ReadOptions) -> Result<TruthSet, String> {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    TruthSet::read(file.path(), options).map_err(|e| {
        let said = e.to_string();
        assert!(said.contains(file.path().to_str().unwrap()), "{said}");
        said
    })
}

fn measure(predictions: &Predictions, truth: &TruthSet) -> Report {
    evaluate(predictions, truth, &EvalOptions::default()).unwrap()
}

/// `imgname`, `S` and `part` of people alone in their pictures, in Human3.6M's order.
fn toolbox(people: &[(&str, Pose)]) -> Arrays {
    let (mut solid, mut flat) = (Vec::new(), Vec::new());
    for (_, pose) in people {
        for (k, &j) in H36M.iter().enumerate() {
            // A nose that lies anywhere must not matter.
            let p = if k == NOSE { [0.3, -0.3, 4.0] } else { pose[j] };
            solid.extend([p[0], p[1], p[2], 1.0]);
            let [u, v] = seen(p);
            flat.extend([u, v, 1.0]);
        }
    }
    let n = people.len() as u64;
    let names: Vec<&str> = people.iter().map(|(name, _)| *name).collect();
    Arrays::default()
        .texts("imgname", &names)
        .array("center", &[n, 2], &vec![0.0; 2 * people.len()])
        .array("S", &[n, 17, 4], &solid)
        .array("part", &[n, 17, 3], &flat)
}

fn h36m() -> ReadOptions {
    ReadOptions {
        joint_order: Some(JointOrder::H36m),
        ..ReadOptions::default()
    }
}

/// MuPoTS-3D as the converter writes it: millimetres, two people a row, 28 or 17 joints.
fn crowd(joints: &[usize], rows: &[(&str, [Option<Pose>; 2])]) -> Arrays {
    let (mut solid, mut flat, mut valid) = (Vec::new(), Vec::new(), Vec::new());
    for pose in rows.iter().flat_map(|(_, people)| people) {
        valid.push(i64::from(pose.is_some()));
        for &j in joints {
            let p = pose.and_then(|p| p.get(j).copied()).unwrap_or([0.1; 3]);
            solid.extend(p.map(|x| (1e3 * x) as f32));
            flat.extend(seen(p));
        }
    }
    let (n, count) = (rows.len() as u64, joints.len() as u64);
    let names: Vec<&str> = rows.iter().map(|(name, _)| *name).collect();
    Arrays::default()
        .texts("imgname", &names)
        .texts("units", &["mm"])
        .texts("joint_order", &["mpi_inf_3dhp"])
        .array("positions_3d", &[n, 2, count, 3], &solid)
        .array("positions_2d", &[n, 2, count, 2], &flat)
        .array("valid", &[n, 2], &valid)
}
