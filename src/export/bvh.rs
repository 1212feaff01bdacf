//! BVH: a T-pose with constant bone lengths, then a line of rotations a step. Centimetres and degrees, as its readers
//! expect.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::io::{self, Write};

use glam::{DQuat, DVec3, EulerRot};

use super::motion::Motion;
use crate::body::skeleton::{RIG_BONES, RIG_NAMES};

const CM: f64 = 100.0;
/// Decimals: a thousandth of a millimetre, a millionth of a degree.
const PLACES: usize = 6;

/// Writes the file's text step by step: the first pose is held for `held` of them before the motion.
///
/// # Errors
/// Those of `out`.
pub fn write(motion: &Motion, held: usize, out: &mut impl Write) -> io::Result<()> {
    let mut text = "HIERARCHY\n".to_owned();
    let mut order = Vec::new();
    joint(motion, 0, 0, &mut order, &mut text);
    let _ = writeln!(
        text,
        "MOTION\nFrames: {}\nFrame Time: {:.9}",
        held + motion.moments.len(),
        1.0 / motion.rate
    );
    out.write_all(text.as_bytes())?;
    let mut before = [DVec3::ZERO; RIG_BONES];
    let first = motion.moments.iter().take(1).cycle().take(held);
    for moment in first.chain(&motion.moments) {
        let p = moment.position * CM;
        text.clear();
        let _ = write!(text, "{:.PLACES$} {:.PLACES$} {:.PLACES$}", p.x, p.y, p.z);
        for &bone in &order {
            before[bone] = angles(moment.rotations[bone], before[bone]);
            let [z, x, y] = before[bone].to_array().map(f64::to_degrees);
            let _ = write!(text, " {z:.PLACES$} {x:.PLACES$} {y:.PLACES$}");
        }
        text.push('\n');
        out.write_all(text.as_bytes())?;
    }
    Ok(())
}

/// A rotation's angles about z, x and y, radians: of all that mean it those nearest to the ones `before`, as programs
/// blend these numbers.
fn angles(rotation: DQuat, before: DVec3) -> DVec3 {
    let upright = DVec3::from(rotation.to_euler(EulerRot::ZXY));
    // glam keeps x within a quarter of a turn: where a knee bends further, z and y would jump by half a turn.
    let beyond = DVec3::new(upright.x + PI, PI - upright.y, upright.z + PI);
    let [upright, beyond] = [upright, beyond].map(|a| a - ((a - before) / TAU).round() * TAU);
    match upright.distance_squared(before) <= beyond.distance_squared(before) {
        true => upright,
        false => beyond,
    }
}

/// Writes a joint and all that it carries; `order` is that of the numbers.
fn joint(motion: &Motion, bone: usize, depth: usize, order: &mut Vec<usize>, out: &mut String) {
    order.push(bone);
    let indent = "\t".repeat(depth);
    let (kind, channels) = match depth {
        0 => ("ROOT", "6 Xposition Yposition Zposition"),
        _ => ("JOINT", "3"),
    };
    let _ = writeln!(out, "{indent}{kind} {}\n{indent}{{", RIG_NAMES[bone]);
    offset(motion.rest.offsets[bone], depth + 1, out);
    let _ = writeln!(
        out,
        "{indent}\tCHANNELS {channels} Zrotation Xrotation Yrotation"
    );
    let parents = motion.rest.parents;
    let carried = (0..RIG_BONES).filter(|&b| parents[b] == Some(bone));
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

#[cfg(test)]
mod tests {
    use super::super::motion::Moment;
    use super::*;
    use crate::body::skeleton::{Skeleton, TPose};
    use crate::joints::BODY_JOINTS;

    fn knee(side: &str) -> usize {
        let name = format!("{side}LowerLeg");
        RIG_NAMES.iter().position(|b| *b == name).unwrap()
    }

    fn rotation(degrees: [f64; 3]) -> DQuat {
        let [z, x, y] = degrees.map(f64::to_radians);
        DQuat::from_euler(EulerRot::ZXY, z, x, y)
    }

    /// What stands in the file for somebody with these knees, degrees about z, x and y: left and right at each step.
    fn written(knees: &[[[f64; 3]; 2]]) -> Vec<[[f64; 3]; 2]> {
        let lengths = *Skeleton::builtin().lengths();
        let moments = knees.iter().map(|&[left, right]| {
            let mut rotations = [DQuat::IDENTITY; RIG_BONES];
            rotations[knee("left")] = rotation(left);
            rotations[knee("right")] = rotation(right);
            Moment {
                position: DVec3::ZERO,
                rotations,
                joints: [DVec3::ZERO; BODY_JOINTS],
                is_there: true,
            }
        });
        let motion = Motion {
            id: 1,
            rate: 30.0,
            start: 0.0,
            moments: moments.collect(),
            lengths,
            rest: TPose::new(Skeleton::builtin(), &lengths),
        };
        let mut text = Vec::new();
        write(&motion, 0, &mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        let (hierarchy, rows) = text.split_once("Frame Time:").unwrap();
        let words: Vec<&str> = hierarchy.split_whitespace().collect();
        let joints = words
            .windows(2)
            .filter(|w| ["ROOT", "JOINT"].contains(&w[0]));
        let joints: Vec<&str> = joints.map(|w| w[1]).collect();
        let columns = ["left", "right"].map(|side| {
            let name = RIG_NAMES[knee(side)];
            3 + 3 * joints.iter().position(|joint| *joint == name).unwrap()
        });
        let rows = rows.lines().skip(1).map(|row| {
            let numbers: Vec<f64> = row.split(' ').map(|n| n.parse().unwrap()).collect();
            columns.map(|at| [numbers[at], numbers[at + 1], numbers[at + 2]])
        });
        rows.collect()
    }

    #[test]
    fn a_knee_that_bends_beyond_a_right_angle_makes_no_jump() {
        let sweep = (60..120).chain((60..=120).rev()).map(f64::from);
        // One begins bent far, and is turned a little about the other axes, too.
        let knees = sweep.map(|x| [[0.0, x, 0.0], [3.0, 180.5 - x, -5.0]]);
        let knees: Vec<[[f64; 3]; 2]> = knees.collect();
        let written = written(&knees);
        assert_eq!(written.len(), knees.len());
        for (step, (found, wanted)) in written.iter().zip(&knees).enumerate() {
            for (found, wanted) in found.iter().zip(wanted) {
                let apart = rotation(*found).dot(rotation(*wanted)).abs();
                assert!(
                    apart > 1.0 - 1e-12,
                    "step {step}: {found:?}, not {wanted:?}"
                );
            }
        }
        for pair in written.windows(2) {
            let each = pair[0].as_flattened().iter().zip(pair[1].as_flattened());
            let most = each.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(
                most < 1.0 + 1e-5,
                "{most} degrees from {:?} to {:?}",
                pair[0],
                pair[1]
            );
        }
    }

    #[test]
    fn a_joint_begins_with_the_angles_nearest_to_none() {
        let found = written(&[[[0.0, 120.0, 0.0], [20.0, 70.0, 10.0]]]);
        let wanted = [[0.0, 120.0, 0.0], [20.0, 70.0, 10.0]];
        let each = found[0].as_flattened().iter().zip(wanted.as_flattened());
        for (found, wanted) in each {
            assert!((found - wanted).abs() < 1e-5, "{found}, not {wanted}");
        }
    }
}
