//! Other people's weights: what they must say of themselves, and everything that is wrong with them at once.

use std::collections::HashMap;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use edgecap::engine::model::{Calibration, Contract, Stage2Contract};
use edgecap::engine::network::Op;
use edgecap::engine::{CalibrationOptions, Model, ModelError, Network};
use safetensors::tensor::{Dtype, TensorView};
use serde_json::{Value, json};

/// Shapes of all tensors that a network's state dict has, by name.
fn shapes(network: &Network) -> HashMap<String, Vec<usize>> {
    let mut shapes = HashMap::new();
    for node in &network.graph().nodes {
        let Op::Conv { shape, params, .. } = &node.op else {
            continue;
        };
        let (k, out, inputs) = (shape.kernel(), shape.out_channels(), shape.in_channels());
        let weight = match shape.transposed() {
            true => vec![inputs, out / shape.groups(), k, k],
            false => vec![out, inputs / shape.groups(), k, k],
        };
        shapes.insert(params.weight.clone(), weight);
        if let Some(bias) = &params.bias {
            shapes.insert(bias.clone(), vec![out]);
        }
        if let Some(norm) = &params.norm {
            for part in ["weight", "bias", "running_mean", "running_var"] {
                shapes.insert(format!("{norm}.{part}"), vec![out]);
            }
        }
    }
    shapes
}

/// Safetensors of zeros.
fn file(shapes: &HashMap<String, Vec<usize>>, contract: Option<&Value>) -> Vec<u8> {
    let most = shapes.values().map(|s| s.iter().product::<usize>()).max();
    let zeros = vec![0_u8; 4 * most.unwrap_or(0)];
    let views = shapes.iter().map(|(name, shape)| {
        let bytes = 4 * shape.iter().product::<usize>();
        let view = TensorView::new(Dtype::F32, shape.clone(), &zeros[..bytes]).unwrap();
        (name.as_str(), view)
    });
    let metadata = contract.map(|c| HashMap::from([("contract".into(), c.to_string())]));
    safetensors::serialize(views, metadata).unwrap()
}

fn template(network: &Network) -> Value {
    serde_json::to_value(Contract::template(network)).unwrap()
}

fn edgecap(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_edgecap"))
        .args(args)
        .output()
        .unwrap()
}

fn lines(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    text.lines().map(ToOwned::to_owned).collect()
}

#[test]
fn what_the_program_prints_is_what_it_takes() {
    for arch in Network::names() {
        let out = edgecap(&["model", "contract", "--arch", arch]);
        assert!(out.status.success(), "{out:?}");
        let text = String::from_utf8(out.stdout).unwrap();
        let network = Network::shipped(arch).unwrap();
        assert_eq!(
            Contract::parse(&text, &network).unwrap(),
            Contract::template(&network)
        );
    }
    let out = edgecap(&["model", "contract", "--stage2"]);
    let text = String::from_utf8(out.stdout).unwrap();
    assert_eq!(
        Stage2Contract::parse(&text).unwrap(),
        Stage2Contract::template()
    );
}

#[test]
fn weights_with_the_printed_contract_are_imported() {
    let network = Network::shipped("selecsls42").unwrap();
    let bytes = file(&shapes(&network), Some(&template(&network)));
    assert!(Model::mismatches(&bytes, &network).unwrap().is_empty());
    Model::from_safetensors(&bytes, network).unwrap();
}

#[test]
fn every_mismatch_is_told_at_once() {
    let network = Network::shipped("selecsls60").unwrap();
    let (mut shapes, mut contract) = (shapes(&network), template(&network));
    let object = contract.as_object_mut().unwrap();
    object.remove("frame3d");
    object.insert("stride".into(), json!(4));
    object.insert("step".into(), json!("many"));
    object.insert("colour_space".into(), json!("sRGB"));
    object["input"]["colour"] = json!("BGR");
    object["input"].as_object_mut().unwrap().remove("formula");
    shapes.remove("stem.0.weight");
    shapes.insert("classifier.0.weight".into(), vec![10, 1280]);
    shapes.insert("stem.1.num_batches_tracked".into(), vec![1]);
    *shapes.get_mut("head2d.out.bias").unwrap() = vec![34];
    let bytes = file(&shapes, Some(&contract));
    let all: Vec<String> = Model::mismatches(&bytes, &network)
        .unwrap()
        .iter()
        .map(ToString::to_string)
        .collect();
    let wanted = [
        "`input.formula`: expected \"x/255-0.5\", found nothing",
        "`frame3d`: expected \"x right, y down",
        "`step`: expected 0, found \"many\"",
        "`colour_space`: expected no such key",
        "`input.colour`: expected \"RGB\", found \"BGR\"",
        "`stride`: expected 8, found 4",
        "expected a tensor `stem.0.weight`, found none",
        "`head2d.out.bias`: expected shape [40], found shape [34]",
        "first `classifier.0.weight`",
    ];
    assert_eq!(all.len(), wanted.len(), "{all:#?}");
    for wanted in wanted {
        assert!(all.iter().any(|m| m.contains(wanted)), "{wanted}: {all:#?}");
    }
    // And an import says the first of them.
    let e = Model::from_safetensors(&bytes, network).unwrap_err();
    assert_eq!(e.to_string(), all[0]);
}

#[test]
fn sizes_that_no_input_has_are_told() {
    let network = Network::shipped("selecsls42").unwrap();
    for (size, is_taken) in [
        (json!([1, 8192]), true),
        (json!([0, 0]), false),
        (json!([512, 0]), false),
        (json!([512, 8193]), false),
        (json!([1_u64 << 63, 320]), false),
    ] {
        let mut contract = template(&network);
        contract["input"]["reference_size"] = size.clone();
        let read = Contract::parse(&contract.to_string(), &network);
        let said = read.err().map(|e| e.to_string()).unwrap_or_default();
        assert_eq!(said.is_empty(), is_taken, "{size}: {said}");
        let wanted = "`input.reference_size`: expected a width and a height of 1 to 8192 pixels";
        assert!(is_taken || said.contains(wanted), "{size}: {said}");
    }
}

#[test]
fn a_word_before_every_name_is_told_once() {
    let network = Network::shipped("selecsls42").unwrap();
    let names = shapes(&network);
    let wrapped = names
        .iter()
        .map(|(n, s)| (format!("module.{n}"), s.clone()));
    let mut wrapped: HashMap<_, _> = wrapped.collect();
    wrapped.remove("module.stem.0.weight");
    let bytes = file(&wrapped, Some(&template(&network)));
    let all = Model::mismatches(&bytes, &network).unwrap();
    let [
        ModelError::Prefix { prefix, count },
        ModelError::Missing(missing),
    ] = &all[..]
    else {
        panic!("{all:?}");
    };
    assert_eq!((prefix.as_str(), *count), ("module.", names.len() - 1));
    assert_eq!(missing, "stem.0.weight");
}

#[test]
fn stage_two_is_checked_too() {
    let mut shapes: HashMap<String, Vec<usize>> = HashMap::new();
    for (i, w) in [924, 16, 16, 16, 8, 63].windows(2).enumerate() {
        shapes.insert(format!("fc{}.0.weight", i + 1), vec![w[1], w[0]]);
        for part in ["weight", "bias", "running_mean", "running_var"] {
            shapes.insert(format!("fc{}.1.{part}", i + 1), vec![w[1]]);
        }
    }
    let mut contract = serde_json::to_value(Stage2Contract::template()).unwrap();
    contract["output"] = json!("17 x (x, y, z)");
    let all = Model::stage2_mismatches(&file(&shapes, Some(&contract))).unwrap();
    let all: Vec<String> = all.iter().map(ToString::to_string).collect();
    assert_eq!(all.len(), 6, "{all:#?}");
    assert!(all[0].contains("`output`: expected \"21 x (x, y, z) metres\""));
    assert!(all[1].contains("fc5.0.bias"));
    assert!(all[2..].iter().all(|m| m.contains("fc5.1.")));
}

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
fn options_of_a_calibration_are_not_taken_without_one() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("m.ecm");
    let weights = "models/weights/stage1.safetensors";
    let import = ["model", "import", weights, "-o", to.to_str().unwrap()];
    for option in [
        "--pictures=3",
        "--range=mse",
        "--own-ranges=1",
        "--no-bias-correction",
        "--try-ranges",
        "--width=64",
        "--height=64",
    ] {
        let out = edgecap(&[&import[..], &[option]].concat());
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(64), "{option}: {said}");
        assert!(said.contains("--calibrate"), "{option}: {said}");
    }
    assert!(!to.exists());
}

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
    for (image, npz) in [
        ("none.jpg", "docs/demo.jpg/maps.npz"),
        ("docs/demo.jpg", "/dev/full"),
    ] {
        let out = edgecap(&[&run[..], &["--image", image, "--npz", npz]].concat());
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(73), "{said}");
        assert!(
            said.contains(npz) && said.contains("cannot write"),
            "{said}"
        );
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

/// A layer at an eighth of the picture, and both heads.
const SMALL: &str = r#"
    name = "small"
    about = "calibrated in no time"
    input = { channels = 3, multiple = 16 }
    output = { head2d = "head2d.out", head3d = "head3d.out" }
    layers = [
      { kind = "conv", name = "core", out = 4, kernel = 1, stride = 8 },
      { kind = "conv", name = "head2d.out", out = 40, kernel = 1, norm = false, relu = false },
      { kind = "conv", name = "head3d.out", from = ["core"], out = 63, kernel = 1, norm = false, relu = false },
    ]
"#;

#[test]
fn numbers_that_an_import_cannot_take_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.ecm");
    std::fs::write(&model, "of an earlier import").unwrap();
    let stage1 = "models/weights/stage1.safetensors";
    let import = ["model", "import", stage1, "--calibrate", "docs"];
    for wrong in ["nan", "7", "-3", "inf", "half"] {
        let own = format!("--own-ranges={wrong}");
        let out = edgecap(&[&import[..], &["-o", model.to_str().unwrap(), &own]].concat());
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(64), "{own}: {said}");
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

/// A network of its own in a folder, its file and weights of zeros for it.
struct Own {
    folder: tempfile::TempDir,
    arch: String,
    weights: String,
}

impl Own {
    fn new(text: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let network = Network::parse(text).unwrap();
        let (arch, weights) = (path("own.toml"), path("w"));
        std::fs::write(&arch, text).unwrap();
        let bytes = file(&shapes(&network), Some(&template(&network)));
        std::fs::write(&weights, bytes).unwrap();
        Self {
            folder,
            arch,
            weights,
        }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn import(&self, more: &[&str]) -> Output {
        let own = ["model", "import", &self.weights, "--arch", &self.arch];
        edgecap(&[&own[..], more].concat())
    }
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
fn multiples_that_cells_of_maps_do_not_divide_are_imported() {
    let own = Own::new(&SMALL.replace("multiple = 16", "multiple = 12"));
    let (photos, to) = (own.path("photos"), own.path("m.ecm"));
    std::fs::create_dir(&photos).unwrap();
    std::fs::copy("docs/demo.jpg", own.path("photos/0.jpg")).unwrap();
    let import = ["--calibrate", &photos, "-o", &to];
    let out = own.import(&import);
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{said}");
    assert!(edgecap(&["model", "verify", &to]).status.success());
    // Of a size that nobody can take it is the size that is wrong, and not the network.
    let out = own.import(&[&import[..], &["--width", "132", "--height", "96"]].concat());
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(64), "{said}");
    let wanted = "multiples of 24 pixels up to 8192, found 132x96; choose e.g. 528x336";
    assert!(said.contains(wanted), "{said}");
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
fn a_run_without_ranges_is_told_what_it_can_do() {
    let own = Own::new(SMALL);
    let (arch, to) = (&own.arch, own.path("maps.npz"));
    let run = ["model", "run", &own.weights, "--arch", arch, "--npz", &to];
    let out = edgecap(&[&run[..], &["--image", "docs/demo.jpg"]].concat());
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(64), "{said}");
    for remedy in ["model import --calibrate DIR", "--precision f32"] {
        assert!(said.contains(remedy), "{said}");
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

/// Most memory that a run of the program takes, bytes.
fn peak(args: &[&str]) -> u64 {
    let mut child = Command::new(env!("CARGO_BIN_EXE_edgecap"))
        .args(args)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    let code = loop {
        // The system's mark only grows.
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|l| l.trim().strip_suffix(" kB")?.parse::<u64>().ok());
        peak = peak.max(kilobytes.unwrap_or(0) * 1024);
        if let Some(code) = child.try_wait().unwrap() {
            break code;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    assert!(code.success(), "{args:?}: {code}");
    peak
}

#[test]
fn calibration_holds_one_photo_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let network = Network::parse(SMALL).unwrap();
    std::fs::write(path("small.toml"), SMALL).unwrap();
    let weights = file(&shapes(&network), Some(&template(&network)));
    std::fs::write(path("w"), weights).unwrap();
    let (photos, side) = (12, 3000);
    std::fs::create_dir(path("photos")).unwrap();
    let first = path("photos/0.png");
    let photo = image::RgbImage::from_pixel(side, side, image::Rgb([90, 120, 60]));
    photo.save(&first).unwrap();
    for k in 1..photos {
        std::fs::copy(&first, path(&format!("photos/{k}.png"))).unwrap();
    }
    let (w, arch, photos_at, to) = (path("w"), path("small.toml"), path("photos"), path("m.ecm"));
    let found = peak(&[
        "model",
        "import",
        &w,
        "--arch",
        &arch,
        "--calibrate",
        &photos_at,
        "--try-ranges",
        "-o",
        &to,
    ]);
    let all = u64::from(photos * 3 * side * side);
    assert!(
        found < all * 3 / 4,
        "{found} bytes of memory, {all} in the photos"
    );
    let made = Model::open(Path::new(&to)).unwrap();
    let said = made.calibration();
    assert!(said.contains("over 12 pictures"), "{said}");
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

/// The page names every key of both contracts, and files that it sends people to are there.
#[test]
fn the_page_on_weights_is_complete() {
    let page = include_str!("../../docs/weights.md");
    let network = Network::shipped("selecsls").unwrap();
    let (one, two) = (
        template(&network),
        serde_json::to_value(Stage2Contract::template()).unwrap(),
    );
    for (key, value) in one
        .as_object()
        .unwrap()
        .iter()
        .chain(two.as_object().unwrap())
    {
        assert!(page.contains(&format!("`{key}`")), "{key}");
        let yours = ["trained_on", "outputs"].contains(&&**key);
        if let Some(sentence) = value.as_str().filter(|_| !yours) {
            assert!(page.replace('\n', " ").contains(sentence), "{key}");
        }
    }
    for file in ["convert.py", "backbone.py"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("models/train")
            .join(file);
        assert!(page.contains(file) && path.is_file(), "{file}");
    }
}
