//! Pictures of a board as a known camera takes them: distortion, blur and noise.

use calib_targets_charuco::resolve_dictionary;
use edgecap::camera::View;
use glam::{DMat3, DVec2, DVec3};
use image::RgbImage;
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

/// Samples of a pixel, along each side.
const SAMPLES: usize = 2;
/// Standard deviation of the blur, pixels.
const BLUR: f64 = 0.8;
/// Standard deviation of the noise, grey values.
const NOISE: f64 = 3.0;
/// Grey values of black, of white and of what lies around.
const BLACK: f64 = 40.0;
const WHITE: f64 = 215.0;
const AROUND: f64 = 120.0;

/// What is printed.
pub struct Printed {
    /// Squares in a row, and rows of them.
    pub squares: [usize; 2],
    /// Side of a square, metres.
    pub side: f64,
    /// OpenCV's dictionary, and the side of a marker as a share of its square's.
    pub markers: Option<(&'static str, f64)>,
}

/// A board in the world: its axes (x along rows, y down columns, z into it), and its first corner, where the outermost
/// square begins.
#[derive(Clone, Copy)]
pub struct Lying {
    pub axes: DMat3,
    pub origin: DVec3,
}

impl Printed {
    /// A board whose middle is at `middle`, turned about its own x, y and z by so many degrees from facing a camera
    /// that looks along the world's z.
    pub fn turned(&self, middle: DVec3, [x, y, z]: [f64; 3]) -> Lying {
        let axes = DMat3::from_rotation_x(x.to_radians())
            * DMat3::from_rotation_y(y.to_radians())
            * DMat3::from_rotation_z(z.to_radians());
        self.centred(axes, middle)
    }

    /// A board whose middle is at `middle`.
    pub fn centred(&self, axes: DMat3, middle: DVec3) -> Lying {
        let [w, h] = self.squares.map(|n| n as f64 * self.side / 2.0);
        Lying {
            axes,
            origin: middle - axes * DVec3::new(w, h, 0.0),
        }
    }

    /// Grey value at a place on the board, squares from its outermost corner.
    fn grey(&self, place: DVec2) -> f64 {
        let [columns, rows] = self.squares.map(|n| n as f64);
        let [margin_x, margin_y] = [place.x / columns, place.y / rows];
        if !(0.0..1.0).contains(&margin_x) || !(0.0..1.0).contains(&margin_y) {
            let near =
                (-1.0..columns + 1.0).contains(&place.x) && (-1.0..rows + 1.0).contains(&place.y);
            return if near { WHITE } else { AROUND };
        }
        let (i, j) = (place.x as usize, place.y as usize);
        if (i + j).is_multiple_of(2) {
            return BLACK;
        }
        let Some((name, size)) = self.markers else {
            return WHITE;
        };
        let dictionary = resolve_dictionary(name).unwrap();
        let cells = dictionary.marker_size() + 2;
        let inside = (place.fract() - (1.0 - size) / 2.0) / size * cells as f64;
        if inside.min_element() < 0.0 || inside.max_element() >= cells as f64 {
            return WHITE;
        }
        let (x, y) = (inside.x as usize, inside.y as usize);
        if x == 0 || y == 0 || x == cells - 1 || y == cells - 1 {
            return BLACK;
        }
        // White squares are numbered row by row.
        let number = (0..j * self.squares[0] + i)
            .filter(|k| (k % self.squares[0] + k / self.squares[0]) % 2 == 1)
            .count();
        let bit = (y - 1) * (cells - 2) + x - 1;
        let is_black = dictionary.codes()[number] >> bit & 1 == 1;
        if is_black { BLACK } else { WHITE }
    }
}

/// A camera with the rays of its pixels.
pub struct Photographer {
    view: View,
    rays: Vec<DVec3>,
    random: SmallRng,
}

impl Photographer {
    pub fn new(view: &View, seed: u64) -> Self {
        let [w, h] = view.size.map(|n| n as usize * SAMPLES);
        let at = |k: usize| (k as f64 + 0.5) / SAMPLES as f64 - 0.5;
        let rays = (0..w * h).map(|k| view.ray(DVec2::new(at(k % w), at(k / w))));
        Self {
            view: view.clone(),
            rays: rays.collect(),
            random: SmallRng::seed_from_u64(seed),
        }
    }

    /// A picture of the board.
    pub fn picture(&mut self, printed: &Printed, lying: &Lying) -> RgbImage {
        let [w, h] = self.view.size.map(|n| n as usize);
        let normal = lying.axes.z_axis;
        let ahead = normal.dot(lying.origin - self.view.position);
        let shown = |ray: &DVec3| {
            let along = ahead / normal.dot(*ray);
            if along.is_nan() || along <= 0.0 || normal.dot(*ray) <= 0.0 {
                return AROUND;
            }
            let at = self.view.position + along * *ray - lying.origin;
            let place = (lying.axes.transpose() * at).truncate() / printed.side;
            printed.grey(place)
        };
        let mut grey = vec![0.0; w * h];
        for (k, ray) in self.rays.iter().enumerate() {
            let (x, y) = (k % (w * SAMPLES) / SAMPLES, k / (w * SAMPLES) / SAMPLES);
            grey[y * w + x] += shown(ray) / (SAMPLES * SAMPLES) as f64;
        }
        let across = blurred(&grey, w, h, 1, w);
        let both = blurred(&across, h, w, w, 1);
        RgbImage::from_fn(w as u32, h as u32, |x, y| {
            // Sums of uniform numbers are as good as normal ones here.
            let sum: f64 = (0..4).map(|_| self.random.random_range(-1.0..1.0)).sum();
            let value = both[y as usize * w + x as usize] + NOISE * sum * 0.866;
            image::Rgb([value.round().clamp(0.0, 255.0) as u8; 3])
        })
    }
}

/// Blurred along one axis: `length` values `step` apart, in `lines` that begin `line` apart.
fn blurred(grey: &[f64], length: usize, lines: usize, step: usize, line: usize) -> Vec<f64> {
    let weights = [-2.0_f64, -1.0, 0.0, 1.0, 2.0].map(|d| (-d * d / (2.0 * BLUR * BLUR)).exp());
    let sum: f64 = weights.iter().sum();
    let mut out = vec![0.0; grey.len()];
    for l in 0..lines {
        for k in 0..length {
            let each = weights.iter().enumerate().map(|(d, weight)| {
                let at = (k + d).saturating_sub(2).min(length - 1);
                weight * grey[l * line + at * step]
            });
            out[l * line + k * step] = each.sum::<f64>() / sum;
        }
    }
    out
}
