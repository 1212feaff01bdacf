//! In: evidence of a person, and where they are expected. Out: the evidence smoothed, joints that jump left out for a
//! moment. XNect §5.2.

use glam::{DVec2, DVec3};

use super::gate::{Gate, Verdict};
use crate::body::skeleton::Posed;
use crate::fit::config::{FitConfig, OneEuroConfig};
use crate::fit::evidence::{Evidence, OneEuro};
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS, PELVIS};

/// A joint farther than this (metres) from its prediction is an outlier.
const OUTLIER: f64 = 0.35;

/// The filters of one person's joints, in the picture and in space.
#[derive(Debug, Clone, Default)]
pub struct Filters {
    plane: [OneEuro<2>; EVIDENCE_JOINTS],
    space: [OneEuro<3>; BODY_JOINTS],
    plane_gates: [Gate; EVIDENCE_JOINTS],
    space_gates: [Gate; BODY_JOINTS],
}

impl Filters {
    /// Of somebody who has been seen once.
    pub fn started(evidence: &Evidence) -> Self {
        let mut filters = Self::default();
        let config = OneEuroConfig::default();
        for j in 0..EVIDENCE_JOINTS {
            if evidence.confidence[j] > 0.0 {
                filters.plane[j].update(evidence.plane[j].to_array(), 0.0, 1.0, &config);
            }
        }
        if evidence.known3d {
            for j in 0..BODY_JOINTS {
                filters.space[j].update(evidence.points3d[j].to_array(), 0.0, 1.0, &config);
            }
        }
        filters
    }

    /// 1€ filters with outliers held back: a joint that jumps away from its prediction is left out for a moment.
    pub fn smooth(&mut self, e: &mut Evidence, expected: &Posed, dt: f64, config: &FitConfig) {
        let root = expected.joints[PELVIS];
        let depth = root.z.max(0.3);
        for j in 0..EVIDENCE_JOINTS {
            let filter = &mut self.plane[j];
            if e.confidence[j] == 0.0 {
                filter.skip(dt);
                continue;
            }
            let p = expected.joints[j];
            let far = p.z > 0.2 && ((p.truncate() / p.z - e.plane[j]) * depth).length() > OUTLIER;
            match self.plane_gates[j].look(far, dt) {
                Verdict::HeldBack => {
                    e.confidence[j] = 0.0;
                    filter.skip(dt);
                    continue;
                }
                Verdict::Anew => filter.reset(),
                Verdict::Counts => {}
            }
            let smooth = filter.update(e.plane[j].to_array(), dt, depth, &config.filter2d);
            e.plane[j] = DVec2::from_array(smooth);
        }
        for j in 0..BODY_JOINTS {
            let filter = &mut self.space[j];
            if !(e.known3d && e.tells3d[j]) {
                filter.skip(dt);
                continue;
            }
            let far = (expected.joints[j] - root - e.points3d[j]).length() > OUTLIER;
            match self.space_gates[j].look(far, dt) {
                Verdict::HeldBack => {
                    filter.skip(dt);
                    continue;
                }
                Verdict::Anew => filter.reset(),
                Verdict::Counts => {}
            }
            let smooth = filter.update(e.points3d[j].to_array(), dt, 1.0, &config.filter3d);
            e.points3d[j] = DVec3::from_array(smooth);
        }
    }

    /// Lets `dt` seconds pass without an observation.
    pub fn skip(&mut self, dt: f64) {
        for f in &mut self.plane {
            f.skip(dt);
        }
        for f in &mut self.space {
            f.skip(dt);
        }
    }

    /// Forgets where joints were.
    pub fn reset(&mut self) {
        for f in &mut self.plane {
            f.reset();
        }
        for f in &mut self.space {
            f.reset();
        }
    }

    /// Whether a joint's last place in space was left out.
    pub fn holds_back(&self, joint: usize) -> bool {
        self.space_gates[joint].holds()
    }
}
