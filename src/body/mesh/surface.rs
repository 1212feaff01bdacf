//! Single vertices of a posed body and how they move with pose and shape. Pose correctives are left out.

use glam::DVec3;

use super::{FREEDOM, JOINTS, MeshBody, PARENTS, Person, PosedTree, first_turn};

/// A posed body's surface, vertex by vertex.
#[derive(Debug)]
pub struct Surface<'a> {
    body: &'a MeshBody,
    person: &'a Person,
    posed: &'a PosedTree,
    /// By shape coefficient, how the joints move.
    by_shape: Vec<[DVec3; JOINTS]>,
}

impl<'a> Surface<'a> {
    /// The surface of a person in a pose.
    pub fn new(body: &'a MeshBody, person: &'a Person, posed: &'a PosedTree) -> Self {
        Self {
            body,
            person,
            posed,
            by_shape: Vec::new(),
        }
    }

    /// Readies derivatives by the first `shapes` coefficients.
    pub fn prepare(&mut self, shapes: usize) {
        let (body, posed) = (self.body, self.posed);
        let of = |c: usize| std::array::from_fn(|j| body.joint_by_shape(posed, j, c));
        self.by_shape = (0..shapes).map(of).collect();
    }

    fn rest(&self, vertex: usize) -> DVec3 {
        let mut at = DVec3::from(self.body.template[vertex].map(f64::from));
        for (beta, moves) in self.person.betas().iter().zip(&self.body.components) {
            at += *beta * DVec3::from(moves[vertex].map(f64::from));
        }
        at
    }

    /// Where a vertex is.
    pub fn vertex(&self, vertex: usize) -> DVec3 {
        let rest = self.rest(vertex);
        let each = self.body.weights.of(vertex).iter().map(|&(joint, w)| {
            let j = usize::from(joint);
            let arm = self.posed.turn[j] * (rest - self.person.joints()[j]);
            f64::from(w) * (arm + self.posed.place[j])
        });
        each.sum()
    }

    /// Calls `column` with every parameter that moves a vertex, in rising order, and its derivative: of the pose, then
    /// the coefficients that were prepared.
    pub fn jacobian(&self, vertex: usize, mut column: impl FnMut(usize, DVec3)) {
        let rest = self.rest(vertex);
        // Of what each joint carries: weight, and weight times place.
        let mut carried = [(0.0, DVec3::ZERO); JOINTS];
        for &(joint, w) in self.body.weights.of(vertex) {
            let (j, w) = (usize::from(joint), f64::from(w));
            let at = self.posed.turn[j] * (rest - self.person.joints()[j]) + self.posed.place[j];
            let mut a = j;
            loop {
                carried[a].0 += w;
                carried[a].1 += w * at;
                if a == 0 {
                    break;
                }
                a = PARENTS[a];
            }
        }
        for (k, axis) in DVec3::AXES.into_iter().enumerate() {
            column(k, carried[0].0 * axis);
        }
        for (a, (weight, sum)) in carried.into_iter().enumerate() {
            if weight == 0.0 {
                continue;
            }
            let arm = sum - weight * self.posed.place[a];
            for (k, axis) in DVec3::AXES.into_iter().enumerate() {
                let axis = if a == 0 {
                    axis
                } else {
                    self.posed.turn[PARENTS[a]] * axis
                };
                column(first_turn(a) + k, axis.cross(arm));
            }
        }
        for (c, joints) in self.by_shape.iter().enumerate() {
            let moves = DVec3::from(self.body.components[c][vertex].map(f64::from));
            let each = self.body.weights.of(vertex).iter().map(|&(joint, w)| {
                let j = usize::from(joint);
                let own = moves - DVec3::from(self.body.joint_components[c][j]);
                f64::from(w) * (self.posed.turn[j] * own + joints[j])
            });
            column(FREEDOM + c, each.sum());
        }
    }
}
