//! COCO's keypoint measures: object keypoint similarity, average precision and recall. Agrees with pycocotools.

use edgecap_client::joints::EVIDENCE_JOINTS;
use serde::Serialize;

use super::keypoints::SIGMAS;
use super::truth::AREA_OF_BOX;
use super::{JointSet, Keypoint, TruthPerson, bounding_box};

/// Joints of a prediction: u, v, confidence.
pub type Joints2d = [[f32; 3]; EVIDENCE_JOINTS];

/// Where a joint was predicted. Confidence 0 means that it was not seen, but a place counts all the same, as in COCO's
/// protocol; only 0, 0 with confidence 0 says nothing.
pub fn predicted([u, v, confidence]: [f32; 3]) -> Option<[f64; 2]> {
    (confidence > 0.0 || u != 0.0 || v != 0.0).then_some([f64::from(u), f64::from(v)])
}

/// Similarity of a prediction to a labelled person, 0–1: mean over the labelled points of `exp(−d² / (2 s² k²))`, s²
/// the person's area, k twice the point's constant. A point that was not predicted scores 0.
///
/// Where labels span no area, as a single one does or several in one row, that of the prediction takes its place:
/// enough to know a guess at such a person as one.
///
/// For a person without labels that count, COCO takes the distance to twice the bounding box; so does this.
pub fn oks(truth: &TruthPerson, prediction: &Joints2d, set: JointSet) -> f64 {
    let counted = || truth.points.iter().filter(|k| set.holds(k));
    let labelled = counted().filter(|k| k.is_labelled()).count();
    let area = match truth.area > 0.0 || labelled == 0 {
        true => truth.area,
        false => area_of(prediction),
    };
    let area = area + f64::EPSILON;
    let [x, y, w, h] = truth.bbox;
    let (mut sum, mut n) = (0.0, 0.0_f64);
    for k in counted() {
        if labelled > 0 && !k.is_labelled() {
            continue;
        }
        n += 1.0;
        let Some(j) = k.joint else { continue };
        let Some([u, v]) = predicted(prediction[j]) else {
            continue;
        };
        let (dx, dy) = if labelled > 0 {
            (u - k.u, v - k.v)
        } else {
            let outside = |p: f64, low: f64, size: f64| {
                (low - size - p).max(0.0) + (p - (low + 2.0 * size)).max(0.0)
            };
            (outside(u, x, w), outside(v, y, h))
        };
        let variance = (2.0 * SIGMAS[j]).powi(2);
        sum += (-(dx * dx + dy * dy) / variance / area / 2.0).exp();
    }
    sum / n.max(1.0)
}

/// Area of a predicted person, square pixels.
fn area_of(prediction: &Joints2d) -> f64 {
    let joints = prediction.iter().enumerate();
    let known = joints.filter_map(|(j, p)| predicted(*p).map(|[u, v]| Keypoint::at(j, u, v, 2)));
    let [_, _, w, h] = bounding_box(&known.collect::<Vec<_>>());
    AREA_OF_BOX * w * h
}

/// Weight of people to be ignored in a matching: they get no prediction that makes any difference to somebody who
/// counts.
const IGNORED_WEIGHT: f64 = 1e-6;

/// Similarities in one picture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ImageOks {
    /// Score of every prediction.
    pub scores: Vec<f64>,
    /// Per person of the truth: whether it is to be ignored (a crowd, no label that counts, or labels that span no
    /// area).
    pub ignored: Vec<bool>,
    /// Per person of the truth: whether any number of predictions may match it.
    pub crowd: Vec<bool>,
    /// `[prediction][person]`.
    pub oks: Vec<Vec<f64>>,
    /// Per prediction: whether it is neither right nor wrong where it is nobody's.
    pub excused: Vec<bool>,
}

impl ImageOks {
    /// Compares every prediction with every person.
    pub fn new(truth: &[TruthPerson], predicted: &[(f64, Joints2d)], set: JointSet) -> Self {
        // Without an area nothing says how near is near enough. A floor of one square pixel would ask for joints that
        // are right to a fifth of a pixel, and so call everybody missed all the same.
        let counts = |t: &TruthPerson| {
            t.area > 0.0 && t.points.iter().any(|k| set.holds(k) && k.is_labelled())
        };
        Self {
            scores: predicted.iter().map(|(s, _)| *s).collect(),
            ignored: truth.iter().map(|t| t.crowd || !counts(t)).collect(),
            crowd: truth.iter().map(|t| t.crowd).collect(),
            oks: predicted
                .iter()
                .map(|(_, p)| truth.iter().map(|t| oks(t, p, set)).collect())
                .collect(),
            excused: predicted.iter().map(|(_, p)| beyond(truth, p)).collect(),
        }
    }

    /// Scores for a matching of greatest total, row-major `[prediction][person]`: OKS, 0 where it is below `least`.
    /// People who count come first, as in COCO's protocol: whoever is near the box of a person without labels, or in a
    /// crowd's, is as similar to it as can be, and that says nothing.
    pub(super) fn matching_scores(&self, least: f64) -> Vec<f32> {
        let score = |(oks, ignored): (&f64, &bool)| match (*oks >= least, ignored) {
            (false, _) => 0.0,
            (true, false) => *oks as f32,
            (true, true) => (IGNORED_WEIGHT * oks) as f32,
        };
        let rows = self.oks.iter();
        rows.flat_map(|row| row.iter().zip(&self.ignored).map(score))
            .collect()
    }
}

/// Whether the middle of a prediction lies on somebody of whom no joint is in the picture.
fn beyond(truth: &[TruthPerson], prediction: &Joints2d) -> bool {
    let seen: Vec<[f64; 2]> = prediction.iter().filter_map(|j| predicted(*j)).collect();
    let n = seen.len().max(1) as f64;
    let [u, v] = [0, 1].map(|i| seen.iter().map(|p| p[i]).sum::<f64>() / n);
    let mut boxes = truth.iter().filter_map(|t| t.beyond);
    boxes.any(|[x, y, w, h]| (x..=x + w).contains(&u) && (y..=y + h).contains(&v))
}

/// COCO's summary. −1 where the truth holds nobody, as in pycocotools.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AveragePrecision {
    /// Mean over OKS thresholds 0.50:0.05:0.95.
    pub ap: f64,
    /// At OKS 0.50.
    pub ap50: f64,
    /// At OKS 0.75.
    pub ap75: f64,
    /// Mean recall over the thresholds.
    pub ar: f64,
    /// Recall at OKS 0.50.
    pub ar50: f64,
    /// People of the truth that count.
    pub people: usize,
}

/// Predictions a picture that COCO looks at, best first.
const MAX_DETECTIONS: usize = 20;

/// Average precision and recall over pictures, in COCO's protocol: at each threshold predictions claim people greedily
/// by score; precision is interpolated at 101 recalls.
pub fn average_precision(images: &[ImageOks]) -> AveragePrecision {
    let thresholds: Vec<f64> = (0..10).map(|i| 0.5 + 0.05 * f64::from(i)).collect();
    let people = images
        .iter()
        .flat_map(|i| &i.ignored)
        .filter(|ignored| !**ignored)
        .count();
    let (precision, recall): (Vec<f64>, Vec<f64>) = thresholds
        .iter()
        .map(|&t| at_threshold(images, t, people))
        .unzip();
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    AveragePrecision {
        ap: mean(&precision),
        ap50: precision[0],
        ap75: precision[5],
        ar: mean(&recall),
        ar50: recall[0],
        people,
    }
}

/// Interpolated precision and greatest recall at one threshold.
fn at_threshold(images: &[ImageOks], threshold: f64, people: usize) -> (f64, f64) {
    if people == 0 {
        return (-1.0, -1.0);
    }
    // (score, right) of every prediction that counts.
    let mut claims: Vec<(f64, bool)> = Vec::new();
    for image in images {
        claims.extend(claim(image, threshold));
    }
    claims.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (mut right, mut curve) = (0.0, Vec::with_capacity(claims.len()));
    for (k, (_, hit)) in claims.iter().enumerate() {
        right += f64::from(u8::from(*hit));
        curve.push((right / people as f64, right / (k + 1) as f64));
    }
    for k in (1..curve.len()).rev() {
        curve[k - 1].1 = curve[k - 1].1.max(curve[k].1);
    }
    let recall = curve.last().map_or(0.0, |c| c.0);
    let mut sum = 0.0;
    for step in 0..=100 {
        let wanted = f64::from(step) * 0.01;
        let k = curve.partition_point(|c| c.0 < wanted);
        sum += curve.get(k).map_or(0.0, |c| c.1);
    }
    (sum / 101.0, recall)
}

/// Which predictions of a picture are right; those that fall on an ignored person are left out.
fn claim(image: &ImageOks, threshold: f64) -> Vec<(f64, bool)> {
    let mut predictions: Vec<usize> = (0..image.scores.len()).collect();
    predictions.sort_by(|&a, &b| image.scores[b].total_cmp(&image.scores[a]));
    predictions.truncate(MAX_DETECTIONS);
    // People that count come first.
    let mut order: Vec<usize> = (0..image.ignored.len()).collect();
    order.sort_by_key(|&g| image.ignored[g]);
    let mut taken = vec![false; order.len()];
    let mut out = Vec::new();
    for d in predictions {
        let mut best = threshold.min(1.0 - 1e-10);
        let mut chosen: Option<usize> = None;
        for &g in &order {
            if taken[g] && !image.crowd[g] {
                continue;
            }
            if chosen.is_some_and(|c| !image.ignored[c]) && image.ignored[g] {
                break;
            }
            if image.oks[d][g] >= best {
                best = image.oks[d][g];
                chosen = Some(g);
            }
        }
        if let Some(g) = chosen {
            taken[g] = true;
            if image.ignored[g] {
                continue;
            }
        } else if image.excused[d] {
            continue;
        }
        out.push((image.scores[d], chosen.is_some()));
    }
    out
}
