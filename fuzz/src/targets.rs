//! One function per reader: any bytes go in, nothing may panic, hang or touch memory that is not its own.
//!
//! `fuzz_targets/` hands them to libFuzzer; `tests/fuzz.rs` of the main workspace runs them over seeds and damaged
//! seeds.

use std::fs::OpenOptions;
use std::io::Cursor;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::time::Duration;

use edgecap::body::BodyModel;
use edgecap::body::mesh::{FREEDOM, MeshBody, PosedTree, Skin};
use edgecap::camera::calibration::{
    Calibration as Calibrated, check, read_colmap, read_easymocap, read_opencv, read_pose2sim,
    read_qtm, write_pose2sim,
};
use edgecap::camera::{CameraFile, monotonic_ns};
use edgecap::capture::{AviReader, Frame, MjpegReader, PhotoDecoder, Y4mReader};
use edgecap::detect::{AssociationConfig, Associator};
use edgecap::engine::model::Calibration;
use edgecap::engine::{
    Algorithms, CalibrationOptions, Engine, EngineOptions, Isa, Maps, Model, Network, Precision,
};
use edgecap::events::{Detector, EventConfig};
use edgecap::export::Take;
use edgecap::fit::{FitConfig, Fitter};
use edgecap::http::Request;
use edgecap::joints::EVIDENCE_JOINTS;
use edgecap::message::{Body, BodyFrame, EventFrame, ObservationFrame};
use edgecap::overlay::{Glyphs, Person, Screen, characters, draw};
use edgecap::record::{BodiesRow, CameraSource, ObservationReader, Row, RowReader};
use edgecap_client::{BUFFER, Subscriber};

use crate::seeds;

// By its path from here: programs that have this file by its path look elsewhere otherwise.
#[path = "film.rs"]
mod film;

#[cfg(feature = "mp4")]
pub use film::mp4;
use film::{assert_whole, play};

/// A target by its name.
pub type Target = (&'static str, fn(&[u8]));

/// All of them.
pub const TARGETS: &[Target] = &[
    ("model", model),
    ("safetensors", safetensors),
    ("network", network),
    ("association", association),
    ("avi", avi),
    #[cfg(feature = "mp4")]
    ("mp4", mp4),
    ("y4m", y4m),
    ("mjpeg", mjpeg),
    ("photo", photo),
    ("observations", observations),
    ("bodies", bodies),
    ("request", request),
    ("camera", camera),
    ("calibration", calibration),
    ("fit_config", fit_config),
    ("messages", messages),
    ("ring", ring),
    ("body", body),
];

/// Lines, frames or messages that are taken from one input.
const FRAMES: usize = 16;
/// The largest network that is run, so that an input takes milliseconds.
const MOST_MACS: u64 = 20_000_000;
/// The largest network that is given memory, numbers.
const MOST_NUMBERS: usize = 4_000_000;

/// A model file. Its digest is made right first: a flipped bit that the digest shows teaches nothing about what comes
/// after.
pub fn model(data: &[u8]) {
    let mut bytes = data.to_vec();
    seeds::sign(&mut bytes);
    if let Ok(model) = Model::from_bytes(&bytes) {
        run_int8(&model);
        run(&model, Precision::F32, None);
        let again = Model::from_bytes(&model.to_bytes().expect("an open model can be written"));
        assert_eq!(
            again.expect("what was written can be read").weights(),
            model.weights()
        );
    }
}

/// Weights as PyTorch exports them, for Stage I and Stage II.
pub fn safetensors(data: &[u8]) {
    let network = Network::parse(seeds::NETWORK).expect("the seed is a network");
    if let Ok(model) = Model::from_safetensors(data, network.clone()) {
        run(&model, Precision::F32, None);
        if let Ok(model) = model.quantise(None) {
            run_int8(&model);
        }
    }
    let _ = Model::random(network, 1).with_stage2(data);
}

/// A network table, with random weights; what it does in f32 on one picture gives the ranges of int8.
pub fn network(data: &[u8]) {
    let Ok(network) = Network::parse(&String::from_utf8_lossy(data)) else {
        return;
    };
    if network.graph().parameters() > MOST_NUMBERS {
        return;
    }
    let model = Model::random(network, 1);
    if run(&model, Precision::F32, None).is_none() {
        return;
    }
    let side = smallest(model.network());
    let options = CalibrationOptions {
        size: (side, side),
        ..CalibrationOptions::default()
    };
    let seen = Calibration::observe(&model, [picture(side)], options);
    if let Ok(model) = seen.and_then(|seen| Ok(model.quantise(Some(&seen))?)) {
        run_int8(&model);
    }
}

/// The fastest kernels compute what the plainest do, and refuse what they do.
fn run_int8(model: &Model) {
    let plain = run(model, Precision::Int8, Some(Isa::Scalar));
    assert!(run(model, Precision::Int8, None) == plain, "tiers differ");
}

/// Side of the smallest input of 16 pixels or more that an engine takes.
fn smallest(network: &Network) -> usize {
    16_usize.next_multiple_of(Maps::step(&[network.input().multiple]))
}

fn picture(side: usize) -> Vec<u8> {
    (0..3 * side * side).map(|i| (i * 37) as u8).collect()
}

/// Runs a small network once on its smallest input; `None` where it cannot be, or is not small.
pub fn run(model: &Model, precision: Precision, isa: Option<Isa>) -> Option<Maps> {
    let graph = model.network().graph();
    let side = smallest(model.network());
    if side > 64 || graph.macs(side, side) > MOST_MACS {
        return None;
    }
    let sizes = graph.sizes(side, side);
    let numbers = sizes
        .iter()
        .zip(&graph.values)
        .fold(0_usize, |sum, ((h, w), v)| {
            sum.saturating_add(h.saturating_mul(*w).saturating_mul(v.channels))
        });
    if numbers > MOST_NUMBERS {
        return None;
    }
    let options = EngineOptions {
        width: side,
        height: side,
        threads: 1,
        isa,
        // Those that are the fastest depend on the tier.
        algorithms: Some(Algorithms::Portable),
        precision,
    };
    let mut engine = Engine::new(model, options).ok()?;
    Some(engine.run(&picture(side)).clone())
}

/// The association's settings, and people looked for under them: in maps that are full everywhere, and in some of any
/// numbers.
pub fn association(data: &[u8]) {
    let Ok(config) = AssociationConfig::parse(&String::from_utf8_lossy(data)) else {
        return;
    };
    let (most, fewest) = (config.max_people, config.min_joints);
    let mut associator = Associator::new(config);
    let mut maps = Maps::new(12, 8);
    maps.head2d.fill(1.0);
    for k in 0..2 {
        let found = associator.associate(&maps);
        assert!(found.len() <= most);
        for person in found {
            let seen = person.joints.iter().filter(|joint| joint[2] > 0.0).count();
            assert!((fewest..=EVIDENCE_JOINTS).contains(&seen), "{seen} joints");
            assert!(person.score.is_finite());
        }
        let number = |i: usize| (i * i * (7 + k) % 251) as f32 / 125.0 - 1.0;
        let values = maps.head2d.iter_mut().enumerate();
        values.for_each(|(i, v)| *v = number(i));
    }
}

/// Motion-JPEG in an AVI container.
pub fn avi(data: &[u8]) {
    if let Ok(film) = AviReader::new(Cursor::new(data), "fuzz.avi") {
        play(film);
    }
}

/// Uncompressed YUV4MPEG2.
pub fn y4m(data: &[u8]) {
    if let Ok(film) = Y4mReader::new(data, "fuzz.y4m", Some(data.len() as u64)) {
        play(film);
    }
    if let Ok(pipe) = Y4mReader::new(data, "fuzz.y4m", None) {
        play(pipe);
    }
}

/// Raw Motion-JPEG.
pub fn mjpeg(data: &[u8]) {
    play(MjpegReader::new(data, "fuzz.mjpeg", None));
}

/// A JPEG or PNG with its Exif orientation.
pub fn photo(data: &[u8]) {
    let mut decoder = PhotoDecoder::default();
    let mut frame = Frame::default();
    for bytes in [data, data] {
        if decoder.decode(bytes, &mut frame).is_ok() {
            assert_whole(&frame);
        }
    }
}

/// Recorded observations, fitted.
pub fn observations(data: &[u8]) {
    let camera = CameraSource::Recorded { fov_degrees: 60.0 };
    let mut reader = ObservationReader::new(data, "fuzz.jsonl", camera);
    let mut frame = ObservationFrame::default();
    let mut fitter = Fitter::new(FitConfig::default()).expect("the defaults are a configuration");
    for _ in 0..FRAMES {
        match reader.read(&mut frame) {
            Ok(true) => fit(&mut fitter, &frame),
            Ok(false) => break,
            Err(_) => {}
        }
    }
}

/// Recorded bodies: what happens in them, and what `export` makes of them before it writes.
pub fn bodies(data: &[u8]) {
    let mut rows = RowReader::<_, BodiesRow>::new(data, "fuzz");
    let mut events = Detector::new(EventConfig::default());
    for _ in 0..FRAMES {
        match rows.read() {
            Ok(Some(row)) => drop(events.look(&row.message())),
            Ok(None) => break,
            Err(_) => {}
        }
    }
    if let Ok(take) = Take::read(data, "fuzz") {
        assert!(take.start().is_finite() && take.rate() > 0.0);
        assert!(
            take.floor()
                .is_none_or(|floor| floor.translation.iter().all(|v| v.is_finite()))
        );
    }
}

/// What a browser asks of the server.
pub fn request(data: &[u8]) {
    if let Some(request) = Request::parse(&String::from_utf8_lossy(data)) {
        assert!(!request.path.contains('?'));
        for name in ["host", "origin", "upgrade", "sec-websocket-key"] {
            request.header(name);
        }
        request.parameter("camera");
    }
}

/// A camera file.
pub fn camera(data: &[u8]) {
    let Ok(camera) = CameraFile::parse(&String::from_utf8_lossy(data)) else {
        return;
    };
    for (width, height) in [(640, 480), (1, 16_384)] {
        if let Ok(lens) = camera.for_frame(width, height) {
            let numbers = [lens.fx, lens.fy, lens.cx, lens.cy];
            assert!(numbers.iter().all(|v| v.is_finite()), "{lens:?}");
        }
    }
}

/// What a text is as a calibration of other programs, in every format that takes it. Formats of two files have them one
/// after the other, parted by a form feed.
pub fn calibrations(text: &str) -> Vec<Calibrated> {
    let (first, second) = text.split_once('\x0c').unwrap_or((text, text));
    let all = [
        read_pose2sim(text, "fuzz"),
        read_qtm(text, "fuzz"),
        read_opencv(text, "camera", "fuzz").map(|view| vec![view]),
        read_easymocap(first, second, "fuzz"),
        read_colmap(first, second, "fuzz"),
    ];
    let read = all.into_iter().flatten();
    read.filter_map(|views| check("fuzz", views).ok()).collect()
}

/// Calibrations: what is read can be written and read again.
pub fn calibration(data: &[u8]) {
    for checked in calibrations(&String::from_utf8_lossy(data)) {
        let again = read_pose2sim(&write_pose2sim(&checked.views), "fuzz");
        assert_eq!(
            again.expect("what was written can be read").len(),
            checked.views.len()
        );
        for view in &checked.views {
            if let Some(pixel) = view.project(view.position + view.rotation.transpose().z_axis) {
                let _ = view.ray(pixel);
            }
        }
    }
}

/// A body model in SMPL's format, posed and skinned. Its archive's checksums are made right first.
pub fn body(data: &[u8]) {
    let mut bytes = data.to_vec();
    seeds::sign_archive(&mut bytes);
    let Ok(body) = MeshBody::read(Cursor::new(bytes)) else {
        return;
    };
    let person = body.person(&[1.0, -2.0]);
    let mut step = [0.0; FREEDOM];
    step[12] = 0.4;
    let pose = body.moved(&body.rest_pose(), &step);
    let mut posed = PosedTree::default();
    body.kinematics(&pose, &person, &mut posed);
    let mut vertices = Vec::new();
    Skin::new(&body, &person).pose(&body, &pose, &posed, &mut vertices);
    assert_eq!(vertices.len(), body.vertices());
}

/// The fit's settings, and people fitted under them.
pub fn fit_config(data: &[u8]) {
    let Ok(config) = FitConfig::parse(&String::from_utf8_lossy(data)) else {
        return;
    };
    let mut fitter = Fitter::new(config).expect("settings that were read are in range");
    for k in 0..4 {
        fit(&mut fitter, &seeds::observation_frame(k));
    }
}

/// What lies in shared memory when its writer has gone mad: observations that `fit` reads, bodies that everybody reads.
pub fn messages(data: &[u8]) {
    let Some((&kind, bytes)) = data.split_first() else {
        return;
    };
    if kind & 1 == 0 {
        let mut fitter =
            Fitter::new(FitConfig::default()).expect("the defaults are a configuration");
        for part in bytes.chunks(size_of::<ObservationFrame>()).take(FRAMES) {
            let frame: Box<ObservationFrame> = seeds::from_bytes(part);
            show(frame.people());
            fit(&mut fitter, &frame);
        }
    } else {
        for part in bytes.chunks(size_of::<BodyFrame>()).take(FRAMES) {
            let frame: Box<BodyFrame> = seeds::from_bytes(part);
            for body in frame.bodies() {
                let _ = frame.in_world(body);
            }
            write(&frame);
            show(frame.bodies());
        }
    }
}

/// A stream's file, whose count becomes another one while it is read. Its sign of life is made right first: what the
/// dead left is not read.
pub fn ring(data: &[u8]) {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let mut bytes = data.to_vec();
    if let Some(alive) = bytes.get_mut(seeds::RING_ALIVE) {
        alive.copy_from_slice(&monotonic_ns().to_ne_bytes());
    }
    let whole = (seeds::RING_HEADER + (BUFFER + 1) * size_of::<EventFrame>()) as u64;
    let file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(folder.path().join("camera0.events.v1"));
    let file = file.expect("a file can be made");
    file.write_all_at(&bytes, 0).expect("it can be written");
    // What is shorter than a header stays so.
    if bytes.len() >= seeds::RING_HEADER {
        file.set_len(whole)
            .expect("it can be as long as a whole one");
    }
    let Ok(reader) = Subscriber::<EventFrame>::open_at(folder.path(), "camera0") else {
        return;
    };
    let read = || {
        let next = || reader.next(Duration::ZERO).expect("a file can be read");
        let frames = std::iter::from_fn(next).take(2 * BUFFER);
        let names = frames.map(|f| f.events().iter().map(|e| e.zone().len()).sum::<usize>());
        names.count()
    };
    assert!(read() <= BUFFER, "it holds no more than that");
    if let Some(count) = data.last_chunk::<8>() {
        file.write_all_at(count, seeds::RING_COUNT.start as u64)
            .expect("it can be written");
    }
    assert!(read() <= BUFFER, "it holds no more than that");
    let newest = reader.newest(Duration::ZERO);
    newest.expect("a file can be read");
    assert!(reader.publisher_count() <= 1);
}

/// Fits one frame and holds what comes out against what every reader may count on.
fn fit(fitter: &mut Fitter, frame: &ObservationFrame) {
    let mut out = BodyFrame::default();
    fitter.update(frame, &mut out);
    assert_bodies(&out);
    write(&out);
    fitter.predict(frame.capture_ns.wrapping_add(20_000_000), &mut out);
    assert_bodies(&out);
}

fn assert_bodies(frame: &BodyFrame) {
    for Body {
        position,
        orientation,
        angles,
        joints3d,
        confidence,
        height,
        ..
    } in frame.bodies()
    {
        let numbers = position
            .iter()
            .chain(orientation)
            .chain(angles)
            .chain(confidence);
        let finite = numbers
            .chain(joints3d.as_flattened())
            .all(|v| v.is_finite());
        assert!(finite && *height > 0.0, "a body is made of numbers");
    }
}

fn write(frame: &BodyFrame) {
    serde_json::to_string(&BodiesRow::new(frame, "fuzz")).expect("a row can be written");
}

fn show<P: Person>(people: &[P]) {
    let mut frame = Frame {
        width: 32,
        height: 24,
        rgb: vec![0; 3 * 32 * 24],
        ..Frame::default()
    };
    draw(&mut frame, people);
    let screen = Screen {
        columns: 24,
        rows: 12,
        glyphs: Glyphs::Braille,
        coloured: true,
    };
    characters(people, [32, 24], screen);
}
