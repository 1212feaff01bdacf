//! Networks, weights and pictures for them that are none.

use crate::program::{assert_fails, output, stderr};

#[test]
fn a_calibration_on_no_pictures() {
    let import = ["model", "import", "weights.safetensors", "-o", "out.ecm"];
    let none = [&import[..], &["--pictures", "0"]].concat();
    assert_fails(&none, 64, &["--pictures", "0"]);
}

#[test]
fn a_model_that_is_corrupt() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.ecm");
    std::fs::write(&path, [0x40u8; 4096]).unwrap();
    let out = folder.path().join("out.jsonl");
    assert_fails(
        &[
            "infer",
            "--input",
            "demo",
            "--model",
            path.to_str().unwrap(),
            "--jsonl",
            out.to_str().unwrap(),
        ],
        65,
        &["bad.ecm"],
    );
}

#[test]
fn stage2_weights_that_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.jsonl");
    let fails = |stage2: &str, model: &str, code, says: &[&str]| {
        let mut args = vec!["infer", "--input", "demo", "--model", model];
        if !stage2.is_empty() {
            args.extend(["--stage2", stage2]);
        }
        args.extend(["--jsonl", out.to_str().unwrap()]);
        assert_fails(&args, code, says);
        assert!(!out.exists(), "{args:?} left its output behind");
    };
    let (stage1, stage2) = (
        "models/weights/stage1.safetensors",
        "models/weights/stage2.safetensors",
    );
    fails(
        "/nowhere/lift.safetensors",
        stage1,
        66,
        &["/nowhere/lift.safetensors"],
    );
    fails("", stage1, 65, &["--stage2"]);
    let cut = folder.path().join("cut.safetensors");
    let whole = std::fs::read(stage2).unwrap();
    std::fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    fails(
        cut.to_str().unwrap(),
        stage1,
        65,
        &["Stage II", "cut.safetensors"],
    );
    // Stage I's weights are no Stage II.
    fails(stage1, stage1, 65, &["Stage II", stage1]);
}

#[test]
fn networks_and_pictures_that_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, content: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path.to_str().unwrap().to_owned()
    };
    assert_fails(
        &["model", "contract", "--arch", "nonesuch"],
        64,
        &["nonesuch", "selecsls"],
    );
    let broken = file("broken.toml", "name = \"x\"\nlayers = [");
    assert_fails(
        &["model", "contract", "--arch", &broken],
        65,
        &["broken.toml:2:"],
    );
    let shipped = std::fs::read_to_string("models/selecsls.toml").unwrap();
    let pool = "kernel = 3, stride = 2 },\n  { kind = \"maxpool\", name = \"trap\", \
                kernel = 4611686018427387905, stride = 1 },";
    let trap = file(
        "trap.toml",
        &shipped.replacen("kernel = 3, stride = 2 },", pool, 1),
    );
    assert_fails(
        &["model", "contract", "--arch", &trap],
        65,
        &["trap.toml", "4611686018427387905"],
    );
    let picture = file("broken.jpg", "no picture");
    let maps = folder.path().join("maps.npz");
    let maps = maps.to_str().unwrap();
    assert_fails(
        &[
            "model",
            "run",
            "models/edgecap.ecm",
            "--image",
            &picture,
            "--npz",
            maps,
        ],
        65,
        &["broken.jpg"],
    );
    let stage1 = "models/weights/stage1.safetensors";
    let model = folder.path().join("x.ecm");
    let import = ["model", "import", stage1, "-o", model.to_str().unwrap()];
    let calibrate = |pictures: &str, code| {
        let arguments = [&import[..], &["--calibrate", pictures]].concat();
        assert_fails(&arguments, code, &[pictures]);
    };
    calibrate("/nowhere", 66);
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    calibrate(empty.to_str().unwrap(), 66);
    assert!(!model.exists());
}

#[test]
fn a_contract_says_what_is_yours() {
    let said = |more: &[&str]| stderr(&output(&[&["model", "contract"], more].concat()));
    let (first, second) = (said(&[]), said(&["--stage2"]));
    for key in ["trained_on", "batchnorm_eps"] {
        assert!(
            first.contains(key) && second.contains(key),
            "{first}{second}"
        );
    }
    for key in ["reference_size", "outputs", "bones_at", "encodings_trained"] {
        assert!(
            first.contains(key) && !second.contains(key),
            "{key}: {second}"
        );
    }
}
