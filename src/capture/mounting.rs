//! How a camera is mounted: its picture goes in, an upright one comes out, with the lens that belongs to it.

use std::ops::Sub;

use edgecap_client::message::Intrinsics;
use glam::DVec2;

use super::frame::Frame;
use crate::camera::Brown;

/// Pixels that are turned at once, across and down: rows of both pictures then stay in the cache.
const TILE: usize = 32;

/// What has to be done to a camera's picture: first the mirror image where the camera shows one, then quarter turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Mounting {
    /// Clockwise quarter turns that put the picture upright, 0 to 3.
    pub quarter_turns: u8,
    /// The camera shows a mirror image, which is mirrored back.
    pub mirrored: bool,
}

impl Mounting {
    /// Every way of turning a picture upright, that of leaving it first.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..8).map(|k| Self {
            quarter_turns: k % 4,
            mirrored: k > 3,
        })
    }

    /// Whether the picture stays as it is.
    pub fn is_plain(self) -> bool {
        self == Self::default()
    }

    /// Width and height of the camera's own picture, given those of the upright one, or the other way round.
    pub fn size(self, width: u32, height: u32) -> (u32, u32) {
        if self.quarter_turns % 2 == 1 {
            (height, width)
        } else {
            (width, height)
        }
    }

    /// What has to be done to an upright picture to have the camera's own again.
    pub fn undoing(self) -> Self {
        let quarter_turns = match self.mirrored {
            // A mirror image that is turned is mirrored back and turned back by the same.
            true => self.quarter_turns % 4,
            false => (4 - self.quarter_turns % 4) % 4,
        };
        Self {
            quarter_turns,
            ..self
        }
    }

    /// The distortion of upright pictures, given that of the camera's own. Its tangential part is a direction in the
    /// picture, p2 across and p1 down, and turns as such.
    pub fn distortion(self, own: Brown) -> Brown {
        let [p1, p2] = own.tangential;
        let across = if self.mirrored { -p2 } else { p2 };
        let turns = 0..self.quarter_turns % 4;
        let turned = turns.fold(DVec2::new(across, p1), |vector, _| vector.perp());
        Brown {
            tangential: [turned.y, turned.x],
            ..own
        }
    }

    /// Puts a picture upright; `spare` is memory for it.
    ///
    /// # Panics
    /// When `frame` has not `3 * width * height` bytes.
    pub fn apply(self, frame: &mut Frame, spare: &mut Vec<u8>) {
        if self.is_plain() {
            return;
        }
        let (w, h) = (frame.width as usize, frame.height as usize);
        assert_eq!(frame.rgb.len(), 3 * w * h, "bytes of the picture");
        let (width, height) = self.size(frame.width, frame.height);
        spare.resize(frame.rgb.len(), 0);
        let (from, _) = frame.rgb.as_chunks::<3>();
        let (to, _) = spare.as_chunks_mut::<3>();
        let across = width as usize;
        for top in (0..h).step_by(TILE) {
            for left in (0..w).step_by(TILE) {
                for y in top..(top + TILE).min(h) {
                    for x in left..(left + TILE).min(w) {
                        let [u, v] = self.place([x, y], [w, h]);
                        to[v * across + u] = from[y * w + x];
                    }
                }
            }
        }
        std::mem::swap(&mut frame.rgb, spare);
        (frame.width, frame.height) = (width, height);
    }

    /// Where a pixel of a `w` × `h` picture goes.
    fn place(self, at: [usize; 2], [w, h]: [usize; 2]) -> [usize; 2] {
        self.turned(at, [w - 1, h - 1])
    }

    /// Where a point of a picture of this size (pixels across and down) goes, in pixels whose centres are whole
    /// numbers.
    pub fn point(self, [x, y]: [f32; 2], (width, height): (u32, u32)) -> [f32; 2] {
        self.turned([x, y], [width as f32 - 1.0, height as f32 - 1.0])
    }

    /// Where a direction in the picture goes, x right and y down.
    pub fn direction(self, direction: [f32; 2]) -> [f32; 2] {
        self.turned(direction, [0.0, 0.0])
    }

    /// A point of a picture whose last pixel is `right`, `bottom`.
    fn turned<T>(self, [x, y]: [T; 2], [right, bottom]: [T; 2]) -> [T; 2]
    where
        T: Copy + Sub<Output = T>,
    {
        let x = if self.mirrored { right - x } else { x };
        match self.quarter_turns % 4 {
            0 => [x, y],
            1 => [bottom - y, x],
            2 => [right - x, bottom - y],
            _ => [y, right - x],
        }
    }

    /// The lens of the upright picture, given that of the camera's own picture of `width` × `height`.
    pub fn intrinsics(self, lens: Intrinsics, width: u32, height: u32) -> Intrinsics {
        let [cx, cy] = self.point([lens.cx, lens.cy], (width, height));
        let (fx, fy) = if self.quarter_turns % 2 == 1 {
            (lens.fy, lens.fx)
        } else {
            (lens.fx, lens.fy)
        };
        Intrinsics { fx, fy, cx, cy }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_turn_clockwise_after_they_are_mirrored_back() {
        let picture = |width, height, reds: [u8; 6]| Frame {
            width,
            height,
            rgb: reds.iter().flat_map(|r| [*r, 0, 9]).collect(),
            ..Frame::default()
        };
        let turned = |quarter_turns, mirrored| {
            let mut frame = picture(3, 2, [1, 2, 3, 4, 5, 6]);
            let mounting = Mounting {
                quarter_turns,
                mirrored,
            };
            mounting.apply(&mut frame, &mut Vec::new());
            frame
        };
        assert_eq!(turned(0, false), picture(3, 2, [1, 2, 3, 4, 5, 6]));
        assert_eq!(turned(1, false), picture(2, 3, [4, 1, 5, 2, 6, 3]));
        assert_eq!(turned(2, false), picture(3, 2, [6, 5, 4, 3, 2, 1]));
        assert_eq!(turned(3, false), picture(2, 3, [3, 6, 2, 5, 1, 4]));
        assert_eq!(turned(0, true), picture(3, 2, [3, 2, 1, 6, 5, 4]));
        assert_eq!(turned(1, true), picture(2, 3, [6, 3, 5, 2, 4, 1]));
    }

    #[test]
    fn the_lens_turns_with_the_picture() {
        let lens = Intrinsics {
            fx: 900.0,
            fy: 910.0,
            cx: 620.0,
            cy: 350.0,
        };
        let (w, h) = (1280usize, 720usize);
        for mounting in Mounting::all() {
            let upright = mounting.intrinsics(lens, w as u32, h as u32);
            for at in [[0, 0], [1279, 0], [620, 350], [17, 700]] {
                let [u, v] = mounting.place(at, [w, h]);
                // Distances from the principal point in focal lengths are those of the camera's own picture.
                let mut own = [
                    (at[0] as f32 - lens.cx) / lens.fx,
                    (at[1] as f32 - lens.cy) / lens.fy,
                ];
                let mut now = [
                    (u as f32 - upright.cx) / upright.fx,
                    (v as f32 - upright.cy) / upright.fy,
                ];
                if mounting.quarter_turns % 2 == 1 {
                    now.swap(0, 1);
                }
                (own, now) = (own.map(f32::abs), now.map(f32::abs));
                for k in 0..2 {
                    assert!((own[k] - now[k]).abs() < 1e-5, "{mounting:?} {at:?}");
                }
            }
        }
    }

    #[test]
    fn large_pictures_turn_whole_and_back() {
        let (width, height) = (77, 45);
        let rgb: Vec<u8> = (0..3 * width * height).map(|i| (i % 251) as u8).collect();
        let before = Frame {
            width,
            height,
            rgb,
            ..Frame::default()
        };
        for mounting in Mounting::all() {
            let mut frame = before.clone();
            let mut spare = Vec::new();
            mounting.apply(&mut frame, &mut spare);
            assert_eq!((frame.width, frame.height), mounting.size(width, height));
            let back = Mounting {
                // A mirror image turns the other way.
                quarter_turns: if mounting.mirrored {
                    0
                } else {
                    (4 - mounting.quarter_turns) % 4
                },
                mirrored: false,
            };
            if mounting.mirrored {
                let turned_back = Mounting {
                    quarter_turns: (4 - mounting.quarter_turns) % 4,
                    mirrored: false,
                };
                turned_back.apply(&mut frame, &mut spare);
                let mirror = Mounting {
                    quarter_turns: 0,
                    mirrored: true,
                };
                mirror.apply(&mut frame, &mut spare);
            }
            back.apply(&mut frame, &mut spare);
            assert_eq!(frame, before, "{mounting:?}");
        }
    }
}
