//! Hands on what a camera publishes besides bodies: events, how it is doing, and pictures where the user wants to see
//! them.

use std::time::{Duration, Instant};

use edgecap_client::message::{
    BodyFrame, EventFrame, FLAG_END_OF_STREAM, HealthFrame, PictureFrame,
};
use edgecap_client::{LinkError, Priority, Received, Subscriber};

use super::bridges::BridgeArgs;
use crate::bridge::websocket::Hub;
use crate::camera::monotonic_ns;
use crate::sink::{Packet, Silence, SinkError, Sinks};

/// What was published longer ago before anybody looked is shown to nobody.
const OLD: Duration = Duration::from_secs(2);

/// Whether something was published so lately that whoever was in view may be there yet; nanoseconds.
pub fn is_of_now(publish_ns: u64, now_ns: u64) -> bool {
    now_ns.saturating_sub(publish_ns) <= OLD.as_nanos() as u64
}

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
    /// What was there at the first look and is to be handed on.
    left: Option<Received<EventFrame>>,
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
            // Who listens does something at an event: once, though a run was started again within a moment.
            false => Ok(Some(Self::new(camera, priority, sinks, |_| false)?)),
        }
    }

    /// To everybody who listens at a page, which shows who is there at once: what has just happened as well.
    ///
    /// # Errors
    /// Shared memory's.
    pub fn to_page(camera: &str, hub: &Hub) -> Result<Self, LinkError> {
        let mut sinks = Sinks::default();
        sinks.push(hub.sink(camera));
        Self::new(camera, Priority::Reader, sinks, |left| {
            is_of_now(left.publish_ns, monotonic_ns())
        })
    }

    /// `is_wanted`: whether what was there before is to be handed on, which may be of hours ago.
    fn new(
        camera: &str,
        priority: Priority,
        sinks: Sinks<EventFrame>,
        is_wanted: impl FnOnce(&EventFrame) -> bool,
    ) -> Result<Self, LinkError> {
        let events = Subscriber::<EventFrame>::open_with(camera, priority)?;
        let left = events.next(Duration::ZERO)?.filter(|left| is_wanted(left));
        Ok(Self {
            events,
            left,
            sinks,
        })
    }

    /// Hands on what has come since the last look; waits for nothing.
    ///
    /// # Errors
    /// Shared memory's and the sinks'.
    pub fn look(&mut self) -> Result<(), SinkError> {
        loop {
            let next = match self.left.take() {
                None => self.events.next(Duration::ZERO)?,
                left => left,
            };
            let Some(message) = next else {
                return Ok(());
            };
            if message.flags & FLAG_END_OF_STREAM == 0 {
                self.sinks.take(&Packet {
                    message: &*message,
                    source: "",
                    picture: None,
                })?;
            }
        }
    }
}

/// From what a camera says of itself to sinks.
pub struct HealthRelay {
    camera: String,
    health: Subscriber<HealthFrame>,
    sinks: Sinks<HealthFrame>,
    /// It was said that it cannot be handed on.
    has_failed: bool,
}

impl HealthRelay {
    /// To the bridges that take it; `None` where there are none.
    ///
    /// # Errors
    /// As [`BridgeArgs::add_health_to`], and shared memory's.
    pub fn to_bridges(
        bridges: &BridgeArgs,
        camera: &str,
        page: Option<&Hub>,
        priority: Priority,
    ) -> anyhow::Result<Option<Self>> {
        let mut sinks = Sinks::default();
        bridges.add_health_to(&mut sinks, camera, page)?;
        match sinks.is_empty() {
            true => Ok(None),
            false => Ok(Some(Self::new(camera, priority, sinks)?)),
        }
    }

    /// To a page.
    ///
    /// # Errors
    /// Shared memory's.
    pub fn to_page(camera: &str, hub: &Hub) -> Result<Self, LinkError> {
        let mut sinks = Sinks::default();
        sinks.push(hub.health_sink(camera));
        Self::new(camera, Priority::Reader, sinks)
    }

    fn new(camera: &str, priority: Priority, sinks: Sinks<HealthFrame>) -> Result<Self, LinkError> {
        Ok(Self {
            camera: camera.to_owned(),
            health: Subscriber::open_with(camera, priority)?,
            sinks,
            has_failed: false,
        })
    }

    /// Hands on what has been said since the last look; waits for nothing. Bodies go on without it: what it fails of is
    /// said once.
    pub fn look(&mut self) {
        if let Err(e) = self.hand_on()
            && !std::mem::replace(&mut self.has_failed, true)
        {
            tracing::warn!("{}: how it is doing is not handed on: {e}", self.camera);
        }
    }

    fn hand_on(&mut self) -> Result<(), SinkError> {
        while let Some(message) = self.health.next(Duration::ZERO)? {
            self.sinks.take(&Packet {
                message: &*message,
                source: "",
                picture: None,
            })?;
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

#[cfg(test)]
mod tests {
    use std::net::TcpStream;

    use edgecap_client::Publisher;

    use super::*;
    use crate::http::Server;

    #[test]
    fn a_page_hears_of_what_happened_just_before_it_was_looked_for() {
        let camera = format!("test-relay-{}", std::process::id());
        let hub = Hub::new(Duration::from_secs(60), false);
        let asked = hub.clone();
        let server = Server::start(([127, 0, 0, 1], 0).into(), move |request| {
            asked.answer(request)
        });
        let address = server.as_ref().unwrap().address();
        let url = format!("ws://{address}/events?format=binary");
        let stream = TcpStream::connect(address).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(60)))
            .unwrap();
        let (mut client, _) = tungstenite::client(url, stream).unwrap();
        let mut publisher = Publisher::<EventFrame>::open(&camera).unwrap();
        // A gesture of three seconds ago is over; its camera may have been unplugged after it.
        for (sequence, ago_ns) in [(1, 3_000_000_000), (2, 0)] {
            let happened = EventFrame {
                sequence,
                publish_ns: monotonic_ns() - ago_ns,
                count: 1,
                ..EventFrame::default()
            };
            publisher.publish(&happened).unwrap();
            let mut relay = EventRelay::to_page(&camera, &hub).unwrap();
            relay.look().unwrap();
        }
        let told = client.read().unwrap().into_data();
        assert_eq!(told[8..16], 2_u64.to_le_bytes());
    }
}
