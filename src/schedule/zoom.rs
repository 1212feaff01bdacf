//! Which input the next picture takes, where that follows the people in view.
//!
//! The network knows people of some 60 to 300 pixels best, whatever the picture: somebody before a screen is taller
//! than that at 512×320 and is better seen by an input of half the size, which takes a quarter of the time; somebody
//! across the hall needs the whole size. So the input is as small as the tallest person wants it, unless that makes the
//! smallest one too small; and as those whom the present size cannot see would never be missed, another size is looked
//! at beside it now and then.
//!
//! An input that the machine has no time for is taken only for people who enter an empty place and whom no other one
//! sees: nobody is there whom that slows down.

use edgecap_client::message::Observation;

/// Network inputs, from the largest to the smallest, as shares of the whole size: 512x320, 384x240 and 256x160 for
/// pictures of that shape.
pub const SHARES: [f32; 3] = [1.0, 0.75, 0.5];
/// Somebody taller than this, network pixels, is better seen by a smaller input.
const TALL: f32 = 320.0;
/// Somebody smaller than this is not to become smaller.
const SMALL: f32 = 90.0;
/// The present input stays until people so many times as tall, and so many times as small, want another: one person's
/// stature differs by some 3 % from picture to picture.
const SLACK: f32 = 1.1;
/// Two inputs take one person to be of statures less than this factor apart; who is seen by one of them alone is taller
/// or smaller than who is seen by the other by more.
const ALIKE: f32 = 2.0;
/// How long everybody must want another input before it is taken.
const PATIENCE_NS: u64 = 500_000_000;
/// A wish is forgotten where no picture came for so long, or for two that come as the last ones did: nobody knows what
/// was wanted meanwhile.
const FORGOTTEN_NS: u64 = 1_000_000_000;
/// How often another input is looked at beside the present one.
const LOOK_EVERY_NS: u64 = 1_000_000_000;
/// Looks in a row that must show everybody before a smaller input does for them: who is hardly seen comes and goes.
const ENOUGH_LOOKS: u32 = 2;

/// The input at present, and who wants another.
#[derive(Debug, Clone, Default)]
pub struct Zoom {
    level: usize,
    /// The largest input that this machine has time for.
    limit: usize,
    /// Where a larger one is taken nevertheless.
    lifted: Option<Lifted>,
    /// Another input that people want.
    wish: Option<Wish>,
    /// When the last picture was taken, and how long after the one before, nanoseconds.
    last: Option<u64>,
    interval: u64,
    looked_ns: Option<u64>,
    looked_at: usize,
}

/// What people want.
#[derive(Debug, Clone, Copy)]
struct Wish {
    level: usize,
    /// When the first picture that showed it was taken, nanoseconds.
    since: u64,
}

/// Somebody is there whom no input sees that the machine has time for.
#[derive(Debug, Clone, Copy)]
struct Lifted {
    /// The input that sees them, and the largest one that is taken.
    largest: usize,
    /// Looks in a row, with inputs that there is time for, which showed everybody.
    looks: u32,
}

impl Zoom {
    /// Which of [`SHARES`] the next picture takes.
    pub fn level(&self) -> usize {
        self.level.max(self.largest())
    }

    /// From now on the machine has time for no larger input than this one.
    pub fn limit(&mut self, limit: usize) {
        self.limit = limit;
    }

    /// Takes in who is in a place that was empty: people whom the input `alone` sees and no other one, or else nobody,
    /// or people whom other inputs see as well. That input is taken, whatever time it needs, until a smaller one does:
    /// better seen seldom than never.
    pub fn entered(&mut self, alone: Option<usize>) {
        let lifted = |largest| Lifted { largest, looks: 0 };
        self.lifted = alone.map(lifted);
    }

    /// The largest input that may be taken.
    fn largest(&self) -> usize {
        let lifted = self.lifted.map_or(self.limit, |l| l.largest);
        lifted.min(self.limit)
    }

    /// The input that the picture taken at `now` nanoseconds is to be looked at with as well, if any: every other one
    /// in its turn.
    pub fn look_elsewhere(&mut self, now: u64) -> Option<usize> {
        // A clock that went backwards is a film that began again.
        let last = *self.looked_ns.get_or_insert(now);
        if (last..last.saturating_add(LOOK_EVERY_NS)).contains(&now) {
            return None;
        }
        self.looked_ns = Some(now);
        for _ in 0..SHARES.len() {
            self.looked_at = (self.looked_at + 1) % SHARES.len();
            if self.looked_at >= self.largest() && self.looked_at != self.level() {
                return Some(self.looked_at);
            }
        }
        None
    }

    /// Takes in how tall people are, pixels of the largest input: those seen by the present input in the picture taken
    /// at `now`, and those seen by another one if it was looked at.
    pub fn seen(&mut self, now: u64, here: &[f32], elsewhere: Option<&[f32]>) {
        self.keep_limit(here, elsewhere);
        let forgotten = FORGOTTEN_NS.max(self.interval.saturating_mul(2));
        let last = self.last.replace(now).unwrap_or(now);
        self.interval = now.saturating_sub(last);
        // Of whom both see, the present input is asked alone: every other one takes them to be a little taller or
        // smaller.
        let others = elsewhere.filter(|people| shows_others(people, here));
        let everybody = here.iter().chain(others.unwrap_or_default()).copied();
        let wanted = wanted_at(self.level, everybody);
        if wanted == self.level {
            self.wish = None;
            return;
        }
        let is_lasting = (last..=last.saturating_add(forgotten)).contains(&now);
        let goes_on = |w: &Wish| is_lasting && w.level == wanted;
        let since = self.wish.filter(goes_on).map_or(now, |w| w.since);
        // Whom only another input sees, the present one will not see next time either.
        if others.is_some() || now - since >= PATIENCE_NS {
            self.level = wanted;
            self.wish = None;
        } else {
            self.wish = Some(Wish {
                level: wanted,
                since,
            });
        }
    }

    /// Takes no larger input than there is time for any more, once such a one shows everybody.
    fn keep_limit(&mut self, here: &[f32], elsewhere: Option<&[f32]>) {
        let (level, limit) = (self.level(), self.limit);
        let Some(lifted) = &mut self.lifted else {
            return;
        };
        let is_enough = if level >= limit {
            !here.is_empty()
        } else {
            if let Some(people) = elsewhere.filter(|_| self.looked_at >= limit) {
                let is_everybody = !people.is_empty() && people.len() >= here.len();
                lifted.looks = if is_everybody { lifted.looks + 1 } else { 0 };
            }
            lifted.looks >= ENOUGH_LOOKS
        };
        if is_enough {
            self.lifted = None;
        }
    }
}

/// Whether one input, by the statures of those whom it sees, sees somebody whom the present one does not.
fn shows_others(elsewhere: &[f32], here: &[f32]) -> bool {
    let is_here = |s: &f32| here.iter().any(|h| s.max(*h) < ALIKE * s.min(*h));
    elsewhere.len() > here.len() || !elsewhere.iter().all(is_here)
}

/// As [`wanted`], or the input `level` as long as people a little taller or smaller would want that.
fn wanted_at(level: usize, statures: impl Iterator<Item = f32> + Clone) -> usize {
    let times = |factor: f32| wanted(statures.clone().map(|s| s * factor));
    if (times(1.0 / SLACK)..=times(SLACK)).contains(&level) {
        level
    } else {
        times(1.0)
    }
}

/// The input for people of these statures, pixels of the largest input; the largest for nobody.
fn wanted(statures: impl Iterator<Item = f32>) -> usize {
    let (least, most) = statures.fold((f32::INFINITY, 0.0f32), |(a, b), s| (a.min(s), b.max(s)));
    let last = SHARES.len() - 1;
    let low_enough = (0..last)
        .find(|&k| most * SHARES[k] <= TALL)
        .unwrap_or(last);
    let large_enough = (0..=last)
        .rev()
        .find(|&k| least * SHARES[k] >= SMALL)
        .unwrap_or(0);
    low_enough.min(large_enough)
}

/// How tall somebody is upright, pixels of the picture: the scale between the joints seen and the body's, times 1.70 m.
/// `None` for who shows too little.
pub fn stature(o: &Observation) -> Option<f32> {
    use edgecap_client::joints::CANONICAL_STATURE;
    let joints = || {
        o.joints2d
            .iter()
            .zip(&o.joints3d)
            .filter(|(p, _)| p[2] > 0.0)
    };
    let n = joints().count() as f32;
    if n < 3.0 {
        return None;
    }
    let mut mean = [0.0; 4];
    for (p, x) in joints() {
        for (m, v) in mean.iter_mut().zip([p[0], p[1], x[0], x[1]]) {
            *m += v / n;
        }
    }
    let (mut both, mut body) = (0.0, 0.0);
    for (p, x) in joints() {
        let (u, v, a, b) = (
            p[0] - mean[0],
            p[1] - mean[1],
            x[0] - mean[2],
            x[1] - mean[3],
        );
        both += u * a + v * b;
        body += a * a + b * b;
    }
    let pixels = both / body * CANONICAL_STATURE;
    (pixels.is_finite() && pixels > 0.0).then_some(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_NS: u64 = 33_333_333;

    /// Ten seconds of pictures: `see` says who an input of this level sees. The input that the last picture had.
    fn after_ten_seconds(zoom: &mut Zoom, from: u64, see: impl Fn(usize) -> Vec<f32>) -> usize {
        let mut level = zoom.level();
        for k in 0..300 {
            let now = from + k * FRAME_NS;
            let other = zoom.look_elsewhere(now).map(&see);
            level = zoom.level();
            zoom.seen(now, &see(level), other.as_deref());
        }
        level
    }

    /// Those of these people whom an input sees: 60 to 400 of its pixels.
    fn seen_by(people: &[f32]) -> impl Fn(usize) -> Vec<f32> {
        move |level| {
            let share = SHARES[level];
            let sees = |s: &&f32| (60.0..400.0).contains(&(**s * share));
            people.iter().filter(sees).copied().collect()
        }
    }

    #[test]
    fn the_input_is_as_small_as_people_allow() {
        let wants = |people: &[f32]| wanted(people.iter().copied());
        assert_eq!(wants(&[]), 0);
        assert_eq!(wants(&[200.0]), 0);
        assert_eq!(wants(&[400.0]), 1);
        assert_eq!(wants(&[700.0, 300.0]), 2);
        // who is far away would be lost
        assert_eq!(wants(&[700.0, 130.0]), 1);
        assert_eq!(wants(&[700.0, 100.0]), 0);
    }

    /// Repeatable noise, uniform, standard deviation 1.
    fn noise() -> impl FnMut() -> f32 {
        let mut state = 1u64;
        move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            12.0f32.sqrt() * ((state >> 40) as f32 / (1 << 24) as f32 - 0.5)
        }
    }

    #[test]
    fn somebody_at_a_threshold_has_one_input() {
        // As tall as the largest input takes well, and as small as the next one does.
        for people in [&[322.0][..], &[120.0, 700.0]] {
            let (mut zoom, mut noise) = (Zoom::default(), noise());
            let mut see = || -> Vec<f32> {
                let each = people.iter();
                each.map(|s| s * (1.0 + 0.03 * noise())).collect()
            };
            let (mut level, mut changes) = (zoom.level(), 0);
            for k in 0..1800 {
                let now = k * FRAME_NS;
                let other = zoom.look_elsewhere(now).map(|_| see());
                zoom.seen(now, &see(), other.as_deref());
                changes += u32::from(zoom.level() != level);
                level = zoom.level();
            }
            assert!(changes <= 2, "{changes} in a minute: {people:?}");
        }
    }

    #[test]
    fn what_another_input_takes_somebody_for_changes_nothing() {
        let mut zoom = Zoom::default();
        zoom.seen(0, &[200.0], Some(&[390.0]));
        assert_eq!(zoom.level(), 0);
        // One of them is somebody else.
        zoom.seen(FRAME_NS, &[200.0], Some(&[210.0, 700.0]));
        assert_eq!(zoom.level(), 2);
    }

    #[test]
    fn pictures_that_come_seldom_have_patience_too() {
        for seconds in [2, 10] {
            let mut zoom = Zoom::default();
            for k in 0..3 {
                zoom.seen(k * seconds * 1_000_000_000, &[400.0], None);
            }
            assert_eq!(zoom.level(), 1, "{seconds} s apart");
        }
    }

    #[test]
    fn whom_no_input_sees_in_time_is_seen_nevertheless() {
        let mut zoom = Zoom::default();
        zoom.limit(2);
        let mut from = 0;
        let mut play = |zoom: &mut Zoom, people: &[f32]| {
            from += 300 * FRAME_NS;
            after_ten_seconds(zoom, from, seen_by(people))
        };
        assert_eq!(play(&mut zoom, &[70.0]), 2);
        zoom.entered(Some(0));
        assert_eq!(play(&mut zoom, &[70.0]), 0);
        assert_eq!(play(&mut zoom, &[70.0]), 0);
        // Who has come near, and goes away again: rate comes first as long as somebody is seen in time.
        assert_eq!(play(&mut zoom, &[125.0]), 2);
        assert_eq!(play(&mut zoom, &[70.0]), 2);
        zoom.entered(Some(0));
        assert_eq!(zoom.level(), 0);
        zoom.entered(None);
        assert_eq!(zoom.level(), 2);
        zoom.entered(Some(0));
        assert_eq!(play(&mut zoom, &[700.0]), 2);
        assert_eq!(play(&mut zoom, &[700.0, 70.0]), 2);
    }

    #[test]
    fn whom_the_present_input_does_not_see_is_found_by_looking_with_another() {
        let mut zoom = Zoom::default();
        // nobody, then somebody before the screen, then somebody far away as well, then nobody
        let scenes: [(&[f32], usize); 4] = [(&[], 0), (&[700.0], 2), (&[700.0, 70.0], 0), (&[], 0)];
        for (k, (people, level)) in (0..).zip(scenes) {
            let from = k * 300 * FRAME_NS;
            assert_eq!(after_ten_seconds(&mut zoom, from, seen_by(people)), level);
        }
    }

    #[test]
    fn a_slow_machine_looks_with_no_larger_input_than_it_has_time_for() {
        let mut zoom = Zoom::default();
        zoom.limit(1);
        assert_eq!(after_ten_seconds(&mut zoom, 0, seen_by(&[100.0])), 1);
        assert_eq!(after_ten_seconds(&mut zoom, 0, seen_by(&[700.0])), 2);
        zoom.limit(2);
        assert!((0..300).all(|k| zoom.look_elsewhere(k * FRAME_NS).is_none()));
        zoom.limit(0);
        let from = 300 * FRAME_NS;
        assert_eq!(after_ten_seconds(&mut zoom, from, seen_by(&[100.0])), 0);
    }

    #[test]
    fn a_moment_changes_nothing() {
        let mut zoom = Zoom::default();
        assert_eq!(after_ten_seconds(&mut zoom, 0, |_| vec![200.0]), 0);
        let now = 300 * FRAME_NS;
        zoom.seen(now, &[400.0], None);
        zoom.seen(now + FRAME_NS, &[200.0], None);
        zoom.seen(now + 30 * FRAME_NS, &[400.0], None);
        assert_eq!(zoom.level(), 0);
        zoom.seen(now + 50 * FRAME_NS, &[400.0], None);
        assert_eq!(zoom.level(), 1);
    }

    #[test]
    fn somebody_whom_no_input_sees_for_a_moment_changes_nothing() {
        let mut zoom = Zoom::default();
        assert_eq!(after_ten_seconds(&mut zoom, 0, seen_by(&[700.0])), 2);
        let now = 300 * FRAME_NS;
        zoom.seen(now, &[], Some(&[]));
        assert_eq!(zoom.level(), 2);
        for k in 1..=16 {
            zoom.seen(now + k * FRAME_NS, &[], None);
        }
        assert_eq!(zoom.level(), 0);
    }

    #[test]
    fn what_was_wanted_before_a_pause_is_forgotten() {
        let mut zoom = Zoom::default();
        zoom.seen(0, &[400.0], None);
        let hour = 3600 * 1_000_000_000;
        zoom.seen(hour, &[400.0], None);
        assert_eq!(zoom.level(), 0);
        zoom.seen(hour + PATIENCE_NS, &[400.0], None);
        assert_eq!(zoom.level(), 1);
    }

    #[test]
    fn another_input_is_looked_at_once_a_second_and_never_the_present_one() {
        let mut zoom = Zoom::default();
        let looks: Vec<_> = (0..150)
            .filter_map(|k| zoom.look_elsewhere(k * FRAME_NS))
            .collect();
        assert_eq!(looks, [1, 2, 1, 2]);
        // a film that begins again
        assert_eq!(zoom.look_elsewhere(0), Some(1));
    }

    #[test]
    fn how_tall_somebody_is_does_not_depend_on_what_shows() {
        let mut o = Observation::default();
        for (k, (p, x)) in o.joints2d.iter_mut().zip(&mut o.joints3d).enumerate() {
            let (a, b) = ((k as f32 * 1.7).sin() * 0.4, (k as f32 * 0.9).cos() * 0.8);
            (x[0], x[1]) = (a, b);
            *p = [300.0 + 250.0 * a, 200.0 + 250.0 * b, 0.9];
        }
        assert!((stature(&o).unwrap() - 425.0).abs() < 0.1);
        for p in &mut o.joints2d[8..] {
            p[2] = 0.0;
        }
        assert!((stature(&o).unwrap() - 425.0).abs() < 0.1);
        for p in &mut o.joints2d[2..] {
            p[2] = 0.0;
        }
        assert_eq!(stature(&o), None);
    }
}
