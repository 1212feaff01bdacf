//! OSC and VMC, read by decoders that share nothing with their writers.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Cursor, Write};
use std::net::{TcpListener, UdpSocket};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use edgecap::body::skeleton::{Pose, Posed, Skeleton, bone_rotations};
use edgecap::camera::monotonic_ns;
use edgecap::capture::{AviReader, Frame, Source, demo};
use edgecap::joints::{BODY_JOINTS, JOINT_NAMES, PELVIS};
use edgecap::record::{BodiesRow, RowReader};
use edgecap_client::message::{
    Body, BodyFrame, BodyState, EventFrame, EventKind, FLAG_END_OF_STREAM, Hand, HealthFrame,
    HealthState, World, WorldState,
};
use edgecap_client::{Publisher, Subscriber};
use glam::{DQuat, DVec3};

use crate::program::stand_in::{StandIn, Watched};
use crate::program::{Running, assert_fails, edgecap, eventually, signal, stderr, stream};

/// A message of OSC 1.0.
#[derive(Debug, Clone, Default)]
struct Osc {
    address: String,
    numbers: Vec<f32>,
    words: Vec<String>,
}

/// Reads a bundle by the words of the specification: its time, seconds since 1970, and its messages.
fn bundle(bytes: &[u8]) -> (f64, Vec<Osc>) {
    assert_eq!(&bytes[..8], b"#bundle\0");
    let word = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    let time = f64::from(word(8)) - 2_208_988_800.0 + f64::from(word(12)) / 4_294_967_296.0;
    let mut messages = Vec::new();
    let mut at = 16;
    while at < bytes.len() {
        let size = word(at) as usize;
        assert_eq!(size % 4, 0);
        messages.push(message(&bytes[at + 4..at + 4 + size]));
        at += 4 + size;
    }
    (time, messages)
}

fn message(bytes: &[u8]) -> Osc {
    let text = |at: &mut usize| {
        let length = bytes[*at..].iter().position(|b| *b == 0).unwrap();
        let text = String::from_utf8(bytes[*at..*at + length].to_vec()).unwrap();
        // At least one zero, then up to the next multiple of four.
        *at += (length / 4 + 1) * 4;
        text
    };
    let mut at = 0;
    let mut found = Osc {
        address: text(&mut at),
        ..Osc::default()
    };
    let types = text(&mut at);
    for kind in types.strip_prefix(',').unwrap().chars() {
        match kind {
            's' => found.words.push(text(&mut at)),
            'f' | 'i' => {
                let raw = bytes[at..at + 4].try_into().unwrap();
                let number = match kind {
                    'f' => f32::from_be_bytes(raw),
                    _ => i32::from_be_bytes(raw) as f32,
                };
                found.numbers.push(number);
                at += 4;
            }
            other => panic!("type {other}"),
        }
    }
    assert_eq!(at, bytes.len());
    found
}

/// A port to listen at.
fn listen() -> (UdpSocket, String) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let wait = Some(Duration::from_millis(300));
    socket.set_read_timeout(wait).unwrap();
    let address = socket.local_addr().unwrap().to_string();
    (socket, address)
}

fn receive(socket: &UdpSocket) -> Option<(f64, Vec<Osc>)> {
    let mut bytes = [0; 65536];
    let length = socket.recv(&mut bytes).ok()?;
    Some(bundle(&bytes[..length]))
}

/// Somebody with a bent left elbow who has turned a quarter to the left, seen by a camera that looks down by 0.2 rad.
fn pose() -> Pose {
    let skeleton = Skeleton::builtin();
    let mut pose = Pose::facing_camera(4.0);
    pose.rotation = DQuat::from_rotation_x(0.2)
        * pose.rotation
        * DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let angle = |name: &str| {
        skeleton
            .angles()
            .iter()
            .position(|a| a.name == name)
            .unwrap()
    };
    pose.angles[angle("l_elbow_flexion")] = 1.2;
    pose.angles[angle("r_shoulder_abduction")] = 1.0;
    pose
}

fn frame(sequence: u64) -> BodyFrame {
    let (skeleton, pose) = (Skeleton::builtin(), pose());
    let mut posed = Posed::default();
    skeleton.pose(&pose, skeleton.lengths(), &mut posed);
    let now = monotonic_ns();
    let mut frame = BodyFrame {
        sequence,
        capture_ns: now,
        pose_ns: now,
        count: 1,
        world: World {
            // Half a turn about x, and the camera's tilt taken back.
            rotation: DQuat::from_rotation_x(std::f64::consts::PI - 0.2)
                .as_quat()
                .to_array(),
            translation: [0.0, 1.8, 0.0],
            state: WorldState::GIVEN,
        },
        ..BodyFrame::default()
    };
    frame.bodies[0] = Body {
        id: 6,
        state: BodyState::TRACKED,
        position: pose.position.as_vec3().to_array(),
        orientation: pose.rotation.as_quat().to_array(),
        joints3d: posed.joints.map(|p| p.as_vec3().to_array()),
        confidence: [0.8; BODY_JOINTS],
        bone_lengths: skeleton.lengths().map(|l| l as f32),
        bone_rotations: bone_rotations(&posed).map(|q| q.as_quat().to_array()),
        ..Body::default()
    };
    frame
}

#[test]
fn osc_names_every_joint_where_it_stands_and_when() {
    let (socket, address) = listen();
    let name = stream("osc");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    let run = Running::start(&["bridge", "--camera", &name, "--osc", &address]);
    // What is too large for one bundle comes in two of one time.
    let (time, joints) = eventually("a body", || {
        publisher.publish(&frame(3)).unwrap();
        let is_head = |(_, m): &(f64, Vec<Osc>)| m[0].address.ends_with("/frame");
        let (time, _) = receive(&socket).filter(is_head)?;
        let mut joints = Vec::new();
        while joints.len() < BODY_JOINTS {
            let (at, messages) = receive(&socket)?;
            assert_eq!(at, time, "another time than that of its frame");
            joints.extend(messages);
        }
        Some((time, joints))
    });
    assert_eq!(joints.len(), BODY_JOINTS);
    let now = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap()
        .as_secs_f64();
    assert!((0.0..60.0).contains(&(now - time)), "{} s ago", now - time);
    let published = frame(3);
    for (j, (joint, found)) in JOINT_NAMES.iter().zip(&joints).enumerate() {
        assert_eq!(found.address, format!("/edgecap/{name}/body/6/{joint}"));
        let [x, y, z] = published.world.point(published.bodies[0].joints3d[j]);
        assert_eq!(found.numbers, [x, y, z, 0.8]);
    }
    // Before a frame's bodies: how many, and in which axes.
    let head = eventually("a head", || {
        publisher.publish(&frame(4)).unwrap();
        receive(&socket).filter(|(_, m)| m[0].address == format!("/edgecap/{name}/frame"))
    });
    assert_eq!(head.1[0].words, ["floor"]);
    assert_eq!(head.1[0].numbers[1], 1.0);
    let empty = BodyFrame {
        sequence: 5,
        pose_ns: monotonic_ns(),
        ..BodyFrame::default()
    };
    eventually("the message that 6 is gone", || {
        publisher.publish(&empty).unwrap();
        receive(&socket).filter(|(_, m)| m[0].address == format!("/edgecap/{name}/body/6/gone"))
    });
    signal(run.pid(), "INT");
    let out = run.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", stderr(&out));
}

#[test]
fn osc_tells_what_happens() {
    let (socket, address) = listen();
    let name = stream("osc-events");
    let mut events = Publisher::<EventFrame>::open(&name).unwrap();
    let _run = Running::start(&["bridge", "--camera", &name, "--osc", &address]);
    let mut frame = EventFrame {
        time_ns: monotonic_ns(),
        count: 3,
        ..EventFrame::default()
    };
    let [left, waved, main, ..] = &mut frame.events;
    (left.kind, left.person, left.seconds) = (EventKind::ZONE_LEFT, 6, 1.5);
    left.set_zone("door");
    (waved.kind, waved.person, waved.hand) = (EventKind::WAVED, 7, Hand::LEFT);
    main.kind = EventKind::MAIN_PERSON;
    let (time, messages) = eventually("events", || {
        events.publish(&frame).unwrap();
        receive(&socket)
    });
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let ago = now.as_secs_f64() - time;
    assert!((0.0..60.0).contains(&ago), "{ago} s ago");
    for (found, (event, which, numbers)) in messages.iter().zip([
        ("zone_left", "door", [6.0, 1.5]),
        ("waved", "left", [7.0, 0.0]),
        ("main_person", "", [0.0, 0.0]),
    ]) {
        assert_eq!(found.address, format!("/edgecap/{name}/event/{event}"));
        assert_eq!(found.words, [which]);
        assert_eq!(found.numbers, numbers);
    }
    assert_eq!(messages.len(), 3);
    // How it is doing is told while nothing happens.
    let mut health = Publisher::<HealthFrame>::open(&name).unwrap();
    let told = eventually("how it is doing", || {
        let now = monotonic_ns();
        let away = HealthFrame {
            publish_ns: now,
            since_ns: now - 2_000_000_000,
            state: HealthState::AWAY,
            cameras: 1,
            ..HealthFrame::default()
        };
        health.publish(&away).unwrap();
        let (_, mut messages) = receive(&socket)?;
        messages
            .pop()
            .filter(|m| m.address == format!("/edgecap/{name}/health"))
    });
    assert_eq!(told.words, ["away", "unknown"]);
    assert_eq!(told.numbers, [2.0, 0.0, 0.0, 1.0]);
}

#[test]
fn what_was_before_the_bridge_is_not_handed_on() {
    let (socket, address) = listen();
    let name = stream("bridge-late");
    let mut bodies = Publisher::<BodyFrame>::open(&name).unwrap();
    let mut events = Publisher::<EventFrame>::open(&name).unwrap();
    let happened = |sequence| {
        let mut frame = EventFrame {
            sequence,
            count: 1,
            ..EventFrame::default()
        };
        (frame.events[0].kind, frame.events[0].person) = (EventKind::WAVED, sequence as u32);
        frame
    };
    // The camera was unplugged after these.
    bodies.publish(&frame(1)).unwrap();
    events.publish(&happened(1)).unwrap();
    let mut run = Running::start(&["bridge", "--camera", &name, "--osc", &address]);
    let mut said = String::new();
    let stdout = run.0.stdout.as_mut().unwrap();
    BufReader::new(stdout).read_line(&mut said).unwrap();
    assert!(said.contains("handing on"), "{said}");
    eventually("a reader of both", || {
        (bodies.subscriber_count() > 0 && events.subscriber_count() > 0).then_some(())
    });
    bodies.publish(&frame(2)).unwrap();
    events.publish(&happened(2)).unwrap();
    let (mut frames, mut waved) = (Vec::new(), Vec::new());
    eventually("both", || {
        for message in receive(&socket)?.1 {
            if message.address.ends_with("/frame") {
                frames.push(message.numbers[0]);
            } else if message.address.ends_with("/waved") {
                waved.push(message.numbers[0]);
            }
        }
        (!frames.is_empty() && !waved.is_empty()).then_some(())
    });
    assert_eq!((&frames[..], &waved[..]), (&[2.0][..], &[2.0][..]));
}

#[test]
fn a_bridge_hands_on_every_run_to_its_end() {
    let (socket, address) = listen();
    let name = stream("bridge-end");
    let mut bodies = Publisher::<BodyFrame>::open(&name).unwrap();
    let _run = Running::start(&["bridge", "--camera", &name, "--osc", &address]);
    let mut number = 0;
    eventually("a frame", || {
        number += 1;
        bodies.publish(&frame(number)).unwrap();
        receive(&socket)
    });
    // The last frame, and at once the end.
    let last = number + 1;
    bodies.publish(&frame(last)).unwrap();
    let mut end = frame(last);
    end.count = 0;
    end.flags |= FLAG_END_OF_STREAM;
    bodies.publish(&end).unwrap();
    let (mut heads, mut gone) = (Vec::new(), Vec::new());
    eventually("that somebody is gone", || {
        let (_, messages) = receive(&socket)?;
        for message in messages {
            if message.address.ends_with("/frame") {
                heads.push((message.numbers[0] as u64, message.numbers[1]));
            } else if message.address.ends_with("/gone") {
                gone.push(message.address);
            }
        }
        (!gone.is_empty()).then_some(())
    });
    assert!(heads.contains(&(last, 1.0)), "{heads:?}");
    assert_eq!(heads.last(), Some(&(last, 0.0)));
    assert_eq!(gone, [format!("/edgecap/{name}/body/6/gone")]);
    drop(bodies);

    // The camera comes back, every frame is sent at its own pace, and goes without a word.
    let mut bodies = Publisher::<BodyFrame>::open(&name).unwrap();
    let mut received = Vec::new();
    let take = |received: &mut Vec<u64>| {
        let (_, messages) = receive(&socket)?;
        let head = messages.iter().find(|m| m.address.ends_with("/frame"))?;
        received.push(head.numbers[0] as u64);
        Some(())
    };
    let mut number = 1000;
    eventually("a frame of the new run", || {
        number += 1;
        bodies.publish(&frame(number)).unwrap();
        while take(&mut received).is_some() {}
        received.contains(&number).then_some(())
    });
    received.clear();
    for paced in 2000..2010 {
        bodies.publish(&frame(paced)).unwrap();
        eventually("a frame", || {
            while received.last() != Some(&paced) {
                take(&mut received)?;
            }
            Some(())
        });
    }
    received.retain(|n| *n >= 2000);
    assert_eq!(received, (2000..2010).collect::<Vec<_>>());
    drop(bodies);
    eventually("that somebody is gone again", || {
        let (_, messages) = receive(&socket)?;
        let mut gone = messages.iter().filter(|m| m.address.ends_with("/gone"));
        gone.next().map(drop)
    });
}

/// What an avatar in Unity does with a bone's local place and rotation: left-handed axes, parents by name. Seen from
/// its root.
fn unity(bones: &BTreeMap<String, (DVec3, DQuat)>, bone: &str) -> (DVec3, DQuat) {
    let parent = match bone {
        "Hips" => return bones[bone],
        "Spine" | "RightUpperLeg" | "LeftUpperLeg" => "Hips".to_owned(),
        "Neck" | "RightUpperArm" | "LeftUpperArm" => "Spine".to_owned(),
        "Head" => "Neck".to_owned(),
        other => other
            .replace("Hand", "LowerArm.")
            .replace("LowerArm", "UpperArm")
            .replace("UpperArm.", "LowerArm")
            .replace("Foot", "LowerLeg.")
            .replace("LowerLeg", "UpperLeg")
            .replace("UpperLeg.", "LowerLeg"),
    };
    let ((at, turn), (place, own)) = (unity(bones, &parent), bones[bone]);
    (at + turn * place, turn * own)
}

/// Whether somebody is sent, as VMC says it.
fn ok(messages: &[Osc]) -> Option<f32> {
    let ok = messages.iter().find(|m| m.address == "/VMC/Ext/OK");
    ok.map(|m| m.numbers[0])
}

#[test]
fn vmc_poses_an_avatar_as_the_body_is_posed() {
    let (socket, address) = listen();
    let name = stream("vmc");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    let _run = Running::start(&["bridge", "--camera", &name, "--vmc", &address]);
    let (_, messages) = eventually("an avatar", || {
        publisher.publish(&frame(3)).unwrap();
        receive(&socket)
    });
    assert_eq!(messages[0].address, "/VMC/Ext/OK");
    assert_eq!(messages[0].numbers, [1.0]);
    let mut bones = BTreeMap::new();
    for m in messages.iter().filter(|m| m.address == "/VMC/Ext/Bone/Pos") {
        let n: Vec<f64> = m.numbers.iter().map(|n| f64::from(*n)).collect();
        let turn = DQuat::from_xyzw(n[3], n[4], n[5], n[6]);
        bones.insert(m.words[0].clone(), (DVec3::from_slice(&n[..3]), turn));
    }
    assert_eq!(bones.len(), 16);
    let root = messages.iter().find(|m| m.address == "/VMC/Ext/Root/Pos");
    let root: Vec<f64> = root.unwrap().numbers.iter().map(|n| (*n).into()).collect();
    assert_eq!(root[3..], [0.0, 0.0, 0.0, 1.0]);
    // Walking moves the root, whose height is the floor's.
    let (root, hips) = (DVec3::from_slice(&root), bones["Hips"].0);
    assert!(
        root.y == 0.0 && hips.x == 0.0 && hips.z == 0.0,
        "{root}, {hips}"
    );
    let published = frame(3);
    for (bone, joint) in [
        ("Hips", "pelvis"),
        ("Neck", "neck"),
        ("LeftUpperArm", "l_shoulder"),
        ("LeftLowerArm", "l_elbow"),
        ("LeftHand", "l_wrist"),
        ("RightHand", "r_wrist"),
        ("RightFoot", "r_ankle"),
        ("LeftFoot", "l_ankle"),
    ] {
        let joint = JOINT_NAMES.iter().position(|n| *n == joint).unwrap();
        let [x, y, z] = published.world.point(published.bodies[0].joints3d[joint]);
        // Seen in a mirror: Unity's x goes the other way.
        let wanted = DVec3::new(-f64::from(x), y.into(), z.into());
        let off = (root + unity(&bones, bone).0 - wanted).length();
        assert!(off < 1e-3, "{bone}: {off} m off");
    }
    // Upright on the floor, and turned by a quarter about the vertical alone.
    let (place, turn) = bones["Hips"];
    let up = turn * DVec3::Y;
    assert!((up - DVec3::Y).length() < 1e-3, "{up}");
    let front = turn * DVec3::Z;
    assert!(front.x.abs() > 0.999, "{front}");
    let height = published.world.point(published.bodies[0].joints3d[PELVIS])[1];
    assert!((place.y - f64::from(height)).abs() < 1e-5);

    // Nobody is there for longer than a port is kept: it is told once.
    let mut empty = frame(4);
    empty.count = 0;
    let next = |publisher: &mut Publisher<BodyFrame>, frame: &BodyFrame, wanted: f32| {
        eventually("a word about the avatar", || {
            publisher.publish(frame).unwrap();
            let (_, messages) = receive(&socket)?;
            (ok(&messages) == Some(wanted)).then_some(())
        });
    };
    next(&mut publisher, &empty, 0.0);
    publisher.publish(&empty).unwrap();
    assert!(receive(&socket).is_none(), "it is told once");
    // And at the end, at once.
    next(&mut publisher, &frame(5), 1.0);
    let mut end = frame(5);
    end.count = 0;
    end.flags |= FLAG_END_OF_STREAM;
    next(&mut publisher, &end, 0.0);
}

/// As that of a camera which was unplugged.
#[test]
fn people_of_a_publisher_that_has_fallen_silent_are_gone_until_it_goes_on() {
    let ((osc, to_osc), (vmc, to_vmc)) = (listen(), listen());
    let name = stream("bridge-quiet");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    let more = ["--osc", &to_osc, "--vmc", &to_vmc];
    let _run = Running::start(&[&["bridge", "--camera", &name], &more[..]].concat());
    for number in [3, 4] {
        eventually("an avatar", || {
            publisher.publish(&frame(number)).unwrap();
            let (_, messages) = receive(&vmc)?;
            (ok(&messages) == Some(1.0)).then_some(())
        });
        eventually("that nobody is sent", || {
            let (_, messages) = receive(&vmc)?;
            (ok(&messages) == Some(0.0)).then_some(())
        });
        let gone = format!("/edgecap/{name}/body/6/gone");
        eventually("that somebody is gone", || {
            let (_, messages) = receive(&osc)?;
            (messages[0].address == gone).then_some(())
        });
    }
}

/// A picture as a pipe has it, BT.601, each plane for itself.
fn picture(frame: &Frame) -> Vec<u8> {
    let mut bytes = b"FRAME\n".to_vec();
    for ([r, g, b], middle) in [
        ([0.299, 0.587, 0.114], 0.0),
        ([-0.168_736, -0.331_264, 0.5], 128.0),
        ([0.5, -0.418_688, -0.081_312], 128.0),
    ] {
        let pixels = frame.rgb.chunks_exact(3);
        let pixels = pixels.map(|p| [0, 1, 2].map(|c: usize| f64::from(p[c])));
        bytes.extend(pixels.map(|p| (r * p[0] + g * p[1] + b * p[2] + middle).round() as u8));
    }
    bytes
}

/// As where the network breaks off over which its pictures come.
#[test]
fn people_of_a_pipe_that_stalls_are_gone_until_it_goes_on() {
    let (osc, to_osc) = listen();
    let name = stream("pipe-quiet");
    let folder = tempfile::tempdir().unwrap();
    let mut child = edgecap()
        .args(["run", "--input", "-", "--name", &name, "--osc", &to_osc])
        .current_dir(folder.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipe = child.stdin.take().unwrap();
    let _run = Running(child);
    let mut clip = AviReader::new(Cursor::new(demo::CLIP), "demo").unwrap();
    let frames: Vec<Frame> = std::iter::from_fn(|| clip.next().unwrap())
        .take(60)
        .collect();
    let (width, height) = (frames[0].width, frames[0].height);
    let head = format!("YUV4MPEG2 W{width} H{height} F30:1 C444 XCOLORRANGE=FULL\n");
    pipe.write_all(head.as_bytes()).unwrap();
    for some in frames.chunks(30) {
        let bytes: Vec<u8> = some.iter().flat_map(picture).collect();
        // Beside the reading, and read without a pause: a socket that is full drops what comes last. Where nobody takes
        // it, it is not waited for.
        let writer = std::thread::spawn(move || {
            pipe.write_all(&bytes).unwrap();
            pipe
        });
        let mut shown = None;
        eventually("that nobody is there after the last frame", || {
            while let Some((_, messages)) = receive(&osc) {
                let frame = messages.iter().find(|m| m.address.ends_with("/frame"));
                match frame.map(|head| (head.numbers[0], head.numbers[1])) {
                    Some((number, people)) if people > 0.0 => shown = Some(number),
                    Some((number, _)) if shown == Some(number) => return Some(()),
                    _ => {}
                }
            }
            None
        });
        pipe = writer.join().unwrap();
    }
}

#[test]
fn a_run_hands_on_what_it_publishes_and_bad_addresses_are_refused() {
    let (socket, address) = listen();
    let camera = StandIn::new(10.0);
    let more = ["--osc", &address, "--view", "127.0.0.1:0"];
    let run = Watched::start("run-osc", &camera, &more);
    for (address, word) in [("frame", "camera"), ("health", "live")] {
        let address = format!("/edgecap/{}/{address}", run.name);
        eventually(&address, || {
            let (_, messages) = receive(&socket)?;
            let is_it = |m: &Osc| m.address == address && m.words[0] == word;
            messages.iter().any(is_it).then_some(())
        });
    }
    let out = run.stop();
    assert!(out.status.success(), "{}", stderr(&out));
    assert!(
        stderr(&out).contains("the page: http://127.0.0.1:"),
        "{}",
        stderr(&out)
    );
    let token = ["bridge", "--token", "open-sesame"];
    for args in [&token[..1], &token] {
        assert_fails(args, 64, &["--osc", "--vmc", "--view"]);
    }
    let args = [&token[..], &["--osc", &address]].concat();
    assert_fails(&args, 64, &["--token", "expected --view"]);
    let args = ["run", "--input", "demo", "--token", "open-sesame"];
    assert_fails(&args, 64, &["--token", "expected --view"]);
    for flag in ["--osc", "--vmc", "--view"] {
        let args = ["bridge", flag, "localhost:9000"];
        assert_fails(&args, 64, &["localhost:9000", "such as 127.0.0.1:9000"]);
    }
    let args = ["bridge", "--vmc", "127.0.0.1:65529"];
    assert_fails(&args, 64, &["expected a port up to 65528", "found 65529"]);
    // Where the system is to choose a port, nobody listens.
    let folder = tempfile::tempdir().unwrap();
    let settings = folder.path().join("edgecap.toml");
    for key in ["osc", "vmc"] {
        let words = "expected a port to send to, from 1 to 65535, found 0";
        let args = ["bridge", &format!("--{key}"), "127.0.0.1:0"];
        assert_fails(&args, 64, &[words]);
        std::fs::write(&settings, format!("[bridges]\n{key} = \"[::1]:0\"\n")).unwrap();
        let args = ["config", "check", "--config", settings.to_str().unwrap()];
        assert_fails(&args, 78, &["edgecap.toml:2:7: ", words]);
    }
}

/// A film of one grey picture.
fn grey_film(folder: &Path) -> PathBuf {
    let film = folder.join("walk.y4m");
    let mut pictures = b"YUV4MPEG2 W96 H64 F30:1 Cmono\nFRAME\n".to_vec();
    pictures.resize(pictures.len() + 96 * 64, 128);
    std::fs::write(&film, pictures).unwrap();
    film
}

/// More people read it than the settings, for longer.
#[test]
fn the_journal_does_not_hold_the_token_of_the_settings() {
    let folder = tempfile::tempdir().unwrap();
    let [settings, log] = ["edgecap.toml", "log"].map(|name| folder.path().join(name));
    std::fs::write(&settings, "[bridges]\ntoken = \"open-sesame\"\n").unwrap();
    let film = grey_film(folder.path());
    for is_journal in [true, false] {
        let stderr = std::fs::File::create(&log).unwrap();
        let it = stderr.metadata().unwrap();
        let number = it.ino() + u64::from(!is_journal);
        let mut run = edgecap();
        run.args(["run", "--size", "64x64", "--threads", "1", "--jsonl", "-"]);
        run.args(["--view", "127.0.0.1:0", "--config"])
            .arg(&settings);
        run.arg("--input").arg(&film).stderr(stderr);
        let run = run.env("JOURNAL_STREAM", format!("{}:{number}", it.dev()));
        assert!(run.output().unwrap().status.success());
        let said = std::fs::read_to_string(&log).unwrap();
        assert!(said.contains("the page: http://127.0.0.1:"), "{said}");
        assert_eq!(said.contains("open-sesame"), !is_journal, "{said}");
    }
}

/// They say it on standard output, which a unit's journal holds, too.
#[test]
fn the_journal_does_not_hold_the_token_that_a_bridge_or_a_page_was_given() {
    let folder = tempfile::tempdir().unwrap();
    let [take, log] = ["take.jsonl", "log"].map(|name| folder.path().join(name));
    let mut run = edgecap();
    run.args(["run", "--size", "64x64", "--threads", "1", "--input"]);
    run.arg(grey_film(folder.path())).arg("--jsonl").arg(&take);
    assert!(run.output().unwrap().status.success());
    let name = stream("journal");
    for args in [
        ["bridge", "--camera", &name, "--view"],
        ["view", "--camera", &name, "--listen"],
        ["view", "--record", take.to_str().unwrap(), "--listen"],
    ] {
        let stderr = std::fs::File::create(&log).unwrap();
        let it = stderr.metadata().unwrap();
        let mut verb = edgecap();
        verb.args(args)
            .args(["127.0.0.1:0", "--token", "open-sesame"])
            .env("JOURNAL_STREAM", format!("{}:{}", it.dev(), it.ino()));
        let verb = verb.stdout(Stdio::piped()).stderr(stderr).spawn();
        let mut running = Running(verb.unwrap());
        let mut said = String::new();
        let stdout = running.0.stdout.take().unwrap();
        BufReader::new(stdout).read_line(&mut said).unwrap();
        assert!(said.contains("http://127.0.0.1:"), "{args:?}: {said}");
        assert!(!said.contains("open-sesame"), "{args:?}: {said}");
    }
}

/// The cameras of the settings run meanwhile: theirs is the address, and their people alone are to be seen.
#[test]
fn a_film_goes_only_where_it_is_told_to() {
    let folder = tempfile::tempdir().unwrap();
    let (socket, osc) = listen();
    let page = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = page.local_addr().unwrap();
    let [file, flight] = ["edgecap.toml", "last"].map(|name| folder.path().join(name));
    let camera = format!(
        "[network]\nsize = \"64x64\"\nthreads = 1\n\
        [bridges]\nview = \"{taken}\"\ntoken = \"open-sesame\"\nosc = {osc:?}\nflight = {flight:?}\n\
        [[camera]]\ninput = \"/dev/video0\"\n"
    );
    std::fs::write(&file, camera).unwrap();
    let film = grey_film(folder.path());
    let run = |more: &[&str]| {
        let mut run = edgecap();
        run.args(["run", "--config", file.to_str().unwrap(), "--input"]);
        run.arg(&film).args(["--jsonl", "-"]).args(more);
        run.output().unwrap()
    };
    let out = run(&[]);
    assert!(out.status.success(), "{}", stderr(&out));
    assert!(!out.stdout.is_empty() && !flight.exists());
    socket.set_nonblocking(true).unwrap();
    assert!(receive(&socket).is_none(), "nobody has asked for it");
    let out = run(&["--osc", &osc]);
    assert!(out.status.success(), "{}", stderr(&out));
    let all = std::iter::from_fn(|| receive(&socket)).flat_map(|(_, messages)| messages);
    let all: Vec<Osc> = all.collect();
    let states = all.iter().filter(|m| m.address.ends_with("/health"));
    let states: Vec<&str> = states.map(|m| &*m.words[0]).collect();
    assert_eq!(
        (states.first(), states.last()),
        (Some(&"starting"), Some(&"ended"))
    );
    assert!(all.iter().any(|m| m.address.ends_with("/frame")));
    let out = run(&["--view", "127.0.0.1:0"]);
    let said = stderr(&out);
    assert!(
        out.status.success() && said.contains("the page: http://"),
        "{said}"
    );
    let out = run(&["--token", "another-one"]);
    assert_eq!(out.status.code(), Some(64), "{}", stderr(&out));
}

/// Whole frames of the records in a folder, by file.
fn saved(folder: &std::path::Path) -> Vec<usize> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let records = files.filter(|f| f.path().extension().is_some_and(|e| e == "record"));
    let frames = records.map(|file| {
        let file = std::io::BufReader::new(std::fs::File::open(file.path()).unwrap());
        let mut rows = RowReader::<_, BodiesRow>::new(file, "flight");
        std::iter::from_fn(|| rows.read().unwrap()).count()
    });
    frames.collect()
}

#[test]
fn the_last_minute_of_a_film_is_saved_when_asked() {
    let folder = tempfile::tempdir().unwrap();
    let flight = folder.path().join("flight");
    let name = stream("film-flight");
    let args = ["run", "--input", "demo", "--name", &name, "--flight"];
    let kept = folder.path().join("bodies.jsonl");
    let places = [flight.to_str().unwrap(), "--jsonl", kept.to_str().unwrap()];
    let run = Running::start(&[&args[..], &places].concat());
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    eventually("a frame", || {
        bodies.next(Duration::from_secs(1)).unwrap().map(drop)
    });
    signal(run.pid(), "USR1");
    eventually("a record", || (saved(&flight).len() == 1).then_some(()));
    drop(bodies);
    signal(run.pid(), "TERM");
    eventually("the end", || run.has_ended().then_some(()));
}

#[test]
fn the_last_minute_is_saved_when_asked_and_after_a_crash() {
    let folder = tempfile::tempdir().unwrap();
    let camera = StandIn::new(10.0);
    let flight = folder.path().join("flight");
    let run = Watched::start("flight", &camera, &["--flight", flight.to_str().unwrap()]);
    let bodies = run.listen::<BodyFrame>();
    let some = |n: usize| {
        for _ in 0..n {
            eventually("a frame", || {
                bodies.next(Duration::from_secs(1)).unwrap().map(drop)
            });
        }
    };
    some(3);
    signal(run.run.pid(), "USR1");
    eventually("a record", || (saved(&flight).len() == 1).then_some(()));
    let fit = eventually("fit", || run.run.child("fit"));
    signal(fit, "KILL");
    let all = eventually("another record", || {
        Some(saved(&flight)).filter(|all| all.len() == 2)
    });
    assert!(all.iter().all(|frames| *frames >= 1), "{all:?}");
    drop(bodies);
    let out = run.stop();
    assert!(out.status.success(), "{}", stderr(&out));
    assert!(
        stderr(&out).contains("the last minute → "),
        "{}",
        stderr(&out)
    );
}
