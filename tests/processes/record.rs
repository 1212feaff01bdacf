//! Records: everything that a message holds comes back, in both formats, and a cut file plays to its last whole frame.

use std::path::Path;

use edgecap::camera::to_lens;
use edgecap::message::{
    Body, BodyFrame, BodyState, Intrinsics, JointState, MAX_PEOPLE, Observation, ObservationFrame,
    StageTimes, World, WorldState,
};
use edgecap::record::{
    BodiesRow, CameraSource, Format, Kind, ObservationReader, ObservationsRow, RecordError,
    RecordWriter, Row, RowReader, lines,
};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

use crate::program::assert_fails;

const FOV: CameraSource<'static> = CameraSource::Recorded { fov_degrees: 60.0 };
const FORMATS: [Format; 2] = [Format::Jsonl, Format::Binary];

/// A rotation, with all its bits.
fn rotation(rng: &mut SmallRng) -> [f32; 4] {
    let q: [f32; 4] = std::array::from_fn(|_| rng.random_range(0.1f32..1.0));
    let length = q.iter().map(|v| v * v).sum::<f32>().sqrt();
    q.map(|v| v / length)
}

/// Numbers of every magnitude, with all their bits.
fn number(rng: &mut SmallRng) -> f32 {
    rng.random_range(-1.0f32..1.0) * 10f32.powi(rng.random_range(-20..20))
}

fn observations(rng: &mut SmallRng) -> ObservationFrame {
    let mut frame = ObservationFrame {
        sequence: rng.random(),
        capture_ns: rng.random(),
        publish_ns: rng.random_range(1..u64::MAX),
        width: rng.random_range(1..u32::MAX),
        height: rng.random_range(1..u32::MAX),
        intrinsics: Intrinsics {
            fx: number(rng).abs() + 1.0,
            fy: number(rng).abs() + 1.0,
            cx: number(rng),
            cy: number(rng),
        },
        stage_times: StageTimes {
            preprocess_us: rng.random(),
            stage1_us: rng.random(),
            association_us: rng.random(),
            stage2_us: rng.random(),
        },
        flags: rng.random(),
        without_neck: rng.random(),
        count: rng.random_range(0..=MAX_PEOPLE as u32),
        frame_total: rng.random(),
        ..ObservationFrame::default()
    };
    let count = frame.count as usize;
    for (k, o) in frame.people[..count].iter_mut().enumerate() {
        *o = Observation {
            score: 1.0 - k as f32 / 64.0,
            joints2d: std::array::from_fn(|_| [number(rng), number(rng), rng.random()]),
            joints3d: std::array::from_fn(|_| [number(rng), number(rng), number(rng)]),
            hue: std::array::from_fn(|_| number(rng).abs()),
            saturation: std::array::from_fn(|_| number(rng).abs()),
        };
    }
    frame
}

fn bodies(rng: &mut SmallRng) -> BodyFrame {
    let from = observations(rng);
    let mut frame = BodyFrame {
        sequence: from.sequence,
        capture_ns: from.capture_ns,
        pose_ns: rng.random(),
        publish_ns: from.publish_ns,
        width: from.width,
        height: from.height,
        intrinsics: from.intrinsics,
        stage_times: from.stage_times,
        fit_us: rng.random(),
        flags: from.flags,
        count: from.count,
        frame_total: from.frame_total,
        ..BodyFrame::default()
    };
    if rng.random() {
        frame.world = World {
            rotation: rotation(rng),
            translation: std::array::from_fn(|_| number(rng)),
            state: [WorldState::ESTIMATED, WorldState::GIVEN][rng.random_range(0..2)],
        };
    }
    for body in &mut frame.bodies[..from.count as usize] {
        let states = [
            JointState::PREDICTED,
            JointState::OCCLUDED,
            JointState::OBSERVED,
        ];
        *body = Body {
            id: rng.random(),
            state: [BodyState::TRACKED, BodyState::PREDICTED][rng.random_range(0..2)],
            score: number(rng),
            position: std::array::from_fn(|_| number(rng)),
            orientation: rotation(rng),
            velocity: std::array::from_fn(|_| number(rng)),
            angles: std::array::from_fn(|_| number(rng)),
            joints3d: std::array::from_fn(|_| std::array::from_fn(|_| number(rng))),
            joints2d: std::array::from_fn(|_| std::array::from_fn(|_| number(rng))),
            confidence: std::array::from_fn(|_| number(rng)),
            height: number(rng),
            bone_lengths: std::array::from_fn(|_| number(rng)),
            bone_rotations: std::array::from_fn(|_| rotation(rng)),
            joint_states: std::array::from_fn(|_| states[rng.random_range(0..3)]),
            reserved: [0; 3],
        };
    }
    frame
}

fn written<T: Row>(messages: &[T::Message], source: &str, format: Format, path: &Path) -> Vec<u8> {
    let mut writer = RecordWriter::<T>::create(path, format).unwrap();
    for message in messages {
        writer.write(message, source).unwrap();
    }
    writer.finish().unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn every_message_comes_back_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("record");
    let mut rng = SmallRng::seed_from_u64(1);
    let seen: Vec<_> = (0..40).map(|_| observations(&mut rng)).collect();
    let fitted: Vec<_> = (0..40).map(|_| bodies(&mut rng)).collect();
    for format in FORMATS {
        let bytes = written::<ObservationsRow>(&seen, "a \"film\".mp4", format, &path);
        let mut reader = ObservationReader::new(&bytes[..], "record", FOV);
        let mut back = ObservationFrame::default();
        for message in &seen {
            assert!(reader.read(&mut back).unwrap());
            assert!(back == *message, "{format:?}");
            assert_eq!(reader.source(), "a \"film\".mp4");
        }
        assert!(!reader.read(&mut back).unwrap() && !reader.was_cut());

        let bytes = written::<BodiesRow>(&fitted, "b", format, &path);
        let mut reader = RowReader::<_, BodiesRow>::new(&bytes[..], "record");
        for message in &fitted {
            assert!(
                reader.read().unwrap().unwrap().message() == *message,
                "{format:?}"
            );
        }
        assert!(reader.read().unwrap().is_none());
    }
}

#[test]
fn a_cut_file_plays_to_its_last_whole_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("record");
    let mut rng = SmallRng::seed_from_u64(2);
    let mut small = || {
        let mut frame = observations(&mut rng);
        frame.count = frame.count.min(2);
        frame
    };
    let seen: Vec<_> = (0..3).map(|_| small()).collect();
    for format in FORMATS {
        let bytes = written::<ObservationsRow>(&seen, "", format, &path);
        let two = written::<ObservationsRow>(&seen[..2], "", format, &path).len();
        for end in [two + 1, two + 5, (two + bytes.len()) / 2, bytes.len() - 2] {
            let mut reader = RowReader::<_, ObservationsRow>::new(&bytes[..end], "record");
            for _ in 0..2 {
                assert!(reader.read().unwrap().is_some());
            }
            assert!(reader.read().unwrap().is_none(), "{format:?} cut at {end}");
            assert!(reader.was_cut());
        }
    }
}

/// The rows of a record and whether it was cut, or what is wrong with it.
fn read_all<T: Row>(bytes: &[u8]) -> Result<(usize, bool), String> {
    let mut reader = RowReader::<_, T>::new(bytes, "record");
    let mut rows = 0;
    while reader.read().map_err(|e| e.to_string())?.is_some() {
        rows += 1;
    }
    assert_eq!(reader.line(), rows);
    Ok((rows as usize, reader.was_cut()))
}

#[test]
fn zeros_that_a_power_cut_leaves_are_no_frame_and_damage_before_the_end_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("record");
    let mut rng = SmallRng::seed_from_u64(5);
    let mut small = || {
        let mut frame = bodies(&mut rng);
        frame.count = 1;
        frame
    };
    let fitted: Vec<_> = (0..3).map(|_| small()).collect();
    for format in FORMATS {
        let whole = written::<BodiesRow>(&fitted, "", format, &path);
        let two = written::<BodiesRow>(&fitted[..2], "", format, &path).len();
        for zeros in [1, 4, 4096, 100_001, 9 << 20] {
            let padded = [&whole[..], &vec![0; zeros]].concat();
            assert_eq!(read_all::<BodiesRow>(&padded), Ok((3, true)), "{format:?}");
        }
        // The file was made longer before the last frame's bytes had come.
        let mut holed = whole.clone();
        holed[two + 300..].fill(0);
        holed.resize(holed.len() + 4096, 0);
        assert_eq!(read_all::<BodiesRow>(&holed), Ok((2, true)), "{format:?}");

        let one = written::<BodiesRow>(&fitted[..1], "", format, &path).len();
        let mut damaged = whole;
        let end = match format {
            Format::Binary => two,
            // Its line stays one.
            Format::Jsonl => two - 1,
        };
        damaged[one + 4..end].fill(0);
        let found = read_all::<BodiesRow>(&damaged).unwrap_err();
        let words = match format {
            Format::Binary => ["record, frame 2: expected a whole frame", "copy it again"],
            Format::Jsonl => ["record, line 2: expected one frame", "remove the line"],
        };
        for word in words {
            assert!(found.contains(word), "{found}");
        }
        assert!(
            !found.contains("remove the line") || format == Format::Jsonl,
            "{found}"
        );
    }
    // What is no record from its first line on was not cut off.
    for other in [&b"{\"x\": 1}"[..], b"\0\0\0\0", b"some words"] {
        assert!(read_all::<BodiesRow>(other).unwrap_err().contains("line 1"));
    }
}

#[test]
fn bodies_with_numbers_that_no_message_holds_are_refused() {
    let frame = BodyFrame {
        count: 1,
        world: World {
            state: WorldState::GIVEN,
            ..World::default()
        },
        ..BodyFrame::default()
    };
    let good = serde_json::to_value(BodiesRow::new(&frame, "")).unwrap();
    assert_eq!(
        read_all::<BodiesRow>(good.to_string().as_bytes()),
        Ok((1, false))
    );
    let huge = serde_json::json!(1e39);
    let none = serde_json::json!([0.0, 0.0, 0.0, 0.0]);
    for (place, bad, expected) in [
        (
            "/people/0/orientation",
            &none,
            "in orientation, a quaternion",
        ),
        ("/people/0/bone_rotations/3", &none, "in bone_rotations"),
        ("/world/rotation", &none, "in world.rotation"),
        ("/world/translation/1", &huge, "inf in world.translation"),
        ("/people/0/joints3d/4/1", &huge, "inf in joints3d"),
        ("/people/0/joints2d/4/1", &huge, "inf in joints2d"),
        ("/people/0/position/0", &huge, "inf in position"),
        ("/people/0/height", &huge, "inf in height"),
        ("/people/0/bone_lengths/7", &huge, "inf in bone_lengths"),
    ] {
        let mut row = good.clone();
        *row.pointer_mut(place).unwrap() = bad.clone();
        let found = read_all::<BodiesRow>(format!("{row}\n").as_bytes()).unwrap_err();
        assert!(found.contains(expected), "{place}: {found}");
    }
    // Binary can hold what JSON has no word for.
    let folder = tempfile::tempdir().unwrap();
    let mut wrong = frame;
    wrong.bodies[0].angles[3] = f32::NAN;
    let path = folder.path().join("record");
    let bytes = written::<BodiesRow>(&[wrong], "", Format::Binary, &path);
    let found = read_all::<BodiesRow>(&bytes).unwrap_err();
    assert!(
        found.contains("frame 1") && found.contains("NaN in angles"),
        "{found}"
    );
}

#[test]
fn binary_is_read_wherever_lines_are_and_is_much_smaller() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("record");
    let mut rng = SmallRng::seed_from_u64(3);
    let fitted: Vec<_> = (0..3).map(|_| bodies(&mut rng)).collect();
    let json = written::<BodiesRow>(&fitted, "film", Format::Jsonl, &path);
    let binary = written::<BodiesRow>(&fitted, "film", Format::Binary, &path);
    assert!(
        binary.len() * 2 < json.len(),
        "{} {}",
        binary.len(),
        json.len()
    );
    for either in [&binary, &json] {
        let as_json = lines(either.clone(), "record").unwrap();
        assert_eq!(as_json, (json.clone(), false));
    }
    // Not what was asked for, and damaged.
    let mut reader = RowReader::<_, ObservationsRow>::new(&binary[..], "record");
    let found = reader.read().unwrap_err().to_string();
    assert!(
        found.contains("expected observations, found bodies"),
        "{found}"
    );
    let mut damaged = binary;
    damaged[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    // A length that no frame has, and a file that ends before its first frame.
    for bytes in [&damaged[..], &damaged[..5]] {
        let mut reader = RowReader::<_, BodiesRow>::new(bytes, "record");
        let found = reader.read().unwrap_err();
        assert!(
            matches!(found, RecordError::Frame { frame: 1, .. }),
            "{found}"
        );
        std::fs::write(&path, bytes).unwrap();
        let to = folder.path().join("a.csv");
        let export = ["export", path.to_str().unwrap(), "--to"];
        assert_fails(
            &[&export[..], &[to.to_str().unwrap()]].concat(),
            65,
            &["frame 1"],
        );
    }
}

#[test]
fn lines_have_the_documented_keys() {
    let mut rng = SmallRng::seed_from_u64(4);
    let mut frame = bodies(&mut rng);
    frame.count = 1;
    frame.bodies[0].state = BodyState::PREDICTED;
    let row = serde_json::to_value(BodiesRow::new(&frame, "x")).unwrap();
    assert_eq!(row["people"][0]["state"], "predicted");
    for (key, length) in [
        ("position", 3),
        ("orientation", 4),
        ("velocity", 3),
        ("angles", 29),
        ("joints3d", 21),
        ("joints2d", 21),
        ("joint_confidence", 21),
        ("joint_states", 21),
        ("bone_lengths", 21),
        ("bone_rotations", 16),
    ] {
        let found = row["people"][0][key].as_array().map(Vec::len);
        assert_eq!(found, Some(length), "{key}");
    }
    for key in [
        "frame",
        "time_ns",
        "width",
        "height",
        "capture_ns",
        "fit_us",
        "flags",
    ] {
        assert!(row[key].is_number(), "{key}");
    }
    frame.world = World::default();
    let row = serde_json::to_value(BodiesRow::new(&frame, "x")).unwrap();
    assert!(row["world"].is_null(), "no floor, no world");
}

fn line(extra_person: &str, extra: &str) -> String {
    let joints2d = vec!["[10.5, 20, 0.5]"; 14].join(",");
    let joints3d = vec!["[0.1, -0.2, 0.3]"; 21].join(",");
    format!(
        r#"{{"frame": 7, "time_ns": 5000, "source": "a.mp4", "width": 640, "height": 480, {extra}
           "people": [{{"score": 0.8, "joints2d": [{joints2d}], "joints3d": [{joints3d}] {extra_person}}}]}}"#
    )
    .replace('\n', " ")
}

#[test]
fn lines_of_other_programs_may_leave_out_what_they_do_not_know() {
    let text = format!(
        "\n{}\n\n{}",
        line("", ""),
        line("", "").replace("a.mp4", "b.png")
    );
    let mut reader = ObservationReader::new(text.as_bytes(), "o.jsonl", FOV);
    let mut frame = ObservationFrame::default();
    assert!(reader.read(&mut frame).unwrap());
    assert_eq!((reader.line(), reader.source()), (2, "a.mp4"));
    assert_eq!(
        (frame.sequence, frame.capture_ns, frame.count),
        (7, 5000, 1)
    );
    assert_eq!(
        frame.intrinsics,
        Intrinsics::from_horizontal_fov(640, 480, 60.0)
    );
    assert_eq!(frame.people()[0].joints2d[13], [10.5, 20.0, 0.5]);
    assert_eq!(frame.people()[0].hue, Observation::default().hue);
    assert!(reader.read(&mut frame).unwrap());
    assert_eq!((reader.line(), reader.source()), (4, "b.png"));
    assert!(!reader.read(&mut frame).unwrap());

    // Editors and shells put a mark before a text, on a line of its own where that is empty.
    for marked in [
        format!("\u{FEFF}{text}"),
        format!("\u{FEFF}{}", text.trim()),
    ] {
        let mut reader = ObservationReader::new(marked.as_bytes(), "o.jsonl", FOV);
        for source in ["a.mp4", "b.png"] {
            assert!(reader.read(&mut frame).unwrap());
            assert_eq!(reader.source(), source);
        }
        assert!(!reader.read(&mut frame).unwrap());
        assert_eq!(Kind::of(&mut marked.as_bytes()), Some(Kind::Observations));
        let (plain, _) = lines(marked.into_bytes(), "o.jsonl").unwrap();
        assert!(!plain.starts_with("\u{FEFF}".as_bytes()));
    }
    // Elsewhere it is no line of JSON.
    let inside = format!("{0}\n\u{FEFF}{0}\n", line("", ""));
    let mut reader = ObservationReader::new(inside.as_bytes(), "o.jsonl", FOV);
    assert!(reader.read(&mut frame).unwrap() && reader.read(&mut frame).is_err());

    let text = line(
        "",
        r#""intrinsics": {"fx": 500, "fy": 501, "cx": 320, "cy": 240},"#,
    );
    let given = Intrinsics::from_horizontal_fov(640, 480, 90.0);
    for (camera, fy) in [
        (FOV, 501.0),
        (CameraSource::Given(&|_, _| Ok(given)), given.fy),
    ] {
        let mut reader = ObservationReader::new(text.as_bytes(), "o.jsonl", camera);
        assert!(reader.read(&mut frame).unwrap());
        assert_eq!(frame.intrinsics.fy, fy);
    }
}

#[test]
fn another_lens_turns_what_the_recorded_one_lifted() {
    let lens = r#""intrinsics": {"fx": 500, "fy": 500, "cx": 100, "cy": 240},"#;
    let given = Intrinsics::from_horizontal_fov(640, 480, 90.0);
    let read = |row: &str, camera| {
        let mut frame = ObservationFrame::default();
        let text = line("", row);
        let mut reader = ObservationReader::new(text.as_bytes(), "o.jsonl", camera);
        assert!(reader.read(&mut frame).unwrap());
        frame
    };
    let for_frame = |_, _| Ok(given);
    let own = CameraSource::Given(&for_frame);
    let (told, turned) = (read(lens, FOV), read(lens, own));
    let mut truth = told.people()[0];
    to_lens(&told.intrinsics, &given, std::slice::from_mut(&mut truth));
    assert_ne!(told.people()[0].joints3d, truth.joints3d);
    assert_eq!(turned.people()[0].joints3d, truth.joints3d);
    // Of what lifted joints without a lens nothing is known.
    let (as_usual, as_told) = (read("", FOV), read("", own));
    assert_eq!(as_told.people()[0].joints3d, as_usual.people()[0].joints3d);
}

#[test]
fn the_best_of_too_many_people_are_kept() {
    let whole = line("", "");
    let person = &whole[whole.find(r#"{"score"#).unwrap()..whole.rfind("]}").unwrap()];
    let many: Vec<String> = (0..40)
        .map(|i| person.replace("0.8", &format!("{}", i as f32 / 40.0)))
        .collect();
    let text = whole.replace(person, &many.join(","));
    let mut frame = ObservationFrame::default();
    ObservationReader::new(text.as_bytes(), "o.jsonl", FOV)
        .read(&mut frame)
        .unwrap();
    assert_eq!(frame.count as usize, MAX_PEOPLE);
    assert_eq!(frame.people[0].score, 39.0 / 40.0);
    assert!(frame.people().is_sorted_by(|a, b| a.score >= b.score));
}

#[test]
fn errors_name_file_line_and_fault() {
    let good = line("", "");
    let cases = [
        ("{\"frame\": 1".to_string(), "EOF"),
        ("[1, 2]".to_string(), "ObservationsRow"),
        (
            good.replace("\"time_ns\": 5000,", ""),
            "missing field `time_ns`",
        ),
        (good.replace("\"width\": 640", "\"width\": 0"), "0×480"),
        (
            good.replacen("[10.5, 20, 0.5],", "", 1),
            "13 rows in joints2d instead of 14",
        ),
        (good.replacen("[10.5, 20, 0.5]", "[10.5, 20]", 1), "length"),
        (
            good.replacen("0.1, -0.2", "1e39, -0.2", 1),
            "inf in joints3d",
        ),
        (good.replacen("20, 0.5]", "20, 1.5]", 1), "confidence 1.5"),
        (
            line(r#", "appearance": {"hue": [1], "saturation": []}"#, ""),
            "1 bins in hue",
        ),
        (
            line("", r#""intrinsics": {"fx": 0, "fy": 1, "cx": 1, "cy": 1},"#),
            "focal lengths 0",
        ),
        ("\u{fffd}\u{0}".to_string(), "expected value"),
    ];
    for (bad, expected) in cases {
        let text = format!("{good}\n{bad}\n{good}");
        let mut reader = ObservationReader::new(text.as_bytes(), "o.jsonl", FOV);
        let mut frame = ObservationFrame::default();
        assert!(reader.read(&mut frame).unwrap());
        let message = reader.read(&mut frame).unwrap_err().to_string();
        assert!(
            message.starts_with("o.jsonl, line 2: expected one frame"),
            "{message}"
        );
        assert!(
            message.contains(expected),
            "{expected:?} not in {message:?}"
        );
        assert!(
            reader.read(&mut frame).unwrap(),
            "reading goes on after a bad line"
        );
    }
}
