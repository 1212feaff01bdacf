//! Films of which pictures are damaged, or whose end is missing: what could be read of them is used.

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;

use edgecap::camera::calibration::{self, write_pose2sim};
use edgecap::capture::AviWriter;
use edgecap::lab::multiview::own::{own, steady};
use edgecap::message::FLAG_FILE_TIME;
use edgecap::multiview::Mask;
use edgecap::record::{Format, ObservationsRow, RecordWriter};
use image::ImageEncoder;
use serde_json::Value;

use crate::many_views::seen_by;
use crate::program::{assert_fails, output, stderr, stdout};

/// Frames of a film.
const FRAMES: usize = 24;
/// The picture of the first film that is damaged; it and the second end inside others.
const DAMAGED: usize = 5;
const ENDS: [usize; 2] = [20, 21];

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
    // A picture of the first is of zeros, both end inside one.
    let films = ["hall/cam01.avi", "hall/cam02.avi"].map(at);
    damage(&films[0], DAMAGED);
    let second = fs::read(&films[1]).unwrap();
    for (film, end) in films.iter().zip(ENDS) {
        let whole = fs::read(film).unwrap();
        let (start, length) = pictures(&whole)[end];
        fs::write(film, &whole[..start + length / 2]).unwrap();
    }

    let (calibration, run) = (at("hall/Calib.toml"), at("run"));
    let args = ["multiview", "--calibration", &calibration, "--sync", "none"];
    let views = ["--view", &films[0], "--view", &films[1], "--out", &run];
    let args = [&args[..], &views].concat();
    // Both are looked at, and the run ends for another reason.
    let out = output(&[&args[..], &["--obj", "99"]].concat());
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(64), "{said}");
    assert!(
        said.contains("frame 5: ") && said.contains("frames 0 to 19"),
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
    // The picture that could not be read keeps its number.
    let lines = fs::read_to_string(at("run/bodies.jsonl")).unwrap();
    let last: Value = serde_json::from_str(lines.lines().last().unwrap()).unwrap();
    assert_eq!(last["frame"], ENDS[0] - 1, "{last}");
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
    for (start, length) in &all[..ENDS[1]] {
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

#[test]
fn cameras_are_found_by_what_could_be_read_of_films() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let hall = at("hall");
    let synth = "synth --views 2 --people 1 --fps 30 --width 640 --height 400 --seed 2 --frames 36";
    let mut args: Vec<&str> = synth.split(' ').collect();
    args.extend(["--out", &hall]);
    let out = output(&args);
    assert!(out.status.success(), "{}", stderr(&out));
    let (lens, found) = (at("hall/Calib.toml"), at("found.toml"));
    let films = ["hall/cam01.avi", "hall/cam02.avi"].map(at);
    damage(&films[0], DAMAGED);
    let args = ["calibrate", "--stature", "1.7", "--lens", &lens];
    let views = ["--view", &films[0], "--view", &films[1], "--out", &found];
    let out = output(&[&args[..], &views].concat());
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(65), "{said}");
    assert!(
        said.contains("frame 5: ") && said.contains("camera cam01: its film is damaged"),
        "{said}"
    );
    assert!(stdout(&out).contains("held out px"), "{}", stdout(&out));
    assert_eq!(calibration::read(found.as_ref()).unwrap().views.len(), 2);
}

/// Fills a picture of an AVI with zeros.
fn damage(film: &str, picture: usize) {
    let mut bytes = fs::read(film).unwrap();
    let (start, length) = pictures(&bytes)[picture];
    bytes[start..start + length].fill(0);
    fs::write(film, bytes).unwrap();
}

/// A film of outlines before an even wall, which is all there is where an outline is of nobody; `None` is a picture of
/// zeros.
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

/// Somebody who leaves: a mask that is made of the picture after its frame's is of nobody in the last frame.
#[test]
fn masks_are_of_the_pictures_that_were_observed() {
    const ROWS: usize = 15;
    const LEAVES: usize = 7;
    const LOST: usize = 2;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let trial = own(5, 3, LEAVES, steady(5));
    let calibration = at("Calib.toml");
    fs::write(&calibration, write_pose2sim(&trial.views)).unwrap();
    let outlines = (0..ROWS).map(|k| {
        let mut mask = trial.mask(k.min(LEAVES - 1), 0);
        if k >= LEAVES {
            mask.owners.fill(0);
        }
        Some(mask)
    });
    let mut pictures: Vec<Option<Mask>> = outlines.collect();
    film(&at("whole.avi"), &pictures);
    pictures[LOST] = None;
    film(&at("damaged.avi"), &pictures);
    let contours = ["whole", "damaged"].map(|name| {
        let (run, film) = (at(name), at(&format!("{name}.avi")));
        let film = format!("{}={film}", trial.views[0].name);
        let mut args = vec!["multiview", "--calibration", &calibration, "--out", &run];
        args.extend(["--sync", "none", "--no-dct", "--masks", "background"]);
        args.extend(["--film", &film]);
        let records = trial.views.iter().enumerate().map(|(v, view)| {
            let path = at(&format!("{}.jsonl", view.name));
            let mut file =
                RecordWriter::<ObservationsRow>::create(path.as_ref(), Format::Jsonl).unwrap();
            // `infer` writes no row of a picture that it cannot read, and counts it.
            let is_lost = |k: usize| name == "damaged" && v == 0 && k == LOST;
            for k in (0..ROWS).filter(|k| !is_lost(*k)) {
                let people = trial.seen.get(k).map_or(&[][..], |views| &views[v]);
                let mut message = seen_by(view, k, people);
                message.flags = FLAG_FILE_TIME;
                file.write(&message, "").unwrap();
            }
            file.finish().unwrap();
            path
        });
        let records: Vec<String> = records.collect();
        args.extend(records.iter().flat_map(|r| ["--view", r]));
        let out = output(&args);
        assert!(out.status.success(), "{name}: {}", stderr(&out));
        let report = fs::read_to_string(at(&format!("{name}/report.json"))).unwrap();
        let report: Value = serde_json::from_str(&report).unwrap();
        report["views"][0]["contours"].as_u64().unwrap() as usize
    });
    assert_eq!(contours, [LEAVES, LEAVES - 1]);
}
