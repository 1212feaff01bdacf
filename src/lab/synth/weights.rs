//! How much each bone moves a point of the rest pose's skin.

use glam::Vec3;

use super::flesh::Part;
use super::noise::smoothstep;
use super::outfit::Matter;
use super::shape::{BONE_PARENT, BONES, Bone, Shape};
use crate::joints::R_HIP;

/// Weights of the bones next to the nearest part's, which sum to 1: a soft change at every joint, nothing from limbs
/// that only pass by. `gap`: how far every bone's nearest part is from the point, metres.
pub fn weights(shape: &Shape, p: Vec3, nearest: &Part, gap: [f32; BONES]) -> [(u8, f32); 4] {
    let own = nearest.bone as usize;
    let soft = 0.022 * shape.unit();
    let mut w = [0.0f32; BONES];
    for b in 0..BONES {
        let next = b == own || BONE_PARENT[b] == own || BONE_PARENT[own] == b;
        if next && gap[b] < f32::MAX {
            w[b] = (-(gap[b] - gap[own]).max(0.0) / soft).exp();
        }
    }
    if is_trunk(nearest.bone) {
        hang(shape, p, nearest.matter, &mut w);
    }
    strongest(&w)
}

/// Weights of a point of a trunk, skirt or bag to which no limb is near.
pub fn of_trunk(shape: &Shape, p: Vec3, matter: Matter) -> [(u8, f32); 4] {
    let mut w = [0.0; BONES];
    hang(shape, p, matter, &mut w);
    strongest(&w)
}

/// Trunk and skirt hang on heights, not on distances: their parts overlap everywhere.
pub fn is_trunk(bone: Bone) -> bool {
    matches!(bone, Bone::Pelvis | Bone::Chest)
}

/// Shares what pelvis and chest carry between them, and with the thighs below the hips.
fn hang(shape: &Shape, p: Vec3, matter: Matter, w: &mut [f32; BONES]) {
    let u = shape.unit();
    let height = |y: f32| shape.at(0.0, y, 0.0).y;
    let t = smoothstep(height(0.575), height(0.735), p.y);
    let sum = w[0] + w[1];
    let sum = if sum > 0.0 { sum } else { 1.0 };
    w[0] = sum * (1.0 - t);
    w[1] = sum * t;
    let hip = shape.joints[R_HIP].y;
    let drop = ((hip + 0.01 * u - p.y) / (0.06 * u)).clamp(0.0, 1.0);
    if drop > 0.0 {
        let left = smoothstep(-0.05 * u, 0.05 * u, p.x);
        let free = if matter == Matter::Bottom && p.y < hip - 0.04 * u {
            1.0
        } else {
            0.6
        };
        for (b, side) in [(Bone::LThigh, left), (Bone::RThigh, 1.0 - left)] {
            w[b as usize] = w[b as usize].max(0.0) * 0.3 + drop * free * side;
        }
        w[0] *= 1.0 - 0.9 * drop * free;
    }
}

/// The four largest as shares of their sum.
fn strongest(w: &[f32; BONES]) -> [(u8, f32); 4] {
    let mut order: [usize; BONES] = std::array::from_fn(|b| b);
    order.sort_by(|&a, &b| w[b].total_cmp(&w[a]));
    let order = &order[..4];
    let total: f32 = order.iter().map(|&b| w[b]).sum();
    let mut out = [(0u8, 0.0f32); 4];
    for (slot, &b) in out.iter_mut().zip(order) {
        *slot = (b as u8, w[b] / total);
    }
    out
}
