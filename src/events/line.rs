//! An event as a line of JSON.

use serde::Serialize;

use crate::message::{Event, EventFrame, Hand};

/// An event, whose and when; what its kind does not say is left out.
#[derive(Debug, Serialize)]
pub struct Line<'a> {
    camera: &'a str,
    frame: u64,
    time_ns: u64,
    person: Option<u32>,
    event: &'static str,
    #[serde(skip_serializing_if = "str::is_empty")]
    zone: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    hand: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<f32>,
}

impl<'a> Line<'a> {
    /// One a known event of a message.
    pub fn all(camera: &'a str, frame: &'a EventFrame) -> impl Iterator<Item = Self> {
        let line = move |event: &'a Event| {
            Some(Self {
                camera,
                frame: frame.sequence,
                time_ns: frame.time_ns,
                person: Some(event.person).filter(|id| *id != 0),
                // Of a later version.
                event: event.kind.name()?,
                zone: event.zone(),
                hand: (event.hand != Hand::NONE)
                    .then(|| event.hand.name())
                    .flatten(),
                seconds: (event.seconds != 0.0).then_some(event.seconds),
            })
        };
        frame.events().iter().filter_map(line)
    }

    /// As text.
    pub fn json(&self) -> String {
        // Of numbers that are not finite JSON makes null.
        serde_json::to_string(self).unwrap_or_default()
    }
}
