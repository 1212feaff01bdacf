//! Pictures, taken and decoded in a thread of their own while the network is at work on the one before.
//!
//! One order, one delivery: no more than one picture is ever in hand. A camera's picture is taken as late as it can be
//! and still be ready in time, so that it is new when the network gets to it.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use crate::camera::monotonic_ns;
use crate::capture::{Brightness, CaptureError, Frame, Mounting, RawDecoder, RawPicture, Source};
use crate::schedule::change::Change;
use crate::schedule::pace::Wanted;

/// Longest that a delivery is put off in one go: whoever waits looks at its stop signal in between.
const STEP: Duration = Duration::from_millis(250);
/// Share of a new measurement in what decoding takes.
const SMOOTH: f32 = 0.1;

/// What is to come next.
#[derive(Debug)]
pub struct Order {
    /// Pictures of a camera that were taken before this are left out.
    pub from_ns: u64,
    /// What is wanted of it.
    pub wanted: Wanted,
    /// When somebody will have time for it.
    pub ready_at: Instant,
    /// What later pictures are compared with, if that is another picture now.
    pub reference: Option<Brightness>,
    /// A buffer to fill, in place of the one that an order without a picture left.
    pub buffer: Frame,
}

/// A picture that is to be looked at.
#[derive(Debug)]
pub struct Picture {
    /// Its colours.
    pub frame: Frame,
    /// Its brightness, where that was wanted.
    pub brightness: Option<Brightness>,
    /// Where it comes from.
    pub name: String,
    /// How many pictures the input has, if that is known.
    pub total: Option<u64>,
}

/// What an order brought.
#[derive(Debug)]
pub enum Delivery {
    /// The next picture.
    Picture(Box<Picture>),
    /// The next picture shows what the reference shows: its time and count, and the buffer.
    Unchanged(u64, u64, Frame),
    /// The next picture is not due yet.
    NotDue,
    /// The input has ended.
    Ended,
    /// No picture, and why.
    Failed(CaptureError),
}

/// A source behind a thread, which ends with this value, or, where the source waits for ever, with the process.
#[derive(Debug)]
pub struct Feed {
    orders: Sender<Order>,
    deliveries: Receiver<Delivery>,
    pending: bool,
}

impl Feed {
    /// Takes pictures from `source` when they are ordered, and puts them upright.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn start(source: Box<dyn Source>, mounting: Mounting) -> std::io::Result<Self> {
        let (orders, ordered) = channel();
        let (deliver, deliveries) = channel();
        let work = move || {
            let mut feeder = Feeder::new(source, mounting);
            for order in ordered {
                if deliver.send(feeder.fulfil(order)).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new()
            .name("capture".into())
            .spawn(work)?;
        Ok(Self {
            orders,
            deliveries,
            pending: false,
        })
    }

    /// Whether something has been ordered and not been delivered.
    pub fn is_pending(&self) -> bool {
        self.pending
    }

    /// Orders; what is ordered must have been received before.
    pub fn order(&mut self, order: Order) {
        debug_assert!(!self.pending, "one order at a time");
        // Where nobody takes it any more, receiving says so.
        let _ = self.orders.send(order);
        self.pending = true;
    }

    /// What was ordered; `None` if it has not come within a quarter of a second.
    ///
    /// # Errors
    /// If the thread has ended, which would be a fault of this program.
    pub fn receive(&mut self) -> anyhow::Result<Option<Delivery>> {
        match self.deliveries.recv_timeout(STEP) {
            Ok(delivery) => {
                self.pending = false;
                Ok(Some(delivery))
            }
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => {
                anyhow::bail!("the thread that takes pictures ended unexpectedly")
            }
        }
    }
}

/// The thread's own state.
struct Feeder {
    source: Box<dyn Source>,
    is_live: bool,
    mounting: Mounting,
    turned: Vec<u8>,
    raw: RawPicture,
    decoder: RawDecoder,
    change: Change,
    brightness: Brightness,
    /// What the next picture fills: of the orders whose pictures have not come yet.
    spare: Frame,
    /// What decoding takes, seconds.
    decoding: f32,
}

impl Feeder {
    fn new(source: Box<dyn Source>, mounting: Mounting) -> Self {
        Self {
            is_live: source.is_live(),
            source,
            mounting,
            turned: Vec::new(),
            raw: RawPicture::default(),
            decoder: RawDecoder::default(),
            change: Change::default(),
            brightness: Brightness::default(),
            spare: Frame::default(),
            decoding: 0.0,
        }
    }

    fn fulfil(&mut self, order: Order) -> Delivery {
        if order.buffer.rgb.capacity() > self.spare.rgb.capacity() {
            self.spare = order.buffer;
        }
        if order.reference.is_some() {
            self.change.compare_with(order.reference);
        }
        if self.is_live {
            let due = Duration::from_nanos(order.from_ns.saturating_sub(monotonic_ns()));
            let ready = order.ready_at.saturating_duration_since(Instant::now());
            let ready = ready.saturating_sub(Duration::from_secs_f32(self.decoding));
            let wait = due.max(ready);
            // A camera that has to wait longer is asked again.
            std::thread::sleep(wait.min(STEP));
            if wait > STEP {
                return Delivery::NotDue;
            }
        }
        match self.source.next_raw(&mut self.raw) {
            Ok(true) => {}
            Ok(false) => return Delivery::Ended,
            Err(e) => return Delivery::Failed(e),
        }
        if self.is_live && self.raw.time_ns < order.from_ns {
            return Delivery::NotDue;
        }
        let looked = self.look(order.wanted);
        let failure = looked.as_ref().err();
        self.source.judged(failure.map(String::as_str));
        looked.unwrap_or_else(|reason| {
            Delivery::Failed(CaptureError::Picture {
                input: format!("{}, frame {}", self.source.name(), self.raw.sequence),
                reason,
            })
        })
    }

    fn look(&mut self, wanted: Wanted) -> Result<Delivery, String> {
        if wanted != Wanted::Colours {
            self.decoder.brightness(&self.raw, &mut self.brightness)?;
            if wanted == Wanted::BothIfChanged && !self.change.is_in(&self.brightness) {
                return Ok(Delivery::Unchanged(
                    self.raw.time_ns,
                    self.raw.sequence,
                    std::mem::take(&mut self.spare),
                ));
            }
        }
        let start = Instant::now();
        self.decoder.decode(&mut self.raw, &mut self.spare)?;
        self.mounting.apply(&mut self.spare, &mut self.turned);
        self.decoding += SMOOTH * (start.elapsed().as_secs_f32() - self.decoding);
        Ok(Delivery::Picture(Box::new(Picture {
            frame: std::mem::take(&mut self.spare),
            brightness: (wanted != Wanted::Colours).then(|| self.brightness.clone()),
            name: self.source.picture(),
            total: self.source.frame_count(),
        })))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::capture::PixelFormat;

    /// A camera of which every second picture is damaged; what it hears of them.
    struct Camera(u64, Arc<Mutex<Vec<bool>>>);

    impl Source for Camera {
        fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
            self.0 += 1;
            (frame.width, frame.height) = (2, 2);
            frame.rgb = vec![9; 12];
            Ok(true)
        }

        fn next_raw(&mut self, raw: &mut RawPicture) -> Result<bool, CaptureError> {
            let mut frame = Frame::default();
            self.next_into(&mut frame)?;
            raw.take_over(&mut frame);
            if self.0.is_multiple_of(2) {
                raw.layout.format = PixelFormat::Mjpeg;
            }
            Ok(true)
        }

        fn judged(&mut self, failure: Option<&str>) {
            self.1.lock().unwrap().push(failure.is_none());
        }

        fn name(&self) -> &str {
            "camera"
        }
    }

    #[test]
    fn a_camera_hears_which_of_its_pictures_could_be_decoded() {
        let heard = Arc::default();
        let camera = Camera(0, Arc::clone(&heard));
        let mut feeder = Feeder::new(Box::new(camera), Mounting::default());
        for wanted in [Wanted::Colours, Wanted::Both] {
            for is_whole in [true, false] {
                let order = Order {
                    from_ns: 0,
                    wanted,
                    ready_at: Instant::now(),
                    reference: None,
                    buffer: Frame::default(),
                };
                let came = matches!(feeder.fulfil(order), Delivery::Picture(_));
                assert_eq!(came, is_whole);
            }
        }
        assert_eq!(*heard.lock().unwrap(), [true, false, true, false]);
    }

    /// A camera of grey pictures of 1970; the second one is cut off.
    struct Grey(u64);

    impl Source for Grey {
        fn next_into(&mut self, _: &mut Frame) -> Result<bool, CaptureError> {
            unreachable!("its pictures are decoded by whoever wants to see them")
        }

        fn next_raw(&mut self, raw: &mut RawPicture) -> Result<bool, CaptureError> {
            self.0 += 1;
            raw.layout.format = PixelFormat::Grey;
            (raw.layout.width, raw.layout.height, raw.layout.stride) = (2, 2, 2);
            raw.bytes = vec![9; if self.0 == 2 { 3 } else { 4 }];
            Ok(true)
        }

        fn is_live(&self) -> bool {
            true
        }

        fn name(&self) -> &str {
            "camera"
        }
    }

    /// Memory fresh from the system costs more than decoding into what there is.
    #[test]
    fn the_buffer_of_an_order_without_a_picture_is_filled_by_a_later_one() {
        let mut feeder = Feeder::new(Box::new(Grey(0)), Mounting::default());
        let mut buffer = Frame::default();
        buffer.rgb.reserve_exact(12);
        let first = buffer.rgb.as_ptr();
        let mut fulfil = |from_ns, buffer| {
            feeder.fulfil(Order {
                from_ns,
                wanted: Wanted::Colours,
                ready_at: Instant::now(),
                reference: None,
                buffer,
            })
        };
        // Not yet; too old; cut off.
        assert!(matches!(fulfil(u64::MAX, buffer), Delivery::NotDue));
        assert!(matches!(fulfil(1, Frame::default()), Delivery::NotDue));
        assert!(matches!(fulfil(0, Frame::default()), Delivery::Failed(_)));
        let Delivery::Picture(picture) = fulfil(0, Frame::default()) else {
            panic!("expected a picture");
        };
        assert_eq!(
            (picture.frame.rgb.len(), picture.frame.rgb.as_ptr()),
            (12, first)
        );
    }
}
