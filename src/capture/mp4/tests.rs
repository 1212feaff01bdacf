//! H.264 without ffmpeg. A real film comes from the folder in `EDGECAP_DATA`.

mod damaged;
#[path = "../../../tests/program/tools.rs"]
mod tools;

use std::path::{Path, PathBuf};
use std::process::Command;

use proptest::prelude::*;

use super::film::is_cut;
use crate::capture::{
    Ffmpeg, FfmpegSource, Frame, InputSpec, Mp4Source, OpenOptions, Source, open,
};

/// The film of the outside data, or a printed line.
fn film() -> Option<PathBuf> {
    let Some(data) = std::env::var_os("EDGECAP_DATA") else {
        println!("skipped: EDGECAP_DATA is not set");
        return None;
    };
    Some(PathBuf::from(data).join("multiview/single/videos/cam01.mp4"))
}

#[test]
fn pictures_are_those_that_ffmpeg_shows() {
    let Some(path) = film() else { return };
    let mut ours = Mp4Source::open(&path).unwrap().unwrap();
    let mut theirs = match FfmpegSource::open(&path, &Ffmpeg::default()) {
        Ok(source) => source,
        Err(e) => {
            tools::skip("ffmpeg", &e.to_string());
            return;
        }
    };
    assert_eq!(ours.frame_count(), theirs.frame_count());
    let (mut a, mut b) = (Frame::default(), Frame::default());
    for k in 0..12 {
        assert!(ours.next_into(&mut a).unwrap() && theirs.next_into(&mut b).unwrap());
        assert_eq!((a.width, a.height, a.sequence), (b.width, b.height, k));
        assert!(
            a.time_ns.abs_diff(b.time_ns) < 2_000_000,
            "{} {}",
            a.time_ns,
            b.time_ns
        );
        // The two turn colours into RGB in slightly different ways.
        let sum: u64 = a
            .rgb
            .iter()
            .zip(&b.rgb)
            .map(|(a, b)| u64::from(a.abs_diff(*b)))
            .sum();
        let mean = sum as f64 / a.rgb.len() as f64;
        assert!(mean < 6.0, "picture {k} differs by {mean}");
    }
}

#[test]
fn a_film_cut_off_is_refused_or_ends_with_an_error() {
    let Some(path) = film() else { return };
    let whole = std::fs::read(path).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cut = folder.path().join("cut.mp4");
    for percent in [1, 50, 99] {
        std::fs::write(&cut, &whole[..whole.len() * percent / 100]).unwrap();
        let error = match Mp4Source::open(&cut) {
            Err(e) => e,
            Ok(None) => panic!("expected H.264"),
            Ok(Some(mut source)) => loop {
                match source.next() {
                    Ok(Some(_)) => {}
                    Ok(None) => panic!("expected an error at {percent} %"),
                    Err(e) if e.is_skippable() => {}
                    Err(e) => break e,
                }
            },
        };
        assert_eq!(error.exit_code(), 65);
        assert!(error.to_string().contains("cut.mp4"), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn random_boxes_are_refused(tail in prop::collection::vec(any::<u8>(), 0..200)) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.mp4");
        let mut bytes = b"\0\0\0\x10ftypisom\0\0\0\0\0\0\0\x60moov".to_vec();
        bytes.extend_from_slice(&tail);
        std::fs::write(&path, bytes).unwrap();
        let error = Mp4Source::open(&path).err().unwrap();
        prop_assert_eq!(error.exit_code(), 65);
    }
}

/// Two pictures of 32×16 pixels.
const TINY: &[u8] = include_bytes!("../../../fuzz/seeds/tiny.mp4");

fn opened(bytes: &[u8]) -> Result<Mp4Source, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiny.mp4");
    std::fs::write(&path, bytes).unwrap();
    match Mp4Source::open(&path) {
        Ok(film) => Ok(film.expect("H.264")),
        Err(e) => {
            assert_eq!(e.exit_code(), 65);
            Err(e.to_string())
        }
    }
}

fn place_of(name: &[u8; 4]) -> usize {
    TINY.windows(4).position(|w| w == name).unwrap()
}

#[test]
fn a_box_without_a_size_does_not_hang_and_billions_of_samples_need_no_memory() {
    let mut film = opened(TINY).unwrap();
    let mut pictures = 0;
    while film.next().unwrap().is_some() {
        pictures += 1;
    }
    assert!(pictures > 0 && film.frame_count() == Some(pictures));
    for name in [b"edts", b"tkhd", b"mdhd", b"vmhd", b"stss"] {
        let mut damaged = TINY.to_vec();
        damaged[place_of(name) - 4..][..8].copy_from_slice(b"\0\0\0\0what");
        let said = opened(&damaged).err().unwrap();
        assert!(said.contains("a size that cannot be"), "{said}");
    }
    let mut many = TINY.to_vec();
    many[place_of(b"stsz") + 8..][..8].copy_from_slice(&[0, 0, 0, 1, 255, 255, 255, 255]);
    let said = opened(&many).err().unwrap();
    assert!(said.contains("more samples than it can hold"), "{said}");
}

/// Number and time of every picture that can be seen.
fn shown(bytes: &[u8]) -> Vec<(u64, u64)> {
    let mut film = opened(bytes).unwrap();
    let (mut frame, mut all) = (Frame::default(), Vec::new());
    loop {
        match film.next_into(&mut frame) {
            Ok(true) => all.push((frame.sequence, frame.time_ns)),
            Ok(false) => return all,
            Err(e) => assert!(e.is_skippable(), "{e}"),
        }
    }
}

/// Where samples begin, and how long they are.
type Places = Vec<(usize, usize)>;

/// A film of 24 pictures, 24 a second, that are decoded in another order than shown, with these flags of ffmpeg's
/// muxer; `None` without an ffmpeg that makes such films.
fn made(folder: &Path, flags: &str) -> Option<Vec<u8>> {
    let path = folder.join("reordered.mp4");
    let made = Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-f", "lavfi", "-i"])
        .arg("testsrc=size=160x96:rate=24:duration=1")
        .args([
            "-c:v", "libx264", "-bf", "2", "-g", "6", "-pix_fmt", "yuv420p",
        ])
        .args(["-movflags", flags])
        .arg(&path)
        .status();
    if !made.is_ok_and(|made| made.success()) {
        tools::skip("ffmpeg", "no ffmpeg with libx264");
        return None;
    }
    Some(std::fs::read(&path).unwrap())
}

/// Such a film, its tables before its pictures, and where its samples lie.
fn reordered(folder: &Path) -> Option<(Vec<u8>, Places)> {
    let film = made(folder, "faststart")?;
    let place = |name: &[u8; 4]| film.windows(4).position(|w| w == name).unwrap();
    assert!(
        film.windows(4).any(|w| w == b"ctts"),
        "pictures are reordered"
    );
    let word = |at: usize| u32::from_be_bytes(film[at..at + 4].try_into().unwrap()) as usize;
    let (sizes, mut at) = (place(b"stsz") + 12, word(place(b"stco") + 12));
    let all = (1..=word(sizes)).map(|k| {
        let (start, size) = (at, word(sizes + 4 * k));
        at += size;
        (start, size)
    });
    let all = all.collect();
    Some((film, all))
}

/// Numbers and times of 24 pictures a second.
fn even() -> Vec<(u64, u64)> {
    let time = |k: u64| (k * 1_000_000_000 + 12) / 24;
    (0..24).map(|k| (k, time(k))).collect()
}

/// What is shown before a film ends with an error, and that.
fn shown_until_cut(bytes: &[u8]) -> (Vec<(u64, u64)>, String) {
    let mut film = opened(bytes).unwrap();
    let (mut frame, mut all) = (Frame::default(), Vec::new());
    loop {
        match film.next_into(&mut frame) {
            Ok(true) => all.push((frame.sequence, frame.time_ns)),
            Ok(false) => panic!("expected an error after {all:?}"),
            Err(e) => {
                assert_eq!((e.is_skippable(), e.exit_code()), (false, 65));
                assert!(!film.next_into(&mut frame).unwrap());
                return (all, e.to_string());
            }
        }
    }
}

#[test]
fn pictures_of_fragments_have_their_times() {
    let folder = tempfile::tempdir().unwrap();
    // Composition offsets below 0; the first fragment in the film's own tables; an edit list that undoes the offsets.
    for flags in [
        "frag_keyframe+empty_moov",
        "frag_keyframe+empty_moov+negative_cts_offsets",
        "frag_keyframe",
        "frag_keyframe+empty_moov+delay_moov",
    ] {
        let Some(mut film) = made(folder.path(), flags) else {
            return;
        };
        assert_eq!(shown(&film), even(), "{flags}");
        // The last of the four fragments a second later; its decode time is one of 64 bits.
        let last = film.windows(4).rposition(|w| w == b"tfdt").unwrap() + 8;
        let time = u64::from_be_bytes(film[last..last + 8].try_into().unwrap());
        film[last..last + 8].copy_from_slice(&(time + 24 * 512).to_be_bytes());
        let mut late = even();
        late[18..]
            .iter_mut()
            .for_each(|moment| moment.1 += 1_000_000_000);
        assert_eq!(shown(&film), late, "{flags}");
    }
}

#[test]
fn what_a_cut_film_holds_is_shown_before_the_error() {
    let folder = tempfile::tempdir().unwrap();
    let Some((film, samples)) = reordered(folder.path()) else {
        return;
    };
    for count in [6, 10, 15] {
        let (seen, said) = shown_until_cut(&film[..samples[count].0 + 1]);
        assert_eq!(seen.len(), count);
        assert!(
            seen.iter().all(|moment| even().contains(moment)),
            "{seen:?}"
        );
        assert!(said.contains(&format!("inside picture {count};")), "{said}");
    }
    let Some(film) = made(folder.path(), "frag_keyframe+empty_moov") else {
        return;
    };
    let last = film.windows(4).rposition(|w| w == b"moof").unwrap();
    for more in [8, 60, 100] {
        let (seen, said) = shown_until_cut(&film[..last + more]);
        assert_eq!(seen, even()[..18], "{more}");
        assert!(said.contains("inside picture 18;"), "{said}");
    }
}

#[test]
fn times_begin_with_0_and_a_picture_left_out_does_not_move_the_others() {
    assert_eq!(shown(TINY)[0], (0, 0));
    let folder = tempfile::tempdir().unwrap();
    let Some((film, samples)) = reordered(folder.path()) else {
        return;
    };
    let whole = shown(&film);
    assert_eq!(whole, even());
    let mut alone = 0;
    for &(start, size) in &samples[1..] {
        let mut damaged = film.clone();
        // The unit's own bytes; its length stays.
        damaged[start + 4..start + size].fill(0xFF);
        let seen = shown(&damaged);
        for moment in &seen {
            assert!(whole.contains(moment), "{moment:?}");
        }
        // Of others many more hang on it.
        if seen.len() + 1 == whole.len() && start != samples[samples.len() - 1].0 {
            assert_eq!(seen.last(), whole.last(), "sample at {start}: {seen:?}");
            alone += 1;
        }
    }
    assert!(alone > 0, "no picture was left out alone");
}

#[test]
fn pixels_that_are_not_square_are_made_so() {
    let folder = tempfile::tempdir().unwrap();
    for (across, down, size) in [(1, 1, (32, 16)), (64, 45, (46, 16)), (3, 4, (32, 21))] {
        let mut film = TINY.to_vec();
        let shape = [across, down].map(u32::to_be_bytes).concat();
        film[place_of(b"pasp") + 4..][..8].copy_from_slice(&shape);
        let path = folder.path().join("film.mp4");
        std::fs::write(&path, film).unwrap();
        let mut film = open(&InputSpec::Path(path), &OpenOptions::default()).unwrap();
        let frame = film.next().unwrap().unwrap();
        assert_eq!((frame.width, frame.height), size, "{across}:{down}");
    }
}

/// A parameter set of the tiny film's pictures, as long as its own. `profile` and `format`: which one, and what follows
/// its number in those that say how colours are stored; `progressive` and `signal`: the bits there.
fn set(profile: u8, format: &str, progressive: &str, signal: &str) -> Vec<u8> {
    // The set's number; numbering of 4 bits, by the order of decoding; 3 references, no gaps; 32 × 16 pixels.
    let bits = [
        "1",
        format,
        "1",
        "011",
        "00100",
        "0",
        "010",
        "1",
        progressive,
        "1",
        "0",
        signal,
        "1",
    ];
    let bits = bits.concat();
    let bytes = bits.as_bytes().chunks(8);
    let byte = |bits: &[u8]| {
        let bits = bits.iter().chain([b'0'; 8].iter()).take(8);
        bits.fold(0, |n, bit| n << 1 | (bit - b'0'))
    };
    let mut set = vec![0x67, profile, 0, 10];
    set.extend(bytes.map(byte));
    set.resize(22, 0);
    set
}

/// The tiny film with another parameter set.
fn with_set(set: &[u8]) -> Vec<u8> {
    let mut film = TINY.to_vec();
    film[place_of(b"avcC") + 12..][..set.len()].copy_from_slice(set);
    film
}

/// No signal about colours; one that says their range.
const SILENT: &str = "0";
const LIMITED: &str = "100110100000000";
const FULL: &str = "100110110000000";

#[test]
fn h264_that_openh264_does_not_read_is_left_to_ffmpeg() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.mp4");
    for (what, set, ours) in [
        ("plain", set(66, "", "1", SILENT), true),
        ("high", set(100, "0101100", "1", SILENT), true),
        ("10 bits", set(110, "01001101100", "1", SILENT), false),
        ("4:2:2", set(122, "0111100", "1", SILENT), false),
        ("interlaced", set(100, "0101100", "00", SILENT), false),
    ] {
        std::fs::write(&path, with_set(&set)).unwrap();
        let film = Mp4Source::open(&path).unwrap();
        assert_eq!(film.is_some(), ours, "{what}");
    }
}

#[test]
fn a_film_whose_edit_list_leaves_pictures_out_is_left_to_ffmpeg() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.mp4");
    // Its second picture is shown 0x200 after the first.
    for (begin, ours) in [(0_u32, true), (1, false), (0x200, false), (u32::MAX, true)] {
        let mut film = TINY.to_vec();
        film[place_of(b"elst") + 16..][..4].copy_from_slice(&begin.to_be_bytes());
        std::fs::write(&path, film).unwrap();
        let film = Mp4Source::open(&path).unwrap();
        assert_eq!(film.is_some(), ours, "from {begin}");
    }
    // The list of a film with reordered pictures begins with the first one that is shown, not with 0.
    if let Some((mut film, _)) = reordered(folder.path()) {
        let begin = film.windows(4).position(|w| w == b"elst").unwrap() + 16;
        let first = u32::from_be_bytes(film[begin..begin + 4].try_into().unwrap());
        assert!(first > 0);
        for (at, ours) in [(first, true), (first + 1, false)] {
            film[begin..begin + 4].copy_from_slice(&at.to_be_bytes());
            std::fs::write(&path, &film).unwrap();
            assert_eq!(Mp4Source::open(&path).unwrap().is_some(), ours, "from {at}");
        }
        film[begin..begin + 4].copy_from_slice(&first.to_be_bytes());
        // For so long, milliseconds: a second is all of it, 0 to the end; writers forget the last picture's own time.
        for (lasts, ours) in [
            (1000_u32, true),
            (0, true),
            (958, true),
            (917, false),
            (500, false),
        ] {
            film[begin - 4..begin].copy_from_slice(&lasts.to_be_bytes());
            std::fs::write(&path, &film).unwrap();
            let opened = Mp4Source::open(&path).unwrap();
            assert_eq!(opened.is_some(), ours, "for {lasts} ms");
        }
    }
    let nothing = u64::from(u32::MAX);
    for (begins, is_edited) in [
        (&[][..], false),
        (&[1024], false),
        (&[1025], true),
        (&[nothing, 1024], false),
        (&[u64::MAX, 1024], false),
        (&[nothing, 1025], true),
        (&[0, 4096], true),
    ] {
        let edits = begins.iter().map(|begin| (*begin, 0.0));
        assert_eq!(is_cut(edits, 1024, 7.5), is_edited, "{begins:?}");
    }
    for (lasts, is_edited) in [(7.4, true), (7.6, false), (0.0, false)] {
        assert_eq!(is_cut([(1024, lasts)], 1024, 7.5), is_edited, "{lasts}");
    }
}

#[test]
fn black_and_white_are_what_the_stream_says() {
    let first = |signal: &str| {
        let film = with_set(&set(66, "", "1", signal));
        opened(&film).unwrap().next().unwrap().unwrap().rgb
    };
    let limited = first(LIMITED);
    assert_eq!(first(SILENT), limited);
    let spread = |rgb: &[u8]| {
        let mean = rgb.iter().map(|v| f64::from(*v)).sum::<f64>() / rgb.len() as f64;
        let off = rgb.iter().map(|v| (f64::from(*v) - mean).abs());
        off.sum::<f64>() / rgb.len() as f64
    };
    let (narrow, wide) = (spread(&first(FULL)), spread(&limited));
    assert!(narrow < 0.95 * wide, "{narrow} and {wide}");
}
