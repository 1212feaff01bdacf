//! What is measured against the truth: identities, joint errors, jitter, lag, confidence, limits.

use std::collections::BTreeMap;

use edgecap::assignment::assign;
use edgecap::body::skeleton::Skeleton;
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::{ANKLES, BODY_JOINTS, PELVIS};
use edgecap::message::{Body, BodyFrame, ObservationFrame};
use glam::DVec3;

use super::{Scene, Truth};

/// Mean and count.
#[derive(Debug, Clone, Copy, Default)]
pub struct Mean {
    pub sum: f64,
    pub n: f64,
}

impl Mean {
    pub fn add(&mut self, v: f64) {
        self.sum += v;
        self.n += 1.0;
    }
    pub fn merge(&mut self, other: Self) {
        self.sum += other.sum;
        self.n += other.n;
    }
    pub fn get(&self) -> f64 {
        self.sum / self.n.max(1.0)
    }
}

#[derive(Default)]
pub struct Report {
    /// Root-relative joint errors at the true height, metres: Stage II, Stage III; by joint, [visible, occluded].
    pub stage2: [[Mean; 2]; BODY_JOINTS],
    pub stage3: [[Mean; 2]; BODY_JOINTS],
    /// Joints of people not seen in the frame.
    pub predicted: Mean,
    /// Root-relative accelerations, m/s².
    pub jitter2: Mean,
    pub jitter3: Mean,
    pub jitter_truth: Mean,
    /// Errors against the truth `k` tenths of a frame ago.
    pub lag2: [Mean; 31],
    pub lag3: [Mean; 31],
    /// |Δz| / z of the root.
    pub depth: Mean,
    /// The same had the height been known.
    pub depth_known: Mean,
    /// Root error in space, metres.
    pub root: Mean,
    /// The same had the height been known.
    pub root_known: Mean,
    /// Bodies whose root is near no truth.
    pub false_bodies: u64,
    pub bodies: u64,
    pub detectable: u64,
    pub matched: u64,
    pub switches: u64,
    pub idf1: f64,
    pub ids: usize,
    /// Greatest excess over a limit, degrees.
    pub beyond: f64,
    /// Speed of ankles that stand still in truth, m/s.
    pub sliding2: Mean,
    pub sliding3: Mean,
    pub finite: bool,
}

impl Report {
    /// Adds another scene's sums; identities are not merged.
    pub fn merge(&mut self, other: &Self) {
        for j in 0..BODY_JOINTS {
            for h in 0..2 {
                self.stage2[j][h].merge(other.stage2[j][h]);
                self.stage3[j][h].merge(other.stage3[j][h]);
            }
        }
        for k in 0..31 {
            self.lag2[k].merge(other.lag2[k]);
            self.lag3[k].merge(other.lag3[k]);
        }
        for (a, b) in [
            (&mut self.predicted, other.predicted),
            (&mut self.jitter2, other.jitter2),
            (&mut self.jitter3, other.jitter3),
            (&mut self.sliding2, other.sliding2),
            (&mut self.sliding3, other.sliding3),
            (&mut self.depth_known, other.depth_known),
            (&mut self.root_known, other.root_known),
        ] {
            a.merge(b);
        }
    }
    pub fn mpjpe2(&self) -> f64 {
        all(&self.stage2, None)
    }
    pub fn mpjpe3(&self) -> f64 {
        all(&self.stage3, None)
    }
    pub fn lag_frames(lags: &[Mean; 31]) -> f64 {
        let best = (0..31).min_by(|&a, &b| lags[a].get().total_cmp(&lags[b].get()));
        (best.unwrap_or(10) as f64 - 10.0) / 10.0
    }
}

/// Mean over joints (without the pelvis), visible (0), occluded (1) or both.
pub fn all(errors: &[[Mean; 2]; BODY_JOINTS], which: Option<usize>) -> f64 {
    let mut m = Mean::default();
    for (j, e) in errors.iter().enumerate() {
        if j != PELVIS {
            for (i, part) in e.iter().enumerate() {
                if which.is_none_or(|w| w == i) {
                    m.sum += part.sum;
                    m.n += part.n;
                }
            }
        }
    }
    m.get()
}

fn root_relative(points: &[DVec3; BODY_JOINTS]) -> [DVec3; BODY_JOINTS] {
    points.map(|p| p - points[PELVIS])
}

fn body_joints(body: &Body) -> [DVec3; BODY_JOINTS] {
    body.joints3d.map(|p| DVec3::from(p.map(f64::from)))
}

/// Farthest that a body may be from the person it stands for, mean over joints, metres at the person's distance.
const NEAR: f64 = 0.3;

type History = BTreeMap<usize, Vec<Option<[DVec3; BODY_JOINTS]>>>;

/// Runs a scene through a fitter. `lag`: also measure lag (slower).
pub fn run(scene: &mut Scene, config: FitConfig, frames: u64, warm_up: u64, lag: bool) -> Report {
    let mut fitter = Fitter::new(config).expect("valid settings");
    let mut report = Report {
        finite: true,
        ..Report::default()
    };
    let mut out = BodyFrame::default();
    let (mut past2, mut past3, mut past_truth): (History, History, History) = Default::default();
    let mut pairs: BTreeMap<(usize, u32), u64> = BTreeMap::new();
    let mut last_id: BTreeMap<usize, u32> = BTreeMap::new();
    let mut ids = std::collections::BTreeSet::new();
    let mut stood: BTreeMap<(usize, usize), (u64, DVec3, Option<DVec3>)> = BTreeMap::new();
    let (mut truth_count, mut body_count) = (0u64, 0u64);
    for f in 0..frames {
        let (frame, truths) = scene.next();
        fitter.update(&frame, &mut out);
        check_finite(&out, &mut report);
        limits(&out, &mut report);
        for b in out.bodies() {
            ids.insert(b.id);
        }
        let matches = match_bodies(&truths, &out, &last_id);
        // Identity counts everybody who can be seen and every body that is shown.
        for (i, truth) in truths.iter().enumerate() {
            if truth.detectable {
                truth_count += 1;
                if let Some(b) = matches[i] {
                    let id = out.bodies[b].id;
                    *pairs.entry((truth.person, id)).or_default() += 1;
                    if last_id
                        .insert(truth.person, id)
                        .is_some_and(|last| last != id)
                    {
                        report.switches += 1;
                    }
                }
            }
        }
        for (b, body) in out.bodies().iter().enumerate() {
            let owner = matches.iter().position(|m| *m == Some(b));
            // Somebody just hidden is no false body.
            if owner.is_none_or(|i| truths[i].detectable) {
                body_count += 1;
            }
            report.bodies += 1;
            report.false_bodies += u64::from(owner.is_none());
            let _ = body;
        }
        let time = scene.time(f);
        for (i, truth) in truths.iter().enumerate() {
            report.detectable += u64::from(truth.detectable);
            let stage2 = truth.observation.map(|o| observed(&frame, o, truth));
            let body = matches[i].map(|b| &out.bodies[b]);
            let stage3 = body.map(|b| {
                let grow = truth.height / f64::from(b.height);
                root_relative(&body_joints(b)).map(|p| p * grow)
            });
            report.matched += u64::from(truth.detectable && body.is_some());
            past2.entry(truth.person).or_default().push(stage2);
            past3.entry(truth.person).or_default().push(stage3);
            past_truth
                .entry(truth.person)
                .or_default()
                .push(Some(root_relative(&truth.joints)));
            let (Some(body), Some(stage3)) = (body, stage3) else {
                continue;
            };
            if f < warm_up {
                continue;
            }
            let wanted = root_relative(&truth.joints);
            match stage2 {
                Some(stage2) => {
                    for j in 0..BODY_JOINTS {
                        let through = super::SEEN_THROUGH[j];
                        let hidden = usize::from(
                            frame.people[truth.observation.unwrap()].joints2d[through][2] == 0.0
                                || (truth.counter.is_some() && super::LEGS.contains(&through)),
                        );
                        report.stage2[j][hidden].add((stage2[j] - wanted[j]).length());
                        report.stage3[j][hidden].add((stage3[j] - wanted[j]).length());
                    }
                    let z = truth.joints[PELVIS].z;
                    report
                        .depth
                        .add((f64::from(body.position[2]) - z).abs() / z);
                    let known = f64::from(body.position[2]) * truth.height / f64::from(body.height);
                    report.depth_known.add((known - z).abs() / z);
                    let place = DVec3::from(body.position.map(f64::from));
                    report.root.add((place - truth.joints[PELVIS]).length());
                    let known = place * truth.height / f64::from(body.height);
                    report
                        .root_known
                        .add((known - truth.joints[PELVIS]).length());
                }
                None => {
                    for j in (0..BODY_JOINTS).filter(|&j| j != PELVIS) {
                        report.predicted.add((stage3[j] - wanted[j]).length());
                    }
                }
            }
            if lag && let Some(stage2) = stage2 {
                for k in 0..31 {
                    let ago = time - (f64::from(k) - 10.0) / 10.0 / scene.fps;
                    let (_, joints) = scene.people[truth.person].at(ago);
                    let then = root_relative(&joints);
                    for j in (0..BODY_JOINTS).filter(|&j| j != PELVIS) {
                        report.lag2[k as usize].add((stage2[j] - then[j]).length_squared());
                        report.lag3[k as usize].add((stage3[j] - then[j]).length_squared());
                    }
                }
            }
            let (_, before) = scene.people[truth.person].at(time - 0.1);
            let (_, after) = scene.people[truth.person].at(time + 0.1);
            for ankle in ANKLES {
                let still = (after[ankle] - before[ankle]).length() < 0.004;
                if !still {
                    continue;
                }
                // In space: Stage II's joints hang on the true pelvis, ours on our own.
                let place = DVec3::from(body.position.map(f64::from)) * truth.height
                    / f64::from(body.height);
                let now3 = place + stage3[ankle];
                let now2 = stage2.map(|s| truth.joints[PELVIS] + s[ankle]);
                let key = (truth.person, ankle);
                if let Some((then, p3, p2)) = stood.insert(key, (f, now3, now2))
                    && then + 1 == f
                {
                    report.sliding3.add((now3 - p3).length() * scene.fps);
                    if let (Some(a), Some(b)) = (now2, p2) {
                        report.sliding2.add((a - b).length() * scene.fps);
                    }
                }
            }
        }
    }
    for (past, jitter) in [
        (&past2, &mut report.jitter2),
        (&past3, &mut report.jitter3),
        (&past_truth, &mut report.jitter_truth),
    ] {
        for (person, series) in past {
            // The same moments for all three.
            for f in warm_up as usize..series.len().saturating_sub(2) {
                let complete = (0..3)
                    .all(|k| past2[person][f + k].is_some() && past3[person][f + k].is_some());
                if !complete {
                    continue;
                }
                let [a, b, c] = std::array::from_fn(|k| series[f + k].unwrap());
                for j in (0..BODY_JOINTS).filter(|&j| j != PELVIS) {
                    jitter.add((a[j] - 2.0 * b[j] + c[j]).length() * scene.fps * scene.fps);
                }
            }
        }
    }
    report.idf1 = idf1(&pairs, truth_count, body_count);
    report.ids = ids.len();
    report
}

fn observed(frame: &ObservationFrame, slot: usize, truth: &Truth) -> [DVec3; BODY_JOINTS] {
    let scale = truth.height / 1.70;
    root_relative(
        &frame.people[slot]
            .joints3d
            .map(|p| DVec3::from(p.map(f64::from)) * scale),
    )
}

/// Body of every truth: nearest in the picture, within 0.3 m at the person's distance. As in CLEAR MOT, a body that is
/// still near the person whom it followed in the last frame (`last`) stays with that person.
pub fn match_bodies(
    truths: &[Truth],
    out: &BodyFrame,
    last: &BTreeMap<usize, u32>,
) -> Vec<Option<usize>> {
    let bodies = out.bodies();
    let mut costs = Vec::new();
    for truth in truths {
        for body in bodies {
            let joints = body_joints(body);
            let mut m = Mean::default();
            for j in 0..BODY_JOINTS {
                let (a, b) = (truth.joints[j], joints[j]);
                if a.z > 0.3 && b.z > 0.3 {
                    m.add((a.truncate() / a.z - b.truncate() / b.z).length() * a.z);
                }
            }
            let apart = if m.n > 0.0 { m.get() } else { f64::INFINITY };
            let stays = apart <= NEAR && last.get(&truth.person) == Some(&body.id);
            costs.push(if stays { apart - NEAR } else { apart });
        }
    }
    assign(&costs, truths.len(), bodies.len(), NEAR)
}

/// Best assignment of identities to people over the whole scene.
fn idf1(pairs: &BTreeMap<(usize, u32), u64>, truths: u64, bodies: u64) -> f64 {
    let people: Vec<usize> = dedup(pairs.keys().map(|k| k.0));
    let ids: Vec<u32> = dedup(pairs.keys().map(|k| k.1));
    let most = pairs.values().copied().max().unwrap_or(0) as f64;
    let mut costs = Vec::new();
    for p in &people {
        for id in &ids {
            let n = pairs.get(&(*p, *id)).copied().unwrap_or(0) as f64;
            costs.push(most - n);
        }
    }
    let found = assign(&costs, people.len(), ids.len(), 4.0 * most + 1.0);
    let together: u64 = found
        .iter()
        .enumerate()
        .filter_map(|(p, id)| pairs.get(&(people[p], ids[(*id)?])))
        .sum();
    2.0 * together as f64 / (truths + bodies).max(1) as f64
}

fn dedup<T: Ord>(values: impl Iterator<Item = T>) -> Vec<T> {
    values
        .collect::<std::collections::BTreeSet<T>>()
        .into_iter()
        .collect()
}

pub fn limits(out: &BodyFrame, report: &mut Report) {
    for body in out.bodies() {
        for (k, dof) in Skeleton::builtin().angles().iter().enumerate() {
            let a = f64::from(body.angles[6 + k]);
            let beyond = (a - dof.limits[1]).max(dof.limits[0] - a);
            report.beyond = report.beyond.max(beyond.to_degrees());
        }
    }
}

/// Whether every number of every body is finite.
pub fn is_finite(out: &BodyFrame) -> bool {
    let world = out.world.rotation.iter().chain(&out.world.translation);
    let mut world = world.copied();
    world.all(f32::is_finite)
        && out.bodies().iter().all(|b| {
            b.score.is_finite()
                && b.height.is_finite()
                && b.position
                    .iter()
                    .chain(&b.orientation)
                    .chain(&b.velocity)
                    .all(|v| v.is_finite())
                && b.angles
                    .iter()
                    .chain(&b.confidence)
                    .chain(&b.bone_lengths)
                    .all(|v| v.is_finite())
                && b.joints3d.iter().flatten().all(|v| v.is_finite())
                && b.joints2d.iter().flatten().all(|v| v.is_finite())
                && b.bone_rotations.iter().flatten().all(|v| v.is_finite())
        })
}

fn check_finite(out: &BodyFrame, report: &mut Report) {
    report.finite &= is_finite(out);
}

/// One line of figures.
pub fn line(name: &str, r: &Report) -> String {
    format!(
        "{name:<26} II {:5.1}  III {:5.1} (seen {:5.1} hidden {:5.1} missed {:5.1}) mm  jitter {:5.1} → {:4.1} (truth {:3.1})  lag {:+.1}  depth {:4.1} % ({:3.1} % known)  root {:4.0} mm  slide {:.2} → {:.2}  switches {} IDF1 {:.3} ids {} false {} beyond {:.1}°",
        1e3 * r.mpjpe2(),
        1e3 * r.mpjpe3(),
        1e3 * all(&r.stage3, Some(0)),
        1e3 * all(&r.stage3, Some(1)),
        1e3 * r.predicted.get(),
        r.jitter2.get(),
        r.jitter3.get(),
        r.jitter_truth.get(),
        Report::lag_frames(&r.lag3) - Report::lag_frames(&r.lag2),
        100.0 * r.depth.get(),
        100.0 * r.depth_known.get(),
        1e3 * r.root.get(),
        r.sliding2.get(),
        r.sliding3.get(),
        r.switches,
        r.idf1,
        r.ids,
        r.false_bodies,
        r.beyond,
    )
}
