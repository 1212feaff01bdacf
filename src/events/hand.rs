//! Gestures of one hand: raised, waved.

use std::collections::VecDeque;

use super::config::EventConfig;
use super::steady::Steady;

/// A wave is looked for in so long.
const WAVE: f64 = 2.0;
/// Another wave is told no sooner than this after the last.
const PAUSE: f64 = 2.0;

/// Where a hand is, metres; up and sidewards as seen by the person.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// The wrist above the top of the head.
    pub above_head: f64,
    /// The wrist above the shoulder.
    pub above_shoulder: f64,
    /// The wrist beside the elbow.
    pub beside: f64,
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
    waved: Option<f64>,
}

impl Hand {
    /// A hand that is down.
    pub fn new(time: f64) -> Self {
        Self {
            up: Steady::new(false, time),
            turns: VecDeque::new(),
            farthest: None,
            waved: None,
        }
    }

    /// Forgets that it may be up or down where it was not seen so for longer than `gap` seconds.
    pub fn lapse(&mut self, time: f64, gap: f64) {
        self.up.lapse(time, gap);
    }

    /// Takes in a moment; `None` where the hand is not seen.
    pub fn look(&mut self, seen: Option<Seen>, time: f64, config: &EventConfig) -> Vec<Gesture> {
        let Some(seen) = seen else {
            self.lapse(time, config.hand);
            return Vec::new();
        };
        // Between head and shoulder it stays what it was.
        let up = match self.up.get() {
            true => seen.above_shoulder > 0.0,
            false => seen.above_head > 0.0,
        };
        let changed = self.up.look(up, time, config.hand);
        let mut gestures: Vec<Gesture> = changed
            .map(|up| {
                if up {
                    Gesture::Raised
                } else {
                    Gesture::Lowered
                }
            })
            .into_iter()
            .collect();
        if seen.above_shoulder < -0.1 {
            self.turns.clear();
            self.farthest = None;
        } else if self.swings(seen.beside, time, config) >= config.swings
            && self.waved.is_none_or(|t| time - t >= PAUSE)
        {
            self.waved = Some(time);
            gestures.push(Gesture::Waved);
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
