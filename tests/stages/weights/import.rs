//! `edgecap model import`: checks before it, second stages, networks of somebody's own.

use std::collections::HashMap;
use std::path::Path;
use std::process::Output;

use edgecap::engine::model::{Calibration, Stage2Contract};
use edgecap::engine::{CalibrationOptions, Model, Network};
use serde_json::{Value, json};

use super::{Own, SMALL, edgecap, file, lines, shapes, template};

#[test]
fn the_program_lists_them_and_says_how_many() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let network = Network::shipped("selecsls42").unwrap();
    let mut contract = template(&network);
    std::fs::write(path("right"), file(&shapes(&network), Some(&contract))).unwrap();
    let import = |name: &str| {
        edgecap(&[
            "model",
            "import",
            &path(name),
            "--arch",
            "selecsls42",
            "--check",
        ])
    };
    let out = import("right");
    assert!(out.status.success(), "{out:?}");
    let said = lines(&out.stdout);
    assert!(
        said.len() == 1 && said[0].contains("can be imported as selecsls42"),
        "{said:?}"
    );
    assert!(said[0].contains("--calibrate"), "{said:?}");
    contract["stride"] = json!(4);
    contract["limbs"] = json!([]);
    std::fs::write(path("wrong"), file(&shapes(&network), Some(&contract))).unwrap();
    let out = import("wrong");
    assert_eq!(out.status.code(), Some(65));
    assert_eq!(lines(&out.stdout).len(), 2, "{out:?}");
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(
        said.contains("2 mismatches") && said.contains("model contract"),
        "{said}"
    );
    let files = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(files, 2, "a check writes nothing");
}

/// Safetensors of a Stage II with this contract, all zeros.
fn second_stage(contract: &Value) -> Vec<u8> {
    let mut shapes: HashMap<String, Vec<usize>> = HashMap::new();
    for (i, w) in [924, 16, 16, 16, 8, 63].windows(2).enumerate() {
        shapes.insert(format!("fc{}.0.weight", i + 1), vec![w[1], w[0]]);
        if i == 4 {
            shapes.insert("fc5.0.bias".into(), vec![w[1]]);
            continue;
        }
        for part in ["weight", "bias", "running_mean", "running_var"] {
            shapes.insert(format!("fc{}.1.{part}", i + 1), vec![w[1]]);
        }
    }
    file(&shapes, Some(contract))
}

#[test]
fn a_check_says_which_file_is_wrong_and_where_its_contract_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let network = Network::shipped("selecsls42").unwrap();
    let mut contract = template(&network);
    std::fs::write(path("right"), file(&shapes(&network), Some(&contract))).unwrap();
    contract["stride"] = json!(4);
    std::fs::write(path("wrong"), file(&shapes(&network), Some(&contract))).unwrap();
    let mut second = serde_json::to_value(Stage2Contract::template()).unwrap();
    std::fs::write(path("right2"), second_stage(&second)).unwrap();
    second["output"] = json!("17 x (x, y, z)");
    std::fs::write(path("wrong2"), second_stage(&second)).unwrap();
    std::fs::write(path("a.toml"), "max_peaks = 1000000").unwrap();
    let check = |weights: &str, stage2: &str, association: Option<&str>| {
        let (weights, stage2) = (path(weights), path(stage2));
        let association = association.map(path);
        let mut args = vec![
            "model",
            "import",
            &weights,
            "--arch",
            "selecsls42",
            "--check",
        ];
        args.extend(["--stage2", &stage2]);
        if let Some(association) = &association {
            args.extend(["--association", association]);
        }
        let out = edgecap(&args);
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        (out.status.code().unwrap(), lines(&out.stdout).len(), said)
    };
    let (code, _, said) = check("right", "right2", None);
    assert_eq!(code, 0, "{said}");
    let (one, two) = ("contract --arch selecsls42`", "contract --stage2`");
    let (code, listed, said) = check("right", "wrong2", None);
    assert_eq!((code, listed), (65, 1), "{said}");
    assert!(
        said.contains("wrong2: expected weights of Stage II"),
        "{said}"
    );
    assert!(said.contains(two) && !said.contains(one), "{said}");
    let (code, listed, said) = check("wrong", "wrong2", None);
    assert_eq!((code, listed), (65, 2), "{said}");
    assert!(said.contains(two) && said.contains(one), "{said}");
    // As an import ends there.
    for (association, code, why) in [
        ("a.toml", 78, "neck_threshold"),
        ("none.toml", 66, "No such file"),
    ] {
        let (found, listed, said) = check("right", "right2", Some(association));
        assert_eq!((found, listed), (code, 0), "{said}");
        assert!(said.contains(association) && said.contains(why), "{said}");
        assert!(!said.contains("model contract"), "{said}");
        let (found, _, said) = check("wrong", "right2", Some(association));
        assert_eq!(found, 65, "{said}");
        assert!(said.contains(one) && said.contains(why), "{said}");
    }
}

#[test]
fn a_model_file_takes_another_second_stage_and_keeps_its_first() {
    let folder = tempfile::tempdir().unwrap();
    let made = folder.path().join("made.ecm");
    let (open, stage2) = (
        "models/open/edgecap-open.ecm",
        "models/weights/stage2.safetensors",
    );
    let import = ["model", "import", open, "-o", made.to_str().unwrap()];
    for (more, words) in [
        (&[][..], "--stage2 or --association"),
        (
            &["--stage2", stage2, "--calibrate", "docs"],
            "leave out --calibrate",
        ),
    ] {
        for check in [&[][..], &["--check"]] {
            let out = edgecap(&[&import[..], more, check].concat());
            let said = String::from_utf8_lossy(&out.stderr).into_owned();
            assert_eq!(out.status.code(), Some(64), "{said}");
            assert!(said.contains(words) && out.stdout.is_empty(), "{said}");
        }
    }
    let out = edgecap(&[&import[..], &["--stage2", stage2, "--check"]].concat());
    assert!(
        out.status.success() && lines(&out.stdout).len() == 1,
        "{out:?}"
    );
    let out = edgecap(&[&import[..], &["--stage2", open, "--check"]].concat());
    assert_eq!(out.status.code(), Some(65), "{out:?}");
    assert!(!made.exists());
    let out = edgecap(&[&import[..], &["--stage2", stage2]].concat());
    assert!(out.status.success(), "{out:?}");
    let [open, made] = [Path::new(open), &made].map(|p| Model::open(p).unwrap());
    assert!(made.weights() == open.weights(), "Stage I is not the same");
    let own = Model::shipped().unwrap();
    let [made_of, open_of, own_of] = [&made, &open, &own].map(|m| format!("{:?}", m.stage2()));
    // Not printed: it is a million numbers.
    assert!(made_of != open_of, "Stage II is that of before");
    assert!(made_of == own_of, "Stage II is not the given one");
    assert_eq!(made.association(), open.association());
}

#[test]
fn numbers_that_an_import_cannot_take_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.ecm");
    std::fs::write(&model, "of an earlier import").unwrap();
    let stage1 = "models/weights/stage1.safetensors";
    let import = ["model", "import", stage1, "--calibrate", "docs"];
    for wrong in ["nan", "7", "-3", "inf", "half"] {
        let own = ["-o", model.to_str().unwrap(), "--own-ranges", wrong];
        let out = edgecap(&[&import[..], &own].concat());
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(64), "{wrong}: {said}");
        assert!(
            said.contains("expected a number from 0 to 1") && said.contains(wrong),
            "{said}"
        );
    }
    let kept = std::fs::read_to_string(&model).unwrap();
    assert_eq!(kept, "of an earlier import");
    let maps = folder.path().join("maps.npz");
    let run = [
        "model",
        "run",
        "models/edgecap.ecm",
        "--image",
        "docs/demo.jpg",
    ];
    for wrong in ["0", "257", "1000000"] {
        let more = ["--npz", maps.to_str().unwrap(), "--threads", wrong];
        let out = edgecap(&[&run[..], &more].concat());
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(64), "{said}");
        assert!(said.contains("1..=256"), "{said}");
    }
    assert!(!maps.exists());
}

#[test]
fn a_check_says_what_no_engine_runs() {
    let head = r#"{ kind = "conv", name = "head3d.out", from = ["core"], out = 63, kernel = 1, norm = false, relu = false },"#;
    let text = SMALL.replace(head, "");
    let text = text.replace(r#", head3d = "head3d.out""#, "");
    assert!(!text.contains("head3d"), "{text}");
    let out = Own::new(&text).import(&["--check"]);
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(65), "{said}");
    assert!(out.stdout.is_empty(), "{out:?}");
    let wanted = "expected outputs head2d [40] and head3d [63] at 1/8 of the input, found head2d";
    assert!(said.contains(wanted), "{said}");
    let out = Own::new(SMALL).import(&["--check"]);
    assert!(out.status.success(), "{out:?}");
}

#[test]
fn a_check_looks_at_pictures_their_size_and_the_place() {
    let own = Own::new(SMALL);
    let (photos, to) = (own.path("photos"), own.path("m.ecm"));
    std::fs::create_dir(&photos).unwrap();
    std::fs::copy("docs/demo.jpg", own.path("photos/0.jpg")).unwrap();
    let checked = |more: &[&str]| {
        let out = own.import(&[&["--check"], more].concat());
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        (out.status.code().unwrap(), said)
    };
    let (code, said) = checked(&["--calibrate", &photos, "-o", &to]);
    assert_eq!(code, 0, "{said}");
    assert!(!Path::new(&to).exists());
    for (more, code, words) in [
        (&["--calibrate", "/nowhere"][..], 66, "/nowhere"),
        (&["--calibrate", &photos, "--width", "17"], 64, "found 17x"),
        (&["-o", "/proc/nowhere/m.ecm"], 73, "/proc/nowhere/m.ecm"),
        (
            &["--calibrate", "/nowhere", "-o", "/proc/nowhere/m.ecm"],
            65,
            "; cannot write /proc/nowhere/m.ecm",
        ),
    ] {
        let (found, said) = checked(more);
        assert_eq!(found, code, "{said}");
        assert!(said.contains(words), "{said}");
    }
}

#[test]
fn layers_without_vector_kernels_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::create_dir(path("photos")).unwrap();
    std::fs::copy("docs/demo.jpg", path("photos/0.jpg")).unwrap();
    let depthwise = r#"{ kind = "conv", name = "deep", out = 4, kernel = 3, groups = 4 },"#;
    let after = r#"out = 4, kernel = 1, stride = 8 },"#;
    for (name, more) in [("whole", ""), ("depthwise", depthwise)] {
        let text = SMALL
            .replace("multiple = 16", "multiple = 64")
            .replace(after, &format!("{after}\n{more}"));
        let network = Network::parse(&text).unwrap();
        let (arch, weights) = (path(&format!("{name}.toml")), path(name));
        std::fs::write(&arch, text).unwrap();
        let bytes = file(&shapes(&network), Some(&template(&network)));
        std::fs::write(&weights, bytes).unwrap();
        let (photos, to) = (path("photos"), path(&format!("{name}.ecm")));
        let size = ["--width", "128", "--height", "128", "-o", &to];
        let import = [
            "model",
            "import",
            &weights,
            "--arch",
            &arch,
            "--calibrate",
            &photos,
        ];
        let out = edgecap(&[&import[..], &size].concat());
        assert!(
            out.status.success(),
            "{}",
            String::from_utf8_lossy(&out.stderr)
        );
        let out = edgecap(&["model", "verify", &to]);
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.success(), "{said}");
        let is_named = said.contains("without vector kernels") && said.contains(": deep;");
        assert_eq!(is_named, !more.is_empty(), "{said}");
    }
}

/// At the import, and in the settings: not once it runs unattended.
#[test]
fn a_network_that_the_engine_refuses_is_refused_early() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::create_dir(path("photos")).unwrap();
    std::fs::copy("docs/demo.jpg", path("photos/0.jpg")).unwrap();
    let head =
        r#"name = "head3d.out", from = ["core"], out = 63, kernel = 1, norm = false, relu = false"#;
    assert!(SMALL.contains(head));
    let text = SMALL.replace(head, &head.replace("relu = false", "relu = true"));
    let network = Network::parse(&text).unwrap();
    let (arch, weights) = (path("small.toml"), path("w"));
    std::fs::write(&arch, text).unwrap();
    let bytes = file(&shapes(&network), Some(&template(&network)));
    std::fs::write(&weights, &bytes).unwrap();
    let (photos, to, settings) = (path("photos"), path("m.ecm"), path("edgecap.toml"));
    let import = ["model", "import", &weights, "--arch", &arch];
    let out = edgecap(&[&import[..], &["--calibrate", &photos, "-o", &to]].concat());
    let refuses = |out: Output| {
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(65), "{said}");
        let why = "`head3d.out` is an output with ReLU";
        assert!(said.contains(why), "{said}");
    };
    refuses(out);
    assert!(!Path::new(&to).exists());

    let options = CalibrationOptions {
        size: (64, 64),
        ..CalibrationOptions::default()
    };
    let stage2 = std::fs::read("models/weights/stage2.safetensors").unwrap();
    let model = Model::from_safetensors(&bytes, network).unwrap();
    let model = model.with_stage2(&stage2).unwrap();
    let seen = Calibration::observe(&model, [vec![90; 3 * 64 * 64]], options).unwrap();
    let rounded = model.quantise(Some(&seen)).unwrap();
    rounded.save(Path::new(&to)).unwrap();
    std::fs::write(&settings, "[network]\nmodel = \"m.ecm\"\n").unwrap();
    refuses(edgecap(&["config", "check", "--config", &settings]));
}
