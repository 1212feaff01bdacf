//! Films from any bytes, played: a file of its own, as the tests of MP4 in `src/capture/mp4` run their target, too.

use edgecap::capture::{Frame, Source};

/// Pictures that are taken from one film.
const PICTURES: usize = 8;

/// H.264 in an MP4 container. It is opened by path, so it lies in memory that has one.
#[cfg(feature = "mp4")]
pub fn mp4(data: &[u8]) {
    use std::io::Write;
    let mut file = tempfile::NamedTempFile::new_in("/dev/shm").expect("/dev/shm takes files");
    file.write_all(data).expect("/dev/shm has room");
    if let Ok(Some(film)) = edgecap::capture::Mp4Source::open(file.path()) {
        play(film);
    }
}

/// Takes the first pictures of a film.
pub fn play(mut film: impl Source) {
    let _ = (film.frame_count(), film.fps());
    let mut frame = Frame::default();
    for _ in 0..PICTURES {
        match film.next_into(&mut frame) {
            Ok(true) => assert_whole(&frame),
            Ok(false) => break,
            Err(e) if e.is_skippable() => {}
            Err(_) => break,
        }
    }
}

/// A picture that was given has all its pixels.
pub fn assert_whole(frame: &Frame) {
    let expected = 3 * frame.width as usize * frame.height as usize;
    assert!(expected > 0 && frame.rgb.len() == expected);
}
