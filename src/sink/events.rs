//! What happens in front of a camera, found in its bodies and handed on, as a sink of them.

use super::{Packet, Sink, SinkError, Sinks};
use crate::events::{Detector, EventConfig};
use crate::message::{BodyFrame, Event, EventFrame, MAX_EVENTS};

/// Looks at every frame of bodies; what has happened goes to sinks of its own.
pub struct EventSink {
    detector: Detector,
    sinks: Sinks<EventFrame>,
    /// How many events there were.
    told: u64,
    /// Those of the newest frame.
    flags: u32,
}

impl EventSink {
    /// Nobody is there yet.
    pub fn new(config: EventConfig, sinks: Sinks<EventFrame>) -> Self {
        Self {
            detector: Detector::new(config),
            sinks,
            told: 0,
            flags: 0,
        }
    }

    /// Says that ids begin anew with the next frame, whatever its number and time: everybody leaves with it.
    pub fn begin_anew(&mut self) {
        self.detector.begin_anew();
    }

    /// What has happened by this frame, a message for each [`MAX_EVENTS`] events.
    pub fn look(&mut self, frame: &BodyFrame) -> Vec<EventFrame> {
        self.look_as(frame, frame)
    }

    /// Looks at `found`, and tells what has happened by it with the number, the times and the flags under which the
    /// packet's frame is published.
    ///
    /// # Errors
    /// As [`Sink::take`].
    pub fn take_as(
        &mut self,
        packet: &Packet<'_, BodyFrame>,
        found: &BodyFrame,
    ) -> Result<(), SinkError> {
        for message in self.look_as(packet.message, found) {
            self.sinks.take(&Packet {
                message: &message,
                source: packet.source,
                picture: None,
            })?;
        }
        Ok(())
    }

    fn look_as(&mut self, frame: &BodyFrame, found: &BodyFrame) -> Vec<EventFrame> {
        let happened = self.detector.look(found);
        self.flags = frame.flags;
        let messages = happened.chunks(MAX_EVENTS).map(|part| {
            let mut message = EventFrame {
                sequence: frame.sequence,
                time_ns: frame.pose_ns,
                publish_ns: frame.publish_ns,
                first: self.told,
                flags: frame.flags,
                count: part.len() as u32,
                present: self.detector.present() as u32,
                main_person: self.detector.main_person().unwrap_or(0),
                events: [Event::default(); MAX_EVENTS],
            };
            message.events[..part.len()].copy_from_slice(part);
            self.told += part.len() as u64;
            message
        });
        messages.collect()
    }
}

impl Sink<BodyFrame> for EventSink {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        self.take_as(packet, packet.message)
    }

    fn end(&mut self) -> Result<(), SinkError> {
        if self.told == 0 {
            // Nothing has told readers yet whether the end is that of a file.
            self.sinks.take(&Packet {
                message: &EventFrame {
                    flags: self.flags,
                    ..EventFrame::default()
                },
                source: "",
                picture: None,
            })?;
        }
        self.sinks.end()
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        self.sinks.finish().1.map(|()| None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{BodyState, EventKind, MAX_PEOPLE};

    #[test]
    fn more_events_than_a_message_holds_come_in_several_and_none_is_lost() {
        let config = EventConfig {
            confirm: 0.0,
            ..EventConfig::default()
        };
        let mut sink = EventSink::new(config, Sinks::default());
        let mut frame = BodyFrame {
            sequence: 7,
            pose_ns: 1,
            count: MAX_PEOPLE as u32,
            ..BodyFrame::default()
        };
        for (body, id) in frame.bodies.iter_mut().zip(1..) {
            (body.id, body.state) = (id, BodyState::TRACKED);
        }
        // Everybody enters, and somebody is the main person.
        let told = sink.look(&frame);
        assert_eq!(told.len(), 2);
        let [first, second] = [&told[0], &told[1]];
        assert_eq!((first.first, first.count), (0, MAX_EVENTS as u32));
        assert_eq!((second.first, second.count), (32, 1));
        assert_eq!(second.events()[0].kind, EventKind::MAIN_PERSON);
        for message in &told {
            assert_eq!((message.sequence, message.time_ns), (7, 1));
            assert_eq!((message.present, message.main_person), (32, 1));
        }
        frame.pose_ns += 1;
        assert_eq!(sink.look(&frame), [], "nothing new");
    }
}
