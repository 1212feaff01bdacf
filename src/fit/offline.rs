//! In: lines of `infer --jsonl`. Out: the same [`ObservationFrame`]s that `infer` publishes in shared memory.

use std::io::BufRead;

use serde::Deserialize;

use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use crate::message::{APPEARANCE_BINS, Intrinsics, MAX_PEOPLE, Observation, ObservationFrame};

/// Why a recorded observation file cannot be read. Lines count from 1.
#[derive(Debug, thiserror::Error)]
pub enum OfflineError {
    /// The file itself failed.
    #[error(
        "{name}, line {line}: cannot read: {source}; check that the file is complete and readable"
    )]
    Io {
        /// The file.
        name: String,
        /// The line that could not be read.
        line: u64,
        /// The cause.
        source: std::io::Error,
    },
    /// A line is no frame as `infer --jsonl` writes it.
    #[error(
        "{name}, line {line}: expected one frame as written by `infer --jsonl`, found: {found}; repair or remove the line"
    )]
    Line {
        /// The file.
        name: String,
        /// The offending line.
        line: u64,
        /// What is wrong with it.
        found: String,
    },
}

/// Where the camera of a recorded frame comes from.
#[derive(Clone, Copy)]
pub enum CameraSource<'a> {
    /// This camera for every line, whatever the lines say: its intrinsics for a picture's width and height, or why there
    /// are none.
    Given(&'a dyn Fn(u32, u32) -> Result<Intrinsics, String>),
    /// The line's `intrinsics`; where it has none, a centred camera with this horizontal field of view in degrees.
    Recorded {
        /// Horizontal field of view of lines without `intrinsics`, degrees.
        fov_degrees: f32,
    },
}

#[derive(Deserialize)]
struct Line {
    frame: u64,
    time_ns: u64,
    #[serde(default)]
    source: String,
    width: u32,
    height: u32,
    intrinsics: Option<LineIntrinsics>,
    people: Vec<LinePerson>,
}

#[derive(Deserialize)]
struct LineIntrinsics {
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
}

#[derive(Deserialize)]
struct LinePerson {
    score: f32,
    joints2d: Vec<[f32; 3]>,
    joints3d: Vec<[f32; 3]>,
    appearance: Option<LineAppearance>,
}

#[derive(Deserialize)]
struct LineAppearance {
    hue: Vec<f32>,
    saturation: Vec<f32>,
}

/// Reads a recorded observation file line by line; empty lines are skipped, unknown fields ignored.
pub struct ObservationReader<'a, R> {
    input: R,
    name: String,
    camera: CameraSource<'a>,
    line: u64,
    buffer: Vec<u8>,
    source: String,
}

impl<'a, R: BufRead> ObservationReader<'a, R> {
    /// Reads from `input`; `name` is what errors call it.
    pub fn new(input: R, name: impl Into<String>, camera: CameraSource<'a>) -> Self {
        Self {
            input,
            name: name.into(),
            camera,
            line: 0,
            buffer: Vec::new(),
            source: String::new(),
        }
    }

    /// The line read last, from 1; 0 before the first.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// The `source` of the line read last: a picture or video name, empty if it has none.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Reads the next frame into `frame` and says whether there was one. Of more than [`MAX_PEOPLE`] people those with
    /// the lowest scores are left out. After an error reading may go on with the next line.
    ///
    /// # Errors
    /// [`OfflineError`], naming the line.
    pub fn read(&mut self, frame: &mut ObservationFrame) -> Result<bool, OfflineError> {
        loop {
            self.buffer.clear();
            self.line += 1;
            let read = self
                .input
                .read_until(b'\n', &mut self.buffer)
                .map_err(|source| OfflineError::Io {
                    name: self.name.clone(),
                    line: self.line,
                    source,
                })?;
            if read == 0 {
                self.line -= 1;
                return Ok(false);
            }
            if !self.buffer.trim_ascii().is_empty() {
                break;
            }
        }
        let line: Line = serde_json::from_slice(&self.buffer)
            .map_err(|e| self.bad_line(json_complaint(&e.to_string(), e.column())))?;
        fill(&line, self.camera, frame).map_err(|found| self.bad_line(found))?;
        self.source = line.source;
        Ok(true)
    }

    fn bad_line(&self, found: String) -> OfflineError {
        OfflineError::Line {
            name: self.name.clone(),
            line: self.line,
            found,
        }
    }
}

/// serde_json counts lines within the one line it was given: keep only its column.
fn json_complaint(message: &str, column: usize) -> String {
    let text = message.split(" at line ").next().unwrap_or(message);
    format!("{text} at column {column}")
}

fn fill(line: &Line, camera: CameraSource<'_>, frame: &mut ObservationFrame) -> Result<(), String> {
    if line.width == 0 || line.height == 0 {
        return Err(format!(
            "a picture of {}×{} pixels",
            line.width, line.height
        ));
    }
    let intrinsics = match (camera, &line.intrinsics) {
        (CameraSource::Given(camera), _) => camera(line.width, line.height)?,
        (CameraSource::Recorded { .. }, Some(i)) => Intrinsics {
            fx: i.fx,
            fy: i.fy,
            cx: i.cx,
            cy: i.cy,
        },
        (CameraSource::Recorded { fov_degrees }, None) => {
            Intrinsics::from_horizontal_fov(line.width, line.height, fov_degrees)
        }
    };
    let usable = |f: f32| f.is_finite() && f > 0.0;
    if !(usable(intrinsics.fx)
        && usable(intrinsics.fy)
        && intrinsics.cx.is_finite()
        && intrinsics.cy.is_finite())
    {
        return Err(format!(
            "intrinsics with focal lengths {}, {} and principal point {}, {}",
            intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy
        ));
    }
    let mut people = Vec::with_capacity(line.people.len());
    for (index, person) in line.people.iter().enumerate() {
        people.push(observation(person).map_err(|found| format!("person {index}: {found}"))?);
    }
    people.sort_by(|a, b| b.score.total_cmp(&a.score));
    people.truncate(MAX_PEOPLE);
    *frame = ObservationFrame {
        sequence: line.frame,
        capture_ns: line.time_ns,
        publish_ns: line.time_ns,
        width: line.width,
        height: line.height,
        intrinsics,
        count: people.len() as u32,
        ..ObservationFrame::default()
    };
    frame.people[..people.len()].copy_from_slice(&people);
    Ok(())
}

fn observation(person: &LinePerson) -> Result<Observation, String> {
    let mut observation = Observation {
        score: person.score,
        joints2d: rows::<EVIDENCE_JOINTS>("joints2d", &person.joints2d)?,
        joints3d: rows::<BODY_JOINTS>("joints3d", &person.joints3d)?,
        ..Observation::default()
    };
    if !person.score.is_finite() {
        return Err("a score that is no finite number".into());
    }
    for (joint, [_, _, confidence]) in observation.joints2d.iter().enumerate() {
        if !(0.0..=1.0).contains(confidence) {
            return Err(format!(
                "joints2d[{joint}] with confidence {confidence}, not within 0 to 1"
            ));
        }
    }
    if let Some(appearance) = &person.appearance {
        observation.hue = histogram("hue", &appearance.hue)?;
        observation.saturation = histogram("saturation", &appearance.saturation)?;
    }
    Ok(observation)
}

fn rows<const N: usize>(what: &str, rows: &[[f32; 3]]) -> Result<[[f32; 3]; N], String> {
    let rows: &[[f32; 3]; N] = rows
        .try_into()
        .map_err(|_| format!("{} rows in {what} instead of {N}", rows.len()))?;
    match rows.iter().flatten().find(|v| !v.is_finite()) {
        Some(v) => Err(format!("the value {v} in {what}")),
        None => Ok(*rows),
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

#[cfg(test)]
mod tests {
    use super::*;

    const FOV: CameraSource<'static> = CameraSource::Recorded { fov_degrees: 60.0 };

    fn line(extra_person: &str, extra: &str) -> String {
        let joints2d = vec!["[10.5, 20, 0.5]"; 14].join(",");
        let joints3d = vec!["[0.1, -0.2, 0.3]"; 21].join(",");
        format!(
            r#"{{"frame": 7, "time_ns": 5000, "source": "a.mp4", "width": 640, "height": 480, {extra}
               "people": [{{"score": 0.8, "joints2d": [{joints2d}], "joints3d": [{joints3d}] {extra_person}}}]}}"#
        )
        .replace('\n', " ")
    }

    fn read_one(text: &str, camera: CameraSource<'_>) -> Result<ObservationFrame, OfflineError> {
        let mut frame = ObservationFrame::default();
        let mut reader = ObservationReader::new(text.as_bytes(), "o.jsonl", camera);
        reader.read(&mut frame).map(|found| {
            assert!(found);
            frame
        })
    }

    #[test]
    fn reads_what_infer_writes() {
        let text = format!(
            "\n{}\n\n{}",
            line("", ""),
            line("", "").replace("a.mp4", "b.png")
        );
        let mut reader = ObservationReader::new(text.as_bytes(), "o.jsonl", FOV);
        let mut frame = ObservationFrame::default();
        assert!(reader.read(&mut frame).unwrap());
        assert_eq!((reader.line(), reader.source()), (2, "a.mp4"));
        assert_eq!(
            (frame.sequence, frame.capture_ns, frame.count),
            (7, 5000, 1)
        );
        assert_eq!((frame.width, frame.height), (640, 480));
        assert_eq!(
            frame.intrinsics,
            Intrinsics::from_horizontal_fov(640, 480, 60.0)
        );
        let person = frame.people()[0];
        assert_eq!(person.score, 0.8);
        assert_eq!(person.joints2d[13], [10.5, 20.0, 0.5]);
        assert_eq!(person.joints3d[20], [0.1, -0.2, 0.3]);
        assert_eq!(person.hue, [0.0; APPEARANCE_BINS]);
        assert!(reader.read(&mut frame).unwrap());
        assert_eq!((reader.line(), reader.source()), (4, "b.png"));
        assert!(!reader.read(&mut frame).unwrap());
    }

    #[test]
    fn takes_optional_appearance_and_intrinsics() {
        let bins = vec!["0.0333"; 30].join(",");
        let text = line(
            &format!(r#", "appearance": {{"hue": [{bins}], "saturation": [{bins}]}}"#),
            r#""intrinsics": {"fx": 500, "fy": 501, "cx": 320, "cy": 240},"#,
        );
        let frame = read_one(&text, FOV).unwrap();
        assert_eq!(frame.intrinsics.fy, 501.0);
        assert_eq!(frame.people()[0].saturation[29], 0.0333);
        let given = Intrinsics::from_horizontal_fov(640, 480, 90.0);
        let frame = read_one(&text, CameraSource::Given(&|_, _| Ok(given))).unwrap();
        assert_eq!(frame.intrinsics, given);
    }

    #[test]
    fn keeps_the_best_of_too_many_people() {
        let whole = line("", "");
        let person = &whole[whole.find(r#"{"score"#).unwrap()..whole.rfind("]}").unwrap()];
        let many: Vec<String> = (0..40)
            .map(|i| person.replace("0.8", &format!("{}", i as f32 / 40.0)))
            .collect();
        let frame = read_one(&whole.replace(person, &many.join(",")), FOV).unwrap();
        assert_eq!(frame.count as usize, MAX_PEOPLE);
        assert_eq!(frame.people[0].score, 39.0 / 40.0);
        assert!(frame.people().is_sorted_by(|a, b| a.score >= b.score));
    }

    #[test]
    fn errors_name_file_line_and_fault() {
        let good = line("", "");
        let cases = [
            ("{\"frame\": 1".to_string(), "EOF"),
            ("[1, 2]".to_string(), "expected struct Line"),
            (
                good.replace("\"time_ns\": 5000,", ""),
                "missing field `time_ns`",
            ),
            (good.replace("\"width\": 640", "\"width\": 0"), "0×480"),
            (
                good.replacen("[10.5, 20, 0.5],", "", 1),
                "13 rows in joints2d instead of 14",
            ),
            (good.replacen("[10.5, 20, 0.5]", "[10.5, 20]", 1), "length"),
            (
                good.replacen("0.1, -0.2", "1e39, -0.2", 1),
                "inf in joints3d",
            ),
            (good.replacen("20, 0.5]", "20, 1.5]", 1), "confidence 1.5"),
            (
                line(r#", "appearance": {"hue": [1], "saturation": []}"#, ""),
                "1 bins in hue",
            ),
            (
                line("", r#""intrinsics": {"fx": 0, "fy": 1, "cx": 1, "cy": 1},"#),
                "focal lengths 0",
            ),
            ("\u{fffd}\u{0}".to_string(), "expected value"),
        ];
        for (bad, expected) in cases {
            let text = format!("{good}\n{bad}\n{good}");
            let mut reader = ObservationReader::new(text.as_bytes(), "o.jsonl", FOV);
            let mut frame = ObservationFrame::default();
            assert!(reader.read(&mut frame).unwrap());
            let message = reader.read(&mut frame).unwrap_err().to_string();
            assert!(
                message.starts_with("o.jsonl, line 2: expected one frame"),
                "{message}"
            );
            assert!(
                message.contains(expected),
                "{expected:?} not in {message:?}"
            );
            assert!(
                reader.read(&mut frame).unwrap(),
                "reading goes on after a bad line"
            );
        }
    }
}
