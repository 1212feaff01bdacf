//! Neck, skull and face.

use glam::{Quat, Vec3};

use super::{Lump, Sculptor, hair};
use crate::lab::synth::outfit::Matter;
use crate::lab::synth::shape::Bone;

impl Sculptor<'_> {
    /// Neck, head and what grows or sits on it.
    pub(super) fn head(&mut self) {
        let (u, shape) = (self.u, self.shape);
        let neck = (0.0335 - 0.005 * shape.feminine + 0.003 * shape.muscle)
            * (1.0 + 0.12 * shape.bulk.max(0.0));
        self.cone(
            [self.at(0.0, 0.815, -0.006), self.at(0.0, 0.845, 0.0)],
            [neck * 1.1 * u, neck * u],
            0.02,
            Matter::Skin,
            Bone::Chest,
        );
        self.cone(
            [self.at(0.0, 0.845, 0.0), self.at(0.0, 0.892, 0.012)],
            [neck * u, neck * 0.95 * u],
            0.015,
            Matter::Skin,
            Bone::Head,
        );
        let jaw = 1.0 + 0.10 * shape.bulk.max(0.0);
        let face = [
            // skull, jaw, chin, nose
            [0.0, 0.942, 0.012, 0.0435, 0.058, 0.0545, 0.0, 0.01],
            [0.0, 0.905, 0.03, 0.035 * jaw, 0.0375, 0.036, 0.15, 0.02],
            [0.0, 0.88, 0.046, 0.0165, 0.012, 0.014, 0.0, 0.015],
            [0.0, 0.915, 0.0665, 0.0072, 0.016, 0.0095, -0.35, 0.006],
        ];
        let ears = [-0.044, 0.044].map(|x| [x, 0.92, 0.008, 0.0045, 0.0165, 0.01, 0.2, 0.004]);
        let (hair, hat) = hair::worn(self.outfit.hair);
        self.lumps(&face, Matter::Skin);
        self.lumps(&ears, Matter::Skin);
        self.lumps(hair, Matter::Hair);
        self.lumps(hat, Matter::Hat);
    }

    fn lumps(&mut self, lumps: &[Lump], matter: Matter) {
        for &[x, y, z, a, b, c, tilt, soft] in lumps {
            let radii = Vec3::new(a, b, c) * self.u;
            let turn = Quat::from_rotation_x(tilt);
            self.egg(self.at(x, y, z), radii, turn, soft, matter, Bone::Head);
        }
    }
}
