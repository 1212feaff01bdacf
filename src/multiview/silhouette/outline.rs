//! A posed mesh goes in, the vertices on its outline in one view come out.

use glam::{DVec2, DVec3, Vec3};

use crate::body::mesh::MeshBody;
use crate::camera::View;

/// Cells along the longer side of the grid on which the body is drawn.
const CELLS: f64 = 150.0;
/// How far outwards, in cells, nothing of the body may be.
const CLEAR: f64 = 1.8;
/// Vertices of an outline at most.
const MOST: usize = 220;

/// A vertex on the outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rimmed {
    /// Which vertex.
    pub vertex: u32,
    /// Where it is on the plane z = 1.
    pub plane: DVec2,
    /// Unit vector away from the body.
    pub normal: DVec2,
}

/// The outline of a body in one view.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Its vertices, evenly spread.
    pub rim: Vec<Rimmed>,
}

impl Outline {
    /// The outline of `vertices`, in the world; `None` where some of them are behind the camera.
    pub fn new(body: &MeshBody, vertices: &[Vec3], view: &View) -> Option<Self> {
        let camera: Vec<DVec3> = vertices
            .iter()
            .map(|v| view.to_camera(v.as_dvec3()))
            .collect();
        if camera.iter().any(|p| p.z < 0.1) {
            return None;
        }
        let flat: Vec<DVec2> = camera.iter().map(|p| p.truncate() / p.z).collect();
        let mut normals = vec![DVec3::ZERO; vertices.len()];
        // Whether some and other faces at a vertex are turned to the camera.
        let mut turned = vec![[false; 2]; vertices.len()];
        let grid = &mut Grid::new(&flat);
        for face in body.faces() {
            let [a, b, c] = face.map(|i| camera[i as usize]);
            let normal = (b - a).cross(c - a);
            let towards = normal.dot(a) < 0.0;
            for &i in face {
                normals[i as usize] += normal;
                turned[i as usize][usize::from(towards)] = true;
            }
            if towards {
                grid.draw(face.map(|i| flat[i as usize]));
            }
        }
        let mut rim: Vec<Rimmed> = (0..vertices.len())
            .filter(|&v| turned[v] == [true; 2])
            .filter_map(|v| {
                let (p, n) = (camera[v], normals[v]);
                // On the plane a point moves along x and y, less along the ray.
                let normal = (n.truncate() * p.z).try_normalize()?;
                let (plane, vertex) = (flat[v], v as u32);
                let rimmed = Rimmed {
                    vertex,
                    plane,
                    normal,
                };
                (!grid.at(plane + normal * (CLEAR * grid.cell))).then_some(rimmed)
            })
            .collect();
        let step = rim.len().div_ceil(MOST).max(1);
        rim = rim.into_iter().step_by(step).collect();
        Some(Self { rim })
    }
}

/// Where the body is, roughly.
struct Grid {
    least: DVec2,
    cell: f64,
    width: usize,
    height: usize,
    full: Vec<bool>,
}

impl Grid {
    fn new(points: &[DVec2]) -> Self {
        let (least, most) = points
            .iter()
            .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| {
                (low.min(*p), high.max(*p))
            });
        let cell = ((most - least).max_element() / CELLS).max(1e-6);
        let size = ((most - least) / cell).ceil().as_uvec2() + 1;
        let (width, height) = (size.x as usize, size.y as usize);
        Self {
            least,
            cell,
            width,
            height,
            full: vec![false; width * height],
        }
    }

    fn draw(&mut self, corners: [DVec2; 3]) {
        let [a, b, c] = corners.map(|p| (p - self.least) / self.cell);
        let area = (b - a).perp_dot(c - a);
        if area == 0.0 {
            return;
        }
        let low = a.min(b).min(c).floor().as_uvec2();
        let high = a.max(b).max(c).ceil().as_uvec2();
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let p = DVec2::new(f64::from(x), f64::from(y));
                let wa = (c - b).perp_dot(p - b) / area;
                let wb = (a - c).perp_dot(p - c) / area;
                let inside = wa >= 0.0 && wb >= 0.0 && wa + wb <= 1.0;
                let (x, y) = (x as usize, y as usize);
                if inside && x < self.width && y < self.height {
                    self.full[y * self.width + x] = true;
                }
            }
        }
    }

    fn at(&self, p: DVec2) -> bool {
        let p = ((p - self.least) / self.cell).round();
        let inside =
            p.x >= 0.0 && p.y >= 0.0 && p.x < self.width as f64 && p.y < self.height as f64;
        inside && self.full[p.y as usize * self.width + p.x as usize]
    }
}
