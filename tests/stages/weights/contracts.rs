//! Contracts: what is printed is what is taken, and every mismatch is told.

use std::collections::HashMap;
use std::path::Path;

use edgecap::engine::model::{Contract, Stage2Contract};
use edgecap::engine::{Model, ModelError, Network};
use serde_json::json;

use super::{edgecap, file, shapes, template};

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

/// The page names every key of both contracts, and files that it sends people to are there.
#[test]
fn the_page_on_weights_is_complete() {
    let page = include_str!("../../../docs/weights.md");
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
