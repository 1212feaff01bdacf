//! What is opened: devices that are no camera, and the mode that is chosen of a camera's.

use edgecap::capture::PixelFormat;
use edgecap::capture::camera::{Mode, choose_mode};
use edgecap::capture::{InputSpec, OpenOptions, open};

#[test]
fn devices_that_are_no_camera_are_refused() {
    for (path, code) in [("/dev/null", 65), ("/dev/video4095", 69)] {
        let error = open(&InputSpec::Path(path.into()), &OpenOptions::default())
            .err()
            .unwrap();
        assert_eq!(error.exit_code(), code, "{error}");
        assert!(error.to_string().contains(path));
    }
}

fn mode(format: PixelFormat, width: u32, height: u32, fps: f64) -> Mode {
    Mode {
        format,
        fourcc: *b"....",
        width,
        height,
        fps,
    }
}

#[test]
fn modes_are_chosen_for_rate_size_and_cost() {
    use PixelFormat::{Mjpeg, Nv12, Yuyv};
    // A common USB 2 webcam: large pictures are fast with MJPEG only.
    let webcam = [
        mode(Yuyv, 640, 480, 30.0),
        mode(Yuyv, 1280, 720, 10.0),
        mode(Yuyv, 160, 120, 60.0),
        mode(Mjpeg, 640, 480, 30.0),
        mode(Mjpeg, 1280, 720, 30.0),
        mode(Mjpeg, 1920, 1080, 30.0),
    ];
    assert_eq!(choose_mode(&webcam, (1280, 720), 30.0), Some(webcam[4]));
    assert_eq!(choose_mode(&webcam, (640, 480), 30.0), Some(webcam[0]));
    assert_eq!(choose_mode(&webcam, (1280, 720), 10.0), Some(webcam[1]));
    assert_eq!(choose_mode(&webcam, (4000, 3000), 30.0), Some(webcam[5]));
    // Without MJPEG a smaller picture at full rate is better than a slide show.
    assert_eq!(
        choose_mode(&webcam[..3], (1280, 720), 30.0),
        Some(webcam[0])
    );
    // A driver that keeps its rates to itself is not passed over.
    let silent = [mode(Nv12, 1280, 720, 0.0), mode(Yuyv, 1280, 720, 15.0)];
    assert_eq!(choose_mode(&silent, (1280, 720), 30.0), Some(silent[0]));
    assert_eq!(choose_mode(&[], (1280, 720), 30.0), None);
}
