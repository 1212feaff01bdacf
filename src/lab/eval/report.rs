//! Predictions and truth go in, every measure that they allow comes out.

use std::collections::BTreeMap;

use edgecap_client::joints::{CANONICAL_STATURE, EVIDENCE_JOINTS, JOINT_NAMES, PELVIS};
use serde::Serialize;

use super::geometry::{minus, norm};
use super::identity::{Identity, IdentityScore};
use super::jitter::Jitter;
use super::mupots::{Mupots, MupotsPerson, MupotsScore, Protocol};
use super::oks::{AveragePrecision, ImageOks, Joints2d, average_precision};
use super::pairing::pair;
use super::recall::{self, Picture, RecallRow, labelled};
use super::{
    EvalError, Finding, JointSet, Pck, Pckh, PckhScore, Person, Pose3d, PoseErrors, PredictedFrame,
    Predictions, Quiet, TruthFrame, TruthPerson, TruthSet, find_people,
};
use crate::assignment::Matcher;

/// Fraction of the torso within which a joint is right.
const PCK_FRACTION: f64 = 0.2;
/// Least OKS for a prediction to be taken as this person in the measures of joints: the person was found, however
/// badly.
const SAME_PERSON: f64 = 0.1;
/// OKS at which a predicted identity lies on a true one.
const SAME_IDENTITY: f64 = 0.5;
/// No pelvis comes nearer to a camera than this, metres: where it does, the truth is relative to the pelvis, and does
/// not say where in camera space a body is.
const NEAREST_PELVIS: f64 = 0.1;
/// The network's reference input: heights are given in its pixels.
const NETWORK_INPUT: [f64; 2] = [512.0, 320.0];

/// What to measure.
#[derive(Debug, Clone, PartialEq)]
pub struct EvalOptions {
    /// Points that count in OKS.
    pub joints: JointSet,
    /// People with fewer labelled evidence joints are not asked for in recall.
    pub min_joints: usize,
    /// People whose boxes are lower than this, network input pixels, are not asked for in recall, nor those in pictures
    /// of unknown size.
    pub min_height: f64,
}

impl Default for EvalOptions {
    fn default() -> Self {
        Self {
            joints: JointSet::Shared,
            min_joints: 8,
            min_height: 0.0,
        }
    }
}

/// Every measure that the predictions and the truth allow.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Report {
    /// Points that counted in OKS.
    pub joints: JointSet,
    /// For pictures that hold nobody; then nothing else is measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quiet: Option<Quiet>,
    /// Frames of the truth.
    pub frames: usize,
    /// Frames of the truth that have no prediction at all, as if nobody had been found.
    pub frames_without_prediction: usize,
    /// Predicted people in the others.
    pub predicted_people: usize,
    /// COCO's AP and AR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coco: Option<AveragePrecision>,
    /// Recall and precision at OKS 0.3, 0.5 and 0.75 of people with enough joints.
    pub finding: Vec<Finding>,
    /// Recall at OKS 0.5 by the box's height, in pictures of known size.
    pub recall_by_height: Vec<RecallRow>,
    /// Recall at OKS 0.5 by labelled evidence joints, of everybody tall enough.
    pub recall_by_joints: Vec<RecallRow>,
    /// Recall at OKS 0.5 by people in the picture.
    pub recall_by_company: Vec<RecallRow>,
    /// PCK@0.2 of the torso over all labelled joints; a person who is not matched at OKS 0.1 or more has all joints
    /// wrong.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pck: Option<f64>,
    /// The same, joint by joint.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pck_per_joint: Vec<(&'static str, Option<f64>)>,
    /// PCKh@0.5, MPII's, of the same people where something tells the size of heads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pckh: Option<PckhScore>,
    /// 3D errors of everybody who is matched from OKS 0.1 on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pose3d: Option<Pose3d>,
    /// MuPoTS-3D's protocol.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub mupots: Vec<MupotsScore>,
    /// Identities over time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub identity: Option<IdentityScore>,
    /// Mean acceleration of predicted joints, m/s²; of observations at 1.70 m, which is their stature.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jitter: Option<f64>,
    /// Mean acceleration of true joints at the same size, m/s², over as long as a predicted track lies on one person.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub true_motion: Option<f64>,
}

/// One frame with everything the measures share.
struct Scene<'a> {
    truth: &'a TruthFrame,
    predicted: Option<&'a PredictedFrame>,
    /// In the joint set asked for.
    image: ImageOks,
    /// Over all evidence joints.
    evidence: ImageOks,
    /// Prediction of every true person, over the evidence joints; those to be ignored have what nobody who counts has.
    partner: Vec<Option<usize>>,
    /// Network input pixels per pixel; none where the picture's size is not known.
    scale: Option<f64>,
}

impl Scene<'_> {
    fn people(&self) -> &[Person] {
        self.predicted.map_or(&[], |p| &p.people)
    }

    fn partner(&self, t: usize) -> Option<&Person> {
        self.partner[t].map(|p| &self.people()[p])
    }
}

/// Measures predictions against truth.
///
/// # Errors
/// When there is nothing to measure, it cannot be told which prediction belongs to which frame of the truth, or the
/// bodies are not in a camera's axes.
pub fn evaluate(
    predictions: &Predictions,
    truth: &TruthSet,
    options: &EvalOptions,
) -> Result<Report, EvalError> {
    expect_somebody(truth)?;
    if let Some(at) = &predictions.in_calibration {
        return Err(EvalError::format(
            at,
            "bodies in camera axes, as truth is",
            "those in a calibration's; measure the observations of each camera, or bodies of `fit` or `run` of one",
        ));
    }
    let pairs = pair(truth, predictions)?;
    let mut matcher = Matcher::default();
    let scenes: Vec<Scene> = pairs
        .into_iter()
        .map(|(t, p)| {
            let partial = truth.single || t.partial;
            scene(t, p, partial, options.joints, &mut matcher)
        })
        .collect();
    let mut report = Report {
        joints: options.joints,
        frames: scenes.len(),
        frames_without_prediction: scenes.iter().filter(|s| s.predicted.is_none()).count(),
        predicted_people: scenes.iter().map(|s| s.people().len()).sum(),
        ..Report::default()
    };
    if !truth.single {
        let pictures: Vec<Picture> = scenes
            .iter()
            .map(|s| (&s.image, &s.truth.people[..], s.scale))
            .collect();
        let tall = |t: &TruthPerson, scale: Option<f64>| {
            options.min_height <= 0.0 || scale.is_some_and(|s| t.height() * s >= options.min_height)
        };
        let asked = |t: &TruthPerson, scale: Option<f64>| {
            labelled(t) >= options.min_joints && tall(t, scale)
        };
        // Where nobody reported can be wrong, precision says nothing.
        if truth.frames.iter().any(|f| !f.partial) {
            let images: Vec<ImageOks> = scenes.iter().map(|s| s.image.clone()).collect();
            report.coco = Some(average_precision(&images));
            for least in [0.3, 0.5, 0.75] {
                let found = find_people(pictures.iter().copied(), least, &asked);
                report.finding.push(found);
            }
        }
        report.recall_by_height = recall::by_height(&pictures, &asked);
        report.recall_by_joints = recall::by_joints(&pictures, &tall);
        report.recall_by_company = recall::by_company(&pictures, &asked);
    }
    points(&scenes, &mut report);
    if scenes
        .iter()
        .flat_map(|s| &s.truth.people)
        .any(|t| t.joints3d.is_some())
    {
        report.pose3d = pose3d(&scenes, predictions.bodies);
        report.mupots = mupots(&scenes);
    }
    if truth.video {
        if predictions.bodies {
            report.identity = Some(identity(&scenes));
        }
        (report.jitter, report.true_motion) = jitter(&scenes, predictions.bodies);
    }
    Ok(report)
}

/// Refuses a truth about nothing.
fn expect_somebody(truth: &TruthSet) -> Result<(), EvalError> {
    if truth.frames.is_empty() {
        return Err(EvalError::Empty { of: "truth" });
    }
    let mut people = truth.frames.iter().flat_map(|f| &f.people);
    if !people.any(|t| !t.crowd && t.points.iter().any(|k| k.is_labelled())) {
        return Err(EvalError::Nobody {
            pictures: truth.frames.len(),
        });
    }
    Ok(())
}

/// `partial`: others than the labelled may be in the picture.
fn scene<'a>(
    truth: &'a TruthFrame,
    predicted: Option<&'a PredictedFrame>,
    partial: bool,
    joints: JointSet,
    matcher: &mut Matcher,
) -> Scene<'a> {
    let people = predicted.map_or(&[][..], |p| &p.people[..]);
    let flat: Vec<(f64, Joints2d)> = people.iter().map(|p| (p.score, p.joints2d)).collect();
    let compared = |set: JointSet| {
        let mut image = ImageOks::new(&truth.people, &flat, set);
        if partial {
            image.excused.fill(true);
        }
        image
    };
    let (image, evidence) = (compared(joints), compared(JointSet::Evidence));
    let scores = evidence.matching_scores(SAME_PERSON);
    let mut partner = vec![None; truth.people.len()];
    let pairs = matcher.solve(people.len(), truth.people.len(), &scores);
    for (p, t) in pairs.iter().enumerate() {
        if let Some(t) = *t {
            partner[t] = Some(p);
        }
    }
    // By the truth first: it knows the size of a picture that nobody predicted, too.
    let sizes = [truth.size, predicted.map(|p| p.size)];
    let size = sizes.into_iter().flatten();
    let size = size.into_iter().find(|[w, h]| *w > 0.0 && *h > 0.0);
    let scale = size.map(|[w, h]| (NETWORK_INPUT[0] / w).min(NETWORK_INPUT[1] / h));
    Scene {
        truth,
        predicted,
        image,
        evidence,
        partner,
        scale,
    }
}

/// PCK and PCKh over every person that counts.
fn points(scenes: &[Scene], report: &mut Report) {
    let mut pck = Pck::new(PCK_FRACTION);
    let mut pckh = Pckh::default();
    for s in scenes {
        for (t, person) in s.truth.people.iter().enumerate() {
            if !s.evidence.ignored[t] {
                let seen = s.partner(t).map(|p| &p.joints2d);
                pck.add(person, seen);
                pckh.add(person, seen);
            }
        }
    }
    report.pckh = pckh.score();
    if pck.people() > 0 {
        report.pck = Some(pck.mean());
        report.pck_per_joint = JOINT_NAMES[..EVIDENCE_JOINTS]
            .iter()
            .copied()
            .zip(pck.per_joint())
            .collect();
    }
}

/// What brings a true person to the size of predictions: observations are of canonical stature, so that a truth that
/// knows the person's is brought to it.
fn to_size(person: &TruthPerson, bodies: bool) -> f64 {
    match person.stature {
        Some(stature) if !bodies => f64::from(CANONICAL_STATURE) / stature,
        _ => 1.0,
    }
}

/// Whether a true pelvis says where somebody is, and not only that joints are relative to it.
fn is_in_camera_space(pelvis: [f64; 3]) -> bool {
    norm(pelvis) > NEAREST_PELVIS
}

fn pose3d(scenes: &[Scene], bodies: bool) -> Option<Pose3d> {
    let (mut errors, mut canonical) = (Vec::new(), Vec::new());
    let (mut roots, mut people) = (Vec::new(), 0);
    for s in scenes {
        for (t, person) in s.truth.people.iter().enumerate() {
            let asked = |j: &_| !s.evidence.ignored[t] && PoseErrors::can_be(j);
            let Some(joints) = person.joints3d.filter(asked) else {
                continue;
            };
            people += 1;
            let Some(p) = s.partner(t) else { continue };
            let scale = to_size(person, bodies);
            let scaled = joints.map(|j| j.map(|j| j.map(|x| x * scale)));
            errors.extend(PoseErrors::new(&scaled, &p.joints3d));
            // Both sides are brought to one stature, or neither: observations have it, bodies say theirs.
            let seen = match p.height {
                None if bodies => None,
                height => Some(height.unwrap_or(f64::from(CANONICAL_STATURE))),
            };
            if let Some((truly, seen)) = person.stature.zip(seen) {
                let [truly, seen] = [truly, seen].map(|s| f64::from(CANONICAL_STATURE) / s);
                canonical.extend(PoseErrors::new(
                    &joints.map(|j| j.map(|j| j.map(|x| x * truly))),
                    &p.joints3d.map(|j| j.map(|x| x * seen)),
                ));
            }
            if let Some(root) = joints[PELVIS].filter(|r| bodies && is_in_camera_space(*r)) {
                roots.push(norm(minus(p.joints3d[PELVIS], root)));
            }
        }
    }
    Pose3d::pool(&errors, &canonical, people, &roots)
}

fn mupots(scenes: &[Scene]) -> Vec<MupotsScore> {
    let mut sequences: BTreeMap<&str, Vec<&Scene>> = BTreeMap::new();
    for s in scenes {
        sequences.entry(&s.truth.sequence).or_default().push(s);
    }
    let mut mupots = Mupots::default();
    for sequence in sequences.values() {
        mupots.begin_sequence();
        for s in sequence {
            let (truth, predicted) = mupots_people(s);
            mupots.add(&truth, &predicted);
        }
    }
    [Protocol::All, Protocol::Matched]
        .into_iter()
        .filter_map(|p| mupots.score(p))
        .collect()
}

/// Everybody true that counts, and everybody predicted.
fn mupots_people(s: &Scene) -> (Vec<MupotsPerson>, Vec<MupotsPerson>) {
    let truth: Vec<MupotsPerson> = s
        .truth
        .people
        .iter()
        .zip(&s.evidence.ignored)
        .filter(|(_, ignored)| !**ignored)
        .filter_map(|(t, _)| {
            let mut joints2d = [None; EVIDENCE_JOINTS];
            for k in t.points.iter().filter(|k| k.is_labelled()) {
                if let Some(j) = k.joint {
                    joints2d[j] = Some([k.u, k.v]);
                }
            }
            let joints3d = t.joints3d.filter(PoseErrors::has_extent)?;
            Some(MupotsPerson { joints2d, joints3d })
        })
        .collect();
    let predicted: Vec<MupotsPerson> = s
        .people()
        .iter()
        .map(|p| MupotsPerson {
            // That protocol matches by the joints that were seen alone.
            joints2d: p
                .joints2d
                .map(|[u, v, c]| (c > 0.0).then_some([f64::from(u), f64::from(v)])),
            joints3d: p.joints3d.map(Some),
        })
        .collect();
    (truth, predicted)
}

fn identity(scenes: &[Scene]) -> IdentityScore {
    let mut identity = Identity::default();
    for s in scenes {
        let counted: Vec<usize> = (0..s.truth.people.len())
            .filter(|&t| !s.evidence.ignored[t] && s.truth.people[t].id.is_some())
            .collect();
        // A body on somebody who is not asked for, because nearly nothing of them shows, is neither right nor wrong,
        // unless it is that of somebody who is.
        let is_taken = |p: usize| {
            let mut partners = s.partner.iter().enumerate();
            partners.any(|(t, own)| {
                *own == Some(p) && !s.evidence.ignored[t] && s.evidence.oks[p][t] >= SAME_IDENTITY
            })
        };
        let on_hidden = |p: usize| {
            let best = |ignored: bool| {
                let row = s.evidence.oks[p].iter().zip(&s.evidence.ignored);
                let row = row.filter(|(_, i)| **i == ignored).map(|(o, _)| *o);
                row.fold(0.0, f64::max)
            };
            let hidden = best(true) >= SAME_IDENTITY && best(true) > best(false);
            hidden && !is_taken(p) || s.evidence.excused[p] && best(false) < SAME_IDENTITY
        };
        let people = s.people();
        let kept: Vec<usize> = (0..people.len())
            .filter(|&p| people[p].id.is_some() && !on_hidden(p))
            .collect();
        let truth: Vec<u64> = counted
            .iter()
            .filter_map(|&t| s.truth.people[t].id)
            .collect();
        let predicted: Vec<u64> = kept.iter().filter_map(|&p| people[p].id).collect();
        let row = |&p: &usize| counted.iter().map(|&t| s.evidence.oks[p][t]).collect();
        let similarity: Vec<Vec<f64>> = kept.iter().map(row).collect();
        identity.add(&truth, &predicted, &similarity, SAME_IDENTITY);
    }
    identity.score()
}

/// Acceleration of the predicted and of the true joints: tracks are the predicted identities, or the true ones where
/// the predictions have none, and the truth begins anew where the predicted track does. Observations are compared
/// relative to the pelvis and at their size, bodies in camera space where the truth is in it, else relative to the
/// pelvis, too. Time is the truth's where it has one: that of predictions may be assumed, as photos in a row have none.
fn jitter(scenes: &[Scene], bodies: bool) -> (Option<f64>, Option<f64>) {
    let (mut predicted, mut truth) = (Jitter::default(), Jitter::default());
    for s in scenes {
        let Some(frame) = s.predicted else { continue };
        let own = frame.time_ns as f64 * 1e-9;
        let seconds = s.truth.seconds.unwrap_or(own);
        for (t, person) in s.truth.people.iter().enumerate() {
            let (Some(id), Some(p)) = (person.id, s.partner(t)) else {
                continue;
            };
            let track = if bodies { p.id.unwrap_or(id) } else { id };
            let pelvis = person.joints3d.and_then(|j| j[PELVIS]);
            let is_relative = !bodies || pelvis.is_some_and(|r| !is_in_camera_space(r));
            let seen = match bodies && is_relative {
                true => p.joints3d.map(|j| minus(j, p.joints3d[PELVIS])),
                false => p.joints3d,
            };
            predicted.add(track, frame.frame, seconds, &seen);
            let Some(joints) = person.joints3d else {
                continue;
            };
            let root = pelvis.filter(|_| is_relative).unwrap_or_default();
            let scale = to_size(person, bodies);
            let moved = |j: [f64; 3]| minus(j, root).map(|x| x * scale);
            let whole: Option<Vec<[f64; 3]>> = joints.iter().map(|j| j.map(moved)).collect();
            if let Some(whole) = whole.and_then(|w| w.try_into().ok()) {
                truth.add((id, track), frame.frame, seconds, &whole);
            }
        }
    }
    (predicted.mean(), truth.mean())
}
