//! The fuzz targets on the stable compiler, without sanitizers: whole seeds, everything that fuzzing once found, and
//! seeds damaged at random. `docs/fuzzing.md` says how the same targets run under libFuzzer.

#[path = "program/damage.rs"]
mod damage;
#[path = "../fuzz/src/seeds.rs"]
mod seeds;
#[path = "../fuzz/src/targets.rs"]
mod targets;

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use damage::{DAMAGED, check, damage, folder};
use rand::SeedableRng;
use rand::rngs::SmallRng;
use rand::seq::IndexedRandom;
use rayon::prelude::*;
use targets::TARGETS;

fn runs(name: &str) {
    let (_, target) = *TARGETS
        .iter()
        .find(|(n, _)| *n == name)
        .expect("a target's name");
    damage::run(name, target, &seeds::seeds(name));
}

macro_rules! each {
    ($($name:ident),*) => {
        $(
            #[test]
            fn $name() {
                runs(stringify!($name));
            }
        )*
    };
}

each!(
    model,
    safetensors,
    network,
    association,
    avi,
    y4m,
    mjpeg,
    photo,
    observations,
    bodies,
    request,
    camera,
    calibration,
    fit_config,
    messages,
    ring,
    body
);

/// Damaged inputs that CI runs besides, always the same ones: about what a core does in ten seconds, as most targets
/// still reach new code then. Fewer of association, camera, fit_config, photo, request, ring and y4m: a few more than
/// it took to reach their last new edge (SanitizerCoverage); more inputs reached none.
const LONG: &[(&str, u64)] = &[
    ("association", 30_000),
    ("avi", 600_000),
    ("bodies", 150_000),
    ("body", 18_000),
    ("calibration", 220_000),
    ("camera", 260_000),
    ("fit_config", 45_000),
    ("messages", 36_000),
    ("mjpeg", 400_000),
    ("model", 32_000),
    ("network", 95_000),
    ("observations", 14_000),
    ("photo", 160_000),
    ("request", 40_000),
    ("ring", 400),
    ("safetensors", 24_000),
    ("y4m", 70_000),
];
/// Into so many parts a target's inputs are divided, so that all cores have some to the end.
const SHARES: u64 = 8;

#[test]
fn every_target_is_damaged_for_long() {
    let long: BTreeSet<&str> = LONG.iter().map(|(name, _)| *name).collect();
    let targets = TARGETS.iter().map(|(name, _)| *name);
    // MP4 is damaged by tests of its own.
    assert_eq!(long, targets.filter(|name| *name != "mp4").collect());
}

#[test]
#[ignore = "long: a minute"]
fn long_damage() {
    let target = |name| TARGETS.iter().find(|(n, _)| *n == name).unwrap().1;
    let of_target = |&(name, count): &(&'static str, u64)| {
        (0..SHARES).map(move |share| (name, target(name), (DAMAGED + share..DAMAGED + count)))
    };
    let jobs: Vec<_> = LONG.iter().flat_map(of_target).collect();
    jobs.into_par_iter().for_each(|(name, target, inputs)| {
        let whole = seeds::seeds(name);
        for k in inputs.step_by(SHARES as usize) {
            let mut rng = SmallRng::seed_from_u64(k);
            let mut bytes = whole.choose(&mut rng).unwrap().clone();
            damage(&mut bytes, &mut rng);
            check(target, &format!("{name}, damage {k}"), &bytes);
        }
    });
}

fn manifest(path: &str) -> toml::Table {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    fs::read_to_string(path).unwrap().parse().unwrap()
}

/// Nothing else builds `fuzz/` on the stable compiler: a target that libFuzzer is not told of would never be fuzzed.
#[test]
fn libfuzzer_has_every_target() {
    let mut targets: BTreeSet<&str> = TARGETS.iter().map(|(name, _)| *name).collect();
    targets.insert("mp4");
    let manifest = manifest("fuzz/Cargo.toml");
    let programs = manifest["bin"].as_array().unwrap();
    let names = programs.iter().map(|bin| bin["name"].as_str().unwrap());
    assert_eq!(names.collect::<BTreeSet<_>>(), targets);
    assert_eq!(programs.len(), targets.len(), "each once");
    for bin in programs {
        let (name, path) = (bin["name"].as_str().unwrap(), bin["path"].as_str().unwrap());
        assert_eq!(path, format!("fuzz_targets/{name}.rs"));
        let text = fs::read_to_string(folder("", path)).unwrap();
        let call = format!("edgecap_fuzz::targets::{name}(data)");
        assert!(
            text.contains(&call),
            "{path}: expected {call}, found {text}"
        );
        let features = bin.get("required-features").is_some();
        assert_eq!(features, name == "mp4", "{name} needs features: {features}");
    }
    let files = fs::read_dir(folder("", "fuzz_targets")).unwrap();
    assert_eq!(files.count(), targets.len(), "a file for each target");
}

/// Here `fuzz/src` is built with the dependencies of the main workspace.
#[test]
fn fuzz_names_every_crate_that_it_uses() {
    let word = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    let (own, fuzz) = (manifest("Cargo.toml"), manifest("fuzz/Cargo.toml"));
    let named = fuzz["dependencies"].as_table().unwrap();
    let kinds = ["dependencies", "dev-dependencies"].map(|kind| own[kind].as_table().unwrap());
    let crates = kinds
        .iter()
        .flat_map(|kind| kind.keys().map(String::as_str));
    let crates: Vec<&str> = crates.chain(["edgecap"]).collect();
    let mut used = BTreeSet::new();
    for file in ["film.rs", "seeds.rs", "targets.rs"] {
        let text = fs::read_to_string(folder("src", file)).unwrap();
        for name in &crates {
            let root = format!("{}::", name.replace('-', "_"));
            let mut places = text.match_indices(&root);
            if places.any(|(at, _)| !text[..at].ends_with(word)) {
                used.insert(*name);
            }
        }
    }
    assert!(used.contains("edgecap") && used.len() > 4, "{used:?}");
    for name in used {
        assert!(
            named.contains_key(name),
            "fuzz/Cargo.toml: expected {name} among its dependencies"
        );
    }
}

/// What lies in a folder of another name is never run again.
#[test]
fn whatever_was_found_is_a_targets() {
    let names: Vec<&str> = TARGETS.iter().map(|(name, _)| *name).collect();
    for entry in fs::read_dir(folder("found", "")).unwrap() {
        let found = entry.unwrap().file_name().into_string().unwrap();
        assert!(
            found == "mp4" || names.contains(&&*found),
            "fuzz/found/{found}: expected one of {names:?}"
        );
    }
}

/// Seeds that are refused at once would test nothing.
#[test]
fn seeds_are_whole() {
    use edgecap::camera::CameraFile;
    use edgecap::capture::{AviReader, MjpegReader, PhotoDecoder, Source, Y4mReader};
    use edgecap::engine::{Model, Network};
    use edgecap::message::{BodyFrame, ObservationFrame};
    let seeds = seeds::seeds;
    assert!(
        Model::from_bytes(&seeds("model")[0])
            .unwrap()
            .stage2()
            .is_some()
    );
    for text in seeds("network") {
        Network::parse(std::str::from_utf8(&text).unwrap()).unwrap();
    }
    let pictures = |mut film: Box<dyn Source>| {
        let mut count = 0;
        while film.next().unwrap().is_some() {
            count += 1;
        }
        count
    };
    let avi = std::io::Cursor::new(seeds("avi").remove(0));
    assert_eq!(pictures(Box::new(AviReader::new(avi, "avi").unwrap())), 3);
    for film in seeds("y4m") {
        let film = std::io::Cursor::new(film);
        assert_eq!(
            pictures(Box::new(Y4mReader::new(film, "y4m", None).unwrap())),
            3
        );
    }
    for film in seeds("mjpeg") {
        let film = std::io::Cursor::new(film);
        assert_eq!(pictures(Box::new(MjpegReader::new(film, "mjpeg", None))), 3);
    }
    for photo in seeds("photo") {
        PhotoDecoder::default()
            .decode(&photo, &mut Default::default())
            .unwrap();
    }
    let [stage1, stage2] = &seeds("safetensors")[..] else {
        panic!("a seed of each stage");
    };
    let network = Network::parse(self::seeds::NETWORK).unwrap();
    let model = Model::from_safetensors(stage1, network).unwrap();
    model.with_stage2(stage2).unwrap();
    for text in seeds("calibration") {
        let text = String::from_utf8(text).unwrap();
        assert!(!targets::calibrations(&text).is_empty(), "{text}");
    }
    for bytes in seeds("messages") {
        let people = match bytes[0] {
            0 => self::seeds::from_bytes::<ObservationFrame>(&bytes[1..]).count,
            _ => self::seeds::from_bytes::<BodyFrame>(&bytes[1..]).count,
        };
        assert!(people > 0, "nobody in a message");
    }
    for text in seeds("camera") {
        CameraFile::parse(std::str::from_utf8(&text).unwrap()).unwrap();
    }
    for bytes in seeds("body") {
        let mut signed = bytes.clone();
        self::seeds::sign_archive(&mut signed);
        assert_eq!(signed, bytes, "checksums were right before");
        edgecap::body::mesh::MeshBody::read(std::io::Cursor::new(bytes)).unwrap();
    }
    for bytes in seeds("observations") {
        let camera = edgecap::record::CameraSource::Recorded { fov_degrees: 60.0 };
        let mut reader = edgecap::record::ObservationReader::new(&bytes[..], "seed", camera);
        let mut frame = edgecap::message::ObservationFrame::default();
        for _ in 0..3 {
            assert!(reader.read(&mut frame).unwrap());
        }
    }
    for bytes in seeds("bodies") {
        use edgecap::record::{BodiesRow, RowReader};
        let mut reader = RowReader::<_, BodiesRow>::new(&bytes[..], "seed");
        for _ in 0..3 {
            assert!(reader.read().unwrap().unwrap().message().count > 0);
        }
        assert!(reader.read().unwrap().is_none());
        edgecap::export::Take::read(&bytes[..], "seed").unwrap();
    }
    for text in seeds("request") {
        let request = edgecap::http::Request::parse(std::str::from_utf8(&text).unwrap()).unwrap();
        assert_eq!(request.parameter("camera"), Some("hall"));
        assert!(request.header("origin").is_some());
    }
    let settings = seeds("association").remove(0);
    edgecap::detect::AssociationConfig::parse(std::str::from_utf8(&settings).unwrap()).unwrap();
    let config = seeds("fit_config").remove(0);
    edgecap::fit::FitConfig::parse(std::str::from_utf8(&config).unwrap()).unwrap();
}

/// What no engine takes is the same on every tier, whatever its kernels do.
#[test]
fn networks_run_whatever_their_inputs_are_multiples_of() {
    use edgecap::engine::{Model, Network, Precision};
    // Layers one behind the other, which inputs of any size suit.
    let text = String::from_utf8(seeds::seeds("network").remove(1)).unwrap();
    for multiple in [1, 8, 12, 16, 20, 32] {
        let other = text.replace("multiple = 16", &format!("multiple = {multiple}"));
        let model = Model::random(Network::parse(&other).unwrap(), 1);
        let maps = targets::run(&model, Precision::F32, None);
        assert!(maps.is_some(), "multiples of {multiple}");
    }
}

/// The seeds as files, where libFuzzer looks for them.
#[test]
#[ignore = "writes fuzz/corpus"]
fn write_seeds() {
    for name in TARGETS.iter().map(|(name, _)| name).chain(&["mp4"]) {
        let folder = folder("corpus", name);
        fs::create_dir_all(&folder).unwrap();
        for (i, bytes) in seeds::seeds(name).iter().enumerate() {
            fs::write(folder.join(format!("seed-{i}")), bytes).unwrap();
        }
    }
}
