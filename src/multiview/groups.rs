//! Who is who among detections of one frame that nobody known took: detections of several views go in, groups come out
//! in which every view agrees with every other.

use super::sight::{LEAST_SHARED, Sight, between};
use crate::camera::View;

/// Median distance between the rays of two views' joints of one person, metres.
const AGREE: f64 = 0.15;
/// Mean distance of pairs at which one view more tells nothing, metres: of one person's it is a few centimetres, of two
/// people's who stand close some ten.
const TELLS: f64 = 0.12;

/// Detections of one person, one a view at most.
struct Group {
    /// Their numbers, the pair that it began with first.
    members: Vec<usize>,
    /// How much speaks for it.
    worth: f64,
}

/// How much speaks for so many detections being one person's whose pairs are so many metres apart together: views
/// count, and less the farther their rays pass each other.
fn worth(count: usize, apart: f64) -> f64 {
    let pairs = count * (count - 1) / 2;
    count as f64 * (1.0 - apart / pairs as f64 / TELLS)
}

/// How far every two detections are from each other, where they may be one person's, metres.
struct Links {
    all: usize,
    apart: Vec<Option<f64>>,
}

impl Links {
    fn new(views: &[View], all: &[(usize, usize, &Sight)]) -> Self {
        let mut links = Self {
            all: all.len(),
            apart: vec![None; all.len() * all.len()],
        };
        for (i, a) in all.iter().enumerate() {
            for (j, b) in all[..i].iter().enumerate().filter(|(_, b)| b.0 != a.0) {
                let apart = ray_distance((&views[a.0], a.2), (&views[b.0], b.2));
                let apart = apart.filter(|d| *d < AGREE);
                links.apart[i * all.len() + j] = apart;
                links.apart[j * all.len() + i] = apart;
            }
        }
        links
    }

    fn of(&self, i: usize) -> &[Option<f64>] {
        &self.apart[i * self.all..(i + 1) * self.all]
    }

    /// The group that a pair begins: as long as a detection agrees with all in it, and more speaks for the group with
    /// it, the nearest one joins. No two of one view agree.
    fn group(&self, pair: [usize; 2], is_free: &[bool]) -> Group {
        let [first, second] = pair;
        let mut members = vec![first, second];
        let mut sum = self.of(first)[second].unwrap_or_default();
        // Of every other detection how far it is from all members together.
        let mut others: Vec<(usize, f64)> = (0..self.all)
            .filter(|k| is_free[*k])
            .filter_map(|k| Some((k, self.of(first)[k]? + self.of(second)[k]?)))
            .collect();
        while let Some(&(next, apart)) = others.iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
            let count = members.len();
            if worth(count + 1, sum + apart) <= worth(count, sum) {
                break;
            }
            sum += apart;
            members.push(next);
            others.retain_mut(|(k, apart)| match self.of(next)[*k] {
                Some(more) => {
                    *apart += more;
                    true
                }
                None => false,
            });
        }
        Group {
            worth: worth(members.len(), sum),
            members,
        }
    }

    /// Who belongs together, as numbers of detections, in their order.
    fn groups(&self) -> Vec<Vec<usize>> {
        let mut is_free = vec![true; self.all];
        let mut open: Vec<Group> = Vec::new();
        for i in 0..self.all {
            let pairs = (0..i).filter(|j| self.of(i)[*j].is_some());
            open.extend(pairs.map(|j| self.group([i, j], &is_free)));
        }
        let mut taken: Vec<Vec<usize>> = Vec::new();
        let order =
            |a: &usize, b: &usize, open: &[Group]| open[*a].worth.total_cmp(&open[*b].worth);
        while let Some(best) = (0..open.len()).max_by(|a, b| order(a, b, &open)) {
            let mut members = open.swap_remove(best).members;
            members.iter().for_each(|&k| is_free[k] = false);
            members.sort_unstable();
            taken.push(members);
            open.retain_mut(|group| {
                let pair = [group.members[0], group.members[1]];
                if !pair.iter().all(|&k| is_free[k]) {
                    return false;
                }
                if !group.members.iter().all(|&k| is_free[k]) {
                    *group = self.group(pair, &is_free);
                }
                true
            });
        }
        taken.sort_unstable();
        taken
    }
}

/// Groups detections that nobody known took, each with its view and its number there. Every pair that agrees begins a
/// group, and that for which most speaks is taken first: rays of two people who happen to meet may pass nearer than
/// those of one whom a detector sees with errors, but other views do not agree with them. Groups of two views at least,
/// as one detection a view, in the order of the detections.
pub fn groups(views: &[View], all: &[(usize, usize, &Sight)]) -> Vec<Vec<Option<usize>>> {
    let one_a_view = |members: Vec<usize>| {
        let mut chosen = vec![None; views.len()];
        for k in members {
            chosen[all[k].0] = Some(all[k].1);
        }
        chosen
    };
    let groups = Links::new(views, all).groups();
    groups.into_iter().map(one_a_view).collect()
}

/// Median distance between the rays of two detections' joints, sides exchanged where that is nearer.
pub(super) fn ray_distance((va, a): (&View, &Sight), (vb, b): (&View, &Sight)) -> Option<f64> {
    let of = |b: &Sight| {
        let mut each: Vec<f64> = a
            .rays
            .iter()
            .zip(&b.rays)
            .filter_map(|(p, q)| {
                Some(between(
                    va.position,
                    p.as_ref()?.direction,
                    vb.position,
                    q.as_ref()?.direction,
                ))
            })
            .collect();
        if each.len() < LEAST_SHARED {
            return None;
        }
        each.sort_by(f64::total_cmp);
        Some(each[each.len() / 2])
    };
    match (of(b), of(&b.mirrored())) {
        (Some(x), Some(y)) => Some(x.min(y)),
        (x, _) => x,
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::joints::EVIDENCE_JOINTS;
    use crate::message::Observation;

    /// Two people who stand so that to two views each is the other's image in a mirror, whose rays of one and the other
    /// meet exactly, while those of one person miss each other.
    #[test]
    fn two_people_are_not_grouped_as_two_others_where_a_third_view_tells() {
        // The world's y goes down: the third one is above and looks down.
        let above = View {
            rotation: DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
            position: DVec3::new(0.0, -4.0, 0.0),
            ..View::around(0.0)
        };
        let views = [View::around(0.0), View::around(90.0), above];
        let across = (views[0].position - views[1].position).normalize();
        let sight = |v: usize, person: usize| {
            let mut seen = Observation::default();
            for (j, out) in seen.joints2d.iter_mut().take(EVIDENCE_JOINTS).enumerate() {
                let side = 0.15 * ((j % 3) as f64 - 1.0);
                let own = DVec3::new(0.8 + side, 0.1 * j as f64 - 0.7, 0.3 + 0.2 * side);
                let point = match person {
                    0 => own,
                    _ => own - 2.0 * own.dot(across) * across,
                };
                // One view sees the first person too low and the second too high, another the other way round.
                let off = match v {
                    2 => 0.0,
                    _ => 0.03 - 0.06 * f64::from(u8::from(v != person)),
                };
                let pixel = views[v].project(point + off * DVec3::Y).expect("in front");
                *out = [pixel.x as f32, pixel.y as f32, 0.9];
            }
            Sight::new(&views[v], &seen)
        };
        let sights: Vec<(usize, usize, Sight)> = (0..3)
            .flat_map(|v| [0, 1].map(|person| (v, person, sight(v, person))))
            .collect();
        let all: Vec<_> = sights.iter().map(|(v, d, s)| (*v, *d, s)).collect();
        let apart = |a: usize, b: usize| {
            let [a, b] = [&sights[a], &sights[b]];
            ray_distance((&views[a.0], &a.2), (&views[b.0], &b.2)).unwrap()
        };
        assert!(
            apart(0, 3) < 0.01 && apart(0, 2) > 0.03,
            "{} {}",
            apart(0, 3),
            apart(0, 2)
        );
        assert_eq!(groups(&views, &all), [vec![Some(0); 3], vec![Some(1); 3]]);
    }

    #[test]
    fn somebody_close_by_joins_nobody_else_s_group() {
        // Two views see one person, two others another one, whom one of these shows close to the first.
        let mut links = Links {
            all: 4,
            apart: vec![None; 16],
        };
        for (i, j, apart) in [(0, 1, 0.01), (2, 3, 0.01), (0, 2, 0.1), (1, 2, 0.1)] {
            links.apart[4 * i + j] = Some(apart);
            links.apart[4 * j + i] = Some(apart);
        }
        assert_eq!(links.groups(), [[0, 1], [2, 3]]);
        // Another view that sees the first one as well.
        for (i, j) in [(0, 3), (1, 3), (2, 3)] {
            links.apart[4 * i + j] = Some(0.03);
            links.apart[4 * j + i] = Some(0.03);
        }
        for j in [0, 1] {
            links.apart[4 * 2 + j] = Some(0.03);
            links.apart[4 * j + 2] = Some(0.03);
        }
        assert_eq!(links.groups(), [[0, 1, 2, 3]]);
    }
}
