//! Synthetic scenes: the truth is consistent with the pictures and the camera, and everything depends on the seed
//! alone.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;

use edgecap::capture::AviReader;
use edgecap::commands::synth::{PictureFormat, SynthArgs, synth};
use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS, PARENTS, PELVIS};
use edgecap::lab::synth::raster::{NOBODY, TRIANGLE_BITS};
use edgecap::lab::synth::render::SUPERSAMPLE;
use edgecap::lab::synth::shoot::{Reel, Shot, outline_still, shoot_still};
use edgecap::lab::synth::stills::Stills;
use edgecap::lab::synth::truth::{
    ABSENT, OCCLUDED, SELF_OCCLUDED, Truth, TruthError, TruthPerson, VISIBLE,
};
use edgecap::message::Intrinsics;

const SIZE: (u32, u32) = (256, 160);

fn stills(seed: u64) -> Stills {
    Stills {
        seed,
        size: SIZE,
        people: 5,
        overhead: 0.0,
    }
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>().sqrt()
}

fn bones(p: &TruthPerson) -> [f32; BODY_JOINTS] {
    std::array::from_fn(|j| distance(p.joints3d[j], p.joints3d[PARENTS[j]]))
}

fn projected(shot: &Shot) {
    let c = &shot.truth.camera;
    let lens = Intrinsics {
        fx: c.fx,
        fy: c.fy,
        cx: c.cx,
        cy: c.cy,
    };
    for p in &shot.truth.people {
        for j in 0..BODY_JOINTS {
            if p.joints3d[j][2] > 0.3 {
                let q = lens.project(p.joints3d[j]);
                let e = (q[0] - p.joints2d[j][0]).hypot(q[1] - p.joints2d[j][1]);
                assert!(
                    e < 0.08,
                    "joint {j} of person {} is {e} px off its projection",
                    p.id
                );
            }
        }
    }
}

/// What the samples round a joint show: whether any is the person's own, and the depth at the joint.
fn around(shot: &Shot, person: u32, at: [f32; 2], reach: i64) -> (bool, f32) {
    let s = &shot.picture.survey.samples;
    let scale = SUPERSAMPLE as f32;
    let (x, y) = (
        ((at[0] + 0.5) * scale).floor() as i64,
        ((at[1] + 0.5) * scale).floor() as i64,
    );
    let mut own = false;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let (u, v) = (x + dx, y + dy);
            if u >= 0 && v >= 0 && u < s.width as i64 && v < s.height as i64 {
                let who = s.who[v as usize * s.width + u as usize];
                own |= who != NOBODY && who >> TRIANGLE_BITS == person;
            }
        }
    }
    (own, s.z[y as usize * s.width + x as usize])
}

/// Counts joints of each visibility; checks every joint against depth and identity. `place_of` maps identities to
/// stances.
fn visibilities(shot: &Shot, counts: &mut [u32; 4], on_own: &mut u32) {
    for p in &shot.truth.people {
        // Identities count those of a scene for whom there was room, from 1, in the order of the stances.
        let place = p.id - 1;
        for j in 0..BODY_JOINTS {
            let (v, at, z) = (p.visibility[j], p.joints2d[j], p.joints3d[j][2]);
            counts[v as usize] += 1;
            let inside = at[0] > -0.4
                && at[1] > -0.4
                && at[0] < shot.frame.width as f32 - 0.6
                && at[1] < shot.frame.height as f32 - 0.6;
            if v == ABSENT {
                assert!(
                    !inside || z <= 0.1,
                    "joint {j} at {at:?} is called absent inside the picture"
                );
                continue;
            }
            let (near_own, surface) = around(shot, place, at, SUPERSAMPLE as i64);
            let (exactly_own, _) = around(shot, place, at, 0);
            match v {
                VISIBLE => {
                    *on_own += u32::from(near_own);
                    assert!(
                        surface > z - 0.21,
                        "a visible joint lies {} m behind its surface",
                        z - surface
                    );
                }
                SELF_OCCLUDED => assert!(exactly_own && surface < z),
                OCCLUDED => assert!(
                    !exactly_own && surface < z - 0.03,
                    "joint {j}: {surface} against {z}"
                ),
                other => panic!("visibility {other}"),
            }
        }
    }
}

#[test]
fn clip_truth_is_consistent() {
    let fps = 2.0;
    let reel = Reel::new(5, SIZE, 5, 8, fps);
    let mut first: BTreeMap<u32, (f32, [f32; BODY_JOINTS])> = BTreeMap::new();
    let (mut counts, mut on_own, mut moved) = ([0; 4], 0, 0.0f32);
    let mut last: BTreeMap<u32, [f32; 3]> = BTreeMap::new();
    for k in 0..reel.len() {
        let shot = reel.shot(k);
        assert_eq!(shot.truth.time_ns, (k as f64 * 1e9 / f64::from(fps)) as u64);
        assert_eq!(shot.frame.time_ns, shot.truth.time_ns);
        projected(&shot);
        visibilities(&shot, &mut counts, &mut on_own);
        for p in &shot.truth.people {
            let now = bones(p);
            let (stature, lengths) = *first.entry(p.id).or_insert((p.stature, now));
            assert_eq!(stature, p.stature);
            assert!((1.45..=2.0).contains(&stature));
            for j in 0..BODY_JOINTS {
                assert!(
                    (now[j] - lengths[j]).abs() < 5e-4,
                    "bone {j} of person {} changed its length",
                    p.id
                );
            }
            if let Some(was) = last.insert(p.id, p.joints3d[PELVIS]) {
                let step = distance(was, p.joints3d[PELVIS]);
                moved = moved.max(step);
            }
            let b = p.bounds.expect("nobody stands behind the camera of a clip");
            for at in &p.joints2d {
                assert!(
                    at[0] > b[0] - 3.0
                        && at[0] < b[2] + 3.0
                        && at[1] > b[1] - 3.0
                        && at[1] < b[3] + 3.0
                );
            }
        }
    }
    assert_eq!(first.len(), 5);
    assert!(
        counts.iter().all(|n| *n > 5),
        "every kind of visibility should occur: {counts:?}"
    );
    assert!(
        f64::from(on_own) > 0.97 * f64::from(counts[VISIBLE as usize]),
        "{on_own} of {counts:?}"
    );
    // somebody walks, nobody jumps through space
    assert!(moved > 0.3 && moved < 1.2, "{moved} m in half a second");
}

#[test]
fn stills_truth_is_consistent_and_varied() {
    let (mut counts, mut on_own, mut statures) = ([0; 4], 0, BTreeSet::new());
    let mut cameras = BTreeSet::new();
    for k in 0..8 {
        let shot = shoot_still(&stills(21), k);
        projected(&shot);
        visibilities(&shot, &mut counts, &mut on_own);
        cameras.insert(shot.truth.camera.fx.to_bits());
        statures.extend(shot.truth.people.iter().map(|p| p.stature.to_bits()));
        let mean =
            shot.frame.rgb.iter().map(|v| f64::from(*v)).sum::<f64>() / shot.frame.rgb.len() as f64;
        assert!(
            (15.0..240.0).contains(&mean),
            "picture {k} has mean brightness {mean}"
        );
    }
    assert_eq!(cameras.len(), 8);
    assert!(statures.len() >= 6, "{} people in 8 stills", statures.len());
    assert!(
        f64::from(on_own) > 0.95 * f64::from(counts[VISIBLE as usize]),
        "{on_own} of {counts:?}"
    );
}

#[test]
fn truth_without_pictures_says_where_the_same_people_are() {
    let mut compared = 0;
    for k in 0..6 {
        let (shot, known) = (shoot_still(&stills(21), k), outline_still(&stills(21), k));
        assert_eq!(shot.truth.camera, known.camera);
        for p in &known.people {
            // Who reaches into the picture with a joint does so with a box.
            let same = shot.truth.people.iter().find(|q| q.id == p.id).unwrap();
            assert_eq!(same.joints3d, p.joints3d);
            assert_eq!(same.stature, p.stature);
            for (seen, inside) in same.visibility.iter().zip(p.visibility) {
                assert_eq!(*seen == ABSENT, inside == ABSENT);
            }
            compared += 1;
        }
    }
    assert!(compared >= 6, "{compared} people in 6 stills");
}

#[test]
fn every_still_can_be_placed() {
    // Some places are so full that the first person finds no room.
    let people: usize = (0..20_000)
        .map(|k| outline_still(&stills(31), k).people.len())
        .sum();
    assert!(people > 40_000, "{people} people in 20,000 stills");
}

#[test]
fn some_people_lie_on_the_floor_and_nobody_in_it() {
    let (mut all, mut low, mut lying) = (0, 0, 0);
    for k in 0..2_000 {
        let truth = outline_still(&stills(3), k);
        let floor = truth.camera.floor;
        let height = |p: [f32; 3]| (0..3).map(|i| floor[i] * p[i]).sum::<f32>() + floor[3];
        for p in &truth.people {
            let heights = p.joints3d.map(height);
            let (crown, neck, pelvis) = (heights[0], heights[1], heights[PELVIS]);
            all += 1;
            low += i32::from(pelvis < 0.3);
            lying += i32::from(pelvis < 0.3 && neck < 0.4 && crown < 0.5);
            let deepest = heights.into_iter().fold(f32::MAX, f32::min);
            assert!(deepest > 0.0, "a joint {deepest} m above the floor");
        }
    }
    let share = |n: i32| f64::from(n) / f64::from(all);
    assert!(
        (0.05..0.15).contains(&share(low)) && (0.03..0.10).contains(&share(lying)),
        "{low} low, {lying} lying of {all}"
    );
}

#[test]
fn cameras_under_the_ceiling_look_down_at_people() {
    let steepness = |truth: &edgecap::lab::synth::TruthFrame| {
        // The floor's normal leans towards the viewer by as much as the camera looks down.
        let [_, y, z, high] = truth.camera.floor;
        ((-z).atan2(-y).to_degrees(), high)
    };
    let mut inside = 0;
    let mut steep = Vec::new();
    for k in 0..200 {
        let all = Stills {
            overhead: 1.0,
            ..stills(3)
        };
        let truth = outline_still(&all, k);
        let (angle, high) = steepness(&truth);
        assert!((2.3..=4.2).contains(&high), "{high} m up");
        steep.push(angle);
        inside += usize::from(truth.people.iter().any(|p| {
            p.visibility[..EVIDENCE_JOINTS]
                .iter()
                .filter(|&&v| v == VISIBLE)
                .count()
                >= 10
        }));
    }
    steep.sort_by(f32::total_cmp);
    assert!(
        steep[100] > 28.0,
        "half look down by {} degrees at most",
        steep[100]
    );
    assert!(
        inside > 130,
        "somebody is in the picture in {inside} of 200"
    );
}

fn arguments(out: &std::path::Path) -> SynthArgs {
    SynthArgs {
        out: Some(out.to_path_buf()),
        clip: None,
        frames: 3,
        people: 3,
        seed: 9,
        width: 96,
        height: 64,
        fps: 10,
        stills: true,
        overhead: 0.0,
        views: None,
        masks: false,
        observed: false,
        truth_only: false,
        quality: None,
        format: PictureFormat::Jpg,
        threads: Default::default(),
    }
}

#[test]
fn pictures_depend_on_the_seed_alone() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, threads: usize, seed: u64, clip: bool| -> Vec<u8> {
        let out = folder.path().join(name);
        let mut args = SynthArgs {
            seed,
            ..arguments(&out)
        };
        if clip {
            args.stills = false;
            args.clip = Some(out.join("clip.avi"));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| synth(args)).unwrap();
        let mut files: Vec<_> = std::fs::read_dir(&out)
            .unwrap()
            .map(|e| e.unwrap().path())
            .collect();
        files.sort();
        assert_eq!(files.len(), if clip { 2 } else { 4 });
        files
            .iter()
            .flat_map(|f| std::fs::read(f).unwrap())
            .collect()
    };
    let one = run("one", 1, 9, false);
    assert!(
        one == run("four", 4, 9, false),
        "the number of threads changed a still"
    );
    assert!(
        one != run("other", 1, 10, false),
        "another seed gave the same stills"
    );
    let clip = run("clip1", 1, 9, true);
    assert!(
        clip == run("clip3", 3, 9, true),
        "the number of threads changed a clip"
    );
    // Nothing half-written stays behind.
    assert!(
        std::fs::read_dir(folder.path()).unwrap().all(|e| !e
            .unwrap()
            .file_name()
            .to_string_lossy()
            .starts_with('.'))
    );
}

#[test]
fn truth_can_be_had_alone() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("known");
    let args = SynthArgs {
        truth_only: true,
        frames: 12,
        ..arguments(&out)
    };
    synth(args).unwrap();
    let truth = Truth::load(&out.join("truth.json")).unwrap();
    assert_eq!(truth.frames.len(), 12);
    assert!(truth.frames.iter().all(|f| f.file.is_none()));
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 1);
}

#[test]
fn a_folder_with_files_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("mine.txt"), "keep").unwrap();
    let error = synth(arguments(folder.path())).unwrap_err().to_string();
    assert!(error.contains("new or empty folder"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn truth_about_something_else_is_not_replaced_by_that_of_a_clip() {
    let folder = tempfile::tempdir().unwrap();
    let (clip, truth) = (
        folder.path().join("clip.avi"),
        folder.path().join("truth.json"),
    );
    let film = || {
        synth(SynthArgs {
            clip: Some(clip.clone()),
            frames: 1,
            people: 0,
            stills: false,
            ..arguments(folder.path())
        })
    };
    film().unwrap();
    film().expect("its own truth is made anew");
    let own = Truth::load(&truth).unwrap();
    // As it was written before truth named its clip.
    let unnamed = Truth { clip: None, ..own };
    let mut album = unnamed.clone();
    album.frames[0].file = Some("000000.jpg".into());
    let stills = Truth {
        fps: 0.0,
        ..unnamed.clone()
    };
    for foreign in [
        "{\"mine\": 1}".to_owned(),
        "no JSON".to_owned(),
        album.to_text(),
        stills.to_text(),
    ] {
        std::fs::write(&truth, &foreign).unwrap();
        let said = film().unwrap_err().to_string();
        assert!(said.contains("something else"), "{said}");
        assert_eq!(std::fs::read_to_string(&truth).unwrap(), foreign);
    }
    std::fs::write(&truth, unnamed.to_text()).unwrap();
    film().unwrap();
    let named = Truth::load(&truth).unwrap().clip;
    assert_eq!(named.as_deref(), Some("clip.avi"));
}

#[test]
fn other_versions_are_refused() {
    let text = Truth {
        format: "edgecap-truth".into(),
        version: 1,
        seed: 0,
        width: 1,
        height: 1,
        fps: 0.0,
        clip: None,
        frames: vec![],
    }
    .to_text();
    assert!(Truth::parse(&text, "mine").is_ok());
    let newer = text.replace("\"version\":1", "\"version\":2");
    assert!(matches!(
        Truth::parse(&newer, "newer"),
        Err(TruthError::Version { version: 2, .. })
    ));
    assert!(matches!(
        Truth::parse("{", "torn"),
        Err(TruthError::Parse { .. })
    ));
}

#[test]
fn the_bundled_clip_matches_its_truth() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("models/demo");
    let truth = Truth::load(&folder.join("truth.json")).unwrap();
    let bytes = std::fs::read(folder.join("demo.avi")).unwrap();
    let size = bytes.len() as u64 + std::fs::metadata(folder.join("truth.json")).unwrap().len();
    assert!(
        size <= 2_000_000,
        "the bundled clip and its truth take {size} bytes"
    );
    let mut reader = AviReader::new(Cursor::new(bytes), "demo.avi").unwrap();
    let mut frames = 0;
    while let Some(frame) = edgecap::capture::Source::next(&mut reader).unwrap() {
        assert_eq!((frame.width, frame.height), (truth.width, truth.height));
        frames += 1;
    }
    assert_eq!(frames, truth.frames.len());
    let here = |f: usize, id: u32| {
        truth.frames[f]
            .people
            .iter()
            .any(|p| p.id == id && p.pixels > 0.0)
    };
    let ids: BTreeSet<u32> = truth
        .frames
        .iter()
        .flat_map(|f| f.people.iter().map(|p| p.id))
        .collect();
    assert!((3..=5).contains(&ids.len()));
    let returns = |id: &u32| {
        let seen: Vec<bool> = (0..frames).map(|f| here(f, *id)).collect();
        seen.windows(2).filter(|w| !w[0] && w[1]).count() >= 1
            && seen.windows(2).any(|w| w[0] && !w[1])
    };
    assert!(ids.iter().any(returns), "nobody leaves and comes back");
    let hidden = truth
        .frames
        .iter()
        .flat_map(|f| &f.people)
        .flat_map(|p| &p.visibility[..EVIDENCE_JOINTS]);
    assert!(hidden.filter(|v| **v == OCCLUDED).count() > 500);
}
