//! The page in a browser: what it draws, tells, and does by keys. Needs Debian's chromium.

use std::time::Duration;

use edgecap::camera::monotonic_ns;
use edgecap_client::Publisher;
use edgecap_client::joints::{BODY_JOINTS, JOINT_NAMES, PELVIS};
use edgecap_client::message::{
    BodyFrame, EventFrame, EventKind, FLAG_END_OF_STREAM, Hand, HealthFrame, HealthState,
    Intrinsics, World, WorldState,
};
use serde_json::{Value, json};

use super::{View, crowd, recorded};
use crate::program::browser::Browser;
use crate::program::{eventually, signal, stream};

/// Ten people cross the page: what is drawn is what was published. Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_shows_who_is_published() {
    let view = View::start("browser", &[]);
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    browser.open(&view.url);
    browser.until("window.edgecap");
    let name = format!("{:?}", view.camera);
    for sequence in 0..150 {
        publisher.publish(&crowd(10, sequence)).unwrap();
        std::thread::sleep(Duration::from_millis(33));
    }
    browser.until(&format!(
        "edgecap.scene().camera === {name} && edgecap.scene().sequence === 149"
    ));
    let scene = browser.value("edgecap.scene()");
    shows(&scene, &crowd(10, 149));
    assert!(
        scene["state"].as_str().unwrap().ends_with(": live"),
        "{scene}"
    );
    assert!(scene["trailPoints"].as_u64().unwrap() > 20, "{scene}");
    assert_eq!(scene["frustum"].as_array().unwrap().len(), 4);
    let work = scene["workMs"].as_f64().unwrap();
    println!("the page's own work: {work:.1} ms a frame");
    // On an idle machine it is below 8; others may be at work on this one.
    assert!(work < 40.0, "{work} ms a frame");
    let rows = browser.value("document.querySelectorAll('#people tbody tr').length");
    assert_eq!(rows, 10);

    // What happens stands beside it, the newest first; and what had happened by an earlier frame.
    let mut events = Publisher::<EventFrame>::open(&view.camera).unwrap();
    for (sequence, kind) in [(30, EventKind::ENTERED), (140, EventKind::WAVED)] {
        let mut frame = EventFrame {
            sequence,
            time_ns: crowd(10, sequence).pose_ns,
            count: 1,
            ..EventFrame::default()
        };
        let event = &mut frame.events[0];
        (event.kind, event.person, event.hand) = (kind, 3, Hand::NONE);
        if kind == EventKind::WAVED {
            event.hand = Hand::LEFT;
        }
        events.publish(&frame).unwrap();
    }
    let lines = "[...document.querySelectorAll('#events tr')].map((r) => [...r.cells].map((c) => c.textContent))";
    browser.until(&format!("{lines}.length === 2"));
    assert_eq!(
        browser.value(lines),
        json!([
            ["#3", "waved with the left hand", "0 s ago"],
            ["#3", "came", "0 s ago"]
        ])
    );

    // Back to an earlier frame, and to the newest again.
    let all = browser.value("edgecap.frames()");
    let all: Vec<u64> = serde_json::from_value(all).unwrap();
    assert!(all.len() > 100 && all.is_sorted(), "{} frames", all.len());
    browser.value("edgecap.seek(-2.0)");
    browser.until("edgecap.scene().sequence < 120");
    let scene = browser.value("edgecap.scene()");
    shows(&scene, &crowd(10, scene["sequence"].as_u64().unwrap()));
    browser.until(&format!("{lines}.length === 1"));
    browser.value("edgecap.seek(0)");
    browser.until("edgecap.scene().sequence === 149");
    if let Some(path) = std::env::var_os("EDGECAP_SCREENSHOT") {
        browser.screenshot(path.as_ref());
    }
    // Of another run the same ids are others': no way leads from one to the other. Its numbers may begin anew, …
    let anew = |place: u64, sequence: u64| BodyFrame {
        sequence,
        publish_ns: crowd(10, 150 + sequence).publish_ns,
        ..crowd(10, place)
    };
    publisher.publish(&anew(50, 0)).unwrap();
    browser.until("edgecap.scene().sequence === 0 && edgecap.scene().trailPoints === 0");
    // … or the end of the one before alone tells.
    publisher.publish(&anew(60, 1)).unwrap();
    browser.until("edgecap.scene().sequence === 1");
    let mut end = anew(60, 1);
    end.flags |= FLAG_END_OF_STREAM;
    publisher.publish(&end).unwrap();
    browser.until("edgecap.scene().state.endsWith(': the input has ended')");
    publisher.publish(&anew(70, 2)).unwrap();
    browser.until("edgecap.scene().sequence === 2 && edgecap.scene().trailPoints === 0");
    // Opened again it has the past that was there before it.
    browser.open(&view.url);
    browser.until("window.edgecap && edgecap.frames().length > 100");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);

    drop(view);
    browser.until("edgecap.scene().state.startsWith('not connected')");
}

/// Who lacks the token is told so; a room of several cameras has no one lens to be away from. Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_shows_a_room_to_who_has_the_token() {
    let view = View::start("browser-room", &["--token", "a-token-of-ours"]);
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    browser.open(&format!("http://{}/?token=an-older-one", view.host()));
    browser.until("window.edgecap");
    let said = "document.getElementById('say').textContent";
    browser.until(&format!("{said}.startsWith('not let in: ')"));
    let refused = browser.value(said);
    assert!(refused.as_str().unwrap().contains("?token="), "{refused}");

    browser.open(&view.url);
    browser.until("window.edgecap");
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut frame = crowd(2, 1);
    (frame.width, frame.height) = (0, 0);
    frame.intrinsics = Intrinsics::default();
    let mut at = |sequence: u64| {
        frame.sequence = sequence;
        frame.publish_ns = 2_000_000 + sequence * 33_000_000;
        publisher.publish(&frame).unwrap();
        std::thread::sleep(Duration::from_millis(33));
    };
    (0..20).for_each(&mut at);
    browser.until("edgecap.scene().sequence === 19");
    let cell = "document.querySelector('#people tbody tr').cells[3].textContent";
    browser.until(&format!("{cell} !== ''"));
    let [x, _, z] = frame.in_world(&frame.bodies[0]).unwrap().joints3d[PELVIS];
    assert_eq!(browser.value(cell), *format!("{x:.2}, {z:.2} m"));
    let place = browser.value("document.getElementById('place').textContent");
    assert_eq!(place, "at x, z");
    let floor = "[...document.querySelectorAll('#times tr')].some((r) => r.cells[0].textContent === 'floor')";
    assert_eq!(browser.value(floor), false);
    assert_eq!(browser.value("edgecap.scene().frustum.length"), 0);

    // A name stands above the head, whichever way is up in the room's own axes: here its z.
    let quarter = std::f32::consts::FRAC_1_SQRT_2;
    frame.world = World {
        rotation: [-quarter, 0.0, 0.0, quarter],
        translation: [0.0; 3],
        state: WorldState::GIVEN,
    };
    frame.sequence = 20;
    frame.publish_ns = 2_000_000 + 20 * 33_000_000;
    publisher.publish(&frame).unwrap();
    browser.until("edgecap.scene().sequence === 20");
    let scene = browser.value("edgecap.scene()");
    let head = JOINT_NAMES.iter().position(|n| *n == "head_top").unwrap();
    for (drawn, body) in scene["people"]
        .as_array()
        .unwrap()
        .iter()
        .zip(frame.bodies())
    {
        let at: [f32; 3] = serde_json::from_value(drawn["labelAt"].clone()).unwrap();
        let [x, y, z] = frame.in_world(body).unwrap().joints3d[head];
        for (a, b) in at.into_iter().zip([x, y + 0.2, z]) {
            assert!((a - b).abs() < 1e-3, "{at:?}, above {x}, {y}, {z}");
        }
    }
}

/// Holds what the page drew against a frame: every joint in the floor's axes, every name.
fn shows(scene: &Value, frame: &BodyFrame) {
    let people = scene["people"].as_array().unwrap();
    assert_eq!(people.len(), frame.bodies().len());
    for (drawn, body) in people.iter().zip(frame.bodies()) {
        assert_eq!(drawn["id"], body.id);
        let label = format!("#{}  {:.0} %", body.id, body.score * 100.0);
        assert_eq!(drawn["label"], *label);
        let wanted = frame.in_world(body).unwrap();
        let joints: Vec<[f32; 3]> = serde_json::from_value(drawn["joints"].clone()).unwrap();
        for (j, (a, b)) in joints.iter().zip(wanted.joints3d).enumerate() {
            let off = (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
            assert!(off < 1e-3, "body {}, joint {j}: {a:?}, not {b:?}", body.id);
        }
        assert_eq!(joints.len(), BODY_JOINTS);
        let pelvis = joints[PELVIS];
        assert!((pelvis[1] - wanted.position[1]).abs() < 1e-3);
    }
}

/// Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_goes_through_a_record_by_keys() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (take, other) = (folder.path().join("take"), folder.path().join("other"));
    recorded(&take, 1200);
    recorded(&other, 30);
    let (take, other) = (take.to_str().unwrap(), other.to_str().unwrap());
    let view = View::of(
        "take",
        &["view", "--record", take, "--listen", "127.0.0.1:0"],
    );
    browser.open(&view.url);
    browser.until("window.edgecap && edgecap.scene().sequence === 1199");
    // The way of ten seconds, however many frames they have: each is a line further.
    let trail = browser.value("edgecap.scene().trailPoints");
    assert!(trail.as_u64().unwrap() > 1900, "{trail} points");
    // What happened is found in the record: nobody was there before its first frame.
    browser.until("edgecap.events().map((e) => e.event).join() === 'main_person,entered'");
    browser.value("edgecap.seek(-11.9)");
    browser.until("edgecap.scene().sequence < 20 && edgecap.events().length === 0");
    browser.value("edgecap.seek(0)");
    browser.until("edgecap.scene().sequence === 1199");

    browser.value(
        "window.press = (key, more, at = document.body) => at.dispatchEvent(new KeyboardEvent('keydown', \
         { key, code: key, bubbles: true, cancelable: true, ...more }))",
    );
    // Quicker one after the other than the tables are written: in the end they are those of the frame that is shown.
    browser.value("for (const ms of [0, 40, 80]) setTimeout(() => press('ArrowLeft'), ms)");
    browser.until("edgecap.scene().sequence === 1196");
    browser.until("document.querySelector('#times').textContent.includes('frame1196')");
    // What the browser itself does by a key, and who chooses a camera, moves nothing.
    browser.value("press('ArrowLeft', { altKey: true }); press('ArrowLeft', { ctrlKey: true })");
    browser.value("press('ArrowLeft', {}, document.getElementById('camera'))");
    // Nor does who turns the view.
    let turned = browser.value("edgecap.scene().turned").as_f64().unwrap();
    let canvas = "document.getElementById('space')";
    assert_eq!(browser.value(&format!("{canvas}.tabIndex")), 0);
    browser.value(&format!(
        "press('ArrowLeft', {{ shiftKey: true }}, {canvas})"
    ));
    let after = browser.value("edgecap.scene().turned").as_f64().unwrap();
    assert!((after - turned).abs() > 0.05, "{turned} and {after}");
    browser.value("press('ArrowLeft')");
    browser.until("edgecap.scene().sequence === 1195");
    // The slider goes along though it was used before.
    browser.value("document.getElementById('scrub').focus()");
    browser.value("press('ArrowLeft', {}, document.activeElement)");
    browser.until("Math.abs(document.getElementById('scrub').valueAsNumber + 0.05) < 0.002");

    // Dragged to its right end it is at the end of the record, however many milliseconds that is long.
    let slider = "document.getElementById('scrub')";
    let length = browser.value(&format!("-Number({slider}.min)"));
    let length = length.as_f64().unwrap();
    assert!((length - 11.993).abs() < 1e-6, "{length} s");
    let [left, right, y] = ["left", "right", "y"].map(|key| {
        let place = format!("{slider}.getBoundingClientRect().{key}");
        browser.value(&place).as_f64().unwrap()
    });
    browser.drag([(left + right) / 2.0, y + 5.0], [right + 20.0, y + 5.0]);
    browser.until("document.getElementById('when').textContent === 'end'");
    browser.until("edgecap.scene().sequence === 1199");

    // Another record at the same address is shown without anybody's doing.
    let host = view.host().to_owned();
    drop(view);
    let _view = View::of("other", &["view", "--record", other, "--listen", &host]);
    browser.until("window.edgecap && edgecap.scene().camera === 'other'");
    assert_eq!(browser.value("edgecap.frames().length"), 30);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// As where the network breaks off. Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_whose_connections_break_off_shows_all_of_a_record_once() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let take = folder.path().join("take");
    // Somebody enters, and nothing else happens.
    recorded(&take, 50);
    let take = take.to_str().unwrap();
    let view = View::of(
        "take",
        &["view", "--record", take, "--listen", "127.0.0.1:0"],
    );
    // The first connection of each stream ends after so many messages.
    browser.before(
        "{ const Own = WebSocket; const most = { bodies: 10, events: 1 }; window.heard = { bodies: 0, events: 0 }; \
         window.WebSocket = class extends Own { constructor(url) { super(url); \
         const kind = new URL(url).pathname.slice(1); let left = most[kind]; most[kind] = 0; \
         this.addEventListener('message', () => { heard[kind]++; if (--left === 0) this.close(); }); } }; }",
    );
    browser.open(&view.url);
    browser.until("window.edgecap && edgecap.frames().length === 50");
    // And a word after the last of them.
    browser.until("heard.bodies === 61");
    browser.until("heard.events === 2");
    assert_eq!(browser.value("edgecap.events().length"), 1);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_waits_for_a_slow_camera_and_lets_go_of_who_has_gone() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    let gone = stream("page-gone");
    let view = View::start("page-slow", &["--camera", &gone]);
    let mut slow = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut other = Publisher::<BodyFrame>::open(&gone).unwrap();
    // The page's time, so that nobody has to wait for it.
    browser.before(
        "{ const now = performance.now.bind(performance); window.later = 0; \
         performance.now = () => now() + window.later; }",
    );
    browser.open(&view.url);
    browser.until("window.edgecap");
    let mut sequence = 0;
    let mut slowly = |browser: &mut Browser, wanted: &str| {
        eventually(wanted, || {
            sequence += 1;
            let mut frame = crowd(0, sequence);
            frame.publish_ns = sequence * 5_000_000_000;
            slow.publish(&frame).unwrap();
            (browser.value(wanted) == Value::Bool(true)).then_some(())
        });
    };
    slowly(&mut browser, "edgecap.frames().length > 3");
    let cameras = "[...document.getElementById('camera').options].map((o) => o.value).join()";
    let both = format!("{cameras} === '{},{gone}'", view.camera);
    let mut sequence = 0;
    let mut are_both = |browser: &mut Browser| {
        eventually("both cameras on the page", || {
            sequence += 1;
            other.publish(&crowd(1, sequence)).unwrap();
            (browser.value(&both) == Value::Bool(true)).then_some(())
        });
    };
    are_both(&mut browser);

    // Back to who was there before nobody came any more.
    browser.value(&format!("edgecap.choose('{gone}')"));
    browser.until("edgecap.scene().people.length === 0");
    browser.value("window.dispatchEvent(new KeyboardEvent('keydown', { code: 'ArrowLeft' }))");
    browser.until("edgecap.scene().people.length === 1");
    browser.value(&format!("edgecap.choose('{}')", view.camera));

    // A frame is not late in twice the time between the last ones.
    browser.value("window.known = edgecap.frames().at(-1)");
    slowly(&mut browser, "edgecap.frames().at(-1) > window.known");
    browser.value("window.later = 5000");
    std::thread::sleep(Duration::from_millis(300));
    let state = browser.value("edgecap.scene().state");
    assert_eq!(state, format!("{}: live", view.camera));
    browser.value("window.later = 200000");
    browser.until("edgecap.scene().state.endsWith(': no frames come')");
    // Nothing is kept of who has been away for a minute, but of who is looked at.
    browser.until(&format!("{cameras} === '{}'", view.camera));
    are_both(&mut browser);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_tells_of_each_camera_and_keeps_what_is_paused() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    let second = stream("second");
    let view = View::start("first", &["--camera", &second]);
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut other = Publisher::<BodyFrame>::open(&second).unwrap();
    browser.open(&view.url);
    browser.until("window.edgecap");
    let shown = |browser: &mut Browser, publisher: &mut Publisher<BodyFrame>, frame: &BodyFrame| {
        let name = format!("{:?}", view.camera);
        let wanted = format!(
            "edgecap.scene().camera === {name} && edgecap.scene().sequence === {}",
            frame.sequence
        );
        eventually("a frame on the page", || {
            publisher.publish(frame).unwrap();
            (browser.value(&wanted) == Value::Bool(true)).then_some(())
        });
    };
    // The view goes along with the floor when it becomes known.
    let mut floorless = crowd(2, 0);
    floorless.world = World::default();
    shown(&mut browser, &mut publisher, &floorless);
    let scene = browser.value("edgecap.scene()");
    assert!(scene["floor"].as_f64().unwrap() < -0.5, "{scene}");
    shown(&mut browser, &mut publisher, &crowd(2, 1));
    let scene = browser.value("edgecap.scene()");
    assert_eq!(scene["floor"], 0, "{scene}");
    let height = scene["looksAt"][1].as_f64().unwrap();
    assert!((height - 0.9).abs() < 0.01, "{scene}");

    // Paused for longer than a minute: the frame stays.
    for sequence in 2..60 {
        shown(&mut browser, &mut publisher, &crowd(2, sequence));
    }
    browser.value("edgecap.seek(-1.0)");
    browser.until("edgecap.scene().sequence < 59");
    let paused = browser.value("edgecap.scene().sequence");
    for late in 1..=40 {
        let mut frame = crowd(2, 60 * late);
        frame.sequence = 1000 + late;
        publisher.publish(&frame).unwrap();
        browser.until(&format!("edgecap.frames().at(-1) === {}", 1000 + late));
    }
    browser.until("!edgecap.frames().includes(59)");
    assert_eq!(browser.value("edgecap.scene().sequence"), paused);
    let frames = browser.value("edgecap.frames()");
    assert!(
        frames.as_array().unwrap().contains(&paused),
        "{frames}: without {paused}"
    );
    browser.value("edgecap.seek(0)");
    browser.until("edgecap.scene().sequence === 1040");

    // One is gone without a word, another goes on.
    let mut sequence = 0;
    eventually("that no frames come", || {
        sequence += 1;
        other.publish(&crowd(1, sequence)).unwrap();
        let said = browser.value("edgecap.scene().state");
        (said == format!("{}: no frames come", view.camera)).then_some(())
    });
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);

    browser.before(
        "const get = HTMLCanvasElement.prototype.getContext; \
         HTMLCanvasElement.prototype.getContext = function (kind, ...more) { \
         return kind.startsWith('webgl') ? null : get.call(this, kind, ...more); };",
    );
    browser.open(&view.url);
    browser.until("document.getElementById('say')?.textContent.includes('has no WebGL')");
}

/// Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_says_why_no_frames_come() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    let view = View::start("browser-health", &[]);
    browser.open(&view.url);
    browser.until("window.edgecap && edgecap.scene().state.startsWith('nobody publishes yet')");
    let mut health = Publisher::<HealthFrame>::open(&view.camera).unwrap();
    let since = monotonic_ns() - 90_000_000_000;
    let mut says =
        |browser: &mut Browser, state, [cameras_live, cameras]: [u32; 2], wanted: &str| {
            let wanted = format!("{}: {wanted}", view.camera);
            eventually(&wanted, || {
                let message = HealthFrame {
                    publish_ns: monotonic_ns(),
                    since_ns: since,
                    state,
                    cameras,
                    cameras_live,
                    ..HealthFrame::default()
                };
                health.publish(&message).unwrap();
                let said = browser.value("edgecap.scene().state");
                let said = said.as_str().unwrap().to_owned();
                said.starts_with(&wanted).then_some(said)
            })
        };
    let away = says(
        &mut browser,
        HealthState::AWAY,
        [0, 1],
        "the camera has been away since ",
    );
    let again = says(
        &mut browser,
        HealthState::AWAY,
        [0, 1],
        "the camera has been away since ",
    );
    assert_eq!(away, again, "it is not read out every second");
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    eventually("people", || {
        publisher.publish(&crowd(1, 1)).unwrap();
        let said = browser.value("edgecap.scene().state");
        said.as_str().unwrap().ends_with(": live").then_some(())
    });
    let stalled = "the camera has sent no picture since ";
    says(&mut browser, HealthState::STALLED, [0, 1], stalled);
    says(
        &mut browser,
        HealthState::STALLED,
        [2, 3],
        "2 of 3 cameras send",
    );
    // One that says nothing any more may have gone long since.
    browser.until("edgecap.scene().state.endsWith(': no frames come')");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// As where a machine loses its power. Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_notices_a_server_that_answers_no_more() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    let view = View::start("silent", &[]);
    browser.open(&view.url);
    browser.until("window.edgecap && edgecap.scene().state.startsWith('nobody publishes yet')");
    signal(view.run.pid(), "STOP");
    browser.until("edgecap.scene().state.startsWith('not connected')");
    signal(view.run.pid(), "CONT");
    browser.until("edgecap.scene().state.startsWith('nobody publishes yet')");

    // A page is not loaded anew from a server that is gone again.
    browser.value(
        "{ window.isOld = true; sessionStorage.refused = 0; const own = window.fetch; \
         window.fetch = (...asked) => { if (sessionStorage.refused >= 2) return own(...asked); \
         sessionStorage.refused++; return Promise.reject(new TypeError('no server')); }; loadAnew(0) }",
    );
    browser.until("!window.isOld && window.edgecap && sessionStorage.refused >= 2");
    browser.until("edgecap.scene().state.startsWith('nobody publishes yet')");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_says_why_no_stream_comes_and_when_the_past_does() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    let view = View::start("streamless", &[]);
    // Every stream is taken.
    let others: Vec<_> = (0..48).map(|_| view.connect("")).collect();
    browser.open(&view.url);
    browser.until("window.edgecap && edgecap.scene().state.startsWith('full: ')");
    drop(others);
    browser.until("edgecap.scene().state.startsWith('nobody publishes yet')");

    // As a proxy that knows no WebSocket, until it is let through; and of the past the end alone is late.
    browser.before(
        "{ const Own = WebSocket; window.isOpen = false; window.late = []; window.said = []; \
         window.WebSocket = class extends Own { constructor(url) { \
         said.push(document.getElementById('say').textContent); \
         super(window.isOpen ? url : url.replace('/bodies', '/nothing')); \
         this.addEventListener('message', (e) => { if (e.data !== 'now') return; \
         e.stopImmediatePropagation(); late.push(() => this.onmessage(e)); }); } }; }",
    );
    browser.open(&view.url);
    browser.until(
        "window.edgecap && edgecap.scene().state.startsWith('the server answers, but no stream')",
    );
    // Not after the first one in vain: the server may have come up meanwhile.
    assert_eq!(browser.value("said[1]"), "connecting …");
    browser.value("window.isOpen = true");
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut sequence = 0;
    let mut until = |browser: &mut Browser, end: &str| {
        let wanted = format!("edgecap.scene().state === '{}: {end}'", view.camera);
        eventually(end, || {
            sequence += 1;
            publisher.publish(&crowd(1, sequence)).unwrap();
            (browser.value(&wanted) == Value::Bool(true)).then_some(())
        });
    };
    until(&mut browser, "the last minute is loading …");
    browser.value("late.forEach((take) => take())");
    until(&mut browser, "live");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_shows_the_chosen_camera_again_and_nothing_of_a_films_earlier_run() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    let film = stream("chosen");
    let view = View::start("not-chosen", &["--camera", &film]);
    let mut other = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut publisher = Publisher::<BodyFrame>::open(&film).unwrap();
    browser.open(&view.url);
    browser.until("window.edgecap");
    let until = |browser: &mut Browser, wanted: &str, publish: &mut dyn FnMut()| {
        eventually(wanted, || {
            publish();
            (browser.value(wanted) == Value::Bool(true)).then_some(())
        });
    };
    // The one that comes first is shown, until the user chooses; the past that comes again begins with it, too.
    let is_other = format!("edgecap.scene().camera === '{}'", view.camera);
    until(&mut browser, &is_other, &mut || {
        other.publish(&crowd(1, 1)).unwrap();
    });
    let is_there =
        format!("[...document.getElementById('camera').options].some((o) => o.value === '{film}')");
    until(&mut browser, &is_there, &mut || {
        publisher.publish(&crowd(1, 60)).unwrap();
    });
    browser.value(&format!("edgecap.choose('{film}')"));
    browser.value("window.isOld = true; location.reload()");
    let is_chosen = format!("edgecap.scene().camera === '{film}'");
    browser.until(&format!("!window.isOld && window.edgecap && {is_chosen}"));

    // The film begins again after its end, and goes beyond where something happened.
    let mut events = Publisher::<EventFrame>::open(&film).unwrap();
    let mut happened = EventFrame {
        sequence: 50,
        time_ns: crowd(1, 50).pose_ns,
        count: 1,
        ..EventFrame::default()
    };
    (happened.events[0].kind, happened.events[0].person) = (EventKind::ENTERED, 1);
    until(&mut browser, "edgecap.events().length > 0", &mut || {
        events.publish(&happened).unwrap();
    });
    let mut last = crowd(1, 60);
    last.flags |= FLAG_END_OF_STREAM;
    // Later than the page was told that nobody is shown any more.
    last.publish_ns += 5_000_000_000;
    let has_ended = "edgecap.scene().state.endsWith(': the input has ended')";
    until(&mut browser, has_ended, &mut || {
        publisher.publish(&last).unwrap();
    });
    for sequence in [1, 90] {
        let mut again = crowd(1, sequence);
        again.publish_ns += 10_000_000_000;
        let is_shown = format!("edgecap.scene().sequence === {sequence}");
        until(&mut browser, &is_shown, &mut || {
            publisher.publish(&again).unwrap();
        });
    }
    assert_eq!(browser.value("edgecap.events()"), json!([]));
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}
