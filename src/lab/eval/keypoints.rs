//! Labelled points of a person in a picture, in whatever joint set a public format has.

use serde::Serialize;

/// One labelled point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keypoint {
    /// The evidence joint it is; `None` for points that the detector does not know (eyes, ears, nose, toes).
    pub joint: Option<usize>,
    /// Pixels of the original picture.
    pub u: f64,
    /// Pixels of the original picture.
    pub v: f64,
    /// 0 not labelled, 1 labelled but hidden, 2 visible.
    pub visibility: u8,
}

impl Keypoint {
    /// A point at an evidence joint.
    pub fn at(joint: usize, u: f64, v: f64, visibility: u8) -> Self {
        Self {
            joint: Some(joint),
            u,
            v,
            visibility,
        }
    }

    /// Whether the point was labelled.
    pub fn is_labelled(&self) -> bool {
        self.visibility > 0
    }
}

/// COCO's constants k / 2 of the evidence joints (head and neck: CrowdPose's): standard deviation of annotators over
/// the root of the person's area.
pub const SIGMAS: [f64; 14] = [
    0.079, 0.079, 0.079, 0.072, 0.062, 0.079, 0.072, 0.062, 0.107, 0.087, 0.089, 0.107, 0.087,
    0.089,
];

/// Which points count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum JointSet {
    /// The 12 joints that COCO and the evidence joints share: shoulders, elbows, wrists, hips, knees, ankles.
    #[default]
    Shared,
    /// Whatever of the 14 evidence joints the truth labels.
    Evidence,
    /// Everything the truth labels; points that the detector does not know count as wrong.
    All,
}

impl JointSet {
    /// Whether a point counts.
    pub fn holds(self, k: &Keypoint) -> bool {
        match self {
            JointSet::Shared => k.joint.is_some_and(|j| j >= 2),
            JointSet::Evidence => k.joint.is_some(),
            JointSet::All => true,
        }
    }
}

/// x, y, width, height of the labelled points; zeros without any.
pub fn bounding_box(points: &[Keypoint]) -> [f64; 4] {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for k in points.iter().filter(|k| k.is_labelled()) {
        for (i, x) in [k.u, k.v].into_iter().enumerate() {
            low[i] = low[i].min(x);
            high[i] = high[i].max(x);
        }
    }
    if low[0] > high[0] {
        return [0.0; 4];
    }
    [low[0], low[1], high[0] - low[0], high[1] - low[1]]
}
