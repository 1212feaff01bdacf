use super::*;

const MS: u64 = 1_000_000;

/// A frame of somebody whose joints are at x = 1 pixel a millisecond.
fn frame(ms: u64) -> ObservationFrame {
    let mut frame = ObservationFrame {
        capture_ns: ms * MS,
        count: 1,
        ..ObservationFrame::default()
    };
    for (j, joint) in frame.people[0].joints2d.iter_mut().enumerate() {
        *joint = [ms as f32, 40.0 * j as f32, 0.9];
    }
    frame
}

/// A frame of nobody.
fn nobody(ms: u64) -> ObservationFrame {
    ObservationFrame {
        count: 0,
        ..frame(ms)
    }
}

/// A frame of somebody in a file.
fn of_file(ms: u64) -> ObservationFrame {
    ObservationFrame {
        flags: FLAG_FILE_TIME,
        ..frame(ms)
    }
}

fn x(set: &FrameSet, view: usize) -> Option<f32> {
    Some(set.views[view].as_ref()?.first()?.joints2d[3][0])
}

/// Milliseconds between a camera's frames, from 0 to its first one, and from capture to arrival.
#[derive(Debug, Clone, Copy)]
struct Camera(u64, u64, u64);

/// What comes out of cameras within so many milliseconds, and the one at which it does; and what is known at the
/// end. `shown` tells frames, by camera and time of capture.
fn shown_by(
    cameras: &[Camera],
    ms: u64,
    shown: impl Fn(usize, u64) -> Option<ObservationFrame>,
) -> (Vec<(u64, FrameSet)>, Synchroniser) {
    let mut sync = Synchroniser::new(cameras.len());
    let mut out = Vec::new();
    for now in 0..ms {
        for (k, &Camera(interval, offset, latency)) in cameras.iter().enumerate() {
            let taken = now.checked_sub(latency + offset);
            let taken = taken.filter(|t| t % interval == 0);
            if let Some(frame) = taken.and_then(|t| shown(k, t + offset)) {
                sync.push(k, &frame, now * MS);
            }
        }
        while let Some(set) = sync.next(now * MS) {
            out.push((now, set));
        }
    }
    (out, sync)
}

/// What comes out of cameras. `skip` leaves out frames, by camera and time of capture.
fn timed(cameras: &[Camera], ms: u64, skip: impl Fn(usize, u64) -> bool) -> Vec<(u64, FrameSet)> {
    shown_by(cameras, ms, |k, t| (!skip(k, t)).then(|| frame(t))).0
}

fn are_sorted(sets: &[(u64, FrameSet)]) -> bool {
    sets.is_sorted_by_key(|(_, set)| set.capture_ns)
}

/// The same without when, of intervals and offsets; frames arrive 20 ms after capture.
fn run(cameras: &[(u64, u64)], ms: u64, skip: impl Fn(usize, u64) -> bool) -> Vec<FrameSet> {
    let cameras: Vec<_> = cameras.iter().map(|&(i, o)| Camera(i, o, 20)).collect();
    let sets = timed(&cameras, ms, skip);
    sets.into_iter().map(|(_, set)| set).collect()
}

/// Replays at a tenth of the speed: frames of 33 ms come every 330 ms.
#[test]
fn slow_replays_of_files_are_together() {
    let mut sync = Synchroniser::new(2);
    let mut sets = Vec::new();
    for now in 0..6000 {
        for (camera, offset) in [0, 5].into_iter().enumerate() {
            let shown = now / 10;
            if now % 10 == 0 && shown >= offset && (shown - offset) % 33 == 0 {
                sync.push(camera, &of_file(shown), now * MS);
            }
        }
        sets.extend(std::iter::from_fn(|| sync.next(now * MS)));
    }
    assert!(sets.len() > 15, "{}", sets.len());
    for set in sets.iter().skip(1) {
        let at = set.capture_ns / MS;
        assert!(set.views.iter().all(Option::is_some), "at {at}");
    }
}

/// Once their rates are known, cameras that both see somebody are together in every instant.
fn assert_together(cameras: [Camera; 2]) {
    let sets = timed(&cameras, 5000, |_, _| false);
    let times = sets.iter().map(|(_, s)| s.capture_ns / MS);
    assert!(times.max() > Some(4000), "{cameras:?}: nothing comes");
    for (_, set) in sets.iter().filter(|(now, _)| *now > 1500) {
        let at = set.capture_ns / MS;
        assert!(set.views.iter().all(Option::is_some), "{cameras:?}: {at}");
    }
}

#[test]
fn instants_are_those_of_the_fastest_and_the_others_are_interpolated() {
    let sets = run(&[(40, 0), (33, 7), (50, 11)], 1500, |_, _| false);
    let late: Vec<_> = sets.iter().skip(5).collect();
    assert!(late.len() > 35, "{}", late.len());
    for pair in late.windows(2) {
        assert_eq!(pair[1].capture_ns - pair[0].capture_ns, 33 * MS);
    }
    for set in late {
        let at = set.capture_ns as f64 / MS as f64;
        for view in 0..3 {
            let x = x(set, view).expect("all are seen");
            // Frames no more than 2 ms apart are of one instant.
            let off = (f64::from(x) - at).abs();
            assert!(off <= 2.0, "view {view}: {x} at {at}");
        }
    }
}

#[test]
fn a_silent_camera_drops_out_after_100_ms_and_returns() {
    let silent = 600..1000;
    let sets = run(&[(33, 0), (33, 5)], 1600, |k, t| {
        k == 1 && silent.contains(&t)
    });
    let times: Vec<u64> = sets.iter().map(|s| s.capture_ns / MS).collect();
    assert!(times.windows(2).all(|w| w[1] - w[0] == 33), "{times:?}");
    assert!(times.last() > Some(&1500), "{times:?}: nothing comes");
    for set in &sets {
        let t = set.capture_ns / MS;
        let seen = set.views[1].is_some();
        if (640..990).contains(&t) {
            assert!(!seen, "silent at {t}");
        }
        if t > 60 && t < 590 || t > 1040 && t < 1500 {
            assert!(seen, "there at {t}");
        }
    }
}

#[test]
fn an_end_is_one_of_all() {
    let mut sync = Synchroniser::new(2);
    let end = ObservationFrame {
        flags: FLAG_END_OF_STREAM,
        ..ObservationFrame::default()
    };
    sync.push(0, &frame(0), 0);
    sync.push(0, &frame(33), 33 * MS);
    sync.push(0, &end, 34 * MS);
    assert!(!sync.has_ended(), "the other has not come yet");
    sync.push(1, &frame(0), 40 * MS);
    sync.push(1, &end, 41 * MS);
    assert!(sync.has_ended());
    // What has come before the end is not lost.
    let left = std::iter::from_fn(|| sync.next(50 * MS)).count();
    assert_eq!(left, 2);
    sync.push(1, &frame(70), 80 * MS);
    assert!(!sync.has_ended(), "one that goes on has not ended");
}

#[test]
fn slow_cameras_are_together_at_any_phase() {
    for [a, b] in [[200, 200], [167, 167], [167, 200], [250, 250], [300, 300]] {
        for phase in (0..b).step_by(10) {
            assert_together([Camera(a, 0, 170), Camera(b, phase, 170)]);
        }
    }
}

#[test]
fn cameras_of_unequal_latencies_are_together() {
    let fast = Camera(33, 0, 40);
    for (interval, latency) in [(167, 170), (167, 250), (67, 200), (33, 400)] {
        for phase in [0, 5, 30] {
            let late = Camera(interval, phase, latency);
            assert_together([fast, late]);
            assert_together([late, fast]);
        }
    }
}

#[test]
fn instants_of_fast_cameras_are_out_as_soon_as_all_have_shown_them() {
    for phase in 3..31 {
        let sets = timed(&[Camera(33, 0, 40), Camera(33, phase, 40)], 3000, |_, _| {
            false
        });
        let late: Vec<_> = sets.iter().filter(|(now, _)| *now > 500).collect();
        assert!(late.len() > 70, "{phase}: {}", late.len());
        for (now, set) in late {
            assert_eq!(now - set.capture_ns / MS, 40 + phase);
        }
    }
}

#[test]
fn a_slow_camera_that_dies_holds_the_others_up_for_once() {
    let cameras = [Camera(33, 0, 40), Camera(167, 0, 250)];
    let sets = timed(&cameras, 5000, |k, t| k == 1 && t > 2500);
    let (mut together, mut alone) = (0, 0);
    for (now, set) in sets.iter().filter(|(now, _)| *now > 1500) {
        let waited = now - set.capture_ns / MS - 40;
        // Its frame after the instant comes no later than one interval and 210 ms after the other's.
        assert!(waited <= 100 + 167 + 210, "{waited} at {now}");
        // Its last frame is of 2338.
        together += usize::from(set.views[1].is_some());
        if *now > 2338 + 250 + 2 * 167 + 1 {
            alone += 1;
            assert_eq!(waited, 0, "at {now}");
        }
    }
    assert!(together > 30 && alone > 50, "{together}, {alone}");
}

#[test]
fn cameras_that_cannot_come_in_time_hold_the_others_up_no_more_than_others() {
    // Two are seconds late, frames of the third are too far apart to interpolate.
    for other in [
        Camera(33, 0, 3000),
        Camera(16, 0, 3000),
        Camera(600, 500, 40),
    ] {
        let sets = timed(&[Camera(33, 0, 40), other], 9000, |_, _| false);
        let late: Vec<_> = sets.iter().filter(|(now, _)| *now > 6000).collect();
        assert!(late.len() > 80, "{other:?}: {}", late.len());
        for (now, set) in late {
            let waited = now - set.capture_ns / MS - 40;
            assert!(waited <= 100, "{other:?}: {waited} at {now}");
        }
    }
}

/// Why the second of two cameras is left out after some seconds.
fn left_out(other: Camera) -> Option<LeftOut> {
    let mut sync = Synchroniser::new(2);
    for now in 0..9000u64 {
        for (k, Camera(interval, offset, latency)) in
            [Camera(33, 0, 40), other].into_iter().enumerate()
        {
            let taken = now.checked_sub(latency + offset);
            if let Some(t) = taken.filter(|t| t % interval == 0) {
                sync.push(k, &frame(t + offset), now * MS);
            }
        }
        while sync.next(now * MS).is_some() {}
        assert_eq!(sync.left_out(0, now * MS), None, "the one that leads");
    }
    sync.left_out(1, 9000 * MS)
}

#[test]
fn why_a_camera_is_left_out_is_known() {
    let near = |found: f64, expected: f64| (found - expected).abs() < 0.01;
    for together in [Camera(33, 5, 40), Camera(200, 0, 400), Camera(380, 0, 300)] {
        assert_eq!(left_out(together), None, "{together:?}");
    }
    let slow = left_out(Camera(600, 500, 40));
    assert!(
        matches!(slow, Some(LeftOut::Slow(s)) if near(s, 0.6)),
        "{slow:?}"
    );
    let late = left_out(Camera(33, 0, 3000));
    assert!(
        matches!(late, Some(LeftOut::Late(s)) if near(s, 2.993)),
        "{late:?}"
    );
}

/// Replays into a fit that is left running: the one that leads ends, the other starts over, the first ends.
#[test]
fn a_camera_that_started_over_is_not_silent_when_it_takes_the_lead() {
    let mut sync = Synchroniser::new(2);
    let end = ObservationFrame {
        flags: FLAG_END_OF_STREAM,
        ..ObservationFrame::default()
    };
    let mut out = Vec::new();
    for k in 0..600 {
        let now = 33 * k;
        match k {
            // Both of a file of a minute, near its end.
            0..200 => sync.push(0, &of_file(50_000 + now), now * MS),
            200 => sync.push(0, &end, now * MS),
            // From the beginning.
            300.. => sync.push(0, &of_file(33 * (k - 300)), now * MS),
            _ => {}
        }
        match k {
            0..400 => sync.push(1, &of_file(50_000 + now), now * MS),
            400 => sync.push(1, &end, now * MS),
            _ => {}
        }
        while let Some(set) = sync.next(now * MS) {
            out.push((k, set.capture_ns / MS));
        }
    }
    let first = out.iter().position(|(_, at)| *at < 50_000);
    let (_, again) = out.split_at(first.expect("instants of the beginning"));
    // What the other showed at last has waited for it for two seconds.
    let begun = again[0].0 as usize;
    assert!(begun <= 400 + 61, "{:?}", again[0]);
    assert_eq!(again.len(), 600 - begun, "one with every frame");
    for (k, at) in again {
        assert!(*at <= 33 * (k - 300), "{at}");
    }
}

#[test]
fn where_a_camera_follows_a_file_its_times_begin() {
    let mut sync = Synchroniser::new(2);
    let mut times = Vec::new();
    for now in 0..9000 {
        // Records of a minute into the day are killed; a camera comes of a machine that has just been started.
        if now % 33 == 0 && now < 3000 {
            (0..2).for_each(|k| sync.push(k, &of_file(60_000 + now), now * MS));
        }
        if now % 33 == 0 && now > 7000 {
            sync.push(1, &frame(now), now * MS);
        }
        times.extend(std::iter::from_fn(|| sync.next(now * MS)).map(|s| s.capture_ns / MS));
    }
    assert!(times.ends_with(&[8943, 8976]), "{times:?}");
    assert_eq!(times.iter().filter(|t| **t < 60_000).count(), 60);
}

#[test]
fn no_instant_of_files_is_lost_while_a_silent_one_is_waited_for() {
    // Replayed ten times as fast, one with a hole of 40 s; what came meanwhile comes at once.
    for silent in 0..2 {
        let mut sync = Synchroniser::new(2);
        let mut times = Vec::new();
        for k in 0..2000u64 {
            let now = 3 * k;
            for camera in 0..2 {
                if camera != silent || !(600..1200).contains(&k) {
                    sync.push(camera, &of_file(33 * k), now * MS);
                }
            }
            if k % 60 == 0 || k > 1900 {
                let next = std::iter::from_fn(|| sync.next(now * MS));
                times.extend(next.map(|s| s.capture_ns / MS));
            }
        }
        assert_eq!(times.len(), 2000, "camera {silent} is silent");
        assert!(times.is_sorted());
    }
}

#[test]
fn a_stall_does_not_take_the_times_back() {
    // One looks once a second, later, and sees nobody; the others stall for longer than they are waited for.
    let cameras = [Camera(33, 0, 40), Camera(1000, 0, 170), Camera(33, 5, 40)];
    for from in [5000, 5250, 5500, 5750] {
        let stall = from..from + 260;
        let (sets, _) = shown_by(&cameras, 7000, |k, t| match k {
            1 => Some(nobody(t)),
            _ => (!stall.contains(&t)).then(|| frame(t)),
        });
        assert!(sets.len() > 150, "{} instants", sets.len());
        assert!(are_sorted(&sets), "a stall at {from}");
    }
    // A faster one comes whose frames are later.
    let cameras = [Camera(33, 0, 40), Camera(16, 0, 700)];
    let sets = timed(&cameras, 7000, |k, t| k == 1 && t < 3000);
    assert!(sets.len() > 200, "{} instants", sets.len());
    assert!(are_sorted(&sets));
}

#[test]
fn a_camera_that_comes_too_late_does_not_keep_the_lead() {
    let cameras = [Camera(33, 0, 40), Camera(33, 0, 3000)];
    for missed in [160, 5000] {
        let hiccup = 8000..8000 + missed;
        let again = hiccup.end + 33 + 40 + 100;
        let (sets, sync) = shown_by(&cameras, again + 2000, |k, t| {
            (k == 1 || !hiccup.contains(&t)).then(|| frame(t))
        });
        assert!(are_sorted(&sets), "{missed} ms");
        let after = sets.iter().filter(|(now, _)| *now > again);
        let old = after.map(|(now, set)| now - set.capture_ns / MS);
        assert!(old.max() < Some(300), "{missed} ms");
        let late = sync.left_out(1, (again + 2000) * MS);
        assert!(matches!(late, Some(LeftOut::Late(_))), "{late:?}");
    }
}

#[test]
fn a_camera_that_looks_seldom_does_not_take_the_times_back() {
    let mut sync = Synchroniser::new(2);
    let mut times = Vec::new();
    for now in 0..4000 {
        // The one that leads falters while the newest frame of the other is 0.8 s old.
        if now % 33 == 0 && !(1700..1900).contains(&now) {
            sync.push(0, &frame(now), now * MS);
        }
        if now % 900 == 0 {
            sync.push(1, &nobody(now), now * MS);
        }
        times.extend(std::iter::from_fn(|| sync.next(now * MS)).map(|s| s.capture_ns));
    }
    assert!(times.len() > 100 && times.is_sorted(), "{times:?}");
}

#[test]
fn a_prompt_camera_that_sees_nobody_does_not_shut_out_those_that_see_somebody() {
    let cameras = [
        Camera(1000, 0, 40),
        Camera(33, 0, 1200),
        Camera(33, 5, 1200),
    ];
    let (sets, _) = shown_by(&cameras, 9000, |k, t| {
        Some(if k == 0 { nobody(t) } else { frame(t) })
    });
    assert!(are_sorted(&sets));
    let late = sets.iter().filter(|(now, _)| *now > 3000);
    let shown = late.filter(|(_, set)| set.views[1].is_some() && set.views[2].is_some());
    let shown = shown.count();
    assert!(shown > 150, "{shown} instants of those who see somebody");
}

/// Three see the same, one of them by a clock that is two seconds ahead.
#[test]
fn a_clock_that_is_ahead_does_not_make_all_others_late() {
    let mut sync = Synchroniser::new(3);
    let mut together = 0;
    for now in 0..6000 {
        if now % 100 == 0 {
            sync.push(0, &frame(now + 2000), (now + 40) * MS);
        }
        if now % 33 == 0 {
            (1..3).for_each(|k| sync.push(k, &frame(now), (now + 40) * MS));
        }
        for set in std::iter::from_fn(|| sync.next((now + 40) * MS)) {
            together += usize::from(set.views[1].is_some() && set.views[2].is_some());
        }
    }
    assert!(together > 100, "{together} instants of the two");
}

#[test]
fn a_camera_about_as_late_as_it_may_be_does_not_take_and_lose_the_lead() {
    let mut sync = Synchroniser::new(2);
    let (mut changes, mut instants) = (0, 0);
    for now in 0..20_000 {
        if now >= 40 && (now - 40) % 200 == 0 {
            sync.push(0, &frame(now - 40), now * MS);
        }
        // By turns 30 ms less and more than the limit after the other's.
        for latency in [910, 970] {
            let taken = u64::checked_sub(now, latency).filter(|t| t % 33 == 0);
            let is_so = |t: &u64| (t / 2000).is_multiple_of(2) == (latency == 910);
            if let Some(t) = taken.filter(is_so) {
                sync.push(1, &frame(t), now * MS);
            }
        }
        let lead = sync.lead;
        instants += std::iter::from_fn(|| sync.next(now * MS)).count();
        changes += usize::from(sync.lead != lead);
    }
    assert!(changes <= 1, "the lead changes {changes} times");
    assert!(instants > 80, "{instants}");
}
