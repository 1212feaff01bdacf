//! camera.toml: the lens, its distortion, and files that are wrong.

use edgecap::camera::CameraFile;

#[test]
fn the_lens_scales_with_the_picture() {
    let default = CameraFile::default().for_frame(640, 480).unwrap();
    assert!((default.fx - 320.0 / 30f32.to_radians().tan()).abs() < 1e-2);
    assert_eq!((default.cx, default.cy), (319.5, 239.5));

    let file = CameraFile::parse(
        "fx = 1000.0\nfy = 990.0\ncx = 639.5\ncy = 359.5\nwidth = 1280\nheight = 720\n",
    )
    .unwrap();
    let same = file.for_frame(1280, 720).unwrap();
    assert_eq!(
        (same.fx, same.fy, same.cx, same.cy),
        (1000.0, 990.0, 639.5, 359.5)
    );
    let half = file.for_frame(640, 360).unwrap();
    assert_eq!(
        (half.fx, half.fy, half.cx, half.cy),
        (500.0, 495.0, 319.5, 179.5)
    );
    // A ray through the same point of the scene stays the same ray.
    let (a, b) = (
        same.ray(200.0, 100.0),
        half.ray(200.5 / 2.0 - 0.5, 100.5 / 2.0 - 0.5),
    );
    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6));
    assert!(file.for_frame(640, 480).unwrap_err().contains("1280x720"));

    let wide = CameraFile::parse("fov_degrees = 90.0")
        .unwrap()
        .for_frame(200, 100)
        .unwrap();
    assert!((wide.fx - 100.0).abs() < 1e-3);
}

#[test]
fn a_lens_keeps_its_distortion_in_the_file() {
    let plain = "fx = 900.0\ncx = 300.0\ncy = 200.0\nwidth = 640\nheight = 480\n";
    let bent = format!("{plain}k1 = -0.2\nk2 = 0.1\np1 = 0.001\np2 = -0.002\nk3 = 0.01\n");
    let lens = CameraFile::parse(&bent).unwrap();
    assert_eq!(lens.distortion().radial, [-0.2, 0.1, 0.01]);
    assert_eq!(lens.distortion().tangential, [0.001, -0.002]);
    assert_eq!(
        CameraFile::parse(&toml::to_string(&lens).unwrap()),
        Ok(lens)
    );
    let straight = CameraFile::parse(plain).unwrap();
    assert!(!toml::to_string(&straight).unwrap().contains("k1"));
    for wrong in [
        format!("{plain}k1 = nan"),
        "fov_degrees = 60.0\nk1 = 0.1".into(),
    ] {
        CameraFile::parse(&wrong).unwrap_err();
    }
}

#[test]
fn the_help_names_what_a_camera_file_may_hold() {
    let keys = [
        ("fov_degrees", "fov_degrees = 70.0"),
        (
            "fx, fy, cx, cy, width, height",
            "fx = 9.0\nfy = 9.0\ncx = 3.0\ncy = 2.0\nwidth = 8\nheight = 6",
        ),
    ];
    for verb in ["run", "infer", "fit"] {
        let help = std::process::Command::new(env!("CARGO_BIN_EXE_edgecap"))
            .args([verb, "--help"])
            .output()
            .unwrap();
        let words: Vec<String> = String::from_utf8(help.stdout)
            .unwrap()
            .split_whitespace()
            .map(String::from)
            .collect();
        let help = words.join(" ");
        for (named, text) in keys {
            assert!(help.contains(named), "{verb} --help does not name {named}");
            CameraFile::parse(text).unwrap();
        }
    }
}

#[test]
fn wrong_camera_files_are_refused_with_a_reason() {
    for (text, word) in [
        ("", "either fov_degrees"),
        ("fov_degrees = 200.0", "1 to 179"),
        ("fov_degrees = 60.0\nfx = 3.0", "either fov_degrees"),
        ("fx = 1000.0\ncx = 1.0\ncy = 1.0", "width"),
        (
            "fx = 1000.0\ncx = 9999.0\ncy = 1.0\nwidth = 100\nheight = 100",
            "principal point",
        ),
        (
            "fx = nan\ncx = 9.0\ncy = 1.0\nwidth = 100\nheight = 100",
            "focal",
        ),
        ("fov_degrees = 60.0\nzoom = 2", "line 2"),
        ("fov_degrees = \"wide\"", "line 1"),
        ("][", "line 1"),
    ] {
        let error = CameraFile::parse(text).unwrap_err();
        assert!(
            error.contains(word) && !error.contains('\n'),
            "{text:?}: {error}"
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.toml");
    assert_eq!(CameraFile::read(&path).unwrap_err().exit_code(), 66);
    std::fs::write(&path, "nothing = true").unwrap();
    let error = CameraFile::read(&path).unwrap_err();
    assert_eq!(error.exit_code(), 78);
    assert!(error.to_string().contains("camera.toml"));
}

/// Whoever has calibrated with another program gives its file.
#[test]
fn a_calibration_of_another_program_is_told_from_a_lens() {
    let folder = tempfile::tempdir().unwrap();
    let opencv = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
                  cols: 3\n   dt: d\n   data: [ 600., 0., 320., 0., 600., 240., 0., 0., 1. ]\n";
    let pose2sim =
        "[cam01]\nsize = [640, 480]\nmatrix = [[600, 0, 320], [0, 600, 240], [0, 0, 1]]\n";
    for (name, text, whose) in [
        ("a.yml", opencv, "OpenCV"),
        ("b.yml", &opencv[opencv.find("image").unwrap()..], "OpenCV"),
        (
            "c.xml",
            "<?xml version=\"1.0\"?>\n<opencv_storage>\n",
            "OpenCV",
        ),
        ("d.toml", pose2sim, "Pose2Sim"),
        ("e.qca.txt", "<calibration><cameras/></calibration>", "QTM"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let error = CameraFile::read(&path).unwrap_err();
        assert_eq!(error.exit_code(), 78, "{error}");
        let error = error.to_string();
        let found = format!("{name}: expected the lens alone");
        assert!(error.contains(&found) && error.contains(whose), "{error}");
    }
}
