//! Films that end early, or hold pictures that cannot be decoded: what comes out of them, and what is told.

use std::path::Path;
use std::process::Command;

use edgecap::capture::{Ffmpeg, FfmpegSource, Source};

use super::{PICTURE, made, stand_ins};
use crate::tools;

/// Overwrites what is stored of the picture of a film that is shown in this place, but for the first bytes.
fn damage(film: &Path, place: usize, kept: usize) {
    let packets = Command::new("ffprobe")
        .args(["-v", "error", "-select_streams", "V:0"])
        .args([
            "-show_entries",
            "packet=pts_time,size,pos",
            "-of",
            "csv=p=0",
        ])
        .arg(film)
        .output()
        .unwrap();
    let mut packets: Vec<Vec<f64>> = String::from_utf8_lossy(&packets.stdout)
        .lines()
        .map(|line| line.split(',').map(|n| n.parse().unwrap()).collect())
        .collect();
    packets.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let (size, at) = (packets[place][1] as usize, packets[place][2] as usize);
    let mut bytes = std::fs::read(film).unwrap();
    bytes[at + kept..at + size].fill(0);
    std::fs::write(film, bytes).unwrap();
}

#[test]
fn pictures_after_one_that_cannot_be_decoded_keep_their_times() {
    if !tools::has("ffmpeg") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let source = "testsrc2=size=96x64:rate=12:duration=2";
    // One stored behind those that are shown after it, to which no other refers; and one behind its block's head.
    let reordered = ["-c:v", "libx264", "-bf", "2", "-b_strategy", "0"];
    for (name, options, kept) in [
        ("film.mp4", &reordered[..], 0),
        ("film.mkv", &["-c:v", "mjpeg"], 12),
    ] {
        let film = folder.path().join(name);
        made(&film, source, options);
        let play = || {
            let mut source = FfmpegSource::open(&film, &Ffmpeg::default()).unwrap();
            let mut frames = Vec::new();
            let end = loop {
                match source.next() {
                    Ok(Some(frame)) => frames.push((frame.sequence, frame.time_ns)),
                    Ok(None) => break None,
                    Err(e) => break Some(e),
                }
            };
            assert!(source.next().unwrap().is_none(), "{name}");
            (frames, end)
        };
        let (mut whole, end) = play();
        assert!(end.is_none() && whole.len() == 24, "{name}: {end:?}");
        damage(&film, 7, kept);
        whole.remove(7);
        let (frames, end) = play();
        assert_eq!(frames, whole, "{name}");
        let end = end.unwrap();
        let told = end.to_string();
        assert!(
            end.is_skippable() && told.contains("1 picture of 24 could not be decoded"),
            "{told}"
        );
    }
}

#[test]
fn a_film_that_ends_early_after_a_picture_that_could_not_be_decoded_tells_both() {
    let folder = tempfile::tempdir().unwrap();
    let shown = |us: u32| format!("printf 'frame:0    pts:{us}\\nedgecap=1\\n' >&0; {PICTURE}; ");
    let programs = stand_ins(
        folder.path(),
        &format!("{}{}echo damaged >&2", shown(0), shown(1_000_000)),
        "printf 'packet,0.0\\npacket,0.5\\npacket,1.0\\npacket,1.5\\nstream,2/1,4\\n'",
    );
    let mut source = FfmpegSource::open(Path::new("film.mp4"), &programs).unwrap();
    for place in [0, 2] {
        let frame = source.next().unwrap().unwrap();
        assert_eq!(
            (frame.sequence, frame.time_ns),
            (place, place * 500_000_000)
        );
    }
    let error = source.next().unwrap_err();
    let words =
        "after 3 pictures of 4, 1 before its end could not be decoded; ffmpeg says: damaged";
    assert!(
        !error.is_skippable() && error.to_string().contains(words),
        "{error}"
    );
}

#[test]
fn a_film_that_ends_early_is_told_with_the_childs_own_words() {
    let folder = tempfile::tempdir().unwrap();
    let probe = "printf 'packet,0.0\\nstream,2/1,9\\n'";
    for body in [
        format!("{PICTURE}; echo 'partial file' >&2"),
        format!("{PICTURE}; echo 'partial file' >&2; exit 1"),
        format!("{PICTURE}; printf 'P6\\n2 1\\n255\\nab'; echo 'partial file' >&2"),
    ] {
        let programs = stand_ins(folder.path(), &body, probe);
        let mut source = FfmpegSource::open(Path::new("film.mp4"), &programs).unwrap();
        assert!(source.next().unwrap().is_some());
        let error = source.next().unwrap_err();
        assert_eq!(error.exit_code(), 65);
        let text = error.to_string();
        assert!(
            text.contains("film.mp4")
                && text.contains("partial file")
                && text.contains("1 picture of 9"),
            "{text}"
        );
        assert!(source.next().unwrap().is_none());
    }
}

/// Matroska, WebM and transport streams have no number of pictures in their header.
#[test]
fn a_film_of_unknown_length_that_was_cut_off_or_is_damaged_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let timed = "packet,0.0,0.0,K__\\npacket,0.5,0.5,___\\n";
    let cut = "[matroska,webm @ 0x5] File ended prematurely at pos. 4711 (0x1267)";
    for (packets, pictures, complaint, words) in [
        // ffprobe lists what is left of the file, all of which comes out.
        (timed, 2, cut, Some("after 2 pictures; ffmpeg says: [matro")),
        ("", 2, cut, Some("ended prematurely")),
        (
            timed,
            1,
            "error while decoding MB 3 4",
            Some("1 picture of 2; ffmpeg says: error"),
        ),
        (timed, 2, "mmco: unref short failure", None),
        ("", 2, "error while decoding MB 3 4", None),
        (timed, 1, "", None),
    ] {
        let programs = stand_ins(
            folder.path(),
            &format!(
                "{}echo '{complaint}' >&2",
                format!("{PICTURE}; ").repeat(pictures)
            ),
            &format!("printf '{packets}stream,2/1,N/A\\n'"),
        );
        let mut source = FfmpegSource::open(Path::new("film.mkv"), &programs).unwrap();
        for _ in 0..pictures {
            assert!(source.next().unwrap().is_some());
        }
        match (source.next(), words) {
            (Ok(None), None) => {}
            (Err(error), Some(words)) => {
                assert_eq!(error.exit_code(), 65);
                assert!(error.to_string().contains(words), "{error}");
            }
            (ended, _) => panic!("{packets} {pictures} {complaint}: {ended:?}"),
        }
        assert!(source.next().unwrap().is_none());
    }
}
