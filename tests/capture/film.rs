//! Films: YUV4MPEG2, colours, and whatever ffmpeg can read.

use std::io::{Cursor, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use edgecap::camera::SystemClock;
use edgecap::capture::{
    AviWriter, CaptureError, Ffmpeg, FfmpegSource, Frame, InputSpec, Matrix, OpenOptions,
    PacedSource, Range, Source, Y4mReader, YuvToRgb, open, open_bytes,
};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use proptest::prelude::*;
use rustix::fs::{CWD, FileType, Mode, mknodat};

use crate::tools;

/// The definition in ITU-R BT.601 and BT.709.
fn exact(y: u8, u: u8, v: u8, matrix: Matrix, range: Range) -> [f64; 3] {
    let (kr, kb) = match matrix {
        Matrix::Bt601 => (0.299, 0.114),
        Matrix::Bt709 => (0.2126, 0.0722),
    };
    let (y, u, v) = (f64::from(y), f64::from(u) - 128.0, f64::from(v) - 128.0);
    let (y, u, v) = match range {
        Range::Full => (y, u, v),
        Range::Limited => (
            (y - 16.0) * 255.0 / 219.0,
            u * 255.0 / 224.0,
            v * 255.0 / 224.0,
        ),
    };
    let r = y + 2.0 * (1.0 - kr) * v;
    let b = y + 2.0 * (1.0 - kb) * u;
    let g = (y - kr * r - kb * b) / (1.0 - kr - kb);
    [r, g, b].map(|c| c.clamp(0.0, 255.0))
}

#[test]
fn colours_are_within_one_of_the_definition() {
    for matrix in [Matrix::Bt601, Matrix::Bt709] {
        for range in [Range::Limited, Range::Full] {
            let convert = YuvToRgb::new(matrix, range);
            for u in (0..=255).step_by(5) {
                for v in (0..=255).step_by(5) {
                    let luma: Vec<u8> = (0..=255).collect();
                    let mut rgb = vec![0; 3 * 256];
                    convert.planar(
                        [&luma, &[u; 256], &[v; 256]],
                        [256; 2],
                        (0, 0),
                        256,
                        &mut rgb,
                    );
                    for (y, got) in luma.iter().zip(rgb.chunks_exact(3)) {
                        for (a, b) in got.iter().zip(exact(*y, u, v, matrix, range)) {
                            assert!((f64::from(*a) - b).abs() <= 1.0, "{y} {u} {v}: {a} {b}");
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn layouts_agree_on_the_same_picture() {
    // Narrow, one block, several blocks with a rest, odd and even.
    for (w, h) in [(1, 1), (7, 5), (64, 2), (131, 3), (192, 2)] {
        layouts_agree(w, h);
    }
}

fn layouts_agree(w: usize, h: usize) {
    // Chroma constant over 2 × 2 blocks, so that all subsamplings hold the same picture; odd sizes have half blocks.
    let y = |i: usize, j: usize| (16 + 29 * i + 13 * j) as u8;
    let u = |i: usize, j: usize| (60 + 40 * (i / 2) + 3 * (j / 2)) as u8;
    let v = |i: usize, j: usize| 200usize.wrapping_sub(30 * (i / 2) + 20 * (j / 2)) as u8;
    let plane = |f: &dyn Fn(usize, usize) -> u8, step: usize, step_y: usize| -> Vec<u8> {
        (0..h)
            .step_by(step_y)
            .flat_map(|j| (0..w).step_by(step).map(move |i| (i, j)))
            .map(|(i, j)| f(i, j))
            .collect()
    };
    let convert = YuvToRgb::new(Matrix::Bt601, Range::Limited);
    let luma = plane(&y, 1, 1);
    let planar = |step: usize, step_y: usize, shift| {
        let mut rgb = vec![0; 3 * w * h];
        convert.planar(
            [&luma, &plane(&u, step, step_y), &plane(&v, step, step_y)],
            [w, w.div_ceil(step)],
            shift,
            w,
            &mut rgb,
        );
        rgb
    };
    let expected = planar(1, 1, (0, 0));
    assert_eq!(planar(2, 2, (1, 1)), expected);
    assert_eq!(planar(2, 1, (1, 0)), expected);

    let stride = 2 * w.div_ceil(2) + 2;
    let padded: Vec<u8> = luma
        .chunks(w)
        .flat_map(|row| {
            let mut row = row.to_vec();
            row.resize(stride, 0);
            row
        })
        .collect();
    let (us, vs) = (plane(&u, 2, 2), plane(&v, 2, 2));
    let pairs: Vec<u8> = us
        .chunks(w.div_ceil(2))
        .zip(vs.chunks(w.div_ceil(2)))
        .flat_map(|(us, vs)| {
            let mut row: Vec<u8> = us.iter().zip(vs).flat_map(|(u, v)| [*u, *v]).collect();
            row.resize(stride, 0);
            row
        })
        .collect();
    let mut rgb = vec![0; 3 * w * h];
    convert.nv12(&padded, &pairs, stride, w, &mut rgb);
    assert_eq!(rgb, expected);

    let mut yuyv = Vec::new();
    for j in 0..h {
        for i in (0..w).step_by(2) {
            let second = if i + 1 < w { y(i + 1, j) } else { 0 };
            yuyv.extend_from_slice(&[y(i, j), u(i, j), second, v(i, j)]);
        }
        yuyv.extend_from_slice(&[9; 4]);
    }
    let mut rgb = vec![0; 3 * w * h];
    convert.yuyv(&yuyv, 4 * w.div_ceil(2) + 4, w, &mut rgb);
    assert_eq!(rgb, expected);
}

/// Film of `frames` flat pictures whose luma rises.
fn film(header: &str, plane_bytes: [usize; 3], frames: u8) -> Vec<u8> {
    let mut bytes = format!("YUV4MPEG2 {header}\n").into_bytes();
    for k in 0..frames {
        bytes.extend_from_slice(b"FRAME\n");
        for (plane, n) in plane_bytes.iter().enumerate() {
            bytes.extend(std::iter::repeat_n(
                if plane == 0 { 16 + 20 * k } else { 128 },
                *n,
            ));
        }
    }
    bytes
}

#[test]
fn y4m_of_other_pixels_comes_out_with_square_ones_from_files_and_pipes() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.y4m");
    for (number, (shape, size)) in [
        ("A64:45", (64, 36)),
        ("A2:3", (45, 54)),
        ("A1:1", (45, 36)),
        ("A0:0", (45, 36)),
        ("A", (45, 36)),
    ]
    .into_iter()
    .enumerate()
    {
        // One each: a writer may find the last one's reader, which has its end but has not closed it yet.
        let pipe = folder.path().join(format!("pipe{number}"));
        let made = Command::new("mkfifo").arg(&pipe).status().unwrap();
        assert!(made.success());
        let bytes = film(&format!("W45 H36 F60:1 {shape} Cmono"), [45 * 36, 0, 0], 2);
        std::fs::write(&file, &bytes).unwrap();
        let to = pipe.clone();
        let writing = std::thread::spawn(move || std::fs::write(to, bytes).unwrap());
        for path in [&file, &pipe] {
            let spec = InputSpec::Path(path.clone());
            let mut source = open(&spec, &OpenOptions::default()).unwrap();
            let (mut frame, mut count) = (Frame::default(), 0);
            loop {
                match source.next_into(&mut frame) {
                    Ok(true) => count += 1,
                    Ok(false) => break,
                    Err(CaptureError::NoPictureYet { .. }) => continue,
                    Err(e) => panic!("{e}"),
                }
                assert_eq!((frame.width, frame.height), size, "{shape}");
            }
            assert_eq!((count, source.fps()), (2, Some(60.0)), "{shape}");
        }
        writing.join().unwrap();
    }
}

#[test]
fn y4m_of_every_layout_is_played() {
    for (header, planes) in [
        ("W6 H4 F30:1 Ip A1:1 C420jpeg XYSCSS=420JPEG", [24, 6, 6]),
        ("W6 H4 F30:1", [24, 6, 6]),
        ("W5 H3 F30:1 C420mpeg2", [15, 6, 6]),
        ("W5 H3 F30:1 C422", [15, 9, 9]),
        ("W5 H3 F30:1 C444", [15, 15, 15]),
        ("W5 H3 F30:1 Cmono", [15, 0, 0]),
    ] {
        let bytes = film(header, planes, 3);
        let total = Some(bytes.len() as u64);
        let mut reader = Y4mReader::new(Cursor::new(bytes), "film", total).unwrap();
        assert_eq!(reader.frame_count(), Some(3), "{header}");
        assert_eq!(reader.fps(), Some(30.0));
        for k in 0..3u64 {
            let frame = reader.next().unwrap().unwrap();
            let grey = (20.0 * k as f64 * 255.0 / 219.0).round();
            assert!(
                frame
                    .rgb
                    .iter()
                    .all(|v| (f64::from(*v) - grey).abs() <= 1.0),
                "{header}"
            );
            assert_eq!((frame.sequence, frame.time_ns), (k, k * 1_000_000_000 / 30));
        }
        assert!(reader.next().unwrap().is_none());
    }
}

#[test]
fn full_range_is_honoured() {
    // Words after FRAME are allowed and skipped.
    let bytes = b"YUV4MPEG2 W2 H2 F25:1 Cmono XCOLORRANGE=FULL\nFRAME Ip\n\x10\x10\x10\x10FRAME\n\x24\x24\x24\x24".to_vec();
    let mut reader = Y4mReader::new(Cursor::new(bytes), "film", None).unwrap();
    assert_eq!(reader.frame_count(), None);
    reader.next().unwrap();
    assert_eq!(reader.next().unwrap().unwrap().rgb, [36; 12]);
}

#[test]
fn damaged_y4m_is_refused_or_ends_with_one_error() {
    let refuse = |bytes: &[u8], code: u8, word: &str| {
        let error = Y4mReader::new(Cursor::new(bytes.to_vec()), "film.y4m", None)
            .err()
            .unwrap();
        assert_eq!(error.exit_code(), code, "{error}");
        assert!(
            error.to_string().contains("film.y4m") && error.to_string().contains(word),
            "{error}"
        );
    };
    refuse(b"", 66, "nothing");
    refuse(b"YUV4MPEG2 W6", 65, "other bytes");
    refuse(b"hello\n", 65, "other bytes");
    refuse(&[b'x'; 5000], 65, "other bytes");
    refuse(b"YUV4MPEG2 W0 H4\n", 65, "0x4");
    refuse(b"YUV4MPEG2 W99999 H4\n", 65, "99999x4");
    refuse(b"YUV4MPEG2 W4 H4 C420p10\n", 65, "C420p10");

    let whole = film("W6 H4 F30:1", [24, 6, 6], 3);
    for cut in [whole.len() - 1, whole.len() - 36, whole.len() - 41] {
        let mut reader =
            Y4mReader::new(Cursor::new(whole[..cut].to_vec()), "film.y4m", None).unwrap();
        assert!(reader.next().unwrap().is_some());
        assert!(reader.next().unwrap().is_some());
        let error = reader.next().unwrap_err();
        assert_eq!(error.exit_code(), 65);
        assert!(error.to_string().contains("frame 2"), "{error}");
        assert!(reader.next().unwrap().is_none());
    }
}

#[test]
fn films_open_from_memory_and_from_files() {
    let y4m = film("W6 H4 F30:1", [24, 6, 6], 2);
    let mut writer = AviWriter::new(Cursor::new(Vec::new()), 6, 4, (30, 1)).unwrap();
    let frame = Frame {
        width: 6,
        height: 4,
        rgb: vec![90; 72],
        ..Frame::default()
    };
    writer.write_frame(&frame, 90).unwrap();
    writer.write_frame(&frame, 90).unwrap();
    let avi = writer.finish().unwrap().into_inner();
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in [("a.y4m", y4m), ("b.avi", avi)] {
        // Names do not matter, bytes do.
        let path = folder.path().join(name).with_extension("bin");
        std::fs::write(&path, &bytes).unwrap();
        let from_file = open(&InputSpec::Path(path), &OpenOptions::default()).unwrap();
        let from_memory = open_bytes("demo", bytes.leak()).unwrap();
        for mut source in [from_file, from_memory] {
            assert_eq!(source.frame_count(), Some(2));
            assert!(source.next().unwrap().is_some() && source.next().unwrap().is_some());
            assert!(source.next().unwrap().is_none());
        }
    }
    assert!(open_bytes("demo", b"nothing of the kind").is_err());
}

#[test]
fn jpegs_back_to_back_are_a_film_by_their_name_and_a_photo_without() {
    let jpeg = |value: u8| {
        let mut bytes = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut bytes, 90);
        let grey = [value; 16 * 8];
        encoder
            .write_image(&grey, 16, 8, ExtendedColorType::L8)
            .unwrap();
        bytes
    };
    let pictures = [40, 90, 140].map(jpeg);
    let folder = tempfile::tempdir().unwrap();
    let opened = |name: &str, bytes: &[u8], fps: Option<f64>| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let options = OpenOptions {
            fps,
            ..OpenOptions::default()
        };
        open(&InputSpec::Path(path), &options).unwrap()
    };
    let film = pictures.concat();
    for (name, fps) in [("a.mjpeg", None), ("a.MJPG", Some(10.0)), ("a.mjp", None)] {
        let mut source = opened(name, &film, fps);
        let rate = fps.unwrap_or(30.0);
        assert_eq!((source.fps(), source.is_stills()), (Some(rate), false));
        for (k, value) in [40_u8, 90, 140].into_iter().enumerate() {
            let frame = source.next().unwrap().unwrap();
            assert_eq!((frame.width, frame.height), (16, 8));
            assert!(frame.rgb.iter().all(|v| v.abs_diff(value) <= 3), "{name}");
            let time_ns = (k as f64 * 1e9 / rate).round() as u64;
            assert_eq!((frame.sequence, frame.time_ns), (k as u64, time_ns));
        }
        assert!(source.next().unwrap().is_none());
    }
    let mut photo = opened("a.jpg", &film, None);
    assert!(photo.is_stills() && photo.next().unwrap().is_some());
    assert!(photo.next().unwrap().is_none());

    let mut cut = opened("cut.mjpeg", &film[..film.len() - 1], None);
    assert!(cut.next().unwrap().is_some() && cut.next().unwrap().is_some());
    let error = cut.next().unwrap_err();
    assert_eq!((error.exit_code(), error.is_skippable()), (65, false));
    assert!(error.to_string().contains("inside frame 2"), "{error}");

    let without_end = &pictures[1][..pictures[1].len() - 2];
    let damaged = [&pictures[0][..], without_end, &pictures[2]].concat();
    let mut damaged = opened("damaged.mjpeg", &damaged, None);
    assert!(damaged.next().unwrap().is_some());
    let error = damaged.next().unwrap_err();
    assert!(
        error.is_skippable() && error.to_string().contains("frame 1"),
        "{error}"
    );
    assert_eq!(damaged.next().unwrap().unwrap().sequence, 2);
    assert!(damaged.next().unwrap().is_none());
}

#[test]
fn paths_that_lead_to_no_file_are_no_input() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("file"), "").unwrap();
    std::os::unix::fs::symlink(at("circle"), at("circle")).unwrap();
    mknodat(CWD, at("socket"), FileType::Socket, Mode::RWXU, 0).unwrap();
    let long = "a".repeat(300);
    for name in ["none.avi", "file/clip.avi", "circle", "socket", &long] {
        let spec = InputSpec::Path(at(name));
        let error = open(&spec, &OpenOptions::default()).err().unwrap();
        assert_eq!(error.exit_code(), 66, "{error}");
        assert!(error.to_string().contains("check the path"), "{error}");
    }
}

#[test]
fn words_become_inputs() {
    for (text, spec) in [
        ("camera", InputSpec::FirstCamera),
        ("-", InputSpec::Stdin),
        ("demo", InputSpec::Demo),
        ("./demo", InputSpec::Path("./demo".into())),
        ("/dev/video3", InputSpec::Path("/dev/video3".into())),
    ] {
        assert_eq!(text.parse::<InputSpec>().unwrap(), spec);
        assert_eq!(spec.to_string(), text);
    }
}

/// A folder with stand-ins for the two programs.
fn stand_ins(folder: &Path, ffmpeg: &str, ffprobe: &str) -> Ffmpeg {
    let write = |name: &str, body: &str| {
        let path = folder.join(name);
        // A child writes the file: a descriptor of ours, open for writing while another test starts a process, would be
        // inherited there, and a file that somebody may write to cannot be run.
        let mut child = Command::new("sh")
            .args(["-c", "cat > \"$0\" && chmod 755 \"$0\""])
            .arg(&path)
            .stdin(Stdio::piped())
            .spawn()
            .unwrap();
        let mut script = child.stdin.take().unwrap();
        write!(script, "#!/bin/sh\n{body}\n").unwrap();
        drop(script);
        assert!(child.wait().unwrap().success());
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

const PICTURE: &str = "printf 'P6\\n2 1\\n255\\nabcdef'";

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
fn pixels_that_are_not_square_are_made_so() {
    if !tools::has("ffmpeg") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (shape, size) in [("4/3", (128, 64)), ("1/2", (96, 128)), ("1", (96, 64))] {
        let film = folder.path().join("film.mkv");
        let made = Command::new("ffmpeg")
            .args([
                "-v",
                "error",
                "-y",
                "-f",
                "lavfi",
                "-i",
                "testsrc=size=96x64:rate=5:duration=1",
            ])
            .args(["-vf", &format!("setsar={shape}"), "-c:v", "mpeg4"])
            .arg(&film)
            .status()
            .unwrap();
        assert!(made.success());
        let mut source = FfmpegSource::open(&film, &Ffmpeg::default()).unwrap();
        let frame = source.next().unwrap().unwrap();
        assert_eq!((frame.width, frame.height), size, "{shape}");
        assert_eq!(source.frame_count(), Some(5));
    }
}

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

/// Times of a film's pictures, milliseconds.
fn times_ms(source: &mut dyn Source) -> Vec<u64> {
    let mut times = Vec::new();
    while let Some(frame) = source.next().unwrap() {
        times.push(frame.time_ns / 1_000_000);
    }
    times
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

/// Whether a process exists and is not a zombie of ours.
fn is_alive(pid: u32) -> bool {
    std::fs::read_to_string(format!("/proc/{pid}/stat")).is_ok()
}

#[test]
fn no_child_is_left_behind() {
    let folder = tempfile::tempdir().unwrap();
    // Writes for ever.
    let programs = stand_ins(
        folder.path(),
        &format!("while :; do {PICTURE}; done"),
        "printf 'stream,2/1,N/A\\n'",
    );
    let mut source = FfmpegSource::open(Path::new("film.mp4"), &programs).unwrap();
    let pid = source.child_id();
    assert!(source.next().unwrap().is_some());
    assert!(is_alive(pid));
    drop(source);
    assert!(!is_alive(pid));
}

/// Some installations call a script `ffmpeg` that starts the real one, which has our pipes, too.
#[test]
fn what_the_child_has_started_ends_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let pid_file = folder.path().join("pid");
    let programs = stand_ins(
        folder.path(),
        &format!(
            "{PICTURE}; sleep 600 & echo $! > {}; wait",
            pid_file.display()
        ),
        "printf 'stream,2/1,N/A\\n'",
    );
    let mut source = FfmpegSource::open(Path::new("film.mp4"), &programs).unwrap();
    assert!(source.next().unwrap().is_some());
    let begun = Instant::now();
    let pid = loop {
        let text = std::fs::read_to_string(&pid_file).unwrap_or_default();
        match text.trim().parse::<u32>() {
            Ok(pid) => break pid,
            Err(_) => assert!(begun.elapsed() < Duration::from_secs(60)),
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let begun = Instant::now();
    drop(source);
    assert!(
        begun.elapsed() < Duration::from_secs(60),
        "it was waited for"
    );
    // It is not ours to reap, and may be a zombie until its new parent does.
    let is_there = || {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let state = stat.rsplit(") ").next().unwrap().chars().next();
        !matches!(state, None | Some('Z' | 'X'))
    };
    while is_there() {
        assert!(begun.elapsed() < Duration::from_secs(60), "it is alive");
        std::thread::sleep(Duration::from_millis(5));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn random_y4m_never_panics(
        header in "[WHFCXIA0-9:. ]{0,30}",
        tail in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        let mut bytes = format!("YUV4MPEG2 W3 H2 {header}\nFRAME\n").into_bytes();
        bytes.extend_from_slice(&tail);
        if let Ok(mut reader) = Y4mReader::new(Cursor::new(bytes), "x", Some(300)) {
            while let Ok(true) = reader.next_into(&mut Frame::default()) {}
        }
    }
}
