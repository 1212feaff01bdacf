//! What the confidence of bodies' joints should say: fits the numbers of `src/fit/publish/confidence.rs` to films with
//! truth, or with `--check` holds what is built in against them.
//!
//! ```text
//! for s in $(seq 601 612); do
//!   edgecap synth --frames 60 --fps $((s < 607 ? 6 : 12)) --people $((2 + (s - 1) % 5)) --seed $s --quality 40 \
//!     --out films/$s --clip films/$s.avi
//!   edgecap infer --input films/$s.avi --jsonl films/$s.jsonl
//!   films+=(films/$s.jsonl films/$s/truth.json)
//! done
//! cargo run --release --example body_confidence -- "${films[@]}"
//! ```
//!
//! Its numbers were checked on the ten films of `models/train/clips.py`.

use std::collections::HashMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Parser;
use edgecap::fit::confidence::{self, KnownJoint, PART, PARTS, RADIUS, features};
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS, PELVIS};
use edgecap::lab::synth::Truth;
use edgecap::lab::synth::truth::{TruthFrame, TruthPerson};
use edgecap::message::{Body, BodyFrame, JointState, ObservationFrame};
use edgecap::record::{CameraSource, ObservationReader};
use glam::{Vec2, Vec3};
use nalgebra::{SMatrix, SVector};

/// Mean distance of the evidence joints in the picture beyond which a body is nobody's, shares of the person's size.
const APART: f32 = 0.25;
const WEIGHTS: usize = PARTS + 3;
const BINS: usize = 10;

#[derive(Debug, Parser)]
struct Args {
    /// Pairs: what `infer --jsonl` wrote about a film, and the film's truth.json.
    #[arg(required = true, num_args = 2.., value_name = "OBSERVATIONS TRUTH")]
    films: Vec<PathBuf>,
    /// Fit nothing: hold the numbers that are built in against these films.
    #[arg(long)]
    check: bool,
}

/// One joint of one body, and whether it was where the truth has it.
struct Case {
    joint: usize,
    known: KnownJoint,
    right: bool,
}

impl Case {
    /// What is regressed on: which part it is of, and its features.
    fn row(&self) -> SVector<f64, WEIGHTS> {
        let [a, b, c] = features(&self.known);
        let mut row = SVector::zeros();
        row[PART[self.joint]] = 1.0;
        (row[PARTS], row[PARTS + 1], row[PARTS + 2]) = (a, b, c);
        row
    }
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    if !args.films.len().is_multiple_of(2) {
        bail!(
            "expected observations and truth of every film, found {} files; give them in pairs",
            args.films.len()
        );
    }
    let mut cases = Vec::new();
    for film in args.films.chunks_exact(2) {
        collect(&film[0], &film[1], &mut cases)?;
    }
    if cases.is_empty() {
        bail!("no body is near anybody of the truth: nothing to measure");
    }
    if args.check {
        let said = cases.iter().map(|c| confidence::of(c.joint, &c.known));
        report(&cases, &said.collect::<Vec<_>>());
    } else {
        let known = cases.iter().filter(|c| PART[c.joint] < PARTS);
        let weights = regress(&known.collect::<Vec<_>>());
        let (bias, rest) = weights.as_slice().split_at(PARTS);
        println!("const BIAS: [f64; PARTS] = {bias:.2?};");
        println!("const WEIGHTS: [f64; 3] = {rest:.2?};");
    }
    Ok(())
}

/// Runs the fit over a film and adds every joint but the pelvis of everybody who is matched.
fn collect(observations: &Path, truth: &Path, cases: &mut Vec<Case>) -> anyhow::Result<()> {
    let truth = Truth::load(truth)?;
    let by_number: HashMap<u64, &TruthFrame> = truth.frames.iter().map(|f| (f.frame, f)).collect();
    let file = File::open(observations)
        .with_context(|| format!("cannot read {}", observations.display()))?;
    let camera = CameraSource::Recorded { fov_degrees: 60.0 };
    let name = observations.display().to_string();
    let mut reader = ObservationReader::new(BufReader::new(file), name, camera);
    let mut fitter = Fitter::new(FitConfig::default())?;
    let (mut frame, mut bodies) = (ObservationFrame::default(), BodyFrame::default());
    while reader.read(&mut frame)? {
        let Some(truth) = by_number.get(&frame.sequence) else {
            bail!(
                "expected frames of the truth, found frame {} in {}; give the truth of the same film",
                frame.sequence,
                observations.display()
            );
        };
        fitter.update(&frame, &mut bodies);
        let known: HashMap<u32, [KnownJoint; BODY_JOINTS]> = fitter.known_joints().collect();
        for (body, person) in matched(bodies.bodies(), &truth.people) {
            let at = |joints: &[[f32; 3]; BODY_JOINTS], j: usize| {
                Vec3::from_array(joints[j]) - Vec3::from_array(joints[PELVIS])
            };
            for joint in (0..BODY_JOINTS).filter(|j| *j != PELVIS) {
                let off = at(&body.joints3d, joint).distance(at(&person.joints3d, joint));
                cases.push(Case {
                    joint,
                    known: known[&body.id][joint],
                    right: f64::from(off) < RADIUS,
                });
            }
        }
    }
    Ok(())
}

/// Bodies with the people they are of, the nearest first.
fn matched<'a>(bodies: &'a [Body], people: &'a [TruthPerson]) -> Vec<(&'a Body, &'a TruthPerson)> {
    let apart = |body: &Body, person: &TruthPerson| -> f32 {
        let [mut low, mut high] = [Vec2::INFINITY, Vec2::NEG_INFINITY];
        let mut sum = 0.0;
        for (a, b) in body
            .joints2d
            .iter()
            .zip(&person.joints2d)
            .take(EVIDENCE_JOINTS)
        {
            let b = Vec2::from_array(*b);
            (low, high) = (low.min(b), high.max(b));
            sum += Vec2::from_array(*a).distance(b);
        }
        sum / EVIDENCE_JOINTS as f32 / (high - low).max_element()
    };
    let mut pairs: Vec<(f32, &Body, &TruthPerson)> = bodies
        .iter()
        .flat_map(|b| people.iter().map(move |p| (apart(b, p), b, p)))
        .filter(|(apart, ..)| *apart < APART)
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut out: Vec<(&Body, &TruthPerson)> = Vec::new();
    for (_, body, person) in pairs {
        if out
            .iter()
            .all(|(b, p)| b.id != body.id && p.id != person.id)
        {
            out.push((body, person));
        }
    }
    out
}

/// Logistic regression by Newton's steps.
fn regress(cases: &[&Case]) -> SVector<f64, WEIGHTS> {
    let mut weights = SVector::<f64, WEIGHTS>::zeros();
    for _ in 0..50 {
        let mut curve = SMatrix::<f64, WEIGHTS, WEIGHTS>::identity() * 1e-3;
        let mut slope = -1e-3 * weights;
        for case in cases {
            let row = case.row();
            let p = 1.0 / (1.0 + (-weights.dot(&row)).exp());
            curve.ger(p * (1.0 - p), &row, &row, 1.0);
            slope.axpy(f64::from(u8::from(case.right)) - p, &row, 1.0);
        }
        let Some(step) = curve.cholesky().map(|c| c.solve(&slope)) else {
            break;
        };
        weights += step;
        if step.amax() < 1e-9 {
            break;
        }
    }
    weights
}

/// What was said against what was right: expected calibration error, by bins and by how joints were seen.
fn report(cases: &[Case], said: &[f64]) {
    let line = |name: &str, chosen: &dyn Fn(usize) -> bool| -> f64 {
        let of: Vec<usize> = (0..cases.len()).filter(|&k| chosen(k)).collect();
        if of.is_empty() {
            return 0.0;
        }
        let n = of.len() as f64;
        let claimed = of.iter().map(|&k| said[k]).sum::<f64>() / n;
        let right = of.iter().filter(|&&k| cases[k].right).count() as f64 / n;
        println!("{name:<24} said {claimed:.3}, right {right:.3}, of {n}");
        n * (claimed - right).abs()
    };
    line("all", &|_| true);
    let is = |state| move |k: usize| cases[k].known.unseen == 0.0 && cases[k].known.state == state;
    line("observed", &is(JointState::OBSERVED));
    line("occluded", &is(JointState::OCCLUDED));
    line("predicted", &|k| cases[k].known.unseen > 0.0);
    for part in 0..=PARTS {
        line(&format!("part {part}"), &|k| PART[cases[k].joint] == part);
    }
    let bin = |k: usize| ((said[k] * BINS as f64) as usize).min(BINS - 1);
    let errors = (0..BINS).map(|b| line(&format!("bin {b}"), &|k| bin(k) == b));
    let error = errors.sum::<f64>() / cases.len() as f64;
    println!("expected calibration error {error:.4}");
}
