//! Which association thresholds suit a model: runs Stage I once over labelled photos and over photos without people, then
//! measures a grid of settings on the stored maps.
//!
//! ```text
//! cargo run --release --example tune_association -- MODEL --truth photos/coco/annotations.json ... [--single people2d/annotations.json]
//!     [--quiet no_people] [--limit 200]
//! ```
//!
//! Pictures lie beside their annotation file. Rows are sorted by recall at OKS 0.5 plus PCK plus the share of empty pictures in
//! which nobody is reported.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Parser;
use edgecap::capture::{Frame, Letterbox, PhotoSource, Resizer, Source};
use edgecap::detect::{AssociationConfig, Associator};
use edgecap::engine::{Engine, EngineOptions, HEAD2D_CHANNELS, HEAD3D_CHANNELS, Maps, Model};
use edgecap::eval::{
    EvalOptions, Person, PredictedFrame, Predictions, ReadOptions, TruthSet, evaluate, quiet,
};
use edgecap::joints::BODY_JOINTS;

#[derive(Debug, Parser)]
struct Args {
    /// Model file.
    model: PathBuf,
    /// Labelled photos with several people.
    #[arg(long, num_args = 1..)]
    truth: Vec<PathBuf>,
    /// Labelled photos with one person each; the split 'test'.
    #[arg(long)]
    single: Option<PathBuf>,
    /// Folder of photos without people.
    #[arg(long)]
    quiet: Option<PathBuf>,
    /// Photos taken of the last two.
    #[arg(long, default_value_t = 200)]
    limit: usize,
    /// Rows printed.
    #[arg(long, default_value_t = 40)]
    rows: usize,
    /// Pixels across of the network's input.
    #[arg(long, default_value_t = 512)]
    width: usize,
    /// Pixels down of the network's input.
    #[arg(long, default_value_t = 320)]
    height: usize,
}

/// One picture after Stage I.
struct Seen {
    source: String,
    size: [f64; 2],
    letterbox: Letterbox,
    maps: Maps,
}

struct Eyes {
    engine: Engine,
    resizer: Resizer,
    input: Vec<u8>,
}

impl Eyes {
    fn look(&mut self, path: &Path) -> anyhow::Result<Seen> {
        let mut frame = Frame::default();
        PhotoSource::file(path).next_into(&mut frame)?;
        let letterbox = self.resizer.run(&frame, &mut self.input);
        let mut maps = self.engine.run(&self.input).clone();
        // Only the 2D head matters here, and memory does.
        maps.head3d = Vec::new();
        Ok(Seen {
            source: path.display().to_string(),
            size: [f64::from(frame.width), f64::from(frame.height)],
            letterbox,
            maps,
        })
    }

    fn look_at_all(&mut self, truth: &TruthSet, folder: &Path) -> anyhow::Result<Vec<Seen>> {
        let frames = truth.frames.iter();
        frames.map(|f| self.look(&folder.join(&f.source))).collect()
    }
}

/// What `infer` would have written.
fn predict(seen: &mut [Seen], config: &AssociationConfig) -> Predictions {
    let mut associator = Associator::new(config.clone());
    let mut encodings = Vec::new();
    let frames = seen.iter_mut().enumerate().map(|(k, s)| {
        encodings.resize(s.maps.head2d.len() / HEAD2D_CHANNELS * HEAD3D_CHANNELS, 0.0);
        std::mem::swap(&mut s.maps.head3d, &mut encodings);
        let found = associator.associate(&s.maps);
        let person = |d: &edgecap::detect::Detection| Person {
            id: None,
            score: f64::from(d.score),
            joints2d: d.joints.map(|[u, v, c]| {
                let [u, v] = s.letterbox.to_original(u, v);
                if c > 0.0 { [u, v, c] } else { [0.0; 3] }
            }),
            joints3d: [[0.0; 3]; BODY_JOINTS],
        };
        let frame = PredictedFrame {
            frame: k as u64,
            time_ns: 0,
            source: s.source.clone(),
            size: s.size,
            people: found.iter().map(person).collect(),
        };
        std::mem::swap(&mut s.maps.head3d, &mut encodings);
        frame
    });
    Predictions {
        frames: frames.collect(),
        bodies: false,
    }
}

/// Settings that change which joints belong together.
fn groupings() -> Vec<AssociationConfig> {
    let mut all = Vec::new();
    for neck_threshold in [0.2, 0.3, 0.4, 0.5] {
        for joint_threshold in [0.15, 0.25, 0.4, 0.5] {
            for limb_threshold in [0.05, 0.1, 0.2] {
                all.push(AssociationConfig {
                    neck_threshold,
                    joint_threshold,
                    limb_threshold,
                    min_joints: 1,
                    min_score: 0.0,
                    ..AssociationConfig::default()
                });
            }
        }
    }
    all
}

/// The people that stricter limits leave: these only drop people, so that the grouping need not be done again.
fn only(all: &Predictions, min_joints: usize, min_score: f64) -> Predictions {
    let mut out = all.clone();
    for f in &mut out.frames {
        f.people.retain(|p| {
            let joints = p.joints2d.iter().filter(|j| j[2] > 0.0).count();
            joints >= min_joints && p.score >= min_score
        });
    }
    out
}

/// Fewest joints and least score.
fn limits() -> Vec<(usize, f64)> {
    let mut all = Vec::new();
    for min_joints in [4, 6, 8] {
        all.extend((3..20).map(|k| (min_joints, 0.05 * f64::from(k))));
    }
    all
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let model = Model::open(&args.model)?;
    let options = EngineOptions {
        width: args.width,
        height: args.height,
        ..EngineOptions::default()
    };
    let resizer = Resizer::new(args.width as u32, args.height as u32);
    let mut eyes = Eyes {
        engine: Engine::new(&model, options)?,
        input: vec![0; resizer.output_bytes()],
        resizer,
    };
    let (mut truth, mut photos) = (TruthSet::default(), Vec::new());
    for path in &args.truth {
        let more = TruthSet::read(path, &ReadOptions::default())?;
        let folder = path
            .parent()
            .context("an annotation file lies in a folder")?;
        photos.extend(eyes.look_at_all(&more, folder)?);
        truth.append(more, &path.display().to_string())?;
    }
    let (mut single, mut portraits) = (TruthSet::default(), Vec::new());
    if let Some(path) = &args.single {
        let test = ReadOptions {
            split: Some("test".into()),
            ..ReadOptions::default()
        };
        single = TruthSet::read(path, &test)?;
        single.frames.truncate(args.limit);
        let folder = path
            .parent()
            .context("an annotation file lies in a folder")?;
        portraits = eyes.look_at_all(&single, folder)?;
    }
    let mut empty = Vec::new();
    if let Some(folder) = &args.quiet {
        let files = PhotoSource::folder(folder, None)?;
        for path in files.files().iter().take(args.limit) {
            empty.push(eyes.look(path)?);
        }
    }
    println!(
        "{} photos, {} of one person, {} of nobody",
        photos.len(),
        portraits.len(),
        empty.len()
    );

    let mut rows = Vec::new();
    for config in groupings() {
        let crowd = predict(&mut photos, &config);
        let alone = predict(&mut portraits, &config);
        let nobody = predict(&mut empty, &config);
        for (min_joints, min_score) in limits() {
            let keep = |all: &Predictions| only(all, min_joints, min_score);
            let report = evaluate(&keep(&crowd), &truth, &EvalOptions::default())?;
            let pck = match alone.frames.is_empty() {
                true => 0.0,
                false => {
                    let r = evaluate(&keep(&alone), &single, &EvalOptions::default())?;
                    r.pck.unwrap_or(0.0)
                }
            };
            let silence = quiet(&keep(&nobody)).share();
            let config = AssociationConfig {
                min_joints,
                min_score: min_score as f32,
                ..config.clone()
            };
            rows.push((report, pck, silence, config));
        }
    }
    let rank = |r: &(edgecap::eval::Report, f64, f64, AssociationConfig)| {
        r.0.finding[1].recall + r.1 + r.2
    };
    rows.sort_by(|a, b| rank(b).total_cmp(&rank(a)));
    println!(
        " AP    R@.3  R@.5  P@.5  mOKS  false  PCK   quiet | neck joint limb min_joints min_score"
    );
    for (report, pck, silence, c) in rows.iter().take(args.rows) {
        let (a, b) = (report.finding[0], report.finding[1]);
        println!(
            "{:.3} {:.3} {:.3} {:.3} {:.3} {:4}  {:.3} {:.3} | {} {} {} {} {:.2}",
            report.coco.map_or(0.0, |c| c.ap),
            a.recall,
            b.recall,
            b.precision,
            b.mean_oks,
            b.false_people,
            pck,
            silence,
            c.neck_threshold,
            c.joint_threshold,
            c.limb_threshold,
            c.min_joints,
            c.min_score
        );
    }
    Ok(())
}
