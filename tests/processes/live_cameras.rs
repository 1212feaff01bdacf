//! `edgecap fit --cameras` and `edgecap run --calibration`: several cameras that see the same people.

use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use edgecap::body::skeleton::{Posed, Skeleton};
use edgecap::camera::calibration::write_pose2sim;
use edgecap::camera::{View, monotonic_ns};
use edgecap::message::{
    BodyFrame, EventFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, HealthFrame, HealthState,
    Observation, ObservationFrame,
};
use edgecap::record::{Format, ObservationsRow, RecordWriter};
use edgecap_client::{Publisher, Subscriber};
use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::program::stand_in::{StandIn, processes_of};
use crate::program::{Running, assert_fails, eventually, signal, stderr, stream};

/// Asks a run to stop, which is no failure; what was said.
fn stopped(run: Running) -> String {
    signal(run.pid(), "TERM");
    let out = run.wait(Duration::from_secs(60));
    let said = stderr(&out);
    assert!(out.status.success(), "{said}");
    said
}

/// Cameras round the origin of a world whose y points up.
fn views(count: usize, size: [u32; 2]) -> Vec<View> {
    (0..count)
        .map(|k| {
            let a = 1.9 * k as f64;
            let position = DVec3::new(4.5 * a.sin(), 1.7, 4.5 * a.cos());
            let z = (DVec3::new(0.0, 1.0, 0.0) - position).normalize();
            let x = z.cross(DVec3::Y).normalize();
            View {
                name: format!("view{k}"),
                size,
                focal: DVec2::splat(0.9 * f64::from(size[0])),
                centre: DVec2::new(f64::from(size[0]), f64::from(size[1])) / 2.0,
                distortion: Default::default(),
                rotation: DMat3::from_cols(x, z.cross(x), z).transpose(),
                position,
            }
        })
        .collect()
}

/// Somebody who goes along x at half a metre a second, and swings an arm.
fn joints(t: f64) -> Posed {
    let skeleton = Skeleton::builtin();
    let mut pose = edgecap::body::skeleton::Pose::facing_camera(0.0);
    pose.position = DVec3::new(0.5 * t - 0.8, 0.93, 0.1);
    pose.rotation = DQuat::from_rotation_y(0.3);
    pose.angles[5] = 0.5 * (2.0 * t).sin();
    let mut posed = Posed::default();
    skeleton.pose(&pose, skeleton.lengths(), &mut posed);
    posed
}

fn frame(view: &View, sequence: u64, t: f64) -> ObservationFrame {
    let posed = joints(t);
    let mut frame = ObservationFrame {
        sequence,
        capture_ns: (t * 1e9) as u64,
        flags: FLAG_FILE_TIME,
        width: view.size[0],
        height: view.size[1],
        intrinsics: view.intrinsics(),
        count: 1,
        ..ObservationFrame::default()
    };
    let mut seen = Observation {
        score: 0.98,
        ..Observation::default()
    };
    for (out, joint) in seen.joints2d.iter_mut().zip(posed.joints) {
        let p = view.project(joint).expect("in front");
        *out = [p.x as f32, p.y as f32, 0.9];
    }
    for (out, joint) in seen.joints3d.iter_mut().zip(posed.joints) {
        let p = view.rotation * (joint - posed.joints[14]);
        *out = p.as_vec3().to_array();
    }
    frame.people[0] = seen;
    frame
}

fn calibrated(folder: &Path, views: &[View]) -> String {
    let path = folder.join("Calib.toml");
    std::fs::write(&path, write_pose2sim(views)).unwrap();
    path.display().to_string()
}

/// Mean distance of a frame's only body from the truth, metres.
fn error(frame: &BodyFrame) -> Option<f64> {
    let [body] = frame.bodies() else {
        return None;
    };
    let truth = joints(frame.pose_ns as f64 * 1e-9).joints;
    let each = body.joints3d.iter().zip(truth).take(14);
    let sum: f64 = each
        .map(|(p, q)| DVec3::from(p.map(f64::from)).distance(q))
        .sum();
    Some(sum / 14.0)
}

#[test]
fn records_of_several_cameras_become_bodies_in_the_world() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(3, [640, 480]);
    let calibration = calibrated(folder.path(), &views);
    let names: Vec<String> = (0..3).map(|k| stream(&format!("together{k}"))).collect();
    let record = |k: usize| -> PathBuf {
        let path = folder.path().join(format!("{k}.record"));
        let mut writer = RecordWriter::<ObservationsRow>::create(&path, Format::Binary).unwrap();
        // Every camera at a rate and at times of its own.
        let rate = [30.0, 25.0, 28.0][k];
        for n in 0..(4.0 * rate) as u64 {
            let t = 0.004 * k as f64 + n as f64 / rate;
            writer.write(&frame(&views[k], n, t), "").unwrap();
        }
        writer.finish().unwrap();
        path
    };
    let records: Vec<PathBuf> = (0..3).map(record).collect();
    let room = stream("together");
    let bodies = Subscriber::<BodyFrame>::open(&room).unwrap();
    // The calibration calls the cameras otherwise than the streams are called.
    let cameras: Vec<String> = names
        .iter()
        .enumerate()
        .map(|(k, n)| format!("view{k}={n}"))
        .collect();
    let args = [
        "fit",
        "--cameras",
        &cameras.join(","),
        "--calibration",
        &calibration,
    ];
    let fit = Running::start(&[&args[..], &["--name", &room]].concat());
    let replays: Vec<Running> = records
        .iter()
        .zip(&names)
        .map(|(path, name)| Running::start(&["replay", path.to_str().unwrap(), "--name", name]))
        .collect();
    let mut errors = Vec::new();
    eventually("the end of all cameras", || {
        let frame = bodies.next(Duration::from_secs(1)).unwrap()?;
        if frame.flags & FLAG_END_OF_STREAM != 0 {
            return Some(());
        }
        assert_ne!(frame.flags & FLAG_FILE_TIME, 0);
        assert_eq!((frame.width, frame.bodies[0].joints2d[3]), (0, [0.0; 2]));
        assert!(frame.world.is_known());
        errors.extend(error(&frame));
        None
    });
    for replay in replays {
        assert!(replay.wait(Duration::from_secs(60)).status.success());
    }
    let out = fit.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", stderr(&out));
    errors.sort_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2);
    assert!(errors.len() > 20, "{} bodies", errors.len());
    assert!(median.is_some_and(|m| *m < 0.05), "{median:?}");
}

/// Publishes what a camera sees at this moment.
fn show(publisher: &mut Publisher<ObservationFrame>, view: &View, began: Instant) {
    let mut seen = frame(view, 0, began.elapsed().as_secs_f64().min(3.0));
    (seen.flags, seen.capture_ns) = (0, monotonic_ns());
    seen.publish_ns = seen.capture_ns;
    publisher.publish(&seen).unwrap();
}

#[test]
fn a_camera_that_comes_late_and_one_that_is_killed_are_done_without() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(3, [640, 480]);
    let names: Vec<String> = (0..3).map(|k| stream(&format!("comes-late{k}"))).collect();
    let named: Vec<View> = views
        .iter()
        .zip(&names)
        .map(|(v, name)| View {
            name: name.clone(),
            ..v.clone()
        })
        .collect();
    let calibration = calibrated(folder.path(), &named);
    let room = stream("comes-late");
    let bodies = Subscriber::<BodyFrame>::open(&room).unwrap();
    let args = [
        "fit",
        "--cameras",
        &names.join(","),
        "--calibration",
        &calibration,
    ];
    let fit = Running::start(&[&args[..], &["--name", &room]].concat());
    let open = |k: usize| Publisher::<ObservationFrame>::open(&names[k]).unwrap();
    let mut publishers = [Some(open(0)), Some(open(1)), None];
    let began = Instant::now();
    // Somebody is seen by so many cameras as count: first two, then three, then the last one alone with the second.
    for stage in 0..3 {
        match stage {
            0 => {}
            1 => publishers[2] = Some(open(2)),
            _ => publishers[0] = None,
        }
        let mut newest = 0;
        let mut found = 0;
        eventually("bodies", || {
            for (publisher, view) in publishers.iter_mut().zip(&named) {
                if let Some(publisher) = publisher {
                    show(publisher, view, began);
                }
            }
            let frame = bodies.newest(Duration::from_millis(25)).unwrap()?;
            assert!(frame.capture_ns >= newest, "times go on");
            newest = frame.capture_ns;
            assert_eq!(frame.flags, 0, "nothing has ended");
            found += usize::from(frame.count == 1);
            (found > 15).then_some(())
        });
    }
    signal(fit.pid(), "TERM");
    let out = fit.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", stderr(&out));
}

#[test]
fn a_room_says_how_many_of_its_cameras_come() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(3, [640, 480]);
    let names: Vec<String> = (0..3).map(|k| stream(&format!("roomful{k}"))).collect();
    let named = views.iter().zip(&names);
    let named = named.map(|(v, name)| View {
        name: name.clone(),
        ..v.clone()
    });
    let named: Vec<View> = named.collect();
    let calibration = calibrated(folder.path(), &named);
    let cameras = names.join(",");
    let fit = |room: &str| {
        let args = ["fit", "--cameras", &cameras, "--calibration", &calibration];
        Running::start(&[&args[..], &["--name", room]].concat())
    };
    let room = stream("roomful");
    let health = Subscriber::<HealthFrame>::open(&room).unwrap();
    let run = fit(&room);
    let open = |k: usize| Publisher::<ObservationFrame>::open(&names[k]).unwrap();
    let mut publishers = vec![open(0), open(1), open(2)];
    let began = Instant::now();
    let told = |publishers: &mut [Publisher<ObservationFrame>], state, come| {
        eventually("what is so", || {
            for (publisher, view) in publishers.iter_mut().zip(&named) {
                show(publisher, view, began);
            }
            let told = health.next(Duration::from_millis(25)).unwrap()?;
            assert_eq!(told.cameras, 3);
            let is_measured = told.observed_hz > 0.0 || state != HealthState::LIVE;
            ((told.state, told.cameras_live) == (state, come) && is_measured).then_some(*told)
        })
    };
    let all = told(&mut publishers, HealthState::LIVE, 3);
    assert!(all.latency_us > 0 && all.observed > 0, "{all:?}");
    assert_eq!((all.source_hz, all.left_out, all.input_width), (0.0, 0, 0));
    publishers.pop();
    told(&mut publishers, HealthState::LIVE, 2);
    publishers.clear();
    let none = told(&mut publishers, HealthState::STALLED, 0);
    assert!(
        none.observed > all.observed && none.observed_hz == 0.0,
        "{none:?}"
    );
    drop(health);
    stopped(run);
    // Who has a camera's name leaves what is said under that to the camera.
    let _health = Publisher::<HealthFrame>::open(&names[0]).unwrap();
    let bodies = Subscriber::<BodyFrame>::open(&names[0]).unwrap();
    let run = fit(&names[0]);
    let mut publishers = [open(0), open(1)];
    eventually("bodies", || {
        for (publisher, view) in publishers.iter_mut().zip(&named) {
            show(publisher, view, began);
        }
        bodies.next(Duration::from_millis(25)).unwrap().map(|_| ())
    });
    drop(bodies);
    stopped(run);
}

#[test]
fn a_camera_too_slow_to_be_combined_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(2, [640, 480]);
    let names = [stream("quick"), stream("seldom")];
    let cameras = format!("view0={},view1={}", names[0], names[1]);
    let calibration = calibrated(folder.path(), &views);
    let args = ["fit", "--cameras", &cameras, "--calibration", &calibration];
    let mut fit = Running::start(&[&args[..], &["--name", &stream("apart")]].concat());
    let (pid, is_heard) = (fit.pid(), AtomicBool::new(false));
    let line = std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut publishers =
                [&names[0], &names[1]].map(|n| Publisher::<ObservationFrame>::open(n).unwrap());
            let began = Instant::now();
            let goes_on = || !is_heard.load(Ordering::Relaxed) && began.elapsed().as_secs() < 60;
            for step in (0..).take_while(|_| goes_on()) {
                show(&mut publishers[0], &views[0], began);
                if step % 12 == 0 {
                    show(&mut publishers[1], &views[1], began);
                }
                std::thread::sleep(Duration::from_millis(50));
            }
            signal(pid, "TERM");
        });
        let line = fit.says("to be combined");
        is_heard.store(true, Ordering::Relaxed);
        line
    });
    assert!(
        line.contains(&names[1]) && line.contains("where 0.4 s"),
        "{line}"
    );
    let out = fit.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", stderr(&out));
}

#[test]
fn what_does_not_go_together_is_said_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(2, [640, 480]);
    let two = calibrated(folder.path(), &views);
    let one = folder.path().join("one.toml").display().to_string();
    std::fs::write(&one, write_pose2sim(&views[..1])).unwrap();
    let fit = |cameras: &str, calibration: &str, code: i32, words: &[&str]| {
        let args = ["fit", "--cameras", cameras, "--calibration", calibration];
        assert_fails(&args, code, words);
    };
    fit(
        "view0,hall",
        &two,
        64,
        &["view0, view1", "found hall", "CAMERA=NAME"],
    );
    fit("view0", &two, 64, &["view0,view1", "found 1"]);
    fit("view0,view0", &two, 64, &["once", "twice"]);
    fit("view0,view1=view0", &two, 64, &["once", "twice"]);
    fit("view0,view1", &one, 65, &["at least two cameras", "view0"]);
    fit("view0,view1", "/nowhere.toml", 66, &["/nowhere.toml"]);
    fit("view0,view1=a/b", &two, 64, &["a/b"]);
    for args in [
        &["fit", "--cameras", "view0,view1"][..],
        &["fit", "--calibration", &two],
        &[
            "fit",
            "--cameras",
            "view0,view1",
            "--calibration",
            &two,
            "--input",
            "x",
        ],
        &[
            "fit",
            "--cameras",
            "view0,view1",
            "--calibration",
            &two,
            "--stills",
        ],
    ] {
        let out = crate::program::output(args);
        assert_eq!(out.status.code(), Some(64), "{args:?}: {}", stderr(&out));
    }
    let settings = folder.path().join("fit.toml").display().to_string();
    std::fs::write(&settings, "[identity]\nconfirm_hits = 5\nmemory = 5\n").unwrap();
    let calibrated = ["fit", "--cameras", "view0,view1", "--calibration", &two];
    // It ends at the name of the room.
    let more = ["--config", &settings, "--name", "a/b"];
    let out = crate::program::output(&[&calibrated[..], &more].concat());
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(64), "{said}");
    let told = "mean nothing with several cameras: identity.confirm_hits";
    assert_eq!(said.matches(told).count(), 1, "{said}");
    assert!(!said.contains("memory"), "{said}");
    let run = ["run", "--input", "demo", "--live", "--calibration", &two];
    assert_fails(&run, 64, &["--calibration", "several", "found one"]);
}

#[test]
fn pictures_of_another_size_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(2, [640, 480]);
    let calibration = calibrated(folder.path(), &views);
    let names = [stream("size0"), stream("size1")];
    let cameras = format!("view0={},view1={}", names[0], names[1]);
    let room = stream("size");
    let args = ["fit", "--cameras", &cameras, "--calibration", &calibration];
    let fit = Running::start(&[&args[..], &["--name", &room]].concat());
    let mut publisher = Publisher::<ObservationFrame>::open(&names[0]).unwrap();
    let began = Instant::now();
    eventually("its end", || {
        let turned = View {
            size: [480, 640],
            ..views[0].clone()
        };
        show(&mut publisher, &turned, began);
        std::thread::sleep(Duration::from_millis(20));
        fit.has_ended().then_some(())
    });
    let out = fit.wait(Duration::from_secs(60));
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(65), "{said}");
    assert!(
        said.contains("640x480") && said.contains("turned by 90 degrees"),
        "{said}"
    );
}

/// Verbs of the processes whose command line names a stream.
fn verbs(name: &str) -> Vec<String> {
    let line = |pid: &u32| std::fs::read(format!("/proc/{pid}/cmdline")).ok();
    let mut verbs: Vec<String> = processes_of(name, &[])
        .iter()
        .filter_map(line)
        .filter_map(|l| Some(String::from_utf8_lossy(l.split(|b| *b == 0).nth(1)?).into_owned()))
        .collect();
    verbs.sort();
    verbs
}

/// A settings file for calibrated cameras of the room `name`, every second one on its side, and how they stand.
fn settings(folder: &Path, name: &str, cameras: &[StandIn]) -> (String, Vec<View>) {
    let upright = [[96, 64], [64, 96]].map(|size| views(cameras.len(), size));
    let named: Vec<View> = (0..cameras.len())
        .map(|k| View {
            name: format!("{name}-{k}"),
            ..upright[k % 2][k].clone()
        })
        .collect();
    calibrated(folder, &named);
    let mut settings = String::new();
    for (k, (camera, view)) in cameras.iter().zip(&named).enumerate() {
        settings += &format!(
            "[[camera]]\nname = {:?}\ninput = {:?}\nrotate = {}\n",
            view.name,
            camera.input(),
            90 * (k % 2)
        );
    }
    settings += &format!(
        "[network]\nsize = \"64x64\"\nthreads = 1\n[multiview]\ncalibration = \"Calib.toml\"\nroom = {name:?}\n"
    );
    let file = folder.join("edgecap.toml");
    std::fs::write(&file, settings).unwrap();
    (file.display().to_string(), named)
}

#[test]
fn a_camera_of_a_room_that_cannot_start_at_first_is_tried_again() {
    let folder = tempfile::tempdir().unwrap();
    let name = stream("again");
    let cameras = [StandIn::new(15.0), StandIn::new(15.0)];
    let (file, named) = settings(folder.path(), &name, &cameras);
    let taken = Publisher::<ObservationFrame>::open(&named[1].name).unwrap();
    let second = Subscriber::<ObservationFrame>::open(&named[1].name).unwrap();
    let mut run = Running::start(&["run", "--config", &file]);
    let line = run.says("the others go on");
    assert!(line.contains(&named[1].name), "{line}");
    drop(taken);
    eventually("the second camera", || {
        second.next(Duration::from_millis(200)).unwrap()
    });
    drop(second);
    stopped(run);
}

/// A settings file for cameras of these names that have nothing to do with each other.
fn apart(folder: &Path, names: &[String], cameras: &[StandIn]) -> String {
    let mut settings = "[network]\nsize = \"64x64\"\nthreads = 1\n".to_owned();
    for (name, camera) in names.iter().zip(cameras) {
        let input = camera.input();
        settings += &format!("[[camera]]\nname = {name:?}\ninput = {input:?}\n");
    }
    let file = folder.join("edgecap.toml");
    std::fs::write(&file, settings).unwrap();
    file.display().to_string()
}

/// Two cameras that have nothing to do with each other; something of the second one is another's.
struct Apart<T> {
    _folder: tempfile::TempDir,
    _cameras: [StandIn; 2],
    names: [String; 2],
    taken: T,
    run: Running,
}

impl<T> Apart<T> {
    /// Runs them until the second has failed of what `take` takes of its name.
    fn start(tag: &str, take: impl Fn(&str) -> T) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let cameras = [StandIn::new(15.0), StandIn::new(15.0)];
        let names = [0, 1].map(|k| stream(&format!("{tag}{k}")));
        let file = apart(folder.path(), &names, &cameras);
        let taken = take(&names[1]);
        let mut run = Running::start(&["run", "--config", &file]);
        let line = run.says("the others go on");
        assert!(line.contains(&names[1]), "{line}");
        Self {
            _folder: folder,
            _cameras: cameras,
            names,
            taken,
            run,
        }
    }
}

/// Waits for bodies of a camera.
fn has_bodies(name: &str) {
    let bodies = Subscriber::<BodyFrame>::open(name).unwrap();
    eventually("bodies of a camera", || {
        bodies.next(Duration::from_millis(200)).unwrap()
    });
}

/// Takes a camera's stream of observations.
fn observations(name: &str) -> Publisher<ObservationFrame> {
    Publisher::open(name).unwrap()
}

#[test]
fn one_of_several_cameras_that_cannot_start_at_first_is_tried_again() {
    let two = Apart::start("apart-again", observations);
    drop(two.taken);
    has_bodies(&two.names[1]);
    stopped(two.run);
}

#[test]
fn a_stop_while_one_of_several_cameras_is_tried_again_is_no_failure() {
    let two = Apart::start("apart-stop", observations);
    has_bodies(&two.names[0]);
    stopped(two.run);
}

#[test]
fn a_camera_that_is_tried_again_says_once_what_it_publishes() {
    // Its process for bodies publishes events, too, and cannot.
    let events = |name: &str| Publisher::<EventFrame>::open(name).unwrap();
    let two = Apart::start("apart-once", events);
    drop(two.taken);
    has_bodies(&two.names[1]);
    let said = stopped(two.run);
    let again = |line: &&str| line.contains("→ shared memory") && line.contains(&two.names[1]);
    assert_eq!(said.lines().find(again), None, "{said}");
}

#[test]
fn a_run_of_calibrated_cameras_has_one_fit_for_all() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = [
        StandIn::new(15.0),
        StandIn::new(15.0),
        StandIn::absent(15.0),
    ];
    let name = stream("room");
    let (file, named) = settings(folder.path(), &name, &cameras);
    let file = file.as_str();
    let checked = crate::program::output(&["config", "check", "--config", file]);
    assert!(checked.status.success(), "{}", stderr(&checked));
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    let args = [
        "run",
        "--config",
        file,
        "--view",
        "127.0.0.1:0",
        "--show-picture",
    ];
    let mut run = Running::start(&args);
    // One camera is not there yet: the others do not wait for it.
    let mut seen = 0;
    eventually("bodies of the room", || {
        let frame = bodies.next(Duration::from_millis(200)).unwrap()?;
        assert_eq!(frame.width, 0, "of several pictures");
        seen += 1;
        (seen > 5).then_some(())
    });
    assert_eq!(verbs(&name), ["fit", "infer", "infer", "infer"]);
    // Beside the room's bodies the page shows what its first camera sees.
    let line = run.says("the page: http://");
    let (_, url) = line.trim_end().split_once("http://").unwrap();
    let host = url.trim_end_matches('/');
    let socket = TcpStream::connect(host).unwrap();
    socket
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    let of_room = format!("ws://{host}/pictures?camera={name}");
    let (mut client, _) = tungstenite::client(of_room, socket).unwrap();
    let picture = client.read().unwrap().into_data();
    assert_eq!(&picture[..4], b"PICT");
    assert_eq!(picture[36..36 + name.len()], *name.as_bytes());
    drop(client);
    cameras[2].plug_in();
    let third = Subscriber::<ObservationFrame>::open(&named[2].name).unwrap();
    eventually("the third camera", || {
        third.next(Duration::from_millis(200)).unwrap()
    });
    stopped(run);
    assert_eq!(verbs(&name), Vec::<String>::new(), "nothing is left");
}
