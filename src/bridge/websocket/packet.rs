//! A published frame on its way to clients: encoded once a form, when the first client wants it.

use std::sync::OnceLock;

use serde::Serialize;
use tungstenite::{Bytes, Utf8Bytes};

use super::binary;
use super::mailbox::OfCamera;
use crate::message::{BodyFrame, FLAG_END_OF_STREAM};
use crate::record::{BodiesRow, Row};

/// A published frame of a camera.
#[derive(Debug)]
pub struct Packet {
    camera: String,
    frame: Box<BodyFrame>,
    json: OnceLock<Utf8Bytes>,
    binary: OnceLock<Bytes>,
}

/// The line of a record, and whose it is.
#[derive(Serialize)]
struct Line<'a> {
    camera: &'a str,
    #[serde(flatten)]
    row: BodiesRow,
}

impl Packet {
    /// A frame of `camera`.
    pub fn new(camera: &str, frame: &BodyFrame) -> Self {
        Self {
            camera: camera.to_owned(),
            frame: Box::new(*frame),
            json: OnceLock::new(),
            binary: OnceLock::new(),
        }
    }

    /// Whether the camera's input has ended with it.
    pub fn is_end(&self) -> bool {
        self.frame.flags & FLAG_END_OF_STREAM != 0
    }

    /// As a line of a record, with `camera` before it.
    pub fn json(&self) -> Utf8Bytes {
        let encode = || {
            let line = Line {
                camera: &self.camera,
                row: BodiesRow::new(&self.frame, ""),
            };
            // Of numbers that are not finite JSON makes null.
            serde_json::to_string(&line).unwrap_or_default().into()
        };
        self.json.get_or_init(encode).clone()
    }

    /// In the [compact form](binary).
    pub fn binary(&self) -> Bytes {
        let encode = || binary::encode(&self.camera, &self.frame).into();
        self.binary.get_or_init(encode).clone()
    }
}

impl OfCamera for Packet {
    fn camera(&self) -> &str {
        &self.camera
    }
}
