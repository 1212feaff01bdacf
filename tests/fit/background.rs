//! Masks from the background of a camera that stands still: what is somebody's, what is not, and what that is good for.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use edgecap::capture::AviWriter;
use edgecap::joints::{EVIDENCE_JOINTS, LIMB_JOINTS};
use edgecap::lab::multiview::own::{own, steady};
use edgecap::lab::multiview::{Cast, Trial, studio};
use edgecap::lab::synth::detector::Flaws;
use edgecap::lab::synth::noise::Dice;
use edgecap::lab::synth::shoot::Reel;
use edgecap::multiview::{
    Background, Figure, Mask, Masks, MultiviewOptions, Sight, Small, UNKNOWN, mask, squares,
};
use glam::{DVec2, Vec3};
use image::ImageEncoder;
use rayon::prelude::*;

use crate::many_views::files;
use crate::program::{assert_fails, output, stderr};

const SIZE: [u32; 2] = [320, 240];
/// Pictures of a film.
const FILM: usize = 24;
/// Half a limb's breadth as part of the stature.
const BREADTH: f64 = 0.05;

/// Evidence joints of somebody upright, statures: right is left in the picture.
const UPRIGHT: [[f64; 2]; EVIDENCE_JOINTS] = [
    [0.0, 0.0],
    [0.0, 0.15],
    [-0.1, 0.2],
    [-0.15, 0.34],
    [-0.17, 0.47],
    [0.1, 0.2],
    [0.15, 0.34],
    [0.17, 0.47],
    [-0.06, 0.48],
    [-0.07, 0.71],
    [-0.07, 0.95],
    [0.06, 0.48],
    [0.07, 0.71],
    [0.07, 0.95],
];

#[derive(Clone, Copy)]
struct Standing {
    at: DVec2,
    tall: f64,
    colour: Vec3,
}

impl Standing {
    fn new(x: f64) -> Self {
        Self {
            at: DVec2::new(x, 30.0),
            tall: 180.0,
            colour: Vec3::new(40.0, 60.0, 160.0),
        }
    }

    fn joints(&self) -> [DVec2; EVIDENCE_JOINTS] {
        UPRIGHT.map(|p| self.at + self.tall * DVec2::from(p))
    }

    fn figure(&self) -> Figure {
        Figure::new(&self.joints().map(Some)).unwrap()
    }

    fn shows(&self, pixel: DVec2) -> bool {
        let joints = self.joints();
        LIMB_JOINTS.iter().any(|(child, parent)| {
            let (from, along) = (joints[*parent], joints[*child] - joints[*parent]);
            let part = ((pixel - from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            pixel.distance(from + part * along) < BREADTH * self.tall
        })
    }
}

/// The room's colour at a pixel: walls with a pattern.
fn wall(x: f64, y: f64) -> Vec3 {
    let wave = ((x / 17.0).sin() * (y / 23.0).cos()) as f32;
    Vec3::new(140.0, 130.0, 110.0) + wave * Vec3::new(25.0, 20.0, 30.0)
}

/// A picture of people in the room; `light` is by how much it is brighter at a pixel.
fn picture(people: &[Standing], dice: &mut Dice, light: impl Fn(f64, f64) -> f32) -> Small {
    let mut rgb = Vec::new();
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let (x, y) = (f64::from(x), f64::from(y));
            let own = people.iter().rev().find(|p| p.shows(DVec2::new(x, y)));
            let colour = own.map_or(wall(x, y), |p| p.colour) * light(x, y);
            let noisy = colour.to_array().map(|c| c + 2.0 * dice.normal());
            rgb.extend(noisy.map(|c| c.round().clamp(0.0, 255.0) as u8));
        }
    }
    Small::new(SIZE, &rgb)
}

fn even(_: f64, _: f64) -> f32 {
    1.0
}

/// The background of a film in which somebody walks through the room.
fn walked_through(dice: &mut Dice) -> Background {
    let film = |k: usize| {
        let somebody = Standing::new(40.0 + 240.0 * k as f64 / FILM as f64);
        (picture(&[somebody], dice, even), vec![somebody.figure()])
    };
    Background::learn(&(0..FILM).map(film).collect::<Vec<_>>())
}

fn found(background: &Background, shown: &Small, people: &[Standing]) -> Option<Mask> {
    let figures: Vec<Figure> = people.iter().map(Standing::figure).collect();
    let differing = background.differs(shown, &figures)?;
    Some(mask(SIZE, &differing, &figures))
}

/// Intersection over union of a value's pixels with where somebody is.
fn overlap(mask: &Mask, own: u8, truth: impl Fn(usize) -> bool) -> f64 {
    let (mut both, mut either) = (0, 0);
    for (k, owner) in mask.owners.iter().enumerate() {
        let (a, b) = (*owner == own, truth(k));
        both += usize::from(a && b);
        either += usize::from(a || b);
    }
    both as f64 / either.max(1) as f64
}

fn pixel(k: usize) -> DVec2 {
    let w = SIZE[0] as usize;
    DVec2::new((k % w) as f64, (k / w) as f64)
}

#[test]
fn everybody_has_their_own_pixels() {
    let mut dice = Dice::new(1, 0);
    let background = walked_through(&mut dice);
    let mut people = [Standing::new(100.0), Standing::new(200.0)];
    people[1].colour = Vec3::new(60.0, 20.0, 20.0);
    let shown = picture(&people, &mut dice, even);
    let mask = found(&background, &shown, &people).unwrap();
    for (k, person) in people.iter().enumerate() {
        let overlap = overlap(&mask, k as u8 + 1, |p| person.shows(pixel(p)));
        assert!(overlap > 0.9, "person {k}: {overlap}");
        let joints = person.joints();
        assert_eq!(mask.owner(joints.into_iter()), Some(k as u8 + 1));
    }
    // Somebody who was not seen is nobody's.
    let mask = found(&background, &shown, &people[..1]).unwrap();
    assert!(mask.owners.iter().all(|o| [0, 1, UNKNOWN].contains(o)));
    let other = people[1].joints();
    assert_eq!(mask.owner(other.into_iter()), None);
}

#[test]
fn shadows_are_nobodys() {
    let mut dice = Dice::new(2, 0);
    let background = walked_through(&mut dice);
    let person = Standing::new(150.0);
    let shade = |x: f64, y: f64| if y > 190.0 && x > 150.0 { 0.68 } else { 1.0 };
    // The person stands before the shadow.
    let lit = |x: f64, y: f64| {
        if person.shows(DVec2::new(x, y)) {
            1.0
        } else {
            shade(x, y)
        }
    };
    let shown = picture(&[person], &mut dice, lit);
    let mask = found(&background, &shown, &[person]).unwrap();
    let overlap = overlap(&mask, 1, |p| person.shows(pixel(p)));
    assert!(overlap > 0.85, "{overlap}");
}

#[test]
fn another_light_is_no_person() {
    let mut dice = Dice::new(3, 0);
    let background = walked_through(&mut dice);
    let person = Standing::new(150.0);
    // Brighter all over is made up for, a lamp on one side is not.
    let shown = picture(&[person], &mut dice, |_, _| 1.3);
    let mask = found(&background, &shown, &[person]).unwrap();
    let overlap = overlap(&mask, 1, |p| person.shows(pixel(p)));
    assert!(overlap > 0.85, "{overlap}");
    let shown = picture(&[person], &mut dice, |x, _| 0.4 + 1.3 * (x / 320.0) as f32);
    assert_eq!(found(&background, &shown, &[person]), None);
    // A camera that was pushed.
    let mut moved = picture(&[], &mut dice, even);
    moved.rgb.rotate_left(20 + 14 * SIZE[0] as usize);
    assert_eq!(found(&background, &moved, &[person]), None);
}

#[test]
fn who_hardly_moves_has_no_mask() {
    let mut dice = Dice::new(4, 0);
    let still = Standing::new(150.0);
    let film = |_| (picture(&[still], &mut dice, even), vec![still.figure()]);
    let background = Background::learn(&(0..FILM).map(film).collect::<Vec<_>>());
    let shown = picture(&[still], &mut dice, even);
    let mask = found(&background, &shown, &[still]).unwrap();
    assert!(mask.owners.iter().all(|o| *o != 1));
    assert_eq!(mask.owner(still.joints().into_iter()), None);
    // Who comes in later where the background was seen has one.
    let late = Standing::new(60.0);
    let mask = found(
        &background,
        &picture(&[still, late], &mut dice, even),
        &[still, late],
    )
    .unwrap();
    let overlap = overlap(&mask, 2, |p| late.shows(pixel(p)));
    assert!(overlap > 0.85, "{overlap}");
}

#[test]
fn an_empty_room_is_nobodys() {
    let mut dice = Dice::new(5, 0);
    let background = walked_through(&mut dice);
    let shown = picture(&[], &mut dice, even);
    let mask = found(&background, &shown, &[]).unwrap();
    assert!(mask.owners.iter().all(|o| *o == 0));
    // Somebody who is told of and is not there.
    let mask = found(&background, &shown, &[Standing::new(150.0)]).unwrap();
    assert!(mask.owners.iter().all(|o| *o != 1));
    assert_eq!(
        background.differs(&Small::new([20, 20], &[9; 1200]), &[]),
        None
    );
}

/// Frames of a synthetic film, ten seconds; backgrounds are learned from some all over it.
const TAKE: u64 = 300;

/// What masks of a film's last frames are, and what they do to a fit.
#[derive(Default)]
struct Worth {
    /// Intersection over union of every mask with the truth.
    overlaps: Vec<f64>,
    /// Pictures with somebody, and those of them without a mask.
    pictures: [usize; 2],
    /// Joints, aligned joints, stature, millimetres: without masks, with these, with exact ones.
    errors: [[f64; 3]; 3],
}

/// Masks of the last `frames` of a film of one person before three cameras, whose backgrounds `samples` pictures tell;
/// and, if `fitted`, what comes of a fit with them.
fn worth(seed: u64, frames: u64, samples: u64, fitted: bool) -> Worth {
    let whole = studio(seed, 3, TAKE, Flaws::MEASURED);
    let Cast::Studio(hall) = &whole.cast else {
        panic!("of synth");
    };
    hall.prepare();
    let first = TAKE - frames;
    let mut worth = Worth::default();
    type Masked = (Option<Mask>, Vec<u8>);
    let masks: Vec<Vec<Masked>> = (0..whole.views.len())
        .into_par_iter()
        .map(|v| {
            let (view, reel) = (&whole.views[v], Reel::of(hall.seen_by(v)));
            let shot = |k: u64| {
                let shot = reel.shot(k);
                let sights = whole.seen[k as usize][v]
                    .iter()
                    .map(|o| Sight::new(view, o));
                let figures = sights.filter_map(|s| Figure::of(&s));
                let by = squares(view.size) as f64;
                let figures: Vec<Figure> = figures.map(|f| f.shrunk(by)).collect();
                let small = Small::new(view.size, &shot.frame.rgb);
                (small, figures, shot.picture.survey.owners(&[1]))
            };
            let spread = (0..samples).map(|k| shot(k * TAKE / samples));
            let background = Background::learn(&spread.map(|(s, f, _)| (s, f)).collect::<Vec<_>>());
            let masked = (first..TAKE).map(|k| {
                let (small, figures, truth) = shot(k);
                let differing = background.differs(&small, &figures);
                (differing.map(|d| mask(view.size, &d, &figures)), truth)
            });
            masked.collect()
        })
        .collect();
    for (made, truth) in masks.iter().flatten().filter(|(_, t)| t.contains(&1)) {
        worth.pictures[0] += 1;
        match made.as_ref().filter(|m| m.owners.contains(&1)) {
            Some(made) => worth.overlaps.push(overlap(made, 1, |p| truth[p] == 1)),
            None => worth.pictures[1] += 1,
        }
    }
    if !fitted {
        return worth;
    }
    let made = |frame: usize, view: usize| masks[view][frame].0.clone();
    let exact = |frame: usize, view: usize| {
        let view_size = whole.views[view].size;
        Some(Mask {
            size: view_size,
            owners: masks[view][frame].1.clone(),
            unknown: None,
        })
    };
    let end = Trial {
        seen: whole.seen[first as usize..].to_vec(),
        joints: whole.joints[first as usize..].to_vec(),
        ..whole.clone()
    };
    let ways: [Option<&Masks<'_>>; 3] = [None, Some(&made), Some(&exact)];
    worth.errors = ways.map(|way| {
        let options = MultiviewOptions {
            rate: end.rate,
            paths: true,
            hierarchy: true,
        };
        let e = end.errors(&end.fit(options, way, &|_| ()));
        [e.joints, e.aligned, e.stature].map(|x| 1e3 * x)
    });
    worth
}

#[test]
fn films_of_synthetic_people_give_masks() {
    // EDGECAP_SEEDS and EDGECAP_FRAMES, beside 31 pictures for the background, make the figures of the book.
    let number = |name: &str, usual: u64| {
        std::env::var(name).map_or(usual, |n| n.parse().expect("a number"))
    };
    let (seeds, frames) = (number("EDGECAP_SEEDS", 1), number("EDGECAP_FRAMES", 4));
    let is_trial = frames < 10;
    let samples = if is_trial { 11 } else { 31 };
    let all: Vec<Worth> = (1..=seeds)
        .map(|seed| worth(seed, frames, samples, !is_trial))
        .collect();
    let overlaps: Vec<f64> = all.iter().flat_map(|w| &w.overlaps).copied().collect();
    let mean = overlaps.iter().sum::<f64>() / overlaps.len().max(1) as f64;
    let pictures = |k: usize| all.iter().map(|w| w.pictures[k]).sum::<usize>();
    let (seen, without) = (pictures(0), pictures(1));
    println!(
        "{seeds} people, {frames} frames, 3 views: IoU {mean:.3}, {without} of {seen} pictures without a mask"
    );
    let ways = ["none", "background", "exact"].iter().enumerate();
    for (way, name) in ways.filter(|_| !is_trial) {
        let of = |k: usize| all.iter().map(|w| w.errors[way][k]).sum::<f64>() / seeds as f64;
        let each: Vec<String> = all
            .iter()
            .map(|w| format!("{:.1}", w.errors[way][0]))
            .collect();
        println!(
            "masks {name}: joints {:.1} mm ({}), aligned {:.1} mm, stature {:.1} mm",
            of(0),
            each.join(", "),
            of(1),
            of(2)
        );
    }
    assert!(
        mean > 0.75 && 2 * without < seen,
        "IoU {mean}, {without} of {seen} without"
    );
}

/// A film of somebody's outline before an even wall.
fn film(path: &Path, masks: impl Iterator<Item = Mask>) {
    let mut avi: Option<AviWriter<_>> = None;
    for mask in masks {
        let [w, h] = mask.size;
        let file = || BufWriter::new(File::create(path).unwrap());
        let avi = avi.get_or_insert_with(|| AviWriter::new(file(), w, h, (30, 1)).unwrap());
        let grey: Vec<u8> = mask
            .owners
            .iter()
            .map(|o| if *o == 0 { 180 } else { 60 })
            .collect();
        let mut bytes = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new(&mut bytes);
        let rgb: Vec<u8> = grey.iter().flat_map(|g| [*g; 3]).collect();
        encoder
            .write_image(&rgb, w, h, image::ExtendedColorType::Rgb8)
            .unwrap();
        avi.write_jpeg(&bytes).unwrap();
    }
    avi.unwrap().finish().unwrap();
}

#[test]
fn the_verb_takes_films_beside_records_and_refuses_others() {
    const FRAMES: usize = 8;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    files(folder.path(), 3, FRAMES);
    let trial = own(5, 3, FRAMES, steady(5));
    film(
        Path::new(&at("seen.avi")),
        (0..FRAMES).map(|k| trial.mask(k, 0)),
    );
    film(
        Path::new(&at("short.avi")),
        (0..3).map(|k| trial.mask(k, 0)),
    );
    let (calibration, run) = (at("Calib.toml"), at("run"));
    let records = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let with = |more: &[&str]| -> Vec<String> {
        let usual = [
            "multiview",
            "--calibration",
            &calibration,
            "--sync",
            "none",
            "--no-dct",
        ];
        let mut all: Vec<String> = usual.map(str::to_owned).to_vec();
        all.extend(["--out", &run].map(str::to_owned));
        all.extend(
            records
                .iter()
                .flat_map(|r| ["--view".to_owned(), r.clone()]),
        );
        all.extend(more.iter().map(|a| (*a).to_owned()));
        all
    };
    let refused = |code, more: &[&str], words: &[&str]| {
        let args = with(more);
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        assert_fails(&args, code, words);
        assert!(!Path::new(&run).exists(), "a failed run leaves no folder");
    };
    let background = ["--masks", "background"];
    refused(64, &background, &["films", "records", "--film"]);
    let film = |camera: &str, name: &str| format!("{camera}={}", at(name));
    let given = |film: &str| {
        let args = [background[0], background[1], "--film", film].map(str::to_owned);
        args.to_vec()
    };
    let refused_film = |code, film: &str, words: &[&str]| {
        let args = given(film);
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        refused(code, &args, words);
    };
    refused_film(
        64,
        &film("7", "seen.avi"),
        &["--film CAMERA=FILE", "0, 120, 240", "7"],
    );
    refused_film(66, &film("0", "none.avi"), &["none.avi"]);
    refused_film(
        65,
        &film("0", "short.avi"),
        &["short.avi", "8 frames", "3 frames"],
    );
    refused(64, &["--film", &film("0", "seen.avi")], &["--masks"]);
    let folder_of = ["--masks", "elsewhere", "--film", "0=x.avi"];
    refused(64, &folder_of, &["--masks background", "elsewhere"]);
    let args = given(&film("0", "seen.avi"));
    let args = with(&args.iter().map(String::as_str).collect::<Vec<_>>());
    let out = output(&args.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(out.status.success(), "{}", stderr(&out));
    assert!(Path::new(&run).join("bodies.npz").exists());
}
