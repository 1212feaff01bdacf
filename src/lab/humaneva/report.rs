//! What came out, as JSON and as the table of the book.

use std::fmt::{self, Display, Formatter};

use serde::Serialize;

/// A mean over pieces.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// Its standard error; 0 for fewer than two pieces.
    pub error: f64,
}

impl Spread {
    /// Of so many values; `None` without any.
    pub fn new(values: &[f64]) -> Option<Self> {
        if values.is_empty() {
            return None;
        }
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        Some(Self {
            mean,
            error: (square / (n - 1.0).max(1.0) / n).sqrt(),
        })
    }
}

/// How well a camera was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraLine {
    /// Whose, and which.
    pub name: String,
    /// Root mean square distance in frames that it was not found from, pixels.
    pub rms_px: f64,
}

/// One experiment; lengths in metres, none where there is nothing to measure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    /// Whether 2D is a detector's; else it is exact.
    pub detected: bool,
    /// Number of cameras; figures are means over all choices of so many.
    pub views: usize,
    /// Whether paths were made of few cosines.
    pub paths: bool,
    /// Pieces.
    pub pieces: usize,
    /// Frames that are measured: those that all cameras saw.
    pub frames: usize,
    /// Share of these with a body.
    pub found: f64,
    /// Mean distance of the 15 joints as they are named, in the world.
    pub named: Option<Spread>,
    /// The same of elbows, wrists, knees and ankles.
    pub limbs: Option<Spread>,
    /// Of the 15 after every frame's body is moved, turned and scaled onto the truth.
    pub named_aligned: Option<Spread>,
    /// Of the 15 with offsets learned from the other people, in the world; none where there are no others.
    pub mapped: Option<Spread>,
    /// The same, aligned.
    pub mapped_aligned: Option<Spread>,
}

/// Everything.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HumanEvaTables {
    /// Every person's cameras.
    pub cameras: Vec<CameraLine>,
    /// Pieces with fewer frames were left out.
    pub least: usize,
    /// Whether what one camera sees could be lifted; without it there are no experiments of one camera.
    pub is_lifted: bool,
    /// Experiments.
    pub lines: Vec<Line>,
}

impl Display for HumanEvaTables {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "Cameras, found from exact 2D of half the frames, off in others:\n"
        )?;
        for c in &self.cameras {
            writeln!(f, "{}: {:.3} px", c.name, c.rms_px)?;
        }
        writeln!(
            f,
            "\nJoints, mm, means over pieces of {} frames or more, ± standard error:\n",
            self.least
        )?;
        writeln!(
            f,
            "| 2D | views | DCT | pieces | frames | found | named | limbs | named, aligned | mapped | mapped, aligned |"
        )?;
        writeln!(f, "|---|---|---|---|---|---|---|---|---|---|---|")?;
        let mm = |s: Option<Spread>| {
            s.map_or("–".to_owned(), |s| {
                format!("{:.1} ± {:.1}", 1e3 * s.mean, 1e3 * s.error)
            })
        };
        for l in &self.lines {
            writeln!(
                f,
                "| {} | {} | {} | {} | {} | {:.1} % | {} | {} | {} | {} | {} |",
                if l.detected { "AlphaPose" } else { "exact" },
                l.views,
                if l.paths { "yes" } else { "no" },
                l.pieces,
                l.frames,
                100.0 * l.found,
                mm(l.named),
                mm(l.limbs),
                mm(l.named_aligned),
                mm(l.mapped),
                mm(l.mapped_aligned)
            )?;
        }
        if !self.is_lifted {
            writeln!(
                f,
                "\nOne view is left out: this build has no weights of Stage II, which lift what it sees."
            )?;
        }
        Ok(())
    }
}
