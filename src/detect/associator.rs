//! Peaks and limbs go in, people come out.

use edgecap_client::joints::{
    EVIDENCE_JOINTS, HEAD_TOP, L_ANKLE, L_ELBOW, L_HIP, L_KNEE, L_SHOULDER, L_WRIST, LIMB_JOINTS,
    LIMBS, R_ANKLE, R_ELBOW, R_HIP, R_KNEE, R_SHOULDER, R_WRIST, limb_to,
};

use super::limb;
use super::peaks::Peaks;
use super::person::Person;
use super::{AssociationConfig, Detection};
use crate::assignment::Matcher;
use crate::engine::{HEAD2D_CHANNELS, HEAD3D_CHANNELS, Maps};

/// Limbs by their distance from the neck: trunk before limbs, so that a person's size is known when arms and legs are
/// added.
const OUTWARDS: [usize; LIMBS] = [
    limb_to(HEAD_TOP),
    limb_to(R_SHOULDER),
    limb_to(L_SHOULDER),
    limb_to(R_HIP),
    limb_to(L_HIP),
    limb_to(R_ELBOW),
    limb_to(L_ELBOW),
    limb_to(R_KNEE),
    limb_to(L_KNEE),
    limb_to(R_WRIST),
    limb_to(L_WRIST),
    limb_to(R_ANKLE),
    limb_to(L_ANKLE),
];
/// How many of [`OUTWARDS`] end at the neck.
const AT_NECK: usize = 5;
/// The two limbs of each arm and leg, outwards.
const CHAINS: [[usize; 2]; 4] = [
    [limb_to(R_ELBOW), limb_to(R_WRIST)],
    [limb_to(L_ELBOW), limb_to(L_WRIST)],
    [limb_to(R_KNEE), limb_to(R_ANKLE)],
    [limb_to(L_KNEE), limb_to(L_ANKLE)],
];
/// Weight of the child's confidence beside the limb's score.
const CONFIDENCE_WEIGHT: f32 = 0.1;
/// What is left of a pair that the lengths speak against: it still counts for more than none.
const LEAST_SCORE: f32 = 1e-3;

/// Groups the joints of [`Maps`] into people, over the tree of limbs rooted at the neck; XNect §4.1.1, Cao et al. 2017.
///
/// Each limb is assigned to all people at once, optimally: choosing the best pair first can leave a neighbour without a
/// limb that both could have had. Nothing is allocated once the largest scene has been seen.
#[derive(Debug, Clone)]
pub struct Associator {
    config: AssociationConfig,
    peaks: Peaks,
    people: Vec<Person>,
    scores: Vec<f32>,
    matcher: Matcher,
    claimed: [Vec<bool>; EVIDENCE_JOINTS],
    carried: Vec<bool>,
    detections: Vec<Detection>,
    found: usize,
    without_neck: u32,
}

impl Associator {
    /// An associator with these settings.
    pub fn new(config: AssociationConfig) -> Self {
        Self {
            config,
            peaks: Peaks::default(),
            people: Vec::new(),
            scores: Vec::new(),
            matcher: Matcher::default(),
            claimed: Default::default(),
            carried: Vec::new(),
            detections: Vec::new(),
            found: 0,
            without_neck: 0,
        }
    }

    /// The settings.
    pub fn config(&self) -> &AssociationConfig {
        &self.config
    }

    /// People whose neck was not found in the last maps and who were therefore left out: the greatest number of whole
    /// arms, or of whole legs, of one side that no person has.
    pub fn without_neck(&self) -> u32 {
        self.without_neck
    }

    /// The people of the last maps, best first.
    pub fn found(&self) -> &[Detection] {
        &self.detections[..self.found]
    }

    /// The people of `maps`, best first. Values that are not finite count as no evidence.
    ///
    /// # Panics
    /// If the lengths in `maps` do not match its width and height.
    pub fn associate(&mut self, maps: &Maps) -> &[Detection] {
        let cells = maps.width * maps.height;
        assert_eq!(maps.head2d.len(), cells * HEAD2D_CHANNELS, "2D maps");
        assert_eq!(maps.head3d.len(), cells * HEAD3D_CHANNELS, "3D maps");
        self.peaks.find(maps, &self.config);
        self.people.clear();
        let necks = self.peaks.of(edgecap_client::joints::NECK).len();
        self.people.extend((0..necks).map(Person::from_neck));
        for (step, &limb) in OUTWARDS.iter().enumerate() {
            if step == AT_NECK {
                for person in &mut self.people {
                    person.drop_absurd_trunk(self.config.absurd_length);
                }
            }
            self.assign(maps, limb);
        }
        self.merge();
        self.count_without_neck(maps);
        self.report(maps);
        self.found()
    }

    /// Gives every person the child of `limb` that makes all people together most likely.
    fn assign(&mut self, maps: &Maps, limb: usize) {
        let (child, parent) = LIMB_JOINTS[limb];
        let children = self.peaks.of(child);
        let people = self.people.len();
        self.scores.clear();
        for c in children {
            for person in &self.people {
                let score = person.peak[parent].and_then(|k| {
                    let p = &self.peaks.of(parent)[k];
                    let long = limb::length(c, p);
                    if person.is_absurd(limb, long, self.config.absurd_length) {
                        return None;
                    }
                    let field = limb::score(maps, limb, c, p, &self.config)?;
                    let total = field + CONFIDENCE_WEIGHT * c.score.min(1.0)
                        - self.config.length_weight * person.oddity(limb, long);
                    Some(total.max(LEAST_SCORE))
                });
                self.scores.push(score.unwrap_or(0.0));
            }
        }
        let pairs = self.matcher.solve(children.len(), people, &self.scores);
        for (c, person) in pairs.iter().enumerate() {
            if let Some(person) = *person {
                let person_mut = &mut self.people[person];
                let Some(k) = person_mut.peak[parent] else {
                    continue;
                };
                let (child, parent) = (&children[c], &self.peaks.of(parent)[k]);
                let field = limb::score(maps, limb, child, parent, &self.config);
                person_mut.attach(limb, c, field.unwrap_or(0.0), limb::length(child, parent));
            }
        }
    }

    /// Joins people found twice; the one with more joints takes over the rest of the other.
    fn merge(&mut self) {
        let mut i = 0;
        while i < self.people.len() {
            let mut j = i + 1;
            while j < self.people.len() {
                let (a, b) = (&self.people[i], &self.people[j]);
                if a.is_same(b, &self.peaks, self.config.merge_distance) {
                    let mut other = self.people.swap_remove(j);
                    let kept = &mut self.people[i];
                    if other.joints() > kept.joints() {
                        std::mem::swap(kept, &mut other);
                    }
                    kept.absorb(&other);
                } else {
                    j += 1;
                }
            }
            i += 1;
        }
    }

    /// Counts arms and legs that nobody claimed.
    fn count_without_neck(&mut self, maps: &Maps) {
        for (j, claimed) in self.claimed.iter_mut().enumerate() {
            claimed.clear();
            claimed.resize(self.peaks.of(j).len(), false);
            for k in self.people.iter().filter_map(|p| p.peak[j]) {
                claimed[k] = true;
            }
        }
        self.without_neck = 0;
        for chain in CHAINS {
            let root = LIMB_JOINTS[chain[0]].1;
            self.carried.clear();
            self.carried.extend(self.claimed[root].iter().map(|c| !c));
            for limb in chain {
                let (child, parent) = LIMB_JOINTS[limb];
                let (children, parents) = (self.peaks.of(child), self.peaks.of(parent));
                self.scores.clear();
                for (c, claimed) in children.iter().zip(&self.claimed[child]) {
                    for (p, carried) in parents.iter().zip(&self.carried) {
                        let score = (!claimed && *carried)
                            .then(|| limb::score(maps, limb, c, p, &self.config))
                            .flatten();
                        self.scores.push(score.unwrap_or(0.0));
                    }
                }
                let pairs = self
                    .matcher
                    .solve(children.len(), parents.len(), &self.scores);
                self.carried.clear();
                self.carried.extend(pairs.iter().map(Option::is_some));
            }
            let whole = self.carried.iter().filter(|c| **c).count() as u32;
            self.without_neck = self.without_neck.max(whole);
        }
    }

    /// Fills the detections from the people that have enough evidence.
    fn report(&mut self, maps: &Maps) {
        let (config, peaks) = (&self.config, &self.peaks);
        self.people.retain_mut(|p| {
            p.score = config
                .score
                .expected(&p.confidences(peaks), &p.limb_scores());
            p.joints() >= config.min_joints.max(1)
                && p.stature() * Maps::STRIDE as f32 >= config.min_stature
                && p.score >= config.min_score
        });
        self.people
            .sort_unstable_by(|a, b| b.score.total_cmp(&a.score));
        self.people.truncate(config.max_people);
        self.found = self.people.len();
        while self.detections.len() < self.found {
            self.detections.push(Detection {
                joints: [[0.0; 3]; EVIDENCE_JOINTS],
                confidence: [0.0; EVIDENCE_JOINTS],
                encodings: [[0.0; HEAD3D_CHANNELS]; EVIDENCE_JOINTS],
                limbs: [0.0; LIMBS],
                score: 0.0,
            });
        }
        for (person, d) in self.people.iter().zip(&mut self.detections) {
            d.joints = [[0.0; 3]; EVIDENCE_JOINTS];
            d.encodings = [[0.0; HEAD3D_CHANNELS]; EVIDENCE_JOINTS];
            d.limbs = person.limb_scores();
            d.score = config.confidence.person(person.score);
            for (j, peak) in person.chosen(peaks) {
                let centre = 0.5 * (Maps::STRIDE as f32 - 1.0);
                d.joints[j] = [
                    Maps::STRIDE as f32 * peak.x + centre,
                    Maps::STRIDE as f32 * peak.y + centre,
                    peak.score.min(1.0),
                ];
                let read = &maps.head3d[peak.cell * HEAD3D_CHANNELS..][..HEAD3D_CHANNELS];
                for (to, from) in d.encodings[j].iter_mut().zip(read) {
                    *to = if from.is_finite() { *from } else { 0.0 };
                }
            }
            d.confidence = config.confidence.joints(&d.joints);
        }
    }
}
