//! Which network at which size, as the user says it.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::commands::exit::Failure;
use crate::commands::input::path_in_words;
use crate::commands::pipeline::{self, Pipeline, PipelineOptions};
use crate::schedule::inputs::{Inputs, Quality};
use crate::schedule::size::InputSize;
use crate::schedule::spacing::ENOUGH;

/// Options of the network, shared by the verbs that run it.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EngineArgs {
    /// Model file, or PyTorch weights of SelecSLS (safetensors), which run in f32; the shipped model when not given
    #[arg(long, value_name = "FILE", value_parser = path_in_words())]
    pub model: Option<PathBuf>,
    /// Weights of Stage II (safetensors) in place of the model's own
    #[arg(long, value_name = "FILE", value_parser = path_in_words())]
    pub stage2: Option<PathBuf>,
    /// Network input, multiples of 16, or 'auto', for films and cameras: what 512x320 is in the pictures' shape, or as
    /// much smaller as suits those in view, which sees people close to the camera better in less time [default: as
    /// --quality says]
    #[arg(long, value_name = "WxH")]
    pub size: Option<InputSize>,
    /// How much time a picture may take. 'fast' looks once, at 384x240, of films and cameras 15 times a second;
    /// 'balanced' once, at 512x320; 'best' twice, at 384x240 and 768x480, and takes everybody from the look that has
    /// them better. For who lies, films and cameras are also looked at on their side, photos with 'best' alone
    /// [default: balanced for films and cameras, best for photos]
    #[arg(long, value_name = "fast|balanced|best", hide_possible_values = true)]
    pub quality: Option<Quality>,
    /// Look at so many pictures per second, at more where somebody is lost, and at fewer of a camera where as many
    /// leave no time for the others, in which joints are followed by the optical flow [default: 15 with --quality fast,
    /// else every picture, or of a camera that is too fast for this machine half of them, 15 at least as far as there
    /// is time]
    #[arg(long, value_name = "PER SECOND", value_parser = parse_looks)]
    pub looks: Option<f64>,
    /// Threads for the network [default: all cores, divided among the cameras; for films and cameras fewer where that
    /// is measured to be faster]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub threads: Option<u16>,
    /// Look at the mirror image of every picture, too, and take the mean: more accurate, twice the time
    #[arg(long)]
    pub flip_test: bool,
    /// Cameras that share the cores; nothing that a user says.
    #[arg(skip)]
    #[serde(skip)]
    pub cameras: Option<usize>,
}

fn parse_looks(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(looks) if (1.0..=1000.0).contains(&looks) => Ok(looks),
        _ => Err(format!(
            "'{text}': expected looks per second, from 1 to 1000, such as 15"
        )),
    }
}

impl EngineArgs {
    /// The inputs of the pictures of a `film` (or camera), or of photos.
    ///
    /// # Errors
    /// When they are asked for in two ways, or in one that photos cannot take.
    pub fn inputs(&self, film: bool) -> Result<Inputs, Failure> {
        if self.size.is_some() && self.quality.is_some() {
            return Err(Failure::usage(
                "--quality chooses the network's input: expected it or --size, found both: leave one out",
            ));
        }
        if self.size == Some(InputSize::Auto) && !film {
            return Err(Failure::usage(
                "--size auto follows people from picture to picture: expected a film, a camera or a folder of its frames with --fps, found photos: give --size WxH",
            ));
        }
        let needs = |what: &str| {
            Failure::usage(format!(
                "--looks follows joints from a picture to the next: expected {what}: leave it out"
            ))
        };
        match Inputs::new(self.size, self.quality, film) {
            _ if self.looks.is_some() && !film => Err(needs(
                "a film, a camera or a folder of its frames with --fps, found photos",
            )),
            Inputs::Looks(_) if self.looks.is_some() => Err(needs(
                "one look at a picture, found --quality best, which looks twice",
            )),
            inputs => Ok(inputs),
        }
    }

    /// Nanoseconds from one look at a film to the next, where that is said.
    pub fn looks_apart(&self) -> Option<u64> {
        let usual = (self.quality == Some(Quality::Fast)).then_some(f64::from(ENOUGH));
        self.looks.or(usual).map(|looks| (1e9 / looks) as u64)
    }

    /// Threads that there are for a picture: so many as are set, else this camera's part of the cores.
    pub fn most_threads(&self) -> usize {
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        self.threads.map_or_else(
            || cores().div_ceil(self.cameras.unwrap_or(1).max(1)),
            usize::from,
        )
    }

    /// Reads the model that is named as a run would.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn expect_model(&self) -> anyhow::Result<()> {
        pipeline::expect_model(self.model.as_deref(), self.stage2.as_deref())
    }

    /// The stages at this size, which the user has asked for.
    ///
    /// # Errors
    /// As [`Pipeline::new`].
    pub fn build(&self, size: (usize, usize)) -> anyhow::Result<Pipeline> {
        Pipeline::new(&self.options(size, false))
    }

    /// The stages at this size of our own choice, or the nearest that the network takes.
    ///
    /// # Errors
    /// As [`Pipeline::new`].
    pub fn build_near(&self, size: (usize, usize)) -> anyhow::Result<Pipeline> {
        Pipeline::new(&self.options(size, true))
    }

    fn options(&self, (width, height): (usize, usize), nearest: bool) -> PipelineOptions<'_> {
        PipelineOptions {
            model: self.model.as_deref(),
            stage2: self.stage2.as_deref(),
            width,
            height,
            nearest,
            threads: self.most_threads(),
            flip_test: self.flip_test,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_divide_the_cores_and_never_what_the_user_set() {
        let threads = |threads, cameras| {
            let engine = EngineArgs {
                threads,
                cameras,
                ..EngineArgs::default()
            };
            engine.most_threads()
        };
        let cores = threads(None, None);
        assert_eq!(threads(None, Some(1)), cores);
        assert_eq!(threads(None, Some(cores)), 1);
        assert_eq!(threads(None, Some(1000)), 1, "at least one");
        assert_eq!(threads(Some(7), Some(1000)), 7);
    }
}
