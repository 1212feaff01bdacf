//! How a camera is doing, on its way to clients: a line of JSON.

use serde::Serialize;
use tungstenite::Utf8Bytes;

use super::mailbox::OfCamera;
use crate::message::HealthFrame;

/// What a camera says of itself.
#[derive(Debug)]
pub struct Report {
    camera: String,
    json: Utf8Bytes,
}

/// A message and whose it is; `state` and `pace` are words, `null` where they are of a later version.
#[derive(Debug, Serialize)]
struct Line<'a> {
    camera: &'a str,
    state: Option<&'static str>,
    pace: Option<&'static str>,
    publish_ns: u64,
    started_ns: u64,
    since_ns: u64,
    sequence: u64,
    capture_ns: u64,
    observed: u64,
    left_out: u64,
    flags: u32,
    source_hz: f32,
    observed_hz: f32,
    look_hz: f32,
    latency_us: u32,
    people: u32,
    input_width: u32,
    input_height: u32,
    reconnects: u32,
    restarts: u32,
    cameras: u32,
    cameras_live: u32,
}

impl Report {
    /// What `camera` says.
    pub fn new(camera: &str, health: &HealthFrame) -> Self {
        let HealthFrame {
            publish_ns,
            started_ns,
            since_ns,
            sequence,
            capture_ns,
            observed,
            left_out,
            state,
            flags,
            source_hz,
            observed_hz,
            look_hz,
            latency_us,
            pace,
            people,
            input_width,
            input_height,
            reconnects,
            restarts,
            cameras,
            cameras_live,
        } = *health;
        let line = Line {
            camera,
            state: state.name(),
            pace: pace.name(),
            publish_ns,
            started_ns,
            since_ns,
            sequence,
            capture_ns,
            observed,
            left_out,
            flags,
            source_hz,
            observed_hz,
            look_hz,
            latency_us,
            people,
            input_width,
            input_height,
            reconnects,
            restarts,
            cameras,
            cameras_live,
        };
        Self {
            camera: camera.to_owned(),
            // Of numbers that are not finite JSON makes null.
            json: serde_json::to_string(&line).unwrap_or_default().into(),
        }
    }

    /// As text.
    pub fn json(&self) -> Utf8Bytes {
        self.json.clone()
    }
}

impl OfCamera for Report {
    fn camera(&self) -> &str {
        &self.camera
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::message::{HealthPace, HealthState};

    fn line(health: &HealthFrame) -> Value {
        serde_json::from_str(&Report::new("hall", health).json()).unwrap()
    }

    #[test]
    fn states_are_words_and_the_page_names_every_key() {
        let line = line(&HealthFrame {
            state: HealthState::AWAY,
            pace: HealthPace::BEHIND,
            since_ns: 7,
            source_hz: 29.5,
            cameras: 3,
            ..HealthFrame::default()
        });
        for (key, value) in [
            ("camera", json!("hall")),
            ("state", json!("away")),
            ("pace", json!("behind")),
            ("since_ns", json!(7)),
            ("source_hz", json!(29.5)),
            ("cameras", json!(3)),
        ] {
            assert_eq!(line[key], value);
        }
        let page = include_str!("../../../docs/clients.md");
        let (_, fields) = page.split_once("\n## Health\n").unwrap();
        let fields = fields.split("\n## ").next().unwrap();
        for key in line.as_object().unwrap().keys().filter(|k| *k != "camera") {
            assert!(fields.contains(&format!("`{key}`")), "{key}");
        }
    }

    #[test]
    fn a_state_of_a_later_version_is_null() {
        let health = HealthFrame {
            state: 77.into(),
            ..HealthFrame::default()
        };
        assert_eq!(line(&health)["state"], Value::Null);
    }
}
