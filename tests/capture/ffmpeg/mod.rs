//! Whatever ffmpeg can read: by stand-ins for it, and by the real one where it is installed.

mod child;
mod damage;
mod times;

use std::path::Path;
use std::process::Command;

use edgecap::camera::SystemClock;
use edgecap::capture::{CaptureError, Ffmpeg, FfmpegSource, Frame, PacedSource, Source};
use edgecap::capture::{InputSpec, OpenOptions, open};

use crate::said::said;
use crate::script::script;
use crate::tools;

/// A folder with stand-ins for the two programs.
fn stand_ins(folder: &Path, ffmpeg: &str, ffprobe: &str) -> Ffmpeg {
    let write = |name: &str, body: &str| {
        let path = folder.join(name);
        script(&path, &format!("#!/bin/sh\n{body}\n"));
        path
    };
    Ffmpeg {
        ffmpeg: write(
            "ffmpeg",
            &format!(
                "if [ \"$1\" = -version ]; then echo 'ffmpeg version 5.1.9-0 x'; exit; fi\n{ffmpeg}"
            ),
        ),
        ffprobe: write("ffprobe", ffprobe),
    }
}

/// Prints a picture of two pixels, as ffmpeg does.
const PICTURE: &str = "printf 'P6\\n2 1\\n255\\nabcdef'";

/// A film that ffmpeg makes of a test picture.
fn made(film: &Path, source: &str, options: &[&str]) {
    let status = Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-f", "lavfi", "-i", source])
        .args(options)
        .arg(film)
        .status()
        .unwrap();
    assert!(status.success(), "{}", film.display());
}

#[test]
fn pictures_come_out_of_the_child() {
    let folder = tempfile::tempdir().unwrap();
    let programs = stand_ins(
        folder.path(),
        &format!("{PICTURE}; {PICTURE}"),
        "printf 'packet,1.5\\npacket,1.0\\nstream,2/1,2\\n'",
    );
    let mut source = FfmpegSource::open(Path::new("film.mp4"), &programs).unwrap();
    assert_eq!((source.frame_count(), source.fps()), (Some(2), Some(2.0)));
    for k in 0..2 {
        let frame = source.next().unwrap().unwrap();
        assert_eq!(
            (frame.width, frame.height, &frame.rgb[..]),
            (2, 1, &b"abcdef"[..])
        );
        assert_eq!((frame.sequence, frame.time_ns), (k, k * 500_000_000));
    }
    assert!(source.next().unwrap().is_none() && source.next().unwrap().is_none());
}

/// Listing all packets of a long film takes minutes, and nothing of it changes while the film plays over and over.
#[test]
fn a_film_that_plays_over_and_over_is_probed_once_until_it_is_another() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let probes = || {
        std::fs::read_to_string(at("probes"))
            .unwrap()
            .lines()
            .count()
    };
    let programs = stand_ins(
        folder.path(),
        &format!("{PICTURE}; {PICTURE}"),
        &format!(
            "echo probed >> '{}'; printf 'packet,0.00\\npacket,0.01\\nstream,100/1,2\\n'",
            at("probes").display()
        ),
    );
    let film = at("film.mp4");
    std::fs::write(&film, "film").unwrap();
    let open = {
        let film = film.clone();
        move || -> Result<Box<dyn Source>, CaptureError> {
            Ok(Box::new(FfmpegSource::open(&film, &programs)?))
        }
    };
    let mut source = PacedSource::new(open, SystemClock).unwrap();
    let mut frame = Frame::default();
    let mut play_until = |sequence: u64| {
        while frame.sequence < sequence {
            match source.next_into(&mut frame) {
                Ok(more) => assert!(more, "it has no end"),
                Err(e) => assert!(e.is_skippable(), "{e}"),
            }
        }
        frame.sequence
    };
    let played = play_until(10);
    assert_eq!(probes(), 1);
    std::fs::write(at("other.mp4"), "another film").unwrap();
    std::fs::rename(at("other.mp4"), &film).unwrap();
    play_until(played + 10);
    assert_eq!(probes(), 2);
}

#[test]
fn what_ffmpeg_says_of_a_film_that_plays_over_and_over_is_told_once() {
    let folder = tempfile::tempdir().unwrap();
    // Each time with other words: a place in memory is among them.
    let programs = stand_ins(
        folder.path(),
        &format!("{PICTURE}; echo \"[h264 @ $$] mmco: unref short failure\" >&2"),
        "printf 'packet,0.0,0.0,K__\\nstream,2/1,N/A\\n'",
    );
    let film = folder.path().join("film.ts");
    std::fs::write(&film, "film").unwrap();
    let text = said(|| {
        let mut source = FfmpegSource::open(&film, &programs).unwrap();
        for _ in 0..3 {
            assert!(source.next().unwrap().is_some());
            assert!(source.next().unwrap().is_none());
            assert!(source.rewind().unwrap());
        }
    });
    assert_eq!(text.matches("ffmpeg says").count(), 1, "{text}");
}

/// Camcorders put picture and sound into one stream of an AVI file, of a kind of its own.
#[test]
fn avi_files_of_camcorders_are_given_to_ffmpeg() {
    if !tools::has("ffmpeg") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let digital_video = folder.path().join("film.dv");
    let source = "testsrc=size=720x576:rate=25:duration=0.2";
    made(&digital_video, source, &["-pix_fmt", "yuv420p"]);
    let chunk = |code: &[u8; 4], body: &[u8]| {
        let length = (body.len() as u32).to_le_bytes();
        [code, &length[..], body].concat()
    };
    let list = |kind: &[u8; 4], chunks: &[Vec<u8>]| {
        chunk(b"LIST", &[&kind[..], &chunks.concat()].concat())
    };
    let words = |words: &[u32]| {
        words
            .iter()
            .flat_map(|w| w.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let main = words(&[40_000, 0, 0, 0, 5, 0, 1, 0, 720, 576, 0, 0, 0, 0]);
    // Rate after scale; how many pictures.
    let stream = words(&[0, 0, 0, 1, 25, 0, 5, 0, 0, 0, 0, 0]);
    let stream = [b"iavsdvsd", &stream[..]].concat();
    let headers = [chunk(b"strh", &stream), chunk(b"strf", &[0; 32])];
    let headers = [chunk(b"avih", &main), list(b"strl", &headers)];
    let pictures = std::fs::read(&digital_video).unwrap();
    let pictures: Vec<Vec<u8>> = pictures
        .chunks(144_000)
        .map(|p| chunk(b"00__", p))
        .collect();
    let film = [list(b"hdrl", &headers), list(b"movi", &pictures)];
    let avi = folder.path().join("film.avi");
    let open = |content: &[Vec<u8>]| {
        let content = [&b"AVI "[..], &content.concat()].concat();
        std::fs::write(&avi, chunk(b"RIFF", &content)).unwrap();
        open(&InputSpec::Path(avi.clone()), &OpenOptions::default())
    };
    let mut source = open(&film).unwrap();
    let frame = source.next().unwrap().unwrap();
    assert_eq!(frame.height, 576);
    let error = open(&film[..1]).err().unwrap();
    assert_eq!(error.exit_code(), 65);
    assert!(error.to_string().contains("no pictures"), "{error}");
}

#[test]
fn pixels_that_are_not_square_are_made_so() {
    if !tools::has("ffmpeg") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (shape, size) in [("4/3", (128, 64)), ("1/2", (96, 128)), ("1", (96, 64))] {
        let film = folder.path().join("film.mkv");
        let filter = format!("setsar={shape}");
        let source = "testsrc=size=96x64:rate=5:duration=1";
        made(&film, source, &["-vf", &filter, "-c:v", "mpeg4"]);
        let mut source = FfmpegSource::open(&film, &Ffmpeg::default()).unwrap();
        let frame = source.next().unwrap().unwrap();
        assert_eq!((frame.width, frame.height), size, "{shape}");
        assert_eq!(source.frame_count(), Some(5));
    }
}

#[test]
fn without_ffmpeg_the_remedy_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let absent = Ffmpeg {
        ffmpeg: folder.path().join("ffmpeg"),
        ffprobe: folder.path().join("ffprobe"),
    };
    let error = FfmpegSource::open(Path::new("film.mp4"), &absent)
        .err()
        .unwrap();
    assert!(matches!(error, CaptureError::Unavailable { .. }));
    assert!(error.to_string().contains("apt install ffmpeg"), "{error}");
    assert_eq!(error.exit_code(), 69);
}

#[test]
fn a_file_that_is_no_film_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let programs = stand_ins(
        folder.path(),
        "exit 1",
        "echo 'moov atom not found' >&2; exit 1",
    );
    let error = FfmpegSource::open(Path::new("film.mp4"), &programs)
        .err()
        .unwrap();
    assert_eq!(error.exit_code(), 65);
    assert!(error.to_string().contains("moov atom not found"), "{error}");
}
