//! Cameras by a board: corners that pictures show go in; lenses, and where several cameras stand, come out.
//!
//! Every camera is calibrated alone first (`lens` gives a start in closed form, `plane_pose` the board in every
//! picture, `adjust` moves all together), then `link` places cameras that saw the board at one moment, and all of it is
//! adjusted at once. Every fifth moment is kept apart, to measure by.

mod adjust;
mod error;
mod homography;
mod lens;
mod link;
mod placement;
mod plane_pose;
mod single;

use std::collections::BTreeMap;

use glam::{DMat3, DVec2, DVec3};

pub use error::{BoardError, LEAST_PICTURES};

use super::is_sunk;
use super::pose::Pose;
use crate::board::Corner;
use crate::camera::View;
use adjust::{Free, Scene, Seen};
use lens::Lens;
use link::link;
use placement::Placement;
use plane_pose::placed;
use single::{Corners, Single, limit, median, rms, settle, single};

/// Every so many moments one is kept apart.
const HELD_OUT: usize = 5;
/// Focal lengths must be told to this, as a share.
const CERTAIN: f64 = 0.02;
/// Corners may be off by the picture's width through this …
const WIDTHS: f64 = 640.0;
/// … or by this, pixels.
const LEAST_PX: f64 = 1.0;

/// A picture of the board.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// Number of the moment at which it was taken.
    pub moment: usize,
    /// The board's corners in it; places in squares.
    pub corners: Vec<Corner>,
}

/// What one camera saw of the board.
#[derive(Debug, Clone)]
pub struct Shots {
    /// The camera.
    pub name: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Its lens, where that is known; its place and direction say nothing.
    pub lens: Option<View>,
    /// Pictures taken, also such as show no board.
    pub pictures: usize,
    /// Pictures with the board, at most one of a moment.
    pub shots: Vec<Shot>,
}

/// How well one camera agrees.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardQuality {
    /// Pictures that were used.
    pub used: usize,
    /// Moments of pictures that were put aside, and how far their corners are from where the other pictures have them,
    /// pixels; `None` where no place of the board explains them.
    pub aside: Vec<(usize, Option<f64>)>,
    /// Root mean square of what corners are off, pixels; pictures that were used.
    pub rms_px: f64,
    /// The same in pictures that were not used, the cameras as they are.
    pub held_out_rms_px: Option<f64>,
    /// Standard error of the focal length, pixels; `None` for a lens that was given.
    pub focal_error_px: Option<f64>,
    /// How far boards reach from the picture's centre to its corners in pictures that were used, a share.
    pub reach: f64,
}

/// Calibrated cameras.
#[derive(Debug, Clone)]
pub struct Rig {
    /// The cameras. World axes: those of the board on the floor, or of the first board that several cameras saw; x
    /// along its rows, z out of its front, the origin at its first corner; metres. One camera stands in its own axes.
    pub views: Vec<View>,
    /// How well each agrees.
    pub quality: Vec<BoardQuality>,
}

/// Finds lenses, and places of several cameras. `square` is the side of a square, metres (of one camera's lens any
/// will do); `moments` are the names that shots number, `floor` the one at which the board lay on the floor, face up.
///
/// # Errors
/// [`BoardError`]: what was missing.
pub fn calibrate_by_board(
    cameras: &[Shots],
    moments: &[String],
    square: f64,
    floor: Option<usize>,
) -> Result<Rig, BoardError> {
    let apart = held_out(cameras, moments.len(), floor);
    let scaled = |shot: &Shot| -> Corners {
        let one = |c: &Corner| (c.place * square, c.pixel);
        shot.corners.iter().map(one).collect()
    };
    let mut singles = Vec::new();
    let mut sights = Vec::new();
    for camera in cameras {
        let used: Vec<&Shot> = camera.shots.iter().filter(|s| !apart[s.moment]).collect();
        let alone = alone(camera, &used.iter().map(|s| scaled(s)).collect::<Vec<_>>())?;
        let mut sight = vec![None; moments.len()];
        for (shot, board) in used.iter().zip(&alone.boards) {
            sight[shot.moment] = *board;
        }
        singles.push(alone);
        sights.push(sight);
    }
    let (cameras_found, boards) = link(&singles, &sights)
        .map_err(|camera| BoardError::NotLinked(cameras[camera].name.clone()))?;
    let mut rig = Whole {
        cameras,
        scaled: &scaled,
        numbers: boards
            .iter()
            .enumerate()
            .filter(|b| b.1.is_some())
            .map(|b| b.0)
            .collect(),
        scene: Scene {
            cameras: cameras_found,
            boards: boards.into_iter().flatten().collect(),
        },
        sights,
        radial: singles.iter().map(|s| s.radial).collect(),
        uncertain: singles.iter().map(|s| s.uncertain).collect(),
        strays: BTreeMap::new(),
    };
    if cameras.len() > 1 {
        rig.agree(moments, floor)?;
    }
    rig.finish(&apart, moments, floor, &singles)
}

/// Moments that are kept apart: every fifth of those that the same cameras saw, so that a moment that alone links two
/// cameras is used.
fn held_out(cameras: &[Shots], moments: usize, floor: Option<usize>) -> Vec<bool> {
    let mut seen_by = vec![Vec::new(); moments];
    for (c, camera) in cameras.iter().enumerate() {
        for shot in &camera.shots {
            seen_by[shot.moment].push(c);
        }
    }
    let mut counts: BTreeMap<Vec<usize>, usize> = BTreeMap::new();
    let one = |(m, who): (usize, Vec<usize>)| {
        if Some(m) == floor || who.is_empty() {
            return false;
        }
        let count = counts.entry(who).or_default();
        *count += 1;
        count.is_multiple_of(HELD_OUT)
    };
    seen_by.into_iter().enumerate().map(one).collect()
}

/// What corners of this camera may be off, pixels.
fn allowed(camera: &Shots) -> f64 {
    (f64::from(camera.size[0]) / WIDTHS).max(LEAST_PX)
}

/// One camera by its own pictures.
fn alone(camera: &Shots, pictures: &[Corners]) -> Result<Single, BoardError> {
    if camera.lens.is_none() && camera.shots.len() < LEAST_PICTURES {
        return Err(BoardError::Few {
            camera: camera.name.clone(),
            found: camera.shots.len(),
            of: camera.pictures,
        });
    }
    let known = camera.lens.as_ref().map(|view| Lens {
        focal: view.focal,
        centre: view.centre,
        distortion: view.distortion,
    });
    let found = single(pictures, camera.size, known);
    let found = found.ok_or_else(|| BoardError::Line(camera.name.clone()))?;
    let used = found
        .boards
        .iter()
        .zip(&found.off)
        .filter(|b| b.0.is_some());
    let px = rms(used.map(|(_, off)| off * off));
    if px > allowed(camera) {
        return Err(BoardError::Lens {
            camera: camera.name.clone(),
            px,
            limit: allowed(camera),
            is_given: camera.lens.is_some(),
        });
    }
    // A focal length that pictures do not tell comes out as anything, also with corners where they belong.
    if found.uncertain.is_nan() || found.uncertain > CERTAIN {
        return Err(BoardError::Square {
            camera: camera.name.clone(),
            pictures: pictures.len(),
            percent: (100.0 * found.uncertain).min(100.0),
        });
    }
    Ok(found)
}

/// All cameras and all moments that were used.
struct Whole<'a> {
    cameras: &'a [Shots],
    scaled: &'a dyn Fn(&Shot) -> Corners,
    /// Moments of the scene's boards.
    numbers: Vec<usize>,
    scene: Scene,
    /// Camera by camera, moment by moment: the board alone, where a picture of it is used.
    sights: Vec<Vec<Option<Placement>>>,
    /// How many of k1, k2, k3 are free; `None` for a lens that was given.
    radial: Vec<Option<usize>>,
    uncertain: Vec<f64>,
    /// By camera and moment, how far corners of pictures are off, pixels, that contradict other cameras.
    strays: BTreeMap<(usize, usize), f64>,
}

impl Whole<'_> {
    /// Corners of pictures that are used.
    fn seen(&self) -> Vec<Seen> {
        let board_of: BTreeMap<usize, usize> = self
            .numbers
            .iter()
            .enumerate()
            .map(|(b, m)| (*m, b))
            .collect();
        let mut all = Vec::new();
        for (camera, shots) in self.cameras.iter().enumerate() {
            for shot in &shots.shots {
                if self.sights[camera][shot.moment].is_none() {
                    continue;
                }
                let board = board_of[&shot.moment];
                all.extend((self.scaled)(shot).into_iter().map(|(place, pixel)| Seen {
                    camera,
                    board,
                    place,
                    pixel,
                }));
            }
        }
        all
    }

    /// Adjusts all cameras at once, and puts pictures aside that contradict the others. `floor` is the moment that
    /// tells the floor, `moments` are the names of all.
    fn agree(&mut self, moments: &[String], floor: Option<usize>) -> Result<(), BoardError> {
        self.adjust();
        let mut off: Vec<(usize, usize, f64)> = Vec::new();
        let seen = self.seen();
        for camera in 0..self.cameras.len() {
            for (board, moment) in self.numbers.iter().enumerate() {
                let own = seen
                    .iter()
                    .filter(|s| s.camera == camera && s.board == board);
                let px = rms(own.map(|s| self.scene.off(s).length_squared()));
                if px.is_finite() {
                    off.push((camera, *moment, px));
                }
            }
        }
        // What tells the floor is judged by the others.
        let others = || off.iter().filter(|o| Some(o.1) != floor);
        let far = limit(&others().map(|o| o.2).collect::<Vec<_>>());
        let shared = |m: &usize| self.sights.iter().filter(|s| s[*m].is_some()).count() > 1;
        let links = off.iter().filter(|(_, m, _)| shared(m));
        let links: Vec<(usize, bool, f64)> = links.map(|(c, _, px)| (*c, *px > far, *px)).collect();
        for (c, camera) in self.cameras.iter().enumerate() {
            let own = links.iter().filter(|l| l.0 == c);
            let apart: Vec<f64> = own.clone().filter(|l| l.1).map(|l| l.2).collect();
            // A camera that most of its links contradict would be left with those that do so by chance.
            if 2 * apart.len() > own.count() {
                return Err(BoardError::Apart {
                    camera: camera.name.clone(),
                    px: median(apart),
                    limit: far.min(allowed(camera)),
                    is_given: self.is_given(),
                });
            }
        }
        // What tells the floor no other picture can replace: it may be as far off as its own camera's pictures are.
        let may_be_off = |camera: usize, moment: usize| {
            let own = others().filter(|o| o.0 == camera).map(|o| o.2);
            match Some(moment) == floor {
                true => far.max(limit(&own.collect::<Vec<_>>())),
                false => far,
            }
        };
        if let Some(floor) = floor {
            let sights = off.iter().filter(|o| o.1 == floor);
            let sights: Vec<_> = sights.map(|o| (o.0, o.2, may_be_off(o.0, floor))).collect();
            self.check_floor(&moments[floor], &sights)?;
        }
        let strays: Vec<_> = off.iter().filter(|o| o.2 > may_be_off(o.0, o.1)).collect();
        let mut aside = false;
        for (camera, moment, px) in strays {
            self.sights[*camera][*moment] = None;
            self.strays.insert((*camera, *moment), *px);
            aside = true;
        }
        if aside {
            self.forget_unseen();
            self.adjust();
        }
        let seen = self.seen();
        for (c, camera) in self.cameras.iter().enumerate() {
            let own = seen.iter().filter(|s| s.camera == c);
            let px = rms(own.map(|s| self.scene.off(s).length_squared()));
            // NaN of a camera of which nothing is left.
            if px.is_nan() || px > allowed(camera) {
                return Err(BoardError::Apart {
                    camera: camera.name.clone(),
                    px: if px.is_nan() { far } else { px },
                    limit: allowed(camera),
                    is_given: self.is_given(),
                });
            }
        }
        Ok(())
    }

    /// Whether the lens of one of the cameras was given.
    fn is_given(&self) -> bool {
        self.cameras.iter().any(|camera| camera.lens.is_some())
    }

    /// Whether cameras had the board that tells the floor in one place, or most of them, two at least: of two nobody
    /// knows for which one it had moved. `sights`: by camera, how far corners are off and may be, pixels.
    fn check_floor(&self, picture: &str, sights: &[(usize, f64, f64)]) -> Result<(), BoardError> {
        let apart = sights.iter().filter(|(_, px, limit)| px > limit).count();
        // What one camera alone saw, no other one contradicts.
        if apart == 0 || sights.len() < 2 || sights.len() - apart > apart.max(1) {
            return Ok(());
        }
        let off = sights
            .iter()
            .map(|(c, px, _)| (self.cameras[*c].name.clone(), *px));
        Err(BoardError::Floor {
            picture: picture.to_owned(),
            off: off.collect(),
            limit: sights.iter().map(|s| s.2).fold(0.0, f64::max),
            is_given: self.is_given(),
        })
    }

    fn forget_unseen(&mut self) {
        let stays = |m: &usize| self.sights.iter().any(|s| s[*m].is_some());
        let kept = self.numbers.iter().zip(&self.scene.boards);
        let kept: Vec<_> = kept
            .filter(|(m, _)| stays(m))
            .map(|(m, b)| (*m, *b))
            .collect();
        (self.numbers, self.scene.boards) = kept.into_iter().unzip();
    }

    fn adjust(&mut self) {
        let free: Vec<Free> = self
            .radial
            .iter()
            .enumerate()
            .map(|(c, radial)| Free {
                lens: *radial,
                pose: c > 0,
            })
            .collect();
        let loose = self.cameras.iter().map(allowed).fold(0.0, f64::max) * 3.0;
        let seen = self.seen();
        self.uncertain = settle(&mut self.scene, &free, &seen, loose);
    }

    /// Measures, and turns to the world's axes.
    fn finish(
        self,
        apart: &[bool],
        moments: &[String],
        floor: Option<usize>,
        singles: &[Single],
    ) -> Result<Rig, BoardError> {
        let seen = self.seen();
        let held = self.held_out(apart);
        let one = |(c, camera): (usize, &Shots)| {
            let own = seen.iter().filter(|s| s.camera == c);
            let used = camera
                .shots
                .iter()
                .filter(|s| self.sights[c][s.moment].is_some());
            let tried = camera.shots.iter().filter(|s| !apart[s.moment]);
            let off = tried.zip(&singles[c].off);
            let aside = off.filter(|(s, _)| self.sights[c][s.moment].is_none());
            let aside = aside.map(|(s, alone)| {
                let px = self.strays.get(&(c, s.moment)).unwrap_or(alone);
                (s.moment, Some(*px).filter(|px| px.is_finite()))
            });
            let focal = self.scene.cameras[c].lens.focal.x;
            let free = camera.lens.is_none();
            BoardQuality {
                used: used.count(),
                aside: aside.collect(),
                rms_px: rms(own.map(|s| self.scene.off(s).length_squared())),
                held_out_rms_px: held[c],
                focal_error_px: free.then(|| self.uncertain[c] * focal),
                reach: reach(camera, |s| self.sights[c][s.moment].is_some()),
            }
        };
        let quality = self.cameras.iter().enumerate().map(one).collect();
        let mut poses: Vec<Pose> = self.scene.cameras.iter().map(|c| c.pose).collect();
        if let Some(base) = self.base(moments, floor)? {
            for (pose, camera) in poses.iter_mut().zip(self.cameras) {
                *pose = on_board(*pose, &base);
                if let Some(floor) = floor.filter(|_| is_sunk(pose.position, true)) {
                    return Err(BoardError::UnderFloor {
                        camera: camera.name.clone(),
                        metres: -pose.position.z,
                        picture: moments[floor].clone(),
                    });
                }
            }
        }
        let views = self.cameras.iter().zip(&self.scene.cameras).zip(poses);
        let views = views.map(|((shots, camera), pose)| View {
            name: shots.name.clone(),
            size: shots.size,
            focal: camera.lens.focal,
            centre: camera.lens.centre,
            distortion: camera.lens.distortion,
            rotation: pose.rotation,
            position: pose.position,
        });
        Ok(Rig {
            views: views.collect(),
            quality,
        })
    }

    /// The board whose axes are the world's.
    fn base(
        &self,
        moments: &[String],
        floor: Option<usize>,
    ) -> Result<Option<Placement>, BoardError> {
        let mut boards = self.numbers.iter().zip(&self.scene.boards);
        if let Some(floor) = floor {
            let found = boards.find(|(m, _)| **m == floor);
            let found = found.ok_or_else(|| BoardError::NoFloor(moments[floor].clone()))?;
            return Ok(Some(*found.1));
        }
        let by = |m: usize| self.sights.iter().filter(|s| s[m].is_some()).count();
        Ok(boards.find(|(m, _)| by(**m) > 1).map(|(_, board)| *board))
    }

    /// How far corners are off in pictures that were kept apart: the cameras stay, the board goes where it fits best.
    fn held_out(&self, apart: &[bool]) -> Vec<Option<f64>> {
        let mut squares = vec![Vec::new(); self.cameras.len()];
        for moment in (0..apart.len()).filter(|m| apart[*m]) {
            let shots = self.cameras.iter().enumerate();
            let shots: Vec<(usize, Corners)> = shots
                .filter_map(|(c, camera)| {
                    let shot = camera.shots.iter().find(|s| s.moment == moment)?;
                    Some((c, (self.scaled)(shot)))
                })
                .collect();
            let seen: Vec<Seen> = shots
                .iter()
                .flat_map(|(c, corners)| {
                    corners.iter().map(|(place, pixel)| Seen {
                        camera: *c,
                        board: 0,
                        place: *place,
                        pixel: *pixel,
                    })
                })
                .collect();
            let settled = shots.iter().filter_map(|(c, corners)| {
                let camera = &self.scene.cameras[*c];
                let loose = allowed(&self.cameras[*c]);
                let (board, _) = placed(&camera.lens, corners, loose)?;
                let mut scene = Scene {
                    cameras: self.scene.cameras.clone(),
                    boards: vec![board.seen_from(camera.pose)],
                };
                let free = vec![Free::NOTHING; self.cameras.len()];
                adjust::adjust(&mut scene, &free, &seen, loose);
                let off = rms(seen.iter().map(|s| scene.off(s).length_squared()));
                Some((scene, off))
            });
            if let Some((scene, _)) = settled.min_by(|a, b| a.1.total_cmp(&b.1)) {
                for s in &seen {
                    squares[s.camera].push(scene.off(s).length_squared());
                }
            }
        }
        let one = |squares: Vec<f64>| (!squares.is_empty()).then(|| rms(squares.into_iter()));
        squares.into_iter().map(one).collect()
    }
}

/// A camera in the axes of a board: x along its rows, z out of its front.
fn on_board(camera: Pose, board: &Placement) -> Pose {
    let up = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    Pose {
        rotation: camera.rotation * board.rotation * up,
        position: up * (board.rotation.transpose() * (camera.position - board.position)),
    }
}

/// How far corners reach from the middle of the picture towards its corners in the pictures that are used.
fn reach(camera: &Shots, is_used: impl Fn(&Shot) -> bool) -> f64 {
    let size = DVec2::new(camera.size[0].into(), camera.size[1].into());
    let middle = (size - 1.0) / 2.0;
    let used = camera.shots.iter().filter(|s| is_used(s));
    let corners = used.flat_map(|s| &s.corners);
    let far = corners.map(|c| c.pixel.distance(middle));
    far.fold(0.0, f64::max) / middle.length()
}

#[cfg(test)]
mod tests;
