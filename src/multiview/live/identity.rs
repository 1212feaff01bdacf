//! Who is who, last of all: when somebody new counts, who of those known they are, and who is forgotten.

use super::person::Person;
use crate::assignment::assign;
use crate::fit::{FitConfig, by_former_place, by_looks_or_place, confirmed};
use crate::multiview::people::{ONE_VIEW, PROOF, is_one_body, is_proven};

/// Seconds without two views after which somebody without identity whom one view still sees is let go.
const UNPROVEN: f64 = 0.4;
/// Steps between instants, however long, for which somebody without identity stays at least: one may be missed.
const LEAST_STEPS: f64 = 1.5;
/// Seconds after which somebody who is missed may stand here under another name.
const MISSED: f64 = 0.1;
/// Difference of statures, natural logarithm, that one person has from time to time.
const STATURE_NOISE: f64 = 0.03;
/// By how much sums of seconds may be off that should be equal.
const ROUNDING: f64 = 1e-6;
/// Most people remembered after they left.
const MOST_REMEMBERED: usize = 64;

#[derive(Debug, Clone)]
struct Gone {
    person: Person,
    left_ns: u64,
}

impl Gone {
    /// For how long they have been gone.
    fn seconds(&self, now_ns: u64) -> f64 {
        now_ns.saturating_sub(self.left_ns) as f64 * 1e-9
    }
}

/// Identities: those in view, and those who left.
#[derive(Debug, Clone)]
pub struct Identities {
    gone: Vec<Gone>,
    next: u32,
}

impl Default for Identities {
    fn default() -> Self {
        Self {
            gone: Vec::new(),
            next: 1,
        }
    }
}

impl Identities {
    /// Forgets who left. Identities are never given again.
    pub fn clear(&mut self) {
        self.gone.clear();
    }

    /// People remembered after they left.
    pub fn remembered(&self) -> usize {
        self.gone.len()
    }

    /// Gives identities to those who have been seen often enough: their old one where they are recognised. After a
    /// `pause` of so many seconds, in which everybody left, it is so at first sight; and whoever had no identity yet
    /// goes on towards one.
    pub fn confirm(
        &mut self,
        present: &mut Vec<Person>,
        now_ns: u64,
        pause: Option<f64>,
        config: &FitConfig,
    ) {
        let is_proven = |p: &Person| is_proven(p.proof, PROOF);
        let ready: Vec<usize> = (0..present.len())
            .filter(|&k| {
                let p = &present[k];
                p.id == 0 && p.unseen == 0.0 && (pause.is_some() || is_proven(p))
            })
            .collect();
        if ready.is_empty() {
            return;
        }
        let missed: Vec<usize> = (0..present.len())
            .filter(|&k| present[k].id != 0 && present[k].unseen > MISSED)
            .collect();
        let each_missed = missed.iter().map(|&m| (&present[m], present[m].unseen));
        let each_gone = self.gone.iter().map(|g| (&g.person, g.seconds(now_ns)));
        let absent: Vec<(&Person, f64)> = each_missed.chain(each_gone).collect();
        let mut costs = Vec::with_capacity(ready.len() * absent.len());
        for &k in &ready {
            for (old, gone) in &absent {
                costs.push(dissimilarity(&present[k], old, *gone, config));
            }
        }
        let pairs = assign(&costs, ready.len(), absent.len(), 1.0);
        // Newcomers near where somebody stood at the last instant before the pause, if nobody was recognised as that
        // one.
        let is_confirmed = confirmed(&pairs, absent.len(), |newcomer, w| {
            let (old, gone) = absent[w];
            match pause {
                Some(pause) if gone <= pause + ROUNDING => {
                    confirmation(&present[ready[newcomer]], old, gone, config)
                }
                _ => f64::INFINITY,
            }
        });
        let (mut from_present, mut from_gone) = (Vec::new(), Vec::new());
        for ((&k, pair), is_confirmed) in ready.iter().zip(pairs).zip(is_confirmed) {
            let old = match pair {
                None => None,
                Some(w) if w < missed.len() => {
                    from_present.push(missed[w]);
                    let old = present[missed[w]].clone();
                    Some((old.unseen, old))
                }
                Some(w) => {
                    let gone = w - missed.len();
                    from_gone.push(gone);
                    let gone = &self.gone[gone];
                    Some((gone.seconds(now_ns), gone.person.clone()))
                }
            };
            if let Some((seconds, old)) = old {
                present[k].succeed(old, seconds);
            }
            if present[k].id == 0 && (is_confirmed || is_proven(&present[k])) {
                present[k].id = self.next;
                self.next = self.next.wrapping_add(1).max(1);
            }
        }
        remove_all(present, from_present);
        remove_all(&mut self.gone, from_gone);
    }

    /// Lets everybody go; whoever is seen next may be recognised. Those without identity are remembered until then.
    pub fn leave_all(&mut self, present: &mut Vec<Person>, now_ns: u64) {
        for person in present.drain(..) {
            self.leave(person, now_ns);
        }
    }

    /// Those who left have been away for so much longer, seconds, which times do not tell.
    pub fn slept(&mut self, seconds: f64) {
        for gone in &mut self.gone {
            gone.left_ns = gone.left_ns.saturating_sub((seconds * 1e9) as u64);
        }
    }

    fn leave(&mut self, person: Person, now_ns: u64) {
        if !person.is_finite() {
            return;
        }
        let unseen_ns = (person.unseen * 1e9) as u64;
        self.gone.push(Gone {
            person,
            left_ns: now_ns.saturating_sub(unseen_ns),
        });
    }

    /// Lets go of those missed for too long, of whom there are two of, and of the memory of those who left long ago.
    /// `dt`: seconds since the instant before.
    pub fn forget(&mut self, present: &mut Vec<Person>, now_ns: u64, dt: f64, config: &FitConfig) {
        let identity = &config.identity;
        let [grace, unproven] =
            [identity.tentative_grace, UNPROVEN].map(|seconds| seconds.max(LEAST_STEPS * dt));
        present.sort_by_key(|p| if p.id == 0 { u32::MAX } else { p.id });
        let mut kept: Vec<Person> = Vec::with_capacity(present.len());
        for mut person in present.drain(..) {
            let lost = if person.id == 0 {
                person.unseen > grace || person.apart > unproven
            } else {
                person.unseen > identity.grace.max(identity.hold) || person.apart > ONE_VIEW
            };
            if lost {
                self.leave(person, now_ns);
                continue;
            }
            if !person.is_finite() {
                continue;
            }
            let Some(double) = kept.iter().position(|p| is_same_body(p, &person)) else {
                kept.push(person);
                continue;
            };
            let old = &mut kept[double];
            if old.unseen <= MISSED || person.unseen > 0.0 {
                continue;
            }
            // Whoever is missed does not stand where somebody else is seen: they are the same, or one has left.
            if dissimilarity(&person, old, old.unseen, config) <= 1.0 {
                std::mem::swap(old, &mut person);
                let unseen = person.unseen;
                old.succeed(person, unseen);
            } else if person.id != 0 {
                std::mem::swap(old, &mut person);
                self.leave(person, now_ns);
            } else {
                kept.push(person);
            }
        }
        *present = kept;
        let memory = (identity.memory * 1e9) as u64;
        self.gone
            .retain(|g| g.person.id != 0 && now_ns.saturating_sub(g.left_ns) <= memory);
        self.gone.sort_by_key(|g| (g.left_ns, g.person.id));
        let extra = self.gone.len().saturating_sub(MOST_REMEMBERED);
        self.gone.drain(..extra);
    }
}

fn is_same_body(a: &Person, b: &Person) -> bool {
    is_one_body(a.posed.joints.into_iter().zip(b.posed.joints))
}

/// How unlike somebody new and somebody who has been gone for some seconds are; up to 1 they may be the same person,
/// which two who were seen at one instant are not.
fn dissimilarity(new: &Person, old: &Person, gone: f64, config: &FitConfig) -> f64 {
    if new.age > gone {
        return f64::INFINITY;
    }
    let apart = new.pose.position.distance(old.pose.position);
    let unlike = new.unlike(old, config.identity.reidentify_appearance);
    let taller = new.build.difference(&old.build);
    let taller = taller.map_or(0.0, |d| (d / STATURE_NOISE - 1.0).max(0.0));
    let farther = (apart - 0.5 - 2.5 * gone).clamp(0.0, 2.0);
    by_looks_or_place(unlike, 0.5 * (taller + farther), apart, gone) + 0.001 * gone
}

/// How far somebody new stands from where somebody stood `gone` seconds ago who may make sure of them.
fn confirmation(new: &Person, old: &Person, gone: f64, config: &FitConfig) -> f64 {
    let unlike = new.unlike(old, config.identity.reidentify_appearance);
    let apart = new.pose.position.distance(old.pose.position);
    by_former_place(unlike, apart, gone)
}

fn remove_all<T>(items: &mut Vec<T>, mut indices: Vec<usize>) {
    indices.sort_unstable();
    for k in indices.into_iter().rev() {
        items.remove(k);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::Appearance;
    use crate::message::Observation;
    use crate::multiview::live::looks::Looks;

    /// Somebody whose clothes have one colour, missed for so long.
    fn person(id: u32, colour: usize, unseen: f64) -> Person {
        let mut seen = Observation::default();
        seen.hue[colour] = 1.0;
        seen.saturation[colour] = 1.0;
        let mut looks = Looks::default();
        looks.appearance = Appearance::new(&seen);
        Person {
            unseen,
            looks: vec![looks],
            ..Person::standing(id)
        }
    }

    /// Who is present and who is remembered after an instant.
    fn after(mut present: Vec<Person>) -> (Vec<u32>, Vec<u32>) {
        let mut identities = Identities::default();
        identities.forget(&mut present, 5_000_000_000, 0.033, &FitConfig::default());
        let present = present.iter().map(|p| p.id).collect();
        (
            present,
            identities.gone.iter().map(|g| g.person.id).collect(),
        )
    }

    #[test]
    fn whoever_is_missed_leaves_the_place_to_whoever_is_seen_there() {
        let seen = || person(7, 3, 0.0);
        assert_eq!(after(vec![person(2, 0, 0.8), seen()]), (vec![7], vec![2]));
        assert_eq!(
            after(vec![seen(), person(2, 3, 0.8)]),
            (vec![2], vec![]),
            "the same looks"
        );
        assert_eq!(
            after(vec![person(2, 0, 0.0), seen()]),
            (vec![2], vec![]),
            "both are seen"
        );
        assert_eq!(
            after(vec![person(2, 0, 0.0), person(7, 3, 0.8)]),
            (vec![2], vec![])
        );
        let long_seen = Person {
            age: 1.0,
            ..person(7, 3, 0.0)
        };
        assert_eq!(
            after(vec![person(2, 3, 0.8), long_seen]),
            (vec![7], vec![2]),
            "both were seen at one instant"
        );
        let of_new = |colour| after(vec![person(0, colour, 0.0), person(2, 0, 0.8)]);
        assert_eq!(of_new(0), (vec![2], vec![]));
        assert_eq!(
            of_new(3),
            (vec![2, 0], vec![]),
            "not sure yet that anybody is there"
        );
    }
}
