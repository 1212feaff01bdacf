//! Skeletons over pictures: a frame and the people in it go in, the frame with bones, joints and labels comes out. For
//! terminals they are drawn in characters, without the picture.
//!
//! Every identity keeps its colour. A joint that was seen is a filled dot, one that was worked out (occluded,
//! predicted) is a ring; bones that end in a ring are drawn fainter.

mod canvas;
mod characters;
mod dots;
mod font;
mod palette;
mod png;
mod skeleton;

pub use characters::{Screen, characters};
pub use dots::Glyphs;
pub use palette::{Colour, colour_of};
pub use png::{OverlayError, write_png};
pub use skeleton::{Joint, Person, Skeleton};

use crate::capture::Frame;
use canvas::Canvas;
use palette::{INK, PAPER};

/// Draws everyone into the picture. Coordinates outside it, and such as are no numbers, are left out.
///
/// # Panics
/// When `frame` has not `3 * width * height` bytes.
pub fn draw<P: Person>(frame: &mut Frame, people: &[P]) {
    let mut canvas = Canvas::new(frame);
    let thickness = canvas.thickness();
    for (position, person) in people.iter().enumerate() {
        draw_one(&mut canvas, &person.skeleton(position), thickness);
    }
}

/// Bones, then joints over them, then the label over everything.
fn draw_one(canvas: &mut Canvas<'_>, skeleton: &Skeleton, thickness: f32) {
    let colour = colour_of(skeleton.identity);
    let ends = |&(a, b): &(usize, usize)| Some((skeleton.joints[a]?, skeleton.joints[b]?));
    let radius = 0.9 * thickness + 0.5;
    // Never so small that the rim closes it.
    let ring_radius = (radius + 0.5).max(3.0);
    let ring_width = (0.5 * thickness).max(1.5);
    // Bones stop at rings, so that these stay hollow.
    let bones: Vec<(Joint, Joint)> = skeleton
        .bones
        .iter()
        .filter_map(ends)
        .map(|(a, b)| (shorten(a, b, ring_radius), shorten(b, a, ring_radius)))
        .collect();
    // A dark rim first keeps every colour apart from every background.
    for (a, b) in &bones {
        canvas.line(a.at, b.at, 0.5 * thickness + 1.0, INK, 0.5 * opacity(a, b));
    }
    for (a, b) in &bones {
        canvas.line(a.at, b.at, 0.5 * thickness, colour, opacity(a, b));
    }
    for joint in skeleton.joints.iter().flatten() {
        if joint.seen {
            canvas.dot(joint.at, radius + 1.0, INK, 0.6);
            canvas.dot(joint.at, radius, colour, 1.0);
        } else {
            canvas.ring(joint.at, ring_radius, ring_width + 1.5, INK, 0.6);
            canvas.ring(joint.at, ring_radius, ring_width, colour, 1.0);
        }
    }
    if let Some(at) = skeleton.label_at() {
        canvas.label(&skeleton.label, at, thickness, PAPER, colour);
    }
}

/// The end of a bone at `from`, drawn back to the ring when the joint was not seen.
fn shorten(from: Joint, to: Joint, radius: f32) -> Joint {
    let along = [to.at[0] - from.at[0], to.at[1] - from.at[1]];
    let length = along[0].hypot(along[1]);
    if from.seen || length <= 2.0 * radius {
        return from;
    }
    let at = [0, 1].map(|k| from.at[k] + along[k] * radius / length);
    Joint { at, ..from }
}

/// How strongly a bone is drawn.
fn opacity(a: &Joint, b: &Joint) -> f32 {
    if a.seen && b.seen { 1.0 } else { 0.55 }
}
