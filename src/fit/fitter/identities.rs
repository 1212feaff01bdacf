//! In: people without identity, and those who are missed or left. Out: who gets a new identity, who their old one, and
//! who is forgotten.

use super::Fitter;
use crate::assignment::assign;
use crate::body::skeleton::Skeleton;
use crate::fit::identity::{confirmation, confirmed, looks_may_tell, reidentification};
use crate::fit::track::{Context, Track};

/// Most people remembered after they left.
const MAX_REMEMBERED: usize = 64;
/// Seconds that a newcomer without looks waits for them, while they may tell that it is somebody who was here.
const WAIT_FOR_LOOKS: f64 = 2.0;

/// Somebody who left.
#[derive(Debug, Clone)]
pub(super) struct Gone {
    pub(super) track: Track,
    /// Seconds since they were seen.
    pub(super) away: f64,
}

impl From<Track> for Gone {
    fn from(track: Track) -> Self {
        Self {
            away: track.unseen,
            track,
        }
    }
}

/// Somebody known who is not seen at the moment: index into the present or into those gone.
#[derive(Debug, Clone, Copy)]
enum Absent {
    Present(usize),
    Gone(usize),
}

impl Fitter {
    /// Gives identities to those seen often enough: their old one if they are recognised. `pause`: seconds since the
    /// last frame, if these are long.
    pub(super) fn confirm(&mut self, pause: Option<f64>) {
        let config = &self.config.identity;
        let after_pause = pause.is_some();
        let absent = self.absent();
        let known = || {
            let each = absent.iter().map(|(who, gone)| (self.track(*who), *gone));
            each.filter(|(track, _)| track.id != 0)
        };
        // Waiting only tells newcomers from those who come back: with nobody away there is nothing to wait for. After
        // a pause everybody is away, and at such a pace no second look would ever come.
        let nobody_waited_for = after_pause || known().next().is_none();
        let is_sure = |track: &Track| nobody_waited_for && track.first_score >= config.sure_score;
        let often_enough = |track: &Track| {
            self.config.stills
                || after_pause
                || is_sure(track)
                || track.hits >= config.confirm_hits
                || track.hits >= 2 && track.is_steady() && track.age >= config.confirm_time
        };
        let ready: Vec<usize> = (0..self.present.len())
            .filter(|&t| {
                let track = &self.present[t];
                let waits = || {
                    let looks_may_come = track.appearance.is_none() && track.age < WAIT_FOR_LOOKS;
                    let mut known = known();
                    looks_may_come
                        && !after_pause
                        && known.any(|(left, gone)| looks_may_tell(track, left, gone))
                };
                track.id == 0 && track.unseen == 0.0 && often_enough(track) && !waits()
            })
            .collect();
        if ready.is_empty() {
            return;
        }
        let mut costs = Vec::with_capacity(ready.len() * absent.len());
        for &t in &ready {
            for (who, gone) in &absent {
                let (newcomer, left) = (&self.present[t], self.track(*who));
                costs.push(reidentification(newcomer, left, *gone, config));
            }
        }
        let pairs = assign(&costs, ready.len(), absent.len(), 1.0);
        // Newcomers where somebody stood in the last frame, long ago, as whom nobody of this one is recognised.
        let is_confirmed = confirmed(&pairs, absent.len(), |newcomer, k| {
            let (who, away) = absent[k];
            match pause {
                Some(pause) if away <= pause => {
                    let newcomer = &self.present[ready[newcomer]];
                    confirmation(newcomer, self.track(who), away, config)
                }
                _ => f64::INFINITY,
            }
        });
        let (mut from_present, mut from_gone) = (Vec::new(), Vec::new());
        for ((&t, pair), is_confirmed) in ready.iter().zip(pairs).zip(is_confirmed) {
            let Some(who) = pair else {
                let track = &self.present[t];
                let apart = track.age / f64::from(track.hits.saturating_sub(1).max(1));
                let telling = track.is_steady() && apart >= config.confirm_time;
                if track.age < config.birth_time
                    && !telling
                    && !is_sure(track)
                    && !self.config.stills
                    && !is_confirmed
                {
                    continue;
                }
                self.present[t].id = self.next_id;
                self.next_id = self.next_id.wrapping_add(1).max(1);
                self.counters.births += 1;
                continue;
            };
            let (who, gone) = absent[who];
            match who {
                Absent::Present(p) => from_present.push(p),
                Absent::Gone(g) => from_gone.push(g),
            }
            let old = self.track(who).clone();
            let mut cx = Context {
                skeleton: Skeleton::builtin(),
                config: &self.config,
                model: &self.model,
                solver: &mut self.solver,
            };
            self.present[t].succeed(old, gone, &mut cx);
            if self.present[t].id != 0 {
                self.counters.returns += 1;
                continue;
            }
            self.present[t].id = self.next_id;
            self.next_id = self.next_id.wrapping_add(1).max(1);
            self.counters.births += 1;
        }
        remove_all(&mut self.present, from_present);
        remove_all(&mut self.gone, from_gone);
    }

    /// Who may stand here under another name, with the seconds since they were seen: those missed for a moment as well
    /// as those who left.
    fn absent(&self) -> Vec<(Absent, f64)> {
        let present = self.present.iter().enumerate();
        let missed = present
            .filter(|(_, t)| t.id != 0 && t.unseen > 0.0)
            .map(|(p, t)| (Absent::Present(p), t.unseen));
        let gone = self.gone.iter().enumerate();
        missed
            .chain(gone.map(|(g, gone)| (Absent::Gone(g), gone.away)))
            .collect()
    }

    fn track(&self, who: Absent) -> &Track {
        match who {
            Absent::Present(p) => &self.present[p],
            Absent::Gone(g) => &self.gone[g].track,
        }
    }

    /// Lets go of those missed for too long, and of the memory of those who left long ago.
    pub(super) fn forget(&mut self) {
        let config = &self.config.identity;
        let mut t = 0;
        while t < self.present.len() {
            let track = &self.present[t];
            let grace = if track.id == 0 {
                config.tentative_grace
            } else {
                config.grace.max(config.hold)
            };
            let broken = !(track.pose.is_finite() && track.motion.is_finite());
            if broken || track.unseen > grace {
                let track = self.present.swap_remove(t);
                if track.id != 0 && !broken {
                    self.gone.push(Gone::from(track));
                }
            } else {
                t += 1;
            }
        }
        self.gone
            .retain(|g| g.track.id != 0 && g.away <= config.memory);
        self.gone
            .sort_by(|a, b| b.away.total_cmp(&a.away).then(a.track.id.cmp(&b.track.id)));
        let extra = self.gone.len().saturating_sub(MAX_REMEMBERED);
        self.gone.drain(..extra);
    }
}

fn remove_all<T>(items: &mut Vec<T>, mut indices: Vec<usize>) {
    indices.sort_unstable();
    for i in indices.into_iter().rev() {
        items.remove(i);
    }
}
