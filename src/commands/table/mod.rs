//! The live table: skeletons drawn in characters, one row a body, one line of figures, a progress bar where the input
//! has an end.

use std::fmt::Write;
use std::time::{Duration, Instant};

use console::Term;
use edgecap_client::message::{BodyFrame, BodyState, FLAG_FILE_TIME, StageTimes};

use self::drawing::Drawing;
use super::{log, say};
use crate::counted::counted;
use crate::overlay::{Glyphs, Screen, characters};

mod drawing;

const REDRAW: Duration = Duration::from_millis(50);
/// Without a terminal the figures are logged this often.
const LOG_EVERY: Duration = Duration::from_secs(5);
/// A journal is kept for months.
const JOURNAL_EVERY: Duration = Duration::from_secs(600);
/// Weight of the newest frame in the running means.
const SMOOTH: f64 = 0.1;
/// Lines that the figures may take in a narrow terminal.
const FIGURES_ROWS: usize = 3;
/// Fewer lines show nothing of a skeleton.
const LEAST_ROWS: usize = 8;

/// Options of what is shown.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct TableArgs {
    /// Show the table only, no skeletons
    #[arg(long)]
    plain: bool,
}

/// Shows bodies as they come in.
#[derive(Debug)]
pub struct Table {
    terminal: Option<(Term, Drawing)>,
    plain: bool,
    /// The camera, where the lines of several come together.
    name: Option<String>,
    drawn: Option<Instant>,
    last_frame: Option<Instant>,
    seconds_per_frame: f64,
    /// What stages took for the last picture that the network looked at.
    looked: StageTimes,
}

impl Table {
    /// A table on the terminal's stderr, or a line now and then where there is none.
    pub fn new(args: TableArgs) -> Self {
        Self::with(Some(Term::stderr()).filter(Term::is_term), args.plain, None)
    }

    /// Lines of one of several cameras.
    pub fn of_several(name: &str) -> Self {
        Self::with(None, true, Some(name.to_owned()))
    }

    fn with(terminal: Option<Term>, plain: bool, name: Option<String>) -> Self {
        let drawn_on = |terminal: Term| Some((terminal.clone(), Drawing::on(terminal)?));
        Self {
            terminal: terminal.and_then(drawn_on),
            plain,
            name,
            drawn: None,
            last_frame: None,
            seconds_per_frame: 0.0,
            looked: StageTimes::default(),
        }
    }

    /// Takes in one message.
    pub fn update(&mut self, frame: &BodyFrame, left_out: u64) {
        let now = Instant::now();
        if let Some(last) = self.last_frame {
            let dt = (now - last).as_secs_f64();
            self.seconds_per_frame += if self.seconds_per_frame == 0.0 {
                dt
            } else {
                SMOOTH * (dt - self.seconds_per_frame)
            };
        }
        self.last_frame = Some(now);
        if frame.stage_times.stage1_us > 0 {
            self.looked = frame.stage_times;
        }
        let every = match &self.terminal {
            Some(_) => REDRAW,
            None if log::to_journal() => JOURNAL_EVERY,
            None => LOG_EVERY,
        };
        if self.drawn.is_some_and(|t| t.elapsed() < every) {
            return;
        }
        self.drawn = Some(now);
        let figures = self.figures(frame, left_out);
        match &self.terminal {
            Some((terminal, drawing)) => {
                let mut message = figures;
                if !self.plain {
                    for line in characters(
                        frame.bodies(),
                        [frame.width, frame.height],
                        room(terminal, frame.bodies().len()),
                    ) {
                        message.push('\n');
                        message.push_str(&line);
                    }
                }
                let total = Some(u64::from(frame.frame_total)).filter(|n| *n > 0);
                let message = format!("{message}\n{}", rows(frame));
                drawing.table(frame.sequence + 1, total, message);
            }
            None => {
                let name = self
                    .name
                    .as_ref()
                    .map_or(String::new(), |n| format!("{n}: "));
                say::err(&format!(
                    "{name}frame {}: {}, {figures}",
                    frame.sequence,
                    counted(frame.count, "person", "people")
                ));
            }
        }
    }

    /// Whether somebody sees it.
    pub fn is_on_terminal(&self) -> bool {
        self.terminal.is_some()
    }

    /// Prints a line above the table.
    pub fn say(&self, line: &str) {
        match &self.terminal {
            Some((_, drawing)) => drawing.line(line),
            None => say::err(line),
        }
    }

    /// Takes the table off the screen.
    pub fn finish(&self) {
        if let Some((_, drawing)) = &self.terminal {
            drawing.clear();
        }
    }

    fn figures(&self, frame: &BodyFrame, left_out: u64) -> String {
        let ms = |us: u32| f64::from(us) / 1000.0;
        let t = self.looked;
        let mut s = String::new();
        let fps = if self.seconds_per_frame > 0.0 {
            1.0 / self.seconds_per_frame
        } else {
            0.0
        };
        let _ = write!(
            s,
            "{fps:.1} fps | ms: letterbox {:.1}, stage I {:.1}, association {:.2}, stage II {:.2}, fit {:.2}",
            ms(t.preprocess_us),
            ms(t.stage1_us),
            ms(t.association_us),
            ms(t.stage2_us),
            ms(frame.fit_us)
        );
        if frame.flags & FLAG_FILE_TIME == 0 {
            let _ = write!(
                s,
                ", capture to publish {:.1}",
                frame.publish_ns.saturating_sub(frame.capture_ns) as f64 / 1e6
            );
        }
        if left_out > 0 {
            let frames = counted(left_out, "frame", "frames");
            let _ = write!(s, " | {frames} left out");
        }
        s
    }
}

/// What the table of `people` leaves of the terminal.
fn room(terminal: &Term, people: usize) -> Screen {
    let (rows, columns) = terminal.size();
    let table = FIGURES_ROWS + 1 + people.max(1);
    let rows = usize::from(rows).saturating_sub(table);
    // The Linux console's own fonts have no Braille.
    let glyphs = if std::env::var_os("TERM").is_some_and(|t| t == "linux") {
        Glyphs::Blocks
    } else {
        Glyphs::Braille
    };
    Screen {
        columns: usize::from(columns),
        rows: if rows < LEAST_ROWS { 0 } else { rows },
        glyphs,
        coloured: console::colors_enabled_stderr(),
    }
}

fn rows(frame: &BodyFrame) -> String {
    let mut s = String::from("  id  state          x      y      z  m   height  confidence");
    for b in frame.bodies() {
        let state = if b.state == BodyState::TRACKED {
            "tracked"
        } else {
            "predicted"
        };
        let [x, y, z] = b.position;
        let _ = write!(
            s,
            "\n{:4}  {state:9} {x:7.2}{y:7.2}{z:7.2}     {:.2} m     {:3.0} %",
            b.id,
            b.height,
            100.0 * b.score
        );
    }
    if frame.bodies().is_empty() {
        s.push_str("\n      nobody in sight");
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Most of them nobody wanted: while nobody is in view, or beyond --max-fps.
    #[test]
    fn frames_between_those_that_came_are_not_called_lost() {
        let table = Table::with(None, true, None);
        let figures = table.figures(&BodyFrame::default(), 270);
        assert!(figures.ends_with(" | 270 frames left out"), "{figures}");
        let figures = table.figures(&BodyFrame::default(), 0);
        assert!(!figures.contains("left out"), "{figures}");
    }

    #[test]
    fn what_a_look_takes_is_shown_beside_pictures_that_are_not_looked_at() {
        let mut table = Table::with(None, true, None);
        let mut frame = BodyFrame::default();
        for (preprocess_us, stage1_us) in [(600, 18_000), (9_000, 0)] {
            frame.stage_times = StageTimes {
                preprocess_us,
                stage1_us,
                ..StageTimes::default()
            };
            table.update(&frame, 0);
            let figures = table.figures(&frame, 0);
            assert!(figures.contains("letterbox 0.6, stage I 18.0"), "{figures}");
        }
    }
}
