//! What is known of one point in space, summed up: a quadratic function of its place.

use glam::{DVec2, DVec3};

use super::reprojection::rows;
use crate::body::BodyModel;
use crate::body::skeleton::{Dof, Posed, Skeleton};
use crate::joints::DOF;
use crate::solve::NormalEquations;

/// A quadratic function of a point: matrix M (symmetric) and pull M·r.
#[derive(Debug, Clone, Copy, Default)]
pub struct Quadratic {
    xx: f64,
    xy: f64,
    xz: f64,
    yy: f64,
    yz: f64,
    zz: f64,
    /// Matrix times residual.
    pub pull: DVec3,
}

impl Quadratic {
    /// A residual of all three coordinates alike.
    pub fn add_point(&mut self, weight: f64, residual: DVec3) {
        self.xx += weight;
        self.yy += weight;
        self.zz += weight;
        self.pull += residual * weight;
    }

    /// A residual of a projection on to the plane z = 1 of whoever looks along z from the origin, at a distance of
    /// `depth` metres; `p`: the point.
    pub fn add_projection(&mut self, weight: f64, residual: DVec2, p: DVec3, depth: f64) {
        let [u, v] = rows(p, depth);
        self.xx += weight * u.x * u.x;
        self.xz += weight * u.x * u.z;
        self.yy += weight * v.y * v.y;
        self.yz += weight * v.y * v.z;
        self.zz += weight * (u.z * u.z + v.z * v.z);
        self.pull += (u * residual.x + v * residual.y) * weight;
    }

    /// A residual of one number, whose derivative by the point is `row`.
    pub fn add_row(&mut self, weight: f64, row: DVec3, residual: f64) {
        let pulled = row * weight;
        self.xx += pulled.x * row.x;
        self.xy += pulled.x * row.y;
        self.xz += pulled.x * row.z;
        self.yy += pulled.y * row.y;
        self.yz += pulled.y * row.z;
        self.zz += pulled.z * row.z;
        self.pull += pulled * residual;
    }

    /// Of both.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            xx: self.xx + other.xx,
            xy: self.xy + other.xy,
            xz: self.xz + other.xz,
            yy: self.yy + other.yy,
            yz: self.yz + other.yz,
            zz: self.zz + other.zz,
            pull: self.pull + other.pull,
        }
    }

    /// Matrix times vector.
    pub fn apply(&self, v: DVec3) -> DVec3 {
        DVec3::new(
            self.xx * v.x + self.xy * v.y + self.xz * v.z,
            self.xy * v.x + self.yy * v.y + self.yz * v.z,
            self.xz * v.x + self.yz * v.y + self.zz * v.z,
        )
    }

    /// Whether nothing is known.
    pub fn is_zero(&self) -> bool {
        self.xx == 0.0 && self.yy == 0.0 && self.zz == 0.0
    }
}

/// Adds everything that is known about one joint's place to the normal equations. All of it constrains the same three
/// coordinates, so it comes summed up: once for the joint in space and once relative to the pelvis.
pub fn constrain(
    skeleton: &Skeleton,
    posed: &Posed,
    joint: usize,
    space: &Quadratic,
    relative: &Quadratic,
    out: &mut NormalEquations,
) {
    if space.is_zero() && relative.is_zero() {
        return;
    }
    let rows = skeleton.elimination().rows();
    let mut columns = [DVec3::ZERO; DOF];
    let mut slots = [0; DOF];
    let mut n = 0;
    skeleton.jacobian(posed, joint, |d, column| {
        columns[n] = column;
        slots[n] = rows[d];
        n += 1;
    });
    // What is relative to the pelvis does not move with it.
    let turns = Dof::POSITION.end;
    let (columns, slots) = (&columns[turns..n], &slots[turns..n]);
    let both = space.plus(relative);
    for (i, column) in columns.iter().enumerate() {
        let pulled = both.apply(*column);
        out.pull(slots[i], column.dot(both.pull));
        // Slots fall along the chain: row of the nearer, column of the farther.
        for (other, slot) in columns[i..].iter().zip(&slots[i..]) {
            out.add(slots[i], *slot, pulled.dot(*other));
        }
    }
    if space.is_zero() {
        return;
    }
    for a in 0..3 {
        let row = rows[a];
        out.pull(row, space.pull[a]);
        let pulled = space.apply(DVec3::AXES[a]);
        for b in a..3 {
            out.add(row, rows[b], pulled[b]);
        }
        for (column, slot) in columns.iter().zip(slots) {
            out.add(row, *slot, pulled.dot(*column));
        }
    }
}
