//! Settings of events.

use serde::{Deserialize, Serialize};

use crate::message::ZONE_NAME;

/// More changes of direction than these nobody makes within two seconds.
const MOST_SWINGS: usize = 100;

/// When something counts as having happened. Seconds, metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EventConfig {
    /// How long somebody must be seen to have entered or come back, and a zone or another main person to hold.
    pub confirm: f64,
    /// How long somebody must be away to have left.
    pub gone: f64,
    /// How long a hand must be up or down.
    pub hand: f64,
    /// Least confidence of the joints that a gesture is read from.
    pub confidence: f32,
    /// How much nearer than the main person somebody must be to become it, as a share of the distance.
    pub nearer: f64,
    /// What people stand before, x and z in the floor's axes: the main person is the nearest to it; none: the nearest
    /// to the camera, or of several cameras to the origin of their calibration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub main_near: Option<[f64; 2]>,
    /// Changes of direction within two seconds that make a wave.
    pub swings: usize,
    /// Least way between two of them.
    pub swing: f64,
    /// Parts of the floor.
    pub zone: Vec<Zone>,
}

/// A part of the floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Zone {
    /// What events call it, 63 bytes at most.
    pub name: String,
    /// Its corners in order, x and z in the floor's axes: x to the camera's right, z towards the viewer, so negative in
    /// front of the camera; the origin is below the camera.
    pub corners: Vec<[f64; 2]>,
    /// How long somebody must stay to have dwelt; none: no such event.
    #[serde(default)]
    pub dwell: Option<f64>,
}

impl Default for EventConfig {
    fn default() -> Self {
        Self {
            confirm: 0.3,
            gone: 1.0,
            hand: 0.4,
            confidence: 0.5,
            nearer: 0.15,
            main_near: None,
            swings: 3,
            swing: 0.08,
            zone: Vec::new(),
        }
    }
}

impl EventConfig {
    /// What of it cannot be.
    pub fn mistake(&self) -> Option<String> {
        let times = [
            ("confirm", self.confirm),
            ("gone", self.gone),
            ("hand", self.hand),
            ("swing", self.swing),
        ];
        if let Some((name, value)) = times.iter().find(|(_, v)| !(0.0..=3600.0).contains(v)) {
            return Some(format!("{name}: expected 0 to 3600, found {value}"));
        }
        if !(0.0..=1.0).contains(&self.confidence) {
            return Some(format!(
                "confidence: expected 0 to 1, found {}",
                self.confidence
            ));
        }
        // Nobody is nearer by the whole distance.
        if !(0.0..1.0).contains(&self.nearer) {
            return Some(format!(
                "nearer: expected a share of the distance, 0 to less than 1, found {}",
                self.nearer
            ));
        }
        if self.main_near.iter().flatten().any(|c| !c.is_finite()) {
            return Some("main_near: expected finite numbers".to_owned());
        }
        if !(1..=MOST_SWINGS).contains(&self.swings) {
            return Some(format!(
                "swings: expected 1 to {MOST_SWINGS}, found {}",
                self.swings
            ));
        }
        for (n, zone) in self.zone.iter().enumerate() {
            let name = &zone.name;
            if name.is_empty() || name.len() >= ZONE_NAME {
                let (most, found) = (ZONE_NAME - 1, name.len());
                return Some(format!(
                    "zone '{name}': expected a name of 1 to {most} bytes, found {found}"
                ));
            }
            if name.contains('\0') {
                return Some(format!("zone {name:?}: expected a name without zeros"));
            }
            if self.zone[..n].iter().any(|z| z.name == *name) {
                return Some(format!(
                    "another zone is called '{name}': give each its own name"
                ));
            }
            if zone.corners.len() < 3 {
                let found = zone.corners.len();
                return Some(format!(
                    "zone '{name}': expected 3 or more corners, found {found}"
                ));
            }
            let numbers = zone.corners.iter().flatten().chain(&zone.dwell);
            if numbers.into_iter().any(|c| !c.is_finite()) {
                return Some(format!("zone '{name}': expected finite numbers"));
            }
            if let Some(dwell) = zone.dwell.filter(|d| *d < 0.0) {
                return Some(format!(
                    "zone '{name}': dwell: expected 0 seconds or more, found {dwell}"
                ));
            }
            if zone.is_line() {
                return Some(format!(
                    "zone '{name}': expected corners around a part of the floor, found all of them on one line"
                ));
            }
        }
        None
    }
}

impl Zone {
    /// Whether all corners lie on one line, to a square millimetre: nobody is ever in it.
    fn is_line(&self) -> bool {
        let Some((first, rest)) = self.corners.split_first() else {
            return true;
        };
        let from_first = |c: &[f64; 2]| [c[0] - first[0], c[1] - first[1]];
        let ways: Vec<[f64; 2]> = rest.iter().map(from_first).collect();
        ways.iter().enumerate().all(|(n, a)| {
            let around = |b: &[f64; 2]| (a[0] * b[1] - a[1] * b[0]).abs();
            ways[..n].iter().all(|b| around(b) < 1e-6)
        })
    }

    /// Whether a place on the floor lies in it. Even-odd rule.
    pub fn holds(&self, [x, z]: [f64; 2]) -> bool {
        let next = self.corners.iter().cycle().skip(1);
        let crossings = self
            .corners
            .iter()
            .zip(next)
            .filter(|([ax, az], [bx, bz])| {
                (*az > z) != (*bz > z) && x < (bx - ax) * (z - az) / (bz - az) + ax
            });
        crossings.count() % 2 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_nobody_can_reach_are_mistakes() {
        let mistake = |key: &str, text: &str| {
            let config: EventConfig = toml::from_str(&format!("{key} = {text}")).unwrap();
            config.mistake()
        };
        for (key, wrong, right) in [
            ("confidence", ["-0.1", "1.1", "nan"], ["0.0", "1.0"]),
            ("nearer", ["-0.1", "1.0", "nan"], ["0.0", "0.99"]),
            ("swings", ["0", "101", "1000000"], ["1", "100"]),
            ("gone", ["-1.0", "3601.0", "nan"], ["0.0", "3600.0"]),
        ] {
            for text in wrong {
                let said = mistake(key, text).unwrap_or_else(|| panic!("{key} = {text}"));
                assert!(said.starts_with(&format!("{key}: expected")), "{said}");
            }
            for text in right {
                assert_eq!(mistake(key, text), None, "{key} = {text}");
            }
        }
    }

    #[test]
    fn zones_in_which_nobody_can_be_are_mistakes() {
        let mistake = |corners: &[[f64; 2]], dwell| {
            let zone = vec![Zone {
                name: "till".to_owned(),
                corners: corners.to_vec(),
                dwell,
            }];
            let config = EventConfig {
                zone,
                ..EventConfig::default()
            };
            config.mistake()
        };
        let line = mistake(&[[0.0, 0.0], [1.0, 1.0], [1.0, 1.0], [3.0, 3.0]], None);
        assert!(line.is_some_and(|m| m.contains("on one line")));
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, -1.0], [0.0, -1.0]];
        let before = mistake(&square, Some(-1.0));
        assert!(before.is_some_and(|m| m.contains("dwell") && m.contains("-1")));
        assert_eq!(mistake(&square, Some(0.0)), None);
        // Its halves are equal and opposite, and hold people all the same.
        let crossed = [[0.0, 0.0], [1.0, -1.0], [1.0, 0.0], [0.0, -1.0]];
        assert_eq!(mistake(&crossed, None), None);
    }

    #[test]
    fn a_zone_holds_what_lies_between_its_corners() {
        let zone = Zone {
            name: "L".to_owned(),
            corners: vec![
                [0.0, 0.0],
                [2.0, 0.0],
                [2.0, -1.0],
                [1.0, -1.0],
                [1.0, -2.0],
                [0.0, -2.0],
            ],
            dwell: None,
        };
        for inside in [[0.5, -0.5], [1.5, -0.5], [0.5, -1.5]] {
            assert!(zone.holds(inside), "{inside:?}");
        }
        for outside in [[1.5, -1.5], [-0.1, -0.5], [0.5, 0.1], [3.0, -0.5]] {
            assert!(!zone.holds(outside), "{outside:?}");
        }
    }
}
