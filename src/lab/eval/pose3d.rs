//! Errors of 3D joints: MPJPE, N-MPJPE, PA-MPJPE, 3DPCK@150, AUC.

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS, PELVIS};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

use super::geometry::{Point, mean, minus, norm, plus};

/// Largest error that counts as correct, metres.
pub(crate) const CORRECT: f64 = 0.150;

/// Share of correct joints over thresholds 0, 5, … 150 mm.
pub(crate) fn area_under_curve(errors: &[f64]) -> f64 {
    let share = |t: f64| errors.iter().filter(|e| **e < t).count() as f64 / errors.len() as f64;
    let steps: Vec<f64> = (0..=30).map(|k| share(0.005 * f64::from(k))).collect();
    mean(&steps)
}

/// Share of errors below 150 mm.
pub(crate) fn correct(errors: &[f64]) -> f64 {
    errors.iter().filter(|e| **e < CORRECT).count() as f64 / errors.len() as f64
}

/// `from` moved, turned and scaled to lie as near as possible to `to` (least squares; reflections are not allowed).
/// Unchanged but for the translation when `from` has no extent.
pub fn align_similarity(from: &[[f64; 3]], to: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let n = from.len().max(1) as f64;
    let centre = |p: &[Point]| {
        let sum = p.iter().fold([0.0; 3], |s, q| plus(s, 1.0, *q));
        sum.map(|x| x / n)
    };
    let (a, b) = (centre(from), centre(to));
    let (mut covariance, mut spread) = (Matrix3::zeros(), 0.0);
    for (p, q) in from.iter().zip(to) {
        let (p, q) = (Vector3::from(minus(*p, a)), Vector3::from(minus(*q, b)));
        covariance += q * p.transpose();
        spread += p.norm_squared();
    }
    let svd = covariance.svd(true, true);
    let (Some(u), Some(vt)) = (svd.u, svd.v_t) else {
        return from.iter().map(|p| plus(minus(*p, a), 1.0, b)).collect();
    };
    let mut sign = Vector3::new(1.0, 1.0, 1.0);
    if (u * vt).determinant() < 0.0 {
        sign.z = -1.0;
    }
    let rotation = u * Matrix3::from_diagonal(&sign) * vt;
    let scale = if spread > 0.0 {
        svd.singular_values.component_mul(&sign).sum() / spread
    } else {
        1.0
    };
    let moved = |p: &Point| {
        let q = rotation * Vector3::from(minus(*p, a)) * scale;
        [q.x + b[0], q.y + b[1], q.z + b[2]]
    };
    from.iter().map(moved).collect()
}

/// Joint errors of one person, metres.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseErrors {
    /// Root-aligned.
    pub aligned: Vec<f64>,
    /// The same of the evidence joints alone, which are those of 3DPCK and AUC in MPI-INF-3DHP's own tool
    /// (`mpii_get_pck_auc_joint_groups`): head top, neck and limbs.
    pub evidence: Vec<f64>,
    /// Root-aligned, the prediction scaled about its pelvis as suits the truth best (least squares; Rhodin et al., CVPR
    /// 2018): what is left when somebody's size does not count.
    pub scaled: Vec<f64>,
    /// After similarity Procrustes.
    pub procrustes: Vec<f64>,
}

impl PoseErrors {
    /// Whether joints lie anywhere but all in one point, as where a file has zeros for want of truth.
    pub(super) fn has_extent(joints: &[Option<[f64; 3]>; BODY_JOINTS]) -> bool {
        let mut known = joints.iter().flatten();
        let first = known.next();
        known.any(|j| Some(j) != first)
    }

    /// Whether the truth tells enough to have errors: a pelvis, and four joints to turn and scale by, one of them an
    /// evidence joint, not all of them in one point.
    pub fn can_be(truth: &[Option<[f64; 3]>; BODY_JOINTS]) -> bool {
        let known = |joints: &[Option<[f64; 3]>]| joints.iter().flatten().count();
        let is_enough = known(truth) >= 4 && known(&truth[..EVIDENCE_JOINTS]) > 0;
        truth[PELVIS].is_some() && is_enough && Self::has_extent(truth)
    }

    /// Errors over the joints that the truth has, both sides relative to their pelvis. `None` where they
    /// [cannot be](Self::can_be).
    pub fn new(
        truth: &[Option<[f64; 3]>; BODY_JOINTS],
        predicted: &[[f64; 3]; BODY_JOINTS],
    ) -> Option<Self> {
        let root = truth[PELVIS].filter(|_| Self::can_be(truth))?;
        let (mut t, mut p) = (Vec::new(), Vec::new());
        for (truth, joint) in truth.iter().zip(predicted) {
            if let Some(truth) = truth {
                t.push(minus(*truth, root));
                p.push(minus(*joint, predicted[PELVIS]));
            }
        }
        let aligned = distances(&t, &p);
        // They come first in the order of the joints.
        let evidence = truth[..EVIDENCE_JOINTS].iter().flatten().count();
        Some(Self {
            evidence: aligned[..evidence].to_vec(),
            aligned,
            scaled: distances(&t, &scaled(&p, &t)),
            procrustes: distances(&t, &align_similarity(&p, &t)),
        })
    }
}

/// `from` scaled about the origin to lie as near as possible to `to`; unchanged where it has no extent.
fn scaled(from: &[Point], to: &[Point]) -> Vec<Point> {
    let dot = |a: &Point, b: &Point| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let spread: f64 = from.iter().map(|p| dot(p, p)).sum();
    let common: f64 = from.iter().zip(to).map(|(p, q)| dot(p, q)).sum();
    let scale = if spread > 0.0 { common / spread } else { 1.0 };
    from.iter().map(|p| p.map(|x| x * scale)).collect()
}

fn distances(a: &[Point], b: &[Point]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| norm(minus(*a, *b))).collect()
}

/// Errors over people.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pose3d {
    /// People with a prediction.
    pub people: usize,
    /// People of the truth with 3D joints, with or without a prediction.
    pub truth: usize,
    /// Joint errors of all of them together, pelvises included.
    pub joints: usize,
    /// Mean root-aligned joint error, millimetres.
    pub mpjpe_mm: f64,
    /// The same with prediction and truth each brought to 1.70 m by its own stature: observations and bodies are then
    /// asked the same, how well the pose is known; what a body's stature is wrong by does not count. Over people whose
    /// stature is known; `None` without any.
    pub canonical_mpjpe_mm: Option<f64>,
    /// The same with the prediction scaled to the truth's size (N-MPJPE).
    pub n_mpjpe_mm: f64,
    /// The same after similarity Procrustes.
    pub pa_mpjpe_mm: f64,
    /// Share of evidence joints within 150 mm, root-aligned.
    pub pck150: f64,
    /// Mean of that share over thresholds 0:5:150 mm.
    pub auc: f64,
    /// Mean distance of the pelvis in camera space, millimetres; only where predictions and truth are in camera space.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub root_mm: Option<f64>,
}

impl Pose3d {
    /// Pools the errors of `people` out of `truth` people, in the predictions' size and at `canonical` stature; `roots`
    /// are pelvis errors in metres. `None` when nobody was found.
    pub fn pool(
        people: &[PoseErrors],
        canonical: &[PoseErrors],
        truth: usize,
        roots: &[f64],
    ) -> Option<Self> {
        let aligned: Vec<f64> = people.iter().flat_map(|e| e.aligned.clone()).collect();
        let evidence: Vec<f64> = people.iter().flat_map(|e| e.evidence.clone()).collect();
        let same_size: Vec<f64> = canonical.iter().flat_map(|e| e.aligned.clone()).collect();
        let scaled: Vec<f64> = people.iter().flat_map(|e| e.scaled.clone()).collect();
        let turned: Vec<f64> = people.iter().flat_map(|e| e.procrustes.clone()).collect();
        (!aligned.is_empty()).then(|| Self {
            people: people.len(),
            truth,
            joints: aligned.len(),
            mpjpe_mm: 1e3 * mean(&aligned),
            canonical_mpjpe_mm: (!same_size.is_empty()).then(|| 1e3 * mean(&same_size)),
            n_mpjpe_mm: 1e3 * mean(&scaled),
            pa_mpjpe_mm: 1e3 * mean(&turned),
            pck150: correct(&evidence),
            auc: area_under_curve(&evidence),
            root_mm: (!roots.is_empty()).then(|| 1e3 * mean(roots)),
        })
    }
}
