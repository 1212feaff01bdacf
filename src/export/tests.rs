//! Records whose times and ids are as a publisher that waits, ends or is started again leaves them.

use std::io::Cursor;
use std::slice;
use std::time::Instant;

use super::take::{Frame, Sample, lowest_foot};
use super::*;
use crate::body::BodyModel;
use crate::body::mesh::MeshBody;
use crate::joints::{JOINT_NAMES, PELVIS};
use crate::message::{Body, BodyFrame, FLAG_FILE_TIME, World};
use crate::npz::Archive;
use crate::record::{BodiesRow, Format as RecordFormat, RecordWriter, Row};

const SECOND: u64 = 1_000_000_000;

/// A message: its number, its time in nanoseconds, who is in it.
type Message<'a> = (u64, u64, &'a [u32]);

fn take(messages: &[Message<'_>]) -> Take {
    Take::read(&lines(messages)[..], "record").unwrap()
}

fn lines(messages: &[Message<'_>]) -> Vec<u8> {
    flagged(0, messages)
}

fn flagged(flags: u32, messages: &[Message<'_>]) -> Vec<u8> {
    let mut lines = Vec::new();
    for &(sequence, pose_ns, ids) in messages {
        let mut message = BodyFrame {
            sequence,
            pose_ns,
            flags,
            count: ids.len() as u32,
            ..BodyFrame::default()
        };
        for (body, &id) in message.bodies.iter_mut().zip(ids) {
            body.id = id;
        }
        serde_json::to_writer(&mut lines, &BodiesRow::new(&message, "")).unwrap();
        lines.push(b'\n');
    }
    lines
}

#[test]
fn a_record_that_ends_inside_its_first_frame_was_cut_and_not_of_nobody() {
    let mut frame = BodyFrame {
        count: 1,
        ..BodyFrame::default()
    };
    frame.bodies[0].id = 1;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.record");
    let mut writer = RecordWriter::<BodiesRow>::create(&path, RecordFormat::Binary).unwrap();
    writer.write(&frame, "").unwrap();
    writer.finish().unwrap();
    let binary = std::fs::read(&path).unwrap();
    let refused = Take::read(&binary[..100], "a.record").unwrap_err();
    let words = "a.record: expected a record of bodies, found it cut off inside its first frame; record again";
    assert_eq!(refused.to_string(), words);
    assert_eq!(Take::read(&binary[..], "a.record").unwrap().people.len(), 1);
}

#[test]
fn two_people_of_one_id_in_a_frame_are_refused() {
    let lines = lines(&[(0, 0, &[1, 2]), (1, SECOND, &[2, 1, 2])]);
    for person in [None, Some(1)] {
        let refused = Take::read_of(&lines[..], "record", person).unwrap_err();
        let line = refused.to_string();
        assert!(
            line.starts_with("record, line 2: expected one frame"),
            "{line}"
        );
        assert!(line.contains("two people with the id 2"), "{line}");
        assert!(matches!(refused, ExportError::Record(_)), "{line}");
    }
}

/// A record in which two people stand, each with the feet so far down, metres, and which knows no floor. The second is
/// in the first ten frames only, of which there are fewer a second.
fn two_without_a_floor(down: [f32; 2]) -> Vec<u8> {
    let mut lines = Vec::new();
    for k in 0..40_u64 {
        let mut message = BodyFrame {
            sequence: k,
            pose_ns: k * SECOND / 10 - k.saturating_sub(10) * SECOND / 20,
            count: if k < 10 { 2 } else { 1 },
            ..BodyFrame::default()
        };
        for ((id, body), down) in (1..).zip(&mut message.bodies).zip(down) {
            body.id = id;
            body.joints3d = [[0.0, down, 3.0]; JOINT_NAMES.len()];
        }
        serde_json::to_writer(&mut lines, &BodiesRow::new(&message, "")).unwrap();
        lines.push(b'\n');
    }
    lines
}

#[test]
fn alone_somebody_is_as_high_and_as_fast_as_among_all() {
    for down in [[1.0, 0.82], [0.82, 1.0]] {
        let lines = two_without_a_floor(down);
        let motions = |person| -> Vec<Motion> {
            let take = Take::read_of(&lines[..], "record", person).unwrap();
            Motion::all(&take).unwrap().collect()
        };
        let all = motions(None);
        assert_eq!(all.len(), 2);
        for (among_all, down) in all.iter().zip(down) {
            let alone = &motions(Some(among_all.id))[0];
            let height = |motion: &Motion| motion.moments[0].position.y;
            assert!((height(among_all) - f64::from(1.0 - down)).abs() < 1e-6);
            assert_eq!(height(alone), height(among_all), "{down} m down");
            assert_eq!(alone.rate, among_all.rate, "{down} m down");
            assert_eq!(alone.moments.len(), among_all.moments.len());
        }
    }
}

#[test]
fn of_one_person_nobody_else_is_held() {
    let lines = lines(&[(0, 0, &[1, 2]), (1, SECOND, &[2]), (2, 2 * SECOND, &[1])]);
    let of = |id| Take::read_of(&lines[..], "record", Some(id));
    let take = of(1).unwrap();
    assert_eq!(take.frames.len(), 3);
    assert_eq!(take.people.keys().collect::<Vec<_>>(), [&1]);
    assert_eq!(take.people[&1].len(), 2);
    let refused = of(5).unwrap_err().to_string();
    assert!(refused.contains("id 5; there are 1, 2"), "{refused}");
}

fn times(take: &Take) -> Vec<f64> {
    take.frames.iter().map(|f| f.time).collect()
}

/// `fit --rate 50` of a camera that shows five pictures a second: bodies go on for 0.1 s and are held for another 0.1.
fn held() -> Vec<Message<'static>> {
    let messages = 0..100;
    let ahead = |k: u64| (k % 10).min(5) * SECOND / 50;
    messages
        .map(|k| (k / 10, k / 10 * SECOND / 5 + ahead(k), &[1][..]))
        .collect()
}

#[test]
fn bodies_that_are_held_are_one_frame_and_the_others_keep_their_times() {
    let take = take(&held());
    assert_eq!(take.frames.len(), 60);
    assert_eq!(take.people[&1].len(), 60);
    assert!((take.rate() - 50.0).abs() < 1e-6, "{}", take.rate());
    let times = times(&take);
    assert!((times[59] - 1.9).abs() < 1e-9, "{}", times[59]);
    assert!(times.is_sorted_by(|a, b| a < b), "{times:?}");
    let motion = Motion::all(&take).unwrap().next().unwrap();
    assert_eq!(motion.moments.len(), 96);
    assert!(
        motion.moments.iter().all(|m| m.is_there),
        "nobody is away while bodies are held"
    );
}

#[test]
fn somebody_in_a_place_that_was_mostly_empty_has_all_their_poses() {
    // Three pictures a second of nobody for 20 s, then 30 of somebody for one.
    let mut messages: Vec<Message<'_>> = (0..60).map(|k| (k, k * SECOND / 3, &[][..])).collect();
    messages.extend((60..90).map(|k| (k, 18 * SECOND + k * SECOND / 30, &[1][..])));
    let take = take(&messages);
    assert!((take.rate() - 30.0).abs() < 1e-3, "{}", take.rate());
    let motion = Motion::all(&take).unwrap().next().unwrap();
    assert_eq!(motion.moments.len(), 30);
}

#[test]
fn whoever_is_in_no_two_frames_in_a_row_has_the_rate_of_all() {
    let who = |k: u64| -> &[u32] { if k.is_multiple_of(2) { &[1] } else { &[] } };
    let messages: Vec<Message<'_>> = (0..9).map(|k| (k, k * SECOND / 10, who(k))).collect();
    let rate = take(&messages).rate();
    assert!((rate - 10.0).abs() < 1e-6, "{rate}");
}

/// Containers such as Matroska's count milliseconds.
#[test]
fn a_film_whose_times_are_whole_milliseconds_has_its_rate() {
    let ms = |k: u64| (k * 1000 + 30) / 60;
    let times = (0..600).map(|k| (k, ms(k) * SECOND / 1000, &[1][..]));
    let take = take(&times.collect::<Vec<_>>());
    assert!((take.rate() - 60.0).abs() < 0.05, "{}", take.rate());
    let motion = Motion::all(&take).unwrap().next().unwrap();
    assert_eq!(motion.moments.len(), 600);
}

#[test]
fn a_frame_that_was_overtaken_is_left_out() {
    let messages: [Message<'_>; 4] = [
        (0, 0, &[1]),
        (1, SECOND / 10, &[1]),
        (2, SECOND / 11, &[2]),
        (3, SECOND / 5, &[1]),
    ];
    let take = take(&messages);
    assert_eq!(times(&take), [0.0, 0.1, 0.2]);
    let frames: Vec<usize> = take.people[&1].iter().map(|s| s.frame).collect();
    assert_eq!(frames, [0, 1, 2]);
    assert!(!take.people.contains_key(&2), "who is in no other frame");
    let alone = Take::read_of(&lines(&messages)[..], "record", Some(2));
    let refused = alone.unwrap_err().to_string();
    assert!(refused.contains("no later"), "{refused}");
}

#[test]
fn times_that_mostly_stand_still_are_those_of_30_frames_a_second() {
    let photos: Vec<Message<'_>> = (0..4).map(|k| (k, 7, &[1][..])).collect();
    let take = take(&photos);
    assert_eq!(times(&take), [0.0, 1.0 / 30.0, 2.0 / 30.0, 3.0 / 30.0]);
}

#[test]
fn a_recording_that_begins_anew_follows_the_one_before() {
    let film = (0..10).map(|k| k * SECOND / 10);
    let twice = film.clone().chain(film).zip(0..);
    let take = take(&twice.map(|(t, k)| (k, t, &[1][..])).collect::<Vec<_>>());
    let wanted: Vec<f64> = (0..20).map(|k| f64::from(k) / 10.0).collect();
    let times = times(&take);
    assert_eq!(times.len(), wanted.len(), "none is left out: {times:?}");
    for (time, wanted) in times.iter().zip(&wanted) {
        assert!((time - wanted).abs() < 1e-9, "{times:?}");
    }
}

#[test]
fn who_has_an_id_of_before_the_publisher_s_restart_is_somebody_else() {
    let take = take(&[
        (70, 10 * SECOND, &[1, 3]),
        (71, 11 * SECOND, &[3]),
        (0, 20 * SECOND, &[1]),
        (1, 21 * SECOND, &[1, 2]),
        (0, 30 * SECOND, &[1]),
    ]);
    let frames = |id: u32| -> Vec<usize> { take.people[&id].iter().map(|s| s.frame).collect() };
    let all: Vec<u32> = take.people.keys().copied().collect();
    assert_eq!(all, [1, 3, 4, 5, 6]);
    assert_eq!(
        [frames(1), frames(4), frames(6)],
        [vec![0], vec![2, 3], vec![4]]
    );
    let named = |(id, samples): (&u32, &Vec<Sample>)| samples.iter().all(|s| s.body.id == *id);
    assert!(take.people.iter().all(named), "bodies are called alike");
}

/// As where the machine was started again while somebody recorded, or a film is played twice.
#[test]
fn ids_of_a_camera_whose_clock_goes_back_are_somebody_else_s() {
    let messages: [Message<'_>; 5] = [
        (7, 100 * SECOND, &[1]),
        (8, 101 * SECOND, &[1]),
        (9, 5 * SECOND, &[1]),
        (10, 6 * SECOND, &[1]),
        // One that was overtaken begins nothing.
        (11, 6 * SECOND - SECOND / 10, &[1]),
    ];
    let ids = |flags: u32| -> Vec<u32> {
        let take = Take::read(&flagged(flags, &messages)[..], "record").unwrap();
        take.people.into_keys().collect()
    };
    assert_eq!(ids(0), [1, 2]);
    assert_eq!(ids(FLAG_FILE_TIME), [1]);
}

/// Gives frames the lowest feet of the people in them, as where a record is read.
fn with_feet(take: &mut Take) {
    take.frames.iter_mut().for_each(|f| f.lowest_foot = None);
    for sample in take.people.values().flatten() {
        let foot = lowest_foot(slice::from_ref(&sample.body));
        let lowest = &mut take.frames[sample.frame].lowest_foot;
        *lowest = (*lowest).into_iter().chain(foot).reduce(f32::max);
    }
}

/// Frames at these times, seconds, and in which of them somebody is.
fn visits(frames: impl Iterator<Item = (f64, bool)>) -> Take {
    let mut take = Take::default();
    for (frame, (time, is_there)) in frames.enumerate() {
        take.frames.push(Frame {
            sequence: frame as u64,
            time,
            world: World::default(),
            lowest_foot: None,
        });
        if is_there {
            let body = Body::default();
            let samples = take.people.entry(1).or_default();
            samples.push(Sample { frame, body });
        }
    }
    with_feet(&mut take);
    take
}

/// The curves of a take, panel by panel, in each by rising id.
fn curves(take: &Take) -> Vec<String> {
    let svg = plot::encode(take);
    let paths = svg.split("<path d=\"").skip(1);
    let curves = paths.filter(|path| path.contains("stroke-width=\"1.5\""));
    let curves = curves.map(|path| path.split('"').next().unwrap().to_owned());
    curves.collect()
}

/// How often the first curve begins, and its lines.
fn strokes(take: &Take) -> (usize, usize) {
    let curve = &curves(take)[0];
    (curve.matches('M').count(), curve.matches('L').count())
}

#[test]
fn a_curve_shows_every_peak_and_of_who_is_narrower_than_a_pixel_four_points() {
    let mut take = visits((0..40_000).map(|k| (f64::from(k) / 30.0, true)));
    let samples = take.people.get_mut(&1).unwrap();
    for sample in &mut samples[20_005..20_015] {
        sample.body.joints3d[PELVIS][1] = -1.0;
    }
    // For two thirds of a second, up and down all the time.
    let visitor = (30_001..30_021).map(|frame| {
        let mut body = Body::default();
        body.joints3d[PELVIS][1] = -0.01 * (frame % 7) as f32;
        Sample { frame, body }
    });
    take.people.insert(2, visitor.collect());
    let curves = curves(&take);
    let heights = |curve: &str| -> Vec<f64> {
        let points = curve.split(['M', 'L']).skip(1);
        points
            .map(|p| p.split_once(' ').unwrap().1.parse().unwrap())
            .collect()
    };
    let highest = |curve: &str| heights(curve).into_iter().fold(f64::INFINITY, f64::min);
    // The first panel is the pelvis'; its top is 1 m.
    let [all, visitor] = [&curves[0], &curves[1]].map(|curve| highest(curve));
    let top = 44.0;
    assert_eq!(all, top);
    assert!(visitor > top + 100.0, "{visitor}");
    for curve in curves.iter().skip(1).step_by(2) {
        let points = heights(curve).len();
        assert!((2..=4).contains(&points), "{points}: {curve}");
    }
}

#[test]
fn a_curve_breaks_where_somebody_is_away_however_few_of_its_points_are_drawn() {
    let seldom_missing = (0..12_000).map(|k| (f64::from(k) / 30.0, k % 5 != 4));
    let (moves, lines) = strokes(&visits(seldom_missing));
    assert_eq!(moves, 1);
    assert!(lines > 1000, "{lines}");
    let hole = |k: i32| if k < 100 { 0.0 } else { 30.0 };
    let no_frames = (0..200).map(|k| (f64::from(k) / 30.0 + hole(k), true));
    assert_eq!(strokes(&visits(no_frames)), (2, 198));
    let nobody = (0..12_000).map(|k| (f64::from(k) / 30.0, !(5000..5300).contains(&k)));
    assert_eq!(strokes(&visits(nobody)).0, 2);
}

#[test]
fn markers_of_who_is_away_are_empty() {
    let ends = (0..=400).map(|k| (f64::from(k) / 10.0, k == 0 || k == 400));
    let take = visits(ends);
    let files = encode(&take, Format::Trc, "a.trc".as_ref()).unwrap();
    let text = String::from_utf8(bytes(&files[0])).unwrap();
    // As OpenSim reads a row: a last field that is empty is none, and all rows have as many as the axes' line.
    let fields = |line| {
        let mut fields: Vec<&str> = str::split(line, '\t').collect();
        fields.pop_if(|last| last.is_empty());
        fields
    };
    let lines: Vec<Vec<&str>> = text.lines().map(fields).collect();
    assert_eq!(lines[4].len(), 2 + 3 * JOINT_NAMES.len());
    let rows = &lines[6..];
    assert_eq!(rows.len(), 401);
    // pandas takes a column that only some rows have for the frames' numbers.
    let tabs = |line: &str| line.matches('\t').count();
    assert!(
        text.lines()
            .skip(6)
            .all(|line| tabs(line) == 2 + 3 * JOINT_NAMES.len())
    );
    assert_eq!(
        tabs(text.lines().nth(4).unwrap()),
        2 + 3 * JOINT_NAMES.len()
    );
    for (row, is_there) in [(0, true), (1, true), (2, false), (200, false), (400, true)] {
        let fields = &rows[row][2..];
        assert_eq!(fields.len(), 3 * JOINT_NAMES.len());
        assert!(fields.iter().all(|f| f.is_empty() != is_there), "{row}");
    }
}

#[test]
fn what_is_fitted_too_low_in_one_frame_does_not_lift_everybody() {
    let mut take = visits((0..200).map(|k| (f64::from(k) / 30.0, true)));
    let is_foot = |name: &str| name.ends_with("_ankle") || name.ends_with("_foot_tip");
    let samples = take.people.get_mut(&1).unwrap();
    for sample in samples.iter_mut() {
        for (joint, name) in sample.body.joints3d.iter_mut().zip(JOINT_NAMES) {
            *joint = [0.0, if is_foot(name) { 1.0 } else { 0.0 }, 3.0];
        }
    }
    for (frame, wrong) in [(50, "r_wrist"), (60, "l_ankle")] {
        let joint = JOINT_NAMES.iter().position(|name| *name == wrong).unwrap();
        samples[frame].body.joints3d[joint][1] = 1.5;
    }
    with_feet(&mut take);
    let axes = Axes::of(&take);
    let heights = [0.0, 1.0].map(|y| axes.point([0.0, y, 3.0]).y);
    assert!(
        (heights[0] - 1.0).abs() < 1e-9 && heights[1].abs() < 1e-9,
        "{heights:?}"
    );
}

/// One frame at each time, each with somebody of its own.
fn crowd(times: impl Iterator<Item = f64>) -> Take {
    let mut take = Take::default();
    for (frame, time) in times.enumerate() {
        take.frames.push(Frame {
            sequence: frame as u64,
            time,
            world: World::default(),
            lowest_foot: None,
        });
        let body = Body::default();
        take.people
            .insert(frame as u32, vec![Sample { frame, body }]);
    }
    with_feet(&mut take);
    take
}

#[test]
fn steps_are_no_shorter_than_a_camera_s() {
    let take = crowd([0.0, 1e-6, 2e-6, 3e-6].into_iter());
    assert_eq!(take.rate(), 1000.0);
}

/// Two thousand visitors of a week took as many looks at all of it.
#[test]
fn frames_are_looked_at_once_for_the_floor_and_not_once_for_each_person() {
    const PEOPLE: u32 = 300;
    const LOOKS: u32 = 20;
    let mut take = crowd((0..PEOPLE).map(|k| f64::from(k) / 30.0));
    let empty = (PEOPLE..1000 * PEOPLE).map(|k| Frame {
        sequence: k.into(),
        time: f64::from(k) / 30.0,
        world: World::default(),
        lowest_foot: None,
    });
    take.frames.extend(empty);
    let began = Instant::now();
    for _ in 0..LOOKS {
        assert!(Axes::of(&take).point([0.0; 3]).is_finite());
    }
    let one_look = began.elapsed() / LOOKS;
    // The shortest: any of them may have waited for the processor.
    let took = (0..5).map(|_| {
        let began = Instant::now();
        assert_eq!(Motion::all(&take).unwrap().count(), PEOPLE as usize);
        began.elapsed()
    });
    let took = took.min().unwrap();
    assert!(
        took < one_look * PEOPLE / 2,
        "{took:?}, a look {one_look:?}"
    );
}

#[test]
fn what_cannot_be_held_is_refused_before_it_is_made() {
    let refused = |take: &Take, name: &str, words: [&str; 2]| {
        let error = encode(take, Format::of(name.as_ref()).unwrap(), name.as_ref());
        let error = error.unwrap_err().to_string();
        assert!(error.contains("4 GiB of numbers at most"), "{error}");
        for word in words {
            assert!(error.contains(word), "{word}: {error}");
        }
    };
    let crowd = crowd((0..3000).map(|k| f64::from(k) / 30.0));
    refused(&crowd, "a.npz", ["3000 frames × 3000 people", "--person"]);
    // Those who come last stand still for three minutes.
    let queue = self::crowd((0..6000).map(|k| f64::from(k) / 30.0));
    refused(&queue, "a.bvh", ["steps of 0.033333 s", "--person"]);
    assert!(encode(&queue, Format::Trc, "a.trc".as_ref()).is_ok());
    // A clock that was set while somebody was in view.
    let mut long = take(&held());
    long.frames[59].time = 1e9;
    for name in ["a.bvh", "a.trc", "a.glb"] {
        refused(&long, name, ["steps of 0.020000 s", "shorter takes"]);
    }
}

fn bytes(file: &Exported<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    file.write(&mut bytes).unwrap();
    bytes
}

/// The bytes of all pieces that came, and of the longest.
#[derive(Debug, Default)]
struct Pieces(usize, usize);

impl Write for Pieces {
    fn write(&mut self, piece: &[u8]) -> io::Result<usize> {
        self.0 += piece.len();
        self.1 = self.1.max(piece.len());
        Ok(piece.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_csv_of_any_length_is_never_held() {
    let take = crowd((0..300).map(|k| f64::from(k) / 30.0));
    let files = encode(&take, Format::Csv, "a.csv".as_ref()).unwrap();
    let mut pieces = Pieces::default();
    files[0].write(&mut pieces).unwrap();
    assert!(pieces.0 > 300_000 && pieces.1 < 1000, "{pieces:?}");
}

#[test]
fn arrays_are_made_and_written_one_after_the_other() {
    let mut take = crowd((0..40).map(|k| f64::from(k) / 30.0));
    for frame in &mut take.frames {
        frame.sequence += 7;
    }
    let files = encode(&take, Format::Npz, "a.npz".as_ref()).unwrap();
    let mut pieces = Pieces::default();
    files[0].write(&mut pieces).unwrap();
    assert!(pieces.0 > 1_500_000 && pieces.1 <= 64 << 10, "{pieces:?}");
    // What is written into a pipe and into a file is the same to a reader.
    let mut file = Cursor::new(Vec::new());
    files[0].write_into(&mut file).unwrap();
    for whole in [bytes(&files[0]), file.into_inner()] {
        let mut archive = Archive::new(Cursor::new(whole)).unwrap();
        let mut numbers = |name| archive.numbers(name).unwrap().unwrap();
        assert_eq!(numbers("frame").data[39], 46.0);
        let positions = numbers("position");
        assert_eq!(positions.shape, [40, 40, 3]);
        let is_there = |n: usize| (n / 3).is_multiple_of(41);
        let nan = positions.data.iter().map(|v| v.is_nan());
        assert!(nan.zip(0..).all(|(nan, n)| nan != is_there(n)));
    }
}

#[test]
fn a_bvh_whose_first_pose_is_held_is_never_held_itself() {
    let mut take = visits((0..60).map(|k| (f64::from(k) / 30.0, k < 30)));
    for frame in &mut take.frames[30..] {
        frame.time += 500.0;
    }
    let body = Body::default();
    let later = (30..60).map(|frame| Sample { frame, body });
    take.people.insert(2, later.collect());
    with_feet(&mut take);
    let files = encode(&take, Format::Bvh, "a.bvh".as_ref()).unwrap();
    let mut pieces = Pieces::default();
    files[1].write(&mut pieces).unwrap();
    assert!(pieces.0 > 3_000_000 && pieces.1 < 10_000, "{pieces:?}");
}

/// The times of every animated property of a file, and the sizes where it is one.
fn tracks(glb: &[u8]) -> Vec<(String, Vec<f32>, Vec<f32>)> {
    use ::gltf::animation::util::ReadOutputs;
    let gltf = ::gltf::Gltf::from_slice(glb).unwrap();
    let blob = gltf.blob.as_deref().unwrap();
    let animation = gltf.animations().next().unwrap();
    let channels = animation.channels().map(|channel| {
        let reader = channel.reader(|_| Some(blob));
        let times: Vec<f32> = reader.read_inputs().unwrap().collect();
        let outputs = reader.read_outputs().unwrap();
        let (count, sizes) = match outputs {
            ReadOutputs::Scales(all) => {
                let sizes: Vec<f32> = all.map(|s| s[0]).collect();
                (sizes.len(), sizes)
            }
            ReadOutputs::Translations(all) => (all.count(), Vec::new()),
            ReadOutputs::Rotations(all) => (all.into_f32().count(), Vec::new()),
            ReadOutputs::MorphTargetWeights(_) => panic!("faces"),
        };
        assert_eq!(count, times.len());
        let name = channel.target().node().name().unwrap().to_owned();
        (name, times, sizes)
    });
    channels.collect()
}

fn glb(take: &Take) -> Vec<(String, Vec<f32>, Vec<f32>)> {
    let files = encode(take, Format::Glb, "a.glb".as_ref()).unwrap();
    let tracks = tracks(&bytes(&files[0]));
    for (name, times, _) in &tracks {
        assert!(times.is_sorted_by(|a, b| a < b), "{name}: {times:?}");
    }
    tracks
}

const WEEK: u64 = 7 * 86_400 * SECOND;

#[test]
fn times_of_a_glb_begin_with_the_first_person_and_rise_after_a_week() {
    let mut messages: Vec<Message<'_>> = vec![(0, 0, &[])];
    messages.extend((1..=120).map(|k| {
        let who: &[u32] = if k > 90 { &[1, 2] } else { &[1] };
        (k, WEEK + (k - 1) * SECOND / 30, who)
    }));
    let tracks = glb(&take(&messages));
    let (_, times, _) = tracks.iter().find(|(name, ..)| name == "hips").unwrap();
    assert_eq!((times.len(), times[0]), (120, 0.0));
    assert!((times[119] - 119.0 / 30.0).abs() < 1e-5, "{}", times[119]);
    let sizes = |who: &str| {
        let (_, times, sizes) = tracks.iter().find(|(name, ..)| name == who).unwrap();
        (times.clone(), sizes.clone())
    };
    assert_eq!(sizes("person 1"), (vec![0.0], vec![1.0]));
    let (times, there) = sizes("person 2");
    assert_eq!(there, [0.0, 1.0], "away, there");
    assert!((times[1] - 3.0).abs() < 1e-5, "{times:?}");
}

/// The keys of everybody's size, by rising id.
fn sizes(take: &Take) -> Vec<(Vec<f32>, Vec<f32>)> {
    let tracks = glb(take).into_iter();
    let sizes = tracks.filter(|(name, ..)| name.starts_with("person "));
    sizes.map(|(_, times, sizes)| (times, sizes)).collect()
}

#[test]
fn whoever_is_in_the_last_frame_of_a_glb_stays() {
    let photo = sizes(&take(&[(0, 0, &[1])]));
    assert_eq!(photo, [(vec![0.0], vec![1.0])]);
    let who = |k: u64| -> &[u32] { if k < 10 { &[1, 2] } else { &[2] } };
    let mut film: Vec<Message<'_>> = (0..30).map(|k| (k, k * SECOND / 30, who(k))).collect();
    let of_film = sizes(&take(&film));
    let keys = |n: usize| (of_film[n].0.len(), of_film[n].1.as_slice());
    assert_eq!(keys(0), (2, &[1.0, 0.0][..]), "who has left");
    assert_eq!(keys(1), (1, &[1.0][..]), "who is in the last frame");
    film.push((30, SECOND, &[]));
    let gone = sizes(&take(&film));
    assert_eq!(gone[1].1, [1.0, 0.0], "nobody is in the last frame");
}

#[test]
fn whose_mesh_has_a_pose_in_the_last_frame_stays() {
    let body = MeshBody::shipped();
    let person = body.person(&[]);
    let pose = body.rest_pose();
    let track = |id, times: &[f64]| MeshTrack {
        id,
        person: &person,
        poses: times.iter().map(|time| (*time, &pose)).collect(),
    };
    let tracks = [track(1, &[0.0, 0.1]), track(2, &[0.0, 0.1, 0.2])];
    for (end, of_the_last) in [(0.2, vec![1.0]), (0.3, vec![1.0, 0.0])] {
        let file = encode_meshes(body, &tracks, &Axes::default(), 10.0, end).unwrap();
        let sizes = self::tracks(&file).into_iter();
        let sizes = sizes.filter(|(name, ..)| name.starts_with("person "));
        let sizes: Vec<Vec<f32>> = sizes.map(|(_, _, sizes)| sizes).collect();
        assert_eq!(sizes, [vec![1.0, 0.0], of_the_last]);
    }
}

#[test]
fn who_comes_a_week_after_the_first_has_times_that_rise() {
    let mut messages: Vec<Message<'_>> = (0..30).map(|k| (k, k * SECOND / 30, &[1][..])).collect();
    messages.extend((30..150).map(|k| (k, WEEK + k * SECOND / 30, &[2][..])));
    messages.push((150, WEEK + 10 * SECOND, &[3]));
    let tracks = glb(&take(&messages));
    let last = |who: &str| {
        let (_, _, sizes) = tracks.iter().find(|(name, ..)| name == who).unwrap();
        sizes.clone()
    };
    assert_eq!(last("person 2"), [0.0, 1.0, 0.0]);
    assert_eq!(last("person 3"), [0.0, 1.0], "in the last frame");
}

#[test]
fn who_comes_much_later_does_not_stand_still_in_a_bvh_and_is_told() {
    let mut messages: Vec<Message<'_>> = (0..30).map(|k| (k, k * SECOND / 30, &[1][..])).collect();
    messages.extend((30..60).map(|k| (k, 5 * SECOND + k * SECOND / 30, &[2][..])));
    messages.extend((60..90).map(|k| (k, 3600 * SECOND + k * SECOND / 30, &[3][..])));
    let take = take(&messages);
    let files = encode(&take, Format::Bvh, "a.bvh".as_ref()).unwrap();
    let found = files.iter().map(|file| {
        let text = String::from_utf8(bytes(file)).unwrap();
        let frames = text.split("Frames: ").nth(1).unwrap();
        let frames = frames.lines().next().unwrap().parse().unwrap();
        assert_eq!(
            text.lines().rev().take_while(|l| !l.contains(':')).count(),
            frames
        );
        (frames, file.late)
    });
    let found: Vec<(usize, Option<f64>)> = found.collect();
    assert_eq!(found[..2], [(30, None), (180 + 30, None)]);
    assert_eq!(found[2].0, 30);
    assert!((found[2].1.unwrap() - 3602.0).abs() < 1e-6, "{found:?}");
}
