//! Gestures of one hand: raised, waved.

use std::collections::VecDeque;

use super::config::EventConfig;
use super::steady::Steady;

/// A wave is looked for in so long.
const WAVE: f64 = 2.0;
/// Another wave is told no sooner than this after the last.
const PAUSE: f64 = 2.0;

/// Where a hand is, metres; up and sidewards as seen by the person. `None` where one of the joints that it is measured
/// between is not seen.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen {
    /// The wrist above the top of the head.
    pub above_head: Option<f64>,
    /// The wrist above the shoulder.
    pub above_shoulder: Option<f64>,
    /// The wrist beside the elbow.
    pub beside: Option<f64>,
}

/// What a hand has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gesture {
    Raised,
    Lowered,
    Waved,
}

/// What is known of one hand.
#[derive(Debug, Clone)]
pub struct Hand {
    up: Steady<bool>,
    /// Where the hand turned back: time and place, the oldest first.
    turns: VecDeque<(f64, f64)>,
    /// The farthest place since the last turn, and which way it went.
    farthest: Option<(f64, f64)>,
    /// When it was last seen where it may wave.
    followed: f64,
    waved: Option<f64>,
}

impl Hand {
    /// A hand that is down.
    pub fn new(time: f64) -> Self {
        Self {
            up: Steady::new(false, time),
            turns: VecDeque::new(),
            farthest: None,
            followed: time,
            waved: None,
        }
    }

    /// Forgets what it may do where that was not seen for longer than `gap` seconds.
    pub fn lapse(&mut self, time: f64, gap: f64) {
        self.up.lapse(time, gap);
        self.lapse_turns(time, gap);
    }

    /// Where a hand was that nobody saw, nobody knows: it need not have turned back.
    fn lapse_turns(&mut self, time: f64, gap: f64) {
        if time - self.followed > gap {
            self.forget_turns();
        }
    }

    fn forget_turns(&mut self) {
        self.turns.clear();
        self.farthest = None;
    }

    /// Takes in a moment.
    pub fn look(&mut self, seen: Seen, time: f64, config: &EventConfig) -> Vec<Gesture> {
        let mut gestures = Vec::new();
        // Between head and shoulder it stays what it was.
        let above = match self.up.get() {
            true => seen.above_shoulder,
            false => seen.above_head,
        };
        match above {
            Some(above) => match self.up.look(above > 0.0, time, config.hand) {
                Some(true) => gestures.push(Gesture::Raised),
                Some(false) => gestures.push(Gesture::Lowered),
                None => {}
            },
            None => self.up.lapse(time, config.hand),
        }
        match (seen.above_shoulder, seen.beside) {
            (Some(above), _) if above < -0.1 => self.forget_turns(),
            (Some(_), Some(beside)) => {
                self.followed = time;
                if self.swings(beside, time, config) >= config.swings
                    && self.waved.is_none_or(|t| time - t >= PAUSE)
                {
                    self.waved = Some(time);
                    gestures.push(Gesture::Waved);
                }
            }
            _ => self.lapse_turns(time, config.hand),
        }
        gestures
    }

    /// How often the hand has turned back within the last seconds.
    fn swings(&mut self, place: f64, time: f64, config: &EventConfig) -> usize {
        let Some((farthest, way)) = self.farthest else {
            self.farthest = Some((place, 0.0));
            return 0;
        };
        let moved = place - farthest;
        if way == 0.0 {
            if moved.abs() >= config.swing {
                self.farthest = Some((place, moved.signum()));
            }
        } else if moved * way >= 0.0 {
            self.farthest = Some((place, way));
        } else if moved.abs() >= config.swing {
            self.turns.push_back((time, farthest));
            self.farthest = Some((place, -way));
        }
        while self.turns.front().is_some_and(|(t, _)| time - t > WAVE) {
            self.turns.pop_front();
        }
        self.turns.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a hand at the shoulder tells that turns back three times, and is hidden for so many frames before the last.
    fn waves(hidden: u32) -> Vec<Gesture> {
        let (config, mut hand) = (EventConfig::default(), Hand::new(0.0));
        let at = |beside: f64| Seen {
            above_head: Some(-0.2),
            above_shoulder: Some(0.1),
            beside: Some(beside),
        };
        let swings = [0.0, 0.1, 0.0, 0.1].map(at);
        let hides = (0..hidden).map(|_| Seen::default());
        let film = swings.into_iter().chain(hides).chain([at(0.0)]);
        let told = film.enumerate().flat_map(|(k, seen)| {
            let time = 0.1 * k as f64;
            hand.look(seen, time, &config)
        });
        told.collect()
    }

    #[test]
    fn a_wave_has_no_turn_that_nobody_saw() {
        assert_eq!(waves(0), [Gesture::Waved]);
        assert_eq!(waves(3), [Gesture::Waved], "a moment is no gap");
        assert_eq!(waves(10), []);
    }
}
