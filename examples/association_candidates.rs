//! Whom the association would report if it reported everybody: the pictures from which `models/train/person_score.py` learns to
//! tell people from what only looks like some.
//!
//! ```text
//! cargo run --release --example association_candidates -- models/edgecap.ecm --truth COMPOSITES/truth.json SYNTH/truth.json \
//!     --quiet NO_PEOPLE --out candidates.jsonl
//! ```
//!
//! Writes one line a picture: where it is from, how many people it has who count, and of every candidate the features and the
//! object keypoint similarity to each of those people. Pictures lie beside their annotation file.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Parser;
use edgecap::capture::{Frame, Letterbox, PhotoSource, Resizer, Source};
use edgecap::detect::{AssociationConfig, Associator, Detection, features};
use edgecap::engine::{Engine, EngineOptions, Model};
use edgecap::eval::{JointSet, ReadOptions, TruthFrame, TruthSet, oks};
use serde_json::json;

#[derive(Debug, Parser)]
struct Args {
    /// Model file.
    model: PathBuf,
    /// Labelled pictures in any format of `edgecap eval`.
    #[arg(long, num_args = 1..)]
    truth: Vec<PathBuf>,
    /// The part of the labelled pictures to take, where files name one.
    #[arg(long)]
    split: Option<String>,
    /// Folders of photos without people.
    #[arg(long, num_args = 1..)]
    quiet: Vec<PathBuf>,
    /// Pictures taken of every file and folder, evenly spread.
    #[arg(long, default_value_t = 1000)]
    limit: usize,
    /// Settings to try instead of models/association.toml.
    #[arg(long)]
    association: Option<PathBuf>,
    /// Where the lines go.
    #[arg(long)]
    out: PathBuf,
    /// Pixels across of the network's input.
    #[arg(long, default_value_t = 512)]
    width: usize,
    /// Pixels down of the network's input.
    #[arg(long, default_value_t = 320)]
    height: usize,
}

struct Eyes {
    engine: Engine,
    associator: Associator,
    resizer: Resizer,
    input: Vec<u8>,
}

impl Eyes {
    fn new(args: &Args) -> anyhow::Result<Self> {
        let options = EngineOptions {
            width: args.width,
            height: args.height,
            ..EngineOptions::default()
        };
        let mut everybody = match &args.association {
            Some(path) => toml::from_str(
                &std::fs::read_to_string(path)
                    .with_context(|| format!("cannot read {}", path.display()))?,
            )
            .with_context(|| format!("in {}", path.display()))?,
            None => AssociationConfig::default(),
        };
        everybody.min_score = 0.0;
        let resizer = Resizer::new(args.width as u32, args.height as u32);
        Ok(Self {
            engine: Engine::new(&Model::open(&args.model)?, options)?,
            associator: Associator::new(everybody),
            input: vec![0; resizer.output_bytes()],
            resizer,
        })
    }

    fn look(&mut self, path: &Path) -> anyhow::Result<(&[Detection], Letterbox)> {
        let mut frame = Frame::default();
        PhotoSource::file(path).next_into(&mut frame)?;
        let letterbox = self.resizer.run(&frame, &mut self.input);
        let maps = self.engine.run(&self.input);
        Ok((self.associator.associate(maps), letterbox))
    }
}

/// A picture's line. Who lies in a crowd without labels of its own counts neither as found nor as false.
fn line(
    set: &str,
    truth: &TruthFrame,
    found: &[Detection],
    letterbox: &Letterbox,
) -> serde_json::Value {
    let candidates = found.iter().map(|d| {
        let original = d.joints.map(|[u, v, c]| {
            let [u, v] = letterbox.to_original(u, v);
            if c > 0.0 { [u, v, c] } else { [0.0; 3] }
        });
        let similar = truth
            .people
            .iter()
            .map(|t| oks(t, &original, JointSet::Evidence));
        json!({
            "features": features(&d.joints.map(|j| j[2]), &d.limbs).to_vec(),
            "oks": similar.collect::<Vec<_>>(),
        })
    });
    json!({
        "set": set,
        "source": truth.source,
        "crowd": truth.people.iter().map(|t| t.crowd).collect::<Vec<_>>(),
        "candidates": candidates.collect::<Vec<_>>(),
    })
}

/// At most `limit` of `n` things, evenly spread.
fn spread(n: usize, limit: usize) -> impl Iterator<Item = usize> {
    let take = n.min(limit);
    (0..take).map(move |k| k * n / take.max(1))
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let mut eyes = Eyes::new(&args)?;
    let file =
        File::create(&args.out).with_context(|| format!("cannot write {}", args.out.display()))?;
    let mut out = BufWriter::new(file);
    let read = ReadOptions {
        split: args.split.clone(),
        ..ReadOptions::default()
    };
    for path in &args.truth {
        let truth = TruthSet::read(path, &read)?;
        let folder = path
            .parent()
            .context("an annotation file lies in a folder")?;
        for k in spread(truth.frames.len(), args.limit) {
            let picture = &truth.frames[k];
            let (found, letterbox) = eyes.look(&folder.join(&picture.source))?;
            let line = line(&path.display().to_string(), picture, found, &letterbox);
            writeln!(out, "{line}")?;
        }
    }
    for folder in &args.quiet {
        let files = PhotoSource::folder(folder, None)?;
        for k in spread(files.files().len(), args.limit) {
            let picture = TruthFrame {
                source: files.files()[k].display().to_string(),
                ..TruthFrame::default()
            };
            let (found, letterbox) = eyes.look(&files.files()[k])?;
            let line = line(&folder.display().to_string(), &picture, found, &letterbox);
            writeln!(out, "{line}")?;
        }
    }
    out.flush()?;
    Ok(())
}
