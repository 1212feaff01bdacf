//! Cameras that saw one board at one moment: placed one after the other, by what most of their moments say.

use super::adjust::Camera;
use super::placement::Placement;
use super::single::Single;
use crate::calibrate::pose::Pose;

/// What two moments say differs at most by this, where it counts: a quarter turn is no nearer than a half.
const MOST: f64 = 0.3;

/// Camera by camera, moment by moment: the board in the camera's axes, where it was seen.
pub type Sights = Vec<Vec<Option<Placement>>>;

/// Cameras and boards in the first camera's axes; boards that no camera saw are `None`.
///
/// # Errors
/// The number of a camera that shares no moment with most of the others.
pub fn link(
    singles: &[Single],
    sights: &Sights,
) -> Result<(Vec<Camera>, Vec<Option<Placement>>), usize> {
    let mut poses: Vec<Option<Pose>> = vec![None; sights.len()];
    poses[0] = Some(Pose::ORIGIN);
    while poses.iter().any(Option::is_none) {
        let open = (0..poses.len()).filter(|c| poses[*c].is_none());
        let said = open.map(|c| (c, said(c, &poses, sights)));
        let most = said.max_by_key(|(_, said)| said.len());
        let Some((camera, said)) = most.filter(|(_, said)| !said.is_empty()) else {
            return Err(outsider(sights));
        };
        poses[camera] = consensus(&said);
    }
    let poses: Vec<Pose> = poses.into_iter().flatten().collect();
    let cameras = singles.iter().zip(&poses).map(|(single, pose)| Camera {
        lens: single.lens,
        pose: *pose,
    });
    let moments = sights.first().map_or(0, Vec::len);
    let boards = (0..moments).map(|m| board(m, &poses, sights));
    Ok((cameras.collect(), boards.collect()))
}

/// A camera outside the largest group that shared moments link; of groups of one size outside the first.
fn outsider(sights: &Sights) -> usize {
    let both = |a: usize, b: usize| {
        let mut pairs = sights[a].iter().zip(&sights[b]);
        pairs.any(|(a, b)| a.is_some() && b.is_some())
    };
    let mut group: Vec<usize> = (0..sights.len()).collect();
    for b in 0..sights.len() {
        for a in 0..b {
            let (own, other) = (group[a], group[b]);
            if own != other && both(a, b) {
                group
                    .iter_mut()
                    .filter(|g| **g == other)
                    .for_each(|g| *g = own);
            }
        }
    }
    let size = |of: usize| group.iter().filter(|g| **g == of).count();
    let largest = (0..sights.len()).rev().max_by_key(|c| size(group[*c]));
    let is_outside = |c: &usize| largest.is_some_and(|l| group[*c] != group[l]);
    (0..sights.len()).find(is_outside).unwrap_or(0)
}

/// Where a camera is by every moment that it shares with a placed one, and how far boards were then.
fn said(camera: usize, poses: &[Option<Pose>], sights: &Sights) -> Vec<(Pose, f64)> {
    let others = poses
        .iter()
        .zip(sights)
        .filter_map(|(p, s)| Some(((*p)?, s)));
    others
        .flat_map(|(pose, theirs)| {
            let both = theirs.iter().zip(&sights[camera]);
            both.filter_map(move |(theirs, own)| {
                let own = (*own)?;
                let board = (*theirs)?.seen_from(pose);
                Some((board.camera_that_sees(own), own.position.length()))
            })
        })
        .collect()
}

/// The one to which the others are nearest.
fn consensus(said: &[(Pose, f64)]) -> Option<Pose> {
    let apart = |a: &Pose, (b, far): &(Pose, f64)| {
        let turn = a.rotation * b.rotation.transpose();
        let trace = turn.x_axis.x + turn.y_axis.y + turn.z_axis.z;
        let angle = ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos();
        (angle + a.position.distance(b.position) / far).min(MOST)
    };
    let sum = |a: &Pose| said.iter().map(|b| apart(a, b)).sum::<f64>();
    let all = said.iter().map(|(pose, _)| (*pose, sum(pose)));
    all.min_by(|a, b| a.1.total_cmp(&b.1)).map(|a| a.0)
}

/// The board of a moment in the world: by the camera whose word is nearest to what the others saw.
fn board(moment: usize, poses: &[Pose], sights: &Sights) -> Option<Placement> {
    let own: Vec<Placement> = poses
        .iter()
        .zip(sights)
        .filter_map(|(pose, s)| Some(s[moment]?.seen_from(*pose)))
        .collect();
    let sum = |a: &Placement| {
        let apart = own.iter().map(|b| {
            let turned = (a.rotation.z_axis - b.rotation.z_axis).length();
            (turned + a.position.distance(b.position)).min(MOST)
        });
        apart.sum::<f64>()
    };
    own.iter().copied().min_by(|a, b| sum(a).total_cmp(&sum(b)))
}
