//! Somebody's looks as one view knows them, which sees colours as no other: what it sees goes in. They are learnt and
//! refreshed as before one camera.

use super::seen::Seen;
use crate::fit::{Appearance, Look};

/// How somebody looks in one view.
#[derive(Debug, Clone, Copy, Default)]
pub struct Looks {
    /// What is remembered; none where their torso was never seen.
    pub appearance: Option<Appearance>,
    /// Instants at which the view saw them alone: what it sees of them beside others is only for want of better.
    hits: u32,
    /// Seconds for which it saw their torso so.
    looked_at: f64,
    /// Seconds since the appearance was learnt or refreshed.
    age: f64,
}

impl Looks {
    /// Of somebody whom the view sees for the first time, if it does.
    pub fn first(seen: Option<&Seen>) -> Self {
        let mut looks = Self::default();
        looks.pass(seen, 0.0, f64::INFINITY);
        looks
    }

    /// Lets `dt` seconds pass, after which the view sees them so, if it does; looks that are known are refreshed every
    /// so many seconds.
    pub fn pass(&mut self, seen: Option<&Seen>, dt: f64, refresh: f64) {
        self.age += dt;
        let Some(seen) = seen else {
            return;
        };
        if let Some(now) = &seen.looks {
            self.remember(now, seen.alone, dt, refresh);
        }
        if seen.alone {
            self.hits = self.hits.saturating_add(1);
        }
    }

    fn remember(&mut self, now: &Appearance, alone: bool, dt: f64, refresh: f64) {
        let look = Look {
            hits: self.hits,
            looked_at: self.looked_at,
            age: self.age,
            alone,
        };
        if alone {
            self.looked_at += dt;
        }
        let share = match self.appearance {
            None => Some(1.0),
            Some(_) => look.share(refresh),
        };
        if let Some(share) = share {
            self.appearance.get_or_insert(*now).blend(now, share);
            self.age = 0.0;
        }
    }

    /// Takes over the looks of somebody who has been recognised.
    pub fn succeed(&mut self, old: &Self) {
        self.age = 0.0;
        match (&mut self.appearance, old.appearance) {
            (Some(now), Some(before)) => now.blend(&before, 0.5),
            (now, before) => *now = now.or(before),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::View;
    use crate::message::Observation;

    /// Somebody whose torso has one colour.
    fn seen(colour: usize, alone: bool) -> Seen {
        let mut seen = Observation::default();
        seen.joints2d.fill([100.0, 100.0, 0.9]);
        (seen.hue[colour], seen.saturation[8]) = (1.0, 1.0);
        let seen = Seen::new(&View::around(0.0), &seen, 0.1).expect("joints are seen");
        Seen { alone, ..seen }
    }

    #[test]
    fn whoever_first_appears_behind_somebody_is_known_by_their_own_colours_once_they_are_alone() {
        const STEP: f64 = 0.1;
        let (mixed, own) = (seen(2, false), seen(10, true));
        let mut looks = Looks::first(Some(&mixed));
        for _ in 0..25 {
            looks.pass(Some(&mixed), STEP, 30.0);
        }
        assert_eq!(looks.appearance, mixed.looks, "better than none");
        for _ in 0..5 {
            looks.pass(Some(&own), STEP, 30.0);
        }
        assert_eq!(looks.appearance, own.looks);
    }
}
