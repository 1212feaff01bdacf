//! Skeletons drawn in characters, for terminals: no picture is needed, and none is shown.

use super::dots::{Dots, Glyphs};
use super::palette::colour_of;
use super::skeleton::{Person, Skeleton};
use edgecap_client::joints::{BODY_JOINTS, HEAD, HEAD_TOP};

/// The circle of the head is drawn about these.
const OF_HEAD: [usize; 2] = [HEAD_TOP, HEAD];

/// Room for skeletons in a terminal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Screen {
    /// Most characters across.
    pub columns: usize,
    /// Most lines.
    pub rows: usize,
    /// What dots are made of.
    pub glyphs: Glyphs,
    /// Whether escape codes may colour them.
    pub coloured: bool,
}

/// Everyone as the camera sees them in pictures of `size` pixels, within a frame, as large as the screen allows; no
/// line where it allows nothing, or where the size is 0. Joints that were worked out rather than seen end dotted bones.
pub fn characters<P: Person>(people: &[P], size: [u32; 2], screen: Screen) -> Vec<String> {
    const RIM: usize = 2;
    let [dx, dy] = screen.glyphs.dots();
    let most = [
        screen.columns.saturating_sub(RIM) * dx,
        screen.rows.saturating_sub(RIM) * dy,
    ];
    if most.contains(&0) || size.contains(&0) {
        return Vec::new();
    }
    let scale = (most[0] as f32 / size[0] as f32).min(most[1] as f32 / size[1] as f32);
    let cells = |i: usize, dots: usize| ((size[i] as f32 * scale / dots as f32) as usize).max(1);
    let (columns, rows) = (cells(0, dx), cells(1, dy));
    let mut dots = Dots::new(screen.glyphs, columns, rows);
    for (position, person) in people.iter().enumerate() {
        draw(&mut dots, &person.skeleton(position), scale);
    }
    let edge = "─".repeat(columns);
    let inner = dots.lines(screen.coloured);
    std::iter::once(format!("┌{edge}┐"))
        .chain(inner.iter().map(|line| format!("│{line}│")))
        .chain(std::iter::once(format!("└{edge}┘")))
        .collect()
}

fn draw(dots: &mut Dots, skeleton: &Skeleton, scale: f32) {
    let colour = colour_of(skeleton.identity);
    // From pixel centres on integers to dot centres on integers.
    let place = |at: [f32; 2]| at.map(|v| (v + 0.5) * scale - 0.5);
    for &(a, b) in &skeleton.bones {
        if let (Some(p), Some(q)) = (skeleton.joints[a], skeleton.joints[b]) {
            dots.line(place(p.at), place(q.at), colour, !(p.seen && q.seen));
        }
    }
    if skeleton.joints.len() == BODY_JOINTS
        && let [Some(top), Some(head)] = OF_HEAD.map(|j| skeleton.joints[j])
    {
        let (top_at, at) = (place(top.at), place(head.at));
        let radius = (top_at[0] - at[0]).hypot(top_at[1] - at[1]);
        dots.ring(at, radius, colour, !(top.seen && head.seen));
    }
    if let Some(at) = skeleton.label_at() {
        let name = skeleton.label.split(' ').next().unwrap_or_default();
        let [x, y] = place(at);
        dots.text([x, y - dots.row_height()], name, colour);
    }
}
