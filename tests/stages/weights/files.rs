//! Files that are not what they are taken for, and places where nothing may be written.

use edgecap::engine::Network;

use super::{Own, SMALL, edgecap, file, shapes, template};

#[test]
fn neither_a_network_s_description_nor_a_photo_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let network = Network::parse(SMALL).unwrap();
    let bytes = file(&shapes(&network), Some(&template(&network)));
    std::fs::write(path("w"), bytes).unwrap();
    std::fs::write(path("small.toml"), SMALL).unwrap();
    std::fs::create_dir(path("photos")).unwrap();
    std::fs::copy("docs/demo.jpg", path("photos/0.jpg")).unwrap();
    let [w, arch, photos, photo] = ["w", "small.toml", "photos", "photos/0.jpg"].map(path);
    let of = ["--arch", &arch];
    let import = ["model", "import", &w, "--calibrate", &photos];
    let run = ["model", "run", &w, "--image", &photo];
    for (args, option) in [
        ([&import[..], &of, &["-o", &arch]].concat(), "--arch"),
        ([&import[..], &of, &["-o", &photo]].concat(), "--calibrate"),
        ([&run[..], &of, &["--npz", &arch]].concat(), "--arch"),
    ] {
        let out = edgecap(&args);
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(64), "{said}");
        assert!(said.contains(option), "{said}");
    }
    assert_eq!(std::fs::read_to_string(&arch).unwrap(), SMALL);
    let before = std::fs::read("docs/demo.jpg").unwrap();
    assert!(std::fs::read(&photo).unwrap() == before);
}

#[test]
fn maps_without_a_place_are_told_before_the_network_runs() {
    let run = [
        "model",
        "run",
        "models/edgecap.ecm",
        "--width=64",
        "--height=64",
    ];
    for (image, npz, code) in [
        ("none.jpg", "docs/demo.jpg/maps.npz", 73),
        ("docs/demo.jpg", "/dev/full", 74),
    ] {
        let out = edgecap(&[&run[..], &["--image", image, "--npz", npz]].concat());
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(code), "{said}");
        assert!(
            said.contains(npz) && said.contains("cannot write"),
            "{said}"
        );
    }
}

#[test]
fn a_model_without_a_place_is_told_before_the_calibration() {
    let own = Own::new(SMALL);
    let photos = own.path("photos");
    std::fs::create_dir(&photos).unwrap();
    std::fs::write(own.path("photos/0.jpg"), "no picture").unwrap();
    let to = own.path("w/m.ecm");
    let out = own.import(&["--calibrate", &photos, "-o", &to]);
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(73), "{said}");
    assert!(
        said.contains("cannot write") && said.contains(&to),
        "{said}"
    );
}

#[test]
fn checkpoints_are_answered_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    for (name, begin) in [
        (
            "zip.pth",
            &b"PK\x03\x04\x00\x00\x08\x08\x00\x00\x00\x00"[..],
        ),
        ("pickle.pt", b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19."),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, [begin, &[7; 200]].concat()).unwrap();
        let path = path.to_str().unwrap();
        let (model, jsonl) = (folder.path().join("m.ecm"), folder.path().join("o.jsonl"));
        for args in [
            &["model", "import", path, "--check"][..],
            &["model", "import", path, "--output", model.to_str().unwrap()],
            &["model", "verify", path],
            &[
                "infer",
                "--model",
                path,
                "--input",
                "demo",
                "--jsonl",
                jsonl.to_str().unwrap(),
            ],
        ] {
            let out = edgecap(args);
            let said = String::from_utf8_lossy(&out.stderr).into_owned();
            assert_eq!(out.status.code(), Some(65), "{args:?}: {said}");
            assert!(
                said.contains("convert.py") && said.contains("docs/weights.md"),
                "{said}"
            );
        }
    }
}

/// `--model` takes them as they are; the verbs for model files say which one takes them.
#[test]
fn float_weights_are_not_called_a_damaged_model() {
    let weights = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/models/weights/stage1.safetensors"
    );
    for verb in ["info", "verify"] {
        let out = edgecap(&["model", verb, weights]);
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(65), "{said}");
        assert!(
            said.contains("model import FILE --check") && !said.contains("damaged"),
            "{said}"
        );
    }
}

/// Read twice, a pipe would be empty the second time.
#[test]
fn a_model_in_a_pipe_is_the_same_as_in_its_file() {
    let path = "models/open/edgecap-open.ecm";
    let digest = blake3::hash(&std::fs::read(path).unwrap()).to_hex();
    for verb in ["info", "verify"] {
        let program = env!("CARGO_BIN_EXE_edgecap");
        let script = r#"cat "$1" | "$0" model "$2" /dev/stdin"#;
        let mut piped = std::process::Command::new("sh");
        let piped = piped.args(["-c", script, program, path, verb]).output();
        let piped = String::from_utf8(piped.unwrap().stdout).unwrap();
        let plain = String::from_utf8(edgecap(&["model", verb, path]).stdout).unwrap();
        assert!(plain.contains(digest.as_str()), "{plain}");
        assert_eq!(piped, plain);
    }
}
