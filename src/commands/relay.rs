//! Hands on what a camera publishes besides bodies: events, and pictures where the user wants to see them.

use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, EventFrame, FLAG_END_OF_STREAM, PictureFrame};
use edgecap_client::{LinkError, Priority, Subscriber};

use super::bridges::BridgeArgs;
use crate::bridge::websocket::Hub;
use crate::sink::{Packet, Silence, SinkError, Sinks};

/// Where the bodies have just fallen silent nobody is shown any more until the next ones, nor a picture of them.
pub fn hush<'a>(
    silence: &mut Silence,
    sinks: &mut Sinks<BodyFrame>,
    pictures: impl IntoIterator<Item = &'a mut PictureRelay>,
) {
    if silence.begins(Instant::now()) {
        sinks.quiet();
        pictures.into_iter().for_each(PictureRelay::quiet);
    }
}

/// From a camera's stream of events to sinks.
pub struct EventRelay {
    events: Subscriber<EventFrame>,
    sinks: Sinks<EventFrame>,
}

impl EventRelay {
    /// To the bridges that take events; `None` where there are none.
    ///
    /// # Errors
    /// As [`BridgeArgs::add_events_to`], and shared memory's.
    pub fn to_bridges(
        bridges: &BridgeArgs,
        camera: &str,
        page: Option<&Hub>,
        priority: Priority,
    ) -> anyhow::Result<Option<Self>> {
        let mut sinks = Sinks::default();
        bridges.add_events_to(&mut sinks, camera, page)?;
        match sinks.is_empty() {
            true => Ok(None),
            false => Ok(Some(Self::new(camera, priority, sinks)?)),
        }
    }

    /// To everybody who listens at a page.
    ///
    /// # Errors
    /// Shared memory's.
    pub fn to_page(camera: &str, hub: &Hub) -> Result<Self, LinkError> {
        let mut sinks = Sinks::default();
        sinks.push(hub.sink(camera));
        Self::new(camera, Priority::Reader, sinks)
    }

    fn new(camera: &str, priority: Priority, sinks: Sinks<EventFrame>) -> Result<Self, LinkError> {
        let events = Subscriber::open_with(camera, priority)?;
        // Who listens does something at an event: not at one of hours ago.
        events.next(Duration::ZERO)?;
        Ok(Self { events, sinks })
    }

    /// Hands on what has come since the last look; waits for nothing.
    ///
    /// # Errors
    /// Shared memory's and the sinks'.
    pub fn look(&mut self) -> Result<(), SinkError> {
        while let Some(message) = self.events.next(Duration::ZERO)? {
            if message.flags & FLAG_END_OF_STREAM == 0 {
                self.sinks.take(&Packet {
                    message: &*message,
                    source: "",
                    picture: None,
                })?;
            }
        }
        Ok(())
    }
}

/// From a camera's stream of pictures to a page that shows them.
pub struct PictureRelay {
    pictures: Subscriber<PictureFrame>,
    name: String,
    hub: Hub,
    /// Whether the page shows one.
    is_shown: bool,
}

impl PictureRelay {
    /// To a page, under a name of its own; `None` where it shows no pictures.
    ///
    /// # Errors
    /// Shared memory's.
    pub fn to_page(
        camera: &str,
        name: &str,
        page: Option<&Hub>,
        priority: Priority,
    ) -> Result<Option<Self>, LinkError> {
        let Some(hub) = page.filter(|hub| hub.shows_pictures()) else {
            return Ok(None);
        };
        Ok(Some(Self {
            pictures: Subscriber::open_with(camera, priority)?,
            name: name.to_owned(),
            hub: hub.clone(),
            is_shown: false,
        }))
    }

    /// Hands on the newest, if it has come since the last look; waits for nothing.
    ///
    /// # Errors
    /// Shared memory's.
    pub fn look(&mut self) -> Result<(), LinkError> {
        if let Some(picture) = self.pictures.newest(Duration::ZERO)? {
            self.is_shown = picture.count > 0;
            self.hub.show(&self.name, &picture);
        } else if self.is_shown && self.is_missing() {
            // One that was killed has not said that nothing follows.
            self.quiet();
        }
        Ok(())
    }

    /// Lets the page show none until the next one comes.
    pub fn quiet(&mut self) {
        if std::mem::take(&mut self.is_shown) {
            self.hub.show(&self.name, &PictureFrame::default());
        }
    }

    /// Whether nobody publishes any.
    pub fn is_missing(&self) -> bool {
        self.pictures.publisher_count() == 0
    }
}
