//! The body as a smooth solid: a build and its clothes go in, a signed distance in the rest pose comes out.

use glam::{Quat, Vec3};

use super::outfit::{Hair, Matter, Outfit};
use super::shape::{Bone, REST_ARM, Shape};

/// One solid.
#[derive(Debug, Clone)]
enum Solid {
    /// Two spheres and the cone between them.
    Cone { a: Vec3, b: Vec3, ra: f32, rb: f32 },
    /// Ellipsoid turned by a rotation.
    Egg {
        centre: Vec3,
        radii: Vec3,
        turn: Quat,
    },
    /// Stacked ellipses: height, half width, half depth, centre z; heights rise.
    Stack(Vec<[f32; 4]>),
}

/// A part of the body: a solid, how softly it joins the rest, what it is made of, which bone moves it.
#[derive(Debug, Clone)]
pub struct Part {
    solid: Solid,
    soft: f32,
    /// Substance of its surface.
    pub matter: Matter,
    /// Bone that moves it.
    pub bone: Bone,
    centre: Vec3,
    reach: f32,
}

/// The whole rest-pose solid.
#[derive(Debug, Clone)]
pub struct Flesh {
    /// All parts.
    pub parts: Vec<Part>,
}

impl Part {
    fn new(solid: Solid, soft: f32, matter: Matter, bone: Bone) -> Self {
        let (centre, reach) = match &solid {
            Solid::Cone { a, b, ra, rb } => ((*a + *b) * 0.5, a.distance(*b) * 0.5 + ra.max(*rb)),
            Solid::Egg { centre, radii, .. } => (*centre, radii.max_element()),
            Solid::Stack(rows) => {
                let (lo, hi) = (rows[0][0], rows[rows.len() - 1][0]);
                let wide = rows
                    .iter()
                    .map(|r| r[1].max(r[2] + r[3].abs()))
                    .fold(0.0, f32::max);
                (Vec3::new(0.0, 0.5 * (lo + hi), 0.0), 0.5 * (hi - lo) + wide)
            }
        };
        Self {
            solid,
            soft,
            matter,
            bone,
            centre,
            reach,
        }
    }

    /// Signed distance (approximate for ellipsoids and stacks), negative inside.
    pub fn distance(&self, p: Vec3) -> f32 {
        match &self.solid {
            Solid::Cone { a, b, ra, rb } => {
                let axis = *b - *a;
                let t = ((p - *a).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
                // The radius eases in and out: straight cones look like pipes.
                p.distance(*a + axis * t) - (ra + (rb - ra) * t)
            }
            Solid::Egg {
                centre,
                radii,
                turn,
            } => ellipsoid(turn.inverse() * (p - *centre), *radii),
            Solid::Stack(rows) => {
                let (lo, hi) = (rows[0][0], rows[rows.len() - 1][0]);
                let y = p.y.clamp(lo, hi);
                let k = rows.partition_point(|r| r[0] <= y).clamp(1, rows.len() - 1);
                let (a, b) = (rows[k - 1], rows[k]);
                let t = (y - a[0]) / (b[0] - a[0]);
                let t = t * t * (3.0 - 2.0 * t) * 0.5 + t * 0.5;
                let mix = |i: usize| a[i] + (b[i] - a[i]) * t;
                let (w, d, z) = (mix(1), mix(2), mix(3));
                let q = Vec3::new(p.x, 0.0, p.z - z);
                let side = ellipse(q.x, q.z, w, d);
                let over = p.y - y;
                if over == 0.0 {
                    side
                } else if side > 0.0 {
                    side.hypot(over)
                } else {
                    over.abs().max(side)
                }
            }
        }
    }
}

fn ellipsoid(p: Vec3, r: Vec3) -> f32 {
    let k0 = (p / r).length();
    let k1 = (p / (r * r)).length();
    if k1 < 1e-6 {
        -r.min_element()
    } else {
        k0 * (k0 - 1.0) / k1
    }
}

fn ellipse(x: f32, z: f32, w: f32, d: f32) -> f32 {
    let k0 = (x / w).hypot(z / d);
    let k1 = (x / (w * w)).hypot(z / (d * d));
    if k1 < 1e-6 {
        -w.min(d)
    } else {
        k0 * (k0 - 1.0) / k1
    }
}

impl Flesh {
    /// Builds the solid of a dressed person.
    pub fn new(shape: &Shape, outfit: &Outfit) -> Self {
        let mut parts = Vec::with_capacity(64);
        let u = shape.unit();
        let (fem, bulk, muscle) = (shape.feminine, shape.bulk, shape.muscle);
        let fat = 1.0 + 0.20 * bulk.max(0.0) + 0.10 * bulk.min(0.0);
        let limb = (0.97 + 0.10 * muscle + 0.16 * bulk) * u;
        let at = |x: f32, y: f32, z: f32| shape.at(x, y, z);
        let j = &shape.joints;

        // ------------------------------------------------------------ trunk
        let mix = |m: f32, f: f32| m + (f - m) * fem;
        let belly = bulk.max(0.0);
        let shoulder = j[5].x / u;
        let profile = [
            // height, half width, half depth, centre z
            [0.485, 0.080, 0.055, -0.006],
            [0.500, mix(0.094, 0.101), 0.066, -0.008],
            [0.520, mix(0.098, 0.106), 0.070, -0.009],
            [0.550, mix(0.095, 0.100), 0.067, -0.005],
            [
                0.585,
                mix(0.088, 0.086) + 0.010 * belly,
                0.060 + 0.020 * belly,
                0.002 + 0.014 * belly,
            ],
            [
                0.620,
                mix(0.083, 0.074) + 0.014 * belly,
                mix(0.058, 0.053) + 0.024 * belly,
                0.003 + 0.018 * belly,
            ],
            [
                0.665,
                mix(0.087, 0.077) + 0.010 * belly,
                mix(0.062, 0.056) + 0.014 * belly,
                0.001 + 0.010 * belly,
            ],
            [0.710, mix(0.096, 0.085), mix(0.067, 0.060), 0.001],
            [0.745, mix(0.101, 0.089), mix(0.067, 0.059), 0.000],
            [0.775, 0.90 * shoulder, 0.056, -0.004],
            [0.798, 0.72 * shoulder, 0.045, -0.006],
            [0.818, 0.052, 0.038, -0.006],
            [0.832, 0.035, 0.034, -0.004],
        ];
        let scaled = |from: f32, to: f32, ease: f32| -> Vec<[f32; 4]> {
            let row = |r: &[f32; 4]| {
                let p = at(0.0, r[0], r[3]);
                [p.y, r[1] * u * fat + ease, r[2] * u * fat + ease, p.z]
            };
            let mut rows: Vec<[f32; 4]> = profile
                .iter()
                .filter(|r| r[0] > from && r[0] < to)
                .map(row)
                .collect();
            // end exactly at the hem and the collar
            for (y, front) in [(from, true), (to, false)] {
                let k = profile.partition_point(|r| r[0] < y);
                if k == 0 || k == profile.len() {
                    continue;
                }
                let (a, b) = (profile[k - 1], profile[k]);
                let t = (y - a[0]) / (b[0] - a[0]);
                let r = row(&[
                    y,
                    a[1] + (b[1] - a[1]) * t,
                    a[2] + (b[2] - a[2]) * t,
                    a[3] + (b[3] - a[3]) * t,
                ]);
                if front {
                    rows.insert(0, r)
                } else {
                    rows.push(r)
                }
            }
            rows
        };
        parts.push(Part::new(
            Solid::Stack(scaled(0.0, 1.0, 0.0)),
            0.02 * u,
            Matter::Skin,
            Bone::Chest,
        ));
        if !outfit.bare_chest {
            let rows = scaled(outfit.hem, outfit.collar.min(0.83), outfit.top_ease);
            parts.push(Part::new(
                Solid::Stack(rows),
                0.015 * u,
                Matter::Top,
                Bone::Chest,
            ));
        }
        let rows = scaled(0.0, outfit.hem.max(0.57), outfit.bottom_ease.min(0.012));
        parts.push(Part::new(
            Solid::Stack(rows),
            0.015 * u,
            Matter::Bottom,
            Bone::Pelvis,
        ));
        let bust = outfit.top_ease * 0.5;
        for s in [-1.0, 1.0] {
            let cover = if outfit.bare_chest {
                Matter::Skin
            } else {
                Matter::Top
            };
            // chest and trapezius
            let r = mix(0.032, 0.034 + 0.006 * bulk) * u + bust;
            parts.push(Part::new(
                Solid::Egg {
                    centre: at(s * 0.044, mix(0.745, 0.733), mix(0.036, 0.046)),
                    radii: Vec3::new(r * 1.15, r, r * mix(0.75, 1.0)),
                    turn: Quat::IDENTITY,
                },
                0.025 * u,
                cover,
                Bone::Chest,
            ));
            parts.push(Part::new(
                Solid::Cone {
                    a: at(s * 0.014, 0.838, -0.010),
                    b: at(s * 0.88 * shoulder, 0.792, -0.006),
                    ra: 0.021 * u,
                    rb: 0.021 * limb,
                },
                0.025 * u,
                Matter::Skin,
                Bone::Chest,
            ));
            // buttock
            let r = mix(0.046, 0.051) * u * fat + outfit.bottom_ease * 0.4;
            parts.push(Part::new(
                Solid::Egg {
                    centre: at(s * 0.046, 0.502, -0.030),
                    radii: Vec3::new(r, r * 1.1, r),
                    turn: Quat::IDENTITY,
                },
                0.03 * u,
                Matter::Bottom,
                Bone::Pelvis,
            ));
        }

        // ------------------------------------------------------------- limbs
        for side in 0..2 {
            let s = if side == 0 { -1.0 } else { 1.0 };
            let [sho, elb, wri] = [0, 1, 2].map(|k| j[2 + 3 * side + k]);
            let [hip, kne, ank] = [0, 1, 2].map(|k| j[8 + 3 * side + k]);
            let (hand, toe) = (j[17 + side], j[19 + side]);
            let bones = if side == 0 {
                [
                    Bone::RUpperArm,
                    Bone::RForearm,
                    Bone::RHand,
                    Bone::RThigh,
                    Bone::RShin,
                    Bone::RFoot,
                    Bone::RClavicle,
                ]
            } else {
                [
                    Bone::LUpperArm,
                    Bone::LForearm,
                    Bone::LHand,
                    Bone::LThigh,
                    Bone::LShin,
                    Bone::LFoot,
                    Bone::LClavicle,
                ]
            };
            let mut cone =
                |a: Vec3, b: Vec3, ra: f32, rb: f32, soft: f32, m: Matter, bone: Bone| {
                    parts.push(Part::new(Solid::Cone { a, b, ra, rb }, soft * u, m, bone));
                };
            let arm_fem = 1.0 - 0.12 * fem;
            let (rs, rb, re, rf, rw) = (
                0.0315 * limb * arm_fem,
                0.0285 * limb * arm_fem,
                0.0225 * limb * arm_fem,
                0.0240 * limb * arm_fem,
                0.0148 * (0.6 * limb + 0.4 * u) * arm_fem,
            );
            let mid = sho.lerp(elb, 0.45);
            let fore = elb.lerp(wri, 0.25);
            cone(
                sho + (elb - sho) * 0.04,
                mid,
                rs * 0.95,
                rb,
                0.015,
                Matter::Skin,
                bones[0],
            );
            cone(mid, elb, rb, re, 0.015, Matter::Skin, bones[0]);
            cone(elb, fore, re * 0.98, rf, 0.015, Matter::Skin, bones[1]);
            cone(fore, wri, rf, rw, 0.012, Matter::Skin, bones[1]);
            // deltoid
            cone(
                sho + Vec3::new(-s * 0.020 * u, 0.004 * u, 0.0),
                sho + Vec3::new(s * 0.004 * u, 0.0, 0.0),
                0.027 * limb * arm_fem,
                0.0295 * limb * arm_fem,
                0.02,
                Matter::Skin,
                bones[6],
            );
            if outfit.sleeve >= 0.0 && !outfit.bare_chest {
                let e = outfit.top_ease * 0.8 + 0.002;
                let upper = outfit.sleeve.min(1.0);
                let end = sho.lerp(elb, upper);
                let r_end = rs + (re - rs) * upper + e * (1.0 + 0.4 * (1.0 - upper));
                cone(
                    sho + (elb - sho) * 0.06,
                    end,
                    rs * 0.97 + 0.8 * e,
                    r_end,
                    0.012,
                    Matter::Top,
                    bones[0],
                );
                cone(
                    sho + Vec3::new(-s * 0.022 * u, 0.004 * u, 0.0),
                    sho,
                    0.026 * limb * arm_fem + e,
                    0.028 * limb * arm_fem + e,
                    0.015,
                    Matter::Top,
                    bones[6],
                );
                if outfit.sleeve > 1.0 {
                    let lower = (outfit.sleeve - 1.0).min(1.0);
                    cone(
                        elb,
                        elb.lerp(wri, lower),
                        re + e,
                        rf + (rw * 1.1 - rf) * lower + e,
                        0.012,
                        Matter::Top,
                        bones[1],
                    );
                }
            }
            // hand: palm, fingers, thumb; the palm faces the thigh, the thumb points forwards
            let along = (hand - wri).normalize();
            let turn = Quat::from_rotation_z(s * REST_ARM);
            parts.push(Part::new(
                Solid::Egg {
                    centre: wri + along * 0.034 * u + Vec3::Z * 0.001 * u,
                    radii: Vec3::new(0.0105, 0.036, 0.0225) * u,
                    turn,
                },
                0.010 * u,
                Matter::Skin,
                bones[2],
            ));
            let inward = turn * Vec3::new(-s, 0.0, 0.0);
            for (z, length) in [
                (-0.014, 0.034),
                (-0.005, 0.041),
                (0.005, 0.043),
                (0.0145, 0.038),
            ] {
                let a = wri + along * 0.054 * u + Vec3::Z * z * u;
                let b = a + (along * length * 0.92 + inward * length * 0.38) * u;
                parts.push(Part::new(
                    Solid::Cone {
                        a,
                        b,
                        ra: 0.0062 * u,
                        rb: 0.0052 * u,
                    },
                    0.006 * u,
                    Matter::Skin,
                    bones[2],
                ));
            }
            let a = wri + along * 0.016 * u + Vec3::Z * 0.014 * u;
            parts.push(Part::new(
                Solid::Cone {
                    a,
                    b: a + (along * 0.030 + Vec3::Z * 0.018 + inward * 0.010) * u,
                    ra: 0.0085 * u,
                    rb: 0.0058 * u,
                },
                0.008 * u,
                Matter::Skin,
                bones[2],
            ));

            let mut cone =
                |a: Vec3, b: Vec3, ra: f32, rb: f32, soft: f32, m: Matter, bone: Bone| {
                    parts.push(Part::new(Solid::Cone { a, b, ra, rb }, soft * u, m, bone));
                };
            let leg_fem = 1.0 + 0.05 * fem;
            let (rt, rm, rk, rc, ra) = (
                0.0500 * limb * leg_fem,
                0.0440 * limb * leg_fem,
                0.0300 * limb,
                0.0325 * limb,
                0.0205 * (0.5 * limb + 0.5 * u),
            );
            let groin = hip + Vec3::new(s * 0.004, -0.022, -0.004) * u;
            let thigh = hip.lerp(kne, 0.42);
            let calf = kne.lerp(ank, 0.28) + Vec3::new(0.0, 0.0, -0.010) * u;
            cone(groin, thigh, rt, rm, 0.012, Matter::Skin, bones[3]);
            cone(thigh, kne, rm, rk, 0.012, Matter::Skin, bones[3]);
            cone(kne, calf, rk * 0.98, rc, 0.015, Matter::Skin, bones[4]);
            cone(calf, ank, rc, ra, 0.015, Matter::Skin, bones[4]);
            let e = outfit.bottom_ease;
            let upper = outfit.trouser.min(1.0);
            let radius = |t: f32, bare: f32| bare + e * (0.6 + 0.6 * t) + 0.016 * outfit.flare * t;
            if upper > 0.05 {
                let r_top = rt + 0.5 * e;
                if upper < 0.42 {
                    cone(
                        groin,
                        hip.lerp(kne, upper),
                        r_top,
                        radius(0.3, rm),
                        0.01,
                        Matter::Bottom,
                        bones[3],
                    );
                } else {
                    cone(
                        groin,
                        thigh,
                        r_top,
                        radius(0.42, rm),
                        0.01,
                        Matter::Bottom,
                        bones[3],
                    );
                    let t = (upper - 0.42) / 0.58;
                    cone(
                        thigh,
                        hip.lerp(kne, upper),
                        radius(0.42, rm),
                        radius(upper, rm + (rk - rm) * t),
                        0.01,
                        Matter::Bottom,
                        bones[3],
                    );
                }
            }
            if outfit.trouser > 1.0 {
                let lower = (outfit.trouser - 1.0).min(0.97);
                let end = kne.lerp(ank, lower);
                let mid = kne.lerp(ank, 0.28 * lower.min(1.0));
                cone(
                    kne,
                    mid,
                    radius(1.0, rk),
                    radius(1.2, rc),
                    0.01,
                    Matter::Bottom,
                    bones[4],
                );
                cone(
                    mid,
                    end,
                    radius(1.2, rc),
                    radius(1.0 + lower, rc + (ra - rc) * 0.8 * lower),
                    0.01,
                    Matter::Bottom,
                    bones[4],
                );
            }
            // shoe: heel, ball, toes, flat below
            let heel = Vec3::new(ank.x, 0.019 * u, ank.z - 0.020 * u);
            let tip = Vec3::new(toe.x, 0.0135 * u, toe.z + 0.006 * u);
            let ball = Vec3::new(ank.x + s * 0.006 * u, 0.016 * u, ank.z + 0.068 * u);
            cone(
                ank,
                heel,
                ra * 1.1,
                0.0215 * u,
                0.012,
                Matter::Shoe,
                bones[5],
            );
            cone(
                heel,
                ball,
                0.0215 * u,
                0.0235 * u,
                0.012,
                Matter::Shoe,
                bones[5],
            );
            cone(
                ank + Vec3::new(0.0, -0.004, 0.012) * u,
                ball,
                0.020 * u,
                0.0205 * u,
                0.012,
                Matter::Shoe,
                bones[5],
            );
            cone(
                ball,
                tip,
                0.0235 * u,
                0.0165 * u,
                0.012,
                Matter::Shoe,
                bones[5],
            );
        }

        if let Some(length) = outfit.skirt {
            let y = 0.518 - 0.235 * length.min(1.0) - 0.24 * (length - 1.0).max(0.0);
            let wide = 0.118 + 0.02 * length + 0.03 * outfit.flare.max(0.0);
            let rows = [
                [y, wide, 0.082 + 0.02 * length, 0.0],
                [0.5 * (y + 0.52), 0.5 * (wide + 0.112), 0.086, -0.004],
                [0.520, mix(0.104, 0.112), 0.080, -0.006],
                [0.575, 0.094, 0.066, 0.0],
            ]
            .map(|r| {
                let p = at(0.0, r[0], r[3]);
                [p.y, r[1] * u * fat, r[2] * u * fat, p.z]
            });
            parts.push(Part::new(
                Solid::Stack(rows.to_vec()),
                0.01 * u,
                Matter::Bottom,
                Bone::Pelvis,
            ));
        }
        head(&mut parts, shape, outfit);
        if outfit.bag {
            parts.push(Part::new(
                Solid::Egg {
                    centre: at(0.0, 0.715, -0.105),
                    radii: Vec3::new(0.082, 0.115, 0.058) * u,
                    turn: Quat::IDENTITY,
                },
                0.008 * u,
                Matter::Bag,
                Bone::Chest,
            ));
        }
        Self { parts }
    }

    /// Parts that can matter within `radius` of `p`.
    pub fn near(&self, p: Vec3, radius: f32) -> Vec<u16> {
        (0..self.parts.len())
            .filter(|&k| {
                let part = &self.parts[k];
                p.distance(part.centre) - part.reach < radius + part.soft + 0.03
            })
            .map(|k| k as u16)
            .collect()
    }

    /// Signed distance to the union of some parts, which stand on the floor y = 0.
    pub fn distance(&self, p: Vec3, among: &[u16]) -> f32 {
        let mut d = 1.0f32;
        for &k in among {
            let part = &self.parts[k as usize];
            let e = part.distance(p);
            let h = (part.soft - (d - e).abs()).max(0.0) / part.soft.max(1e-6);
            d = d.min(e) - h * h * part.soft * 0.25;
        }
        d.max(-p.y)
    }
}

/// Skull, face, neck, ears, hair, hat.
fn head(parts: &mut Vec<Part>, shape: &Shape, outfit: &Outfit) {
    let u = shape.unit();
    let fem = shape.feminine;
    let at = |x: f32, y: f32, z: f32| shape.at(x, y, z);
    let mut cone = |a: Vec3, b: Vec3, ra: f32, rb: f32, soft: f32, m: Matter, bone: Bone| {
        parts.push(Part::new(
            Solid::Cone {
                a,
                b,
                ra: ra * u,
                rb: rb * u,
            },
            soft * u,
            m,
            bone,
        ));
    };
    let neck = (0.0335 - 0.005 * fem + 0.003 * shape.muscle) * (1.0 + 0.12 * shape.bulk.max(0.0));
    cone(
        at(0.0, 0.815, -0.006),
        at(0.0, 0.845, 0.0),
        neck * 1.1,
        neck,
        0.02,
        Matter::Skin,
        Bone::Chest,
    );
    cone(
        at(0.0, 0.845, 0.0),
        at(0.0, 0.892, 0.012),
        neck,
        neck * 0.95,
        0.015,
        Matter::Skin,
        Bone::Head,
    );
    let mut egg = |c: [f32; 3], r: [f32; 3], tilt: f32, soft: f32, m: Matter| {
        parts.push(Part::new(
            Solid::Egg {
                centre: at(c[0], c[1], c[2]),
                radii: Vec3::from_array(r) * u,
                turn: Quat::from_rotation_x(tilt),
            },
            soft * u,
            m,
            Bone::Head,
        ));
    };
    let jaw = 1.0 + 0.10 * shape.bulk.max(0.0);
    egg(
        [0.0, 0.9385, 0.012],
        [0.0435, 0.0545, 0.0545],
        0.0,
        0.01,
        Matter::Skin,
    );
    egg(
        [0.0, 0.9050, 0.030],
        [0.0350 * jaw, 0.0375, 0.0360],
        0.15,
        0.02,
        Matter::Skin,
    );
    egg(
        [0.0, 0.8800, 0.046],
        [0.0165, 0.0120, 0.0140],
        0.0,
        0.015,
        Matter::Skin,
    );
    egg(
        [0.0, 0.9150, 0.0665],
        [0.0072, 0.0160, 0.0095],
        -0.35,
        0.006,
        Matter::Skin,
    );
    for s in [-1.0, 1.0] {
        egg(
            [s * 0.0440, 0.9200, 0.008],
            [0.0045, 0.0165, 0.0100],
            0.2,
            0.004,
            Matter::Skin,
        );
    }
    let h = Matter::Hair;
    match outfit.hair {
        Hair::Bald => {}
        Hair::Short => egg(
            [0.0, 0.9430, 0.0070],
            [0.0465, 0.0560, 0.0560],
            -0.25,
            0.006,
            h,
        ),
        Hair::Full => {
            egg(
                [0.0, 0.9470, 0.0060],
                [0.0500, 0.0590, 0.0600],
                -0.3,
                0.006,
                h,
            );
            egg(
                [0.0, 0.9050, -0.0210],
                [0.0400, 0.0350, 0.0280],
                0.0,
                0.01,
                h,
            );
        }
        Hair::Afro => egg(
            [0.0, 0.9560, -0.0020],
            [0.0640, 0.0680, 0.0660],
            -0.2,
            0.006,
            h,
        ),
        Hair::Bob => {
            egg(
                [0.0, 0.9450, 0.0030],
                [0.0500, 0.0580, 0.0570],
                -0.3,
                0.006,
                h,
            );
            egg(
                [0.0, 0.9050, -0.0160],
                [0.0520, 0.0520, 0.0400],
                0.0,
                0.012,
                h,
            );
        }
        Hair::Long => {
            egg(
                [0.0, 0.9450, 0.0030],
                [0.0495, 0.0575, 0.0570],
                -0.3,
                0.006,
                h,
            );
            egg(
                [0.0, 0.8750, -0.0220],
                [0.0530, 0.0900, 0.0300],
                0.12,
                0.012,
                h,
            );
            egg(
                [0.0, 0.8200, -0.0420],
                [0.0480, 0.0800, 0.0220],
                0.05,
                0.012,
                h,
            );
        }
        Hair::Ponytail => {
            egg(
                [0.0, 0.9430, 0.0050],
                [0.0460, 0.0560, 0.0560],
                -0.25,
                0.006,
                h,
            );
            egg(
                [0.0, 0.9350, -0.0580],
                [0.0160, 0.0180, 0.0200],
                0.0,
                0.006,
                h,
            );
            egg(
                [0.0, 0.8950, -0.0720],
                [0.0150, 0.0500, 0.0150],
                0.15,
                0.01,
                h,
            );
        }
        Hair::Bun => {
            egg(
                [0.0, 0.9430, 0.0050],
                [0.0460, 0.0560, 0.0560],
                -0.25,
                0.006,
                h,
            );
            egg(
                [0.0, 0.9850, -0.0350],
                [0.0230, 0.0210, 0.0230],
                0.0,
                0.006,
                h,
            );
        }
        Hair::Cap => {
            egg(
                [0.0, 0.9080, -0.0160],
                [0.0420, 0.0380, 0.0330],
                0.0,
                0.006,
                h,
            );
            egg(
                [0.0, 0.9600, 0.0120],
                [0.0480, 0.0440, 0.0585],
                -0.05,
                0.004,
                Matter::Hat,
            );
            egg(
                [0.0, 0.9590, 0.0770],
                [0.0380, 0.0045, 0.0360],
                0.15,
                0.004,
                Matter::Hat,
            );
        }
        Hair::Beanie => {
            egg(
                [0.0, 0.9080, -0.0160],
                [0.0420, 0.0380, 0.0330],
                0.0,
                0.006,
                h,
            );
            egg(
                [0.0, 0.9620, 0.0080],
                [0.0485, 0.0530, 0.0590],
                -0.25,
                0.004,
                Matter::Hat,
            );
        }
    }
}
