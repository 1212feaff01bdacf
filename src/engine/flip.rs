//! The flip test: a picture and its mirror image go through the network, the mean of what it says of both comes out.

use edgecap_client::joints::{
    BODY_JOINTS, EVIDENCE_JOINTS, LIMB_JOINTS, LIMBS, MIRROR, MIRROR_BODY, limb_to,
};

use super::maps::{HEAD2D_CHANNELS, HEAD3D_CHANNELS, Maps};
use super::run::Engine;

/// A channel of the mirror image's maps, and the factor that turns it into one of the picture's.
type Channel = (usize, f32);

/// What the mirror image says under another channel: left is right, and what points across points the other way.
const HEAD2D: [Channel; HEAD2D_CHANNELS] = {
    let mut from = [(0, 1.0); HEAD2D_CHANNELS];
    let mut j = 0;
    while j < EVIDENCE_JOINTS {
        from[j] = (MIRROR[j], 1.0);
        j += 1;
    }
    let mut limb = 0;
    while limb < LIMBS {
        let across = EVIDENCE_JOINTS + 2 * other_side(limb);
        from[EVIDENCE_JOINTS + 2 * limb] = (across, -1.0);
        from[EVIDENCE_JOINTS + 2 * limb + 1] = (across + 1, 1.0);
        limb += 1;
    }
    from
};
const HEAD3D: [Channel; HEAD3D_CHANNELS] = {
    let mut from = [(0, 1.0); HEAD3D_CHANNELS];
    let mut j = 0;
    while j < BODY_JOINTS {
        let across = 3 * MIRROR_BODY[j];
        from[3 * j] = (across, -1.0);
        from[3 * j + 1] = (across + 1, 1.0);
        from[3 * j + 2] = (across + 2, 1.0);
        j += 1;
    }
    from
};

/// The limb on the other side of the body (itself on the midline).
const fn other_side(limb: usize) -> usize {
    limb_to(MIRROR[LIMB_JOINTS[limb].0])
}

/// Runs an engine over a picture and its mirror image and takes the mean of the maps: the flip test of pose estimation
/// (Newell et al., ECCV 2016, Training Details). Twice the time of one run. A picture's mirror image gets exactly the
/// mirrored maps.
#[derive(Debug, Clone, Default)]
pub struct FlipTest {
    mirrored: Vec<u8>,
    maps: Maps,
}

impl FlipTest {
    /// The mean over `rgb`, row-major `[height, width, 3]`, and its mirror image. Allocates nothing after the first
    /// call.
    ///
    /// # Panics
    /// When `rgb` is not of the engine's size.
    pub fn run(&mut self, engine: &mut Engine, rgb: &[u8]) -> &Maps {
        let maps = engine.run(rgb);
        let width = maps.width * Maps::STRIDE;
        // Field by field: the derived `clone_from` would allocate.
        (self.maps.width, self.maps.height) = (maps.width, maps.height);
        self.maps.head2d.clone_from(&maps.head2d);
        self.maps.head3d.clone_from(&maps.head3d);
        mirror_picture(rgb, width, &mut self.mirrored);
        let other = engine.run(&self.mirrored);
        average(&mut self.maps.head2d, &other.head2d, other.width, &HEAD2D);
        average(&mut self.maps.head3d, &other.head3d, other.width, &HEAD3D);
        &self.maps
    }
}

/// Left and right of every row of `rgb`, `width` pixels of 3 bytes, exchanged into `mirrored`.
fn mirror_picture(rgb: &[u8], width: usize, mirrored: &mut Vec<u8>) {
    mirrored.resize(rgb.len(), 0);
    let rows = rgb
        .chunks_exact(3 * width)
        .zip(mirrored.chunks_exact_mut(3 * width));
    for (from, to) in rows {
        let pixels = from.chunks_exact(3).rev().zip(to.as_chunks_mut::<3>().0);
        for (a, b) in pixels {
            b.copy_from_slice(a);
        }
    }
}

/// The mean of `maps` `[height, width, N]` and of `other`, which was read off the mirror image.
fn average<const N: usize>(maps: &mut [f32], other: &[f32], width: usize, from: &[Channel; N]) {
    let rows = maps
        .as_chunks_mut::<N>()
        .0
        .chunks_exact_mut(width)
        .zip(other.as_chunks::<N>().0.chunks_exact(width));
    for (row, mirrored) in rows {
        for (cell, opposite) in row.iter_mut().zip(mirrored.iter().rev()) {
            for (value, (channel, factor)) in cell.iter_mut().zip(from) {
                *value = 0.5 * (*value + factor * opposite[*channel]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use edgecap_client::joints::JOINT_NAMES;

    use super::*;
    use crate::engine::{EngineOptions, Model, Network, Precision};

    /// The name with left and right exchanged.
    fn across(name: &str) -> String {
        match name.split_at(2) {
            ("l_", rest) => format!("r_{rest}"),
            ("r_", rest) => format!("l_{rest}"),
            _ => name.to_owned(),
        }
    }

    #[test]
    fn channels_follow_the_names_of_the_joints() {
        for j in 0..BODY_JOINTS {
            assert_eq!(JOINT_NAMES[MIRROR_BODY[j]], across(JOINT_NAMES[j]));
            for axis in 0..3 {
                let sign = if axis == 0 { -1.0 } else { 1.0 };
                assert_eq!(HEAD3D[3 * j + axis], (3 * MIRROR_BODY[j] + axis, sign));
            }
        }
        for j in 0..EVIDENCE_JOINTS {
            assert_eq!(HEAD2D[j], (MIRROR_BODY[j], 1.0));
        }
        for (limb, (child, parent)) in LIMB_JOINTS.iter().enumerate() {
            let (x, sign) = HEAD2D[EVIDENCE_JOINTS + 2 * limb];
            let (y, same) = HEAD2D[EVIDENCE_JOINTS + 2 * limb + 1];
            let (a, b) = LIMB_JOINTS[(x - EVIDENCE_JOINTS) / 2];
            assert_eq!((x + 1, sign, same), (y, -1.0, 1.0));
            assert_eq!(JOINT_NAMES[a], across(JOINT_NAMES[*child]));
            assert_eq!(JOINT_NAMES[b], across(JOINT_NAMES[*parent]));
        }
    }

    #[test]
    fn the_mean_of_two_maps_is_that_of_opposite_cells() {
        // One row of two cells, three channels of which the last two are each other's opposites.
        let from = [(0, -1.0), (2, 1.0), (1, 1.0)];
        let mut maps = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        average(&mut maps, &[10.0, 20.0, 30.0, 40.0, 50.0, 60.0], 2, &from);
        assert_eq!(maps, [-19.5, 31.0, 26.5, -3.0, 17.5, 13.0]);
    }

    #[test]
    fn a_mirror_image_gets_the_mirrored_maps() {
        let model = Model::random(Network::shipped("selecsls").unwrap(), 3);
        let (width, height) = (96, 64);
        let options = EngineOptions {
            width,
            height,
            threads: 1,
            precision: Precision::F32,
            ..EngineOptions::default()
        };
        let mut engine = Engine::new(&model, options).unwrap();
        let rgb: Vec<u8> = (0..3 * width * height)
            .map(|i| (i * i / 7 % 251) as u8)
            .collect();
        let mut mirrored = Vec::new();
        mirror_picture(&rgb, width, &mut mirrored);
        assert_ne!(rgb, mirrored);
        let once = engine.run(&rgb).clone();
        let seen = FlipTest::default().run(&mut engine, &rgb).clone();
        let other = FlipTest::default().run(&mut engine, &mirrored).clone();
        assert_ne!(once, seen);
        let opposite = |row: usize, column: usize| row * seen.width + seen.width - 1 - column;
        for row in 0..seen.height {
            for column in 0..seen.width {
                let (a, b) = (row * seen.width + column, opposite(row, column));
                for (c, (k, sign)) in HEAD2D.iter().enumerate() {
                    let (p, q) = (a * HEAD2D_CHANNELS + c, b * HEAD2D_CHANNELS + k);
                    assert_eq!(seen.head2d[p], sign * other.head2d[q]);
                }
                for (c, (k, sign)) in HEAD3D.iter().enumerate() {
                    let (p, q) = (a * HEAD3D_CHANNELS + c, b * HEAD3D_CHANNELS + k);
                    assert_eq!(seen.head3d[p], sign * other.head3d[q]);
                }
            }
        }
    }
}
