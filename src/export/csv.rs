//! CSV, tidy: one row for each joint of each person in each frame, at the frames' own times. Metres in camera axes (x
//! right, y down, z forward) and, where the frame knew a floor, in the floor's; pixels of the picture.

use std::io::{self, Write};

use super::take::Take;
use crate::joints::JOINT_NAMES;

const HEAD: &str = "frame,time_s,person,state,person_confidence,height_m,joint,joint_state,confidence,\
                    x_m,y_m,z_m,u_px,v_px,floor_x_m,floor_y_m,floor_z_m\n";

/// Writes the file's text row by row: all of it may be twice as large as the take.
///
/// # Errors
/// Those of `out`.
pub fn write(take: &Take, out: &mut impl Write) -> io::Result<()> {
    let mut rows: Vec<(usize, u32)> = take
        .people
        .iter()
        .flat_map(|(&id, samples)| (0..samples.len()).map(move |n| (n, id)))
        .collect();
    let sample = |&(n, id): &(usize, u32)| &take.people[&id][n];
    rows.sort_by_key(|row| (sample(row).frame, row.1));
    out.write_all(HEAD.as_bytes())?;
    for row in &rows {
        let (frame, body) = (&take.frames[sample(row).frame], &sample(row).body);
        let start = format!(
            "{},{:.6},{},{},{:.3},{:.3}",
            frame.sequence,
            frame.time,
            body.id,
            body.state.name().unwrap_or_default(),
            body.score,
            body.height
        );
        for (j, name) in JOINT_NAMES.into_iter().enumerate() {
            let ([x, y, z], [u, v]) = (body.joints3d[j], body.joints2d[j]);
            let state = body.joint_states[j].name().unwrap_or_default();
            let sure = body.confidence[j];
            write!(
                out,
                "{start},{name},{state},{sure:.3},{x:.5},{y:.5},{z:.5},{u:.2},{v:.2},"
            )?;
            match frame.world.is_known() {
                true => {
                    let [x, y, z] = frame.world.point(body.joints3d[j]);
                    writeln!(out, "{x:.5},{y:.5},{z:.5}")?;
                }
                false => writeln!(out, ",,")?,
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_page_names_every_column() {
        let page = include_str!("../../docs/export.md");
        let (_, columns) = page.split_once("\n## Columns of `.csv`\n").unwrap();
        let columns = columns.split("\n## ").next().unwrap();
        for name in super::HEAD.trim().split(',') {
            assert!(columns.contains(&format!("`{name}`")), "{name}");
        }
    }
}
