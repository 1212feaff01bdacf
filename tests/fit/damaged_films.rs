//! Films of which pictures are damaged, or whose end is missing: what could be read of them is used.

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;

use edgecap::capture::AviWriter;
use edgecap::lab::multiview::own::{own, steady};
use edgecap::multiview::Mask;
use image::ImageEncoder;

use crate::many_views::files;
use crate::program::{assert_fails, output, stderr};

/// Frames of a film.
const FRAMES: usize = 12;

/// Where the bytes of every picture of an AVI begin, and how many there are.
fn pictures(avi: &[u8]) -> Vec<(usize, usize)> {
    let movi = avi.windows(4).position(|w| w == b"movi").unwrap();
    let (mut at, mut found) = (movi + 4, Vec::new());
    while avi[at..].starts_with(b"00dc") {
        let length = u32::from_le_bytes(avi[at + 4..at + 8].try_into().unwrap()) as usize;
        found.push((at + 8, length));
        at += 8 + length + (length & 1);
    }
    found
}

#[test]
fn what_could_be_read_of_films_is_used_and_looked_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let hall = at("hall");
    let synth = "synth --views 2 --people 1 --fps 30 --width 640 --height 400 --seed 2";
    let count = FRAMES.to_string();
    let mut args: Vec<&str> = synth.split(' ').collect();
    args.extend(["--frames", &count, "--out", &hall]);
    let out = output(&args);
    assert!(out.status.success(), "{}", stderr(&out));
    // A picture of the first is of zeros, the second ends inside one.
    let films = ["hall/cam01.avi", "hall/cam02.avi"].map(at);
    let mut first = fs::read(&films[0]).unwrap();
    let (start, length) = pictures(&first)[5];
    first[start..start + length].fill(0);
    fs::write(&films[0], first).unwrap();
    let second = fs::read(&films[1]).unwrap();
    let (start, length) = pictures(&second)[FRAMES / 2];
    fs::write(&films[1], &second[..start + length / 2]).unwrap();

    let (calibration, run) = (at("hall/Calib.toml"), at("run"));
    let args = ["multiview", "--calibration", &calibration, "--sync", "none"];
    let views = ["--view", &films[0], "--view", &films[1], "--out", &run];
    let args = [&args[..], &views].concat();
    // Both are looked at, and the run ends for another reason.
    let out = output(&[&args[..], &["--obj", "99"]].concat());
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(64), "{said}");
    assert!(
        said.contains("frame 5: ") && said.contains("frames 0 to 5"),
        "{said}"
    );
    let out = output(&args);
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(65), "{said}");
    assert!(said.contains("goes on: 2 of 2 views"), "{said}");
    assert!(
        !said.contains("frame 5: "),
        "it was looked at again: {said}"
    );
    let lines = fs::read_to_string(at("run/bodies.jsonl")).unwrap();
    assert_eq!(lines.lines().count(), FRAMES / 2);
    let report = fs::read_to_string(at("run/report.json")).unwrap();
    for camera in ["cam01", "cam02"] {
        let note = format!("camera {camera}: its film is damaged or cut off");
        assert!(said.contains(&note) && report.contains(&note), "{report}");
    }

    // So is that of one view, at once.
    let alone = at("alone");
    let out = output(&["multiview", "--view", &films[0], "--out", &alone]);
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(65), "{said}");
    assert!(said.contains("frame 5: "), "{said}");
    assert!(Path::new(&alone).join("bodies.jsonl").exists());
    // Of one without any picture there is nothing to keep.
    let mut nothing = fs::read(&films[1]).unwrap();
    let all = pictures(&second);
    for (start, length) in &all[..FRAMES / 2] {
        nothing[*start..start + length].fill(0);
    }
    let (film, none) = (at("nothing.avi"), at("none"));
    fs::write(&film, nothing).unwrap();
    assert_fails(
        &["multiview", "--view", &film, "--out", &none],
        65,
        &["nothing.avi"],
    );
    assert!(!Path::new(&none).exists());
}

/// A film of outlines before an even wall; `None` is a picture of zeros.
fn film(path: &str, pictures: &[Option<Mask>]) {
    let [w, h] = pictures.iter().flatten().next().unwrap().size;
    let file = BufWriter::new(File::create(path).unwrap());
    let mut avi = AviWriter::new(file, w, h, (30, 1)).unwrap();
    for picture in pictures {
        let mut bytes = Vec::new();
        match picture {
            None => bytes.resize(900, 0),
            Some(mask) => {
                let grey = mask.owners.iter().map(|o| if *o == 0 { 180 } else { 60 });
                let rgb: Vec<u8> = grey.flat_map(|g| [g; 3]).collect();
                image::codecs::jpeg::JpegEncoder::new(&mut bytes)
                    .write_image(&rgb, w, h, image::ExtendedColorType::Rgb8)
                    .unwrap();
            }
        }
        avi.write_jpeg(&bytes).unwrap();
    }
    avi.finish().unwrap();
}

/// `infer` writes no row of a picture that it cannot read: the film's other pictures are the record's frames.
#[test]
fn masks_are_of_the_pictures_that_were_observed() {
    const ROWS: usize = 6;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    files(folder.path(), 3, ROWS);
    let trial = own(5, 3, ROWS, steady(5));
    let mut pictures: Vec<Option<Mask>> = (0..ROWS).map(|k| Some(trial.mask(k, 0))).collect();
    film(&at("whole.avi"), &pictures);
    pictures.insert(2, None);
    film(&at("damaged.avi"), &pictures);
    let calibration = at("Calib.toml");
    let records = trial.views.iter().map(|v| at(&format!("{}.jsonl", v.name)));
    let records: Vec<String> = records.collect();
    let bodies = ["whole", "damaged"].map(|name| {
        let (run, film) = (at(name), at(&format!("{name}.avi")));
        let film = format!("{}={film}", trial.views[0].name);
        let mut args = vec!["multiview", "--calibration", &calibration, "--out", &run];
        args.extend(["--sync", "none", "--no-dct", "--masks", "background"]);
        args.extend(["--film", &film]);
        args.extend(records.iter().flat_map(|r| ["--view", r]));
        let out = output(&args);
        assert!(out.status.success(), "{name}: {}", stderr(&out));
        fs::read(at(&format!("{name}/bodies.npz"))).unwrap()
    });
    assert!(bodies[0] == bodies[1], "the masks are of other frames");
}
