//! Curves of a record over time, as SVG: heights above the floor and joint angles, a line for each person.

use std::fmt::Write;

use super::motion::{Axes, is_there_between};
use super::take::{Sample, Take};
use crate::joints::{JOINT_NAMES, PELVIS};

const WIDTH: f64 = 960.0;
const PANEL: f64 = 130.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 44.0;
/// Between two panels.
const GAP: f64 = 34.0;
/// Width of a column of the picture, in its units, in which a line has four points at most: as wide as a pixel where
/// the picture is shown at twice its size.
const COLUMN: f64 = 0.5;

/// A panel: its title, and what it shows of a body.
struct Panel {
    title: String,
    value: Box<dyn Fn(&Sample) -> f64>,
}

/// The file's text.
pub fn encode(take: &Take) -> String {
    let axes = Axes::of(take);
    let mut panels = Vec::new();
    for name in ["pelvis", "head_top", "r_wrist", "l_wrist"] {
        let joint = JOINT_NAMES.iter().position(|n| *n == name);
        let joint = joint.unwrap_or(PELVIS);
        panels.push(Panel {
            title: format!("{name}, metres above the floor"),
            value: Box::new(move |s| axes.point(s.body.joints3d[joint]).y),
        });
    }
    for (number, name) in [
        (6, "spine flexion"),
        (11, "right shoulder flexion"),
        (15, "left shoulder flexion"),
        (14, "right elbow flexion"),
        (18, "left elbow flexion"),
        (19, "right hip flexion"),
        (24, "left hip flexion"),
        (22, "right knee flexion"),
        (27, "left knee flexion"),
    ] {
        panels.push(Panel {
            title: format!("{name}, degrees"),
            value: Box::new(move |s| f64::from(s.body.angles[number]).to_degrees()),
        });
    }
    let height = TOP + panels.len() as f64 * (PANEL + GAP);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n{}\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/>\n",
        title(&take.name)
    );
    legend(take, &mut out);
    for (n, panel) in panels.iter().enumerate() {
        draw(take, panel, TOP + n as f64 * (PANEL + GAP), &mut out);
    }
    out += "</svg>\n";
    out
}

/// A line that says what a drawing is of, and is in a drawing of nothing else.
pub fn title(record: &str) -> String {
    let mut line = "<title>".to_owned();
    for c in record.chars() {
        match c {
            '&' => line += "&amp;",
            '<' => line += "&lt;",
            '>' => line += "&gt;",
            // XML has no way to write most of them.
            c if c.is_control() => line.push(char::REPLACEMENT_CHARACTER),
            c => line.push(c),
        }
    }
    line + "</title>"
}

fn legend(take: &Take, out: &mut String) {
    let step = ((WIDTH - LEFT - RIGHT) / take.people.len() as f64).min(60.0);
    for (n, id) in take.people.keys().enumerate() {
        let x = LEFT + n as f64 * step;
        let _ = writeln!(
            out,
            "<text x=\"{x:.1}\" y=\"20\" fill=\"{}\" font-weight=\"bold\">#{id}</text>",
            colour(*id)
        );
    }
}

fn draw(take: &Take, panel: &Panel, top: f64, out: &mut String) {
    let values = take.people.values().flatten().map(&panel.value);
    let finite = values.filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
        (a.min(v), b.max(v))
    });
    if low > high {
        return;
    }
    let step = round_step((high - low).max(1e-3) / 3.0);
    let (low, high) = ((low / step).floor() * step, (high / step).ceil() * step);
    let high = if high > low { high } else { low + step };
    let end = take.frames.last().map_or(1.0, |f| f.time).max(1e-3);
    let x = |time: f64| LEFT + time / end * (WIDTH - LEFT - RIGHT);
    let y = |value: f64| top + PANEL - (value - low) / (high - low) * PANEL;
    let _ = writeln!(
        out,
        "<text x=\"{LEFT}\" y=\"{:.1}\" fill=\"#333\">{}</text>",
        top - 6.0,
        panel.title
    );
    let lines = ((high - low) / step).round() as usize;
    for line in 0..=lines {
        let value = low + line as f64 * step;
        let _ = writeln!(
            out,
            "<path d=\"M{LEFT} {0:.1}H{1}\" stroke=\"#ddd\"/><text x=\"{2}\" y=\"{3:.1}\" text-anchor=\"end\" \
             fill=\"#666\">{4}</text>",
            y(value),
            WIDTH - RIGHT,
            LEFT - 6.0,
            y(value) + 4.0,
            number(value)
        );
    }
    let tick = round_step(end / 8.0);
    for n in 0..=(end / tick) as usize {
        let time = n as f64 * tick;
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#666\">{} s</text>",
            x(time),
            top + PANEL + 14.0,
            number(time)
        );
    }
    let time = |sample: &Sample| take.frames[sample.frame].time;
    // Of a shorter pause nothing is seen.
    let finest = COLUMN * end / (WIDTH - LEFT - RIGHT);
    let rate = take.rate();
    for (id, samples) in &take.people {
        let points = samples.iter().map(|s| (s, (panel.value)(s)));
        let points: Vec<(&Sample, f64)> = points.filter(|(_, value)| value.is_finite()).collect();
        // All samples tell where somebody is away, whichever are drawn.
        let runs = points.chunk_by(|(before, _), (after, _)| {
            let gap = time(after) - time(before);
            gap <= finest || is_there_between(before, after, gap, rate)
        });
        let mut path = String::new();
        for run in runs {
            // Columns begin with the line: who is in view for less than one has four points, wherever they are.
            let from = x(time(run[0].0));
            let column = |sample: &Sample| ((x(time(sample)) - from) / COLUMN) as u64;
            let columns = run.chunk_by(|(before, _), (after, _)| column(before) == column(after));
            let mut letter = 'M';
            for (sample, value) in columns.flat_map(outline) {
                let _ = write!(path, "{letter}{:.1} {:.1}", x(time(sample)), y(*value));
                letter = 'L';
            }
            // With round ends a dot.
            if run.len() == 1 {
                path += "h0";
            }
        }
        let _ = writeln!(
            out,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.5\" stroke-linejoin=\"round\" \
             stroke-linecap=\"round\"/>",
            colour(*id)
        );
    }
}

/// What is seen of a column's points, of which there is one at least: the first, the lowest, the highest and the last,
/// in their order, each once.
fn outline<T>(column: &[(T, f64)]) -> impl Iterator<Item = &(T, f64)> {
    let by_value = |a: &usize, b: &usize| column[*a].1.total_cmp(&column[*b].1);
    let lowest = (0..column.len()).min_by(by_value).unwrap_or_default();
    let highest = (0..column.len()).max_by(by_value).unwrap_or_default();
    let mut kept = vec![0, lowest, highest, column.len() - 1];
    kept.sort_unstable();
    kept.dedup();
    kept.into_iter().map(|place| &column[place])
}

/// The next of 1, 2, 5, 10, … times a power of ten.
fn round_step(least: f64) -> f64 {
    let power = 10f64.powf(least.log10().floor());
    let of = [1.0, 2.0, 5.0].into_iter().map(|f| f * power);
    of.into_iter().find(|s| *s >= least).unwrap_or(10.0 * power)
}

/// Without digits that say nothing; to the finest step of an axis, which is a part of a thousandth.
fn number(value: f64) -> String {
    let text = format!("{value:.4}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0" } else { short }.to_owned()
}

/// As different as can be for neighbours; the page shows the same hues.
fn colour(id: u32) -> String {
    let hue = (f64::from(id) * 0.618_034).fract() * 360.0;
    format!("hsl({hue:.0},70%,42%)")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::take::Frame;
    use crate::message::{Body, World};

    #[test]
    fn of_a_column_the_ends_and_the_extremes_are_seen() {
        let seen = |values: &[f64]| -> Vec<usize> {
            let column: Vec<(usize, f64)> = values.iter().copied().enumerate().collect();
            outline(&column).map(|(place, _)| *place).collect()
        };
        assert_eq!(seen(&[3.0]), [0]);
        assert_eq!(seen(&[3.0, 3.0, 3.0]), [0, 2]);
        assert_eq!(seen(&[3.0, 4.0, 9.0, 4.0, 1.0, 2.0, 5.0]), [0, 2, 4, 6]);
        assert_eq!(seen(&[9.0, 4.0, 4.0, 1.0]), [0, 3]);
    }

    #[test]
    fn steps_and_numbers_are_round() {
        for (least, step) in [
            (0.3, 0.5),
            (1.0, 1.0),
            (1.1, 2.0),
            (60.0, 100.0),
            (0.04, 0.05),
        ] {
            assert!((round_step(least) - step).abs() < 1e-9, "{least}");
        }
        assert_eq!(
            [number(1.5), number(-0.0), number(20.0)],
            ["1.5", "0", "20"]
        );
    }

    /// Of one photo, and of somebody who does not move, axes are as short as they can be.
    #[test]
    fn numbers_of_the_shortest_axes_differ() {
        let frames = [Frame {
            sequence: 0,
            time: 0.0,
            world: World::default(),
            lowest_foot: Some(0.8),
        }];
        let sample = Sample {
            frame: 0,
            body: Body::default(),
        };
        let take = Take {
            frames: frames.to_vec(),
            people: [(1, vec![sample])].into(),
            ..Take::default()
        };
        let panel = Panel {
            title: "a panel".into(),
            value: Box::new(|_| 0.95654),
        };
        let mut out = String::new();
        draw(&take, &panel, 0.0, &mut out);
        // The title comes first; what follows the last text is none.
        let mut numbers: Vec<&str> = out.split("</text>").skip(1).collect();
        numbers.pop();
        let of_text = |text: &mut &str| *text = text.rsplit('>').next().unwrap_or_default();
        numbers.iter_mut().for_each(of_text);
        let count = numbers.len();
        numbers.sort_unstable();
        numbers.dedup();
        assert!(count > 6 && numbers.len() == count, "{count}: {numbers:?}");
    }
}
