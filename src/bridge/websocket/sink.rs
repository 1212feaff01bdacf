//! A camera's frames, its events and what it says of itself to a hub, as sinks.

use super::Hub;
use crate::camera::monotonic_ns;
use crate::message::{BodyFrame, EventFrame, FLAG_END_OF_STREAM, HealthFrame};
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

/// Hands on to everybody who listens how one camera is doing.
#[derive(Debug)]
pub struct HealthSink {
    pub(super) hub: Hub,
    pub(super) camera: String,
    /// What it said last.
    pub(super) newest: HealthFrame,
}

impl Sink<HealthFrame> for HealthSink {
    fn take(&mut self, packet: &Packet<'_, HealthFrame>) -> Result<(), SinkError> {
        self.newest = *packet.message;
        self.hub.report(&self.camera, &self.newest);
        Ok(())
    }

    fn end(&mut self) -> Result<(), SinkError> {
        if self.newest.flags & FLAG_END_OF_STREAM == 0 {
            self.newest.end();
            self.newest.stamp(monotonic_ns());
            self.hub.report(&self.camera, &self.newest);
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        Ok(None)
    }
}
