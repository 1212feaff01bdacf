//! In: how one camera has looked at somebody, and the boxes of people in its picture. Out: how much of what it sees now
//! is remembered of their looks. XNect §5.1.

use glam::DVec2;

/// Seconds for which somebody is looked at before their looks are known.
const LEARNS: f64 = 2.0;

/// A box in a picture: least and greatest corner.
pub type Bounds = (DVec2, DVec2);

/// How one camera has looked at somebody whose looks it knows.
#[derive(Debug, Clone, Copy)]
pub struct Look {
    /// Frames in which they were seen before.
    pub hits: u32,
    /// Seconds for which their looks were seen before.
    pub looked_at: f64,
    /// Seconds since these were last taken in.
    pub age: f64,
    /// Nobody else stands before them, or behind.
    pub alone: bool,
}

impl Look {
    /// Share that looks of now take of those known: looks of new people are learnt, those of others refreshed when they
    /// are older than `refresh` seconds, while nobody stands before them. `None` where they are left as they are.
    pub fn share(&self, refresh: f64) -> Option<f32> {
        if !self.alone {
            return None;
        }
        if self.looked_at < LEARNS {
            // Of frames seen, not of looks: somebody whose looks come late is known by the first ones.
            return Some(1.0 / (self.hits + 1) as f32);
        }
        (self.age > refresh).then_some(0.5)
    }
}

/// Whether the boxes of two people overlap by more than a tenth of the smaller.
pub fn overlap((al, ah): Bounds, (bl, bh): Bounds) -> bool {
    let common = (ah.min(bh) - al.max(bl)).max(DVec2::ZERO);
    let area = |l: DVec2, h: DVec2| ((h - l).x * (h - l).y).max(1e-12);
    common.x * common.y > 0.1 * area(al, ah).min(area(bl, bh))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_are_learnt_at_first_and_refreshed_while_nobody_stands_before_them() {
        let seen = |looked_at, age, alone| {
            let look = Look {
                hits: 3,
                looked_at,
                age,
                alone,
            };
            look.share(30.0)
        };
        assert_eq!(seen(1.9, 0.0, true), Some(0.25));
        assert_eq!(seen(2.0, 30.0, true), None);
        assert_eq!(seen(2.0, 30.1, true), Some(0.5));
        for (looked_at, age) in [(0.1, 0.0), (5.0, 60.0)] {
            assert_eq!(seen(looked_at, age, false), None);
        }
    }

    #[test]
    fn boxes_that_hardly_touch_do_not_overlap() {
        let at = |x: f64| (DVec2::new(x, 0.0), DVec2::new(x + 1.0, 3.0));
        assert!(overlap(at(0.0), at(0.8)) && !overlap(at(0.0), at(0.95)));
        assert!(!overlap(at(0.0), at(2.0)));
    }
}
