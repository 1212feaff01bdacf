//! YUV4MPEG2: every layout is played, from files and pipes, and what is damaged is told once.

use std::io::Cursor;
use std::process::Command;

use edgecap::capture::{CaptureError, Frame, InputSpec, OpenOptions, Source, Y4mReader, open};
use proptest::prelude::*;

/// Film of `frames` flat pictures whose luma rises.
pub fn film(header: &str, plane_bytes: [usize; 3], frames: u8) -> Vec<u8> {
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
