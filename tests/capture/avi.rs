//! Motion-JPEG AVI: what is written can be read, and nothing that is read can harm.

use std::io::{Cursor, Read, Seek, SeekFrom, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use edgecap::capture::{
    AviReader, AviWriter, Brightness, CaptureError, Frame, InputSpec, OpenOptions, RawDecoder,
    RawPicture, Source, open,
};
use proptest::prelude::*;

const WIDTH: u32 = 48;
const HEIGHT: u32 = 32;

/// A smooth picture that moves with `k`.
fn picture(k: u32) -> Frame {
    let mut rgb = Vec::new();
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            rgb.extend_from_slice(&[(4 * x + k) as u8, (6 * y) as u8, (2 * (x + y)) as u8]);
        }
    }
    Frame {
        width: WIDTH,
        height: HEIGHT,
        rgb,
        ..Frame::default()
    }
}

fn clip(frames: u32) -> Vec<u8> {
    let mut writer =
        AviWriter::new(Cursor::new(Vec::new()), WIDTH, HEIGHT, (30_000, 1001)).unwrap();
    for k in 0..frames {
        writer.write_frame(&picture(8 * k), 95).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

fn mean_difference(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: u64 = a
        .iter()
        .zip(b)
        .map(|(a, b)| u64::from(a.abs_diff(*b)))
        .sum();
    sum as f64 / a.len() as f64
}

#[test]
fn what_is_written_is_read_back() {
    let mut reader = AviReader::new(Cursor::new(clip(5)), "clip").unwrap();
    assert!(reader.is_motion_jpeg());
    assert_eq!(reader.frame_count(), Some(5));
    assert!((reader.fps().unwrap() - 29.97).abs() < 1e-3);
    let mut frame = Frame::default();
    for k in 0..5 {
        assert!(reader.next_into(&mut frame).unwrap());
        assert_eq!(
            (frame.width, frame.height, frame.sequence),
            (WIDTH, HEIGHT, k)
        );
        assert_eq!(frame.time_ns, k * 1001 * 1_000_000_000 / 30_000);
        let d = mean_difference(&frame.rgb, &picture(8 * k as u32).rgb);
        assert!(d < 3.0, "frame {k} differs by {d}");
    }
    assert!(!reader.next_into(&mut frame).unwrap());
}

#[test]
fn pictures_that_are_left_out_are_not_decoded_and_the_others_are_the_same() {
    let bytes = clip(4);
    let mut reader = AviReader::new(Cursor::new(bytes.clone()), "clip").unwrap();
    let mut other = AviReader::new(Cursor::new(bytes), "clip").unwrap();
    let (mut raw, mut decoder) = (RawPicture::default(), RawDecoder::default());
    let (mut frame, mut expected) = (Frame::default(), Frame::default());
    for k in 0..4 {
        assert!(reader.next_raw(&mut raw).unwrap());
        assert!(other.next_into(&mut expected).unwrap());
        assert!(raw.bytes.starts_with(&[0xFF, 0xD8]), "still a JPEG");
        if k % 2 == 0 {
            continue;
        }
        let mut brightness = Brightness::default();
        decoder.brightness(&raw, &mut brightness).unwrap();
        decoder.decode(&mut raw, &mut frame).unwrap();
        assert_eq!(frame, expected);
        // The luma of the picture, without its colours having been worked out.
        assert_eq!(brightness.cells.len(), brightness.columns * brightness.rows);
        let luma = frame
            .rgb
            .chunks_exact(3)
            .map(|p| 0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2]));
        let mean = luma.sum::<f32>() / (WIDTH * HEIGHT) as f32;
        let cells = &brightness.cells;
        let found = cells.iter().sum::<f32>() / cells.len() as f32;
        assert!((mean - found).abs() < 1.0, "{found} for {mean}");
    }
    assert!(!reader.next_raw(&mut raw).unwrap());
}

#[test]
fn sizes_in_the_headers_add_up() {
    let bytes = clip(3);
    let at = |i: usize| u32::from_le_bytes(bytes[i..i + 4].try_into().unwrap()) as usize;
    assert_eq!(at(4) + 8, bytes.len(), "RIFF");
    let (hdrl, movi) = (12, 12 + 8 + at(16));
    assert_eq!(&bytes[hdrl + 8..hdrl + 12], b"hdrl");
    assert_eq!(&bytes[movi..movi + 4], b"LIST");
    assert_eq!(&bytes[movi + 8..movi + 12], b"movi");
    let index = movi + 8 + at(movi + 4);
    assert_eq!(&bytes[index..index + 4], b"idx1");
    assert_eq!(at(index + 4), 3 * 16);
    for k in 0..3 {
        // Offsets count from the code `movi`.
        let chunk = movi + 8 + at(index + 8 + 16 * k + 8);
        assert_eq!(&bytes[chunk..chunk + 4], b"00dc");
        assert_eq!(at(chunk + 4), at(index + 8 + 16 * k + 12));
        assert_eq!(bytes[chunk + 8..chunk + 10], [0xFF, 0xD8]);
    }
}

/// Pictures of a film that ends without an error.
fn count_whole(bytes: Vec<u8>) -> u64 {
    let mut reader = AviReader::new(Cursor::new(bytes), "clip.avi").unwrap();
    let (mut frame, mut count) = (Frame::default(), 0);
    while reader.next_into(&mut frame).unwrap() {
        count += 1;
    }
    count
}

#[test]
fn what_follows_a_whole_film_does_not_make_it_one_that_is_cut_off() {
    let padding = b"JUNK\x03\0\0\0abc\0";
    for tail in [
        &b"made by a camera in the hall"[..],
        b"abc",
        &[0; 4096],
        padding,
    ] {
        assert_eq!(count_whole([&clip(3)[..], tail].concat()), 3, "{tail:?}");
    }
    // A second part (OpenDML) has its pictures, also behind padding.
    let first = clip(3);
    let movi = first.windows(4).position(|w| w == b"movi").unwrap() - 8;
    let index = first.windows(4).position(|w| w == b"idx1").unwrap();
    let pictures = &first[movi..index];
    let length = (4 + pictures.len() as u32).to_le_bytes();
    let second = [&b"RIFF"[..], &length, b"AVIX", pictures].concat();
    for between in [&b""[..], padding] {
        let both = [&first[..], between, &second, b"the end of it all"].concat();
        assert_eq!(count_whole(both), 6, "{between:?}");
    }
}

#[test]
fn a_length_that_covers_less_than_the_film_hides_no_picture() {
    let whole = clip(3);
    let movi = whole.windows(4).position(|w| w == b"movi").unwrap() - 8;
    let pictures = whole.windows(4).enumerate();
    let pictures: Vec<usize> = pictures
        .filter(|(_, w)| *w == b"00dc")
        .map(|p| p.0)
        .take(3)
        .collect();
    // The headers alone, which the pictures follow.
    let mut headers_only = whole.clone();
    headers_only[4..8].copy_from_slice(&(movi as u32 - 8).to_le_bytes());
    assert_eq!(count_whole(headers_only), 3);
    // Written while the film grew, up to its second picture, and not again.
    let mut grown = whole;
    let until = pictures[1] as u32;
    grown[4..8].copy_from_slice(&(until - 8).to_le_bytes());
    grown[movi + 4..movi + 8].copy_from_slice(&(until - 8 - movi as u32).to_le_bytes());
    assert_eq!(count_whole(grown), 3);
}

#[test]
fn a_long_rest_that_cannot_be_read_is_told() {
    let mut file = tempfile::tempfile().unwrap();
    let film = clip(3);
    file.write_all(&film).unwrap();
    file.set_len(film.len() as u64 + (1 << 31)).unwrap();
    let mut reader = AviReader::new(file, "long.avi").unwrap();
    let mut frame = Frame::default();
    for _ in 0..3 {
        assert!(reader.next_into(&mut frame).unwrap());
    }
    assert_eq!(reader.next_into(&mut frame).unwrap_err().exit_code(), 65);
    assert!(!reader.next_into(&mut frame).unwrap());
}

#[test]
fn a_file_cut_off_gives_its_whole_frames_then_one_error() {
    let whole = clip(4);
    let last = whole.windows(4).rposition(|w| w == b"00dc").unwrap();
    // The index names every chunk too; the pictures' own codes come before it.
    let index = whole.windows(4).position(|w| w == b"idx1").unwrap();
    assert!(last > index);
    let cut = index - 20;
    let mut reader = AviReader::new(Cursor::new(whole[..cut].to_vec()), "cut.avi").unwrap();
    let mut frame = Frame::default();
    for _ in 0..3 {
        assert!(reader.next_into(&mut frame).unwrap());
    }
    let error = reader.next_into(&mut frame).unwrap_err();
    assert_eq!(error.exit_code(), 65);
    assert!(error.to_string().contains("cut.avi") && error.to_string().contains("frame 3"));
    assert!(
        !reader.next_into(&mut frame).unwrap(),
        "one error, then the end"
    );
}

/// Bytes that this thread has read so far, where the system counts them.
fn read_so_far() -> Option<u64> {
    let counts = std::fs::read_to_string("/proc/thread-self/io").ok()?;
    counts.lines().next()?.strip_prefix("rchar: ")?.parse().ok()
}

#[test]
fn a_film_is_opened_by_its_heads_and_read_once() {
    let Some(before) = read_so_far() else {
        eprintln!("skipped: this system does not count what a thread reads");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.avi");
    let bytes = clip(200);
    std::fs::write(&path, &bytes).unwrap();
    let input = InputSpec::Path(path);
    let mut film = open(&input, &OpenOptions::default()).unwrap();
    let opened = read_so_far().unwrap();
    // What looking takes itself is a few hundred bytes.
    let most = bytes.len() as u64 / 4;
    assert!(opened - before < most, "{} of {most}", opened - before);
    let mut raw = RawPicture::default();
    while film.next_raw(&mut raw).unwrap() {}
    let read = read_so_far().unwrap() - opened;
    assert!(read < bytes.len() as u64 + 4096, "{read}");
}

/// Programs that keep a rate repeat pictures by chunks without bytes.
#[test]
fn repetitions_at_the_end_are_no_pictures() {
    let mut bytes = clip(3);
    let chunks: Vec<usize> = bytes
        .windows(4)
        .enumerate()
        .filter(|(_, w)| *w == b"00dc")
        .map(|(at, _)| at)
        .take(3)
        .collect();
    // What was the last picture is passed over as something else.
    let last = chunks[2];
    bytes[last + 4..last + 8].fill(0);
    let mut reader = AviReader::new(Cursor::new(bytes), "clip.avi").unwrap();
    assert_eq!(reader.frame_count(), Some(2));
    let mut frame = Frame::default();
    let seen = std::iter::from_fn(|| {
        let more = reader.next_into(&mut frame).is_ok_and(|more| more);
        more.then_some(frame.sequence)
    });
    assert_eq!(seen.last(), Some(1));
}

/// One picture in 136 years, as a damaged header may say.
#[test]
fn times_rise_up_to_the_last_one_that_there_is() {
    let file = Cursor::new(Vec::new());
    let mut writer = AviWriter::new(file, WIDTH, HEIGHT, (1, u32::MAX)).unwrap();
    for k in 0..7 {
        writer.write_frame(&picture(k), 95).unwrap();
    }
    let bytes = writer.finish().unwrap().into_inner();
    let mut reader = AviReader::new(Cursor::new(bytes), "clip.avi").unwrap();
    let mut frame = Frame::default();
    let step = u64::from(u32::MAX) * 1_000_000_000;
    for k in 0..7 {
        assert!(reader.next_into(&mut frame).unwrap());
        assert_eq!(frame.time_ns, step.saturating_mul(k));
    }
}

#[test]
fn outer_lengths_of_zero_last_to_the_end() {
    let mut bytes = clip(3);
    let movi = bytes.windows(4).position(|w| w == b"movi").unwrap();
    bytes[4..8].fill(0);
    bytes[movi - 4..movi].fill(0);
    let reader = AviReader::new(Cursor::new(bytes), "clip.avi").unwrap();
    assert_eq!(reader.frame_count(), Some(3));
}

/// Counts how often it is read.
struct Counted(Cursor<Vec<u8>>, Arc<AtomicUsize>);

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.1.fetch_add(1, Ordering::Relaxed);
        self.0.read(buffer)
    }
}

impl Seek for Counted {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.0.seek(to)
    }
}

/// A recorder that lost power leaves what it had asked the disk for: zeros, gigabytes of them.
#[test]
fn zeros_between_and_behind_pictures_are_passed_over_at_once() {
    let mut bytes = clip(3);
    let at = |code: &[u8], bytes: &[u8]| bytes.windows(4).position(|w| w == code).unwrap();
    let movi = at(b"movi", &bytes);
    bytes[4..8].fill(0);
    bytes[movi - 4..movi].fill(0);
    bytes.truncate(at(b"idx1", &bytes));
    let first = movi + 4;
    let second = first + 8 + at(b"00dc", &bytes[first + 8..]);
    bytes.splice(second..second, [0; 4000]);
    bytes.resize(bytes.len() + (1 << 20) + 8, 0);
    let reads = Arc::new(AtomicUsize::new(0));
    let counted = Counted(Cursor::new(bytes), Arc::clone(&reads));
    let mut reader = AviReader::new(counted, "clip.avi").unwrap();
    assert!(reads.load(Ordering::Relaxed) < 200, "{reads:?}");
    let mut frame = Frame::default();
    for k in 0..3 {
        assert!(reader.next_into(&mut frame).unwrap());
        let d = mean_difference(&frame.rgb, &picture(8 * k).rgb);
        assert!(d < 3.0, "frame {k} differs by {d}");
    }
    assert!(!reader.next_into(&mut frame).unwrap());
}

#[test]
fn one_damaged_picture_is_skipped() {
    let mut bytes = clip(3);
    let second = bytes
        .windows(4)
        .enumerate()
        .filter(|(_, w)| *w == b"00dc")
        .nth(1)
        .unwrap()
        .0;
    bytes[second + 8] = 0;
    let mut reader = AviReader::new(Cursor::new(bytes), "clip.avi").unwrap();
    let mut frame = Frame::default();
    assert!(reader.next_into(&mut frame).unwrap());
    let error = reader.next_into(&mut frame).unwrap_err();
    assert!(
        error.is_skippable() && error.to_string().starts_with("clip.avi, frame 1"),
        "{error}"
    );
    assert!(reader.next_into(&mut frame).unwrap());
    assert_eq!(frame.sequence, 2);
}

#[test]
fn other_bytes_are_refused_by_name() {
    for bytes in [
        &b""[..],
        b"RIFF",
        b"RIFF\0\0\0\0AVI ",
        b"hello, this is no film",
    ] {
        let error = AviReader::new(Cursor::new(bytes), "x.avi").err().unwrap();
        assert!(matches!(error, CaptureError::Data { .. }), "{error:?}");
        assert!(error.to_string().starts_with("x.avi: "));
    }
}

#[test]
fn impossible_sizes_are_refused() {
    for (w, h, rate) in [
        (0, 1, (1, 1)),
        (1, 70_000, (1, 1)),
        (1, 1, (0, 1)),
        (1, 1, (1, 0)),
    ] {
        assert!(AviWriter::new(Cursor::new(Vec::new()), w, h, rate).is_err());
    }
    let mut writer = AviWriter::new(Cursor::new(Vec::new()), 3, 3, (1, 1)).unwrap();
    assert!(writer.write_frame(&picture(0), 90).is_err());
}

/// Reads to the end; counts what comes.
fn drain(bytes: &[u8]) -> usize {
    let Ok(mut reader) = AviReader::new(Cursor::new(bytes), "x") else {
        return 0;
    };
    let mut frame = Frame::default();
    for n in 0.. {
        match reader.next_into(&mut frame) {
            Ok(true) => assert_eq!(frame.rgb.len(), 3 * (frame.width * frame.height) as usize),
            Ok(false) => return n,
            Err(e) if e.is_skippable() => {}
            Err(_) => return n,
        }
    }
    unreachable!()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn random_bytes_never_panic(tail in prop::collection::vec(any::<u8>(), 0..400)) {
        let mut bytes = b"RIFF\xFF\0\0\0AVI ".to_vec();
        bytes.extend_from_slice(&tail);
        drain(&bytes);
    }

    #[test]
    fn damaged_files_never_panic(
        cut in 0usize..4000,
        hits in prop::collection::vec((0usize..4000, any::<u8>()), 0..12),
    ) {
        let mut bytes = clip(2);
        for (at, value) in hits {
            let n = bytes.len();
            bytes[at % n] = value;
        }
        bytes.truncate(cut.max(12).min(bytes.len()));
        drain(&bytes);
    }
}

/// The clip in a file, as the program opens it: width and height of its pictures, after the same count of them.
fn size_of(bytes: &[u8]) -> (u32, u32) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.avi");
    std::fs::write(&path, bytes).unwrap();
    let mut film = open(&InputSpec::Path(path), &OpenOptions::default()).unwrap();
    assert_eq!(film.frame_count(), Some(2));
    let (mut frame, mut size) = (Frame::default(), (0, 0));
    for k in 0..2 {
        assert!(film.next_into(&mut frame).unwrap());
        assert_eq!(frame.sequence, k);
        size = (frame.width, frame.height);
        assert_eq!(frame.rgb.len(), (3 * size.0 * size.1) as usize);
    }
    assert!(!film.next_into(&mut frame).unwrap());
    size
}

/// The clip with video properties behind the format of its stream: the picture's aspect, x and y.
fn with_aspect(x: u32, y: u32) -> Vec<u8> {
    let mut bytes = clip(2);
    let after = bytes.windows(4).position(|w| w == b"strf").unwrap() + 8 + 40;
    let mut properties = b"vprp".to_vec();
    for word in [68, 0, 0, 25, WIDTH, HEIGHT, x << 16 | y, WIDTH, HEIGHT, 1] {
        properties.extend_from_slice(&word.to_le_bytes());
    }
    properties.resize(8 + 68, 0);
    // The lengths of what it lies in: the file, its headers, the stream's.
    for at in [4, 16, 92] {
        let length = u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let length = length + properties.len() as u32;
        bytes[at..at + 4].copy_from_slice(&length.to_le_bytes());
    }
    bytes.splice(after..after, properties);
    bytes
}

#[test]
fn pixels_that_are_not_square_are_made_so() {
    assert_eq!(size_of(&clip(2)), (WIDTH, HEIGHT));
    for (x, y, size) in [
        (3, 2, (48, 32)),
        (16, 9, (57, 32)),
        (1, 1, (48, 48)),
        (0, 9, (48, 32)),
    ] {
        assert_eq!(size_of(&with_aspect(x, y)), size, "{x}:{y}");
    }
    // Without them the first picture tells: a unit of 0, then the pixel's width and height.
    let with_density = |mut bytes: Vec<u8>, unit: u8| {
        let places = bytes.windows(5).enumerate();
        let places: Vec<usize> = places
            .filter(|(_, w)| w == b"JFIF\0")
            .map(|p| p.0)
            .collect();
        assert_eq!(places.len(), 2);
        for at in places {
            bytes[at + 7..at + 12].copy_from_slice(&[unit, 0, 64, 0, 45]);
        }
        bytes
    };
    assert_eq!(size_of(&with_density(clip(2), 0)), (68, 32));
    assert_eq!(size_of(&with_density(clip(2), 1)), (48, 32));
    assert_eq!(size_of(&with_density(with_aspect(3, 2), 0)), (48, 32));
}

/// Two fields in a chunk are one picture of twice their lines, which is not ours to put together.
#[test]
fn interlaced_pictures_are_not_read_at_half_their_height() {
    let with_lines = |lines: i32| {
        let mut bytes = clip(2);
        let format = bytes.windows(4).position(|w| w == b"strf").unwrap() + 8;
        bytes[format + 8..format + 12].copy_from_slice(&lines.to_le_bytes());
        AviReader::new(Cursor::new(bytes), "clip.avi").unwrap()
    };
    let lines = HEIGHT as i32;
    for (stated, ours) in [
        (lines, true),
        (-lines, true),
        (2 * lines, false),
        (-2 * lines, false),
        // Others are mistaken.
        (0, true),
        (3 * lines, true),
        (i32::MIN, true),
    ] {
        assert_eq!(with_lines(stated).is_motion_jpeg(), ours, "{stated}");
    }
}
