//! When each picture of a film was taken.

use std::path::Path;

use edgecap::capture::{Ffmpeg, FfmpegSource, InputSpec, OpenOptions, Source, open};

use super::{PICTURE, made, stand_ins};
use crate::tools;

/// Times of a film's pictures, milliseconds.
fn times_ms(source: &mut dyn Source) -> Vec<u64> {
    let mut times = Vec::new();
    while let Some(frame) = source.next().unwrap() {
        times.push(frame.time_ns / 1_000_000);
    }
    times
}

/// An edit list leaves the first pictures out: ffprobe has their packets, and ffmpeg does not give them.
#[test]
fn pictures_that_an_edit_list_leaves_out_are_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let packets = "packet,-1.0,KD_\\npacket,-0.5,_D_\\npacket,0.0,___\\npacket,2.0,___\\n";
    let programs = stand_ins(
        folder.path(),
        &format!("{PICTURE}; {PICTURE}; echo 'a word of warning' >&2"),
        &format!("printf '{packets}stream,2/1,4\\n'"),
    );
    let mut source = FfmpegSource::open(Path::new("film.mp4"), &programs).unwrap();
    assert_eq!(source.frame_count(), Some(2));
    for time_ns in [0, 2_000_000_000] {
        assert_eq!(source.next().unwrap().unwrap().time_ns, time_ns);
    }
    assert!(source.next().unwrap().is_none());
}

#[test]
fn a_film_that_tells_no_rate_keeps_its_times() {
    if !tools::has("ffmpeg") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let film = folder.path().join("film.ogv");
    let source = "testsrc2=size=96x64:rate=60:duration=2";
    made(&film, source, &["-c:v", "libtheora"]);
    let mut source = FfmpegSource::open(&film, &Ffmpeg::default()).unwrap();
    assert!((source.fps().unwrap() - 60.0).abs() < 0.5);
    let last = times_ms(&mut source).pop().unwrap();
    assert!((1900..=2000).contains(&last), "{last}");
}

#[test]
fn hidden_pictures_of_vp8_move_no_time() {
    if !tools::has("ffmpeg") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let film = folder.path().join("film.webm");
    let log = folder.path().join("log");
    let source = "testsrc=size=160x120:rate=25:duration=2";
    for pass in ["1", "2"] {
        // Hidden pictures are made where the encoder has looked at the whole film before.
        let log = log.to_str().unwrap();
        let mut options = vec!["-c:v", "libvpx", "-auto-alt-ref", "1"];
        options.extend(["-lag-in-frames", "16", "-pass", pass, "-passlogfile", log]);
        made(&film, source, &options);
    }
    let mut source = FfmpegSource::open(&film, &Ffmpeg::default()).unwrap();
    assert_eq!(source.frame_count(), Some(50));
    let expected: Vec<u64> = (0..50).map(|k| 40 * k).collect();
    assert_eq!(times_ms(&mut source), expected);
}

#[test]
fn a_stream_without_a_container_is_of_the_rate_that_the_user_says() {
    if !tools::has("ffmpeg") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let film = folder.path().join("film.h264");
    let source = "testsrc=size=96x64:rate=10:duration=1";
    made(&film, source, &["-c:v", "libx264"]);
    for (fps, step) in [(None, 100), (Some(50.0), 20)] {
        let options = OpenOptions {
            fps,
            ..OpenOptions::default()
        };
        let mut source = open(&InputSpec::Path(film.clone()), &options).unwrap();
        let expected: Vec<u64> = (0..10).map(|k| step * k).collect();
        assert_eq!(times_ms(&mut *source), expected, "{fps:?}");
    }
}
