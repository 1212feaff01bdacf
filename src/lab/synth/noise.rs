//! Chance and texture: a seed goes in, reproducible random numbers and smooth noise come out.

use glam::Vec3;

/// Random numbers that depend on the seed alone (SplitMix64), on every machine and for every thread count.
#[derive(Debug, Clone)]
pub struct Dice(u64);

/// One round of SplitMix64's finaliser: spreads any change of the input over all bits.
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Dice {
    /// Numbers for a seed and a stream: streams of one seed are independent.
    pub fn new(seed: u64, stream: u64) -> Self {
        Self(
            mix(seed.wrapping_add(0x9e37_79b9_7f4a_7c15))
                ^ mix(stream.wrapping_mul(0xd1b5_4a32_d192_ed03)),
        )
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }

    /// Uniform in 0..1.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform between two values.
    pub fn range(&mut self, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * self.unit()
    }

    /// True with the given probability.
    pub fn chance(&mut self, p: f32) -> bool {
        self.unit() < p
    }

    /// Uniform in `0..n`; `n` must not be 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    /// One of the values.
    pub fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }

    /// About normal with mean 0 and deviation 1, never beyond ±4.24 (3 √2): the sum of six uniforms, brought to size.
    pub fn normal(&mut self) -> f32 {
        let s: f32 = (0..6).map(|_| self.unit()).sum();
        (s - 3.0) * std::f32::consts::SQRT_2
    }

    /// Either sign.
    pub fn sign(&mut self) -> f32 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }
}

/// Hash of a lattice point, 0..1.
pub fn lattice(x: i32, y: i32, z: i32, seed: u32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x8da6_b343)
        ^ (y as u32).wrapping_mul(0xd816_3841)
        ^ (z as u32).wrapping_mul(0xcb1a_b31f)
        ^ seed.wrapping_mul(0x9e37_79b1);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    h ^= h >> 15;
    (h >> 8) as f32 / (1u32 << 24) as f32
}

/// Smooth value noise, 0..1, features of size 1.
pub fn value(p: Vec3, seed: u32) -> f32 {
    let f = p.floor();
    let (x, y, z) = (f.x as i32, f.y as i32, f.z as i32);
    let t = p - f;
    let t = t * t * (Vec3::splat(3.0) - 2.0 * t);
    // Far away, as where a ray grazes the floor, whole numbers end.
    let next = |at: i32| at.wrapping_add(1);
    let row = |y: i32, z: i32| {
        let (a, b) = (lattice(x, y, z, seed), lattice(next(x), y, z, seed));
        a + (b - a) * t.x
    };
    let (a, b) = (row(y, z), row(next(y), z));
    let near = a + (b - a) * t.y;
    let (a, b) = (row(y, next(z)), row(next(y), next(z)));
    let far = a + (b - a) * t.y;
    near + (far - near) * t.z
}

/// Sum of octaves of [`value`], 0..1, each half as strong and twice as fine.
pub fn fractal(p: Vec3, octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut total, mut q) = (0.0, 1.0, 0.0, p);
    for k in 0..octaves {
        sum += weight * value(q, seed.wrapping_add(k * 101));
        total += weight;
        weight *= 0.5;
        q = q * 2.03 + Vec3::new(17.1, 5.3, 9.7);
    }
    sum / total
}

/// 0 below `lo`, 1 above `hi`, smooth between.
pub fn smoothstep(lo: f32, hi: f32, x: f32) -> f32 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_goes_on_for_ever() {
        assert!((0.0..=1.0).contains(&value(Vec3::splat(1e12), 7)));
    }
}
