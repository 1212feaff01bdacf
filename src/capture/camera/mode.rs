//! Which of a camera's many formats, sizes and rates to ask for.

use std::io;

use crate::capture::decode::PixelFormat;

/// One combination that a camera offers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// What the bytes are.
    pub format: PixelFormat,
    /// V4L2's four letters for it.
    pub fourcc: [u8; 4],
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Most pictures per second at this size; 0 when the camera does not say.
    pub fps: f64,
}

/// Rates within this factor count as equal: 29.97 is as good as 30.
const SAME_RATE: f64 = 0.95;

/// How far from the closest size a mode may lie to be chosen for its rate: 640 × 480 for 1280 × 720, but no stamp.
const NEAR: f64 = 3.5;

/// The mode closest to the wish: of sizes near it those that reach the rate, or come closest to it; of these the
/// closest size (rather larger than smaller); of these the format that is cheapest to decode. `None` without modes.
pub fn choose_mode(modes: &[Mode], size: (u32, u32), fps: f64) -> Option<Mode> {
    let size_distance = |m: &Mode| {
        let step = |have: u32, want: u32| {
            let (have, want) = (f64::from(have.max(1)), f64::from(want.max(1)));
            // Too small loses detail for good, too large costs a little time.
            let ratio = (have / want).log2();
            if ratio < 0.0 { -2.0 * ratio } else { ratio }
        };
        step(m.width, size.0) + step(m.height, size.1)
    };
    let closest = modes
        .iter()
        .map(size_distance)
        .fold(f64::INFINITY, f64::min);
    let reach = |m: &Mode| {
        // A camera that does not say is taken at its word to be fast enough.
        let fps_known = if m.fps > 0.0 { m.fps } else { fps };
        (fps_known / fps.max(1e-3)).min(1.0)
    };
    let near: Vec<&Mode> = modes
        .iter()
        .filter(|m| size_distance(m) <= closest + NEAR)
        .collect();
    let best_rate = near.iter().map(|m| reach(m)).fold(0.0, f64::max);
    near.into_iter()
        .filter(|m| reach(m) >= SAME_RATE * best_rate)
        .min_by(|a, b| {
            size_distance(a)
                .total_cmp(&size_distance(b))
                .then(a.format.cost().cmp(&b.format.cost()))
        })
        .copied()
}

/// The mode closest to the wish and, where that one is not compressed, the closest of those that are: other cameras on
/// the same bus may leave room for no other. A size that is `named` counts for more than the rate. `None` without
/// modes.
pub(crate) fn candidates(
    modes: &[Mode],
    size: (u32, u32),
    named: bool,
    fps: f64,
) -> Option<(Mode, Option<Mode>)> {
    let closest = |may: &dyn Fn(&Mode) -> bool| {
        let mut offered: Vec<Mode> = modes.iter().filter(|m| may(m)).copied().collect();
        let is_exact = |m: &Mode| (m.width, m.height) == size;
        if named && offered.iter().any(is_exact) {
            offered.retain(is_exact);
        }
        choose_mode(&offered, size, fps)
    };
    let first = closest(&|_| true)?;
    let is_compressed = |m: &Mode| m.format.is_compressed();
    let second = (!is_compressed(&first))
        .then(|| closest(&is_compressed))
        .flatten();
    Some((first, second))
}

/// Starts a camera in the first mode or, where its bus has no room for that, in the second. `start` gives the system's
/// answer, or why it could not be asked.
pub(crate) fn with_room<T, E>(
    (first, second): (Mode, Option<Mode>),
    mut start: impl FnMut(Mode) -> Result<io::Result<T>, E>,
) -> Result<io::Result<T>, E> {
    let started = start(first)?;
    match (&started, second) {
        (Err(e), Some(second)) if e.raw_os_error() == Some(libc::ENOSPC) => start(second),
        _ => Ok(started),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn on_a_full_bus_a_camera_compresses() {
        use PixelFormat::{Mjpeg, Yuyv};
        let webcam = [
            mode(Yuyv, 640, 480, 30.0),
            mode(Mjpeg, 640, 480, 30.0),
            mode(Mjpeg, 1280, 720, 30.0),
            mode(Yuyv, 960, 720, 10.0),
        ];
        let [yuyv, mjpeg, large, slow] = webcam;
        let of = |modes: &[Mode], size, named| candidates(modes, size, named, 30.0);
        assert_eq!(of(&webcam, (640, 480), true), Some((yuyv, Some(mjpeg))));
        assert_eq!(of(&webcam, (1280, 720), false), Some((large, None)));
        // The named size counts for more than the rate, and none that is compressed has it.
        assert_eq!(of(&webcam, (960, 720), true), Some((slow, Some(large))));
        assert_eq!(of(&webcam[..1], (640, 480), true), Some((yuyv, None)));
        assert_eq!(of(&[], (640, 480), true), None);

        let started = |refusals: &[Option<i32>]| {
            let mut refusals = refusals.iter();
            let mut asked = Vec::new();
            let answer = with_room((yuyv, Some(mjpeg)), |mode| {
                asked.push(mode);
                let code = *refusals.next().expect("asked no more often");
                Ok::<_, ()>(code.map_or(Ok(()), |code| Err(io::Error::from_raw_os_error(code))))
            });
            let code = answer.unwrap().err().and_then(|e| e.raw_os_error());
            (asked, code)
        };
        assert_eq!(started(&[None]), (vec![yuyv], None));
        let no_room = Some(libc::ENOSPC);
        assert_eq!(started(&[no_room, None]), (vec![yuyv, mjpeg], None));
        let (asked, code) = started(&[no_room, no_room]);
        assert_eq!((asked.len(), code), (2, no_room));
        assert_eq!(started(&[Some(libc::EIO)]), (vec![yuyv], Some(libc::EIO)));
    }
}
