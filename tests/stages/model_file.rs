//! Model files: what was written is read, what is damaged or foreign is refused with one clear line.

use std::collections::HashMap;

use edgecap::engine::model::{Calibration, Observed, RangeChoice, Weights};
use edgecap::engine::{Model, ModelError, Network};
use safetensors::tensor::{Dtype, TensorView};

const TINY: &str = r#"
    name = "tiny"
    about = "small"
    input = { channels = 3, multiple = 16 }
    output = { head2d = "a", head3d = "b" }
    layers = [
      { kind = "conv", name = "stem", out = 4, kernel = 3, stride = 2 },
      { kind = "deconv", name = "up", out = 4, kernel = 4, stride = 2, groups = 2 },
      { kind = "conv", name = "a", from = ["up"], out = 40, kernel = 1, norm = false, relu = false },
      { kind = "conv", name = "b", from = ["up"], out = 63, kernel = 1, norm = false, relu = false },
    ]
"#;

fn tiny() -> Network {
    Network::parse(TINY).unwrap()
}

/// The contract that the training recipe writes, with ranges.
fn contract() -> serde_json::Value {
    serde_json::json!({
        "step": 1, "images": 2, "quantised": false,
        "joints": edgecap::joints::JOINT_NAMES[..14],
        "joints3d": edgecap::joints::JOINT_NAMES,
        "parents3d": edgecap::joints::PARENTS,
        "canonical_stature_m": 1.7,
        "frame3d": "x right, y down, z forward, metres, relative to the pelvis, person rescaled to canonical_stature_m; view-aligned: turn by the least rotation that takes +z to the viewing ray through the neck to get camera axes",
        "trained_on": "nothing",
        "input": {"layout": "NCHW", "colour": "RGB", "formula": "x/255-0.5", "size_multiple": 16, "reference_size": [512, 320]},
        "stride": 8,
        "cell_centre": "px = 8*c + 3.5 (pixel centres are integers)",
        "limbs": edgecap::joints::LIMB_JOINTS,
        "batchnorm_eps": 1e-5,
        "outputs": {},
        "bones_at": vec![Vec::<usize>::new(); 14],
        "activation_max": {"stem.2": 3.0, "up.2": 2.0},
        "activation_bits": 7,
    })
}

type Blobs = Vec<(&'static str, Vec<usize>, Vec<f32>)>;

/// Weights that fit [`TINY`], numbered so that an exchanged pair would be seen.
fn blobs() -> Blobs {
    let mut blobs: Blobs = vec![
        ("stem.0.weight", vec![4, 3, 3, 3], vec![]),
        ("up.0.weight", vec![4, 2, 4, 4], vec![]),
        ("a.weight", vec![40, 4, 1, 1], vec![]),
        ("a.bias", vec![40], vec![]),
        ("b.weight", vec![63, 4, 1, 1], vec![]),
        ("b.bias", vec![63], vec![]),
    ];
    for name in [
        "stem.1.weight",
        "stem.1.bias",
        "stem.1.running_mean",
        "stem.1.running_var",
    ] {
        blobs.push((name, vec![4], vec![]));
    }
    for name in [
        "up.1.weight",
        "up.1.bias",
        "up.1.running_mean",
        "up.1.running_var",
    ] {
        blobs.push((name, vec![4], vec![]));
    }
    for (i, (_, shape, data)) in blobs.iter_mut().enumerate() {
        let n: usize = shape.iter().product();
        data.extend((0..n).map(|j| 0.5 + (i * 31 + j) as f32 % 7.0 / 8.0));
    }
    blobs
}

fn safetensors(blobs: &Blobs, contract: Option<&serde_json::Value>) -> Vec<u8> {
    let bytes: Vec<Vec<u8>> = blobs
        .iter()
        .map(|(_, _, data)| data.iter().flat_map(|x| x.to_le_bytes()).collect())
        .collect();
    let views = blobs.iter().zip(&bytes).map(|((name, shape, _), bytes)| {
        (
            *name,
            TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap(),
        )
    });
    let metadata = contract.map(|c| HashMap::from([("contract".into(), c.to_string())]));
    safetensors::serialize(views, metadata).unwrap()
}

fn import(blobs: &Blobs, contract: Option<&serde_json::Value>) -> Result<Model, String> {
    Model::from_safetensors(&safetensors(blobs, contract), tiny()).map_err(|e| e.to_string())
}

fn refusal(blobs: &Blobs, contract: Option<&serde_json::Value>) -> String {
    import(blobs, contract).expect_err("must be refused")
}

#[test]
fn batch_norm_is_folded_and_deconvolution_turned_round() {
    let blobs = blobs();
    let model = import(&blobs, Some(&contract())).unwrap();
    let Weights::Float(convs) = model.weights() else {
        panic!("imported weights are floats");
    };
    let get = |name: &str| &blobs.iter().find(|b| b.0 == name).unwrap().2;
    let up = convs[1].as_ref().unwrap();
    for o in 0..4 {
        let a = get("up.1.weight")[o] / (get("up.1.running_var")[o] + 1e-5).sqrt();
        let bias = get("up.1.bias")[o] - get("up.1.running_mean")[o] * a;
        assert!((up.bias[o] - bias).abs() < 1e-6);
        for i in 0..2 {
            for t in 0..16 {
                // PyTorch: [in over all groups][out in the group][taps].
                let (input, out) = (o / 2 * 2 + i, o % 2);
                let w = get("up.0.weight")[(input * 2 + out) * 16 + t] * a;
                assert!(
                    (up.weight[(o * 2 + i) * 16 + t] - w).abs() < 1e-6,
                    "{o} {i} {t}"
                );
            }
        }
    }
    assert_eq!(convs[2].as_ref().unwrap().bias, *get("a.bias"));
}

#[test]
fn what_was_written_is_read() {
    let model = import(&blobs(), Some(&contract()))
        .unwrap()
        .quantise(None)
        .unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.ecm");
    model.save(&path).unwrap();
    let back = Model::open(&path).unwrap();
    assert_eq!(back.weights(), model.weights());
    assert_eq!(back.contract(), model.contract());
    assert_eq!(back.history(), model.history());
    assert_eq!(back.to_bytes().unwrap(), std::fs::read(&path).unwrap());
    assert!(back.encodings_trained());
    // Nothing is left beside it.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn weights_that_batch_norm_makes_infinite_are_refused() {
    for (tensor, value) in [("stem.1.weight", 3e38), ("stem.1.running_mean", -3e38)] {
        let mut blobs = blobs();
        let blob = blobs.iter_mut().find(|b| b.0 == tensor).unwrap();
        blob.2[2] = value;
        if let Some(variance) = blobs.iter_mut().find(|b| b.0 == "stem.1.running_var") {
            variance.2[2] = 0.0;
        }
        let said = refusal(&blobs, Some(&contract()));
        assert!(
            said.contains("`stem.0.weight`") && said.contains("channel 2"),
            "{tensor}: {said}"
        );
        let all = Model::mismatches(&safetensors(&blobs, Some(&contract())), &tiny()).unwrap();
        assert!(all.len() == 1 && all[0].to_string() == said, "{all:?}");
    }
}

#[test]
fn what_could_not_be_opened_replaces_no_model() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.ecm");
    let float = import(&blobs(), Some(&contract())).unwrap();
    float.clone().quantise(None).unwrap().save(&path).unwrap();
    let good = std::fs::read(&path).unwrap();
    let calibration = Calibration {
        observed: vec![Observed::new(4); float.network().graph().values.len()],
        choice: RangeChoice::Max,
        own_ranges: f32::NAN,
        correct_bias: false,
        pictures: 1,
        left_out: 0,
    };
    let bad = float.quantise(Some(&calibration)).unwrap();
    let said = bad.save(&path).unwrap_err().to_string();
    assert!(said.contains(".step`") && said.contains("NaN"), "{said}");
    assert_eq!(std::fs::read(&path).unwrap(), good);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_flipped_bit_or_a_missing_end_is_seen() {
    let model = import(&blobs(), Some(&contract()))
        .unwrap()
        .quantise(None)
        .unwrap();
    let bytes = model.to_bytes().unwrap();
    for length in [0, 7, 8, 100, bytes.len() / 2, bytes.len() - 1] {
        let e = Model::from_bytes(&bytes[..length]).unwrap_err().to_string();
        assert!(
            e.contains("import it again") && !e.contains('\n'),
            "{length}: {e}"
        );
    }
    for at in (0..bytes.len()).step_by(bytes.len() / 97) {
        let mut wrong = bytes.clone();
        wrong[at] ^= 4;
        assert!(Model::from_bytes(&wrong).is_err(), "bit of byte {at}");
    }
    let mut wrong = bytes.clone();
    *wrong.last_mut().unwrap() ^= 1;
    let e = Model::from_bytes(&wrong).unwrap_err().to_string();
    assert!(e.contains("digest"), "{e}");
}

#[test]
fn foreign_contracts_are_refused_by_key() {
    let with = |key: &str, value: serde_json::Value| {
        let mut c = contract();
        c[key] = value;
        refusal(&blobs(), Some(&c))
    };
    let cases = [
        ("stride", serde_json::json!(4)),
        ("canonical_stature_m", serde_json::json!(1.8)),
        ("frame3d", serde_json::json!("camera axes")),
        ("cell_centre", serde_json::json!("px = 8*c")),
        ("activation_bits", serde_json::json!(8)),
        ("modules", serde_json::json!([[1, 2, 3, 4, 5]])),
        ("limbs", serde_json::json!([[1, 0]])),
        ("colour_space", serde_json::json!("new in a later version")),
    ];
    for (key, value) in cases {
        let e = with(key, value);
        assert!(e.contains(key), "{key}: {e}");
    }
    let e = with(
        "input",
        serde_json::json!({"layout": "NCHW", "colour": "BGR", "formula": "x/255-0.5", "size_multiple": 16, "reference_size": [512, 320]}),
    );
    assert!(e.contains("BGR"), "{e}");
    assert!(refusal(&blobs(), None).contains("contract"));
}

#[test]
fn tensors_must_be_those_of_the_network() {
    let contract = contract();
    let mut missing = blobs();
    missing.remove(0);
    assert!(refusal(&missing, Some(&contract)).contains("stem.0.weight"));
    let mut extra = blobs();
    extra.push(("stranger", vec![1], vec![0.0]));
    assert!(refusal(&extra, Some(&contract)).contains("stranger"));
    let mut shape = blobs();
    shape[2].1 = vec![40, 2, 2, 1];
    let e = refusal(&shape, Some(&contract));
    assert!(
        e.contains("[40, 4, 1, 1]") && e.contains("[40, 2, 2, 1]"),
        "{e}"
    );
    let mut infinite = blobs();
    infinite[0].2[5] = f32::INFINITY;
    assert!(refusal(&infinite, Some(&contract)).contains("inf at element 5"));
}

#[test]
fn int8_without_ranges_says_how_to_get_them() {
    let mut c = contract();
    c["activation_max"] = serde_json::json!({"stem.2": 3.0});
    let model = import(&blobs(), Some(&c)).unwrap();
    let e = model.quantise(None).unwrap_err().to_string();
    assert!(e.contains("up") && e.contains("--calibrate"), "{e}");
}

#[test]
fn shipped_weights_are_whole() {
    let model = match Model::shipped() {
        Ok(model) => model,
        Err(e @ ModelError::NotShipped) => {
            println!("skipped: {e}");
            return;
        }
        Err(e) => panic!("{e}"),
    };
    assert_eq!(model.network().name(), "selecsls");
    assert!(model.is_quantised() && model.stage2().is_some());
}

/// A model file with a pool, `from` in the text of its network replaced by `to`, and the digest that belongs to it:
/// what nobody but an attacker would make.
fn forged(from: &str, to: &str) -> Vec<u8> {
    let up = r#"{ kind = "deconv", name = "up""#;
    let pool = r#"{ kind = "maxpool", name = "pool", kernel = 3, stride = 2 },"#;
    let network = Network::parse(&TINY.replace(up, &format!("{pool}\n{up}"))).unwrap();
    let float = Model::from_safetensors(&safetensors(&blobs(), Some(&contract())), network);
    let bytes = float.unwrap().quantise(None).unwrap().to_bytes().unwrap();
    let (length, rest) = bytes.split_first_chunk::<8>().unwrap();
    let (header, data) = rest.split_at(u64::from_le_bytes(*length) as usize);
    let header = std::str::from_utf8(header).unwrap();
    assert_eq!(header.matches(from).count(), 1, "{header}");
    let mut header = header.replace(from, to).into_bytes();
    header.resize(header.len().next_multiple_of(8), b' ');
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header);
    bytes.extend(data);
    let key = br#"blake3\":\""#;
    let at = bytes.windows(key.len()).position(|w| w == key).unwrap() + key.len();
    bytes[at..at + 64].fill(b'0');
    let digest = blake3::hash(&bytes).to_hex();
    bytes[at..at + 64].copy_from_slice(digest.as_bytes());
    bytes
}

/// Name, type, shape and bytes of a tensor.
type Tensors = std::collections::BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>;

/// A model file of [`TINY`] with a layer `idle`, and a pool of it, that nobody reads, after `change` had its way with
/// header and tensors, and the digest that belongs to it.
fn changed(change: impl Fn(&mut serde_json::Value, &mut Tensors)) -> Result<Model, String> {
    let a = r#"{ kind = "conv", name = "a""#;
    let idle = r#"{ kind = "conv", name = "idle", out = 4, kernel = 1, norm = false },
        { kind = "maxpool", name = "pool", from = ["idle"], kernel = 3, stride = 1 },"#;
    let network = Network::parse(&TINY.replace(a, &format!("{idle}\n{a}"))).unwrap();
    let mut contract = contract();
    contract["activation_max"]["idle.2"] = serde_json::json!(1.0);
    let mut blobs = blobs();
    blobs.push(("idle.weight", vec![4, 4, 1, 1], vec![0.5; 16]));
    blobs.push(("idle.bias", vec![4], vec![0.5; 4]));
    let float = Model::from_safetensors(&safetensors(&blobs, Some(&contract)), network);
    let bytes = float.unwrap().quantise(None).unwrap().to_bytes().unwrap();

    let (_, metadata) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
    let header = &metadata.metadata().as_ref().unwrap()["edgecap"];
    let mut header = serde_json::from_str(header).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let tensor = |(name, t): (String, TensorView)| {
        (name, (t.dtype(), t.shape().to_vec(), t.data().to_vec()))
    };
    let mut tensors = file.tensors().into_iter().map(tensor).collect();
    change(&mut header, &mut tensors);
    header["blake3"] = "0".repeat(64).into();
    let write = |header: &serde_json::Value| {
        let views = tensors.iter().map(|(name, (dtype, shape, data))| {
            let view = TensorView::new(*dtype, shape.clone(), data).unwrap();
            (name.as_str(), view)
        });
        let metadata = HashMap::from([("edgecap".into(), header.to_string())]);
        safetensors::serialize(views, Some(metadata)).unwrap()
    };
    header["blake3"] = blake3::hash(&write(&header)).to_hex().as_str().into();
    Model::from_bytes(&write(&header)).map_err(|e| e.to_string())
}

#[test]
fn a_file_whose_scales_are_not_those_of_its_values_is_refused() {
    changed(|_, _| {}).unwrap();
    let refusal = |change: &dyn Fn(&mut serde_json::Value, &mut Tensors)| {
        let said = changed(change).expect_err("must be refused");
        assert!(!said.contains('\n'), "{said}");
        said
    };
    // Steps of an output.
    let steps = || 1.0_f32.to_le_bytes().repeat(40);
    let said = refusal(&|header, tensors| {
        header["zeros"]["a"] = 0.0.into();
        tensors.insert("a.step".into(), (Dtype::F32, vec![40], steps()));
    });
    assert!(said.contains("zero point for the output `a`"), "{said}");
    // None of a layer that is no output.
    let said = refusal(&|header, tensors| {
        header["zeros"].as_object_mut().unwrap().remove("idle");
        tensors.remove("idle.step").unwrap();
    });
    assert!(said.contains("no zero point for `idle`"), "{said}");
    // Halos of more than seven bits.
    let said = refusal(&|header, _| header["zeros"]["stem"] = 200.0.into());
    assert!(
        said.contains("`stem.step`") && said.contains("zero point 200 is not in 0..=127"),
        "{said}"
    );
}

#[test]
fn a_file_whose_scales_no_int8_kernel_takes_is_refused() {
    let refusal = |change: &dyn Fn(&mut serde_json::Value, &mut Tensors)| {
        changed(change).expect_err("must be refused")
    };
    let said = refusal(&|header, _| header["zeros"]["stem"] = 5.0.into());
    assert!(
        said.contains("`stem.step`") && said.contains("zero point 5 behind ReLU"),
        "{said}"
    );
    let other = "`pool.step` holds a scale other than that of `idle`";
    let said = refusal(&|header, _| header["zeros"]["pool"] = 5.0.into());
    assert!(said.contains(other), "{said}");
    let said = refusal(&|_, tensors| {
        let (_, _, steps) = tensors.get_mut("pool.step").unwrap();
        steps[4..8].copy_from_slice(&0.5_f32.to_le_bytes());
    });
    assert!(said.contains(other), "{said}");
}

const POOL: &str = "kernel = 3, stride = 2 },\\\\n{ kind";

#[test]
fn a_forged_file_that_changes_nothing_is_read() {
    let model = Model::from_bytes(&forged("small", "smart")).unwrap();
    assert_eq!(model.network().about(), "smart");
}

#[test]
fn a_file_of_a_newer_version_is_called_newer_not_damaged() {
    let newer = r#"\"version\":2,\"what_it_adds\":7,"#;
    let e = Model::from_bytes(&forged(r#"\"version\":1,"#, newer)).unwrap_err();
    let e = e.to_string();
    assert!(
        e.contains("found version 2")
            && e.contains("a newer edgecap made it")
            && !e.contains("damaged"),
        "{e}"
    );
    let older = forged(r#"\"version\":1,"#, r#"\"version\":0,"#);
    let e = Model::from_bytes(&older).unwrap_err().to_string();
    assert!(e.contains("`version`: expected 1, found 0"), "{e}");
}

#[test]
fn sizes_that_wrap_are_refused_although_the_digest_is_right() {
    for (from, to, said) in [
        // 4611686018427387905² is 1 modulo 2⁶⁴.
        (
            POOL,
            "kernel = 4611686018427387905, stride = 2 },\\\\n{ kind",
            "pooling `pool`",
        ),
        (
            POOL,
            "kernel = 3, stride = 9223372036854775807 },\\\\n{ kind",
            "pooling `pool`",
        ),
        (
            "out = 4, kernel = 3, stride = 2",
            "out = 4, kernel = 4294967297, stride = 2",
            "layer `stem`",
        ),
        (
            "out = 4, kernel = 3, stride = 2",
            "out = 9223372036854775807, kernel = 3, stride = 2",
            "layer `stem`",
        ),
        (
            "out = 4, kernel = 4, stride = 2",
            "out = 4, kernel = 4, stride = 4611686018427387904",
            "layer `up`",
        ),
        ("channels = 3", "channels = 9223372036854775807", "input"),
        ("multiple = 16", "multiple = 0", "input"),
    ] {
        let e = Model::from_bytes(&forged(from, to)).unwrap_err();
        let e = e.to_string();
        assert!(e.contains(said) && !e.contains('\n'), "{to}: {e}");
    }
}

#[test]
fn the_program_refuses_a_forged_file_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("forged.ecm");
    let wild = "kernel = 4611686018427387905, stride = 2 },\\\\n{ kind";
    std::fs::write(&path, forged(POOL, wild)).unwrap();
    let path = path.to_str().unwrap();
    let jsonl = folder.path().join("out.jsonl");
    let jsonl = jsonl.to_str().unwrap();
    for args in [
        &["model", "verify", path][..],
        &["model", "info", path],
        &[
            "infer", "--model", path, "--input", "demo", "--jsonl", jsonl,
        ],
    ] {
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_edgecap"))
            .args(args)
            .stdin(std::process::Stdio::null())
            .output()
            .unwrap();
        let err = String::from_utf8_lossy(&out.stderr);
        let lines: Vec<&str> = err.lines().filter(|l| l.starts_with("edgecap: ")).collect();
        // A signal has no code.
        assert!(
            out.status.code().is_some_and(|c| c != 0 && c != 101),
            "{args:?}: {err}"
        );
        assert!(
            lines.len() == 1 && lines[0].contains("pooling `pool`"),
            "{args:?}: {err}"
        );
    }
}
