//! Whom the association would report if it reported everybody: the pictures from which `models/train/person_score.py`
//! learns to tell people from what only looks like some, under every combination of settings that is to be tried.
//!
//! ```text
//! cargo run --release --example association_candidates -- models/edgecap.ecm --truth COMPOSITES/truth.json SYNTH/truth.json \
//!     --quiet NO_PEOPLE --out candidates.jsonl [--neck 0.2 0.3] [--joint 0.1 0.15] [--limb 0.05 0.1] [--length 0 0.1]
//! ```
//!
//! Every picture is looked at as `edgecap infer` looks at photos with `--quality best` and `balanced`: heights of peaks
//! change with the size of the network's input, and whom to report is decided in each look alone.
//!
//! Writes one line a look and combination: the settings, the input (pixels across and down), where the picture is from,
//! which of its people do not count (`crowd`: regions of several people, and people without a label of a joint), and of
//! every candidate the features and the object keypoint similarity to each person. Pictures lie beside their annotation
//! file, in which everybody is labelled: who is reported beside them is taught as nobody.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use clap::Parser;
use edgecap::capture::{Frame, Letterbox, PhotoSource, Resizer, Source};
use edgecap::detect::{AssociationConfig, Associator, Detection, features};
use edgecap::engine::{Engine, EngineOptions, Model};
use edgecap::lab::eval::{ImageOks, JointSet, ReadOptions, TruthFrame, TruthSet, oks};
use edgecap::schedule::inputs::{Quality, photo_inputs};
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
    /// Thresholds of necks to try [default: the model's].
    #[arg(long, num_args = 1..)]
    neck: Vec<f32>,
    /// Thresholds of other joints to try [default: the model's].
    #[arg(long, num_args = 1..)]
    joint: Vec<f32>,
    /// Thresholds of limbs to try [default: the model's].
    #[arg(long, num_args = 1..)]
    limb: Vec<f32>,
    /// Weights of limb lengths to try [default: the model's].
    #[arg(long, num_args = 1..)]
    length: Vec<f32>,
    /// Where the lines go.
    #[arg(long)]
    out: PathBuf,
}

impl Args {
    /// Every combination of settings, with nobody left out; `own` are the model's.
    fn associators(&self, own: &AssociationConfig) -> Vec<Associator> {
        let or = |given: &[f32], else_: f32| match given {
            [] => vec![else_],
            some => some.to_vec(),
        };
        let mut all = Vec::new();
        for &neck_threshold in &or(&self.neck, own.neck_threshold) {
            for &joint_threshold in &or(&self.joint, own.joint_threshold) {
                for &limb_threshold in &or(&self.limb, own.limb_threshold) {
                    for &length_weight in &or(&self.length, own.length_weight) {
                        all.push(Associator::new(AssociationConfig {
                            neck_threshold,
                            joint_threshold,
                            limb_threshold,
                            length_weight,
                            min_score: 0.0,
                            ..own.clone()
                        }));
                    }
                }
            }
        }
        all
    }
}

/// The inputs that the program takes for a photo of this size, all pixels across and down.
fn inputs(photo: (usize, usize)) -> Vec<(usize, usize)> {
    let mut all = photo_inputs(photo, Quality::Best);
    all.extend(photo_inputs(photo, Quality::Balanced));
    all
}

struct Eyes {
    /// Has the weights that the engines of all looks share.
    engine: Engine,
    associators: Vec<Associator>,
    out: BufWriter<File>,
}

impl Eyes {
    fn new(args: &Args) -> anyhow::Result<Self> {
        let model = Model::open(&args.model)?;
        let own = AssociationConfig::of(&model)
            .with_context(|| format!("{}: settings of the association", args.model.display()))?;
        let file = File::create(&args.out)
            .with_context(|| format!("cannot write {}", args.out.display()))?;
        Ok(Self {
            engine: Engine::new(&model, EngineOptions::default())?,
            associators: args.associators(&own),
            out: BufWriter::new(file),
        })
    }

    /// Writes the lines of one picture.
    fn see(&mut self, set: &Path, picture: &Path, truth: &TruthFrame) -> anyhow::Result<()> {
        let mut frame = Frame::default();
        PhotoSource::file(picture, None).next_into(&mut frame)?;
        for input in inputs((frame.width as usize, frame.height as usize)) {
            self.look(set, &frame, input, truth)?;
        }
        Ok(())
    }

    /// Writes the lines of one look.
    fn look(
        &mut self,
        set: &Path,
        frame: &Frame,
        (width, height): (usize, usize),
        truth: &TruthFrame,
    ) -> anyhow::Result<()> {
        let mut engine = self.engine.resized(width, height)?;
        let mut resizer = Resizer::new(width as u32, height as u32);
        let mut pixels = vec![0; resizer.output_bytes()];
        let letterbox = resizer.run(frame, &mut pixels);
        let maps = engine.run(&pixels);
        for associator in &mut self.associators {
            let found: Vec<_> = associator
                .associate(maps)
                .iter()
                .map(|d| candidate(d, truth, &letterbox))
                .collect();
            let c = associator.config();
            let settings = [
                c.neck_threshold,
                c.joint_threshold,
                c.limb_threshold,
                c.length_weight,
            ];
            let line = json!({
                "settings": settings.map(plain),
                "input": [width, height],
                "set": set,
                "source": truth.source,
                "crowd": uncounted(truth),
                "candidates": found,
            });
            writeln!(self.out, "{line}")?;
        }
        Ok(())
    }
}

/// A setting as it was given, without the digits that f32 adds.
fn plain(setting: f32) -> f64 {
    (f64::from(setting) * 1e6).round() / 1e6
}

/// Which people are neither to be found nor forbidden: whoever is near one without labels is as similar as can be.
fn uncounted(truth: &TruthFrame) -> Vec<bool> {
    ImageOks::new(&truth.people, &[], JointSet::Evidence).ignored
}

/// Refuses a set in whose pictures people may be who are not labelled.
fn expect_everybody(truth: &TruthSet, path: &Path) -> anyhow::Result<()> {
    ensure!(
        !truth.single && !truth.frames.iter().any(|f| f.partial),
        "{}: expected pictures in which everybody is labelled, found some of the people; leave it out",
        path.display()
    );
    Ok(())
}

fn candidate(d: &Detection, truth: &TruthFrame, letterbox: &Letterbox) -> serde_json::Value {
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
        "joints": original,
        "oks": similar.collect::<Vec<_>>(),
    })
}

/// Where a picture lies that the truth in `folder` names.
fn place(folder: &Path, source: &str) -> PathBuf {
    let named = folder.join(source);
    // The truth's own folder may be part of the source, which is text; a folder's name need not be.
    let beside = named.file_name().map(|name| folder.join(name));
    match beside {
        Some(beside) if !named.exists() && beside.exists() => beside,
        _ => named,
    }
}

/// At most `limit` of `n` things, evenly spread.
fn spread(n: usize, limit: usize) -> impl Iterator<Item = usize> {
    let take = n.min(limit);
    (0..take).map(move |k| k * n / take.max(1))
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let mut eyes = Eyes::new(&args)?;
    let read = ReadOptions {
        split: args.split.clone(),
        ..ReadOptions::default()
    };
    for path in &args.truth {
        let truth = TruthSet::read(path, &read)?;
        expect_everybody(&truth, path)?;
        let folder = path
            .parent()
            .context("an annotation file lies in a folder")?;
        for k in spread(truth.frames.len(), args.limit) {
            let picture = &truth.frames[k];
            eyes.see(path, &place(folder, &picture.source), picture)?;
        }
    }
    for folder in &args.quiet {
        let files = PhotoSource::folder(folder, None)?;
        for k in spread(files.files().len(), args.limit) {
            let file = &files.files()[k];
            let nobody = TruthFrame {
                source: file.display().to_string(),
                ..TruthFrame::default()
            };
            eyes.see(folder, file, &nobody)?;
        }
    }
    eyes.out.flush()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use edgecap::lab::eval::Format;

    #[test]
    fn settings_that_are_not_tried_are_the_models_own() {
        let own = AssociationConfig {
            neck_threshold: 0.375,
            length_weight: 0.625,
            pass_ratio: 0.5,
            ..AssociationConfig::default()
        };
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        let text = toml::to_string(&own).unwrap();
        let model = Model::shipped().unwrap().with_association(text);
        model.save(Path::new(&path("own.ecm"))).unwrap();
        let line = format!(
            "- {} --out {} --joint 0.125 0.25",
            path("own.ecm"),
            path("out")
        );
        let eyes = Eyes::new(&Args::parse_from(line.split(' '))).unwrap();
        let tried = eyes.associators.iter().map(|a| a.config().clone());
        let expected = [0.125, 0.25].map(|joint_threshold| AssociationConfig {
            joint_threshold,
            min_score: 0.0,
            ..own.clone()
        });
        assert_eq!(tried.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn people_without_labels_do_not_count() {
        let person = |visibility: u8, crowd: u8| {
            json!({
                "image_id": 1, "category_id": 1, "keypoints": [9, 9, visibility, 5, 5, visibility],
                "bbox": [0, 0, 9, 9], "area": 50.0, "iscrowd": crowd,
            })
        };
        let text = json!({
            "images": [{"id": 1, "file_name": "a.jpg", "width": 64, "height": 32}],
            "categories": [{"id": 1, "keypoints": ["left_hip", "right_hip"]}],
            "annotations": [person(2, 0), person(0, 0), person(0, 1)],
        });
        let mut truth = TruthSet::parse(&text.to_string(), "t", Format::Coco, None).unwrap();
        assert_eq!(uncounted(&truth.frames[0]), [false, true, true]);
        let path = Path::new("t.json");
        expect_everybody(&truth, path).unwrap();
        truth.frames[0].partial = true;
        let said = expect_everybody(&truth, path).unwrap_err().to_string();
        assert!(said.starts_with("t.json: expected pictures"), "{said}");
        truth.frames[0].partial = false;
        truth.single = true;
        expect_everybody(&truth, path).unwrap_err();
    }

    #[test]
    fn pictures_lie_beside_truth_in_a_folder_of_any_name() {
        use std::os::unix::ffi::OsStrExt;
        let within = tempfile::tempdir().unwrap();
        let folder = within.path().join(std::ffi::OsStr::from_bytes(b"\xff"));
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(folder.join("0.jpg"), "").unwrap();
        let path = folder.join("truth.json");
        let frame = json!({"frame": 0, "file": "0.jpg", "people": []});
        let text = json!({"fps": 0.0, "frames": [frame]}).to_string();
        std::fs::write(&path, text).unwrap();
        let truth = TruthSet::read(&path, &ReadOptions::default()).unwrap();
        let picture = place(&folder, &truth.frames[0].source);
        assert_eq!(picture, folder.join("0.jpg"));
        std::fs::create_dir(folder.join("train")).unwrap();
        std::fs::write(folder.join("train/0.jpg"), "").unwrap();
        let below = place(&folder, "train/0.jpg");
        assert_eq!(below, folder.join("train/0.jpg"));
    }

    #[test]
    fn photos_are_looked_at_as_the_program_does() {
        assert_eq!(inputs((640, 480)), [(320, 240), (640, 480), (432, 320)]);
        assert_eq!(inputs((480, 720)), [(240, 368), (480, 720), (256, 384)]);
    }
}
