//! Truth and predictions that cannot be read or measured, and records that were cut off.

use edgecap::lab::eval::{
    EvalError, EvalOptions, Format, Predictions, ReadOptions, TruthSet, evaluate,
};
use edgecap::message::ObservationFrame;
use edgecap::record::{self, ObservationsRow, RecordWriter};

use super::{exact, line, observation, synthetic};

#[test]
fn truth_of_another_version_is_refused() {
    let parse = |text: &str| TruthSet::parse(text, "t", Format::Auto, None);
    for (format, version) in [("edgecap-truth", 2), ("edgecap-world", 1)] {
        let text = serde_json::json!({
            "format": format, "version": version, "fps": 25.0, "frames": [{"of": "another layout"}],
        });
        let said = parse(&text.to_string()).unwrap_err().to_string();
        let expected =
            format!("t: expected edgecap-truth version 1, found {format} version {version};");
        assert!(said.starts_with(&expected), "{said}");
        let is_another_file = said.contains("calls truth.json");
        assert_eq!(is_another_file, format == "edgecap-world", "{said}");
    }
    assert!(parse(r#"{"fps": 0.0, "frames": []}"#).is_ok());
}

#[test]
fn what_cannot_be_read_is_said() {
    let error = |r: Result<TruthSet, EvalError>| r.unwrap_err().to_string();
    let unknown = error(TruthSet::parse("{}", "t.json", Format::Auto, None));
    assert!(
        unknown.contains("t.json") && unknown.contains("--format"),
        "{unknown}"
    );
    let text = format!("{}\nno json", line(0, "a", ""));
    let bad = Predictions::parse(&text, "p.jsonl")
        .unwrap_err()
        .to_string();
    assert!(bad.contains("p.jsonl, line 2"), "{bad}");
    let short = r#"{"frame":0,"people":[{"score":1,"joints2d":[[1,2,3]],"joints3d":[[0,0,0]]}]}"#;
    let bad = Predictions::parse(short, "p").unwrap_err().to_string();
    assert!(bad.contains("21 joints3d"), "{bad}");
    let truth = r#"[{"file":"a.jpg","split":"test","joints":[[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1],[1,2,1]]}]"#;
    let truth = TruthSet::parse(truth, "t", Format::Auto, None).unwrap();
    let predictions = Predictions::parse(&line(0, "b.jpg", ""), "p").unwrap();
    let bad = evaluate(&predictions, &truth, &EvalOptions::default());
    assert!(matches!(
        bad,
        Err(EvalError::Disjoint {
            truth: 1,
            predictions: 1
        })
    ));
}

#[test]
fn an_empty_file_is_named_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty.json");
    for text in ["", " \n\n"] {
        std::fs::write(&path, text).unwrap();
        for format in [Format::Auto, Format::Npz] {
            let options = ReadOptions {
                format,
                ..ReadOptions::default()
            };
            let said = TruthSet::read(&path, &options).unwrap_err().to_string();
            let expected = "empty.json: expected ground truth, found an empty file; copy it again";
            assert!(said.contains(expected), "{said}");
        }
        let said = Predictions::read(&path).unwrap_err().to_string();
        let expected = "empty.json: expected a record of one frame or more, found no frame in it; record again";
        assert!(said.ends_with(expected), "{said}");
    }
}

#[test]
fn truth_that_cannot_be_is_refused() {
    let said = |r: Result<TruthSet, EvalError>| r.unwrap_err().to_string();
    let flat = said(synthetic(|p| p["stature"] = 0.0.into()));
    assert!(flat.contains("stature"), "{flat}");
    let coco = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut person = serde_json::json!({
            "image_id": 1, "category_id": 1, "keypoints": [9, 9, 2, 5, 5, 2], "bbox": [0, 0, 9, 9], "area": 50.0,
        });
        change(&mut person);
        let truth = serde_json::json!({
            "images": [{"id": 1, "file_name": "a.jpg", "width": 64, "height": 32}],
            "categories": [{"id": 1, "keypoints": ["left_hip", "right_hip"]}, {"id": 2, "name": "chair"}],
            "annotations": [person],
        });
        TruthSet::parse(&truth.to_string(), "t", Format::Auto, None)
    };
    let good = coco(&|_| ()).unwrap();
    assert_eq!(good.frames[0].size, Some([64.0, 32.0]));
    for area in [-5000.0, 0.0] {
        let said = said(coco(&|p| p["area"] = area.into()));
        assert!(said.contains("image 1") && said.contains("area"), "{said}");
    }
    let short = said(coco(&|p| p["keypoints"] = vec![9, 9, 2].into()));
    assert!(short.contains("6 numbers of 2 keypoints"), "{short}");
    // A chair is nobody, and without anybody there is nothing to measure.
    let chair = coco(&|p| p["category_id"] = 2.into()).unwrap();
    assert!(chair.frames[0].people.is_empty());
    let predictions = Predictions::parse(&line(0, "a.jpg", ""), "p").unwrap();
    for nobody in [
        chair,
        coco(&|p| p["keypoints"] = serde_json::json!([])).unwrap(),
    ] {
        let said = evaluate(&predictions, &nobody, &EvalOptions::default()).unwrap_err();
        assert!(said.to_string().contains("--no-people"), "{said}");
    }
}

#[test]
fn observations_and_bodies_are_not_mixed() {
    let seen = |k: u64| line(k, "a.jpg", &observation(0.8, &exact()));
    let body = |k: u64| seen(k).replace("\"joints2d\"", "\"position\":[0,0,4],\"joints2d\"");
    let parse = |lines: &[String]| Predictions::parse(&lines.join("\n"), "p");
    let said = parse(&[seen(0), body(1)]).unwrap_err().to_string();
    assert!(
        said.contains("p, line 2") && said.contains("bodies"),
        "{said}"
    );
    let mut one = parse(&[seen(0)]).unwrap();
    let said = one.append(parse(&[body(1)]).unwrap(), "q").unwrap_err();
    assert!(
        said.to_string().contains("q: expected observations"),
        "{said}"
    );
    one.append(parse(&[seen(1)]).unwrap(), "r").unwrap();
    // A run that found nobody has bodies all the same, and missed everybody.
    let fitted = |k: u64| line(k, "", "").replace("\"people\"", "\"fit_us\":9,\"people\"");
    let nobody = parse(&[fitted(0)]).unwrap();
    assert!(nobody.bodies);
    let truth = synthetic(|_| ()).unwrap();
    let report = evaluate(&nobody, &truth, &EvalOptions::default()).unwrap();
    let identity = report.identity.unwrap();
    assert_eq!((identity.truth, identity.predicted), (1, 0));
}

#[test]
fn bodies_in_the_axes_of_a_calibration_are_refused() {
    let world = |[x, y, z]: [f64; 3], state: &str| {
        let turn = "[-0.7071,0.0,0.0,0.7071]";
        format!(r#""world":{{"rotation":{turn},"translation":[{x},{y},{z}],"state":"{state}"}}"#)
    };
    let lens =
        |focal: f64| format!(r#""intrinsics":{{"fx":{focal},"fy":{focal},"cx":255.5,"cy":159.5}}"#);
    let body = observation(0.8, &exact()).replace("\"score\"", "\"position\":[0,0,4],\"score\"");
    let measured = |about: &[String]| {
        let with = |frame: u64, about: &str| {
            line(frame, "", &body).replace("\"people\"", &format!("{about},\"people\""))
        };
        let plain = with(0, &lens(440.0));
        let text = format!("{plain}\n{}", with(1, &about.join(",")));
        let mut all = Predictions::parse(&plain.replace("\"frame\":0", "\"frame\":7"), "o")?;
        all.append(Predictions::parse(&text, "p")?, "p")?;
        evaluate(&all, &synthetic(|_| ()).unwrap(), &EvalOptions::default())
    };
    let from_one = [lens(440.0), world([0.0; 3], "given")];
    for refused in [
        &from_one[..],
        &[lens(0.0), world([0.0; 3], "given")],
        &[lens(0.0)],
    ] {
        let said = measured(refused).unwrap_err().to_string();
        assert!(
            said.starts_with("p, line 2: expected bodies in camera axes"),
            "{said}"
        );
    }
    // The floor of a camera alone is somewhere below it.
    for state in ["given", "estimated"] {
        let about = [lens(440.0), world([0.0, 1.4, 0.0], state)];
        assert_eq!(measured(&about).unwrap().pose3d.unwrap().people, 1);
    }
}

#[test]
fn records_that_were_cut_off_are_read_to_their_last_whole_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p");
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        Predictions::read(&path).map(|p| p.frames.len())
    };
    let first = line(0, "straße.jpg", &observation(0.8, &exact())) + "\n";
    let text = first.clone() + &line(1, "straße.jpg", &observation(0.8, &exact()));
    assert_eq!(read(text.as_bytes()).unwrap(), 2);
    for cut in first.len() + 1..text.len() {
        assert_eq!(read(&text.as_bytes()[..cut]).unwrap(), 1, "{cut}");
    }
    // As file systems leave it after a power cut.
    let mut zeros = text.as_bytes()[..first.len() + 30].to_vec();
    zeros.resize(4096, 0);
    assert_eq!(read(&zeros).unwrap(), 1);
    // What is wrong in the middle, or from the first line on, was not cut off.
    let said = read(format!("{}\n{text}", &first[..40]).as_bytes()).unwrap_err();
    assert!(said.to_string().contains("line 1"), "{said}");
    let said = read(format!("{first}{}\n{first}", &first[..40]).as_bytes()).unwrap_err();
    assert!(said.to_string().contains("line 2"), "{said}");
    assert!(read(&first.as_bytes()[..40]).is_err());

    let mut writer =
        RecordWriter::<ObservationsRow>::create(&path, record::Format::Binary).unwrap();
    let mut message = ObservationFrame {
        count: 1,
        ..ObservationFrame::default()
    };
    for k in 0..2 {
        message.sequence = k;
        writer.write(&message, "a.jpg").unwrap();
    }
    writer.finish().unwrap();
    let whole = std::fs::read(&path).unwrap();
    assert_eq!(read(&whole).unwrap(), 2);
    assert_eq!(read(&whole[..whole.len() - 3]).unwrap(), 1);
    let said = read(&whole[..40]).unwrap_err().to_string();
    assert!(said.contains("inside its first frame"), "{said}");
}
