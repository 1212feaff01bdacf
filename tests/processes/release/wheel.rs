//! `deploy/wheel`: which commit and weights a wheel says that it holds.

use std::path::PathBuf;
use std::process::Output;

use super::{COMMIT, Sources};
use crate::program::{stderr, stdout};

/// As maturin: the wheel holds the commit that it was built as, and the project that it was made of.
const MATURIN: &str = r#"for out; do :; done
version=$(sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)
{ echo "$EDGECAP_COMMIT"; cat pyproject.toml; } >"$out/edgecap-${version:-0.1.0}-py3-none-any.whl""#;
/// The features of the open weights.
const OPEN: &str = "mp4,open-weights";

fn try_wheel(sources: &Sources, features: &str) -> Output {
    let mut wheel = sources.script("wheel");
    wheel.env("FEATURES", features).output().unwrap()
}

/// Makes a wheel, and returns its name, the commit that it was built as, and the section `project`.
fn wheel(sources: &Sources, features: &str) -> (String, String, toml::Table) {
    let out = try_wheel(sources, features);
    assert!(out.status.success(), "{}", stderr(&out));
    let path = PathBuf::from(stdout(&out).trim());
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let text = std::fs::read_to_string(path).unwrap();
    let (commit, project) = text.split_once('\n').unwrap();
    let project: toml::Table = project.parse().unwrap();
    let project = project["project"].as_table().unwrap().clone();
    (name, commit.to_owned(), project)
}

/// What is built with other weights is built from a copy of the sources, which has no repository.
#[test]
fn wheels_are_of_the_commit_that_they_are_made_of_and_named_by_their_weights() {
    for (sources, commit) in [(Sources::cloned(), COMMIT), (Sources::unpacked(), "")] {
        sources.stand_in("maturin", MATURIN);
        let named = |features| {
            let (name, commit, _) = wheel(&sources, features);
            (name, commit)
        };
        let of_commit = |name: &str| (name.to_owned(), commit.to_owned());
        let academic = of_commit("edgecap-0.1.0-py3-none-any.whl");
        let version = env!("CARGO_PKG_VERSION");
        let open = of_commit(&format!("edgecap-{version}+open-py3-none-any.whl"));
        for _ in 0..2 {
            assert_eq!(named(""), academic);
            assert_eq!(named(OPEN), open);
        }
        assert!(sources.at("out").join(academic.0).exists());
    }
}

#[test]
fn a_wheel_says_the_licence_of_its_weights_and_carries_what_that_asks_for() {
    let sources = Sources::cloned();
    sources.stand_in("maturin", MATURIN);
    let attribution = "models/open/attribution.txt";
    for (features, license, carries) in [
        (
            "",
            "(MIT OR Apache-2.0) AND LicenseRef-edgecap-weights-academic",
            false,
        ),
        (OPEN, "(MIT OR Apache-2.0)", true),
    ] {
        let (_, _, project) = wheel(&sources, features);
        assert_eq!(project["license"].as_str(), Some(license));
        let files = project["license-files"].as_array().unwrap();
        let has = |name: &str| files.iter().any(|f| f.as_str() == Some(name));
        assert!(
            has("LICENSE") && has("LICENSE-MIT") && has("LICENSE-APACHE"),
            "{files:?}"
        );
        assert!(has("deploy/THIRD-PARTY.txt"), "{files:?}");
        assert_eq!(has(attribution), carries, "{files:?}");
        let version = project.get("version").and_then(toml::Value::as_str);
        let open = concat!(env!("CARGO_PKG_VERSION"), "+open");
        assert_eq!(version, carries.then_some(open));
        assert_eq!(project.contains_key("dynamic"), !carries);
    }
}

/// As a formatter writes it.
#[test]
fn a_project_that_cannot_be_changed_for_the_open_weights_is_told() {
    let sources = Sources::cloned();
    sources.stand_in("maturin", MATURIN);
    let project = sources.at("sources/pyproject.toml");
    let text = std::fs::read_to_string(&project).unwrap();
    for (line, other) in [
        ("THIRD-PARTY.txt\"]", "THIRD-PARTY.txt\",\n]"),
        (" AND LicenseRef", " AND  LicenseRef"),
        ("dynamic =", "dynamic="),
    ] {
        assert!(text.contains(line), "{line}");
        std::fs::write(&project, text.replace(line, other)).unwrap();
        let out = try_wheel(&sources, OPEN);
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(70), "{line}: {said}");
        assert!(said.contains("pyproject.toml"), "{said}");
        assert!(!sources.at("out").exists());
    }
}

/// A copy of the sources lies in memory on many machines, and is thrown away.
#[test]
fn a_folder_for_builds_is_that_of_where_the_script_was_called() {
    let sources = Sources::cloned();
    let maturin = format!("mkdir -p \"$CARGO_TARGET_DIR\"\n{MATURIN}");
    sources.stand_in("maturin", &maturin);
    for features in ["", OPEN] {
        let mut wheel = sources.script("wheel");
        wheel
            .env("FEATURES", features)
            .env("CARGO_TARGET_DIR", "builds");
        let out = wheel.output().unwrap();
        assert!(out.status.success(), "{}", stderr(&out));
        std::fs::remove_dir(sources.at("builds")).unwrap();
        assert!(!sources.at("sources/builds").exists());
    }
}
