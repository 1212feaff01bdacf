//! Who is who: detections of several views go in frame by frame, people with one detection a view and an identity over
//! time come out.
//!
//! Known people take the detections whose rays pass near their joints; what is left is grouped so that within a group
//! every view agrees with every other. Somebody new must persist and be built like a body: two views alone see ghosts.

mod body_shape;
mod distance;
mod live_track;
mod look;
#[cfg(test)]
mod mannequin;
mod near;
mod rejoin;
mod take;

use glam::DVec3;

pub use self::body_shape::is_body;
use self::live_track::{Live, empty};
pub(super) use self::look::is_one_body;
use self::look::{Look, merge};
pub use self::near::{closeness, matched, nearest_sight};
pub(super) use self::rejoin::{Followed, rejoin};
pub(super) use self::take::reach;
use self::take::{Standing, take};
use super::exchange;
use super::moment::Moment;
use super::sight::Sight;
use crate::assignment::Matcher;
use crate::camera::View;
use crate::joints::EVIDENCE_JOINTS;

/// Seconds without any view after which somebody is gone, and without two of them: one view alone may follow somebody
/// else.
const MEMORY: f64 = 1.0;
pub(super) const ONE_VIEW: f64 = 10.0;
/// Seconds, from frame to frame, for which three views or more must agree about somebody before they count, and two:
/// three frames and ten at 30 a second, and a little less, so that neither rounding nor uneven times decide anything.
pub(super) const PROOF: [f64; 2] = [0.055, 0.285];

/// Everyone one view sees in one frame.
pub type Detections = Vec<Sight>;

/// Joints of one person in space, world axes, metres; `None` where they are not known.
pub(super) type Joints = [Option<DVec3>; EVIDENCE_JOINTS];

/// Everyone in one frame, by view.
type Frame<'a> = [&'a [Sight]];

/// One person over time.
#[derive(Debug, Clone)]
pub struct Track {
    /// From 1, by first frame.
    pub id: u32,
    /// Frames with at least one view, rising.
    pub moments: Vec<(usize, Moment)>,
}

/// Finds everyone in `frames`: per frame, per view, who is seen there. `rate` is frames a second.
pub fn track(views: &[View], frames: &[Vec<Detections>], rate: f64) -> Vec<Track> {
    track_by(views, &vec![true; views.len()], frames, rate)
}

/// The same by some of the views: of those that are not `used` nobody is taken.
pub(super) fn track_by(
    views: &[View],
    used: &[bool],
    frames: &[Vec<Detections>],
    rate: f64,
) -> Vec<Track> {
    let frames_in = |seconds: f64| (seconds * rate).round().max(1.0) as usize;
    let (patience, alone) = (frames_in(MEMORY), frames_in(ONE_VIEW));
    let needed = frames_needed(frames.len(), rate);
    let (mut live, mut done): (Vec<Live>, Vec<Live>) = (Vec::new(), Vec::new());
    let mut matcher = Matcher::default();
    for (f, frame) in frames.iter().enumerate() {
        let seen = frame.iter().zip(used);
        let seen = seen.map(|(d, used)| if *used { &d[..] } else { &[] });
        let frame: &Frame<'_> = &seen.collect::<Vec<_>>();
        let mut gone = Vec::new();
        live.retain_mut(|t| {
            let stays = match is_proven(t.proof, needed) {
                true => f - t.seen <= patience && f - t.met <= alone,
                false => f - t.met <= patience,
            };
            if !stays {
                gone.push(std::mem::replace(t, empty()));
            }
            stays
        });
        done.extend(gone);
        let standing = live.iter().map(|t| Standing {
            is_proven: is_proven(t.proof, needed),
            is_absent: t.is_absent(f),
            reach: [0, t.away(f)].map(|missed| reach(missed as f64 / rate, 1.0 / rate)),
            ahead: t.ahead(f, rate),
        });
        let standing: Vec<Standing> = standing.collect();
        let mut taken = take(views, frame, &live, &standing, &mut matcher);
        let followed = live.iter().map(|t| {
            (t.away(f) > 0).then(|| Followed {
                joints: t.joints,
                seen_by: t.seen_by(),
                is_absent: t.is_absent(f),
            })
        });
        let followed: Vec<Option<Followed>> = followed.collect();
        let sights: Vec<Vec<&Sight>> = frame.iter().map(|d| d.iter().collect()).collect();
        let new = rejoin(views, &sights, &followed, |_, _, _| true, &mut taken);
        let each = taken.into_iter().chain(new);
        let looks = each.map(|chosen| Look::new(views, frame, chosen));
        let mut looks: Vec<Option<Look>> = looks.collect();
        live.resize_with(looks.len(), empty);
        merge(views, frame, &mut looks, &mut live, needed);
        for (t, look) in live.iter_mut().zip(looks) {
            if let Some(look) = look {
                t.add(views, f, look, rate);
            }
        }
        // Somebody new must be built like a body; of two who are one there is nothing left.
        live.retain(|t| match t.moments.len() {
            0 => false,
            1 => is_body(&t.joints),
            _ => true,
        });
    }
    done.extend(live);
    done.retain(|t| is_proven(t.proof, needed));
    done.sort_by_key(|t| t.moments[0].0);
    let number = |(k, t): (usize, Live)| Track {
        id: k as u32 + 1,
        moments: settled(t, rate),
    };
    done.into_iter().enumerate().map(number).collect()
}

/// Whether somebody counts whom three views or more have seen for so long, and two, where so much is needed of both.
pub(super) fn is_proven<T>(proof: [T; 2], needed: [T; 2]) -> bool
where
    T: Copy + PartialOrd + std::ops::Add<Output = T>,
{
    proof[0] >= needed[0] || proof[0] + proof[1] >= needed[1]
}

/// The same in frames, of which a sequence has so many: of one frame nobody can ask for more.
fn frames_needed(frames: usize, rate: f64) -> [usize; 2] {
    PROOF.map(|seconds| (1.0 + (seconds * rate).ceil()).min(frames as f64) as usize)
}

/// A person's frames with left and right as they are.
fn settled(mut t: Live, rate: f64) -> Vec<(usize, Moment)> {
    let times: Vec<f64> = t.moments.iter().map(|(f, _)| *f as f64 / rate).collect();
    let mut moments: Vec<&mut Moment> = t.moments.iter_mut().map(|(_, m)| m).collect();
    exchange::settle(&times, &mut moments, &mut t.states);
    for (moment, states) in moments.into_iter().zip(&t.states) {
        moment.healed = states.iter().map(|s| s.count_ones() as usize).sum();
    }
    t.moments
}

#[cfg(test)]
mod tests {
    use super::mannequin::{seen, standing};
    use super::*;

    /// For four seconds one view sees the upper body alone, the other the legs, while they walk.
    #[test]
    fn views_that_share_no_joint_go_on_with_somebody() {
        let views = [0.0, 90.0].map(View::around);
        let at = |f: usize| {
            standing(f64::from(f.saturating_sub(30).min(120) as u32) * 0.3 / 30.0 * DVec3::X)
        };
        let frames = (0..180).map(|f| {
            let shown = match (30..150).contains(&f) {
                true => [0..8, 8..EVIDENCE_JOINTS],
                false => [0..EVIDENCE_JOINTS, 0..EVIDENCE_JOINTS],
            };
            let each = views.iter().zip(shown);
            each.map(|(view, shown)| vec![seen(view, &at(f), shown)])
                .collect()
        });
        let frames: Vec<Vec<Detections>> = frames.collect();
        let people = track(&views, &frames, 30.0);
        assert_eq!(people.len(), 1);
        assert_eq!(people[0].moments.len(), frames.len());
        for (f, moment) in &people[0].moments {
            assert!(moment.sights.iter().all(Option::is_some), "frame {f}");
        }
    }
}
