//! Cameras that nobody measured: lenses and what every view saw of people who walk about go in, the cameras' places and
//! directions come out, in metres, on the floor.
//!
//! `relative` tells two views' places from points that both saw, or with `turn` from people whom both lifted; `resect`
//! adds a view to points in known places, `bundle` moves all together, `world` finds size and floor by the people
//! themselves. Sides that a detector exchanged are healed by [`track`] in between. Of the answers to which several
//! pairs of views lead the one is taken in which most rays meet in bodies whose bones keep their lengths.

pub mod boards;
mod bundle;
mod consensus;
mod pose;
mod relative;
mod resect;
mod rig;
mod turn;
mod world;

use glam::{DMat3, DVec2, DVec3};

use crate::camera::View;
use crate::joints::{CANONICAL_STATURE, EVIDENCE_JOINTS};
use crate::multiview::{Detections, Moment, Sight, Track, distance, track, triangulate};
use bundle::{Seen, bundle};
use pose::Pose;

/// Of so many stretches of frames one is kept apart, to measure by: a frame beside one that is used tells nothing new.
const HELD_OUT: usize = 5;
/// Such a stretch at most, seconds: whoever walks is somewhere else, and was forgotten, behind it.
const STRETCH: f64 = 2.0;
/// How far a view may be off before it counts little, metres at the person, from round to round.
const SIGMAS: [f64; 4] = [0.15, 0.1, 0.06, 0.06];
/// What is further off than this is another joint, or another person; metres.
const FAR: f64 = 0.2;
/// A ray so far from its joint agrees by half, metres.
const CLOSE: f64 = 0.05;
/// Frames in which two views saw somebody, at least.
const LEAST_FRAMES: usize = 20;
/// So many of these are left when some are kept apart, at least.
const LEAST_USED: usize = LEAST_FRAMES - LEAST_FRAMES / HELD_OUT;

/// So many times as tall as who counts somebody must be to be told of: the few frames of those who are seen seldom tell
/// a height less well. Tracks that differ by less may be of one person, who left and came back.
const TALLER: f64 = 1.05;
/// So far below the floor a camera may come out where people's own axis tells what is up, who may lean: metres, and for
/// every metre that it stands away from them …
const SUNK_BY_AXES: [f64; 2] = [0.3, 0.1];
/// … and where feet, or a board that lies on it, tell the floor's slope.
const SUNK_BY_FEET: [f64; 2] = [0.1, 0.02];

/// How well one view agrees.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ViewQuality {
    /// The camera.
    pub name: String,
    /// Frames of people in which it took part.
    pub sights: usize,
    /// Root mean square of what joints are off, pixels; frames that were used.
    pub rms_px: f64,
    /// The same in the fifth of the frames by which cameras were not placed to each other; `None` where the view took
    /// part in none of these.
    pub held_out_rms_px: Option<f64>,
    /// Joints left out of both because they were further off than 0.2 m at the person, %.
    pub far_percent: f64,
    /// Sights of people whom another view could have seen as well, and that went with no other view's, %.
    pub alone_percent: f64,
    /// Height of the camera above the floor, metres; a little below 0 where the floor came out tilted.
    pub height_m: f64,
}

/// A calibrated room.
#[derive(Debug, Clone)]
pub struct Room {
    /// The cameras. World axes: z up, the floor at 0, the origin below where people were, y towards the first camera;
    /// metres.
    pub views: Vec<View>,
    /// How well each agrees.
    pub quality: Vec<ViewQuality>,
    /// Height of the tallest of those who are seen often, metres.
    pub stature: f64,
    /// Height of somebody who is seen too seldom to count, metres, where that is clearly more.
    pub taller: Option<f64>,
    /// Whether feet told the floor's slope; else it is level as people hold themselves upright.
    pub floor_by_feet: bool,
}

impl Room {
    /// The room at the size in which cameras `a` and `b`, by number, are `metres` apart. How well views agree stays as
    /// it was found at people's height: a wrong distance says nothing of the places.
    pub fn with_distance(mut self, a: usize, b: usize, metres: f64) -> Self {
        let apart = self.views[a].position.distance(self.views[b].position);
        let factor = metres / apart.max(1e-9);
        for view in &mut self.views {
            view.position *= factor;
        }
        for quality in &mut self.quality {
            quality.height_m *= factor;
        }
        self.stature *= factor;
        self.taller = self.taller.map(|metres| factor * metres);
        self
    }
}

/// Why there is no room.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum CalibrateError {
    /// Too little was seen.
    #[error(
        "expected a person in at least {LEAST_FRAMES} frames of two views, found {0}; let one person walk through what all cameras see"
    )]
    Nobody(usize),
    /// Who is who cannot be told over time.
    #[error(
        "expected a person whom two views can follow through at least {LEAST_USED} frames, found {seen} of the {shared} in which both saw somebody; check that the files are of one moment and the lenses theirs, and record at 10 frames a second or more"
    )]
    Untracked {
        /// Frames of people who were followed.
        seen: usize,
        /// Frames in which two views or more saw somebody.
        shared: usize,
    },
    /// No two views agree.
    #[error(
        "expected two views whose sights of a person go together, found none; check that the files are of one moment and the lenses theirs"
    )]
    NoPair,
    /// The views that agree look from one side, or into each other.
    #[error(
        "expected two cameras that see people from directions 30 to 150 degrees apart, found {0} and {1} {2:.0} degrees apart, which tells no distances; move one of them, or add another"
    )]
    NoAngle(String, String, f64),
    /// A view cannot be placed.
    #[error(
        "expected camera {0} to see somebody whom two placed cameras see at the same time, found too little; leave the view out, or record again"
    )]
    NotLinked(String),
    /// Cameras came out farther below the floor than it may be tilted.
    #[error(
        "expected cameras above the floor, found {0} {1:.2} m below it; people must stand or walk, feet in view"
    )]
    UnderFloor(String, f64),
    /// People's size cannot be told.
    #[error(
        "expected people seen from head to ankles, found none; step back, or lower the cameras"
    )]
    NoSize,
}

/// Finds the cameras. `lenses` are views whose place and direction say nothing yet; `frames` what each saw, frame by
/// frame, made by [`Sight::new`] with any pose; `rate` frames a second; `stature` the height of the tallest of those
/// who are seen at least half as long as the longest stay of anybody, visits of one height together, metres, which
/// gives the room its size.
///
/// # Errors
/// [`CalibrateError`]: what was missing.
pub fn calibrate(
    lenses: &[View],
    frames: &[Vec<Detections>],
    rate: f64,
    stature: f64,
) -> Result<Room, CalibrateError> {
    let shared = shared(frames);
    if shared < LEAST_FRAMES {
        return Err(CalibrateError::Nobody(shared));
    }
    let held_out = held_out(frames, rate);
    let used = without(frames, &held_out);
    let of_all = |e: CalibrateError| match e {
        CalibrateError::Untracked { seen, .. } => CalibrateError::Untracked { seen, shared },
        other => other,
    };
    let mut failure = None;
    let mut answers = Vec::new();
    for start in rig::assemble(lenses, &used, rate).map_err(of_all)? {
        match settle(lenses, start, &used, rate) {
            Ok(answer) => answers.push(answer),
            Err(e) => failure = Some(of_all(e)),
        }
    }
    answers.sort_by(|a, b| b.0.total_cmp(&a.0));
    // An answer that stands on its head is none, however well rays meet.
    let mut first = failure;
    for (k, (_, cameras)) in answers.into_iter().enumerate() {
        match stand(lenses, cameras, frames, &held_out, rate, stature) {
            Ok(room) => return Ok(room),
            Err(e) if k == 0 => first = Some(e),
            Err(_) => {}
        }
    }
    Err(first.unwrap_or(CalibrateError::NoPair))
}

/// Moves the cameras of an answer to agree about everyone; people are of canonical stature. How well they agree then,
/// the more the better, comes first.
fn settle(
    lenses: &[View],
    mut cameras: Vec<Pose>,
    frames: &[Vec<Detections>],
    rate: f64,
) -> Result<(f64, Vec<Pose>), CalibrateError> {
    for sigma in SIGMAS {
        let tracks = people(lenses, &cameras, frames, rate)?;
        refine(&mut cameras, &tracks, sigma);
        let size = Sizes::new(lenses, &cameras, &tracks).of_room()?;
        rescale(&mut cameras, 1.0 / size);
    }
    let tracks = people(lenses, &cameras, frames, rate)?;
    let joints = tracks.iter().flat_map(|t| joints(lenses, &cameras, t));
    let solid = world::solidity(&joints.collect::<Vec<_>>());
    let views = placed(lenses, &cameras);
    let worth = agreement(&views, &tracks) * solid * alike(&views, &tracks);
    Ok((worth, cameras))
}

/// Frames in which two views or more saw somebody.
fn shared(frames: &[Vec<Detections>]) -> usize {
    frames.iter().filter(|frame| is_shared(frame)).count()
}

fn is_shared(frame: &[Detections]) -> bool {
    frame.iter().filter(|all| !all.is_empty()).count() > 1
}

/// Which frames are kept apart: the middle one of every five stretches of the frames that views share, which alone
/// place cameras. Stretches are so short that every view that shares enough keeps most of it.
fn held_out(frames: &[Vec<Detections>], rate: f64) -> Vec<bool> {
    let views = frames.iter().map(Vec::len).max().unwrap_or(0);
    let of_view = |v: usize| {
        let seen =
            |f: &&Vec<Detections>| is_shared(f) && f.get(v).is_some_and(|all| !all.is_empty());
        frames.iter().filter(seen).count()
    };
    let enough = (0..views).map(of_view).filter(|n| *n >= LEAST_FRAMES);
    let least = enough.min().unwrap_or_else(|| shared(frames));
    let stretch = ((STRETCH * rate) as usize).min(least / HELD_OUT).max(1);
    let mut number = 0;
    let each = frames.iter().map(|frame| {
        let is_shared = is_shared(frame);
        let is_held_out = is_shared && number / stretch % HELD_OUT == HELD_OUT / 2;
        number += usize::from(is_shared);
        is_held_out
    });
    each.collect()
}

/// Frames of which those that are kept apart are empty, so that times stay what they are.
fn without(frames: &[Vec<Detections>], held_out: &[bool]) -> Vec<Vec<Detections>> {
    let mut used = frames.to_vec();
    for (frame, _) in used.iter_mut().zip(held_out).filter(|f| *f.1) {
        frame.iter_mut().for_each(Vec::clear);
    }
    used
}

/// Brings cameras to the floor and to the room's size, of which all frames tell: where joints are seen by cameras that
/// are moved, turned and scaled together does not change.
fn stand(
    lenses: &[View],
    mut cameras: Vec<Pose>,
    frames: &[Vec<Detections>],
    held_out: &[bool],
    rate: f64,
    stature: f64,
) -> Result<Room, CalibrateError> {
    let tracks = people(lenses, &cameras, frames, rate)?;
    let sizes = Sizes::new(lenses, &cameras, &tracks);
    let size = sizes.of_room()?;
    rescale(&mut cameras, stature / f64::from(CANONICAL_STATURE) / size);
    let taller = sizes.tallest_followed().map(|other| stature * other / size);
    let taller = taller.filter(|metres| *metres > TALLER * stature);
    let joints: Vec<world::Joints> = tracks
        .iter()
        .flat_map(|t| joints(lenses, &cameras, t))
        .collect();
    let floor = world::floor(&joints, stature).ok_or(CalibrateError::NoSize)?;
    let cameras = world::upright(&cameras, &floor).ok_or(CalibrateError::NoSize)?;
    let views = placed(lenses, &cameras);
    let is_sunk = |v: &&View| is_sunk(v.position, floor.by_feet);
    if let Some(v) = views.iter().find(is_sunk) {
        return Err(CalibrateError::UnderFloor(v.name.clone(), -v.position.z));
    }
    Ok(Room {
        quality: quality(&views, &tracks, frames, held_out, stature),
        views,
        stature,
        taller,
        floor_by_feet: floor.by_feet,
    })
}

fn placed(lenses: &[View], cameras: &[Pose]) -> Vec<View> {
    let each = lenses.iter().zip(cameras);
    each.map(|(lens, pose)| View {
        rotation: pose.rotation,
        position: pose.position,
        ..lens.clone()
    })
    .collect()
}

fn turned(view: &View, sight: &Sight) -> Sight {
    let mut sight = sight.clone();
    for ray in sight.rays.iter_mut().flatten() {
        ray.direction = (view.rotation.transpose() * ray.plane.extend(1.0)).normalize();
    }
    sight
}

/// What these views saw of a moment.
fn seen_by(views: &[View], moment: &Moment) -> Vec<Option<Sight>> {
    let each = views.iter().zip(&moment.sights);
    each.map(|(view, s)| Some(turned(view, s.as_ref()?)))
        .collect()
}

fn refs(sights: &[Option<Sight>]) -> Vec<Option<&Sight>> {
    sights.iter().map(Option::as_ref).collect()
}

/// Who is who, by cameras that are about right; whoever is seen most first.
fn people(
    lenses: &[View],
    cameras: &[Pose],
    frames: &[Vec<Detections>],
    rate: f64,
) -> Result<Vec<Track>, CalibrateError> {
    let views = placed(lenses, cameras);
    let one = |(view, all): (&View, &Detections)| all.iter().map(|s| turned(view, s)).collect();
    let placed: Vec<Vec<Detections>> = frames
        .iter()
        .map(|frame| views.iter().zip(frame).map(one).collect())
        .collect();
    let mut tracks = track(&views, &placed, rate);
    tracks.sort_by_key(|t| std::cmp::Reverse(t.moments.len()));
    let seen: usize = tracks.iter().map(|t| t.moments.len()).sum();
    if seen < LEAST_USED {
        let shared = shared(frames);
        return Err(CalibrateError::Untracked { seen, shared });
    }
    Ok(tracks)
}

/// Joints of one person by these cameras, frame by frame.
fn joints(lenses: &[View], cameras: &[Pose], track: &Track) -> Vec<world::Joints> {
    let views = placed(lenses, cameras);
    let all = track.moments.iter().map(|(_, moment)| {
        let sights = seen_by(&views, moment);
        triangulate(&views, &refs(&sights)).points
    });
    all.collect()
}

/// Whether a camera at `position`, world, is farther below the floor than this may be tilted; `by_slope` says whether
/// feet or a board told its slope.
fn is_sunk(position: DVec3, by_slope: bool) -> bool {
    let [most, share] = match by_slope {
        true => SUNK_BY_FEET,
        false => SUNK_BY_AXES,
    };
    position.z < -(most + share * position.truncate().length())
}

/// How tall people of tracks are. Whoever leaves and comes back has several tracks, of about one size.
struct Sizes {
    /// Shares of the canonical size, the greatest first, and the frames of the track.
    all: Vec<(f64, Vec<usize>)>,
    /// Frames of the longest track, whether or not it tells a size.
    longest: usize,
}

impl Sizes {
    fn new(lenses: &[View], cameras: &[Pose], tracks: &[Track]) -> Self {
        let one = |track: &Track| {
            let size = world::size(&joints(lenses, cameras, track))?;
            Some((size, track.moments.iter().map(|m| m.0).collect()))
        };
        let mut all: Vec<(f64, Vec<usize>)> = tracks.iter().filter_map(one).collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        let longest = tracks.iter().map(|t| t.moments.len()).max().unwrap_or(0);
        Self { all, longest }
    }

    /// In how many frames somebody of this size is seen, or of up to [`TALLER`] times as much: two at one time count
    /// as one.
    fn frames(&self, size: f64) -> usize {
        let alike = |other: f64| (size..=TALLER * size).contains(&other);
        let tracks = self.all.iter().filter(|(other, _)| alike(*other));
        let mut frames: Vec<usize> = tracks.flat_map(|(_, frames)| frames).copied().collect();
        frames.sort_unstable();
        frames.dedup();
        frames.len()
    }

    /// The greatest size of which somebody is seen in at least `least` frames.
    fn tallest(&self, least: usize) -> Option<f64> {
        let mut sizes = self.all.iter().map(|(size, _)| *size);
        sizes.find(|size| self.frames(*size) >= least)
    }

    /// The size that gives the room its own: the greatest of those that are seen at least half as long as the longest
    /// track. Several people may be of one size, so that what one of them adds up to is no measure of the others.
    fn of_room(&self) -> Result<f64, CalibrateError> {
        let tallest = self.tallest(self.longest.div_ceil(2));
        tallest.ok_or(CalibrateError::NoSize)
    }

    /// The greatest size of a track of [`LEAST_FRAMES`] or more: shorter ones may be of nobody, also several.
    fn tallest_followed(&self) -> Option<f64> {
        let is_long = |(_, frames): &&(f64, Vec<usize>)| frames.len() >= LEAST_FRAMES;
        self.all.iter().find(is_long).map(|(size, _)| *size)
    }
}

fn rescale(cameras: &mut [Pose], factor: f64) {
    let first = cameras[0].position;
    for c in cameras {
        c.position = first + factor * (c.position - first);
    }
}

/// Moves the cameras so that views agree on everyone's joints.
fn refine(cameras: &mut Vec<Pose>, tracks: &[Track], sigma: f64) {
    let (mut seen, mut points) = (Vec::new(), Vec::new());
    for (_, moment) in tracks.iter().flat_map(|t| &t.moments) {
        for j in 0..EVIDENCE_JOINTS {
            let rays = moment.sights.iter().enumerate();
            let of_joint = rays.filter_map(|(camera, s)| {
                let ray = s.as_ref()?.rays[j]?;
                Some(Seen {
                    camera,
                    point: points.len(),
                    plane: ray.plane,
                    weight: ray.confidence,
                })
            });
            let of_joint: Vec<Seen> = of_joint.collect();
            if let Some(start) = moment.joints[j].filter(|_| of_joint.len() > 1) {
                points.push(start);
                seen.extend(of_joint);
            }
        }
    }
    bundle(cameras, &mut points, &seen, sigma);
}

/// How many rays go through the joints that they are of, each from 0 to 1.
fn agreement(views: &[View], tracks: &[Track]) -> f64 {
    let mut sum = 0.0;
    for (_, moment) in tracks.iter().flat_map(|t| &t.moments) {
        for (view, sight) in views.iter().zip(&moment.sights) {
            let rays = sight.iter().flat_map(|s| s.rays.iter().zip(&moment.joints));
            for (ray, joint) in rays {
                if let (Some(ray), Some(joint)) = (ray, joint) {
                    let direction = view.rotation.transpose() * ray.plane.extend(1.0).normalize();
                    let off = distance(view.position, direction, *joint) / CLOSE;
                    sum += 1.0 / (1.0 + off * off);
                }
            }
        }
    }
    sum
}

/// How well poses that two views lifted go together when they are turned into the world, from 0 to 1; 1 where nobody
/// was lifted. It tells a room from its mirror image.
fn alike(views: &[View], tracks: &[Track]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (_, moment) in tracks.iter().flat_map(|t| &t.moments) {
        let lifted = views.iter().zip(&moment.sights);
        let lifted: Vec<(DMat3, turn::Lifted)> = lifted
            .filter_map(|(view, sight)| Some((view.rotation, sight.as_ref()?.lifted?)))
            .collect();
        for (k, (b, q)) in lifted.iter().enumerate() {
            for (a, p) in &lifted[..k] {
                sum += turn::agreement(&(*b * a.transpose()), &(*p, *q));
                count += 1.0;
            }
        }
    }
    if count > 0.0 { sum / count } else { 1.0 }
}

/// How well views agree; `held_out` says of every frame whether it placed no camera, `stature` how tall people are,
/// metres.
fn quality(
    views: &[View],
    tracks: &[Track],
    frames: &[Vec<Detections>],
    held_out: &[bool],
    stature: f64,
) -> Vec<ViewQuality> {
    let mut sums = vec![[(0.0, 0.0); 2]; views.len()];
    let (mut far, mut sights) = (vec![0.0; views.len()], vec![0; views.len()]);
    let mut met = vec![0; views.len()];
    for (frame, moment) in tracks.iter().flat_map(|t| &t.moments) {
        let turned = seen_by(views, moment);
        let found = triangulate(views, &refs(&turned));
        let is_met = turned.iter().flatten().count() > 1;
        for (v, (view, sight)) in views.iter().zip(&turned).enumerate() {
            let Some(sight) = sight else { continue };
            sights[v] += 1;
            met[v] += usize::from(is_met);
            for (ray, point) in sight.rays.iter().zip(found.points) {
                let (Some(ray), Some(point)) = (ray, point) else {
                    continue;
                };
                let Some(pixel) = view.project(point) else {
                    continue;
                };
                let off = pixel.distance(ray.pixel);
                if off * view.to_camera(point).z / view.focal.y > FAR {
                    far[v] += 1.0;
                } else {
                    let (sum, count) = &mut sums[v][usize::from(held_out[*frame])];
                    *sum += off * off;
                    *count += 1.0;
                }
            }
        }
    }
    let one = |(v, view): (usize, &View)| {
        let rms = |(sum, count): (f64, f64)| (count > 0.0).then(|| (sum / count).sqrt());
        let [used, held] = sums[v].map(rms);
        let count = sums[v].iter().map(|s| s.1).sum::<f64>() + far[v];
        ViewQuality {
            name: view.name.clone(),
            sights: sights[v],
            rms_px: used.unwrap_or(0.0),
            held_out_rms_px: held,
            far_percent: 100.0 * far[v] / count.max(1.0),
            alone_percent: alone_percent(views, frames, stature, v, met[v]),
            height_m: view.position.z,
        }
    };
    views.iter().enumerate().map(one).collect()
}

/// Share of a view's sights that went with no other view's, %, of those that could have: at that time another view saw
/// somebody who may be in this one's picture as well, and the other way round. `met`: how many went with others.
fn alone_percent(
    views: &[View],
    frames: &[Vec<Detections>],
    stature: f64,
    view: usize,
    met: usize,
) -> f64 {
    // Sights of one camera that may be in the other's picture.
    let within = |frame: &[Detections], of: usize, other: usize| {
        let may_be = |s: &&Sight| {
            about(&views[of], s, stature).is_none_or(|place| is_in_picture(&views[other], place))
        };
        frame[of].iter().filter(may_be).count()
    };
    let confirmable = |frame: &Vec<Detections>| {
        let others = (0..views.len()).filter(|v| *v != view && !frame[*v].is_empty());
        let with = others.map(|v| within(frame, view, v).min(within(frame, v, view)));
        with.max().unwrap_or(0)
    };
    let could: usize = frames.iter().map(confirmable).sum();
    100.0 * could.saturating_sub(met) as f64 / could.max(1) as f64
}

/// Whether a world point is in a view's picture.
fn is_in_picture(view: &View, point: DVec3) -> bool {
    let [width, height] = view.likely_size().map(f64::from);
    let is_within = |p: DVec2| p.x >= 0.0 && p.y >= 0.0 && p.x < width && p.y < height;
    view.project(point).is_some_and(is_within)
}

/// About where somebody of `stature` metres is whom a view saw so, world; `None` where nobody has lifted them.
fn about(view: &View, sight: &Sight, stature: f64) -> Option<DVec3> {
    let depth = sight.depth()? * stature / f64::from(CANONICAL_STATURE);
    let seen = sight.rays.iter().flatten();
    let (sum, count) = seen.fold((DVec2::ZERO, 0.0), |(s, n), ray| (s + ray.plane, n + 1.0));
    let place = depth * (sum / count).extend(1.0);
    (depth > 0.0).then(|| view.position + view.rotation.transpose() * place)
}

#[cfg(test)]
mod tests;
