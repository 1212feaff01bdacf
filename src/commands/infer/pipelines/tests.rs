use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::*;
use crate::capture::{demo, open_bytes};
use crate::engine::{Model, Network};
use crate::schedule::inputs::Quality;

const SECOND: u64 = 1_000_000_000;
const WALL: (usize, usize) = (512, 320);

/// For a film with the input that follows the people in view.
fn following(live: Option<u64>) -> Pipelines {
    let engine = EngineArgs {
        threads: Some(1),
        ..EngineArgs::default()
    };
    Pipelines::new(&engine, true, live).unwrap()
}

fn wall() -> Frame {
    let (w, h) = WALL;
    Frame {
        width: w as u32,
        height: h as u32,
        rgb: vec![128; 3 * w * h],
        ..Frame::default()
    }
}

fn lens() -> Intrinsics {
    let (w, h) = WALL;
    Intrinsics::from_horizontal_fov(w as u32, h as u32, 60.0)
}

/// People of some 50 pixels, before the wall.
fn far_away() -> Frame {
    let mut clip = open_bytes("demo", demo::CLIP).unwrap();
    let (mut near, mut far) = (Frame::default(), wall());
    assert!(clip.next_into(&mut near).unwrap());
    let [across, down] = [near.width, near.height].map(|n| n as usize / 4);
    for y in 0..down {
        for x in 0..across {
            let from = 4 * 3 * (y * near.width as usize + x);
            let to = 3 * ((80 + y) * far.width as usize + 80 + x);
            far.rgb[to..to + 3].copy_from_slice(&near.rgb[from..from + 3]);
        }
    }
    far
}

#[test]
fn every_look_at_a_picture_counts_for_its_times() {
    let (mut pipelines, lens, mut picture) = (following(None), lens(), wall());
    pipelines.process(&picture, &lens).unwrap();
    picture.time_ns = SECOND;
    let both = pipelines.process(&picture, &lens).unwrap().times;
    let of = |pipelines: &mut Pipelines| match &mut pipelines.stages {
        Stages::Following(f) => {
            let built = f.shapes.of(sizes_of(WALL)).unwrap();
            [0, 1, 2].map(|level| built[level].seen().times)
        }
        _ => panic!("expected the input that follows people"),
    };
    let [large, middle, _] = of(&mut pipelines);
    assert!(middle.stage1_us > 0, "no other input was looked at");
    assert_eq!(both, sum(large, middle));
    let both = pipelines.look(&picture, &lens, true).unwrap().times;
    let [large, _, small] = of(&mut pipelines);
    assert!(small.stage1_us > 0);
    assert_eq!(both, sum(small, large));
}

fn grey((w, h): (usize, usize)) -> Frame {
    Frame {
        width: w as u32,
        height: h as u32,
        rgb: vec![128; 3 * w * h],
        ..Frame::default()
    }
}

#[test]
fn of_thirty_pictures_a_second_every_other_one_is_looked_at_where_fifteen_are_wanted() {
    let engine = EngineArgs {
        threads: Some(1),
        quality: Some(Quality::Fast),
        ..EngineArgs::default()
    };
    let mut pipelines = Pipelines::new(&engine, true, None).unwrap();
    let mut clip = open_bytes("demo", demo::CLIP).unwrap();
    let mut picture = Frame::default();
    assert!(clip.next_into(&mut picture).unwrap());
    for k in 0..12 {
        picture.time_ns = SECOND + k * SECOND / 30;
        let way = pipelines.choose(&picture).unwrap();
        let seen = pipelines.process(&picture, &lens()).unwrap();
        assert_eq!(way == Way::Followed, seen.times.stage1_us == 0);
        // The first one is late by its whole time.
        let is_between = k > 1 && k % 2 == 1;
        assert_eq!(way == Way::Followed, is_between, "picture {k}");
    }
    picture.time_ns += SECOND / 30;
    pipelines.look(&picture, &lens(), false).unwrap();
    picture.time_ns += SECOND / 60;
    assert_ne!(pipelines.choose(&picture).unwrap(), Way::Followed);
}

#[test]
fn pictures_of_any_time_are_looked_at() {
    for size in [Some("256x160"), None] {
        let engine = EngineArgs {
            threads: Some(1),
            size: size.map(|size| size.parse().unwrap()),
            looks: Some(15.0),
            ..EngineArgs::default()
        };
        let mut pipelines = Pipelines::new(&engine, true, None).unwrap();
        let times = [0, SECOND / 15, u64::MAX - 1, u64::MAX, u64::MAX, 0];
        for (k, time_ns) in times.into_iter().enumerate() {
            let mut picture = if k % 2 == 0 { far_away() } else { wall() };
            picture.time_ns = time_ns;
            pipelines.choose(&picture).unwrap();
            let seen = pipelines.process(&picture, &lens()).unwrap();
            assert!(seen.times.stage1_us > 0, "{time_ns}");
        }
    }
}

/// A clock by which so many nanoseconds go by from one question to the next.
fn ticking(step: &Arc<AtomicU64>) -> Box<dyn Fn() -> u64 + Send> {
    let (step, now) = (Arc::clone(step), AtomicU64::new(0));
    Box::new(move || now.fetch_add(step.load(Ordering::Relaxed), Ordering::Relaxed))
}

#[test]
fn a_machine_that_becomes_slower_is_told_of_with_inputs_of_any_kind() {
    let fixed = EngineArgs {
        threads: Some(1),
        size: Some("64x64".parse().unwrap()),
        ..EngineArgs::default()
    };
    let best = EngineArgs {
        threads: Some(1),
        quality: Some(Quality::Best),
        ..EngineArgs::default()
    };
    for engine in [fixed, best] {
        let mut pipelines = Pipelines::new(&engine, true, Some(0)).unwrap();
        if let Stages::Looks(_, shares) = &mut pipelines.stages {
            *shares = [&[0.125], &[0.125]];
        }
        let step = Arc::new(AtomicU64::new(SECOND / 10));
        pipelines.clock = ticking(&step);
        let (picture, lens) = (wall(), lens());
        let mut look = |pictures| {
            for _ in 0..pictures {
                pipelines.process(&picture, &lens).unwrap();
            }
            pipelines.speed.has_told()
        };
        assert!(!look(101));
        step.store(SECOND / 2, Ordering::Relaxed);
        assert!(!look(20), "at once");
        assert!(look(20));
    }
}

#[test]
fn looks_on_the_side_say_nothing_of_the_machine() {
    let best = EngineArgs {
        threads: Some(1),
        quality: Some(Quality::Best),
        ..EngineArgs::default()
    };
    let mut pipelines = Pipelines::new(&best, true, Some(0)).unwrap();
    let lens = Intrinsics::from_horizontal_fov(512, 512, 60.0);
    let mut what_is_known = |picture: &Frame, has_turned: bool| {
        pipelines.process(picture, &lens).unwrap();
        let Stages::Looks(looks, _) = &pipelines.stages else {
            panic!("expected several looks");
        };
        assert_eq!(looks.has_turned(), has_turned);
        format!("{:?} {:?}", pipelines.speed, pipelines.crew)
    };
    let (people, mut nobody) = (square(), grey((512, 512)));
    let before = what_is_known(&people, false);
    // They are gone, and looked for on both sides.
    nobody.time_ns = people.time_ns + SECOND / 30;
    assert_eq!(what_is_known(&nobody, true), before);
    nobody.time_ns += SECOND / 30;
    assert_ne!(what_is_known(&nobody, false), before);
}

#[test]
fn a_glance_into_an_empty_room_needs_no_stages_of_its_own() {
    let engine = EngineArgs {
        threads: Some(1),
        quality: Some(Quality::Best),
        ..EngineArgs::default()
    };
    let mut pipelines = Pipelines::new(&engine, true, Some(0)).unwrap();
    let Stages::Looks(_, shares) = &mut pipelines.stages else {
        panic!("expected several looks");
    };
    *shares = [&[0.125, 0.25], &[0.125, 0.25]];
    let (picture, lens) = (wall(), lens());
    let mut inputs = Vec::new();
    for large in [Some(false), Some(true), None] {
        let seen = match large {
            Some(large) => pipelines.look(&picture, &lens, large),
            None => pipelines.process(&picture, &lens),
        };
        seen.unwrap();
        inputs.push(pipelines.input());
    }
    assert!(
        inputs[0] < inputs[1] && inputs[1] == inputs[2],
        "{inputs:?}"
    );
    let Stages::Looks(looks, _) = &pipelines.stages else {
        panic!("expected several looks");
    };
    assert_eq!(looks.shapes(), 1);
}

#[test]
fn people_are_followed_where_a_camera_is_faster_than_any_machine() {
    let mut engine = EngineArgs {
        threads: Some(1),
        size: Some("256x160".parse().unwrap()),
        ..EngineArgs::default()
    };
    let mut follows = |looks, live| {
        engine.looks = looks;
        let mut pipelines = Pipelines::new(&engine, true, live).unwrap();
        pipelines.clock = ticking(&Arc::new(AtomicU64::new(SECOND / 50)));
        let (mut picture, lens) = (wall(), lens());
        // A thousand pictures a second, of which there is time for 25.
        for k in 0..52 {
            (picture.time_ns, picture.sequence) = (SECOND + k * SECOND / 25, 40 * k);
            let way = pipelines.choose(&picture).unwrap();
            assert!(way == Way::Whole || k > 50, "at once");
            pipelines.process(&picture, &lens).unwrap();
        }
        (0..4).any(|_| {
            picture.time_ns += SECOND / 1000;
            picture.sequence += 1;
            let way = pipelines.choose(&picture).unwrap();
            pipelines.process(&picture, &lens).unwrap();
            way == Way::Followed
        })
    };
    assert!(follows(None, Some(0)));
    assert!(!follows(None, None), "a film has time");
    assert!(!follows(Some(1000.0), Some(0)), "all are asked for");
}

#[test]
fn inputs_have_the_shape_of_the_pictures_as_they_come() {
    let mut pipelines = following(None);
    let shapes = [(640, 480), (720, 720), (360, 640), (640, 480)];
    let inputs = [
        [(432, 320), (320, 240), (208, 160)],
        [(368, 368), (272, 272), (192, 192)],
        [(288, 512), (224, 384), (144, 256)],
        [(432, 320), (320, 240), (208, 160)],
    ];
    for (picture, inputs) in shapes.into_iter().zip(inputs) {
        let (w, h) = picture;
        let lens = Intrinsics::from_horizontal_fov(w as u32, h as u32, 60.0);
        pipelines.process(&grey(picture), &lens).unwrap();
        assert_eq!(sizes_of(picture), inputs);
        let Stages::Following(following) = &pipelines.stages else {
            panic!("expected the input that follows people");
        };
        assert_eq!(following.shapes.last(), Some(&inputs[..]));
    }
}

#[test]
fn heights_are_pixels_of_the_largest_input_of_any_shape() {
    let mut clip = open_bytes("demo", demo::CLIP).unwrap();
    let mut frame = Frame::default();
    assert!(clip.next_into(&mut frame).unwrap());
    let mut pipelines = following(None);
    let people = pipelines.process(&frame, &lens()).unwrap().people.to_vec();
    let statures: Vec<f32> = people.iter().filter_map(stature).collect();
    assert!(!statures.is_empty());
    for picture in [(512, 320), (640, 480), (720, 720), (360, 640), (1280, 720)] {
        let (mut heights, input) = (Vec::new(), sizes_of(picture)[0]);
        heights_in(picture)(&people, &mut heights);
        let scale = (input.0 as f32 / picture.0 as f32).min(input.1 as f32 / picture.1 as f32);
        for (height, stature) in heights.iter().zip(&statures) {
            let error = height / (stature * scale) - 1.0;
            assert!(error.abs() < 0.03, "{picture:?}: {error}");
        }
    }
}

/// The picture in which `far_away` are, and at the other side the same people once more.
fn more_come() -> Frame {
    let mut picture = far_away();
    let width = picture.width as usize;
    for y in 80..160 {
        let row = 3 * width * y;
        picture
            .rgb
            .copy_within(row + 3 * 80..row + 3 * 208, row + 3 * 336);
    }
    picture
}

#[test]
fn a_crop_of_the_picture_shows_those_who_are_there_and_nobody_who_comes_is_missed() {
    let (mut pipelines, lens) = (following(None), lens());
    let mut look = |picture: &mut Frame, k: u64| {
        picture.time_ns = k * SECOND / 30;
        let seen = pipelines.process(picture, &lens).unwrap();
        let people = seen.people.to_vec();
        let Stages::Following(following) = &pipelines.stages else {
            panic!("expected the input that follows people");
        };
        (people, following.crops.count())
    };
    let (mut few, mut many) = (far_away(), more_come());
    let (whole, crops) = look(&mut few, 0);
    assert!(!whole.is_empty() && crops == 0);
    let (crop, crops) = look(&mut few, 1);
    assert_eq!((crop.len(), crops), (whole.len(), 1));
    for (a, b) in crop.iter().zip(&whole) {
        for (p, q) in a
            .joints2d
            .iter()
            .zip(&b.joints2d)
            .filter(|(p, _)| p[2] > 0.3)
        {
            let off = (p[0] - q[0]).hypot(p[1] - q[1]);
            assert!(off < 2.0, "{off} px: {p:?} {q:?}");
        }
    }
    let (all, _) = look(&mut many, 2);
    assert!(all.len() > crop.len(), "{} people", all.len());
}

#[test]
fn whom_only_the_largest_input_sees_is_seen_on_a_slow_machine() {
    let (mut pipelines, lens) = (following(Some(SECOND / 10)), lens());
    let speed = &mut pipelines.speed;
    for k in 0..20 {
        speed.took(k * SECOND, speed.limit(), 1.0, true);
    }
    assert_eq!(speed.limit(), SHARES.len() - 1);
    let (far, empty) = (far_away(), wall());
    let mut sees = |picture, large: Option<bool>| {
        let seen = match large {
            None => pipelines.process(picture, &lens),
            Some(large) => pipelines.look(picture, &lens, large),
        };
        !seen.unwrap().people.is_empty()
    };
    assert!(!sees(&far, None));
    assert!(!sees(&far, Some(false)));
    assert!(!sees(&far, None));
    assert!(sees(&far, Some(true)));
    assert!(sees(&far, None), "lost with the next picture");
    assert!(!sees(&empty, Some(true)));
    assert!(!sees(&far, None), "the limit holds for whoever comes next");
}

#[test]
fn a_network_of_other_multiples_needs_no_size() {
    let mut model = Model::shipped().unwrap();
    let text = model.network().source();
    let other = text.replace("multiple = 16", "multiple = 48");
    assert_ne!(text, other);
    model.network = Network::parse(&other).unwrap();
    model.contract.input.size_multiple = 48;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.ecm");
    model.save(&path).unwrap();
    let engine = EngineArgs {
        model: Some(path),
        threads: Some(1),
        ..EngineArgs::default()
    };
    engine.expect_model().unwrap();
    let picture = Frame {
        width: 64,
        height: 48,
        rgb: vec![128; 3 * 64 * 48],
        ..Frame::default()
    };
    let intrinsics = Intrinsics::from_horizontal_fov(64, 48, 60.0);
    for is_film in [true, false] {
        let mut stages = Pipelines::new(&engine, is_film, None).unwrap();
        stages.process(&picture, &intrinsics).unwrap();
        let (w, h) = stages.input();
        assert!(
            w > 0 && [w, h].iter().all(|s| s.is_multiple_of(48)),
            "{w}x{h}"
        );
    }
    let asked = EngineArgs {
        size: Some("512x320".parse().unwrap()),
        ..engine
    };
    let refused = Pipelines::new(&asked, true, None).err().unwrap();
    assert!(refused.to_string().contains("multiples of 48"), "{refused}");
}

/// The first picture of the demo clip in the middle of a grey square.
fn square() -> Frame {
    let mut clip = open_bytes("demo", demo::CLIP).unwrap();
    let (mut inside, mut square) = (Frame::default(), grey((512, 512)));
    assert!(clip.next_into(&mut inside).unwrap());
    let first = 3 * 512 * 96;
    square.rgb[first..first + inside.rgb.len()].copy_from_slice(&inside.rgb);
    square
}

/// How many of those who stood in a square picture of `side` pixels are seen where they are once it is turned.
fn lying_where_they_stood(
    seen: &[Observation],
    stood: &[Observation],
    turn: crate::capture::Mounting,
    side: u32,
) -> usize {
    let is_at = |from: &Observation, to: &Observation| {
        let joints = from.joints2d.iter().zip(&to.joints2d);
        let sure = joints.filter(|(from, to)| from[2] > 0.8 && to[2] > 0.0);
        let off: Vec<f32> = sure
            .map(|(from, to)| {
                let [u, v] = turn.point([from[0], from[1]], (side, side));
                (u - to[0]).hypot(v - to[1])
            })
            .collect();
        off.len() > 3 && off.iter().sum::<f32>() / (off.len() as f32) < 6.0
    };
    let is_found = |from: &&Observation| seen.iter().any(|to| is_at(from, to));
    stood.iter().filter(is_found).count()
}

/// For how many shapes there are stages.
fn shapes_of(pipelines: &Pipelines) -> usize {
    match &pipelines.stages {
        Stages::Following(following) => following.shapes.count(),
        _ => panic!("expected the input that follows people"),
    }
}

#[test]
fn who_lies_down_in_a_film_is_found_where_they_lie() {
    let lens = Intrinsics::from_horizontal_fov(512, 512, 60.0);
    let (mut pipelines, upright) = (following(None), square());
    let stood = pipelines.process(&upright, &lens).unwrap().people.to_vec();
    assert!(stood.len() > 1, "{} people", stood.len());
    assert_eq!(shapes_of(&pipelines), 1, "nobody leans");
    for quarter_turns in [1, 3] {
        let turn = crate::capture::Mounting {
            quarter_turns,
            mirrored: false,
        };
        let mut lying = upright.clone();
        turn.apply(&mut lying, &mut Vec::new());
        pipelines.process(&upright, &lens).unwrap();
        for k in 1..4 {
            lying.time_ns = upright.time_ns + k * SECOND / 30;
            let seen = pipelines.process(&lying, &lens).unwrap().people;
            let found = lying_where_they_stood(seen, &stood, turn, 512);
            let all = found + 1 >= stood.len() && seen.len() <= stood.len() + 1;
            assert!(all, "{found} of {} in picture {k}, {turn:?}", seen.len());
        }
    }
    assert_eq!(
        shapes_of(&pipelines),
        2,
        "nothing was looked at on its side"
    );
}
