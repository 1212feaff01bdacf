//! Calibration: its options, its memory, sizes, and weights without ranges.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use edgecap::engine::{Model, Network};

use super::{Own, SMALL, edgecap, file, shapes, template};

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

/// What hidden files and folders are called makes them no photos.
#[test]
fn photos_to_calibrate_on_are_those_of_an_input() {
    let own = Own::new(SMALL);
    let (photos, to) = (own.path("photos"), own.path("m.ecm"));
    std::fs::create_dir_all(own.path("photos/b.jpg")).unwrap();
    std::fs::copy("docs/demo.jpg", own.path("photos/0.jpg")).unwrap();
    std::fs::write(own.path("photos/._0.jpg"), "no picture").unwrap();
    let out = own.import(&["--calibrate", &photos, "-o", &to]);
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{said}");
    let made = Model::open(Path::new(&to)).unwrap();
    let said = made.calibration();
    assert!(said.contains("over 1 pictures"), "{said}");
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
