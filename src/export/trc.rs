//! TRC: the joints as markers, metres, y up: what OpenSim and Pose2Sim read.

use std::fmt::Write;
use std::path::Path;

use super::motion::Motion;
use crate::joints::{BODY_JOINTS, JOINT_NAMES};

/// The text of the file `path`, which names itself.
pub fn encode(motion: &Motion, path: &Path) -> String {
    let (rate, steps) = (motion.rate, motion.moments.len());
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut out = format!("PathFileType\t4\t(X/Y/Z)\t{name}\n");
    out += "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n";
    let _ = writeln!(
        out,
        "{rate:.3}\t{rate:.3}\t{steps}\t{BODY_JOINTS}\tm\t{rate:.3}\t1\t{steps}"
    );
    let _ = writeln!(out, "Frame#\tTime\t{}\t\t", JOINT_NAMES.join("\t\t\t"));
    out.push('\t');
    for n in 1..=BODY_JOINTS {
        let _ = write!(out, "\tX{n}\tY{n}\tZ{n}");
    }
    out += "\n\n";
    for (step, moment) in motion.moments.iter().enumerate() {
        let time = motion.start + step as f64 / rate;
        let _ = write!(out, "{}\t{time:.6}", step + 1);
        for p in moment.joints {
            let _ = write!(out, "\t{:.6}\t{:.6}\t{:.6}", p.x, p.y, p.z);
        }
        out.push('\n');
    }
    out
}
