//! A tiny network with random weights, run by the engine in f32 and int8, against a reference that shares no code with
//! it.

use crate::tiny_network::{joined_twice, naive, picture, tiny};
use edgecap::engine::model::{Calibration, RangeChoice, Weights};
use edgecap::engine::{
    Algorithms, CalibrationOptions, Engine, EngineOptions, Isa, LayerProfile, Maps, Model, Network,
    Precision,
};

const SIZE: (usize, usize) = (48, 32);

fn options(precision: Precision, threads: usize, isa: Option<Isa>) -> EngineOptions {
    EngineOptions {
        width: SIZE.0,
        height: SIZE.1,
        threads,
        isa,
        precision,
        ..EngineOptions::default()
    }
}

fn engine(model: &Model, precision: Precision, threads: usize, isa: Option<Isa>) -> Engine {
    Engine::new(model, options(precision, threads, isa)).unwrap()
}

fn quantised(model: &Model) -> Model {
    let pictures = (0..4).map(|seed| picture(SIZE, seed));
    let options = CalibrationOptions {
        size: SIZE,
        choice: RangeChoice::Max,
        own_ranges: 0.5,
        correct_bias: false,
    };
    let calibration = Calibration::observe(model, pictures, options).unwrap();
    model.clone().quantise(Some(&calibration)).unwrap()
}

/// Root mean square of the difference over that of the reference.
pub fn error(expected: &Maps, found: &Maps) -> f32 {
    let all = |m: &Maps| {
        let values = m.head2d.iter().chain(&m.head3d);
        values.copied().collect::<Vec<f32>>()
    };
    let (a, b) = (all(expected), all(found));
    assert_eq!(a.len(), b.len());
    let difference: f32 = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum();
    (difference / a.iter().map(|a| a.powi(2)).sum::<f32>()).sqrt()
}

#[test]
fn f32_is_what_a_naive_reference_computes() {
    let model = Model::random(tiny(), 3);
    let picture = picture(SIZE, 9);
    let Weights::Float(weights) = model.weights() else {
        panic!("random weights are floats");
    };
    let expected = naive(model.network().graph(), weights, &picture, SIZE);
    for isa in Isa::available() {
        for algorithms in Algorithms::ALL {
            let mut alone = None;
            for threads in [1, 3] {
                let options = EngineOptions {
                    algorithms: Some(algorithms),
                    ..options(Precision::F32, threads, Some(isa))
                };
                let mut engine = Engine::new(&model, options).unwrap();
                let maps = engine.run(&picture).clone();
                let e = error(&expected, &maps);
                assert!(e < 1e-5, "{isa}, {algorithms:?}, {threads} threads: {e}");
                // However the rows are cut, tiles are the same.
                let alone = alone.get_or_insert_with(|| maps.clone());
                assert!(*alone == maps, "{isa}, {algorithms:?}, {threads} threads");
                let profile = engine.profile();
                let winograd = profile.iter().any(|l| l.kernel.contains("winograd"));
                assert_eq!(winograd, algorithms == Algorithms::Portable, "{isa}");
                let (macs, executed) = (engine.macs(), engine.executed_macs());
                assert_eq!(executed < macs, winograd, "{executed} of {macs}");
                assert_eq!(executed == macs, !winograd, "{executed} of {macs}");
            }
        }
    }
}

#[test]
fn a_layer_is_joined_twice_by_way_of_a_copy() {
    let picture = picture(SIZE, 9);
    for relu in [true, false] {
        let model = Model::random(joined_twice("a.copy", relu), 3);
        let Weights::Float(weights) = model.weights() else {
            panic!("random weights are floats");
        };
        let expected = naive(model.network().graph(), weights, &picture, SIZE);
        let quantised = quantised(&model);
        for (model, precision, most) in [
            (&model, Precision::F32, 1e-5),
            (&quantised, Precision::Int8, 0.1),
        ] {
            let mut engine = engine(model, precision, 1, None);
            let e = error(&expected, engine.run(&picture));
            assert!(e < most, "{precision:?}, ReLU {relu}: {e}");
        }
    }
    let refused = Model::random(joined_twice("a", true), 3);
    let said = Engine::new(&refused, options(Precision::F32, 1, None)).err();
    let said = said.unwrap().to_string();
    // One copy is there already, and no two layers have one name.
    let copy = r#"name = "a.copy2", from = ["a"], kernel = 1, stride = 1"#;
    assert!(
        said.contains("`e` joins `a`") && said.contains(copy) && !said.contains('\n'),
        "{said}"
    );
}

#[test]
fn f32_takes_winograd_on_tiers_whose_int8_does_not() {
    // The variable, which a developer may have set, has the last word.
    if std::env::var_os("EDGECAP_ALGORITHM").is_some() {
        println!("skipped: EDGECAP_ALGORITHM is set");
        return;
    }
    let model = Model::random(tiny(), 3);
    for isa in Isa::available() {
        let engine = engine(&model, Precision::F32, 1, Some(isa));
        assert!(engine.executed_macs() < engine.macs(), "{isa}");
    }
}

/// By these algorithms on every tier: which ones are the fastest depends on the tier.
fn by(algorithms: Algorithms, model: &Model, threads: usize, isa: Isa) -> Engine {
    let options = EngineOptions {
        algorithms: Some(algorithms),
        ..options(Precision::Int8, threads, Some(isa))
    };
    Engine::new(model, options).unwrap()
}

#[test]
fn int8_is_near_f32_and_the_same_on_every_tier() {
    let model = Model::random(tiny(), 3);
    let quantised = quantised(&model);
    let picture = picture(SIZE, 2);
    let float = engine(&model, Precision::F32, 1, None)
        .run(&picture)
        .clone();
    let portable = |threads, isa| by(Algorithms::Portable, &quantised, threads, isa);
    let scalar = portable(1, Isa::Scalar).run(&picture).clone();
    let e = error(&float, &scalar);
    assert!(e < 0.05, "{e}");
    for isa in Isa::available() {
        for threads in [1, 2, 5] {
            let mut engine = portable(threads, isa);
            assert!(*engine.run(&picture) == scalar, "{isa}, {threads} threads");
            assert_vectors(&engine);
        }
    }
}

/// Layers of groups that fell back to the scalar kernel would be the same on every tier whatever vector kernels do.
fn assert_vectors(engine: &Engine) {
    let profile = engine.profile();
    let groups = |l: &&LayerProfile| l.shape.is_some_and(|s| s.groups() > 1);
    let names: Vec<&str> = profile.iter().filter(groups).map(|l| &*l.name).collect();
    for name in [
        "up",
        "features.0.conv1",
        "features.1.conv1",
        "features.1.conv3",
    ] {
        assert!(names.contains(&name), "{name} has no groups: {names:?}");
    }
    for layer in profile.iter().filter(groups) {
        let is_scalar = layer.kernel.contains("scalar");
        assert_eq!(is_scalar, engine.isa() == Isa::Scalar, "{layer:?}");
    }
}

#[test]
fn direct_algorithms_are_near_f32_and_the_same_on_every_tier() {
    let model = Model::random(tiny(), 3);
    let quantised = quantised(&model);
    let picture = picture(SIZE, 2);
    let run = |threads, algorithms, isa| {
        let mut engine = by(algorithms, &quantised, threads, isa);
        engine.run(&picture).clone()
    };
    let scalar = run(1, Algorithms::Direct, Isa::Scalar);
    let float = engine(&model, Precision::F32, 1, None)
        .run(&picture)
        .clone();
    let e = error(&float, &scalar);
    assert!(e < 0.05, "{e}");
    // Or nothing of this was tested.
    assert!(scalar != run(1, Algorithms::Portable, Isa::Scalar));
    for isa in Isa::available() {
        for threads in [1, 2, 5] {
            let mut engine = by(Algorithms::Direct, &quantised, threads, isa);
            assert_eq!(engine.executed_macs(), engine.macs());
            assert!(*engine.run(&picture) == scalar, "{isa}, {threads} threads");
            assert_vectors(&engine);
        }
    }
}

#[test]
fn frames_do_not_remember_each_other() {
    let model = quantised(&Model::random(tiny(), 5));
    let mut used = engine(&model, Precision::Int8, 2, None);
    for seed in 0..20 {
        let picture = picture(SIZE, seed);
        let mut fresh = engine(&model, Precision::Int8, 1, None);
        assert!(used.run(&picture) == fresh.run(&picture), "picture {seed}");
    }
}

#[test]
fn dequantised_weights_are_near_the_trained_ones() {
    let model = Model::random(tiny(), 3);
    let picture = picture(SIZE, 2);
    let run = |model| engine(model, Precision::F32, 1, None).run(&picture).clone();
    let e = error(&run(&model), &run(&quantised(&model)));
    assert!(e > 0.0 && e < 0.03, "{e}");
}

#[test]
fn engines_of_other_sizes_share_weights_and_threads_and_compute_the_same() {
    let model = quantised(&Model::random(tiny(), 5));
    let sizes = [SIZE, (32, 48), (64, 32)];
    let mut first = engine(&model, Precision::Int8, 3, None);
    let mut others: Vec<Engine> = sizes[1..]
        .iter()
        .map(|&(w, h)| first.resized(w, h).unwrap())
        .collect();
    for seed in 0..6 {
        for (i, &size) in sizes.iter().enumerate() {
            let rgb = picture(size, seed);
            let options = EngineOptions {
                width: size.0,
                height: size.1,
                threads: 1,
                ..EngineOptions::default()
            };
            let mut alone = Engine::new(&model, options).unwrap();
            let shared = if i == 0 {
                &mut first
            } else {
                &mut others[i - 1]
            };
            assert!(
                shared.run(&rgb) == alone.run(&rgb),
                "{size:?}, picture {seed}"
            );
        }
    }
    // The one that was built first need not live longest.
    drop(first);
    let rgb = picture(sizes[2], 9);
    let maps = others[1].run(&rgb).clone();
    assert!(maps == *others[1].run(&rgb));
    assert!(others[0].resized(50, 32).is_err());
}

#[test]
fn what_does_not_fit_is_refused() {
    let model = Model::random(tiny(), 3);
    let with = |width, height, precision| {
        let options = EngineOptions {
            width,
            height,
            precision,
            ..EngineOptions::default()
        };
        Engine::new(&model, options).err().unwrap().to_string()
    };
    assert!(with(500, 320, Precision::F32).contains("500x320"));
    assert!(with(0, 320, Precision::F32).contains("multiples of 16"));
    assert!(with(512, 320, Precision::Int8).contains("model import"));
}

/// A network of layers to 1/8 of the picture, the last of which is `c`, and of heads.
fn network(layers: &str) -> Network {
    let text = format!(
        r#"
        name = "small"
        about = "what a test wants"
        input = {{ channels = 3, multiple = 16 }}
        output = {{ head2d = "head2d.out", head3d = "head3d.out" }}
        layers = [{layers}
          {{ kind = "conv", name = "head2d.out", from = ["c"], out = 40, kernel = 1, norm = false, relu = false }},
        ]
    "#
    );
    Network::parse(&text).unwrap()
}

#[test]
fn a_head_that_ends_in_pooling_runs_in_f32_and_is_refused_in_int8() {
    let layers = r#"
      { kind = "conv", name = "a", out = 8, kernel = 3, stride = 2 },
      { kind = "conv", name = "b", out = 8, kernel = 3, stride = 2 },
      { kind = "conv", name = "c", out = 63, kernel = 3, stride = 2 },
      { kind = "maxpool", name = "head3d.out", kernel = 3, stride = 1 },
    "#;
    let model = Model::random(network(layers), 3);
    engine(&model, Precision::F32, 1, None).run(&picture(SIZE, 1));
    let options = EngineOptions {
        width: SIZE.0,
        height: SIZE.1,
        ..EngineOptions::default()
    };
    let said = Engine::new(&quantised(&model), options).err().unwrap();
    assert!(said.to_string().contains("`head3d.out`"), "{said}");
}

#[test]
fn a_picture_beside_a_channel_of_a_layer_stays_whole() {
    // One channel beside the picture's three: four side by side.
    let layers = r#"
      { kind = "conv", name = "one", out = 1, kernel = 3 },
      { kind = "conv", name = "a", from = ["input", "one"], out = 8, kernel = 3, stride = 2 },
      { kind = "conv", name = "b", out = 8, kernel = 3, stride = 2 },
      { kind = "conv", name = "c", out = 8, kernel = 3, stride = 2 },
      { kind = "conv", name = "head3d.out", out = 63, kernel = 1, norm = false, relu = false },
    "#;
    let model = Model::random(network(layers), 5);
    let picture = picture(SIZE, 4);
    let expected = engine(&model, Precision::F32, 1, None)
        .run(&picture)
        .clone();
    let int8 = quantised(&model);
    for isa in Isa::available() {
        let e = error(
            &expected,
            engine(&int8, Precision::Int8, 1, Some(isa)).run(&picture),
        );
        assert!(e < 0.1, "{isa}: {e}");
    }
}

#[test]
fn a_picture_that_is_added_keeps_its_channels() {
    let layers = r#"
      { kind = "bottlenecks", name = "res", width = 4, out = 3, blocks = 1, stride = 1 },
      { kind = "conv", name = "a", out = 8, kernel = 3, stride = 2 },
      { kind = "conv", name = "b", out = 8, kernel = 3, stride = 2 },
      { kind = "conv", name = "c", out = 8, kernel = 3, stride = 2 },
      { kind = "conv", name = "head3d.out", out = 63, kernel = 1, norm = false, relu = false },
    "#;
    let model = Model::random(network(layers), 5);
    let Weights::Float(weights) = model.weights() else {
        panic!("random weights are floats");
    };
    let picture = picture(SIZE, 4);
    let expected = naive(model.network().graph(), weights, &picture, SIZE);
    let int8 = quantised(&model);
    for isa in Isa::available() {
        let mut engine = engine(&int8, Precision::Int8, 1, Some(isa));
        let e = error(&expected, engine.run(&picture));
        assert!(e < 0.1, "{isa}: {e}");
    }
}

/// Every phase of a transposed convolution sums taps of its own, and takes off their zero points.
#[test]
fn transposed_convolutions_of_what_can_be_negative_are_near_f32() {
    let heads = r#"
      { kind = "conv", name = "head3d.out", from = ["c"], out = 63, kernel = 1, norm = false, relu = false },
    "#;
    for layers in [
        r#"
      { kind = "conv", name = "a", out = 8, kernel = 3, stride = 4 },
      { kind = "conv", name = "b", out = 16, kernel = 3, stride = 4, relu = false },
      { kind = "deconv", name = "c", out = 16, kernel = 4, stride = 2 },
    "#,
        r#"
      { kind = "deconv", name = "up", out = 8, kernel = 4, stride = 2 },
      { kind = "conv", name = "a", out = 8, kernel = 3, stride = 4 },
      { kind = "conv", name = "c", out = 16, kernel = 3, stride = 4 },
    "#,
        // Groups of 1 and of 2 channels have no vector kernels.
        r#"
      { kind = "deconv", name = "up", out = 6, kernel = 5, stride = 3, groups = 3 },
      { kind = "conv", name = "a", out = 8, kernel = 3, stride = 3 },
      { kind = "conv", name = "b", out = 8, kernel = 3, stride = 4, relu = false },
      { kind = "deconv", name = "up2", out = 12, kernel = 4, stride = 4, groups = 4, relu = false },
      { kind = "conv", name = "c", out = 16, kernel = 3, stride = 8 },
    "#,
    ] {
        let model = Model::random(network(&[layers, heads].concat()), 5);
        let Weights::Float(weights) = model.weights() else {
            panic!("random weights are floats");
        };
        let picture = picture(SIZE, 4);
        let expected = naive(model.network().graph(), weights, &picture, SIZE);
        let int8 = quantised(&model);
        let scalar = by(Algorithms::Direct, &int8, 1, Isa::Scalar)
            .run(&picture)
            .clone();
        let e = error(&expected, &scalar);
        assert!(e < 0.1, "{layers}: {e}");
        for isa in Isa::available() {
            let mut engine = by(Algorithms::Direct, &int8, 2, isa);
            assert!(*engine.run(&picture) == scalar, "{isa}: {layers}");
        }
    }
}

#[test]
fn a_pool_that_is_added_is_near_f32() {
    for pools in [
        r#"{ kind = "maxpool", name = "pool", kernel = 3, stride = 2 },"#,
        r#"
      { kind = "maxpool", name = "first", kernel = 3, stride = 1 },
      { kind = "maxpool", name = "pool", kernel = 3, stride = 2 },
    "#,
    ] {
        let layers = format!(
            r#"
      {{ kind = "conv", name = "a", out = 16, kernel = 3, stride = 2 }},
      {pools}
      {{ kind = "bottlenecks", name = "res", width = 8, out = 16, blocks = 1, stride = 1 }},
      {{ kind = "conv", name = "c", out = 16, kernel = 3, stride = 2 }},
      {{ kind = "conv", name = "head3d.out", out = 63, kernel = 1, norm = false, relu = false }},
    "#
        );
        let model = Model::random(network(&layers), 5);
        let options = CalibrationOptions {
            size: SIZE,
            ..CalibrationOptions::default()
        };
        let pictures = (0..4).map(|seed| picture(SIZE, seed));
        let calibration = Calibration::observe(&model, pictures, options).unwrap();
        let int8 = model.clone().quantise(Some(&calibration)).unwrap();
        let picture = picture(SIZE, 4);
        let expected = engine(&model, Precision::F32, 1, None)
            .run(&picture)
            .clone();
        let mut engine = engine(&int8, Precision::Int8, 1, None);
        let e = error(&expected, engine.run(&picture));
        assert!(e < 0.1, "{pools}: {e}");
    }
}

#[test]
fn profile_names_every_layer_and_counts_its_work() {
    let model = quantised(&Model::random(tiny(), 3));
    let mut engine = engine(&model, Precision::Int8, 1, None);
    engine.run(&picture(SIZE, 0));
    let profile = engine.profile();
    let graph = model.network().graph();
    assert_eq!(profile.len(), graph.nodes.len());
    let macs: u64 = profile.iter().map(|l| l.macs).sum();
    assert_eq!(macs, graph.macs(SIZE.1, SIZE.0));
    assert_eq!(engine.macs(), macs);
    assert!(profile.iter().all(|l| l.ns > 0));
}
