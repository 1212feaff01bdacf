//! How well two views agree if one's clock is so far ahead: distances of rays that should meet.

use super::trails::{Joints, Trail};
use crate::camera::View;
use crate::joints::{EVIDENCE_JOINTS, MIRROR};
use crate::multiview::sight::between;

/// Distance beyond which rays are about something else, metres.
const FAR: f64 = 0.3;
/// Joints compared of two people at least, at least so many times, and for this share of the time of one of them.
const LEAST_JOINTS: usize = 4;
const LEAST_TIMES: usize = 6;
const LEAST_SHARE: f64 = 0.3;
/// By what factor rays must be nearer on average, squared, for all sides to be exchanged.
const CLEARLY: f64 = 0.5;
/// Most times at which one person is looked at.
const MOST_TIMES: usize = 240;

/// A view and whom it follows.
pub struct Followed<'a> {
    /// The camera.
    pub view: &'a View,
    /// The people.
    pub trails: &'a [Trail],
}

/// Mean squared distance of rays, far ones counted as `FAR`, and how many were compared.
#[derive(Debug, Clone, Copy, Default)]
pub struct Agreement {
    /// Square metres.
    pub sum: f64,
    /// Times and joints.
    pub count: f64,
}

impl Agreement {
    /// Mean, square metres; `None` where nothing was compared.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0.0).then(|| self.sum / self.count)
    }

    /// Of both.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            sum: self.sum + other.sum,
            count: self.count + other.count,
        }
    }
}

/// Compares two views, what the first sees at a time with what the second sees `offset` seconds later on its own clock.
/// Everybody of the first is whoever of the second agrees best. `times`: most times to look at, fewer for a rough
/// answer.
pub fn agreement(a: &Followed<'_>, b: &Followed<'_>, offset: f64, times: usize) -> Agreement {
    let mut all = Agreement::default();
    for own in a.trails {
        let stride = own.times.len().div_ceil(times.clamp(1, MOST_TIMES));
        let looks = own.times.len().div_ceil(stride);
        let best = at_one_time(own, b.trails, offset)
            .filter_map(|other| {
                let (mut sum, mut joints, mut seen) = (0.0, 0, 0);
                for k in (0..own.times.len()).step_by(stride) {
                    let Some(then) = other.at(own.times[k] + offset) else {
                        continue;
                    };
                    if let Some((d, n)) = apart((a.view, &own.joints[k]), (b.view, &then)) {
                        sum += d;
                        joints += n;
                        seen += 1;
                    }
                }
                let enough = seen >= LEAST_TIMES && seen as f64 >= LEAST_SHARE * looks as f64;
                enough.then_some(Agreement {
                    sum,
                    count: joints as f64,
                })
            })
            .min_by(|x, y| (x.sum / x.count).total_cmp(&(y.sum / y.count)));
        if let Some(best) = best {
            all = all.plus(&best);
        }
    }
    all
}

/// Those whom the second view saw while the first one saw `own`: a long film has many who came and went before.
fn at_one_time<'a>(own: &Trail, all: &'a [Trail], offset: f64) -> impl Iterator<Item = &'a Trail> {
    let [begin, end] = own.span().map(|t| t + offset);
    all.iter().filter(move |other| {
        let [first, last] = other.span();
        first <= end && begin <= last
    })
}

/// Sum of squared distances of the rays of two people's joints, sides exchanged where that is nearer, and how many they
/// share.
fn apart((va, a): (&View, &Joints), (vb, b): (&View, &Joints)) -> Option<(f64, usize)> {
    let direction =
        |view: &View, p: glam::DVec2| (view.rotation.transpose() * p.extend(1.0)).normalize();
    let rays = |view: &View, joints: &Joints| joints.map(|p| Some(direction(view, p?)));
    let (a, b) = (rays(va, a), rays(vb, b));
    let of = |other: bool| {
        let each = (0..EVIDENCE_JOINTS).filter_map(|j| {
            let k = if other { MIRROR[j] } else { j };
            let d = between(va.position, a[j]?, vb.position, b[k]?).min(FAR);
            Some(d * d)
        });
        each.fold((0.0, 0), |(s, n), d| (s + d, n + 1))
    };
    let (told, other) = (of(false), of(true));
    // Where both views see one side alone, sides exchanged share head and neck and little else.
    let mean = |(sum, count): (f64, usize)| sum / count as f64;
    let is_nearer = other.1 >= LEAST_JOINTS && mean(other) < CLEARLY * mean(told);
    (told.1 >= LEAST_JOINTS).then_some(if is_nearer { other } else { told })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::{HEAD_TOP, NECK, R_ANKLE, R_ELBOW, R_HIP, R_KNEE, R_SHOULDER, R_WRIST};

    #[test]
    fn only_who_is_there_at_the_time_is_compared() {
        let trail = |begin: f64| Trail::still([begin, begin + 4.0]);
        let all: Vec<Trail> = (0..100).map(|k| trail(10.0 * f64::from(k))).collect();
        let begins = |offset: f64| -> Vec<f64> {
            let found = at_one_time(&all[50], &all, offset);
            found.map(|other| other.span()[0]).collect()
        };
        assert_eq!(begins(0.0), [500.0]);
        assert_eq!(begins(-3.5), [500.0]);
        assert!(begins(5.0).is_empty());
        assert_eq!(begins(8.0), [510.0]);
        assert_eq!(begins(-10.0), [490.0]);
    }

    /// Two figures before two views, each of these joints alone, whose rays miss each other by so much, metres.
    fn figures(shown: &[usize], off: f64) -> [(View, Joints); 2] {
        [(0.0, 0.5), (90.0, -0.5)].map(|(degrees, share)| {
            let view = View::around(degrees);
            let mut joints = Joints::default();
            for &j in shown {
                let side = if MIRROR[j] > j { -0.2 } else { 0.2 };
                // The world's y goes down, and both cameras are at 0.
                let height = 0.1 * (j.min(MIRROR[j])) as f64 - 0.5 + share * off;
                let point = view.to_camera(glam::DVec3::new(side, height, 0.1 * side));
                joints[j] = Some(point.truncate() / point.z);
            }
            (view, joints)
        })
    }

    #[test]
    fn one_side_alone_is_compared_joint_by_joint() {
        let right = [
            HEAD_TOP, NECK, R_SHOULDER, R_ELBOW, R_WRIST, R_HIP, R_KNEE, R_ANKLE,
        ];
        let [a, b] = figures(&right, 0.03);
        let (sum, count) = apart((&a.0, &a.1), (&b.0, &b.1)).unwrap();
        assert_eq!(count, right.len());
        assert!((sum / count as f64).sqrt() < 0.04, "{sum}");
    }

    #[test]
    fn sides_that_one_view_exchanges_are_compared_with_those_of_the_other() {
        let all: Vec<usize> = (0..EVIDENCE_JOINTS).collect();
        let [mut a, b] = figures(&all, 0.01);
        let side = |joints: &mut Joints, j: usize| joints.swap(j, MIRROR[j]);
        (2..EVIDENCE_JOINTS)
            .filter(|j| MIRROR[*j] > *j)
            .for_each(|j| side(&mut a.1, j));
        let (sum, count) = apart((&a.0, &a.1), (&b.0, &b.1)).unwrap();
        assert!(
            count == EVIDENCE_JOINTS && (sum / count as f64).sqrt() < 0.02,
            "{sum}"
        );
    }
}
