//! `deploy/THIRD-PARTY.txt` against what is linked: whoever gets the program gets the licences of all that is in it.

use std::collections::BTreeSet;
use std::process::Command;

use crate::program::{stderr, stdout};

/// Name and version of a package.
type Package = (String, String);

/// What is told of, and no package of Rust's.
const OTHERS: [&str; 2] = [
    "three.js 0.187.0, in the page of `edgecap view`: MIT",
    "Rust's standard library: MIT OR Apache-2.0",
];
/// The architectures of releases.
const TARGETS: [&str; 2] = ["x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu"];

/// Titles of the file: what stands above a text, lines that say whose it is left out.
fn titles() -> BTreeSet<&'static str> {
    let text = include_str!("../../../deploy/THIRD-PARTY.txt");
    let is_rule = |line: &str, of: char| line.len() > 80 && line.chars().all(|c| c == of);
    let mut is_title = false;
    let mut titles = BTreeSet::new();
    for line in text.lines() {
        if is_rule(line, '=') || is_rule(line, '-') {
            is_title = line.starts_with('=');
        } else if is_title && !line.starts_with(' ') {
            titles.insert(line);
        }
    }
    titles
}

/// The packages among the titles.
fn told() -> BTreeSet<Package> {
    let titles = titles().into_iter().filter(|t| !OTHERS.contains(t));
    titles
        .map(|title| {
            let (package, licence) = title.split_once(": ").expect(title);
            assert!(!licence.is_empty(), "{title}");
            let (name, version) = package.split_once(' ').expect(title);
            (name.to_owned(), version.to_owned())
        })
        .collect()
}

/// What a release for `target` links of others, or why that is not known here.
fn linked(target: &str) -> Result<BTreeSet<Package>, String> {
    let root = env!("CARGO_MANIFEST_DIR");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let out = Command::new(cargo)
        .args(["tree", "--locked", "--offline", "--all-features"])
        .args(["--package", "edgecap", "--package", "edgecap-c"])
        .args(["--edges", "normal", "--prefix", "none", "--target", target])
        .current_dir(root)
        .output()
        .map_err(|e| format!("cargo: {e}"))?;
    if !out.status.success() {
        return Err(stderr(&out));
    }
    let is_ours = |line: &&str| line.contains(root) && !line.contains("/vendor/");
    let tree = stdout(&out);
    let lines = tree.lines().filter(|l| !l.is_empty() && !is_ours(l));
    let package = |line: &str| {
        let mut words = line.split(' ');
        let name = words.next()?.to_owned();
        Some((name, words.next()?.strip_prefix('v')?.to_owned()))
    };
    Ok(lines.map(|l| package(l).expect(l)).collect())
}

#[test]
fn everything_that_is_linked_is_told_of() {
    let told = told();
    let mut all = BTreeSet::new();
    for target in TARGETS {
        match linked(target) {
            Ok(packages) => {
                let missing: Vec<_> = packages.difference(&told).collect();
                assert!(
                    missing.is_empty(),
                    "{target}: run deploy/third-party: expected {missing:?}"
                );
                all.extend(packages);
            }
            Err(why) => return eprintln!("skipped: packages of {target}: {}", why.trim()),
        }
    }
    assert!(all.len() > 150, "{} packages", all.len());
    assert_eq!(told, all, "run deploy/third-party");
}

#[test]
fn nothing_is_told_of_that_is_not_locked() {
    let lock: toml::Table = include_str!("../../../Cargo.lock").parse().unwrap();
    let of = |package: &toml::Value, key: &str| package[key].as_str().unwrap().to_owned();
    let packages = lock["package"].as_array().unwrap().iter();
    let locked: BTreeSet<Package> = packages
        .map(|p| (of(p, "name"), of(p, "version")))
        .collect();
    for package in told() {
        assert!(
            locked.contains(&package),
            "run deploy/third-party: {package:?} is not in Cargo.lock"
        );
    }
    // Packages of features, of C++ and of the page among them.
    let titles = titles();
    for of in ["openh264-sys2 ", "iceoryx2 ", "v4l2-sys-mit "]
        .iter()
        .chain(&OTHERS)
    {
        assert!(titles.iter().any(|t| t.starts_with(of)), "{of}");
    }
}

/// One whose licence asks for its notice, by each kind of licence.
#[test]
fn texts_say_whose_they_are() {
    let text = include_str!("../../../deploy/THIRD-PARTY.txt");
    for notice in [
        "Copyright © 2010-2026 three.js authors",
        "Copyright (c) 2013, Cisco Systems",
        "Copyright (c) 2018, Mapbox",
        "Copyright 2020 Sébastien Crozet",
        "Copyright © 1991-2023 Unicode, Inc.",
    ] {
        assert!(text.contains(notice), "{notice}");
    }
}
