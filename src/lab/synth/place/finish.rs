//! Colours and patterns of surfaces: which there are, and which are chosen.

use glam::Vec3;

use crate::lab::synth::noise::Dice;
use crate::lab::synth::outfit::linear;

/// How a surface is painted; colours are linear RGB.
#[derive(Debug, Clone, Copy)]
pub enum Paint {
    /// One colour with faint stains.
    Plaster,
    /// Boards of this width in metres.
    Planks(f32),
    /// Square tiles of this size with joints.
    Tiles(f32),
    /// Tiles of two colours.
    Chequers(f32),
    /// Bricks of this height.
    Bricks(f32),
    /// Coarse noise of this size: carpet, gravel, lawn, asphalt.
    Rough(f32),
    /// Vertical bands of this width.
    Bands(f32),
    /// Large blotches: murals, foliage.
    Blotches(f32),
    /// Windows of this width in a facade.
    Facade(f32),
    /// Shelves full of books and boxes.
    Shelves,
    /// Random rectangles of many colours: posters, screens, shop fronts.
    Collage(f32),
    /// A bright window with panes.
    Window,
}

/// Paint with its colours.
#[derive(Debug, Clone, Copy)]
pub struct Finish {
    /// The pattern.
    pub paint: Paint,
    /// First colour.
    pub a: Vec3,
    /// Second colour.
    pub b: Vec3,
    /// Seed of its noise.
    pub seed: u32,
}

/// A colour of random hue, at most this saturated, of a brightness (sRGB) in `lo..hi`.
pub(super) fn hue(dice: &mut Dice, saturation: f32, lo: f32, hi: f32) -> Vec3 {
    let (h, s, v) = (
        dice.unit() * 6.0,
        saturation * dice.unit(),
        dice.range(lo, hi),
    );
    let k = |n: f32| {
        let k = (n + h) % 6.0;
        v - v * s * k.min(4.0 - k).clamp(0.0, 1.0)
    };
    linear(Vec3::new(k(5.0), k(3.0), k(1.0)))
}

impl Finish {
    pub(super) fn new(paint: Paint, a: Vec3, b: Vec3, dice: &mut Dice) -> Self {
        Self {
            paint,
            a,
            b,
            seed: dice.bits() as u32,
        }
    }

    pub(super) fn wood(dice: &mut Dice) -> Self {
        let v = dice.range(0.25, 0.85);
        let a = linear(Vec3::new(
            v,
            v * dice.range(0.66, 0.85),
            v * dice.range(0.4, 0.68),
        ));
        let width = dice.range(0.07, 0.2);
        Self::new(Paint::Planks(width), a, a * dice.range(0.5, 0.85), dice)
    }

    pub(super) fn wall(dice: &mut Dice) -> Self {
        let a = if dice.chance(0.65) {
            hue(dice, 0.18, 0.55, 0.95)
        } else {
            hue(dice, 0.55, 0.25, 0.85)
        };
        let b = a * dice.range(0.55, 0.95);
        let paint = match dice.below(14) {
            0..=6 => Paint::Plaster,
            7 => Paint::Bands(dice.range(0.08, 0.5)),
            8 | 9 => Paint::Bricks(dice.range(0.07, 0.25)),
            10 => Paint::Tiles(dice.range(0.15, 0.6)),
            11 => Paint::Planks(dice.range(0.1, 0.3)),
            12 => Paint::Collage(dice.range(1.2, 3.0)),
            _ => Paint::Blotches(dice.range(0.3, 1.2)),
        };
        if matches!(paint, Paint::Collage(_) | Paint::Blotches(_)) {
            let b = hue(dice, 0.7, 0.15, 0.9);
            return Self::new(paint, a, b, dice);
        }
        Self::new(paint, a, b, dice)
    }

    pub(super) fn object(dice: &mut Dice) -> Self {
        if dice.chance(0.4) {
            return Self::wood(dice);
        }
        let a = if dice.chance(0.5) {
            hue(dice, 0.2, 0.08, 0.9)
        } else {
            hue(dice, 0.8, 0.2, 0.8)
        };
        let b = hue(dice, 0.6, 0.1, 0.9);
        let paint = match dice.below(12) {
            0..=5 => Paint::Plaster,
            6 => Paint::Bands(dice.range(0.04, 0.2)),
            7 => Paint::Tiles(dice.range(0.1, 0.4)),
            8 => Paint::Collage(dice.range(0.15, 0.7)),
            9 => Paint::Shelves,
            10 => Paint::Rough(dice.range(0.01, 0.06)),
            _ => Paint::Blotches(dice.range(0.08, 0.4)),
        };
        Self::new(paint, a, b, dice)
    }
}
