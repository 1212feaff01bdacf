//! A number of people goes in, perfect maps of that many people come out: what Stage I would say of a crowd seen in
//! full.

use edgecap_client::joints::{EVIDENCE_JOINTS, LIMB_JOINTS};

use crate::engine::{HEAD2D_CHANNELS, HEAD3D_CHANNELS, Maps};

/// Evidence joints of someone walking, in statures from the neck: x to the right, y down.
const FIGURE: [[f32; 2]; EVIDENCE_JOINTS] = [
    [0.0, -0.17],
    [0.0, 0.0],
    [-0.11, 0.02],
    [-0.15, 0.18],
    [-0.10, 0.31],
    [0.11, 0.02],
    [0.15, 0.18],
    [0.19, 0.32],
    [-0.06, 0.30],
    [-0.10, 0.53],
    [-0.12, 0.76],
    [0.06, 0.30],
    [0.09, 0.53],
    [0.13, 0.76],
];
/// People in a row before the next row begins.
const PER_ROW: usize = 10;
/// Standard deviation of a heatmap's peak and half the width of a limb, cells.
const RADIUS: f32 = 0.9;

/// Maps of `people` people who stand in rows, `width` × `height` cells.
pub(super) fn maps(people: usize, width: usize, height: usize) -> Maps {
    let mut maps = Maps::new(width, height);
    let rows = people.div_ceil(PER_ROW).max(1);
    let row_height = height as f32 / rows as f32;
    for person in 0..people {
        let (row, column) = (person / PER_ROW, person % PER_ROW);
        let columns = (people - row * PER_ROW).min(PER_ROW);
        let y = row as f32 * row_height + 0.25 * row_height;
        let stature = 0.75 * row_height;
        // Arms stay inside the picture at both ends of a row.
        let margin = 0.2 * stature + 1.0;
        let share = (column as f32 + 0.5) / columns as f32;
        let x = margin + share * (width as f32 - 2.0 * margin);
        draw(&mut maps, [x, y], stature);
    }
    maps
}

/// Adds one person with the neck at cell `neck`, `stature` cells tall.
fn draw(maps: &mut Maps, neck: [f32; 2], stature: f32) {
    let joints = FIGURE.map(|p| [neck[0] + stature * p[0], neck[1] + stature * p[1]]);
    for cell in 0..maps.width * maps.height {
        let at = [(cell % maps.width) as f32, (cell / maps.width) as f32];
        let values = &mut maps.head2d[cell * HEAD2D_CHANNELS..][..HEAD2D_CHANNELS];
        for (value, joint) in values.iter_mut().zip(&joints) {
            let d2 = (at[0] - joint[0]).powi(2) + (at[1] - joint[1]).powi(2);
            *value = value.max((-0.5 * d2 / (RADIUS * RADIUS)).exp());
        }
        for (limb, &(child, parent)) in LIMB_JOINTS.iter().enumerate() {
            let (a, b) = (joints[child], joints[parent]);
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            let u = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
            let d = [at[0] - a[0], at[1] - a[1]];
            let (along, across) = (d[0] * u[0] + d[1] * u[1], d[0] * u[1] - d[1] * u[0]);
            if (-0.5..length + 0.5).contains(&along) && across.abs() <= RADIUS {
                values[EVIDENCE_JOINTS + 2 * limb..][..2].copy_from_slice(&u);
            }
        }
        // Encodings are read at the joints only; any value costs the same.
        maps.head3d[cell * HEAD3D_CHANNELS..][..HEAD3D_CHANNELS].fill(0.1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::{AssociationConfig, Associator};

    #[test]
    fn everyone_in_a_crowd_is_found_whole() {
        for people in [0, 1, 5, 10, 20] {
            let mut associator = Associator::new(AssociationConfig::default());
            let found = associator.associate(&maps(people, 64, 40));
            assert_eq!(found.len(), people);
            for d in found {
                assert!(d.joints.iter().all(|j| j[2] > 0.5), "{:?}", d.joints);
            }
        }
    }
}
