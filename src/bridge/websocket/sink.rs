//! A camera's frames and events to a hub, as a sink.

use super::Hub;
use crate::message::{BodyFrame, EventFrame};
use crate::sink::{Packet, Sink, SinkError, Streamed};

/// Hands one camera's frames to everybody who is connected.
#[derive(Debug)]
pub struct HubSink {
    pub(super) hub: Hub,
    pub(super) camera: String,
    /// The newest frame.
    pub(super) newest: Box<BodyFrame>,
}

impl Sink<BodyFrame> for HubSink {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        *self.newest = *packet.message;
        self.hub.publish(&self.camera, packet.message);
        Ok(())
    }

    fn quiet(&mut self) {
        self.hub.quiet(&self.camera, &mut self.newest);
    }

    fn end(&mut self) -> Result<(), SinkError> {
        self.newest.end();
        self.hub.publish(&self.camera, &self.newest);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
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
