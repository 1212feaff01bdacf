//! Trunk with its clothes, skirt and bag.

use glam::{Quat, Vec3};

use super::Sculptor;
use crate::joints::L_SHOULDER;
use crate::lab::synth::outfit::Matter;
use crate::lab::synth::shape::Bone;

impl Sculptor<'_> {
    /// Trunk, top and the upper end of the trousers.
    pub(super) fn trunk(&mut self) {
        let (u, limb, fat, outfit) = (self.u, self.limb, self.fat, self.outfit);
        let bulk = self.shape.bulk;
        let shoulder = self.shoulder();
        self.stack(self.slice(0.0, 1.0, 0.0), 0.02, Matter::Skin, Bone::Chest);
        if !outfit.bare_chest {
            let rows = self.slice(outfit.hem, outfit.collar.min(0.83), outfit.top_ease);
            self.stack(rows, 0.015, Matter::Top, Bone::Chest);
        }
        let rows = self.slice(0.0, outfit.hem.max(0.57), outfit.bottom_ease.min(0.012));
        self.stack(rows, 0.015, Matter::Bottom, Bone::Pelvis);
        let bust = outfit.top_ease * 0.5;
        for s in [-1.0, 1.0] {
            let cover = if outfit.bare_chest {
                Matter::Skin
            } else {
                Matter::Top
            };
            // chest and trapezius
            let r = self.mix(0.032, 0.034 + 0.006 * bulk) * u + bust;
            self.egg(
                self.at(s * 0.044, self.mix(0.745, 0.733), self.mix(0.036, 0.046)),
                Vec3::new(r * 1.15, r, r * self.mix(0.75, 1.0)),
                Quat::IDENTITY,
                0.025,
                cover,
                Bone::Chest,
            );
            self.cone(
                [
                    self.at(s * 0.014, 0.838, -0.010),
                    self.at(s * 0.88 * shoulder, 0.792, -0.006),
                ],
                [0.021 * u, 0.021 * limb],
                0.025,
                Matter::Skin,
                Bone::Chest,
            );
            // buttock
            let r = self.mix(0.046, 0.051) * u * fat + outfit.bottom_ease * 0.4;
            self.egg(
                self.at(s * 0.046, 0.502, -0.030),
                Vec3::new(r, r * 1.1, r),
                Quat::IDENTITY,
                0.03,
                Matter::Bottom,
                Bone::Pelvis,
            );
        }
    }

    /// Half the width between the shoulders, in units of stature.
    fn shoulder(&self) -> f32 {
        self.shape.joints[L_SHOULDER].x / self.u
    }

    /// The naked trunk in units of stature: height, half width, half depth, centre z.
    fn profile(&self) -> [[f32; 4]; 13] {
        let belly = self.shape.bulk.max(0.0);
        let shoulder = self.shoulder();
        [
            // height, half width, half depth, centre z
            [0.485, 0.080, 0.055, -0.006],
            [0.500, self.mix(0.094, 0.101), 0.066, -0.008],
            [0.520, self.mix(0.098, 0.106), 0.070, -0.009],
            [0.550, self.mix(0.095, 0.100), 0.067, -0.005],
            [
                0.585,
                self.mix(0.088, 0.086) + 0.010 * belly,
                0.060 + 0.020 * belly,
                0.002 + 0.014 * belly,
            ],
            [
                0.620,
                self.mix(0.083, 0.074) + 0.014 * belly,
                self.mix(0.058, 0.053) + 0.024 * belly,
                0.003 + 0.018 * belly,
            ],
            [
                0.665,
                self.mix(0.087, 0.077) + 0.010 * belly,
                self.mix(0.062, 0.056) + 0.014 * belly,
                0.001 + 0.010 * belly,
            ],
            [0.710, self.mix(0.096, 0.085), self.mix(0.067, 0.060), 0.001],
            [0.745, self.mix(0.101, 0.089), self.mix(0.067, 0.059), 0.000],
            [0.775, 0.90 * shoulder, 0.056, -0.004],
            [0.798, 0.72 * shoulder, 0.045, -0.006],
            [0.818, 0.052, 0.038, -0.006],
            [0.832, 0.035, 0.034, -0.004],
        ]
    }

    /// The part of the trunk between two heights, `ease` metres wider.
    fn slice(&self, from: f32, to: f32, ease: f32) -> Vec<[f32; 4]> {
        let (u, fat, profile) = (self.u, self.fat, self.profile());
        let row = |r: &[f32; 4]| {
            let p = self.at(0.0, r[0], r[3]);
            [p.y, r[1] * u * fat + ease, r[2] * u * fat + ease, p.z]
        };
        let mut rows: Vec<[f32; 4]> = profile
            .iter()
            .filter(|r| r[0] > from && r[0] < to)
            .map(row)
            .collect();
        // end exactly at the hem and the collar
        for (y, front) in [(from, true), (to, false)] {
            let k = profile.partition_point(|r| r[0] < y);
            if k == 0 || k == profile.len() {
                continue;
            }
            let (a, b) = (profile[k - 1], profile[k]);
            let t = (y - a[0]) / (b[0] - a[0]);
            let r = row(&[
                y,
                a[1] + (b[1] - a[1]) * t,
                a[2] + (b[2] - a[2]) * t,
                a[3] + (b[3] - a[3]) * t,
            ]);
            if front {
                rows.insert(0, r)
            } else {
                rows.push(r)
            }
        }
        rows
    }

    /// Skirt, if there is one.
    pub(super) fn skirt(&mut self) {
        let (u, fat, outfit) = (self.u, self.fat, self.outfit);
        if let Some(length) = outfit.skirt {
            let y = 0.518 - 0.235 * length.min(1.0) - 0.24 * (length - 1.0).max(0.0);
            let wide = 0.118 + 0.02 * length + 0.03 * outfit.flare.max(0.0);
            let rows = [
                [y, wide, 0.082 + 0.02 * length, 0.0],
                [0.5 * (y + 0.52), 0.5 * (wide + 0.112), 0.086, -0.004],
                [0.520, self.mix(0.104, 0.112), 0.080, -0.006],
                [0.575, 0.094, 0.066, 0.0],
            ]
            .map(|r| {
                let p = self.at(0.0, r[0], r[3]);
                [p.y, r[1] * u * fat, r[2] * u * fat, p.z]
            });
            self.stack(rows.to_vec(), 0.01, Matter::Bottom, Bone::Pelvis);
        }
    }

    /// Rucksack, if there is one.
    pub(super) fn bag(&mut self) {
        let (u, outfit) = (self.u, self.outfit);
        if outfit.bag {
            self.egg(
                self.at(0.0, 0.715, -0.105),
                Vec3::new(0.082, 0.115, 0.058) * u,
                Quat::IDENTITY,
                0.008,
                Matter::Bag,
                Bone::Chest,
            );
        }
    }
}
