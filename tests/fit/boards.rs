//! `edgecap calibrate --board` on pictures of boards whose cameras are known.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use edgecap::camera::{Brown, CameraFile, View, calibration};
use edgecap::capture::{AviWriter, Frame};
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, DVec4};

use crate::printed::{Lying, Photographer, Printed};
use crate::program::{assert_fails, output, stderr, stdout};

const CHESS: Printed = Printed {
    squares: [10, 7],
    side: 0.03,
    markers: None,
};
const CHARUCO: Printed = Printed {
    squares: [8, 6],
    side: 0.036,
    markers: Some(("DICT_5X5_100", 0.75)),
};

fn camera() -> View {
    View {
        name: "cam01".into(),
        size: [960, 720],
        focal: DVec2::new(830.0, 834.0),
        centre: DVec2::new(471.0, 366.0),
        distortion: Brown {
            radial: [-0.22, 0.08, -0.01],
            tangential: [0.0008, -0.0005],
        },
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    }
}

/// Boards tilted both ways, in the middle and in the corners.
fn album(printed: &Printed) -> Vec<Lying> {
    let one = |k: usize| {
        let (x, y) = ([0.0, -1.0, 1.0][k % 3], [0.0, 1.0, -1.0][(k / 3 + k) % 3]);
        let far = [0.62, 0.5, 0.56][k % 3];
        let middle = DVec3::new(x * (0.62 * far - 0.15), y * (0.45 * far - 0.105), far);
        let tilt = [
            [28.0, 0.0, 5.0],
            [-20.0, 25.0, -12.0],
            [12.0, -30.0, 90.0],
            [-30.0, -8.0, 180.0],
        ];
        printed.turned(middle, tilt[k % 4])
    };
    (0..24).map(one).collect()
}

fn photos(folder: &Path, view: &View, printed: &Printed, boards: &[Lying], seed: u64) {
    fs::create_dir_all(folder).unwrap();
    let mut photographer = Photographer::new(view, seed);
    for (k, board) in boards.iter().enumerate() {
        let picture = photographer.picture(printed, board);
        picture.save(folder.join(format!("{k}.png"))).unwrap();
    }
}

/// Runs `calibrate` and gives what it printed.
fn calibrate(args: &[&str]) -> String {
    let done = output(&[&["calibrate"], args].concat());
    assert!(done.status.success(), "{}", stderr(&done));
    stderr(&done) + &stdout(&done)
}

fn assert_lens(found: &View, truth: &View) {
    let share = (found.focal / truth.focal - 1.0).abs().max_element();
    assert!(share < 0.003, "focal {} for {}", found.focal, truth.focal);
    let off = found.centre.distance(truth.centre);
    assert!(off < 2.0, "centre {} for {}", found.centre, truth.centre);
    let worst = bend(found, truth);
    eprintln!(
        "focal {:.3} %, centre {off:.2} px, {worst:.2} px",
        100.0 * share
    );
    assert!(worst < 0.3, "pixels are {worst} px off");
}

/// How far a pixel's ray is from its pixel by the found lens, at most over the picture. Which way the camera looks,
/// nobody told, and focal lengths are looked at by themselves: the turn and the zoom that fit best are taken.
fn bend(found: &View, truth: &View) -> f64 {
    let size = truth.size.map(f64::from);
    let at = |k: usize| {
        DVec2::new(
            (k % 9) as f64 * (size[0] - 1.0),
            (k / 9) as f64 * (size[1] - 1.0),
        )
    };
    let grid: Vec<DVec2> = (0..81).map(|k| at(k) / 8.0).collect();
    let shown = |by: DVec4, pixel: DVec2| {
        let plane = truth
            .distortion
            .undistort((pixel - truth.centre) / truth.focal);
        let ray = DQuat::from_scaled_axis(by.truncate()) * plane.extend(1.0);
        let plane = ray.truncate() / ray.z;
        found.distortion.distort(plane) * found.focal * (1.0 + by.w) + found.centre - pixel
    };
    let mut by = DVec4::ZERO;
    for _ in 0..3 {
        let (mut square, mut right) = (DMat4::ZERO, DVec4::ZERO);
        for pixel in &grid {
            let off = shown(by, *pixel);
            let step = DVec4::AXES.map(|axis| (shown(by + 1e-6 * axis, *pixel) - off) / 1e-6);
            for axis in 0..2 {
                let row = DVec4::from_array(step.map(|s| s[axis]));
                square += DMat4::from_cols_array_2d(&row.to_array().map(|v| (v * row).to_array()));
                right += row * off[axis];
            }
        }
        by -= square.inverse() * right;
    }
    let off = grid.iter().map(|p| shown(by, *p).length());
    off.fold(0.0, f64::max)
}

fn lens_of(file: &str) -> View {
    let lens = CameraFile::read(file.as_ref()).unwrap();
    let seen = lens.for_frame(960, 720).unwrap();
    View {
        focal: DVec2::new(seen.fx.into(), seen.fy.into()),
        centre: DVec2::new(seen.cx.into(), seen.cy.into()),
        distortion: lens.distortion(),
        ..camera()
    }
}

#[test]
fn photos_of_a_chessboard_give_the_lens() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    photos(
        &folder.path().join("photos"),
        &camera(),
        &CHESS,
        &album(&CHESS),
        1,
    );
    let (photos, out) = (at("photos"), at("camera.toml"));
    let said = calibrate(&["--board", "9x6", "--view", &photos, "--out", &out]);
    eprintln!("{said}");
    assert_lens(&lens_of(&out), &camera());
    // One that is cut off is told, and the others are used.
    let whole = fs::read(format!("{photos}/0.png")).unwrap();
    fs::write(format!("{photos}/cut.png"), &whole[..whole.len() / 2]).unwrap();
    fs::remove_file(&out).unwrap();
    let args = ["calibrate", "--board", "9x6", "--view", &photos];
    let done = output(&[&args[..], &["--out", &out]].concat());
    let said = stderr(&done);
    assert_eq!(done.status.code(), Some(65), "{said}");
    assert!(said.contains("not used: cut: cannot be read"), "{said}");
    assert_lens(&lens_of(&out), &camera());
}

#[test]
fn photos_of_parts_of_a_charuco_board_give_the_lens() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    // Nearer, so that most pictures cut the board.
    let boards: Vec<Lying> = album(&CHARUCO)
        .into_iter()
        .map(|b| Lying {
            origin: b.origin - DVec3::Z * 0.1,
            ..b
        })
        .collect();
    photos(
        &folder.path().join("photos"),
        &camera(),
        &CHARUCO,
        &boards,
        2,
    );
    let (photos, out) = (at("photos"), at("camera.toml"));
    let board = "charuco:8x6:DICT_5X5_100";
    let said = calibrate(&[
        "--board", board, "--square", "0.036", "--marker", "0.027", "--view", &photos, "--out",
        &out,
    ]);
    eprintln!("{said}");
    assert_lens(&lens_of(&out), &camera());
}

/// Three cameras round a board in the middle of a room, z up.
fn ring() -> Vec<View> {
    let target = DVec3::new(0.0, 0.0, 0.3);
    let one = |(k, at): (usize, DVec3)| {
        let z = (target - at).normalize();
        let x = z.cross(DVec3::Z).normalize();
        View {
            name: format!("cam0{}", k + 1),
            focal: camera().focal * (1.0 + 0.05 * k as f64),
            rotation: DMat3::from_cols(x, z.cross(x), z).transpose(),
            position: at,
            ..camera()
        }
    };
    [
        DVec3::new(0.0, -0.9, 0.8),
        DVec3::new(0.55, -0.7, 0.95),
        DVec3::new(-0.6, -0.65, 0.7),
    ]
    .into_iter()
    .enumerate()
    .map(one)
    .collect()
}

/// Boards that all three see; the first lies on the floor, its first inner corner at the world's origin.
fn shared(printed: &Printed) -> Vec<Lying> {
    let flat = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let mut all = vec![Lying {
        axes: flat,
        origin: -(flat * DVec3::new(printed.side, printed.side, 0.0)),
    }];
    let facing = ring()[0].rotation.transpose();
    for k in 0..9 {
        let tilt = [[20.0, 10.0], [-15.0, -18.0], [5.0, 22.0], [-25.0, 4.0]][k % 4];
        let turn = DMat3::from_rotation_x(f64::to_radians(tilt[0]))
            * DMat3::from_rotation_y(f64::to_radians(tilt[1]))
            * DMat3::from_rotation_z(0.2 * k as f64);
        let (x, y) = ([0.0, -0.1, 0.1][k % 3], [0.05, -0.05, 0.0][k / 3 % 3]);
        let middle = DVec3::new(x, 0.1 + y, 0.3 + 0.05 * (k % 2) as f64);
        all.push(printed.centred(facing * turn, middle));
    }
    all
}

fn assert_places(found: &[View], truth: &[View], degrees: f64, metres: f64) {
    assert_eq!(found.len(), truth.len());
    for (f, t) in found.iter().zip(truth) {
        let between = f.rotation * t.rotation.transpose();
        let trace = between.x_axis.x + between.y_axis.y + between.z_axis.z;
        let angle = ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees();
        let off = f.position.distance(t.position);
        eprintln!("{}: {angle:.3}° {:.2} mm", f.name, 1e3 * off);
        assert!(
            angle < degrees && off < metres,
            "{}: {angle}° {off} m",
            f.name
        );
    }
}

#[test]
fn photos_of_one_moment_give_places_above_the_floor() {
    for (printed, board) in [(&CHESS, "9x6"), (&CHARUCO, "charuco:8x6:DICT_5X5_100")] {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name).display().to_string();
        let truth = ring();
        for (k, view) in truth.iter().enumerate() {
            let to = folder.path().join(&view.name);
            photos(&to, view, printed, &shared(printed), k as u64);
        }
        let out = at("Calib.toml");
        let (square, views) = (
            printed.side.to_string(),
            ["cam01", "cam02", "cam03"].map(at),
        );
        let mut args = vec![
            "--board", board, "--square", &square, "--floor", "0", "--out", &out,
        ];
        for view in &views {
            args.extend(["--view", view]);
        }
        let said = calibrate(&args);
        eprintln!("{said}");
        assert!(said.contains("height m"), "{said}");
        let found = calibration::read(out.as_ref()).unwrap().views;
        assert_places(&found, &truth, 0.2, 0.005);
    }
}

#[test]
fn films_and_known_lenses_do_as_well() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let truth = &ring()[..2];
    // Half a second of every board, at a rate of each film's own.
    for (view, (rate, shown)) in truth.iter().zip([(2, [1, 1, 1]), (5, [3, 2, 3])]) {
        let mut photographer = Photographer::new(view, 5);
        let file = fs::File::create(at(&format!("{}.avi", view.name))).unwrap();
        let [width, height] = view.size;
        let mut film = AviWriter::new(file, width, height, (rate, 1)).unwrap();
        for (board, times) in shared(&CHESS).iter().zip(shown) {
            let frame = Frame {
                width,
                height,
                rgb: photographer.picture(&CHESS, board).into_raw(),
                ..Frame::default()
            };
            for _ in 0..times {
                film.write_frame(&frame, 95).unwrap();
            }
        }
        film.finish().unwrap();
    }
    let [lens, first, second, out] = ["lenses.toml", "cam01.avi", "cam02.avi", "out.toml"].map(at);
    fs::write(&lens, calibration::write_pose2sim(truth)).unwrap();
    let args = [
        "--board", "9x6", "--square", "0.03", "--floor", "0.0s", "--lens", &lens, "--view", &first,
        "--view", &second, "--out", &out,
    ];
    let said = calibrate(&args);
    assert!(said.contains("cam02"), "{said}");
    let found = calibration::read(out.as_ref()).unwrap().views;
    assert_places(&found, truth, 0.2, 0.005);
    assert_eq!(found[1].focal, truth[1].focal);
    let other_floor = args.map(|arg| if arg == "0.0s" { "1.5s" } else { arg });
    let other_floor = [&["calibrate"], &other_floor[..]].concat();
    assert_fails(&other_floor, 64, &["--floor", "found 1.5s"]);
    // A damaged picture is told of, also where it is none of those that are looked at.
    let whole = fs::read(&second).unwrap();
    let mut damaged = whole.clone();
    let (start, length) = picture_of(&whole, 1);
    damaged[start..start + length].fill(0);
    fs::write(&second, damaged).unwrap();
    fs::remove_file(&out).unwrap();
    let done = output(&[&["calibrate"], &args[..]].concat());
    let said = stderr(&done);
    assert_eq!(done.status.code(), Some(65), "{said}");
    assert!(
        said.contains("frame 1: ")
            && said.contains("of camera cam02 only the pictures that can be read are looked at"),
        "{said}"
    );
    let found = calibration::read(out.as_ref()).unwrap().views;
    assert_places(&found, truth, 0.2, 0.005);
    // Of one that is cut off the pictures before that are used.
    fs::write(&second, &whole[..whole.len() * 17 / 20]).unwrap();
    fs::remove_file(&out).unwrap();
    let done = output(&[&["calibrate"], &args[..]].concat());
    let said = stderr(&done);
    assert_eq!(done.status.code(), Some(65), "{said}");
    assert!(
        said.contains("of camera cam02 only the pictures before that are looked at"),
        "{said}"
    );
    let found = calibration::read(out.as_ref()).unwrap().views;
    assert_places(&found, truth, 0.3, 0.01);
    // What lies behind that may show the floor.
    assert_fails(&other_floor, 65, &["picture 1.5s", "camera cam02", "ends"]);
}

/// Where the bytes of an AVI's picture begin, and how many there are.
fn picture_of(avi: &[u8], number: usize) -> (usize, usize) {
    let movi = avi.windows(4).position(|w| w == b"movi").unwrap();
    let length = |at: usize| u32::from_le_bytes(avi[at + 4..at + 8].try_into().unwrap()) as usize;
    let next = |at: usize| at + 8 + length(at).next_multiple_of(2);
    let at = (0..number).fold(movi + 4, |at, _| next(at));
    assert_eq!(avi[at..at + 4], *b"00dc");
    (at + 8, length(at))
}

#[test]
fn a_lens_that_is_known_stays_beside_one_that_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let truth = &ring()[..2];
    for (k, view) in truth.iter().enumerate() {
        let to = folder.path().join(&view.name);
        photos(&to, view, &CHESS, &shared(&CHESS), k as u64);
    }
    let [lens, first, second, out] = ["lens.toml", "cam01", "cam02", "out.toml"].map(at);
    fs::write(&lens, calibration::write_pose2sim(&truth[..1])).unwrap();
    let lens = format!("cam01={lens}");
    calibrate(&[
        "--board", "9x6", "--square", "0.03", "--floor", "0", "--lens", &lens, "--view", &first,
        "--view", &second, "--out", &out,
    ]);
    let found = calibration::read(out.as_ref()).unwrap().views;
    assert_places(&found, truth, 0.2, 0.005);
    assert_eq!(found[0].focal, truth[0].focal);
    let share = (found[1].focal / truth[1].focal - 1.0).abs().max_element();
    assert!(share > 0.0 && share < 0.01, "{}", found[1].focal);
}

#[test]
fn what_no_board_tells_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    for name in ["one", "other"] {
        let shots = &album(&CHESS)[..2];
        photos(&folder.path().join(name), &camera(), &CHESS, shots, 1);
    }
    let [one, empty, out] = ["one", "empty", "out.toml"].map(at);
    fs::create_dir(&empty).unwrap();
    let mixed = folder.path().join("mixed");
    fs::create_dir(&mixed).unwrap();
    for (name, side) in [("a.png", 64), ("b.png", 80)] {
        image::RgbImage::new(side, 64)
            .save(mixed.join(name))
            .unwrap();
    }
    let mixed = at("mixed");
    let turned = at("turned");
    fs::create_dir(&turned).unwrap();
    let board = Photographer::new(&camera(), 1).picture(&CHESS, &album(&CHESS)[0]);
    for (name, orientation) in [("a.jpg", 1), ("b.jpg", 3)] {
        let photo = photo_to_turn(&board, orientation);
        fs::write(Path::new(&turned).join(name), photo).unwrap();
    }
    let other = at("other");
    let charuco = "charuco:8x6:DICT_5X5_100";
    let refused = |args: &[&str], code: i32, words: &[&str]| {
        assert_fails(&[&["calibrate", "--out", &out], args].concat(), code, words);
        assert!(!Path::new(&out).exists());
    };
    let both = ["--view", &one, "--view", &other];
    let both = |more: &[&'static str]| [&both[..], more].concat();
    refused(
        &["--view", &one, "--board", "9x6"],
        65,
        &["at least 5 pictures", "2 of 2"],
    );
    refused(
        &["--view", &one, "--board", "8x6"],
        65,
        &["in none of 2", "9x6 corners"],
    );
    refused(&["--view", &one, "--board", charuco], 65, &["in none of 2"]);
    refused(
        &["--view", &mixed, "--board", "9x6"],
        65,
        &["one size", "64x64", "80x64"],
    );
    refused(
        &["--view", &turned, "--board", "9x6"],
        65,
        &[
            "camera turned",
            "EXIF",
            "a as it is stored and b turned by half",
        ],
    );
    refused(&["--view", &empty, "--board", "9x6"], 66, &["empty"]);
    let size = "--board";
    refused(&both(&[size, "9x6"]), 64, &["--square 0.025"]);
    refused(
        &both(&[size, "8x6", "--square", "0.03"]),
        64,
        &["odd and an even", "8x6"],
    );
    let marked = ["--square", "0.03", "--marker", "0.02"];
    refused(
        &[&both(&[size, "9x6"])[..], &marked].concat(),
        64,
        &["ChArUco board with --marker"],
    );
    let large = [size, charuco, "--square", "0.03", "--marker", "0.04"];
    refused(&both(&large), 64, &["smaller than squares"]);
    let floor = [size, "9x6", "--square", "0.03", "--floor", "7"];
    refused(&both(&floor), 64, &["--floor", "such as 0", "found 7"]);
    refused(
        &["--view", &one, "--board", "9x6", "--floor", "0"],
        64,
        &["two or more --view"],
    );
    refused(
        &["--view", &one, "--board", "9x6", "--lens", "x.toml"],
        64,
        &["no --lens"],
    );
    for (board, words) in [
        ("2x6", "3x3"),
        ("9by6", "9x6"),
        ("charuco:8x6:DICT_9", "DICT_9"),
    ] {
        let args = ["calibrate", "--out", &out, "--view", &one, "--board", board];
        let done = output(&args);
        assert_eq!(done.status.code(), Some(64), "{board}");
        assert!(stderr(&done).contains(words), "{}", stderr(&done));
    }
    // What is not used of pictures is said, also where the rest does not do.
    let blank = folder.path().join("one/blank.png");
    image::RgbImage::new(960, 720).save(blank).unwrap();
    let done = output(&["calibrate", "--out", &out, "--view", &one, "--board", "9x6"]);
    let said = stderr(&done);
    assert_eq!(done.status.code(), Some(65), "{said}");
    assert!(said.contains("camera one: not used: blank: "), "{said}");
    let floor = [size, "9x6", "--square", "0.03", "--floor", "blank"];
    let words = [
        "picture blank",
        "--floor names",
        "(camera one: ",
        "such as 0",
    ];
    refused(&both(&floor), 65, &words);
}

/// A photo that says how it is to be turned to be upright.
fn photo_to_turn(shown: &image::RgbImage, orientation: u8) -> Vec<u8> {
    let mut jpeg = Vec::new();
    shown
        .write_to(&mut Cursor::new(&mut jpeg), image::ImageFormat::Jpeg)
        .unwrap();
    let exif = b"\xff\xe1\0\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0";
    let (start, rest) = jpeg.split_at(2);
    [start, exif, &[orientation, 0, 0, 0, 0, 0, 0, 0], rest].concat()
}
