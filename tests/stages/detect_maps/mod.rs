//! Perfect maps of random people, as the training target defines them: Gaussian heatmaps and constant-width affinity
//! fields at stride 8, both scaled with the person. Shared by the association's tests and its bench.

use edgecap::engine::{HEAD2D_CHANNELS, HEAD3D_CHANNELS, Maps};
use edgecap::joints::{EVIDENCE_JOINTS, LIMB_JOINTS, LIMBS};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

/// Limb lengths over stature.
const LENGTH: [f32; LIMBS] = [
    0.18, 0.11, 0.17, 0.15, 0.11, 0.17, 0.15, 0.31, 0.24, 0.24, 0.31, 0.24, 0.24,
];
/// Direction of each limb, parent to child, of a standing person facing the camera, degrees clockwise from the right.
const DIRECTION: [f32; LIMBS] = [
    -90.0, 170.0, 100.0, 95.0, 10.0, 80.0, 85.0, 98.0, 92.0, 90.0, 82.0, 88.0, 90.0,
];

/// One drawn person, network input pixels.
#[derive(Debug, Clone)]
pub struct Figure {
    pub joints: [[f32; 2]; EVIDENCE_JOINTS],
    pub stature: f32,
}

impl Figure {
    /// A random pose: limbs turned up to 70° from standing and foreshortened down to half.
    pub fn random(rng: &mut SmallRng, neck: [f32; 2], stature: f32) -> Self {
        let mut joints = [[0.0; 2]; EVIDENCE_JOINTS];
        joints[1] = neck;
        for (limb, &(child, parent)) in LIMB_JOINTS.iter().enumerate() {
            let free = if parent == 1 { 20.0 } else { 70.0 };
            let angle = (DIRECTION[limb] + rng.random_range(-free..free)).to_radians();
            let length = stature * LENGTH[limb] * rng.random_range(0.5..1.0);
            joints[child] = [
                joints[parent][0] + length * angle.cos(),
                joints[parent][1] + length * angle.sin(),
            ];
        }
        Self { joints, stature }
    }

    /// All joints at least `margin` pixels inside.
    pub fn fits(&self, width: f32, height: f32, margin: f32) -> bool {
        self.joints.iter().all(|j| {
            j[0] > margin && j[1] > margin && j[0] < width - margin && j[1] < height - margin
        })
    }

    /// Every joint at least `cells` away from the same joint of the other: nearer ones merge into one peak.
    pub fn is_apart(&self, other: &Self, cells: f32) -> bool {
        let least = cells * Maps::STRIDE as f32;
        self.joints
            .iter()
            .zip(&other.joints)
            .all(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) >= least)
    }
}

/// Up to `count` people who may cross and overlap, in a 512 × 320 picture.
pub fn crowd(count: usize, seed: u64) -> Vec<Figure> {
    let mut rng = SmallRng::seed_from_u64(seed);
    let mut people: Vec<Figure> = Vec::new();
    for _ in 0..400 {
        if people.len() == count {
            break;
        }
        let stature = rng.random_range(90.0..260.0);
        let neck = [rng.random_range(20.0..492.0), rng.random_range(20.0..200.0)];
        let figure = Figure::random(&mut rng, neck, stature);
        if figure.fits(512.0, 320.0, 6.0) && people.iter().all(|p| p.is_apart(&figure, 3.5)) {
            people.push(figure);
        }
    }
    people
}

/// The training target of these people for a 512 × 320 picture; encoding channel 0 holds 1 + the person's index round
/// each of his joints.
pub fn render(people: &[Figure]) -> Maps {
    let mut maps = Maps::new(64, 40);
    let cell = |p: [f32; 2]| [(p[0] - 3.5) / 8.0, (p[1] - 3.5) / 8.0];
    for row in 0..maps.height {
        for column in 0..maps.width {
            let i = row * maps.width + column;
            let mut nearest = f32::INFINITY;
            let mut count = [0.0_f32; LIMBS];
            let values = &mut maps.head2d[i * HEAD2D_CHANNELS..][..HEAD2D_CHANNELS];
            for (who, person) in people.iter().enumerate() {
                let sigma = (person.stature / 150.0).clamp(0.85, 1.7);
                for (j, &p) in person.joints.iter().enumerate() {
                    let [x, y] = cell(p);
                    let d2 = (column as f32 - x).powi(2) + (row as f32 - y).powi(2);
                    let blob = (-0.5 * d2 / (sigma * sigma)).exp();
                    if blob >= 0.01 {
                        values[j] = values[j].max(blob);
                    }
                    if d2.sqrt() < 1.15 * sigma && d2 < nearest {
                        nearest = d2;
                        maps.head3d[i * HEAD3D_CHANNELS] = 1.0 + who as f32;
                    }
                }
                let reach = (person.stature / 160.0).clamp(0.75, 1.5);
                for (limb, &(child, parent)) in LIMB_JOINTS.iter().enumerate() {
                    let (a, b) = (cell(person.joints[child]), cell(person.joints[parent]));
                    let length = (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-3);
                    let (ux, uy) = ((b[0] - a[0]) / length, (b[1] - a[1]) / length);
                    let (dx, dy) = (column as f32 - a[0], row as f32 - a[1]);
                    let (along, across) = (dx * ux + dy * uy, (dx * uy - dy * ux).abs());
                    if along > -0.4 && along < length + 0.4 && across <= reach {
                        values[EVIDENCE_JOINTS + 2 * limb] += ux;
                        values[EVIDENCE_JOINTS + 2 * limb + 1] += uy;
                        count[limb] += 1.0;
                    }
                }
            }
            for (limb, n) in count.iter().enumerate() {
                values[EVIDENCE_JOINTS + 2 * limb] /= n.max(1.0);
                values[EVIDENCE_JOINTS + 2 * limb + 1] /= n.max(1.0);
            }
        }
    }
    maps
}
