//! A record of `infer` or `run`, or JSON lines of another program in their terms, go in; people per frame come out.

use std::path::Path;

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use edgecap_client::message::FLAG_END_OF_STREAM;
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::EvalError;
use super::oks::Joints2d;
use crate::record::rows::WorldName;
use crate::record::{self, Kind, RecordError};

/// Confidence of a body's joint that is given none: bodies are complete, so every joint counts as predicted.
const LEAST_CONFIDENCE: f32 = 1e-3;

/// One predicted person.
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    /// Identity; only bodies have one.
    pub id: Option<u64>,
    /// How sure the prediction is; orders predictions.
    pub score: f64,
    /// Evidence joints, pixels of the original picture; confidence 0 where not seen, which may have a place all the
    /// same.
    pub joints2d: Joints2d,
    /// Stature that a body is taken for, metres; `None` for observations, which are of canonical stature.
    pub height: Option<f64>,
    /// Body joints, metres, camera axes: relative to the pelvis for observations, in camera space for bodies.
    pub joints3d: [[f64; 3]; BODY_JOINTS],
}

/// Everyone predicted in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictedFrame {
    /// Index of the frame in its input.
    pub frame: u64,
    /// Capture time, nanoseconds.
    pub time_ns: u64,
    /// The picture or video; empty when the file does not say.
    pub source: String,
    /// Width and height of the original picture; 0 when the file does not say.
    pub size: [f64; 2],
    /// The people.
    pub people: Vec<Person>,
}

/// A file of predictions.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Predictions {
    /// In order of the file.
    pub frames: Vec<PredictedFrame>,
    /// Whether `run` wrote it: camera-space bodies with identities, in true metres, rather than pelvis-relative people
    /// of canonical stature.
    pub bodies: bool,
    /// The file, with the line, of the first frame whose bodies are in a calibration's axes, in which truth of one
    /// camera cannot be held against them.
    pub in_calibration: Option<String>,
}

#[derive(Deserialize)]
struct Line {
    frame: u64,
    #[serde(default)]
    time_ns: u64,
    #[serde(default)]
    source: Option<String>,
    #[serde(default)]
    width: f64,
    #[serde(default)]
    height: f64,
    /// `FLAG_*` bits.
    #[serde(default)]
    flags: u32,
    people: Vec<LinePerson>,
    intrinsics: Option<Lens>,
    world: Option<LineWorld>,
    /// Only bodies are fitted.
    fit_us: Option<IgnoredAny>,
    /// Only observations may lack one.
    without_neck: Option<IgnoredAny>,
}

#[derive(Deserialize)]
struct Lens {
    fx: f64,
}

#[derive(Deserialize)]
struct LineWorld {
    translation: [f64; 3],
    state: WorldName,
}

#[derive(Deserialize)]
struct LinePerson {
    id: Option<u64>,
    score: Option<f64>,
    position: Option<[f64; 3]>,
    height: Option<f64>,
    joints2d: Vec<Vec<f32>>,
    joints3d: Vec<[f64; 3]>,
    confidence: Option<serde_json::Value>,
}

impl Predictions {
    /// Reads a record that `infer`, `fit` or `run` wrote; one that was cut off to its last whole frame.
    ///
    /// # Errors
    /// When it cannot be read, or is not what it should be.
    pub fn read(path: &Path) -> Result<Self, EvalError> {
        let name = path.display().to_string();
        let bytes =
            crate::bounded::read(path, crate::bounded::DATA).map_err(|source| EvalError::Read {
                path: path.to_owned(),
                source,
            })?;
        let expected = "frames as `infer --record` or `run --record` writes them";
        let wrong = |e: RecordError| EvalError::format(name.clone(), expected, e.to_string());
        let (lines, is_short) = record::lines(bytes, &name).map_err(wrong)?;
        let (out, is_shorter) = Self::whole(&lines, &name)?;
        let was_cut = is_short || is_shorter;
        if out.frames.is_empty() {
            let found = match was_cut {
                true => "it cut off inside its first frame; record again",
                false => "no frame in it; record again",
            };
            let expected = "a record of one frame or more";
            return Err(EvalError::format(name, expected, found));
        }
        if was_cut {
            tracing::warn!("{name}: cut off inside a frame; the frames before it are measured");
        }
        Ok(out)
    }

    /// Adds the frames of another file of the same kind; `name` is for errors.
    ///
    /// # Errors
    /// When one holds observations and the other bodies.
    pub fn append(&mut self, more: Self, name: &str) -> Result<(), EvalError> {
        if let (Some(own), Some(new)) = (self.kind(), more.kind()) {
            expect_same(own, new, name)?;
        }
        self.bodies |= more.bodies;
        self.in_calibration = self.in_calibration.take().or(more.in_calibration);
        self.frames.extend(more.frames);
        Ok(())
    }

    /// What it holds; `None` where nobody is in it that would tell.
    fn kind(&self) -> Option<Kind> {
        match self.bodies {
            true => Some(Kind::Bodies),
            false if self.frames.iter().all(|f| f.people.is_empty()) => None,
            false => Some(Kind::Observations),
        }
    }

    /// Reads the text of such a file; `name` is for errors.
    pub fn parse(text: &str, name: &str) -> Result<Self, EvalError> {
        Ok(Self::whole(text.as_bytes(), name)?.0)
    }

    /// The whole frames of such a text, and whether it ends inside another.
    fn whole(text: &[u8], name: &str) -> Result<(Self, bool), EvalError> {
        let mut out = Self::default();
        let mut kind = None;
        // Some file systems leave zeros after a power cut where the end was to be.
        let end = text.iter().rposition(|b| *b != 0).map_or(0, |k| k + 1);
        let mut was_cut = end < text.len();
        let lines = text[..end].split_inclusive(|b| *b == b'\n').enumerate();
        for (k, line) in lines.filter(|(_, l)| !l.trim_ascii().is_empty()) {
            let at = || format!("{name}, line {}", k + 1);
            let line: Line = match serde_json::from_slice(line.trim_ascii_end()) {
                Ok(line) => line,
                // The writer was stopped inside this line. A file that begins with such a line may be anything.
                Err(e) if e.is_eof() && !line.ends_with(b"\n") && !out.frames.is_empty() => {
                    was_cut = true;
                    break;
                }
                Err(e) => {
                    return Err(EvalError::format(
                        at(),
                        "one JSON object per line as `infer --jsonl` or `run --jsonl` writes it",
                        e.to_string(),
                    ));
                }
            };
            for new in line.kinds() {
                expect_same(*kind.get_or_insert(new), new, &at())?;
            }
            // The publisher has ended there: it is no frame.
            if line.flags & FLAG_END_OF_STREAM != 0 {
                continue;
            }
            if out.in_calibration.is_none() && line.is_in_calibration() {
                out.in_calibration = Some(at());
            }
            let mut people = Vec::with_capacity(line.people.len());
            for p in line.people {
                people.push(p.check(&at)?);
            }
            out.frames.push(PredictedFrame {
                frame: line.frame,
                time_ns: line.time_ns,
                source: line.source.unwrap_or_default(),
                size: [line.width, line.height],
                people,
            });
        }
        out.bodies = kind == Some(Kind::Bodies);
        Ok((out, was_cut))
    }
}

/// Refuses to go on with the other kind.
fn expect_same(own: Kind, new: Kind, at: &str) -> Result<(), EvalError> {
    let called = |kind: Kind| match kind {
        Kind::Observations => "observations of `infer`",
        Kind::Bodies => "bodies of `run` or `fit`",
    };
    if own == new {
        return Ok(());
    }
    Err(EvalError::Mixed {
        path: at.to_owned(),
        expected: called(own),
        found: called(new),
    })
}

impl Line {
    /// What the line and its people tell of what they are: also a frame in which nobody is has what only one kind has.
    fn kinds(&self) -> impl Iterator<Item = Kind> {
        let fitted = self.fit_us.as_ref().map(|_| Kind::Bodies);
        let observed = self.without_neck.as_ref().map(|_| Kind::Observations);
        let people = self.people.iter().map(|p| match p.position {
            Some(_) => Kind::Bodies,
            None => Kind::Observations,
        });
        fitted.into_iter().chain(observed).chain(people)
    }

    /// Whether it has bodies in a calibration's axes: those of several cameras are of no lens, and those of one are in
    /// a world whose origin is that of the axes and not the floor below the camera.
    fn is_in_calibration(&self) -> bool {
        if !self.kinds().any(|kind| kind == Kind::Bodies) {
            return false;
        }
        let is_of_no_lens = self.intrinsics.as_ref().is_some_and(|lens| lens.fx == 0.0);
        let is_shared = self.world.as_ref().is_some_and(|world| {
            matches!(world.state, WorldName::Given) && world.translation == [0.0; 3]
        });
        is_of_no_lens || is_shared
    }
}

impl LinePerson {
    fn check(self, at: &dyn Fn() -> String) -> Result<Person, EvalError> {
        let wrong = |what: &str, found: usize| {
            EvalError::format(at(), what, format!("{found}; write the file again"))
        };
        let joints3d = <[_; BODY_JOINTS]>::try_from(self.joints3d)
            .map_err(|j| wrong("21 joints3d of x, y, z", j.len()))?;
        // A body may give one confidence for all joints or one per joint; an observation gives it with each point.
        let confidence = |j: usize| match &self.confidence {
            Some(serde_json::Value::Array(all)) => all.get(j).and_then(|c| c.as_f64()),
            Some(one) => one.as_f64(),
            None => None,
        };
        if self.joints2d.len() < EVIDENCE_JOINTS {
            return Err(wrong("at least 14 joints2d", self.joints2d.len()));
        }
        let mut joints2d = [[0.0; 3]; EVIDENCE_JOINTS];
        for (j, (to, from)) in joints2d.iter_mut().zip(&self.joints2d).enumerate() {
            *to = match from[..] {
                [u, v, c] => [u, v, c],
                [u, v] => {
                    let c = confidence(j).unwrap_or(0.0) as f32;
                    [u, v, c.max(LEAST_CONFIDENCE)]
                }
                _ => return Err(wrong("joints2d of u, v or u, v, confidence", from.len())),
            };
        }
        let seen = joints2d.iter().filter(|j| j[2] > 0.0);
        let mean = seen.clone().map(|j| f64::from(j[2])).sum::<f64>() / seen.count().max(1) as f64;
        Ok(Person {
            id: self.id,
            score: self.score.unwrap_or(mean),
            joints2d,
            height: self.height.filter(|h| *h > 0.0),
            joints3d,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{BodyFrame, FLAG_FILE_TIME};
    use crate::record::{BodiesRow, Format, RecordWriter};

    /// As `edgecap record` writes it where one publisher ends and another follows.
    #[test]
    fn the_end_of_a_stream_is_no_frame() {
        let frames = [(0, 0), (1, 0), (1, FLAG_END_OF_STREAM), (2, 0)];
        let folder = tempfile::tempdir().unwrap();
        for format in [Format::Jsonl, Format::Binary] {
            let path = folder.path().join("record");
            let mut record = RecordWriter::<BodiesRow>::create(&path, format).unwrap();
            for (sequence, flags) in frames {
                let message = BodyFrame {
                    sequence,
                    flags: flags | FLAG_FILE_TIME,
                    ..BodyFrame::default()
                };
                record.write(&message, "film.avi").unwrap();
            }
            record.finish().unwrap();
            let out = Predictions::read(&path).unwrap();
            let numbers: Vec<u64> = out.frames.iter().map(|f| f.frame).collect();
            assert_eq!(numbers, [0, 1, 2], "{format:?}");
        }
    }
}
