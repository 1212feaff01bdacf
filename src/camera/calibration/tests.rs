use glam::{DMat3, DVec2, DVec3};
use proptest::prelude::*;

use super::*;
use crate::camera::Brown;

fn ring(count: usize) -> Vec<View> {
    (0..count)
        .map(|k| {
            let rotation =
                DMat3::from_rotation_x(0.1) * DMat3::from_rotation_y(0.3 + 1.4 * k as f64);
            View {
                name: format!("cam{k:02}"),
                size: [1088, 1920],
                focal: DVec2::new(1680.0, 1684.0),
                centre: DVec2::new(533.0, 948.0),
                distortion: Brown {
                    radial: [-0.046, 0.14, 0.01],
                    tangential: [0.0006, 0.0007],
                },
                rotation,
                position: DVec3::new(0.0, 1.0, 0.0)
                    - rotation.transpose() * DVec3::new(0.0, 0.0, 3.5),
            }
        })
        .collect()
}

fn close(a: &View, b: &View) {
    let (p, q) = (DVec3::new(0.2, 1.2, -0.3), DVec3::new(-0.5, 0.1, 0.4));
    assert_eq!((&a.name, a.size), (&b.name, b.size));
    for point in [p, q] {
        let (s, t) = (a.project(point).unwrap(), b.project(point).unwrap());
        assert!((s - t).length() < 1e-3, "{}: {s} and {t}", a.name);
    }
    assert!(
        (a.position - b.position).length() < 1e-6,
        "{} and {}",
        a.position,
        b.position
    );
}

#[test]
fn pose2sim_comes_back_as_it_was_written() {
    let views = ring(12);
    let read = read_pose2sim(&write_pose2sim(&views), "c.toml").unwrap();
    assert_eq!(read.len(), 12);
    for (a, b) in views.iter().zip(&read) {
        close(a, b);
    }
}

#[test]
fn a_camera_that_is_called_like_the_table_beside_cameras_comes_back() {
    let mut views = ring(3);
    views[1].name = "metadata".into();
    views[2].name = "metadata_".into();
    let read = read_pose2sim(&write_pose2sim(&views), "c.toml").unwrap();
    let names: Vec<_> = read.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["cam00", "metadata", "metadata_"]);
}

#[test]
fn cameras_keep_the_order_of_the_file() {
    let mut views = ring(3);
    views.swap(0, 2);
    let read = read_pose2sim(&write_pose2sim(&views), "c.toml").unwrap();
    let names: Vec<_> = read.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["cam02", "cam01", "cam00"]);
}

/// A matrix as OpenCV writes one.
fn matrix(name: &str, rows: usize, numbers: &[f64]) -> String {
    let all: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    format!(
        "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {}\n   dt: d\n   data: [ {} ]\n",
        numbers.len() / rows,
        all.join(",\n       ")
    )
}

fn rows(m: DMat3) -> [f64; 9] {
    m.transpose().to_cols_array()
}

fn lens(v: &View) -> ([f64; 9], [f64; 5]) {
    let Brown {
        radial: [k1, k2, k3],
        tangential: [p1, p2],
    } = v.distortion;
    let k = [
        v.focal.x, 0.0, v.centre.x, 0.0, v.focal.y, v.centre.y, 0.0, 0.0, 1.0,
    ];
    (k, [k1, k2, p1, p2, k3])
}

#[test]
fn opencv_and_easymocap_tell_the_same_cameras() {
    let views = ring(2);
    let (mut intri, mut extri) = (
        "%YAML:1.0\n---\nnames:\n".to_owned(),
        "%YAML:1.0\n---\nnames:\n".to_owned(),
    );
    for v in &views {
        intri += &format!("   - \"{}\"\n", v.name);
    }
    for v in &views {
        let (k, d) = lens(v);
        let shift = (-(v.rotation * v.position)).to_array();
        let text = format!(
            "%YAML:1.0\n---\ncalibration_time: \"Mon\"\nimage_width: 1088\nimage_height: 1920\n{}{}{}{}",
            matrix("camera_matrix", 3, &k),
            matrix("distortion_coefficients", 5, &d),
            matrix("R", 3, &rows(v.rotation)),
            matrix("T", 3, &shift)
        );
        close(&read_opencv(&text, &v.name, "c.yml").unwrap(), v);
        let vector = glam::DQuat::from_mat3(&v.rotation)
            .to_scaled_axis()
            .to_array();
        intri += &matrix(&format!("K_{}", v.name), 3, &k);
        intri += &matrix(&format!("dist_{}", v.name), 1, &d);
        intri += &format!("W_{}: 1088\nH_{0}: 1920\n", v.name);
        extri += &matrix(&format!("R_{}", v.name), 3, &vector);
        extri += &matrix(&format!("Rot_{}", v.name), 3, &rows(v.rotation));
        extri += &matrix(&format!("T_{}", v.name), 3, &shift);
    }
    let read = read_easymocap(&intri, &extri, "folder").unwrap();
    assert_eq!(read.len(), 2);
    for (a, b) in views.iter().zip(&read) {
        close(a, b);
    }
    // Most of EasyMocap's files do not say how large pictures are.
    let told = intri.lines().filter(|l| !l.starts_with(['W', 'H']));
    let untold = told.map(|l| format!("{l}\n")).collect::<String>();
    let read = read_easymocap(&untold, &extri, "folder").unwrap();
    let read = check("folder", read).unwrap().views;
    for (a, b) in views.iter().zip(&read) {
        assert_eq!(b.size, [0; 2]);
        close(a, &b.for_pictures(a.size).unwrap());
        assert_eq!(b.for_pictures([a.size[1], a.size[0]]), None);
    }
}

/// An array of one dimension as OpenCV 5 writes it.
fn array(name: &str, numbers: &[f64]) -> String {
    let all: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    format!(
        "{name}: !!opencv-nd-matrix\n   sizes: [ {} ]\n   dt: d\n   data: [ {} ]\n",
        numbers.len(),
        all.join(", ")
    )
}

#[test]
fn arrays_of_one_dimension_are_understood() {
    let view = &ring(1)[0];
    let (k, d) = lens(view);
    let turn = glam::DQuat::from_mat3(&view.rotation).to_scaled_axis();
    let shift = -(view.rotation * view.position);
    let text = [
        "%YAML 1.2\n---\nimage_width: 1088\nimage_height: 1920\n".to_owned(),
        matrix("camera_matrix", 3, &k),
        array("distortion_coefficients", &d),
        array("rvec", &turn.to_array()),
        array("tvec", &shift.to_array()),
    ];
    close(
        &read_opencv(&text.concat(), "cam00", "c.yml").unwrap(),
        view,
    );
    let intri = |distortion: String| {
        let sizes = "W_cam00: 1088\nH_cam00: 1920\n".to_owned();
        let names = "%YAML 1.2\n---\nnames:\n   - \"cam00\"\n".to_owned();
        [names, matrix("K_cam00", 3, &k), distortion, sizes].concat()
    };
    let extri = array("R_cam00", &turn.to_array()) + &array("T_cam00", &shift.to_array());
    let read = |distortion: String| read_easymocap(&intri(distortion), &extri, "folder");
    close(&read(array("dist_cam00", &d)).unwrap()[0], view);
    // Without its distortion the lens would be another.
    for name in ["dist_cam00", "D_cam00"] {
        let rows = format!("{name}: [ [ -0.3, 0.1, 0., 0., 0. ] ]\n");
        let said = read(rows).unwrap_err().to_string();
        assert!(said.contains(&format!("cam00 with {name},")), "{said}");
    }
    assert_eq!(read(String::new()).unwrap()[0].distortion, Brown::default());
}

#[test]
fn colmap_counts_pixels_from_their_corner() {
    let mut views = ring(2);
    let mut cameras = "# Camera list\n".to_owned();
    let mut images = "# Image list\n".to_owned();
    for (k, v) in views.iter_mut().enumerate() {
        v.distortion.radial[2] = 0.0;
        let q = glam::DQuat::from_mat3(&v.rotation);
        let t = -(v.rotation * v.position);
        let (_, [k1, k2, p1, p2, _]) = lens(v);
        cameras += &format!("{k} OPENCV 1088 1920 1680 1684 533.5 948.5 {k1} {k2} {p1} {p2}\n");
        images += &format!(
            "{k} {} {} {} {} {} {} {} {k} {}.jpg\n{}\n",
            q.w,
            q.x,
            q.y,
            q.z,
            t.x,
            t.y,
            t.z,
            v.name,
            if k == 0 { "" } else { "1.0 2.0 -1" }
        );
    }
    let read = read_colmap(&cameras, &images, "folder").unwrap();
    assert_eq!(read.len(), 2);
    for (a, b) in views.iter().zip(&read) {
        close(a, b);
    }
    // A folder a camera, pictures of one name.
    let folders = images.replace("cam00.jpg", "cam00/000000.jpg");
    let folders = folders.replace("cam01.jpg", "all/cam01/000000.jpg");
    let read = read_colmap(&cameras, &folders, "folder").unwrap();
    assert_eq!([&read[0].name, &read[1].name], ["cam00", "cam01"]);
    // A name ends where the line does.
    let spaced = images.replace("cam0", "cam 0");
    let read = read_colmap(&cameras, &spaced, "folder").unwrap();
    assert_eq!([&read[0].name, &read[1].name], ["cam 00", "cam 01"]);
    let fish = cameras.replace("OPENCV", "OPENCV_FISHEYE");
    let error = read_colmap(&fish, &images, "folder")
        .unwrap_err()
        .to_string();
    assert!(error.contains("OPENCV_FISHEYE"), "{error}");
}

/// Programs write a line with every point of an image, and no end of them.
#[test]
fn images_of_many_points_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let points = "1234.56 1234.56 -1 ".repeat((bounded::SETTINGS >> 4) as usize);
    assert!(points.len() as u64 > bounded::SETTINGS);
    let camera = "1 PINHOLE 1088 1920 1680 1684 533.5 948.5\n";
    let images = format!("1 1 0 0 0 0 0 3 1 a.jpg\n{points}\n2 1 0 0 0 1 0 3 1 b.jpg\n\n");
    fs::write(at("cameras.txt"), camera).unwrap();
    fs::write(at("images.txt"), images).unwrap();
    let views = read(folder.path()).unwrap().views;
    assert_eq!([&views[0].name, &views[1].name], ["a", "b"]);
}

#[test]
fn files_that_are_no_settings_are_said_to_be_others() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("Calib.toml");
    let says = || read(&file).unwrap_err().to_string();
    fs::write(&file, b"\xff\xfe[\0c\0a\0m\0").unwrap();
    let said = says();
    assert!(
        said.contains("UTF-8") && !said.contains("permissions"),
        "{said}"
    );
    let large = fs::File::create(&file).unwrap();
    large.set_len(bounded::SETTINGS + 1).unwrap();
    let said = says();
    assert!(
        said.contains("right file") && !said.contains("permissions"),
        "{said}"
    );
}

#[test]
fn mistakes_are_named() {
    let views = ring(3);
    let text = write_pose2sim(&views);
    let rotation = |text: &str| {
        text.lines()
            .find(|l| l.starts_with("rotation"))
            .unwrap()
            .to_owned()
    };
    let mirrored = text.replacen(
        &rotation(&text),
        "rotation = [1, 0, 0, 0, 1, 0, 0, 0, -1]",
        1,
    );
    for (text, expected) in [
        (
            text.replacen("fisheye = false", "fisheye = true", 1),
            "fisheye",
        ),
        (text.replacen("1680.0", "nan", 1), "not finite"),
        (text.replacen("-0.046", "inf", 1), "not finite"),
        (text.replacen("1680.0", "-1.0", 1), "focal"),
        (mirrored, "mirrored"),
        (
            text.replacen("[1088.0, 1920.0]", "[1088.0]", 1),
            "size of 1",
        ),
        (
            text.replacen("translation", "translations", 1),
            "translation",
        ),
        ("[metadata]\n".into(), "no camera"),
        ("words".into(), "expected a calibration"),
    ] {
        let error = read_pose2sim(&text, "c.toml").unwrap_err().to_string();
        assert!(
            error.contains("c.toml") && error.contains(expected),
            "{expected}: {error}"
        );
    }
}

#[test]
fn cameras_that_cannot_be_are_refused() {
    let says = |change: &dyn Fn(&mut Vec<View>), expected: &str| {
        let mut views = ring(3);
        change(&mut views);
        let error = check("c.toml", views).unwrap_err().to_string();
        assert!(
            error.contains("c.toml") && error.contains(expected),
            "{expected}: {error}"
        );
    };
    says(&|v| v[1].name = v[0].name.clone(), "two called cam00");
    says(
        &|v| (v[1].rotation, v[1].position) = (v[0].rotation, v[0].position),
        "one place",
    );
    says(&|v| v[2].size = [1920, 1088], "turned by 90 degrees");
    says(&|v| v[2].size = [640, 360], "outside");
    says(&|v| v[0].position.x = f64::NAN, "no place");
    let metres_apart = |v: &mut Vec<View>, apart: f64| {
        let now = v[0].position.distance(v[1].position);
        v.iter_mut().for_each(|v| v.position *= apart / now);
    };
    // Two webcams 0.6 m apart, in millimetres; cameras 4 m apart, in centimetres.
    for apart in [600.0, 400.0] {
        for unit in ["by 1000 if these are millimetres", "by 100 if centimetres"] {
            says(&|v| metres_apart(v, apart), unit);
        }
    }
    says(&|v| v.clear(), "none");
}

#[test]
fn millimetres_are_recognised_and_said() {
    let mut views = ring(4);
    let right = check("c", views.clone()).unwrap();
    assert!(right.notes.is_empty());
    for v in &mut views {
        v.position *= 1e3;
    }
    let read = check("c", views).unwrap();
    assert!(read.notes[0].contains("millimetres"), "{:?}", read.notes);
    for (a, b) in right.views.iter().zip(&read.views) {
        assert!((a.position - b.position).length() < 1e-9);
    }
}

#[test]
fn distortion_off_by_64_is_read_both_ways() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("Calib.toml");
    let mut views = ring(2);
    for v in &mut views {
        v.distortion = v.distortion.scaled(1.0 / 64.0);
    }
    fs::write(&path, write_pose2sim(&views)).unwrap();
    let read = read(&path).unwrap();
    let (other, what) = read.alternative.unwrap();
    assert_eq!(what, "distortion times 64");
    assert!((other[0].distortion.radial[0] + 0.046).abs() < 1e-12);
    // An ordinary lens has one reading, and so has a mild one that was measured here.
    for text in [write_pose2sim(&ring(2)), write_measured(&views)] {
        fs::write(&path, text).unwrap();
        assert_eq!(super::read(&path).unwrap().alternative, None);
    }
}

#[test]
fn a_second_reading_of_the_distortion_comes_back_as_it_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("Calib.toml");
    for (size, scale, what) in [
        (1.0, 1.0 / 64.0, "distortion divided by 64"),
        (1.0 / 64.0, 64.0, "distortion times 64"),
    ] {
        let mut views = ring(2);
        for v in &mut views {
            v.distortion = v.distortion.scaled(size);
        }
        fs::write(&path, write_doubtful(&views, scale)).unwrap();
        let read = read(&path).unwrap();
        assert_eq!(read.other_scale(), Some(scale));
        let (other, told) = read.alternative.unwrap();
        assert_eq!(told, what);
        for (a, b) in views.iter().zip(&other) {
            assert_eq!(a.distortion.scaled(scale), b.distortion);
        }
    }
    // Somebody's own number is none of the two.
    fs::write(&path, write_doubtful(&ring(2), 3.0)).unwrap();
    assert_eq!(read(&path).unwrap().alternative, None);
}

/// What OpenCV writes of one webcam, which says nothing of where that stands.
fn lens_alone(v: &View) -> String {
    let (k, d) = lens(v);
    format!(
        "%YAML:1.0\n---\nimage_width: 1088\nimage_height: 1920\n{}{}",
        matrix("camera_matrix", 3, &k),
        matrix("distortion_coefficients", 5, &d)
    )
}

#[test]
fn lenses_are_read_where_a_file_tells_no_places() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let views = ring(2);
    let same_lens = |found: &View, truth: &View| {
        assert_eq!((&found.name, found.focal), (&truth.name, truth.focal));
        assert_eq!(
            (found.centre, found.distortion),
            (truth.centre, truth.distortion)
        );
    };
    // One camera, then a folder of several.
    let mut intri = "%YAML:1.0\n---\nnames:\n".to_owned();
    for v in &views {
        let file = at(&format!("{}.yml", v.name));
        fs::write(&file, lens_alone(v)).unwrap();
        let error = read(&file).unwrap_err().to_string();
        assert!(error.contains("without R or rvec"), "{error}");
        let [found] = &read_lenses(&file).unwrap().views[..] else {
            panic!("one camera")
        };
        same_lens(found, v);
        intri += &format!("   - \"{}\"\n", v.name);
    }
    let all = read_lenses(folder.path()).unwrap().views;
    all.iter().zip(&views).for_each(|(a, b)| same_lens(a, b));
    // All of them in one place, as of cameras that nobody has placed.
    for v in &views {
        let here = matrix("R", 3, &rows(DMat3::IDENTITY)) + &matrix("T", 3, &[0.0; 3]);
        fs::write(at(&format!("{}.yml", v.name)), lens_alone(v) + &here).unwrap();
    }
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("one place"), "{error}");
    assert_eq!(read_lenses(folder.path()).unwrap().views.len(), 2);
    // EasyMocap's lenses without its places, by the file or the folder.
    for v in &views {
        let (k, d) = lens(v);
        intri += &matrix(&format!("K_{}", v.name), 3, &k);
        intri += &matrix(&format!("dist_{}", v.name), 1, &d);
    }
    fs::write(at("intri.yml"), intri).unwrap();
    for path in [at("intri.yml"), folder.path().to_owned()] {
        let all = read_lenses(&path).unwrap().views;
        assert_eq!(all.len(), 2, "{}", path.display());
        all.iter().zip(&views).for_each(|(a, b)| same_lens(a, b));
    }
}

#[test]
fn a_lens_that_says_it_is_no_fisheye_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let (file, intri) = (
        folder.path().join("cam.yml"),
        folder.path().join("intri.yml"),
    );
    let view = &ring(1)[0];
    let matrix = matrix("K_cam00", 3, &lens(view).0);
    for (told, is_read) in [(0, true), (1, false)] {
        fs::write(
            &file,
            lens_alone(view) + &format!("fisheye_model: {told}\n"),
        )
        .unwrap();
        let several =
            format!("%YAML:1.0\n---\nnames:\n   - \"cam00\"\n{matrix}fisheye_cam00: {told}\n");
        fs::write(&intri, several).unwrap();
        for path in [&file, &intri] {
            match read_lenses(path) {
                Ok(found) => assert!(is_read && found.views[0].focal == view.focal),
                Err(e) => assert!(!is_read && e.to_string().contains("fisheye"), "{e}"),
            }
        }
    }
}

#[test]
fn what_opencv_writes_beside_yaml_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let xml = "<?xml version=\"1.0\"?>\n<opencv_storage><camera_matrix type_id=\"opencv-matrix\"/></opencv_storage>";
    let json = "{\n \"camera_matrix\": {\n \"type_id\": \"opencv-matrix\" } }";
    for (name, text, kind) in [("cam.xml", xml, "its XML"), ("cam.json", json, "its JSON")] {
        let file = folder.path().join(name);
        fs::write(&file, text).unwrap();
        for path in [file.as_path(), folder.path()] {
            let error = read(path).unwrap_err().to_string();
            assert!(
                error.contains(name) && error.contains(kind) && error.contains(".yml"),
                "{error}"
            );
        }
        fs::remove_file(file).unwrap();
    }
}

#[test]
fn a_folder_says_what_it_should_hold() {
    let folder = tempfile::tempdir().unwrap();
    let error = read(folder.path()).unwrap_err();
    assert!(error.to_string().contains("intri.yml"), "{error}");
    assert_eq!(
        read(Path::new("/nowhere/c.toml")).unwrap_err().exit_code(),
        66
    );
}

proptest! {
    #[test]
    fn any_text_is_read_or_refused(text in "[-a-zA-Z0-9_:\\[\\]\\. ,!\"\n<>=/#%]{0,400}") {
        let _ = read_pose2sim(&text, "x");
        let _ = read_opencv(&text, "x", "x");
        let _ = read_easymocap(&text, &text, "x");
        let _ = read_colmap(&text, &text, "x");
        let _ = read_qtm(&text, "x");
    }
}
