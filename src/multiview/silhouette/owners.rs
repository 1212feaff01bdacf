//! What differs from the background and who was seen go in, a mask comes out.
//!
//! Only regions on somebody's bones count; every pixel of them is the nearest person's, as far as a body reaches. What
//! is neither somebody's nor surely nobody's is [`UNKNOWN`]: no contour is beside it.

use glam::DVec2;

use super::background::{Pixel, near};
use super::clean::Bits;
use super::contour::Mask;
use super::figure::Figure;
use super::picture::squares;

/// The value of pixels of which it is not known whose they are.
pub const UNKNOWN: u8 = 255;
/// Statures from the bones to which a body and its clothes reach.
const REACH: f64 = 0.13;
/// Statures from the bones within which a body is in any case: what looks like the background there is not nobody's.
const CORE: f64 = 0.04;
/// Share of the bones that a person's region covers at least.
const COVERED: f64 = 0.75;
/// Area of a person's region at least, as part of their joints' box, and at most, as part of the picture.
const AREA: [f64; 2] = [0.1, 0.5];
/// Gaps that are closed and holes that are filled, as parts of the smallest person's stature and of its square.
const CLOSED: f64 = 0.006;
const HOLE: f64 = 0.004;
/// Regions under so many pixels are specks.
const SPECK: usize = 12;

/// The mask of a picture of `size` pixels: person `k` has value `k + 1`. `differing` and `people` are in pixels of the
/// [small picture](super::picture::Small).
pub fn mask(size: [u32; 2], differing: &[Pixel], people: &[Figure]) -> Mask {
    let by = squares(size);
    let [w, h] = size.map(|s| (s as usize).div_ceil(by));
    let people = &people[..people.len().min(usize::from(UNKNOWN) - 1)];
    let smallest = people
        .iter()
        .map(|f| f.stature)
        .fold(f64::INFINITY, f64::min);
    let mut owners: Vec<u8> = differing
        .iter()
        .map(|p| if *p == Pixel::Unknown { UNKNOWN } else { 0 })
        .collect();
    if smallest.is_finite() {
        let on = differing.iter().map(|p| *p == Pixel::Foreground).collect();
        let closed = (CLOSED * smallest).round().clamp(1.0, 4.0) as usize;
        let bits = Bits { size: [w, h], on }.cleaned(closed, (HOLE * smallest * smallest) as usize);
        give([w, h], &bits, people, &mut owners);
        let within = near([w, h], people, CORE);
        for (owner, _) in owners
            .iter_mut()
            .zip(within)
            .filter(|(o, near)| **o == 0 && *near)
        {
            *owner = UNKNOWN;
        }
        for (k, figure) in people.iter().enumerate() {
            let own = k as u8 + 1;
            if !plausible([w, h], &owners, own, figure) {
                owners
                    .iter_mut()
                    .filter(|o| **o == own)
                    .for_each(|o| *o = UNKNOWN);
            }
        }
    }
    let [full_w, full_h] = size.map(|s| s as usize);
    let at = |x: usize, y: usize| owners[y / by * w + x / by];
    let each = (0..full_h).flat_map(|y| (0..full_w).map(move |x| (x, y)));
    Mask {
        size,
        owners: each.map(|(x, y)| at(x, y)).collect(),
        unknown: Some(UNKNOWN),
    }
}

/// Gives every pixel of a region that lies on somebody's bones to who is nearest.
fn give(size: [usize; 2], bits: &Bits, people: &[Figure], owners: &mut [u8]) {
    let mut bone = vec![false; owners.len()];
    let on_bones = people.iter().flat_map(Figure::points);
    on_bones
        .filter_map(|p| number(size, p))
        .for_each(|k| bone[k] = true);
    for region in bits.regions() {
        if region.len() < SPECK {
            continue;
        }
        let somebody = region.iter().any(|k| bone[*k]);
        for k in region {
            if owners[k] == UNKNOWN {
                continue;
            }
            let pixel = DVec2::new((k % size[0]) as f64, (k / size[0]) as f64);
            let each = people.iter().map(|f| f.distance(pixel)).enumerate();
            let nearest = each.min_by(|a, b| a.1.total_cmp(&b.1));
            owners[k] = match nearest {
                Some((person, off)) if somebody && off < REACH => person as u8 + 1,
                _ => UNKNOWN,
            };
        }
    }
}

/// Whether a person's region can be them.
fn plausible(size: [usize; 2], owners: &[u8], own: u8, figure: &Figure) -> bool {
    let area = owners.iter().filter(|o| **o == own).count() as f64;
    let (mut inside, mut covered) = (0, 0);
    for k in figure.points().filter_map(|p| number(size, p)) {
        inside += 1;
        // Where another stands before them their bones are covered as well.
        covered += usize::from(owners[k] != 0 && owners[k] != UNKNOWN);
    }
    covered as f64 >= COVERED * f64::from(inside)
        && area >= AREA[0] * figure.area()
        && area <= AREA[1] * owners.len() as f64
}

/// The number of a pixel; `None` outside of the picture.
fn number([w, h]: [usize; 2], p: DVec2) -> Option<usize> {
    let p = p.round().as_ivec2();
    let inside = p.x >= 0 && p.y >= 0 && (p.x as usize) < w && (p.y as usize) < h;
    inside.then(|| p.y as usize * w + p.x as usize)
}
