//! Pictures are shown to whoever asks for them with `--show-picture` at both ends, and to nobody else.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use edgecap::message::{BodyFrame, FLAG_END_OF_STREAM, PictureFrame};
use edgecap_client::{Publisher, Subscriber};
use image::codecs::jpeg::JpegEncoder;
use tungstenite::WebSocket;

use crate::program::browser::Browser;
use crate::program::stand_in::{StandIn, Watched};
use crate::program::{Running, eventually, signal, stderr, stream};

/// A page of a camera, and its host and port.
fn view(camera: &str, more: &[&str]) -> (Running, String) {
    let mut args = vec!["view", "--camera", camera, "--listen", "127.0.0.1:0"];
    args.extend(more);
    let mut run = Running::start(&args);
    let mut said = String::new();
    BufReader::new(run.0.stdout.as_mut().unwrap())
        .read_line(&mut said)
        .unwrap();
    let host = said["http://".len()..].split('/').next().unwrap();
    (run, host.to_owned())
}

fn get(host: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(host).unwrap();
    let patience = Some(Duration::from_secs(60));
    stream.set_read_timeout(patience).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

/// What a page sends of pictures.
fn page_of_pictures(host: &str) -> WebSocket<TcpStream> {
    let socket = TcpStream::connect(host).unwrap();
    let wait = Some(Duration::from_secs(60));
    socket.set_read_timeout(wait).unwrap();
    let client = tungstenite::client(format!("ws://{host}/pictures"), socket);
    client.unwrap().0
}

/// Bytes before the JPEG of a picture that a page sends.
fn head(camera: &str) -> usize {
    36 + camera.len().next_multiple_of(4)
}

#[test]
fn pictures_go_where_both_ends_ask_for_them_and_nowhere_else() {
    let camera = StandIn::new(10.0);
    let run = Watched::start("show-picture", &camera, &["--show-picture"]);
    let pictures = run.listen::<PictureFrame>();
    let first = eventually("a picture", || {
        let picture = pictures.next(Duration::from_millis(200)).unwrap()?;
        (picture.count > 0).then(|| Box::new(*picture))
    });
    let read = image::load_from_memory(first.jpeg()).unwrap();
    assert_eq!((read.width(), read.height()), (first.width, first.height));
    assert!(first.width <= 480 && first.height <= 360);

    let (_with, host) = view(&run.name, &["--show-picture"]);
    assert!(get(&host, "/features").contains("\"pictures\":true"));
    let bytes = page_of_pictures(&host).read().unwrap().into_data();
    assert_eq!(&bytes[..4], b"PICT");
    let read = image::load_from_memory(&bytes[head(&run.name)..]).unwrap();
    assert_eq!(read.width(), first.width);

    // Pictures are there to be had, but this page was not asked to show them.
    let (_without, host) = view(&run.name, &[]);
    assert!(get(&host, "/features").contains("\"pictures\":false"));
    let refused = get(&host, "/pictures");
    assert!(refused.starts_with("HTTP/1.1 404"), "{refused}");
    assert!(refused.contains("--show-picture"), "{refused}");

    drop(pictures);
    let out = run.stop();
    assert!(out.status.success(), "{}", stderr(&out));
    let said = stderr(&out);
    assert!(said.contains("--show-picture: pictures of"), "{said}");
}

#[test]
fn a_picture_goes_with_its_camera_and_its_run() {
    let camera = StandIn::new(10.0);
    let start = || Watched::start("picture-goes", &camera, &["--show-picture", "--no-idle"]);
    let run = start();
    let (_view, host) = view(&run.name, &["--show-picture"]);
    let (mut page, head) = (page_of_pictures(&host), head(&run.name));
    let mut is_shown = |wanted: bool| {
        eventually("a picture on the page, or none", || {
            let message = page.read().unwrap();
            (message.is_binary() && (message.len() > head) == wanted).then_some(())
        });
    };
    let stream = run.listen::<PictureFrame>();
    let is_published = |wanted: bool| {
        eventually("a picture in the stream, or none", || {
            let picture = stream.next(Duration::from_millis(100)).unwrap()?;
            ((picture.count > 0) == wanted).then_some(())
        });
    };
    is_published(true);
    is_shown(true);
    camera.unplug();
    is_published(false);
    is_shown(false);
    camera.plug_in();
    is_published(true);
    is_shown(true);
    assert!(run.stop().status.success());
    is_published(false);
    is_shown(false);
    // A killed one says nothing.
    let run = start();
    is_shown(true);
    signal(run.run.pid(), "KILL");
    is_shown(false);
}

#[test]
fn a_run_without_the_flag_has_no_pictures_and_its_viewer_is_told() {
    let camera = StandIn::new(10.0);
    let run = Watched::start("no-picture", &camera, &[]);
    let bodies = run.listen::<BodyFrame>();
    eventually("bodies", || {
        bodies.next(Duration::from_millis(200)).unwrap()
    });
    let pictures = Subscriber::<PictureFrame>::open(&run.name).unwrap();
    let (mut viewer, host) = view(&run.name, &["--show-picture"]);
    let lines = BufReader::new(viewer.0.stderr.take().unwrap()).lines();
    let said: Vec<String> = lines.map(Result::unwrap).take(2).collect();
    assert!(said[0].contains(&format!("the page at {host}")), "{said:?}");
    assert!(
        said[1].contains("publishes no pictures: 'edgecap run --show-picture'"),
        "{said:?}"
    );
    assert_eq!(pictures.publisher_count(), 0);
    assert!(
        pictures
            .newest(Duration::from_millis(300))
            .unwrap()
            .is_none()
    );
}

/// Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_shows_the_picture_only_where_it_was_asked_for() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        return;
    };
    let camera = stream("browser-picture");
    let mut bodies = Publisher::<BodyFrame>::open(&camera).unwrap();
    let mut pictures = Publisher::<PictureFrame>::open(&camera).unwrap();
    let colour = [200, 90, 30];
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, 90)
        .encode(
            &colour.repeat(64 * 48),
            64,
            48,
            image::ExtendedColorType::Rgb8,
        )
        .unwrap();
    let mut picture = PictureFrame {
        sequence: 41,
        width: 64,
        height: 48,
        count: jpeg.len() as u32,
        ..PictureFrame::default()
    };
    picture.jpeg[..jpeg.len()].copy_from_slice(&jpeg);
    let mut publish = |flags: u32| {
        let frame = BodyFrame {
            flags,
            ..BodyFrame::default()
        };
        bodies.publish(&frame).unwrap();
        pictures.publish(&picture).unwrap();
        std::thread::sleep(Duration::from_millis(50));
    };
    let mut seen_on = |browser: &mut Browser, flags: u32| {
        (0..100).find_map(|_| {
            publish(flags);
            Some(browser.value("edgecap.picture()")).filter(|p| !p.is_null())
        })
    };
    for (flags, is_shown) in [(&["--show-picture"][..], true), (&[], false)] {
        let (view, host) = view(&camera, flags);
        browser.open(&format!("http://{host}/"));
        browser.until("window.edgecap");
        let seen = seen_on(&mut browser, 0);
        assert_eq!(seen.is_some(), is_shown, "{flags:?}: {seen:?}");
        let Some(seen) = seen else { continue };
        assert_eq!(
            (&seen["width"], &seen["sequence"]),
            (&64.into(), &41.into())
        );
        for (n, wanted) in colour.iter().enumerate() {
            let found = seen["colour"][n].as_f64().unwrap();
            assert!((found - f64::from(*wanted)).abs() < 6.0, "{seen}");
        }
        // Whoever was seen last does not stay on the page, neither when the camera's run has ended, …
        eventually("no picture", || {
            seen_on(&mut browser, FLAG_END_OF_STREAM)
                .is_none()
                .then_some(())
        });
        assert!(seen_on(&mut browser, 0).is_some(), "it is back");
        // … nor when the server has.
        drop(view);
        browser.until("edgecap.picture() === null");
    }
}
