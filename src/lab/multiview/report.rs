//! What came out, as JSON and as the tables of the book.

use std::fmt::{self, Display, Formatter};

use serde::Serialize;

use super::{Errors, PARTS};

/// The experiment whose posed meshes are told by part of the body.
pub const AS_MEASURED: &str = "errors as measured";

/// Means over all seeds of one experiment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    /// What was tried.
    pub what: String,
    /// Number of cameras.
    pub views: usize,
    /// Whether stage one went from joints in space over a coarse to a fine energy.
    pub hierarchy: bool,
    /// Whether paths were made of few cosines.
    pub paths: bool,
    /// Whether outlines counted.
    pub masks: bool,
    /// The errors.
    pub errors: Errors,
}

/// Time on one core.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Times {
    /// Number of cameras.
    pub views: usize,
    /// Of a frame in stage one, who is who included, milliseconds.
    pub stage_one_ms: f64,
    /// What masks add to a frame in stage one, milliseconds; masks are at hand.
    pub masks_ms: f64,
    /// Of a window of 30 frames in stage two, seconds; windows overlap by half.
    pub window_s: f64,
}

/// All experiments.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tables {
    /// People, each with a motion of their own.
    pub seeds: u64,
    /// Frames of each.
    pub frames: u64,
    /// People of `synth`, who are not of the fitted model.
    pub synth: Vec<Line>,
    /// Bodies of the fitted model.
    pub model: Vec<Line>,
    /// The same with limbs of one view exchanged in 30 % of its frames.
    pub exchanged: Vec<Line>,
    /// What it took.
    pub times: Option<Times>,
}

/// In place of a figure that there is none of.
const NONE: &str = "–";

/// Millimetres.
fn mm(metres: f64) -> String {
    match metres.is_finite() {
        true => format!("{:.1}", 1e3 * metres),
        false => NONE.into(),
    }
}

fn yes(x: bool) -> &'static str {
    if x { "yes" } else { "no" }
}

impl Display for Tables {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (seeds, frames) = (self.seeds, self.frames);
        writeln!(f, "People of synth, {seeds} seeds, {frames} frames:\n")?;
        writeln!(
            f,
            "| views | hierarchy | masks | DCT | frames found | joints, mm | aligned, mm | stature, mm | rest pose, mm |"
        )?;
        writeln!(f, "|---|---|---|---|---|---|---|---|---|")?;
        for l in &self.synth {
            let e = l.errors;
            let rest = e.rest.map_or(NONE.into(), |r| r.map(mm).join(" / "));
            writeln!(
                f,
                "| {} | {} | {} | {} | {:.0} % | {} | {} | {} | {rest} |",
                l.views,
                yes(l.hierarchy),
                yes(l.masks),
                yes(l.paths),
                100.0 * e.found,
                mm(e.joints),
                mm(e.aligned),
                mm(e.stature)
            )?;
        }
        writeln!(
            f,
            "\nBodies of the fitted model, {seeds} seeds, {frames} frames:\n"
        )?;
        writeln!(
            f,
            "| errors | views | masks | DCT | joints, mm | shape at rest, mm |"
        )?;
        writeln!(f, "|---|---|---|---|---|---|")?;
        for l in &self.model {
            let shape = l.errors.shape.map_or(NONE.into(), mm);
            let joints = mm(l.errors.joints);
            writeln!(
                f,
                "| {} | {} | {} | {} | {joints} | {shape} |",
                l.what,
                l.views,
                yes(l.masks),
                yes(l.paths)
            )?;
        }
        writeln!(
            f,
            "\nVertices of their posed meshes by part of the body, {AS_MEASURED}, smooth, mm:\n"
        )?;
        writeln!(
            f,
            "| masks | {} |\n|---{}|",
            PARTS.join(" | "),
            "|---".repeat(PARTS.len())
        )?;
        let smooth = self
            .model
            .iter()
            .filter(|l| l.what == AS_MEASURED && l.paths);
        for l in smooth {
            let parts = l
                .errors
                .parts
                .map_or(NONE.into(), |p| p.map(mm).join(" | "));
            writeln!(f, "| {} | {parts} |", yes(l.masks))?;
        }
        writeln!(
            f,
            "\nLimbs of one view of three exchanged in 30 % of its frames:\n"
        )?;
        writeln!(
            f,
            "| exchanged | joints, mm | against nothing |\n|---|---|---|"
        )?;
        let plain = self.exchanged.first().map_or(0.0, |l| l.errors.joints);
        for l in &self.exchanged {
            let more = 100.0 * (l.errors.joints / plain - 1.0);
            let more = match more.is_finite() {
                true => format!("{more:+.1} %"),
                false => NONE.into(),
            };
            writeln!(f, "| {} | {} | {more} |", l.what, mm(l.errors.joints))?;
        }
        if let Some(t) = self.times {
            writeln!(
                f,
                "\nOne core, {} views: stage one {:.1} ms a frame, with masks {:.1} ms, stage two {:.2} s a window.",
                t.views,
                t.stage_one_ms,
                t.stage_one_ms + t.masks_ms,
                t.window_s
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_found_is_a_dash_and_no_distance() {
        let line = |what: &str, errors: Errors| Line {
            what: what.into(),
            views: 3,
            hierarchy: true,
            paths: true,
            masks: false,
            errors,
        };
        let met = Errors {
            found: 1.0,
            joints: 0.02,
            ..Errors::NOBODY
        };
        let tables = |exchanged: [Errors; 2]| Tables {
            seeds: 1,
            frames: 10,
            synth: vec![line("people of synth", Errors::NOBODY)],
            model: vec![line(AS_MEASURED, Errors::NOBODY)],
            exchanged: vec![line("nothing", exchanged[0]), line("legs", exchanged[1])],
            times: None,
        };
        let nobody = tables([Errors::NOBODY; 2]);
        let text = nobody.to_string();
        for row in [
            "| 3 | yes | no | yes | 0 % | – | – | – | – |",
            "| errors as measured | 3 | no | yes | – | – |",
            "| nothing | – | – |",
        ] {
            assert!(text.contains(row), "{row}\n{text}");
        }
        assert!(
            tables([Errors::NOBODY, met])
                .to_string()
                .contains("| legs | 20.0 | – |")
        );
        assert!(
            tables([met, Errors::NOBODY])
                .to_string()
                .contains("| legs | – | – |")
        );
        let json = serde_json::to_value(&nobody).unwrap();
        assert!(json["synth"][0]["errors"]["joints"].is_null(), "{json}");
    }
}
