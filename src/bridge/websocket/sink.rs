//! A camera's frames and events to a hub, as a sink.

use super::Hub;
use crate::message::{BodyFrame, EventFrame, FLAG_END_OF_STREAM};
use crate::sink::{Packet, Sink, SinkError};

/// Hands one camera's frames to everybody who is connected.
#[derive(Debug)]
pub struct HubSink {
    pub(super) hub: Hub,
    pub(super) camera: String,
}

impl Sink<BodyFrame> for HubSink {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        self.hub.publish(&self.camera, packet.message);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        let end = BodyFrame {
            flags: FLAG_END_OF_STREAM,
            ..BodyFrame::default()
        };
        self.hub.publish(&self.camera, &end);
        Ok(None)
    }
}

impl Sink<EventFrame> for HubSink {
    fn take(&mut self, packet: &Packet<'_, EventFrame>) -> Result<(), SinkError> {
        self.hub.tell(&self.camera, packet.message);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        Ok(None)
    }
}
