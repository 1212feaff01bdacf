//! In: looks at standing feet. Out: what each look is worth beside those at the same place.

use glam::DVec3;

use super::PEOPLE;

/// Feet so near to one another (metres, over the floor) rest in one place, …
const SAME_PLACE: f64 = 0.3;
/// … of which a person has so many at a time: two, and two where restless feet go to and fro.
const PLACES: usize = 4;

/// Where somebody's foot was seen, and how often since it came there.
#[derive(Debug, Clone, Copy)]
struct Place {
    id: u32,
    foot: DVec3,
    looks: f64,
}

/// Places where feet stood, in the order of the last look.
#[derive(Debug, Clone, Default)]
pub struct Places(Vec<Place>);

impl Places {
    /// What a look at a foot is worth: the n-th at one place an n-th, whether the floor bears it or not. Whoever rests
    /// for hours tells little more than in the first seconds, and looks at a foot that rests err alike.
    pub fn worth_of_look(&mut self, id: u32, foot: DVec3) -> f64 {
        let is_there = |p: &Place| {
            let apart = p.foot - foot;
            p.id == id && apart.x.hypot(apart.z) < SAME_PLACE
        };
        let mut place = match self.0.iter().position(is_there) {
            Some(k) => self.0.remove(k),
            None => Place {
                id,
                foot,
                looks: 0.0,
            },
        };
        place.looks += 1.0;
        self.0.push(place);
        let own = self.0.iter().filter(|p| p.id == id).count();
        if own > PLACES
            && let Some(oldest) = self.0.iter().position(|p| p.id == id)
        {
            self.0.remove(oldest);
        }
        if self.0.len() > PEOPLE * PLACES {
            self.0.remove(0);
        }
        1.0 / place.looks
    }
}
