//! A lens to begin with: what pictures of a plane tell in closed form (Zhang, *A flexible new technique for camera
//! calibration*, 2000), distortion left out.

use glam::{DMat3, DVec2};
use nalgebra::{Matrix5, SymmetricEigen, Vector5};

use crate::camera::Brown;

/// Focal lengths by the width of the picture where pictures tell none.
const USUAL: [f64; 2] = [0.8, 1.5];

/// What a camera does to rays, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Focal lengths.
    pub focal: DVec2,
    /// Principal point.
    pub centre: DVec2,
    /// Distortion.
    pub distortion: Brown,
}

impl Lens {
    /// The pixel of a point on the plane z = 1.
    pub fn pixel(&self, plane: DVec2) -> DVec2 {
        self.distortion.distort(plane) * self.focal + self.centre
    }

    /// The point on the plane z = 1 that a pixel shows.
    pub fn plane(&self, pixel: DVec2) -> DVec2 {
        self.distortion
            .undistort((pixel - self.centre) / self.focal)
    }
}

/// Lenses that may be the one: `maps` take the board, any unit, to pixels of pictures of `size`. Never none: the last
/// ones are guesses.
pub fn candidates(maps: &[DMat3], size: [u32; 2]) -> Vec<Lens> {
    let size = DVec2::new(size[0].into(), size[1].into());
    let (middle, width) = ((size - 1.0) / 2.0, size.x);
    // Near 1, for numbers' sake.
    let to_unit = DMat3::from_scale(DVec2::splat(1.0 / width)) * DMat3::from_translation(-middle);
    let maps: Vec<DMat3> = maps.iter().map(|h| to_unit * *h).collect();
    let lens = |focal: DVec2, centre: DVec2| Lens {
        focal: focal * width,
        centre: centre * width + middle,
        distortion: Brown::default(),
    };
    let sane = |l: &Lens| {
        let ratio = l.focal.x / l.focal.y;
        let off = (l.centre - middle).abs() / size;
        (0.5..2.0).contains(&ratio)
            && (0.2..20.0).contains(&(l.focal.x / width))
            && off.max_element() < 0.25
    };
    let closed = all_four(&maps).map(|(f, c)| lens(f, c));
    let square = one_focal(&maps).map(|f| lens(DVec2::splat(f), DVec2::ZERO));
    let mut found: Vec<Lens> = [closed, square]
        .into_iter()
        .flatten()
        .filter(sane)
        .collect();
    if found.is_empty() {
        found.extend(USUAL.map(|f| lens(DVec2::splat(f), DVec2::ZERO)));
    }
    found
}

/// Columns of a map that are images of the board's axes: perpendicular and of one length in the camera.
fn axes(h: &DMat3) -> [[f64; 3]; 2] {
    [h.x_axis.to_array(), h.y_axis.to_array()]
}

/// Focal lengths and centre, pixels without skew.
fn all_four(maps: &[DMat3]) -> Option<(DVec2, DVec2)> {
    // hᵢᵀ B hⱼ with B = [b0 0 b2; 0 b1 b3; b2 b3 b4].
    let product = |a: &[f64; 3], b: &[f64; 3]| {
        Vector5::new(
            a[0] * b[0],
            a[1] * b[1],
            a[0] * b[2] + a[2] * b[0],
            a[1] * b[2] + a[2] * b[1],
            a[2] * b[2],
        )
    };
    let mut normal = Matrix5::zeros();
    for h in maps {
        let [a, b] = axes(h);
        for row in [product(&a, &b), product(&a, &a) - product(&b, &b)] {
            normal.ger(1.0, &row, &row, 1.0);
        }
    }
    let eigen = SymmetricEigen::try_new(normal, 1e-14, 500)?;
    let b = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let centre = DVec2::new(-b[2] / b[0], -b[3] / b[1]);
    let scale = b[4] - b[2] * b[2] / b[0] - b[3] * b[3] / b[1];
    let squares = DVec2::new(scale / b[0], scale / b[1]);
    (squares.is_finite() && squares.min_element() > 0.0)
        .then(|| (DVec2::new(squares.x.sqrt(), squares.y.sqrt()), centre))
}

/// The focal length if pixels are square and the centre is the origin.
fn one_focal(maps: &[DMat3]) -> Option<f64> {
    let (mut square, mut right) = (0.0, 0.0);
    for h in maps {
        let [a, b] = axes(h);
        let rows = [
            (a[0] * b[0] + a[1] * b[1], a[2] * b[2]),
            (
                a[0] * a[0] + a[1] * a[1] - b[0] * b[0] - b[1] * b[1],
                a[2] * a[2] - b[2] * b[2],
            ),
        ];
        for (of_inverse, rest) in rows {
            square += of_inverse * of_inverse;
            right -= of_inverse * rest;
        }
    }
    let inverse = right / square;
    (inverse.is_finite() && inverse > 0.0).then(|| inverse.sqrt().recip())
}
