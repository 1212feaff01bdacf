//! What fuzzing starts from: one or two whole, tiny inputs of every format, made from code so that no file goes stale.

use std::io::Cursor;
use std::ops::Range;

use edgecap::body::mesh::{JOINTS, PARENTS};
use edgecap::capture::{AviWriter, Frame};
use edgecap::engine::{Model, Network};
use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use edgecap::message::{Body, BodyFrame, EventFrame, Intrinsics, ObservationFrame};
use edgecap::npz::{self, Array, Values};
use edgecap::record::{BodiesRow, Format, ObservationsRow, RecordWriter, Row};
use edgecap_client::Message;
use serde_json::{Value, json};

/// Every kind of layer that a model needs, as small as it can be.
pub const NETWORK: &str = r#"
name = "fuzz"
about = "small"
input = { channels = 3, multiple = 16 }
output = { head2d = "a", head3d = "b" }
layers = [
  { kind = "conv", name = "stem", out = 4, kernel = 3, stride = 2 },
  { kind = "maxpool", name = "pool", kernel = 3, stride = 2 },
  { kind = "conv", name = "deep", out = 4, kernel = 3, stride = 2 },
  { kind = "conv", name = "down", out = 4, kernel = 3, stride = 2 },
  { kind = "deconv", name = "up", out = 4, kernel = 4, stride = 2, groups = 2 },
  { kind = "conv", name = "a", from = ["up", "deep"], out = 40, kernel = 1, norm = false, relu = false },
  { kind = "conv", name = "b", from = ["up", "deep"], out = 63, kernel = 1, norm = false, relu = false },
]
"#;

/// The kinds that [`NETWORK`] has not.
const MODULES: &str = r#"
name = "modules"
about = "SelecSLS and bottlenecks"
input = { channels = 3, multiple = 16 }
output = { head2d = "a", head3d = "b" }
layers = [
  { kind = "conv", name = "stem", out = 4, kernel = 7, stride = 2 },
  { kind = "bottlenecks", name = "res", width = 4, out = 8, blocks = 2, stride = 2 },
  { kind = "selecsls", name = "features", groups = [[5, 2]], modules = [[8, 0, 6, 6, 2], [6, 6, 6, 8, 1]] },
  { kind = "conv", name = "a", out = 40, kernel = 3, norm = false, relu = false },
  { kind = "conv", name = "b", from = ["features"], out = 63, kernel = 1, norm = false, relu = false },
]
"#;

const CAMERA: [&str; 2] = [
    "fov_degrees = 75.0\n",
    "fx = 500.0\nfy = 501.0\ncx = 320.0\ncy = 240.0\nwidth = 640\nheight = 480\n",
];

const CALIBRATIONS: [&str; 5] = [
    "[cam01]\nname = \"cam01\"\nsize = [640.0, 480.0]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
        distortions = [-0.04, 0.1, 0.0, 0.001]\nrotation = [0.1, -1.0, 0.2]\ntranslation = [0.1, 0.2, 3.0]\nfisheye = false\n\n\
        [metadata]\nadjusted = false\nerror = 0.0\n",
    "<?xml version='1.0'?><calibration><cameras><camera active=\"1\" serial=\"a\" viewrotation=\"0\">\
        <fov_video_max bottom=\"479\" left=\"0\" right=\"639\" top=\"0\"/>\
        <transform r11=\"0\" r12=\"1\" r13=\"0\" r21=\"0\" r22=\"0\" r23=\"1\" r31=\"1\" r32=\"0\" r33=\"0\" x=\"3000\" y=\"0\" z=\"1500\"/>\
        <intrinsic centerPointU=\"20480\" centerPointV=\"15360\" focalLengthU=\"32000\" focalLengthV=\"32000\" \
        radialDistortion1=\"-0.04\" radialDistortion2=\"0\" tangentalDistortion1=\"0\" tangentalDistortion2=\"0\"/>\
        </camera></cameras></calibration>",
    "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n\
        \x20  data: [ 500., 0., 320., 0., 500., 240., 0., 0., 1. ]\ndistortion_coefficients: [ -0.04, 0.1, 0., 0., 0. ]\n\
        rvec: [ 0.1, 0.2, 0.3 ]\ntvec: [ 0., 0.1, 3. ]\n",
    "%YAML:1.0\n---\nnames:\n  - \"1\"\nK_1: [ 500., 0., 320., 0., 500., 240., 0., 0., 1. ]\ndist_1: [ 0., 0., 0., 0., 0. ]\n\
        \x0c%YAML:1.0\n---\nR_1: [ 0.1, 0.2, 0.3 ]\nT_1: [ 0., 0.1, 3. ]\n",
    "1 OPENCV 640 480 500 500 320 240 -0.04 0.1 0 0\n\x0c1 1 0 0 0 0 0.1 3 1 a.jpg\n\n",
];

const FIT_CONFIG: &str = "height = 1.8\nestimate_ground = true\nmin_joint_confidence = 0.2\n\
    [ground]\nnormal = [0.0, -1.0, 0.1]\noffset = 1.5\n\
    [filter2d]\nmin_cutoff = 1.0\nbeta = 2.0\n\
    [terms]\nposition = 2.0\ntemporal = 0.5\n\
    [identity]\nmemory = 5.0\n\
    [prediction]\nmax = 0.2\n";

/// Whole inputs of a target.
///
/// # Panics
/// When a seed cannot be made, or for a target that does not exist.
pub fn seeds(target: &str) -> Vec<Vec<u8>> {
    match target {
        "model" => vec![model()],
        "safetensors" => vec![stage1(), stage2()],
        "network" => vec![NETWORK.into(), MODULES.into()],
        "association" => vec![include_bytes!("../../models/association.toml").to_vec()],
        "avi" => vec![avi()],
        "mp4" => vec![mp4()],
        "y4m" => vec![y4m("420jpeg", 24), y4m("444 XCOLORRANGE=FULL", 48)],
        "mjpeg" => vec![[jpeg(), exif_jpeg(), jpeg()].concat()],
        "photo" => vec![jpeg(), exif_jpeg(), png()],
        "observations" => vec![
            observations(),
            binary_record::<ObservationsRow>(&observation_frame),
        ],
        "bodies" => vec![bodies(), binary_record::<BodiesRow>(&body_frame)],
        "request" => vec![REQUEST.into()],
        "camera" => CAMERA.map(Into::into).to_vec(),
        "calibration" => CALIBRATIONS.map(Into::into).to_vec(),
        "fit_config" => vec![FIT_CONFIG.into()],
        "messages" => messages(),
        "ring" => vec![ring(3, 2), ring(u64::MAX, 4)],
        "body" => vec![body(false), body(true)],
        other => panic!("expected one of TARGETS, found {other}"),
    }
}

/// Shipped weights' contract with ranges, so that they need no calibration.
fn contract(network: &Network) -> String {
    let model = Model::random(network.clone(), 1);
    let mut contract = serde_json::to_value(model.contract()).expect("a contract is JSON");
    let ranges = ["stem", "deep", "down", "up"].map(|n| (format!("{n}.2"), json!(3.0)));
    contract["activation_max"] = Value::Object(ranges.into_iter().collect());
    contract["activation_bits"] = json!(7);
    contract.to_string()
}

fn stage1() -> Vec<u8> {
    let network = Network::parse(NETWORK).expect("the seed is a network");
    let mut tensors: Vec<(String, Vec<usize>)> = vec![
        ("stem.0.weight".into(), vec![4, 3, 3, 3]),
        ("deep.0.weight".into(), vec![4, 4, 3, 3]),
        ("down.0.weight".into(), vec![4, 4, 3, 3]),
        ("up.0.weight".into(), vec![4, 2, 4, 4]),
        ("a.weight".into(), vec![40, 8, 1, 1]),
        ("a.bias".into(), vec![40]),
        ("b.weight".into(), vec![63, 8, 1, 1]),
        ("b.bias".into(), vec![63]),
    ];
    for layer in ["stem", "deep", "down", "up"] {
        for what in ["weight", "bias", "running_mean", "running_var"] {
            tensors.push((format!("{layer}.1.{what}"), vec![4]));
        }
    }
    file(&tensors, &contract(&network))
}

fn stage2() -> Vec<u8> {
    let shipped = Model::shipped().expect("the shipped model is whole");
    let contract = &shipped
        .stage2()
        .expect("the shipped model has a Stage II")
        .contract;
    let widths = [924, 1, 1, 2, 2, 63];
    let mut tensors = Vec::new();
    for (i, w) in widths.windows(2).enumerate() {
        let name = format!("fc{}", i + 1);
        tensors.push((format!("{name}.0.weight"), vec![w[1], w[0]]));
        if i == 4 {
            tensors.push((format!("{name}.0.bias"), vec![w[1]]));
        } else {
            for what in ["weight", "bias", "running_mean", "running_var"] {
                tensors.push((format!("{name}.1.{what}"), vec![w[1]]));
            }
        }
    }
    file(
        &tensors,
        &serde_json::to_string(contract).expect("a contract is JSON"),
    )
}

/// Safetensors of f16 ones and halves.
fn file(tensors: &[(String, Vec<usize>)], contract: &str) -> Vec<u8> {
    let mut header = serde_json::Map::new();
    header.insert("__metadata__".into(), json!({ "contract": contract }));
    let mut data = Vec::new();
    for (name, shape) in tensors {
        let from = data.len();
        for i in 0..shape.iter().product::<usize>() {
            data.extend_from_slice(&[0x00, if i % 3 == 0 { 0x3C } else { 0x38 }]);
        }
        let entry = json!({ "dtype": "F16", "shape": shape, "data_offsets": [from, data.len()] });
        header.insert(name.clone(), entry);
    }
    let mut header = Value::Object(header).to_string();
    while !header.len().is_multiple_of(8) {
        header.push(' ');
    }
    let length = (header.len() as u64).to_le_bytes();
    [&length[..], header.as_bytes(), &data].concat()
}

fn model() -> Vec<u8> {
    let network = Network::parse(NETWORK).expect("the seed is a network");
    Model::from_safetensors(&stage1(), network)
        .and_then(|m| m.with_stage2(&stage2()))
        .and_then(|m| m.quantise(None))
        .and_then(|m| m.to_bytes())
        .expect("the seeds make a model")
}

/// Writes the right digest into what may be a model file: the 64 digits after its key, which count as zeros.
pub fn sign(bytes: &mut [u8]) {
    const KEY: &[u8] = br#"\"blake3\":\""#;
    let Some(at) = bytes.windows(KEY.len()).position(|w| w == KEY) else {
        return;
    };
    let at = at + KEY.len();
    let Some(digits) = bytes.get_mut(at..at + 64) else {
        return;
    };
    digits.fill(b'0');
    let digest = blake3::hash(bytes).to_hex();
    bytes[at..at + 64].copy_from_slice(digest.as_bytes());
}

fn picture() -> Frame {
    let (width, height) = (16, 8);
    Frame {
        width,
        height,
        rgb: (0..3 * width * height).map(|i| (i * 11) as u8).collect(),
        ..Frame::default()
    }
}

fn avi() -> Vec<u8> {
    let mut writer =
        AviWriter::new(Cursor::new(Vec::new()), 16, 8, (30, 1)).expect("memory can be written");
    for _ in 0..3 {
        writer
            .write_frame(&picture(), 50)
            .expect("memory can be written");
    }
    writer.finish().expect("memory can be written").into_inner()
}

/// Two pictures of H.264, made once by `ffmpeg -f lavfi -i testsrc=s=32x16:d=0.08 -c:v libx264 -profile:v baseline`.
fn mp4() -> Vec<u8> {
    include_bytes!("../seeds/tiny.mp4").to_vec()
}

fn y4m(layout: &str, bytes: usize) -> Vec<u8> {
    let mut film = format!("YUV4MPEG2 W4 H4 F30:1 Ip A1:1 C{layout}\n").into_bytes();
    for k in 0..3 {
        film.extend_from_slice(b"FRAME\n");
        film.extend((0..bytes).map(|i| (i * 9 + k) as u8));
    }
    film
}

fn encoded(format: image::ImageFormat) -> Vec<u8> {
    let frame = picture();
    let picture = image::RgbImage::from_raw(frame.width, frame.height, frame.rgb)
        .expect("the picture has all its bytes");
    let mut bytes = Cursor::new(Vec::new());
    picture
        .write_to(&mut bytes, format)
        .expect("memory can be written");
    bytes.into_inner()
}

fn jpeg() -> Vec<u8> {
    encoded(image::ImageFormat::Jpeg)
}

fn png() -> Vec<u8> {
    encoded(image::ImageFormat::Png)
}

/// Turned by a quarter, as phones write it.
fn exif_jpeg() -> Vec<u8> {
    let tiff = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    let mut segment = vec![0xFF, 0xE1, 0, (8 + tiff.len()) as u8];
    segment.extend_from_slice(b"Exif\0\0");
    segment.extend_from_slice(tiff);
    let plain = jpeg();
    [&plain[..2], &segment, &plain[2..]].concat()
}

fn observations() -> Vec<u8> {
    let lines: Vec<String> = (0..3).map(|k| line(&observation_frame(k))).collect();
    lines.join("\n").into_bytes()
}

/// Bodies as JSON lines.
fn bodies() -> Vec<u8> {
    let rows = (0..3).map(|k| BodiesRow::new(&body_frame(k), ""));
    let lines = rows.map(|row| serde_json::to_string(&row).expect("a row is JSON"));
    lines.collect::<Vec<_>>().join("\n").into_bytes()
}

/// Three messages as a binary record.
fn binary_record<T: Row>(message: &dyn Fn(u64) -> Box<T::Message>) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("there is room for a folder");
    let path = folder.path().join("seed.ecr");
    let mut writer =
        RecordWriter::<T>::create(&path, Format::Binary).expect("the folder can be written");
    for k in 0..3 {
        let written = writer.write(&message(k), "a.mp4");
        written.expect("the folder can be written");
    }
    writer.finish().expect("the folder can be written");
    std::fs::read(path).expect("what was written can be read")
}

/// A body of four vertices in SMPL's format, with a sparse regressor and pose correctives or without.
fn body(sparse: bool) -> Vec<u8> {
    let corners = [
        [0.0, 0.0, 0.0],
        [0.2, -0.9, 0.0],
        [-0.2, -0.9, 0.1],
        [0.0, 0.6, 0.0],
    ];
    // The left side hangs on the second vertex, the right one on the third, the head on the fourth.
    let vertex = |joint: usize| match joint {
        1 | 4 | 7 | 10 => 1_usize,
        2 | 5 | 8 | 11 => 2,
        15 => 3,
        _ => 0,
    };
    let on_vertex = |rows: bool| -> Vec<f32> {
        let number = |i: usize| {
            let (vertex_of, joint) = if rows {
                (i % 4, i / 4)
            } else {
                (i / JOINTS, i % JOINTS)
            };
            let own = if rows {
                vertex(joint) == vertex_of
            } else {
                joint == vertex_of
            };
            f32::from(u8::from(own))
        };
        (0..4 * JOINTS).map(number).collect()
    };
    let tree: Vec<i64> = PARENTS.iter().map(|p| *p as i64).chain(0..24).collect();
    let indices: Vec<i64> = (0..JOINTS).map(|j| vertex(j) as i64).collect();
    let starts: Vec<i64> = (0..=JOINTS as i64).collect();
    let (template, shapes) = (corners.as_flattened(), [0.01; 24]);
    let (dense, weights) = (on_vertex(true), on_vertex(false));
    let (ones, correctives) = ([1.0; JOINTS], vec![0.001; 12 * 9 * (JOINTS - 1)]);
    let array = |name, shape, data| Array { name, shape, data };
    let mut arrays = vec![
        array("v_template", &[4, 3][..], Values::F32(template)),
        array("f", &[2, 3], Values::I64(&[0, 1, 2, 1, 2, 3])),
        array("shapedirs", &[4, 3, 2], Values::F32(&shapes)),
        array("weights", &[4, JOINTS], Values::F32(&weights)),
        array("kintree_table", &[2, JOINTS], Values::I64(&tree)),
    ];
    if sparse {
        arrays.extend([
            array("J_regressor_data", &[JOINTS][..], Values::F32(&ones)),
            array("J_regressor_indices", &[JOINTS], Values::I64(&indices)),
            array("J_regressor_indptr", &[JOINTS + 1], Values::I64(&starts)),
            array(
                "posedirs",
                &[4, 3, 9 * (JOINTS - 1)],
                Values::F32(&correctives),
            ),
        ]);
    } else {
        arrays.push(array("J_regressor", &[JOINTS, 4], Values::F32(&dense)));
    }
    npz::write(&arrays).expect("arrays are as long as their shapes say")
}

/// Writes the right checksums into what may be an archive of files that are not compressed, where its directory has
/// them.
pub fn sign_archive(bytes: &mut [u8]) {
    const ENTRY: &[u8] = b"PK\x01\x02";
    const HEAD: usize = 46;
    let number = |bytes: &[u8], at: usize, long: usize| {
        let part = bytes.get(at..at + long)?;
        Some(
            part.iter()
                .rev()
                .fold(0_usize, |n, b| n << 8 | usize::from(*b)),
        )
    };
    let starts: Vec<usize> = bytes
        .windows(ENTRY.len())
        .enumerate()
        .filter_map(|(at, w)| (w == ENTRY && at + HEAD <= bytes.len()).then_some(at))
        .collect();
    for at in starts {
        let data = (|| {
            let (length, local) = (number(bytes, at + 20, 4)?, number(bytes, at + 42, 4)?);
            let names = number(bytes, local + 26, 2)? + number(bytes, local + 28, 2)?;
            bytes.get(local + 30 + names..local + 30 + names + length)
        })();
        if let Some(sum) = data.map(crc32) {
            bytes[at + 16..at + 20].copy_from_slice(&sum.to_le_bytes());
        }
    }
}

/// ISO 3309's checksum, as zip archives have it.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| {
            (sum >> 1) ^ if sum & 1 == 1 { 0xEDB8_8320 } else { 0 }
        })
    })
}

/// A frame as `infer --jsonl` writes it.
fn line(frame: &ObservationFrame) -> String {
    let i = frame.intrinsics;
    let people: Vec<Value> = frame
        .people()
        .iter()
        .map(|p| {
            json!({ "score": p.score, "joints2d": p.joints2d, "joints3d": p.joints3d,
                    "appearance": { "hue": p.hue, "saturation": p.saturation } })
        })
        .collect();
    json!({ "frame": frame.sequence, "time_ns": frame.capture_ns, "source": "a.mp4", "width": frame.width,
            "height": frame.height, "intrinsics": { "fx": i.fx, "fy": i.fy, "cx": i.cx, "cy": i.cy },
            "people": people })
    .to_string()
}

/// One person before the camera, `k` frames after the first.
pub fn observation_frame(k: u64) -> Box<ObservationFrame> {
    let mut frame = Box::new(ObservationFrame {
        sequence: k,
        capture_ns: 1_000_000_000 + k * 33_000_000,
        width: 640,
        height: 480,
        intrinsics: Intrinsics::from_horizontal_fov(640, 480, 60.0),
        count: 1,
        ..ObservationFrame::default()
    });
    let person = &mut frame.people[0];
    person.score = 0.9;
    for j in 0..BODY_JOINTS {
        let (across, down) = ((j % 3) as f32 - 1.0, (j / 3) as f32 / 7.0 - 0.5);
        person.joints3d[j] = [0.2 * across, 1.6 * down, 0.05 * across];
        if j < EVIDENCE_JOINTS {
            person.joints2d[j] = [320.0 + 30.0 * across + k as f32, 240.0 + 250.0 * down, 0.8];
        }
    }
    person.hue[3] = 1.0;
    person.saturation[5] = 1.0;
    frame
}

/// A frame of one body, 30 a second.
fn body_frame(k: u64) -> Box<BodyFrame> {
    let mut frame = Box::new(BodyFrame {
        count: 1,
        sequence: k,
        pose_ns: k * 33_333_333,
        ..BodyFrame::default()
    });
    frame.bodies[0] = Body {
        id: 1,
        state: edgecap::message::BodyState::TRACKED,
        score: 0.5,
        height: 1.7,
        ..Body::default()
    };
    frame
}

fn messages() -> Vec<Vec<u8>> {
    // People after the first are zeros, which need not be written.
    let head = |bytes: &[u8], kind: u8| [&[kind], &bytes[..bytes.len().min(2048)]].concat();
    vec![
        head(&to_bytes(&*observation_frame(0)), 0),
        head(&to_bytes(&*body_frame(0)), 1),
    ]
}

/// Bytes of the header of a stream's file (`clients/rust/src/ring/mod.rs`).
pub const RING_HEADER: usize = 64;
/// Where its count is.
pub const RING_COUNT: Range<usize> = 32..40;
/// Where its publisher's last sign of life is.
pub const RING_ALIVE: Range<usize> = 40..48;

/// The file of a stream of events with so many messages, of which one is here; then the count that comes next.
fn ring(count: u64, next: u64) -> Vec<u8> {
    let (version, size) = (EventFrame::VERSION, size_of::<EventFrame>() as u32);
    let slots = edgecap_client::BUFFER as u32 + 1;
    let mut bytes = b"EDGECAP\x01".to_vec();
    for number in [version, size, slots, 0] {
        bytes.extend(number.to_ne_bytes());
    }
    for number in [1, count, 0, 0, 0_u64] {
        bytes.extend(number.to_ne_bytes());
    }
    let message = EventFrame {
        count: 1,
        ..EventFrame::default()
    };
    bytes.extend(&to_bytes(&message)[..128]);
    bytes.extend(next.to_ne_bytes());
    bytes
}

const REQUEST: &str = "GET /bodies?format=json&camera=hall HTTP/1.1\r\nHost: localhost:1\r\nOrigin: http://localhost:1\r\n\r\n";

/// A message from the bytes of shared memory; what `bytes` lacks is zero.
///
/// # Panics
/// When there are more bytes than the message has.
pub fn from_bytes<T: Message>(bytes: &[u8]) -> Box<T> {
    let mut message = Box::new(T::default());
    let (given, rest) = message.as_mut_bytes().split_at_mut(bytes.len());
    given.copy_from_slice(bytes);
    rest.fill(0);
    message
}

fn to_bytes<T: Message>(message: &T) -> Vec<u8> {
    message.as_bytes().to_vec()
}
