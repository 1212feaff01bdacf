//! Settings of the association that a model file carries: they hold for that model alone.

use edgecap::detect::AssociationConfig;
use edgecap::engine::Model;

use crate::program::{assert_fails, edgecap, output, people_in, stderr, stdout};

/// A model file with the shipped weights and these settings.
fn model(folder: &tempfile::TempDir, settings: &str) -> String {
    let path = folder.path().join("own.ecm");
    let model = Model::shipped().unwrap();
    model.with_association(settings.into()).save(&path).unwrap();
    path.to_str().unwrap().to_owned()
}

/// The shipped settings with a change.
fn settings(change: impl FnOnce(&mut AssociationConfig)) -> String {
    let mut shipped = AssociationConfig::default();
    change(&mut shipped);
    toml::to_string(&shipped).unwrap()
}

#[test]
fn a_model_is_asked_by_its_own_settings() {
    let folder = tempfile::tempdir().unwrap();
    let people = |options: &[&str]| people_in("docs/demo.jpg", options);
    assert!(people(&["--quality", "fast"]) > 0);
    let strict = model(&folder, &settings(|s| s.min_score = 0.999));
    for quality in ["fast", "best"] {
        assert_eq!(people(&["--model", &strict, "--quality", quality]), 0);
    }
    let said = stdout(&output(&["model", "info", &strict]));
    assert!(said.contains("association  its own settings"), "{said}");
    assert!(output(&["model", "verify", &strict]).status.success());
}

#[test]
fn settings_that_nothing_can_hold_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let endless = settings(|s| s.max_peaks = 1_000_000);
    let says = ["'max_peaks' of 1 to 256", "1000000"];
    let crafted = model(&folder, &endless);
    assert_fails(&["model", "verify", &crafted], 65, &says);
    let out = folder.path().join("out.jsonl");
    let infer = ["infer", "--input", "demo", "--model", &crafted, "--jsonl"];
    assert_fails(&[&infer[..], &[out.to_str().unwrap()]].concat(), 65, &says);
    assert!(!out.exists());
    let (file, output) = (folder.path().join("a.toml"), folder.path().join("new.ecm"));
    std::fs::write(&file, endless).unwrap();
    let import = [
        "model",
        "import",
        "models/weights/stage1.safetensors",
        "--association",
    ];
    let (file, output) = (file.to_str().unwrap(), output.to_str().unwrap());
    assert_fails(
        &[&import[..], &[file, "-o", output]].concat(),
        78,
        &["a.toml", says[0]],
    );
    assert_fails(
        &[&import[..], &["/nowhere.toml", "-o", output]].concat(),
        66,
        &["/nowhere.toml"],
    );
    assert!(!std::path::Path::new(output).exists());
}

/// To standard output goes the model and nothing else, by whatever name.
#[test]
fn a_model_comes_whole_out_of_a_pipe() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.toml");
    std::fs::write(&file, settings(|s| s.min_score = 0.999)).unwrap();
    let link = folder.path().join("link");
    std::os::unix::fs::symlink("/dev/stdout", &link).unwrap();
    let import = ["model", "import", "models/edgecap.ecm", "--association"];
    for to in ["-", "/dev/stdout", link.to_str().unwrap()] {
        let mut run = edgecap();
        run.args(import).arg(&file).args(["-o", to]);
        let out = run.output().unwrap();
        assert!(out.status.success(), "{to}: {}", stderr(&out));
        let model = Model::from_bytes(&out.stdout).unwrap();
        assert!(model.association().is_some(), "{to}");
        assert!(stderr(&out).contains("blake3 of the file"), "{to}");
    }
}
