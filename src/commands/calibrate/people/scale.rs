//! What gives the room its size: somebody's height, or the distance between two cameras.

use crate::calibrate::Room;
use crate::commands::calibrate::{CalibrateArgs, STATURES};
use crate::commands::exit::Failure;
use crate::joints::CANONICAL_STATURE;

/// What gives the room its size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// Height of the tallest of those who are seen at least half as long as the longest stay of anybody, visits of one
    /// height together, metres.
    Stature(f64),
    /// Distance between two cameras, by number, metres.
    Distance(usize, usize, f64),
}

impl Scale {
    /// How tall people are taken to be while cameras are looked for, metres: how far joints are off is judged by it.
    pub fn stature(self) -> f64 {
        match self {
            Self::Stature(metres) => metres,
            Self::Distance(..) => f64::from(CANONICAL_STATURE),
        }
    }

    /// The room at this size.
    pub fn of(self, room: Room) -> Room {
        match self {
            Self::Stature(_) => room,
            Self::Distance(a, b, metres) => room.with_distance(a, b, metres),
        }
    }
}

/// The one that is told, or a height of which `notes` gets a word.
///
/// # Errors
/// When `--distance` is not of two of the cameras that are called `names`, or of no distance.
pub fn scale(
    args: &CalibrateArgs,
    names: &[&str],
    notes: &mut Vec<String>,
) -> anyhow::Result<Scale> {
    if let Some(text) = &args.distance {
        let wrong = || {
            Failure::usage(format!(
                "expected two cameras and metres, as in {},{}=3.2, found --distance {text}",
                names[0], names[1]
            ))
        };
        let (pair, metres) = text.rsplit_once('=').ok_or_else(wrong)?;
        let number = |name: &str| names.iter().position(|n| *n == name);
        // A name may hold commas.
        let commas = pair
            .match_indices(',')
            .map(|(at, _)| (&pair[..at], &pair[at + 1..]));
        let known = commas.clone().find_map(|(a, b)| number(a).zip(number(b)));
        let Some((a, b)) = known else {
            let (a, b) = commas.clone().next().ok_or_else(wrong)?;
            let other = if number(a).is_none() { a } else { b };
            return Err(Failure::usage(format!(
                "--distance {text}: no --view is of {other}; expected two of {}",
                names.join(", ")
            ))
            .into());
        };
        let metres: f64 = metres.parse().map_err(|_| wrong())?;
        if a == b || !(0.05..=100.0).contains(&metres) {
            return Err(wrong().into());
        }
        return Ok(Scale::Distance(a, b, metres));
    }
    Ok(Scale::Stature(args.stature.unwrap_or_else(|| {
        notes.push(
            "neither --stature nor --distance: people are taken for 1.70 m; distances are as far off as this is".into(),
        );
        f64::from(CANONICAL_STATURE)
    })))
}

/// Why cameras are not written by a `--distance` by which the tallest person would have this `stature`, metres.
pub fn impossible(stature: f64) -> Failure {
    let (least, most) = (STATURES.start(), STATURES.end());
    Failure::data(format!(
        "expected --distance to make the tallest person {least} to {most} m tall, found {stature:.2} m; measure from lens to lens, in metres"
    ))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[test]
    fn cameras_whose_names_hold_commas_can_be_told_apart() {
        let names = ["hall,left", "hall", "left,door"];
        let find = |distance: &str| {
            let line = [
                "calibrate",
                "--view",
                "a",
                "--out",
                "b",
                "--distance",
                distance,
            ];
            let args = Line::parse_from(line).args;
            scale(&args, &names, &mut Vec::new()).map_err(|e| e.to_string())
        };
        let found = find("hall,left,left,door=3.2").unwrap();
        assert_eq!(found, Scale::Distance(0, 2, 3.2));
        assert_eq!(
            find("hall,left,hall=2").unwrap(),
            Scale::Distance(0, 1, 2.0)
        );
        let said = find("hall,yard=2").unwrap_err();
        assert!(said.contains("no --view is of yard"), "{said}");
        assert!(find("hall=2").is_err());
    }

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        args: CalibrateArgs,
    }
}
