//! People whom one view has followed alone, and what other views see: whose is it, and is somebody new there.

use std::collections::{HashMap, HashSet};

use super::Joints;
use super::body_shape::is_body;
use super::distance::depth;
use super::look::solve;
use super::near::REACH;
use crate::camera::View;
use crate::joints::{L_HIP, NECK, R_HIP};
use crate::multiview::exchange;
use crate::multiview::groups::{groups, ray_distance};
use crate::multiview::sight::Sight;

/// By what factor somebody may be nearer or farther than where one view has followed them to.
const NEARER: f64 = 1.15;

/// Somebody whom fewer than two views saw the last time.
#[derive(Debug)]
pub(in crate::multiview) struct Followed {
    /// Where their joints are about, by what one view tells.
    pub joints: Joints,
    /// By view, whether it saw them when somebody last did.
    pub seen_by: Vec<bool>,
    /// Whether nobody saw them the last time.
    pub is_absent: bool,
}

impl Followed {
    /// Whether what several views see may be a body, about where one of them has followed this person to.
    fn goes_on(&self, views: &[View], mut sights: Vec<Option<Sight>>) -> bool {
        exchange::agree(views, &mut sights);
        let joints = solve(views, &sights).points;
        let mut followed = (0..views.len()).filter(|&v| sights[v].is_some() && self.seen_by[v]);
        let is_near = |v: usize| {
            let [was, now] = [&self.joints, &joints].map(|joints| depth(&views[v], joints));
            let ratio = was.zip(now).map(|(was, now)| now / was);
            ratio.is_some_and(|r| (1.0 / NEARER..NEARER).contains(&r))
        };
        let is_told = [NECK, R_HIP, L_HIP].iter().all(|&j| joints[j].is_some());
        (is_body(&joints) || !is_told) && followed.all(is_near)
    }

    /// Of two views' detections the one that is not theirs: their rays do not meet, or not about where one view has
    /// followed them to, whose own stays. None where the two have no joint in common: nothing tells then.
    fn stranger(&self, views: &[View], sights: Vec<Option<Sight>>) -> Option<usize> {
        let all = sights.iter().enumerate();
        let own: Vec<(usize, &Sight)> = all.filter_map(|(v, s)| Some((v, s.as_ref()?))).collect();
        let [(a, of_a), (b, of_b)] = own[..] else {
            return None;
        };
        let mut both = of_a.rays.iter().zip(&of_b.rays);
        if !both.any(|(p, q)| p.is_some() && q.is_some()) {
            return None;
        }
        let apart = ray_distance((&views[a], of_a), (&views[b], of_b));
        let meet = apart.is_none_or(|d| d < REACH);
        let stranger = if self.seen_by[a] { b } else { a };
        (!(meet && self.goes_on(views, sights))).then_some(stranger)
    }
}

/// Detections of a frame, of everybody known as `[person][view]`.
pub(in crate::multiview) type Taken = Vec<Vec<Option<usize>>>;

/// Views with the number of their detection.
fn views_of(chosen: &[Option<usize>]) -> impl Iterator<Item = (usize, usize)> {
    let each = chosen.iter().enumerate();
    each.filter_map(|(v, d)| Some((v, (*d)?)))
}

/// Where one view has followed somebody, the distance is not known well: another one's detection may be theirs that is
/// further off than others', and one that is not too far may be somebody else's. Mends what everybody took of a frame,
/// `followed` by person, and says in which groups of detections nobody known is. `may_be` tells of a person, a view and
/// a detection whether looks allow it to be theirs.
pub(in crate::multiview) fn rejoin<'a>(
    views: &[View],
    frame: &[Vec<&'a Sight>],
    followed: &[Option<Followed>],
    may_be: impl Fn(usize, usize, usize) -> bool,
    taken: &mut Taken,
) -> Taken {
    let sights = |chosen: &[Option<usize>]| -> Vec<Option<Sight>> {
        let each = chosen.iter().enumerate();
        each.map(|(v, d)| Some(frame[v][(*d)?].clone())).collect()
    };
    let mut owners: HashMap<(usize, usize), usize> = HashMap::new();
    for (k, followed) in followed.iter().enumerate() {
        let Some(followed) = followed else {
            continue;
        };
        if let Some(v) = followed.stranger(views, sights(&taken[k])) {
            taken[k][v] = None;
        }
        let mut own = views_of(&taken[k]);
        if let (Some(alone), None) = (own.next(), own.next()) {
            owners.insert(alone, k);
        }
    }
    let all: HashSet<(usize, usize)> = taken.iter().flat_map(|own| views_of(own)).collect();
    let mut left: Vec<(usize, usize, &'a Sight)> = Vec::new();
    for (v, sights) in frame.iter().enumerate() {
        let is_left = |d: usize| !all.contains(&(v, d)) || owners.contains_key(&(v, d));
        let each = sights.iter().enumerate().filter(|(d, _)| is_left(*d));
        left.extend(each.map(|(d, sight)| (v, d, *sight)));
    }
    let mut new = Vec::new();
    for chosen in groups(views, &left) {
        let known: Vec<usize> = views_of(&chosen)
            .filter_map(|at| owners.get(&at).copied())
            .collect();
        let goes_on = |k: usize| {
            let followed = followed[k].as_ref();
            views_of(&chosen).all(|(v, d)| may_be(k, v, d))
                && followed.is_some_and(|f| f.goes_on(views, sights(&chosen)))
        };
        let is_somebody = || {
            let mut sights = sights(&chosen);
            exchange::agree(views, &mut sights);
            is_body(&solve(views, &sights).points)
        };
        match known[..] {
            [] => new.push(chosen),
            [k] if goes_on(k) => taken[k] = chosen,
            // Of whoever nobody saw the last time one view knows no better than two where they see somebody.
            [k] if followed[k].as_ref().is_some_and(|f| f.is_absent) && is_somebody() => {
                taken[k].fill(None);
                new.push(chosen);
            }
            // Rays of two people may meet where nobody is.
            _ => {}
        }
    }
    new
}
