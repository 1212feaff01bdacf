//! In: tracks, where they are expected, and the people seen. Out: how unlike each pair is. XNect §5.1.

use glam::DVec3;

use crate::body::skeleton::Posed;
use crate::camera::translation::DEPTHS;
use crate::fit::appearance::Appearance;
use crate::fit::config::IdentityConfig;
use crate::fit::evidence::Evidence;
use crate::fit::track::Track;
use crate::joints::PELVIS;

/// Distance in the picture, metres at the person's distance, that counts as 1 at once …
const NEAR: f64 = 0.35;
/// … and its growth per second without being seen, beyond the interval of a usual camera, seconds.
const SPREAD: f64 = 1.0;
const USUAL: f64 = 0.05;
/// The same where looks are not seen: for somebody seen a frame ago and after an absence, and the longest absence,
/// seconds.
const BLIND_NEAR: [f64; 2] = [0.25, 0.15];
const BLIND_TRUST: f64 = 0.25;
/// Speed, m/s, at which somebody who is not seen may leave the expected place; and where no colours tell people apart.
const PACE: [f64; 2] = [1.5, 1.0];
/// Joints farther than this (metres) are simply elsewhere.
const CAP: f64 = 1.0;
/// Weight of the mean 3D joint distance, per metre.
const SHAPE: f64 = 0.6;
/// Difference of depth that one person has from frame to frame, e-folds.
const DEPTH_NOISE: f64 = 0.08;
/// Weight of what is beyond it, per e-fold, and its most: legs that are not seen may be invented, and the whole person
/// with them be far off.
const DEPTH: f64 = 4.0;
const MOST_DEPTH: f64 = 0.7;
/// Share of somebody's distance by which looks at them before and after an absence may be apart in depth.
const DEPTH_SLACK: f64 = 0.15;
/// Difference of appearance that one person has from frame to frame.
const LOOKS_NOISE: f64 = 0.15;
/// Difference of appearance after an absence, as a share of `reidentify_appearance`, that nothing makes up for.
pub const VETO: f64 = 1.35;
/// Weight of the place among people whose looks may be one person's: more than the looks of one person differ by from
/// frame to frame, less than those of two who are dressed differently.
const BESIDE_LOOKS: f64 = 0.4;
/// Longest absence, seconds, after which somebody is recognised by the place alone.
const BY_PLACE: f64 = 3.0;
/// Handicap per second without being seen, up to one second.
const ABSENT: f64 = 0.25;

/// Dissimilarity of a track, expected at `expected`, and a person seen; infinite where they cannot be the same.
pub fn dissimilarity(
    track: &Track,
    expected: &Posed,
    seen: &Evidence,
    appearance: Option<&Appearance>,
    dt: f64,
    config: &IdentityConfig,
) -> f64 {
    let Some(apart) = seen.distance2d(expected, CAP) else {
        return f64::INFINITY;
    };
    let waited = (dt - USUAL).max(0.0);
    let alone = track.unseen + waited;
    let walked = seen
        .root
        .map_or(apart, |root| apart_in_picture(root, expected));
    let colourless = is_colourless(track.appearance.as_ref(), appearance);
    let pace = PACE[usize::from(colourless)];
    if walked > 0.7 && walked > 0.5 + pace * alone {
        return f64::INFINITY;
    }
    // Where looks that could tell are not seen, only somebody who was here a moment ago continues, and only close by:
    // else whoever comes out of hiding first would take the place of whoever is still hidden. At few frames a second a
    // moment is one frame.
    let unknown_looks = track.appearance.is_some() != appearance.is_some();
    if unknown_looks && track.unseen - waited > BLIND_TRUST {
        return f64::INFINITY;
    }
    let near = if unknown_looks {
        BLIND_NEAR[usize::from(track.unseen > 0.0)] + SPREAD * waited
    } else {
        NEAR + SPREAD * alone.min(1.0)
    };
    let mut cost = apart / near;
    if let Some(shape) = seen.distance3d(expected, 0.5) {
        cost += SHAPE * shape;
    }
    if let Some(root) = seen.root {
        let depth = expected.joints[PELVIS].z.max(0.1);
        let apart = (root.z / depth).ln().abs();
        cost += (DEPTH * (apart - DEPTH_NOISE).max(0.0)).min(MOST_DEPTH);
    }
    let absent = track.unseen.min(1.0);
    cost += ABSENT * absent;
    cost += match (&track.appearance, appearance) {
        (Some(a), Some(b)) => {
            let unlike = a.distance(b);
            // Whoever was out of sight and comes back in other clothes is somebody else.
            if track.unseen > 0.0 && unlike > VETO * config.reidentify_appearance {
                return f64::INFINITY;
            }
            config.appearance_weight * (unlike - LOOKS_NOISE).max(0.0)
        }
        _ => 0.0,
    };
    cost
}

/// Distance in the picture between a pelvis that is seen and where it is expected, metres at the expected distance.
fn apart_in_picture(root: DVec3, expected: &Posed) -> f64 {
    let there = expected.joints[PELVIS];
    let depth = there.z.max(DEPTHS[0]);
    (root.truncate() / root.z - there.truncate() / depth).length() * depth
}

/// Whether neither of two has any colour: everybody looks alike then.
fn is_colourless(a: Option<&Appearance>, b: Option<&Appearance>) -> bool {
    let has_colour = |looks: Option<&Appearance>| looks.is_some_and(Appearance::has_colour);
    !has_colour(a) && !has_colour(b)
}

/// How unlike a newcomer and somebody last seen `gone` seconds ago are; up to 1 they may be the same person.
pub fn reidentification(newcomer: &Track, left: &Track, gone: f64, config: &IdentityConfig) -> f64 {
    let (unlike, apart) = (unlike(newcomer, left, config), apart(newcomer, left));
    by_looks_or_place(unlike, besides_looks(newcomer, left, gone), apart, gone)
}

/// How far a newcomer stands from where somebody stood `gone` seconds ago who may make sure of them.
pub fn confirmation(newcomer: &Track, left: &Track, gone: f64, config: &IdentityConfig) -> f64 {
    let (unlike, apart) = (unlike(newcomer, left, config), apart(newcomer, left));
    by_former_place(unlike, apart, gone)
}

/// Difference of looks as a share of the most that one person has; `None` where looks tell nothing.
fn unlike(newcomer: &Track, left: &Track, config: &IdentityConfig) -> Option<f64> {
    let (a, b) = (newcomer.appearance.as_ref()?, left.appearance.as_ref()?);
    a.unlike(b, config.reidentify_appearance)
}

/// How unlike two are whose looks differ by so much, as a share of the most that one person has, or tell nothing,
/// against whom so much else speaks, and who are so many metres apart after `gone` seconds; up to 1 they may be the
/// same person.
pub fn by_looks_or_place(unlike: Option<f64>, besides: f64, apart: f64, gone: f64) -> f64 {
    match unlike {
        // Of those dressed alike the nearest is the likeliest, which says less the longer the absence was. It excludes
        // nobody: people walk.
        Some(unlike) => {
            let (other, place) = (unlike + besides, by_place(apart, gone).min(1.0));
            other + BESIDE_LOOKS * place * (1.0 - other).max(0.0)
        }
        // Nothing tells people apart: only somebody who vanished just now and just here.
        None if gone < BY_PLACE => by_place(apart, gone) + besides,
        None => f64::INFINITY,
    }
}

/// How far somebody is from where another one stood who left [`BY_PLACE`] seconds ago or longer; up to 1 is near. They
/// need not be the same, but two sights of one place make sure that somebody is there. Infinite where looks tell, or
/// the absence was shorter.
pub fn by_former_place(unlike: Option<f64>, apart: f64, gone: f64) -> f64 {
    match unlike {
        None if gone >= BY_PLACE => by_place(apart, BY_PLACE),
        _ => f64::INFINITY,
    }
}

/// How unlike two are by the place alone, so many metres apart after `gone` seconds; up to 1 they may be the same
/// person.
fn by_place(apart: f64, gone: f64) -> f64 {
    apart / (0.5 + PACE[1] * gone)
}

/// Whether a newcomer without looks may turn out, once they are seen, to be somebody last seen `gone` seconds ago.
pub fn looks_may_tell(newcomer: &Track, left: &Track, gone: f64) -> bool {
    left.appearance.is_some_and(|looks| looks.has_colour())
        && besides_looks(newcomer, left, gone) <= 1.0
}

/// What speaks against it besides looks.
fn besides_looks(newcomer: &Track, left: &Track, gone: f64) -> f64 {
    // Both were seen in one picture: that in which the one who left was seen last, or the newcomer's first.
    let first = newcomer.age - gone;
    if newcomer.seen_for >= gone || (0.0..=left.seen_for).contains(&first) {
        return f64::INFINITY;
    }
    let proportions = newcomer
        .bones
        .difference(&left.bones)
        .map_or(0.0, |d| (d / 0.15).min(1.0));
    let farther = (apart(newcomer, left) - 0.5 - 2.5 * gone).clamp(0.0, 2.0);
    0.3 * proportions + 0.5 * farther + 0.001 * gone
}

/// How far one has to have walked meanwhile, metres at canonical stature.
fn apart(newcomer: &Track, left: &Track) -> f64 {
    let (here, there) = (newcomer.pose.position, left.pose.position);
    let gap = here - there;
    let along = (gap.z.abs() - DEPTH_SLACK * here.z.min(there.z)).max(0.0);
    gap.truncate().length().hypot(along)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What speaks against two whose looks differ by so much and who are so many metres apart.
    fn alike(unlike: f64, apart: f64, gone: f64) -> f64 {
        by_looks_or_place(Some(unlike), 0.0, apart, gone)
    }

    #[test]
    fn the_place_tells_those_apart_who_are_dressed_alike() {
        // One look of one person differs from another by about 0.3, give or take 0.1.
        for gone in [1.1, 2.0, 3.0] {
            let (here, there) = (alike(0.4, 0.0, gone), alike(0.3, 1.5, gone));
            assert!(here < there, "{gone} s: {here}, {there}");
        }
        let fades = [1.1, 5.0, 30.0].map(|gone| alike(0.3, 1.5, gone) - 0.3);
        assert!(fades[0] > fades[1] && fades[1] > fades[2], "{fades:?}");
        assert!(fades[2] < 0.02, "{fades:?}");
    }

    #[test]
    fn looks_that_differ_count_more_than_the_place_which_excludes_nobody() {
        for gone in [0.5, 1.1, 10.0] {
            let (own, other) = (alike(0.3, 3.0, gone), alike(0.8, 0.0, gone));
            assert!(own < other, "{gone} s: {own}, {other}");
            assert!(alike(0.99, 9.0, gone) < 1.0);
            assert_eq!(alike(1.2, 9.0, gone), 1.2);
            assert!(by_looks_or_place(Some(0.5), 0.49, 9.0, gone) < 1.0);
            assert_eq!(
                by_looks_or_place(Some(0.5), f64::INFINITY, 9.0, gone),
                f64::INFINITY
            );
        }
    }
}
