//! Which network at which size, as the user says it.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::zoom::INPUTS;
use crate::commands::pipeline::{Pipeline, PipelineOptions};

/// Options of the network, shared by the verbs that run it.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EngineArgs {
    /// Model file, or PyTorch weights of SelecSLS (safetensors), which run in f32; the shipped model when not given
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Weights of Stage II (safetensors) in place of the model's own
    #[arg(long, value_name = "FILE")]
    pub stage2: Option<PathBuf>,
    /// Network input, multiples of 16, or 'auto': 512x320 or as much smaller as suits those in view, which sees people
    /// close to the camera better in less time, turned for upright pictures [default: auto for films and cameras; for
    /// photos 512x320, for upright ones 256x384]
    #[arg(long, value_name = "WxH")]
    pub size: Option<InputSize>,
    /// Threads for the network [default: all cores; for films and cameras fewer where that is measured to be faster]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub threads: Option<u16>,
    /// Look at the mirror image of every picture, too, and take the mean: more accurate, twice the time
    #[arg(long)]
    pub flip_test: bool,
}

/// Upright photos show people who fill them, and these are seen better by less than 320x512 (docs/accuracy.md).
const UPRIGHT_PHOTO: (usize, usize) = (256, 384);

/// The network's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum InputSize {
    /// Pixels across and down.
    Fixed(usize, usize),
    /// As those in view want it.
    Auto,
}

impl FromStr for InputSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            size => parse_size(size)
                .map(|(w, h)| Self::Fixed(w, h))
                .map_err(|e| format!("{e}, or 'auto'")),
        }
    }
}

impl TryFrom<String> for InputSize {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<InputSize> for String {
    fn from(size: InputSize) -> Self {
        size.to_string()
    }
}

impl fmt::Display for InputSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fixed(w, h) => write!(f, "{w}x{h}"),
            Self::Auto => f.write_str("auto"),
        }
    }
}

/// WIDTHxHEIGHT in multiples of 16.
pub fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let wrong = || {
        format!("'{text}': expected WIDTHxHEIGHT, multiples of 16 from 64 to 4096, such as 512x320")
    };
    let (w, h) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
    let size = (
        w.parse().map_err(|_| wrong())?,
        h.parse().map_err(|_| wrong())?,
    );
    let ok = |n: usize| (64..=4096).contains(&n) && n.is_multiple_of(16);
    if ok(size.0) && ok(size.1) {
        Ok(size)
    } else {
        Err(wrong())
    }
}

impl EngineArgs {
    /// Whether every picture gets the same input.
    pub fn is_fixed(&self) -> bool {
        matches!(self.size, Some(InputSize::Fixed(..)))
    }

    /// The inputs for pictures of this orientation: several, from the largest on, where it `follows` the people in
    /// view.
    pub fn sizes(&self, upright: bool, follows: bool) -> Vec<(usize, usize)> {
        match self.size {
            Some(InputSize::Fixed(w, h)) => vec![(w, h)],
            Some(InputSize::Auto) | None if follows => INPUTS.map(|s| turned(s, upright)).to_vec(),
            Some(InputSize::Auto) | None if upright => vec![UPRIGHT_PHOTO],
            Some(InputSize::Auto) | None => vec![INPUTS[0]],
        }
    }

    /// Threads that there are for a picture.
    pub fn most_threads(&self) -> usize {
        self.threads.map_or_else(
            || std::thread::available_parallelism().map_or(1, usize::from),
            usize::from,
        )
    }

    /// The stages at this size.
    ///
    /// # Errors
    /// As [`Pipeline::new`].
    pub fn build(&self, (width, height): (usize, usize)) -> anyhow::Result<Pipeline> {
        let threads = self.most_threads();
        Pipeline::new(&PipelineOptions {
            model: self.model.as_deref(),
            stage2: self.stage2.as_deref(),
            width,
            height,
            threads,
            flip_test: self.flip_test,
        })
    }
}

/// A size for landscape pictures, turned for portrait ones if `upright`.
pub fn turned((w, h): (usize, usize), upright: bool) -> (usize, usize) {
    if upright { (h, w) } else { (w, h) }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        engine: EngineArgs,
    }

    #[test]
    fn photos_have_one_input_and_films_several() {
        let of = |args: &[&str], upright, follows| {
            let line = [&["infer"], args].concat();
            Line::parse_from(line).engine.sizes(upright, follows)
        };
        assert_eq!(of(&[], false, false), [(512, 320)]);
        assert_eq!(of(&[], true, false), [(256, 384)]);
        assert_eq!(of(&[], true, true), [(320, 512), (240, 384), (160, 256)]);
        for (upright, follows) in [(false, false), (true, false)] {
            assert_eq!(of(&["--size", "320x512"], upright, follows), [(320, 512)]);
        }
    }
}
