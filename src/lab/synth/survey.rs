//! A moment goes in, who is where comes out: depth and identity of every sample of the picture, boxes, areas. No light.

use glam::{Vec2, Vec3};

use super::pose::Posed;
use super::raster::{Buffer, NEAR, NOBODY, TRIANGLE_BITS};
use super::scene::{Scene, Stance};

/// Samples along each side of a pixel.
pub const SUPERSAMPLE: usize = 2;

/// Who is where in one picture.
#[derive(Debug, Clone)]
pub struct Survey {
    /// Depth and identity of every sample ([`SUPERSAMPLE`] times as many across and down); places where furniture is in
    /// front hold its depth and nobody.
    pub samples: Buffer,
    /// Bones and joints of everyone, in the order of the stances.
    pub posed: Vec<Posed>,
    /// Box of every person's whole surface in pixels, hidden or not, inside the picture or not: u0, v0, u1, v1. `None`
    /// when some of it lies behind the camera.
    pub boxes: Vec<Option<[f32; 4]>>,
    /// Samples that show each person.
    pub shown: Vec<u32>,
}

/// Everyone's skin at that moment, in the order of the stances.
pub(super) struct Skins<'a> {
    /// Positions and normals in the world.
    pub surfaces: Vec<(Vec<Vec3>, Vec<Vec3>)>,
    /// Positions in camera axes.
    pub in_camera: Vec<Vec<Vec3>>,
    /// Vertex indices.
    pub triangles: Vec<&'a [[u32; 3]]>,
}

/// Draws everyone before a place whose depth at every sample is `behind`.
pub(super) fn survey<'a>(
    scene: &'a Scene,
    behind: &[f32],
    stances: &[Stance],
) -> (Survey, Skins<'a>) {
    let camera = &scene.camera;
    let ss = SUPERSAMPLE as f32;
    let posed: Vec<Posed> = stances
        .iter()
        .map(|s| scene.people[s.person].posed(s))
        .collect();
    let surfaces: Vec<(Vec<Vec3>, Vec<Vec3>)> = stances
        .iter()
        .zip(&posed)
        .map(|(s, p)| {
            let person = &scene.people[s.person];
            person.mesh().pose(p, &person.pivots)
        })
        .collect();
    let triangles: Vec<&[[u32; 3]]> = stances
        .iter()
        .map(|s| scene.people[s.person].mesh().triangles.as_slice())
        .collect();

    let mut samples = Buffer::new(
        camera.width as usize * SUPERSAMPLE,
        camera.height as usize * SUPERSAMPLE,
    );
    samples.z.copy_from_slice(behind);
    let mut boxes = Vec::new();
    let mut in_camera: Vec<Vec<Vec3>> = Vec::new();
    for (k, (points, _)) in surfaces.iter().enumerate() {
        let seen: Vec<Vec3> = points.iter().map(|p| camera.to_camera(*p)).collect();
        let on_screen: Vec<(Vec2, f32)> = seen
            .iter()
            .map(|p| {
                (
                    (camera.project(*p) + Vec2::splat(0.5)) * ss - Vec2::splat(0.5),
                    p.z,
                )
            })
            .collect();
        let ahead = seen.iter().all(|p| p.z > NEAR);
        boxes.push(ahead.then(|| {
            let (mut lo, mut hi) = (Vec2::splat(f32::MAX), Vec2::splat(f32::MIN));
            for (q, _) in &on_screen {
                let q = (*q + Vec2::splat(0.5)) / ss - Vec2::splat(0.5);
                lo = lo.min(q);
                hi = hi.max(q);
            }
            [lo.x, lo.y, hi.x, hi.y]
        }));
        samples.draw(k as u32, &on_screen, triangles[k]);
        in_camera.push(seen);
    }
    let mut shown = vec![0u32; stances.len()];
    for who in &samples.who {
        if *who != NOBODY {
            shown[(*who >> TRIANGLE_BITS) as usize] += 1;
        }
    }
    let survey = Survey {
        samples,
        posed,
        boxes,
        shown,
    };
    let skins = Skins {
        surfaces,
        in_camera,
        triangles,
    };
    (survey, skins)
}

impl Survey {
    /// Who every pixel shows, row by row: `ids` of the stances, 0 where nobody is. A pixel shows whom half of its
    /// samples or more show; of two who share it, the first in the order of the stances.
    pub fn owners(&self, ids: &[u8]) -> Vec<u8> {
        let s = &self.samples;
        let (w, h) = (s.width / SUPERSAMPLE, s.height / SUPERSAMPLE);
        let mut out = Vec::with_capacity(w * h);
        for y in 0..h {
            for x in 0..w {
                let mut own = [NOBODY; SUPERSAMPLE * SUPERSAMPLE];
                for (k, who) in own.iter_mut().enumerate() {
                    let (sx, sy) = (k % SUPERSAMPLE, k / SUPERSAMPLE);
                    let at = (y * SUPERSAMPLE + sy) * s.width + x * SUPERSAMPLE + sx;
                    if s.who[at] != NOBODY {
                        *who = s.who[at] >> TRIANGLE_BITS;
                    }
                }
                own.sort_unstable();
                let most = own
                    .chunk_by(|a, b| a == b)
                    .find(|c| c[0] != NOBODY && 2 * c.len() >= own.len());
                out.push(most.map_or(0, |c| ids[c[0] as usize]));
            }
        }
        out
    }
}
