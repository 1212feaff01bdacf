//! The schema: everything that a message holds, by name. Metres and radians in camera axes, pixels of the original
//! picture, quaternions xyzw, nanoseconds.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::joints::{BODY_JOINTS, DOF, EVIDENCE_JOINTS};
use crate::message::{
    APPEARANCE_BINS, Body, BodyFrame, BodyState, HUMANOID_BONE_COUNT, Intrinsics, JointState,
    MAX_PEOPLE, Observation, ObservationFrame, StageTimes, World, WorldState,
};

/// How far the length of a quaternion may be from 1: some programs write few digits.
const UNIT_WITHIN: f64 = 0.05;

/// One frame of a record.
pub trait Row: Serialize + DeserializeOwned {
    /// The message that it records.
    type Message;
    /// What writes such rows.
    const WRITTEN_BY: &'static str;
    /// What a binary record says it holds.
    const KIND: u8;
    /// Whether ids tell people apart, which begin anew with another publisher.
    const HAS_IDS: bool;

    /// The row of a message that came of the picture or film `source`.
    fn new(message: &Self::Message, source: &str) -> Self;

    /// Looks for numbers that no message holds; readers do so with every row.
    ///
    /// # Errors
    /// What is wrong with the row.
    fn check(&self) -> Result<(), String> {
        Ok(())
    }
}

/// Everyone seen in one frame: an [`ObservationFrame`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObservationsRow {
    /// Sequence number of the frame.
    pub frame: u64,
    /// When the picture was taken.
    pub time_ns: u64,
    /// The picture or film; empty when not known.
    #[serde(default)]
    pub source: String,
    /// Width of the picture.
    pub width: u32,
    /// Height of the picture.
    pub height: u32,
    /// Its camera; none where another program wrote the row and knew of none.
    #[serde(default)]
    pub intrinsics: Option<IntrinsicsRow>,
    /// The people, by falling score.
    pub people: Vec<ObservationRow>,
    /// When the message was published; 0 when not known.
    #[serde(default)]
    pub publish_ns: u64,
    /// Time spent per stage.
    #[serde(default)]
    pub stage_times: StageTimesRow,
    /// `FLAG_*` bits.
    #[serde(default)]
    pub flags: u32,
    /// People left out because their neck was not found.
    #[serde(default)]
    pub without_neck: u32,
    /// Frames in the input; 0 when not known.
    #[serde(default)]
    pub frame_total: u32,
}

/// A pinhole camera, pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct IntrinsicsRow {
    /// Horizontal focal length.
    pub fx: f32,
    /// Vertical focal length.
    pub fy: f32,
    /// Principal point, u.
    pub cx: f32,
    /// Principal point, v.
    pub cy: f32,
}

/// [`StageTimes`], microseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct StageTimesRow {
    /// Letterbox to the network's input.
    pub preprocess_us: u32,
    /// Stage I network.
    pub stage1_us: u32,
    /// Peaks, limbs, people.
    pub association_us: u32,
    /// Stage II network and appearance.
    pub stage2_us: u32,
}

/// One person of an [`ObservationsRow`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObservationRow {
    /// Probability that somebody is there, 0–1.
    pub score: f32,
    /// u, v, confidence of the evidence joints.
    pub joints2d: Joints<3, EVIDENCE_JOINTS>,
    /// Body joints relative to the pelvis, of the person rescaled to 1.70 m.
    pub joints3d: Joints<3, BODY_JOINTS>,
    /// How the torso looks; none where another program wrote the row.
    #[serde(default)]
    pub appearance: Option<AppearanceRow>,
}

/// Histograms of the torso, each sums to 1; all zero when the torso was not seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AppearanceRow {
    /// Of hue.
    pub hue: Vec<f32>,
    /// Of saturation.
    pub saturation: Vec<f32>,
}

/// Rows of `W` numbers, `N` of them unless another program wrote the file: readers check.
pub type Joints<const W: usize, const N: usize> = Vec<[f32; W]>;

/// Everyone with an identity in one frame: a [`BodyFrame`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BodiesRow {
    /// Sequence number of the frame.
    pub frame: u64,
    /// The time the bodies are given for.
    pub time_ns: u64,
    /// The picture or film; empty when not known.
    #[serde(default)]
    pub source: String,
    /// Width of the picture.
    #[serde(default)]
    pub width: u32,
    /// Height of the picture.
    #[serde(default)]
    pub height: u32,
    /// Its camera.
    #[serde(default)]
    pub intrinsics: Option<IntrinsicsRow>,
    /// The floor-aligned world; none while no floor is known.
    #[serde(default)]
    pub world: Option<WorldRow>,
    /// Everyone, by rising id.
    pub people: Vec<BodyRow>,
    /// When the picture was taken; earlier than `time_ns` where the bodies are extrapolated.
    #[serde(default)]
    pub capture_ns: u64,
    /// When the message was published; 0 when not known.
    #[serde(default)]
    pub publish_ns: u64,
    /// Time that `infer` spent per stage.
    #[serde(default)]
    pub stage_times: StageTimesRow,
    /// Identity and fit, microseconds.
    #[serde(default)]
    pub fit_us: u32,
    /// `FLAG_*` bits.
    #[serde(default)]
    pub flags: u32,
    /// Frames in the input; 0 when not known.
    #[serde(default)]
    pub frame_total: u32,
}

/// The floor-aligned world of a [`BodiesRow`]: x to the camera's right, y up, z towards the viewer, metres, origin on
/// the floor below the camera. world = rotation · camera + translation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorldRow {
    /// Camera axes to world axes.
    pub rotation: [f32; 4],
    /// The camera in the world.
    pub translation: [f32; 3],
    /// Where it comes from.
    pub state: WorldName,
}

/// [`WorldState`] by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WorldName {
    /// From standing feet.
    Estimated,
    /// By the settings.
    Given,
}

/// One person of a [`BodiesRow`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BodyRow {
    /// Identity, from 1.
    pub id: u32,
    /// How the track is doing.
    pub state: StateName,
    /// Pelvis in camera space.
    pub position: [f32; 3],
    /// Rotation of the pelvis, rest axes to camera axes.
    pub orientation: [f32; 4],
    /// Pelvis velocity, metres per second.
    pub velocity: [f32; 3],
    /// Skeleton parameters in the order of `models/skeleton.toml`.
    pub angles: [f32; DOF],
    /// Joints in camera space.
    pub joints3d: [[f32; 3]; BODY_JOINTS],
    /// `joints3d` projected into the picture.
    pub joints2d: [[f32; 2]; BODY_JOINTS],
    /// Overall confidence, 0–1.
    pub confidence: f32,
    /// Probability that each joint is within 150 mm of the truth.
    pub joint_confidence: [f32; BODY_JOINTS],
    /// Where each joint comes from.
    pub joint_states: [JointName; BODY_JOINTS],
    /// Stature.
    pub height: f32,
    /// Length of the bone that ends in each joint.
    pub bone_lengths: [f32; BODY_JOINTS],
    /// Local rotations for [`HUMANOID_BONES`](crate::message::HUMANOID_BONES).
    pub bone_rotations: [[f32; 4]; HUMANOID_BONE_COUNT],
}

/// [`BodyState`] by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StateName {
    /// Not yet confirmed; never published.
    Tentative,
    /// Seen in this frame.
    Tracked,
    /// Extrapolated.
    Predicted,
}

/// [`JointState`] by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JointName {
    /// Filled in by motion alone.
    Predicted,
    /// Filled in from the person's other joints.
    Occluded,
    /// Seen.
    Observed,
}

impl Row for ObservationsRow {
    type Message = ObservationFrame;
    const WRITTEN_BY: &'static str = "`infer --jsonl`";
    const KIND: u8 = b'O';
    const HAS_IDS: bool = false;

    fn new(frame: &ObservationFrame, source: &str) -> Self {
        Self {
            frame: frame.sequence,
            time_ns: frame.capture_ns,
            source: source.to_owned(),
            width: frame.width,
            height: frame.height,
            intrinsics: Some(frame.intrinsics.into()),
            people: frame.people().iter().map(ObservationRow::from).collect(),
            publish_ns: frame.publish_ns,
            stage_times: frame.stage_times.into(),
            flags: frame.flags,
            without_neck: frame.without_neck,
            frame_total: frame.frame_total,
        }
    }
}

impl From<&Observation> for ObservationRow {
    fn from(o: &Observation) -> Self {
        Self {
            score: o.score,
            joints2d: o.joints2d.to_vec(),
            joints3d: o.joints3d.to_vec(),
            appearance: Some(AppearanceRow {
                hue: o.hue.to_vec(),
                saturation: o.saturation.to_vec(),
            }),
        }
    }
}

impl ObservationsRow {
    /// The message, seen by `intrinsics`. Of more than [`MAX_PEOPLE`] people those with the lowest scores are left out.
    ///
    /// # Errors
    /// What is wrong with the row.
    pub fn message(&self, intrinsics: Intrinsics) -> Result<ObservationFrame, String> {
        let mut people = Vec::with_capacity(self.people.len());
        for (index, person) in self.people.iter().enumerate() {
            people.push(
                person
                    .message()
                    .map_err(|found| format!("person {index}: {found}"))?,
            );
        }
        people.sort_by(|a: &Observation, b| b.score.total_cmp(&a.score));
        people.truncate(MAX_PEOPLE);
        let mut frame = ObservationFrame {
            sequence: self.frame,
            capture_ns: self.time_ns,
            publish_ns: if self.publish_ns == 0 {
                self.time_ns
            } else {
                self.publish_ns
            },
            width: self.width,
            height: self.height,
            intrinsics,
            stage_times: self.stage_times.into(),
            flags: self.flags,
            without_neck: self.without_neck,
            count: people.len() as u32,
            frame_total: self.frame_total,
            ..ObservationFrame::default()
        };
        frame.people[..people.len()].copy_from_slice(&people);
        Ok(frame)
    }
}

impl ObservationRow {
    fn message(&self) -> Result<Observation, String> {
        if !self.score.is_finite() {
            return Err("a score that is no finite number".into());
        }
        let mut observation = Observation {
            score: self.score,
            joints2d: finite_rows("joints2d", &self.joints2d)?,
            joints3d: finite_rows("joints3d", &self.joints3d)?,
            ..Observation::default()
        };
        for (joint, [_, _, confidence]) in observation.joints2d.iter().enumerate() {
            if !(0.0..=1.0).contains(confidence) {
                return Err(format!(
                    "joints2d[{joint}] with confidence {confidence}, not within 0 to 1"
                ));
            }
        }
        if let Some(appearance) = &self.appearance {
            observation.hue = histogram("hue", &appearance.hue)?;
            observation.saturation = histogram("saturation", &appearance.saturation)?;
        }
        Ok(observation)
    }
}

fn finite_rows<const N: usize>(what: &str, rows: &[[f32; 3]]) -> Result<[[f32; 3]; N], String> {
    let rows: &[[f32; 3]; N] = rows
        .try_into()
        .map_err(|_| format!("{} rows in {what} instead of {N}", rows.len()))?;
    finite(what, rows.as_flattened())?;
    Ok(*rows)
}

fn finite(what: &str, numbers: &[f32]) -> Result<(), String> {
    match numbers.iter().find(|v| !v.is_finite()) {
        Some(v) => Err(format!("the value {v} in {what}")),
        None => Ok(()),
    }
}

/// Whether quaternions turn: without a length there is no direction in them.
fn rotations(what: &str, all: &[[f32; 4]]) -> Result<(), String> {
    let length = |q: &[f32; 4]| q.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
    match all
        .iter()
        .find(|q| !(length(q) - 1.0).abs().le(&UNIT_WITHIN))
    {
        Some(q) => Err(format!(
            "{q:?} in {what}, a quaternion that is not of length 1"
        )),
        None => Ok(()),
    }
}

fn histogram(what: &str, bins: &[f32]) -> Result<[f32; APPEARANCE_BINS], String> {
    let bins: &[f32; APPEARANCE_BINS] = bins
        .try_into()
        .map_err(|_| format!("{} bins in {what} instead of {APPEARANCE_BINS}", bins.len()))?;
    match bins.iter().find(|v| !v.is_finite() || **v < 0.0) {
        Some(v) => Err(format!("the value {v} in {what}")),
        None => Ok(*bins),
    }
}

impl Row for BodiesRow {
    type Message = BodyFrame;
    const WRITTEN_BY: &'static str = "`run --jsonl` or `fit --jsonl`";
    const KIND: u8 = b'B';
    const HAS_IDS: bool = true;

    fn new(frame: &BodyFrame, source: &str) -> Self {
        Self {
            frame: frame.sequence,
            time_ns: frame.pose_ns,
            source: source.to_owned(),
            width: frame.width,
            height: frame.height,
            intrinsics: Some(frame.intrinsics.into()),
            world: WorldRow::of(&frame.world),
            people: frame.bodies().iter().map(BodyRow::from).collect(),
            capture_ns: frame.capture_ns,
            publish_ns: frame.publish_ns,
            stage_times: frame.stage_times.into(),
            fit_us: frame.fit_us,
            flags: frame.flags,
            frame_total: frame.frame_total,
        }
    }

    fn check(&self) -> Result<(), String> {
        if let Some(world) = &self.world {
            finite("world.translation", &world.translation)?;
            rotations("world.rotation", &[world.rotation])?;
        }
        for (index, person) in self.people.iter().enumerate() {
            let checked = person.check();
            checked.map_err(|found| format!("person {index}: {found}"))?;
        }
        Ok(())
    }
}

impl BodiesRow {
    /// The message. Of more than [`MAX_PEOPLE`] people the last are left out.
    pub fn message(&self) -> BodyFrame {
        let mut frame = BodyFrame {
            sequence: self.frame,
            capture_ns: self.capture_ns,
            pose_ns: self.time_ns,
            publish_ns: self.publish_ns,
            width: self.width,
            height: self.height,
            intrinsics: self.intrinsics.unwrap_or_default().into(),
            stage_times: self.stage_times.into(),
            fit_us: self.fit_us,
            flags: self.flags,
            count: self.people.len().min(MAX_PEOPLE) as u32,
            frame_total: self.frame_total,
            world: self
                .world
                .as_ref()
                .map_or_else(World::default, WorldRow::message),
            ..BodyFrame::default()
        };
        for (body, row) in frame.bodies.iter_mut().zip(&self.people) {
            *body = row.message();
        }
        frame
    }
}

impl WorldRow {
    fn of(world: &World) -> Option<Self> {
        world.is_known().then_some(Self {
            rotation: world.rotation,
            translation: world.translation,
            state: if world.state == WorldState::GIVEN {
                WorldName::Given
            } else {
                WorldName::Estimated
            },
        })
    }

    fn message(&self) -> World {
        let state = match self.state {
            WorldName::Estimated => WorldState::ESTIMATED,
            WorldName::Given => WorldState::GIVEN,
        };
        World {
            rotation: self.rotation,
            translation: self.translation,
            state,
        }
    }
}

impl From<&Body> for BodyRow {
    fn from(body: &Body) -> Self {
        Self {
            id: body.id,
            state: match body.state {
                BodyState::TRACKED => StateName::Tracked,
                BodyState::PREDICTED => StateName::Predicted,
                _ => StateName::Tentative,
            },
            position: body.position,
            orientation: body.orientation,
            velocity: body.velocity,
            angles: body.angles,
            joints3d: body.joints3d,
            joints2d: body.joints2d,
            confidence: body.score,
            joint_confidence: body.confidence,
            joint_states: std::array::from_fn(|j| match body.joint_states[j] {
                JointState::OBSERVED => JointName::Observed,
                JointState::OCCLUDED => JointName::Occluded,
                _ => JointName::Predicted,
            }),
            height: body.height,
            bone_lengths: body.bone_lengths,
            bone_rotations: body.bone_rotations,
        }
    }
}

impl BodyRow {
    fn check(&self) -> Result<(), String> {
        finite("position", &self.position)?;
        finite("velocity", &self.velocity)?;
        finite("angles", &self.angles)?;
        finite("joints3d", self.joints3d.as_flattened())?;
        finite("joints2d", self.joints2d.as_flattened())?;
        finite("confidence", &[self.confidence])?;
        finite("joint_confidence", &self.joint_confidence)?;
        finite("height", &[self.height])?;
        finite("bone_lengths", &self.bone_lengths)?;
        rotations("orientation", &[self.orientation])?;
        rotations("bone_rotations", &self.bone_rotations)
    }

    fn message(&self) -> Body {
        Body {
            id: self.id,
            state: match self.state {
                StateName::Tentative => BodyState::TENTATIVE,
                StateName::Tracked => BodyState::TRACKED,
                StateName::Predicted => BodyState::PREDICTED,
            },
            score: self.confidence,
            position: self.position,
            orientation: self.orientation,
            velocity: self.velocity,
            angles: self.angles,
            joints3d: self.joints3d,
            joints2d: self.joints2d,
            confidence: self.joint_confidence,
            height: self.height,
            bone_lengths: self.bone_lengths,
            bone_rotations: self.bone_rotations,
            joint_states: self.joint_states.map(|name| match name {
                JointName::Predicted => JointState::PREDICTED,
                JointName::Occluded => JointState::OCCLUDED,
                JointName::Observed => JointState::OBSERVED,
            }),
            reserved: [0; 3],
        }
    }
}

impl From<Intrinsics> for IntrinsicsRow {
    fn from(i: Intrinsics) -> Self {
        let Intrinsics { fx, fy, cx, cy } = i;
        Self { fx, fy, cx, cy }
    }
}

impl From<IntrinsicsRow> for Intrinsics {
    fn from(i: IntrinsicsRow) -> Self {
        let IntrinsicsRow { fx, fy, cx, cy } = i;
        Self { fx, fy, cx, cy }
    }
}

impl From<StageTimes> for StageTimesRow {
    fn from(t: StageTimes) -> Self {
        Self {
            preprocess_us: t.preprocess_us,
            stage1_us: t.stage1_us,
            association_us: t.association_us,
            stage2_us: t.stage2_us,
        }
    }
}

impl From<StageTimesRow> for StageTimes {
    fn from(t: StageTimesRow) -> Self {
        Self {
            preprocess_us: t.preprocess_us,
            stage1_us: t.stage1_us,
            association_us: t.association_us,
            stage2_us: t.stage2_us,
        }
    }
}
