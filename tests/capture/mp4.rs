//! H.264 without ffmpeg. Needs the feature `mp4`; the film itself comes from the folder in `EDGECAP_DATA`.

use std::path::PathBuf;

use edgecap::capture::{Ffmpeg, FfmpegSource, Frame, Mp4Source, Source};
use proptest::prelude::*;

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
            println!("skipped: {e}");
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

/// 16 pictures of 64×48 pixels.
const TINY: &[u8] = include_bytes!("../../fuzz/seeds/tiny.mp4");

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
