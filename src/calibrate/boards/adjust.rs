//! Bundle adjustment: lenses, cameras and boards are moved together until every corner is where it was seen.

use glam::{DVec2, DVec3};

use super::lens::Lens;
use super::placement::Placement;
use crate::calibrate::pose::{Pose, plane_jacobian};
use crate::solve::{Effort, LeastSquares, NormalEquations, Solver};

/// Unknowns of a lens: focal lengths, centre, k1, k2, p1, p2, k3.
pub const OF_LENS: usize = 9;
/// Unknowns of a turn and a place.
const OF_POSE: usize = 6;
const OF_CAMERA: usize = OF_LENS + OF_POSE;
/// Corners nearer than this are behind the camera as good as, in the board's unit.
const NEAR: f64 = 1e-6;
/// What a corner behind the camera is off, pixels.
const BEHIND: f64 = 1e4;
const EFFORT: Effort = Effort {
    iterations: 60,
    tolerance: 1e-8,
};

/// A camera and how it sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Its lens.
    pub lens: Lens,
    /// Where it is.
    pub pose: Pose,
}

impl Camera {
    /// Where it shows a point of a board, pixels; `None` behind it.
    pub fn shows(&self, board: &Placement, place: DVec2) -> Option<DVec2> {
        let p = self.pose.to_camera(board.point(place));
        (p.z > NEAR).then(|| self.lens.pixel(p.truncate() / p.z))
    }
}

/// A corner, seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Number of the camera.
    pub camera: usize,
    /// Number of the board's placement.
    pub board: usize,
    /// On the board, metres.
    pub place: DVec2,
    /// In the picture.
    pub pixel: DVec2,
}

/// What of a camera may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Free {
    /// Its lens: so many of k1, k2, k3, with all that is not radial; nothing for `None`.
    pub lens: Option<usize>,
    /// Its place and direction.
    pub pose: bool,
}

impl Free {
    /// Nothing.
    pub const NOTHING: Self = Self {
        lens: None,
        pose: false,
    };

    fn unknown(self, k: usize) -> bool {
        let radial = match k {
            4 => 1,
            5 => 2,
            8 => 3,
            _ => 0,
        };
        if k < OF_LENS {
            self.lens.is_some_and(|most| radial <= most)
        } else {
            self.pose
        }
    }
}

/// All that moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The cameras.
    pub cameras: Vec<Camera>,
    /// The board, moment by moment, in the world.
    pub boards: Vec<Placement>,
}

impl Scene {
    /// How far a corner is from where it was seen, pixels.
    pub fn off(&self, s: &Seen) -> DVec2 {
        self.cameras[s.camera]
            .shows(&self.boards[s.board], s.place)
            .map_or(DVec2::new(BEHIND, 0.0), |p| p - s.pixel)
    }
}

/// Moves what is free so that corners are nearest to where they were seen. What is further off than `sigma`, pixels,
/// counts little (Cauchy's loss). Gives the uncertainty of every camera's focal length across, as a share of it, if
/// corners are off by 1 pixel; infinite where nothing tells it, 0 where it was not free.
pub fn adjust(scene: &mut Scene, free: &[Free], seen: &[Seen], sigma: f64) -> Vec<f64> {
    let boards = OF_POSE * scene.boards.len();
    let of_boards = (0..boards).map(|k| k - k % OF_POSE);
    let problem = Problem {
        free,
        seen,
        sigma,
        envelope: of_boards
            .chain(std::iter::repeat_n(0, OF_CAMERA * scene.cameras.len()))
            .collect(),
    };
    let mut solver = Solver::default();
    let mut spare = scene.clone();
    solver.solve(&problem, EFFORT, scene, &mut spare);
    let mut last = solver.last().clone();
    for (c, free) in free.iter().enumerate() {
        for k in (0..OF_CAMERA).filter(|k| !free.unknown(*k)) {
            let row = boards + OF_CAMERA * c + k;
            last.add(row, row, 1.0);
        }
    }
    let wanted = |c: usize| boards + OF_CAMERA * c;
    let certain = last.clone().factorise();
    let each = free.iter().enumerate().map(|(c, free)| {
        if free.lens.is_none() {
            return 0.0;
        }
        if !certain {
            return f64::INFINITY;
        }
        let mut unit = last.clone();
        for row in 0..unit.size() {
            let pulled = unit.gradient()[row];
            unit.pull(row, -pulled);
        }
        unit.pull(wanted(c), 1.0);
        unit.factorise();
        unit.substitute()[wanted(c)].max(0.0).sqrt() / scene.cameras[c].lens.focal.x
    });
    each.collect()
}

struct Problem<'a> {
    free: &'a [Free],
    seen: &'a [Seen],
    sigma: f64,
    envelope: Vec<usize>,
}

impl LeastSquares for Problem<'_> {
    type State = Scene;

    fn envelope(&self) -> &[usize] {
        &self.envelope
    }

    fn cost(&self, at: &Scene) -> f64 {
        let square = self.sigma * self.sigma;
        let one = |s: &Seen| square * (at.off(s).length_squared() / square).ln_1p();
        self.seen.iter().map(one).sum()
    }

    fn linearise(&self, at: &Scene, out: &mut NormalEquations) {
        let cameras = OF_POSE * at.boards.len();
        for s in self.seen {
            let camera = &at.cameras[s.camera];
            let Some(rows) = rows(camera, &at.boards[s.board], s.place) else {
                continue;
            };
            let off = at.off(s);
            let weight = 1.0 / (1.0 + off.length_squared() / (self.sigma * self.sigma));
            let (board, lens) = (OF_POSE * s.board, cameras + OF_CAMERA * s.camera);
            let free = self.free[s.camera];
            for (row, off) in rows.into_iter().zip([off.x, off.y]) {
                for i in 0..OF_POSE {
                    let w = weight * row.board[i];
                    out.pull(board + i, w * off);
                    for j in 0..=i {
                        out.add(board + i, board + j, w * row.board[j]);
                    }
                }
                for i in (0..OF_CAMERA).filter(|i| free.unknown(*i)) {
                    let w = weight * row.camera[i];
                    out.pull(lens + i, w * off);
                    for j in 0..OF_POSE {
                        out.add(lens + i, board + j, w * row.board[j]);
                    }
                    for j in (0..=i).filter(|j| free.unknown(*j)) {
                        out.add(lens + i, lens + j, w * row.camera[j]);
                    }
                }
            }
        }
    }

    fn step(&self, from: &Scene, descent: &[f64], to: &mut Scene) {
        let vector = |at: usize| -DVec3::new(descent[at], descent[at + 1], descent[at + 2]);
        let pair = |at: usize| -DVec2::new(descent[at], descent[at + 1]);
        for (k, (from, to)) in from.boards.iter().zip(&mut to.boards).enumerate() {
            *to = from.moved(vector(OF_POSE * k), vector(OF_POSE * k + 3));
        }
        let cameras = OF_POSE * from.boards.len();
        for (c, (from, to)) in from.cameras.iter().zip(&mut to.cameras).enumerate() {
            let at = cameras + OF_CAMERA * c;
            *to = *from;
            if self.free[c].lens.is_some() {
                to.lens.focal += pair(at);
                to.lens.centre += pair(at + 2);
                let [k1, k2, p1, p2, k3] = std::array::from_fn(|k| -descent[at + 4 + k]);
                let distortion = &mut to.lens.distortion;
                for (radial, by) in distortion.radial.iter_mut().zip([k1, k2, k3]) {
                    *radial += by;
                }
                for (tangential, by) in distortion.tangential.iter_mut().zip([p1, p2]) {
                    *tangential += by;
                }
            }
            if self.free[c].pose {
                let at = at + OF_LENS;
                to.pose = from.pose.moved(vector(at), vector(at + 3));
            }
        }
    }
}

/// Derivatives of one coordinate of a pixel.
struct Row {
    board: [f64; OF_POSE],
    camera: [f64; OF_CAMERA],
}

fn rows(camera: &Camera, board: &Placement, place: DVec2) -> Option<[Row; 2]> {
    let on_board = board.rotation * place.extend(0.0);
    let p = camera.pose.to_camera(on_board + board.position);
    if p.z <= NEAR {
        return None;
    }
    let plane = p.truncate() / p.z;
    let Lens {
        focal, distortion, ..
    } = camera.lens;
    let shown = distortion.distort(plane);
    let bend = distortion.by_point(plane);
    let coefficients = crate::camera::Brown::by_coefficient(plane);
    let [dx, dy] = plane_jacobian(p);
    let each = [0, 1].map(|axis| {
        // Of the pixel by the point in camera axes, then in the world's.
        let by_point = focal[axis] * (bend.x_axis[axis] * dx + bend.y_axis[axis] * dy);
        let in_world = camera.pose.rotation.transpose() * by_point;
        let (turn, board_turn) = (p.cross(by_point), on_board.cross(in_world));
        let mut lens = [0.0; OF_LENS];
        lens[axis] = shown[axis];
        lens[2 + axis] = 1.0;
        for (k, by) in coefficients.iter().enumerate() {
            lens[4 + k] = focal[axis] * by[axis];
        }
        let mut of_camera = [0.0; OF_CAMERA];
        of_camera[..OF_LENS].copy_from_slice(&lens);
        of_camera[OF_LENS..OF_LENS + 3].copy_from_slice(&turn.to_array());
        of_camera[OF_LENS + 3..].copy_from_slice(&(-in_world).to_array());
        let mut of_board = [0.0; OF_POSE];
        of_board[..3].copy_from_slice(&board_turn.to_array());
        of_board[3..].copy_from_slice(&in_world.to_array());
        Row {
            board: of_board,
            camera: of_camera,
        }
    });
    Some(each)
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::camera::Brown;

    #[test]
    fn derivatives_are_those_of_small_steps() {
        let scene = Scene {
            cameras: vec![Camera {
                lens: Lens {
                    focal: DVec2::new(900.0, 910.0),
                    centre: DVec2::new(630.0, 350.0),
                    distortion: Brown {
                        radial: [-0.2, 0.1, 0.02],
                        tangential: [1e-3, -2e-3],
                    },
                },
                pose: Pose {
                    rotation: DMat3::from_rotation_y(0.3),
                    position: DVec3::new(-0.5, 0.2, -2.0),
                },
            }],
            boards: vec![Placement {
                rotation: DMat3::from_rotation_x(0.4),
                position: DVec3::new(-0.1, 0.1, 0.3),
            }],
        };
        let seen = [Seen {
            camera: 0,
            board: 0,
            place: DVec2::new(0.2, 0.15),
            pixel: DVec2::ZERO,
        }];
        let free = [Free {
            lens: Some(3),
            pose: true,
        }];
        let problem = Problem {
            free: &free,
            seen: &seen,
            sigma: 1.0,
            envelope: Vec::new(),
        };
        let [x, y] = rows(&scene.cameras[0], &scene.boards[0], seen[0].place).unwrap();
        let size = 1e-6;
        for k in 0..OF_POSE + OF_CAMERA {
            let moved = |by: f64| {
                let mut descent = [0.0; OF_POSE + OF_CAMERA];
                descent[k] = -by;
                let mut to = scene.clone();
                problem.step(&scene, &descent, &mut to);
                to.off(&seen[0])
            };
            let found = (moved(size) - moved(-size)) / (2.0 * size);
            let of = |row: &Row| [&row.board[..], &row.camera[..]].concat()[k];
            let told = DVec2::new(of(&x), of(&y));
            assert!(
                (found - told).length() < 1e-4 * (1.0 + told.length()),
                "{k}: {found} {told}"
            );
        }
    }
}
