//! In: everybody seen in a frame. Out: whose track each one goes on, the tracks fitted, and new ones.

use super::{Fitter, PersonEvidence};
use crate::assignment::assign;
use crate::body::skeleton::{Posed, Skeleton};
use crate::fit::appearance::Appearance;
use crate::fit::identity::{Look, dissimilarity, overlap};
use crate::fit::track::{Context, Track};
use crate::message::MAX_PEOPLE;

/// Share of the threshold for people without identity: chance must not confirm anybody.
const NEWCOMER: f64 = 0.5;

impl Fitter {
    /// The track of every person seen. Those with an identity choose first: a newcomer must not take an observation
    /// from somebody known because it fits a little better.
    pub(super) fn match_people(&mut self, seen: &[PersonEvidence], dt: f64) -> Vec<Option<usize>> {
        let cx = Context {
            skeleton: Skeleton::builtin(),
            config: &self.config,
            model: &self.model,
            solver: &mut self.solver,
        };
        let config = &self.config.identity;
        let mut matches = vec![None; seen.len()];
        let mut expected = Posed::default();
        for known in [true, false] {
            let tracks: Vec<usize> = (0..self.present.len())
                .filter(|&t| (self.present[t].id != 0) == known)
                .collect();
            let free: Vec<usize> = (0..seen.len()).filter(|&i| matches[i].is_none()).collect();
            let mut costs = Vec::with_capacity(free.len() * tracks.len());
            for &t in &tracks {
                let track = &self.present[t];
                track.expected(dt, &cx, &mut expected);
                for &i in &free {
                    let (evidence, looks) = &seen[i];
                    costs.push(dissimilarity(
                        track,
                        &expected,
                        evidence,
                        looks.as_ref(),
                        dt,
                        config,
                    ));
                }
            }
            let limit = config.threshold * if known { 1.0 } else { NEWCOMER };
            let pairs = assign(&costs, tracks.len(), free.len(), limit);
            for (row, pair) in pairs.iter().enumerate() {
                if let Some(column) = pair {
                    matches[free[*column]] = Some(tracks[row]);
                }
            }
        }
        matches
    }

    /// Fits everyone who was seen, lets the others coast.
    pub(super) fn advance(&mut self, seen: &[PersonEvidence], matches: &[Option<usize>], dt: f64) {
        let mut cx = Context {
            skeleton: Skeleton::builtin(),
            config: &self.config,
            model: &self.model,
            solver: &mut self.solver,
        };
        for (t, track) in self.present.iter_mut().enumerate() {
            match matches.iter().position(|m| *m == Some(t)) {
                Some(person) => {
                    let (evidence, looks) = &seen[person];
                    let alone = is_alone(seen, person);
                    if let Some(looks) = looks {
                        remember_looks(track, looks, alone, dt, self.config.identity.refresh);
                    }
                    track.observe(evidence.clone(), dt, &mut cx);
                }
                None => track.coast(dt, &mut cx),
            }
        }
    }

    /// Starts a track for everyone whom nobody owns.
    pub(super) fn start_people(&mut self, seen: &[PersonEvidence], matches: &[Option<usize>]) {
        let mut cx = Context {
            skeleton: Skeleton::builtin(),
            config: &self.config,
            model: &self.model,
            solver: &mut self.solver,
        };
        for ((evidence, looks), owner) in seen.iter().zip(matches) {
            if owner.is_some() || self.present.len() >= 2 * MAX_PEOPLE {
                continue;
            }
            if let Some(mut track) = Track::start(evidence, &mut cx) {
                track.appearance = *looks;
                self.present.push(track);
            }
        }
    }
}

/// Whether nobody else stands before a person, or behind.
fn is_alone(seen: &[PersonEvidence], person: usize) -> bool {
    let (evidence, _) = &seen[person];
    let mut others = seen.iter().enumerate().filter(|(i, _)| *i != person);
    !others.any(|(_, (other, _))| overlap(evidence.bounds(), other.bounds()))
}

/// Learns the looks of new people, seen `dt` seconds after the last, and refreshes those of others now and then, while
/// nobody stands before them.
fn remember_looks(track: &mut Track, looks: &Appearance, alone: bool, dt: f64, refresh: f64) {
    let look = Look {
        hits: track.hits,
        looked_at: track.looked_at,
        age: track.appearance_age,
        alone,
    };
    track.looked_at += dt;
    let share = match &track.appearance {
        None => Some(1.0),
        Some(_) => look.share(refresh),
    };
    let Some(share) = share else {
        return;
    };
    track.appearance.get_or_insert(*looks).blend(looks, share);
    track.appearance_age = 0.0;
}
