//! Detections that are somebody's until the others say where they are.

use edgecap::body::skeleton::{Pose, Posed, Skeleton};
use edgecap::camera::View;
use edgecap::joints::{EVIDENCE_JOINTS, MIRROR};
use edgecap::message::Observation;
use edgecap::multiview::{Detections, Sight, track};
use glam::DVec3;

use crate::scene::ring::views;

type Joints = [DVec3; EVIDENCE_JOINTS];

const ARMS: std::ops::RangeInclusive<usize> = 2..=7;
const FRAMES: usize = 12;

/// Somebody who hovers at this height, metres.
fn hovering(height: f64) -> Joints {
    let mut pose = Pose::facing_camera(4.2);
    pose.position.y = 0.5 - height;
    let (skeleton, mut posed) = (Skeleton::builtin(), Posed::default());
    skeleton.pose(&pose, skeleton.lengths(), &mut posed);
    std::array::from_fn(|j| posed.joints[j])
}

fn sight(view: &View, joints: &Joints) -> Sight {
    let mut seen = Observation::default();
    for (out, joint) in seen.joints2d.iter_mut().zip(joints) {
        let pixel = view.project(*joint).expect("in front");
        *out = [pixel.x as f32, pixel.y as f32, 0.9];
    }
    Sight::new(view, &seen)
}

/// What three views see of somebody who goes up and down by `step` metres: two of them as it is, the third, from the
/// second frame on, by where that was and is. The last frames show nobody.
fn scene(
    views: &[View],
    frames: usize,
    step: f64,
    third: &dyn Fn(f64, f64) -> Joints,
) -> Vec<Vec<Detections>> {
    let height = |f: usize| step * (f % 2) as f64;
    let all = (0..FRAMES).map(|f| {
        let one = |v: usize| match f {
            f if f >= frames => vec![],
            _ if v < 2 => vec![sight(&views[v], &hovering(height(f)))],
            0 => vec![],
            f => vec![sight(&views[v], &third(height(f - 1), height(f)))],
        };
        (0..views.len()).map(one).collect()
    });
    all.collect()
}

#[test]
fn a_view_that_is_about_somebody_else_proves_nobody() {
    let views = views(3);
    let agrees = scene(&views, 4, 0.3, &|_, now| hovering(now));
    assert_eq!(
        track(&views, &agrees, 30.0).len(),
        1,
        "three views and three frames"
    );
    // Near where the others were, far from where they are.
    let other = scene(&views, 4, 0.3, &|was, now| hovering(2.0 * was - now));
    assert_eq!(
        track(&views, &other, 30.0).len(),
        0,
        "two views and four frames"
    );
}

/// What views see of somebody who is there in these frames, of so many, at a height of so many metres.
fn shown(
    views: &[View],
    frames: usize,
    height: &dyn Fn(usize) -> Option<f64>,
) -> Vec<Vec<Detections>> {
    let one = |f: usize, view: &View| -> Detections {
        let there = height(f).map(hovering);
        there.iter().map(|joints| sight(view, joints)).collect()
    };
    let all = (0..frames).map(|f| views.iter().map(|view| one(f, view)).collect());
    all.collect()
}

#[test]
fn how_long_somebody_must_be_seen_goes_by_seconds() {
    // Frames a second, and frames that three views and two must see.
    for (rate, needed) in [
        (120.0, [8, 36]),
        (60.0, [5, 19]),
        (30.0, [3, 10]),
        (25.0, [3, 9]),
        (10.0, [2, 4]),
        (1.0, [2, 2]),
    ] {
        for (count, needed) in [3, 2].into_iter().zip(needed) {
            let views = views(count);
            let found = |seen: usize| {
                let frames = shown(&views, 40, &|f| (f < seen).then_some(0.0));
                track(&views, &frames, rate).len()
            };
            assert_eq!(found(needed - 1), 0, "{count} views at {rate}");
            assert_eq!(found(needed), 1, "{count} views at {rate}");
            // Of one instant nobody can ask for more.
            let instant = shown(&views, 1, &|_| Some(0.0));
            assert_eq!(track(&views, &instant, rate).len(), 1);
        }
    }
}

#[test]
fn how_far_somebody_may_have_gone_goes_by_seconds() {
    /// Frames for which they are there, and then away.
    const THERE: usize = 25;
    const AWAY: usize = 6;
    let views = views(2);
    // Six frames are long enough to rise by 0.6 metres at 30 frames a second, and not at 60.
    for (rate, goes_on) in [(30.0, true), (60.0, false)] {
        let height = |f: usize| match f {
            0..THERE => Some(0.0),
            f if f < THERE + AWAY => None,
            _ => Some(0.6),
        };
        let tracks = track(&views, &shown(&views, 2 * THERE, &height), rate);
        let back = tracks[0].moments.iter().any(|(f, _)| *f == THERE + AWAY);
        assert_eq!(back, goes_on, "{rate} frames a second");
    }
}

/// What views see of one person a frame, moved by so much.
fn moved(
    views: &[View],
    frames: usize,
    by: &dyn Fn(usize) -> Option<DVec3>,
) -> Vec<Vec<Detections>> {
    let one = |f: usize, view: &View| -> Detections {
        let joints = by(f).map(|by| hovering(0.0).map(|p| p + by));
        joints.iter().map(|joints| sight(view, joints)).collect()
    };
    let all = (0..frames).map(|f| views.iter().map(|view| one(f, view)).collect());
    all.collect()
}

#[test]
fn whoever_is_missed_is_not_somebody_at_the_other_end_of_the_room() {
    const THERE: usize = 12;
    for count in [2, 4] {
        let views = views(count);
        // Across the room, and behind where they were as the first view sees it.
        let behind = (DVec3::new(0.0, 0.0, 4.2) - views[0].position) * DVec3::new(1.0, 0.0, 1.0);
        for aside in [2.4 * DVec3::X, 2.0 * behind.normalize()] {
            // Frames of 20 a second in which nobody is there.
            for away in [5, 10, 18] {
                let by = |f: usize| match f {
                    0..THERE => Some(-0.5 * aside),
                    f if f < THERE + away => None,
                    _ => Some(0.5 * aside),
                };
                let frames = moved(&views, 2 * THERE + away, &by);
                let tracks = track(&views, &frames, 20.0);
                let lengths: Vec<usize> = tracks.iter().map(|t| t.moments.len()).collect();
                let case = format!("{count} views, {away} frames, {aside}");
                assert_eq!(lengths, [THERE, THERE], "{case}");
            }
        }
    }
}

#[test]
fn whoever_is_missed_leaves_somebody_new_to_themselves() {
    const THERE: usize = 15;
    const AWAY: usize = 10;
    let views = views(2);
    // Somebody new comes from farther off to where one who was missed for so long may have gone.
    let by = |f: usize| match f {
        0..THERE => Some(0.0),
        f if f < THERE + AWAY => None,
        f => Some((0.9 - 0.15 * (f - THERE - AWAY) as f64).max(0.45)),
    };
    let frames = moved(&views, 2 * THERE + AWAY, &|f| {
        by(f).map(|up| -up * DVec3::Y)
    });
    let tracks = track(&views, &frames, 20.0);
    let lengths: Vec<usize> = tracks.iter().map(|t| t.moments.len()).collect();
    assert_eq!(lengths, [THERE, THERE]);
}

#[test]
fn limbs_of_a_view_that_is_left_out_are_not_healed() {
    let views = views(3);
    // Arms called by the other side's name where they were, all else further off.
    let other = |was: f64, now: f64| {
        let (arms, rest) = (hovering(was), hovering(was + 5.5 * (was - now)));
        std::array::from_fn(|j| match ARMS.contains(&j) {
            true => arms[MIRROR[j]],
            false => rest[j],
        })
    };
    let tracks = track(&views, &scene(&views, FRAMES, 0.1, &other), 30.0);
    assert_eq!(tracks.len(), 1);
    assert_eq!(tracks[0].moments.len(), FRAMES);
    for (frame, moment) in &tracks[0].moments {
        let seen = moment.sights.iter().flatten().count();
        assert_eq!((seen, moment.healed), (2, 0), "frame {frame}");
    }
}

/// What all views see of somebody who goes sideways through the middle, 3 m at so many metres a second.
fn sideways(views: &[View], speed: f64, rate: f64) -> Vec<Vec<Detections>> {
    let frames = (3.0 / speed * rate) as usize;
    let joints = |f: usize| {
        let gone = DVec3::X * (speed * f as f64 / rate - 1.5);
        hovering(0.0).map(|p| p + gone)
    };
    let one = |f: usize, view: &View| vec![sight(view, &joints(f))];
    let all = (0..frames).map(|f| views.iter().map(|view| one(f, view)).collect());
    all.collect()
}

#[test]
fn whoever_goes_far_from_frame_to_frame_is_one_person() {
    let views = views(4);
    // Metres and frames a second.
    for (speed, rate) in [(2.0, 5.0), (1.5, 5.0), (1.0, 2.0), (4.0, 15.0)] {
        let frames = sideways(&views, speed, rate);
        let tracks = track(&views, &frames, rate);
        assert_eq!(tracks.len(), 1, "{speed} m/s at {rate}");
        let moments = tracks[0].moments.iter();
        let sights = |m: &edgecap::multiview::Moment| m.sights.iter().flatten().count();
        let by_all = moments.filter(|(_, m)| sights(m) == views.len()).count();
        assert_eq!(by_all, frames.len(), "{speed} m/s at {rate}");
    }
}

/// Arms and legs come to where the other side's were.
#[test]
fn whoever_goes_sideways_keeps_left_and_right() {
    for count in [2, 4] {
        let views = views(count);
        for (speed, rate) in [(1.5, 5.0), (4.0, 15.0)] {
            let tracks = track(&views, &sideways(&views, speed, rate), rate);
            assert_eq!(tracks.len(), 1, "{count} views, {speed} m/s at {rate}");
            let moments = tracks.iter().flat_map(|t| &t.moments);
            let healed: usize = moments.map(|(_, m)| m.healed).sum();
            assert_eq!(healed, 0, "{count} views, {speed} m/s at {rate}");
        }
    }
}

/// Two views see them go by so much less that they follow, the others find somebody new in the same place.
#[test]
fn two_who_are_in_one_place_are_one_person() {
    let views = views(4);
    let aside = |f: usize| if f < 15 { DVec3::ZERO } else { 0.6 * DVec3::X };
    let one = |f: usize, view: &View| {
        let joints = hovering(0.0).map(|p| p + aside(f));
        vec![sight(view, &joints)]
    };
    let all = (0..30).map(|f| views.iter().map(|view| one(f, view)).collect());
    let frames: Vec<Vec<Detections>> = all.collect();
    let tracks = track(&views, &frames, RATE);
    assert_eq!(tracks.len(), 1);
    assert_eq!(tracks[0].moments.len(), 30);
    for (frame, moment) in &tracks[0].moments {
        assert_eq!(moment.sights.iter().flatten().count(), 4, "frame {frame}");
    }
}

/// Frames a second of [`walk`].
const RATE: f64 = 30.0;
/// Frames that both views see at the beginning and at the end, and that one alone sees between.
const BOTH: usize = 15;
const ONE: usize = 100;
/// How much taller somebody is than views take everybody to be.
const TALLER: f64 = 1.1;

/// Somebody who walks away from the first camera and to its right, 0.9 m/s.
fn walking(frame: usize) -> Joints {
    let gone = frame as f64 / RATE;
    hovering(0.0).map(|p| p + DVec3::new(0.4, 0.0, 0.8) * gone - DVec3::new(0.8, 0.0, 1.6))
}

/// The same with what the view alone makes of it in 3D.
fn lifted(view: &View, joints: &Joints) -> Sight {
    let camera = joints.map(|p| view.to_camera(p));
    let pelvis = 0.5 * (camera[8] + camera[11]);
    let mut seen = sight(view, joints);
    seen.lifted = Some(camera.map(|p| (p - pelvis) / TALLER));
    seen
}

/// What two views see of them, the second one for a while nobody, or `other` instead.
fn walk(views: &[View], other: Option<&dyn Fn(usize) -> Joints>) -> Vec<Vec<Detections>> {
    let all = (0..2 * BOTH + ONE).map(|f| {
        let between = (BOTH..BOTH + ONE).contains(&f);
        let second = match (between, other) {
            (false, _) => Some(walking(f)),
            (true, other) => other.map(|other| other(f)),
        };
        let second = second.map(|joints| lifted(&views[1], &joints));
        vec![
            vec![lifted(&views[0], &walking(f))],
            second.into_iter().collect(),
        ]
    });
    all.collect()
}

#[test]
fn whom_one_view_alone_follows_for_seconds_stays_the_same() {
    let views = views(2);
    let tracks = track(&views, &walk(&views, None), RATE);
    assert_eq!(tracks.len(), 1);
    assert_eq!(tracks[0].moments.len(), 2 * BOTH + ONE);
    let (_, last) = tracks[0].moments.last().unwrap();
    assert_eq!(last.sights.iter().flatten().count(), 2);
    // In the place of one who stands there for ever may be somebody else.
    let stand = |f: usize| match f {
        0..BOTH => walk(&views, None).swap_remove(0),
        _ => vec![vec![lifted(&views[0], &walking(0))], vec![]],
    };
    let frames: Vec<_> = (0..BOTH + 500).map(stand).collect();
    let tracks = track(&views, &frames, RATE);
    assert_eq!(tracks.len(), 1);
    let kept = tracks[0].moments.len() as f64 / RATE;
    assert!((10.0..11.0).contains(&kept), "{kept} s");
}

#[test]
fn whom_one_view_follows_does_not_take_somebody_else_in_another() {
    let views = views(2);
    let above = |f: usize| walking(f).map(|p| p - 0.6 * DVec3::Y);
    // So that the rays of both meet in a body which nobody has, farther away.
    let [a, b] = [0, 1].map(|v| views[v].position);
    let beside = |f: usize| {
        walking(f).map(|p| {
            let met = a + 1.25 * (p - a);
            b + (met - b) / 1.25
        })
    };
    for other in [&above as &dyn Fn(usize) -> Joints, &beside] {
        let tracks = track(&views, &walk(&views, Some(other)), RATE);
        assert_eq!(tracks.len(), 1, "one view alone proves nobody");
        for (frame, moment) in &tracks[0].moments {
            let both = !(BOTH..BOTH + ONE).contains(frame);
            let seen = moment.sights.iter().flatten().count();
            assert_eq!(seen, 1 + usize::from(both), "frame {frame}");
        }
    }
}
