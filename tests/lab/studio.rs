//! Several cameras round one scene: every view shows the world truth through its calibration, and masks show who is
//! where.

use std::path::Path;

use edgecap::camera::calibration;
use edgecap::capture::AviReader;
use edgecap::commands::synth::{PictureFormat, SynthArgs, synth};
use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS, PELVIS};
use edgecap::lab::eval::Jitter;
use edgecap::lab::synth::Truth;
use edgecap::lab::synth::studio::Studio;
use edgecap::lab::synth::truth::{ABSENT, VISIBLE};
use edgecap::lab::synth::world::{WorldFrame, WorldTruth};
use edgecap::message::FLAG_FILE_TIME;
use edgecap::record::ObservationsRow;
use glam::{DVec2, DVec3};

fn arguments(out: &Path) -> SynthArgs {
    SynthArgs {
        out: Some(out.to_path_buf()),
        clip: None,
        frames: 6,
        people: 2,
        seed: 9,
        width: 192,
        height: 120,
        fps: 5,
        stills: false,
        overhead: 0.0,
        views: Some(3),
        masks: false,
        observed: false,
        truth_only: true,
        quality: None,
        format: PictureFormat::Jpg,
        threads: Default::default(),
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn views_show_the_world_through_their_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("views");
    synth(SynthArgs {
        observed: true,
        ..arguments(&out)
    })
    .unwrap();
    let per_view = ["cam01", "cam02", "cam03"]
        .iter()
        .flat_map(|c| [format!("{c}.jsonl"), format!("{c}.truth.json")]);
    let mut expected: Vec<String> = per_view.collect();
    expected.insert(0, "Calib.toml".into());
    expected.push("world.json".into());
    assert_eq!(names(&out), expected);
    let views = calibration::read(&out.join("Calib.toml")).unwrap().views;
    let world = WorldTruth::load(&out.join("world.json")).unwrap();
    assert_eq!((views.len(), world.frames.len()), (3, 6));
    let (mut compared, mut seen_by) = (0, [0; 3]);
    for (v, view) in views.iter().enumerate() {
        let truth = Truth::load(&out.join(format!("{}.truth.json", view.name))).unwrap();
        let film = format!("{}.avi", view.name);
        assert_eq!(truth.clip.as_ref(), Some(&film));
        let seen = std::fs::read_to_string(out.join(format!("{}.jsonl", view.name))).unwrap();
        assert!(seen.lines().all(|line| line.contains(&film)), "{seen}");
        let first: ObservationsRow = serde_json::from_str(seen.lines().next().unwrap()).unwrap();
        assert_eq!((first.flags, first.frame_total), (FLAG_FILE_TIME, 6));
        // The floor is at z = 0.
        let eye = f64::from(truth.frames[0].camera.floor[3]);
        assert!((view.position.z - eye).abs() < 1e-4 && eye > 1.2);
        for (frame, known) in truth.frames.iter().zip(&world.frames) {
            assert_eq!((frame.frame, frame.time_ns), (known.frame, known.time_ns));
            for person in &frame.people {
                let in_world = known.people.iter().find(|p| p.id == person.id).unwrap();
                for j in 0..BODY_JOINTS {
                    let point = DVec3::from(in_world.joints3d[j].map(f64::from));
                    let pixel = view.project(point).unwrap();
                    let told = DVec2::from(person.joints2d[j].map(f64::from));
                    assert!(pixel.distance(told) < 0.15, "{v} {j}: {pixel} {told}");
                    let inside = person.visibility[j] == VISIBLE;
                    assert!(inside || person.visibility[j] == ABSENT);
                    seen_by[v] += usize::from(inside && j < EVIDENCE_JOINTS);
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 600, "{compared}");
    // All see nearly all of both people.
    let all = 2 * 6 * EVIDENCE_JOINTS;
    assert!(
        seen_by.iter().all(|n| 10 * n > 8 * all),
        "{seen_by:?} of {all}"
    );
    let directions: Vec<DVec3> = views.iter().map(|v| v.position.normalize()).collect();
    assert!(directions[0].dot(directions[1]) < 0.2 && directions[1].dot(directions[2]) < 0.2);
}

#[test]
fn who_does_what_does_not_depend_on_the_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let world = |views: u32, seed: u64| {
        let out = folder.path().join(format!("{views}-{seed}"));
        synth(SynthArgs {
            views: Some(views),
            seed,
            ..arguments(&out)
        })
        .unwrap();
        WorldTruth::load(&out.join("world.json")).unwrap()
    };
    let three = world(3, 9);
    assert_eq!(three, world(1, 9));
    assert_ne!(three.frames, world(3, 10).frames);
    let moved = |k: usize| {
        let at = |f: usize| DVec3::from(three.frames[f].people[k].joints3d[14].map(f64::from));
        (1..6)
            .map(|f| at(f).distance(at(f - 1)))
            .fold(0.0, f64::max)
    };
    assert!((0..2).all(|k| moved(k) < 0.6), "nobody jumps");
}

/// Where three people are in their first six seconds.
fn moving(fps: u32) -> Vec<WorldFrame> {
    let frames = 6 * u64::from(fps);
    let studio = Studio::new(9, (192, 120), 1, 3, frames, fps as f32);
    (0..frames).map(|k| studio.world(k)).collect()
}

/// Mean acceleration of everybody's joints, m/s².
fn acceleration(frames: &[WorldFrame], fps: u32) -> f64 {
    let mut jitter = Jitter::default();
    for frame in frames {
        let seconds = frame.frame as f64 / f64::from(fps);
        for p in &frame.people {
            let joints = p.joints3d.map(|j| j.map(f64::from));
            jitter.add(p.id, frame.frame, seconds, &joints);
        }
    }
    jitter.mean().unwrap()
}

#[test]
fn people_move_alike_at_every_frame_rate() {
    let thirty = moving(30);
    let expected = acceleration(&thirty, 30);
    for fps in [50, 100, 240] {
        let frames = moving(fps);
        let found = acceleration(&frames, fps);
        assert!(
            (found / expected - 1.0).abs() < 0.3,
            "{found:.2} m/s² at {fps} Hz, {expected:.2} at 30"
        );
        // Tenths of a second are frames at all of these rates, and the same ones.
        let of_a_tenth = frames.iter().step_by(fps as usize / 10);
        for (a, b) in of_a_tenth.zip(thirty.iter().step_by(3)) {
            assert_eq!(a.people, b.people, "frame {} at {fps} Hz", a.frame);
        }
    }
}

#[test]
fn whoever_walks_moves_in_every_frame() {
    const FPS: u32 = 240;
    let frames = moving(FPS);
    let mut walking = 0;
    for person in 0..3 {
        let pelvis = |f: &WorldFrame| DVec3::from(f.people[person].joints3d[PELVIS].map(f64::from));
        let places: Vec<DVec3> = frames.iter().map(pelvis).collect();
        // A thirtieth of a second at 0.5 m/s or more.
        let steps = places.windows(9);
        for some in steps.filter(|w| w[0].distance(w[8]) > 0.5 / 30.0) {
            walking += 1;
            for pair in some.windows(2) {
                assert!(pair[0].distance(pair[1]) > 5e-4, "{pair:?}");
            }
        }
    }
    assert!(walking > 200, "{walking}");
}

#[test]
fn masks_show_who_is_where() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("views");
    synth(SynthArgs {
        masks: true,
        frames: 2,
        ..arguments(&out)
    })
    .unwrap();
    assert_eq!(names(&out.join("masks")), ["cam01", "cam02", "cam03"]);
    let mut people = 0;
    for camera in ["cam01", "cam02", "cam03"] {
        let truth = Truth::load(&out.join(format!("{camera}.truth.json"))).unwrap();
        for frame in &truth.frames {
            let path = out.join(format!("masks/{camera}/{:06}.png", frame.frame));
            let mask = image::open(path).unwrap().into_luma8();
            assert_eq!(mask.dimensions(), (192, 120));
            assert!(mask.pixels().all(|p| p.0[0] <= 2), "identities");
            for person in &frame.people {
                let of = |id: u32| mask.pixels().filter(move |p| u32::from(p.0[0]) == id);
                let area = of(person.id).count() as f32;
                assert!(
                    (area - person.pixels).abs() < 0.12 * person.pixels + 12.0,
                    "{area} pixels of the mask, {} of the truth",
                    person.pixels
                );
                let bounds = person.bounds.expect("known where masks are made");
                for (x, y, p) in mask.enumerate_pixels() {
                    if u32::from(p.0[0]) == person.id {
                        let (x, y) = (x as f32, y as f32);
                        assert!(x > bounds[0] - 1.0 && x < bounds[2] + 1.0);
                        assert!(y > bounds[1] - 1.0 && y < bounds[3] + 1.0);
                    }
                }
                people += 1;
            }
        }
    }
    assert!(people >= 10, "{people}");
}

#[test]
fn films_come_with_the_same_truth_and_masks() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, truth_only: bool| {
        let out = folder.path().join(name);
        let args = SynthArgs {
            masks: true,
            truth_only,
            views: Some(1),
            frames: 2,
            people: 1,
            width: 96,
            height: 64,
            ..arguments(&out)
        };
        synth(args).unwrap();
        let read = |file: &str| std::fs::read(out.join(file)).unwrap();
        let both = (read("cam01.truth.json"), read("masks/cam01/000001.png"));
        (both, out.join("cam01.avi"))
    };
    let (filmed, avi) = run("film", false);
    let (known, none) = run("known", true);
    assert!(filmed == known, "light changes no truth");
    assert!(!none.exists());
    let bytes = std::io::Cursor::new(std::fs::read(avi).unwrap());
    let mut reader = AviReader::new(bytes, "cam01.avi").unwrap();
    let mut frames = 0;
    while let Some(frame) = edgecap::capture::Source::next(&mut reader).unwrap() {
        assert_eq!((frame.width, frame.height), (96, 64));
        frames += 1;
    }
    assert_eq!(frames, 2);
}
