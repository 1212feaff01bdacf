//! Posed surfaces go in, a depth and identity buffer comes out.

use glam::Vec2;

/// Nearest surface drawn, mm-exact in depth.
pub const NEAR: f32 = 0.12;

/// Value of [`Buffer::who`] where no person was drawn.
pub const NOBODY: u32 = u32::MAX;

/// Bits of [`Buffer::who`] that number the triangle; the person's place in the scene is above them.
pub const TRIANGLE_BITS: u32 = 22;

/// Depth and identity of every sample, row by row.
#[derive(Debug, Clone)]
pub struct Buffer {
    /// Samples across.
    pub width: usize,
    /// Samples down.
    pub height: usize,
    /// Depth along the viewing axis; infinite where nothing was drawn.
    pub z: Vec<f32>,
    /// Person and triangle, or [`NOBODY`].
    pub who: Vec<u32>,
}

impl Buffer {
    /// An empty buffer.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            z: vec![f32::INFINITY; width * height],
            who: vec![NOBODY; width * height],
        }
    }

    /// Draws the triangles of one person. `points`: sample coordinates (centres on integers) and depth of its vertices.
    /// Triangles that reach in front of [`NEAR`] or face away are left out.
    pub fn draw(&mut self, person: u32, points: &[(Vec2, f32)], triangles: &[[u32; 3]]) {
        for (k, t) in triangles.iter().enumerate() {
            let [(a, za), (b, zb), (c, zc)] = t.map(|i| points[i as usize]);
            if za < NEAR || zb < NEAR || zc < NEAR {
                continue;
            }
            let area = (b - a).perp_dot(c - a);
            // Pictures have v downwards: what is anticlockwise in space turns clockwise here.
            if area >= 0.0 {
                continue;
            }
            let lo = a.min(b).min(c).ceil().max(Vec2::ZERO);
            let hi = a
                .max(b)
                .max(c)
                .floor()
                .min(Vec2::new(self.width as f32 - 1.0, self.height as f32 - 1.0));
            if lo.x > hi.x || lo.y > hi.y {
                continue;
            }
            let inv = area.recip();
            let (ia, ib, ic) = (za.recip(), zb.recip(), zc.recip());
            let tag = (person << TRIANGLE_BITS) | k as u32;
            for y in lo.y as usize..=hi.y as usize {
                for x in lo.x as usize..=hi.x as usize {
                    let p = Vec2::new(x as f32, y as f32);
                    let wa = (c - b).perp_dot(p - b) * inv;
                    let wb = (a - c).perp_dot(p - c) * inv;
                    let wc = 1.0 - wa - wb;
                    if wa < 0.0 || wb < 0.0 || wc < 0.0 {
                        continue;
                    }
                    let z = (wa * ia + wb * ib + wc * ic).recip();
                    let at = y * self.width + x;
                    if z < self.z[at] {
                        self.z[at] = z;
                        self.who[at] = tag;
                    }
                }
            }
        }
    }
}
