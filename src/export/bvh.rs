//! BVH: a T-pose with constant bone lengths, then a line of rotations a step. Centimetres and degrees, as its readers
//! expect.

use std::fmt::Write;

use glam::{DVec3, EulerRot};

use super::motion::Motion;
use crate::message::{HUMANOID_BONE_COUNT, HUMANOID_BONES};

const CM: f64 = 100.0;
/// Decimals: a thousandth of a millimetre, a millionth of a degree.
const PLACES: usize = 6;

/// The file's text; the first pose is held for `held` steps before the motion.
pub fn encode(motion: &Motion, held: usize) -> String {
    let mut out = "HIERARCHY\n".to_owned();
    let mut order = Vec::new();
    joint(motion, 0, 0, &mut order, &mut out);
    let _ = writeln!(
        out,
        "MOTION\nFrames: {}\nFrame Time: {:.9}",
        held + motion.moments.len(),
        1.0 / motion.rate
    );
    let mut before = [DVec3::ZERO; HUMANOID_BONE_COUNT];
    let first = motion.moments.iter().take(1).cycle().take(held);
    for moment in first.chain(&motion.moments) {
        let p = moment.position * CM;
        let _ = write!(out, "{:.PLACES$} {:.PLACES$} {:.PLACES$}", p.x, p.y, p.z);
        for &bone in &order {
            let angles: DVec3 = moment.rotations[bone].to_euler(EulerRot::ZXY).into();
            // Programs blend these numbers: no jump of a whole turn between two steps.
            let turns = ((angles - before[bone]) / std::f64::consts::TAU).round();
            before[bone] = angles - turns * std::f64::consts::TAU;
            let [z, x, y] = before[bone].to_array().map(f64::to_degrees);
            let _ = write!(out, " {z:.PLACES$} {x:.PLACES$} {y:.PLACES$}");
        }
        out.push('\n');
    }
    out
}

/// Writes a joint and all that it carries; `order` is that of the numbers.
fn joint(motion: &Motion, bone: usize, depth: usize, order: &mut Vec<usize>, out: &mut String) {
    order.push(bone);
    let indent = "\t".repeat(depth);
    let (kind, channels) = match depth {
        0 => ("ROOT", "6 Xposition Yposition Zposition"),
        _ => ("JOINT", "3"),
    };
    let _ = writeln!(out, "{indent}{kind} {}\n{indent}{{", HUMANOID_BONES[bone]);
    offset(motion.rest.offsets[bone], depth + 1, out);
    let _ = writeln!(
        out,
        "{indent}\tCHANNELS {channels} Zrotation Xrotation Yrotation"
    );
    let parents = motion.rest.parents;
    let carried = (0..HUMANOID_BONE_COUNT).filter(|&b| parents[b] == Some(bone));
    let mut ends_here = true;
    for child in carried {
        ends_here = false;
        joint(motion, child, depth + 1, order, out);
    }
    if ends_here {
        let _ = writeln!(out, "{indent}\tEnd Site\n{indent}\t{{");
        offset(motion.rest.ends[bone], depth + 2, out);
        let _ = writeln!(out, "{indent}\t}}");
    }
    let _ = writeln!(out, "{indent}}}");
}

fn offset(v: DVec3, depth: usize, out: &mut String) {
    let (v, indent) = (v * CM, "\t".repeat(depth));
    let _ = writeln!(
        out,
        "{indent}OFFSET {:.PLACES$} {:.PLACES$} {:.PLACES$}",
        v.x, v.y, v.z
    );
}
