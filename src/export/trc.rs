//! TRC: the joints as markers, metres, y up: what OpenSim and Pose2Sim read. Fields are empty while somebody is away.
//! The line of axes and all rows end with a tab, as OpenSim's own do: it leaves out a last field that is empty.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::Path;

use super::motion::Motion;
use crate::joints::{BODY_JOINTS, JOINT_NAMES};

/// Writes the text of the file `path`, which names itself, step by step.
///
/// # Errors
/// Those of `out`.
pub fn write(motion: &Motion, path: &Path, out: &mut impl Write) -> io::Result<()> {
    let (rate, steps) = (motion.rate, motion.moments.len());
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut text = format!("PathFileType\t4\t(X/Y/Z)\t{name}\n");
    text += "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n";
    let _ = writeln!(
        text,
        "{rate:.3}\t{rate:.3}\t{steps}\t{BODY_JOINTS}\tm\t{rate:.3}\t1\t{steps}"
    );
    let _ = writeln!(text, "Frame#\tTime\t{}\t\t", JOINT_NAMES.join("\t\t\t"));
    text.push('\t');
    for n in 1..=BODY_JOINTS {
        let _ = write!(text, "\tX{n}\tY{n}\tZ{n}");
    }
    text += "\t\n\n";
    out.write_all(text.as_bytes())?;
    for (step, moment) in motion.moments.iter().enumerate() {
        let time = motion.start + step as f64 / rate;
        text.clear();
        let _ = write!(text, "{}\t{time:.6}", step + 1);
        for p in moment.joints {
            // Readers take what is blended over an absence for measured.
            let _ = match moment.is_there {
                true => write!(text, "\t{:.6}\t{:.6}\t{:.6}", p.x, p.y, p.z),
                false => write!(text, "\t\t\t"),
            };
        }
        text += "\t\n";
        out.write_all(text.as_bytes())?;
    }
    Ok(())
}
