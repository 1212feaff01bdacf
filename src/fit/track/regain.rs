//! In: evidence of somebody who was lost from sight, or is recognised. Out: the pose from this evidence alone, what is
//! known of the person taken over.

use glam::DVec3;

use super::{Context, Track};
use crate::body::skeleton::Posed;
use crate::camera::translation::DEPTHS;
use crate::fit::energy::Problem;
use crate::fit::evidence::{Evidence, SwapMemory};
use crate::joints::PELVIS;
use crate::solve::Effort;

/// Somebody not seen for this long (seconds) who is this far (metres, in the picture) from the expected place is placed
/// anew.
const REACQUIRE_AFTER: f64 = 0.25;
const REACQUIRE_APART: f64 = 0.2;
/// Who is seen this many times as far away as they are expected, nearer than anybody is placed, is placed anew, too: of
/// a pose at the lens or behind it nothing is in the picture that could pull it back.
const FARTHER: f64 = 1.25;

impl Track {
    /// Whether the prediction says nothing: somebody comes back elsewhere than expected or turned round, too far for
    /// the filters to follow, or is expected at the lens and is not there.
    pub(super) fn lost_sight(&self, evidence: &Evidence, expected: &Posed) -> bool {
        let depth = expected.joints[PELVIS].z;
        let seen_farther = |root: DVec3| root.z > FARTHER * depth;
        let is_elsewhere = || {
            let apart = evidence.distance2d(expected, 1.0);
            apart.is_some_and(|d| d > REACQUIRE_APART) || evidence.is_turned_from(expected)
        };
        depth < DEPTHS[0] && evidence.root.is_some_and(seen_farther)
            || self.unseen > REACQUIRE_AFTER && is_elsewhere()
    }

    /// Starts the pose from this observation alone, keeping identity and proportions.
    pub(super) fn reacquire(&mut self, evidence: &Evidence, dt: f64, cx: &mut Context<'_>) -> bool {
        let Some(mut fresh) = Self::start(evidence, cx) else {
            return false;
        };
        fresh.id = self.id;
        fresh.turn = self.turn;
        fresh.first_score = self.first_score;
        fresh.hits = self.hits.saturating_add(1);
        fresh.age = self.age + dt;
        if self.unseen == 0.0 {
            fresh.seen_for = self.seen_for + dt;
        }
        fresh.swaps = SwapMemory::doubting_the_prediction();
        fresh.bones = self.bones.clone();
        fresh.appearance = self.appearance;
        fresh.looked_at = self.looked_at;
        fresh.appearance_age = self.appearance_age + dt;
        fresh.stature = self.stature;
        cx.skeleton
            .pose(&fresh.pose, fresh.bones.lengths(), &mut fresh.posed);
        *self = fresh;
        true
    }

    /// Takes over identity, proportions, height and looks of somebody recognised who was seen `gone` seconds ago. What
    /// the newcomer's own first look tells is added: where frames are far apart everybody is a newcomer in each.
    pub fn succeed(&mut self, old: Track, gone: f64, cx: &mut Context<'_>) {
        self.id = old.id;
        self.turn = old.turn;
        self.bones = old.bones;
        self.stature = old.stature;
        self.appearance_age = 0.0;
        match (&mut self.appearance, old.appearance) {
            (Some(now), Some(before)) => now.blend(&before, 0.5),
            (now, before) => *now = now.or(before),
        }
        match self.first_look.take() {
            Some(evidence) => self.fit_again(&evidence, gone, cx),
            None => cx
                .skeleton
                .pose(&self.pose, self.bones.lengths(), &mut self.posed),
        }
    }

    /// Fits the first observation with the proportions of whoever was recognised by it, last seen `gone` seconds ago,
    /// and adds what it tells of proportions and height.
    fn fit_again(&mut self, evidence: &Evidence, gone: f64, cx: &mut Context<'_>) {
        let targets = self.targets(evidence, self.pose, self.pose.position.z.max(0.3), cx);
        if self.tells_lengths(evidence, &targets) {
            self.bones
                .update(cx.skeleton, &evidence.points3d, &self.posed, gone);
        }
        let lengths = *self.bones.lengths();
        let problem = Problem::new(cx.skeleton, &lengths, &targets);
        let found = cx.solver.solve(&problem, &self.pose, Effort::COLD);
        if found.pose.is_finite() {
            (self.pose, self.posed) = (found.pose, found.posed);
        } else {
            // Never seen to happen; the first fit is finite.
            cx.skeleton.pose(&self.pose, &lengths, &mut self.posed);
        }
        self.settle(evidence, &targets);
        self.stature
            .update(cx.config, &self.posed, &self.states, gone);
    }
}
