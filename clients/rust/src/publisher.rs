//! Writing a stream: a message goes in, readers are woken.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher as Port;
use iceoryx2::prelude::*;

use crate::claim::{self, Claim, PATIENCE};
use crate::domain::{Domain, reserve_for_a_moment};
use crate::error::{LinkError, is_full};
use crate::link::{Link, Side};
use crate::place::{self, Place, own_besides};
use crate::ring::{BUFFER, Folders, RingWriter};
use crate::service::FileService;
use crate::stream::{Message, check_camera, file_stem, ring_path, service_name};

/// How often leftovers of killed readers are looked for.
const CLEAN_UP_EVERY: Duration = Duration::from_secs(10);

/// The one writer of a stream.
#[derive(Debug)]
pub struct Publisher<M: Message> {
    folder: PathBuf,
    /// Where nobody of this user may publish the stream as well.
    besides: Folders,
    camera: String,
    /// `None` only while it is made anew.
    made: Option<Made<M>>,
}

/// All that a writer has; left in this order.
#[derive(Debug)]
struct Made<M: Message> {
    ring: RingWriter<M>,
    port: Port<FileService, M, u64>,
    notifier: Notifier<FileService>,
    link: Link<M>,
    cleaned: Instant,
    _claim: Arc<Claim>,
    _place: Place,
}

impl<M: Message> Publisher<M> {
    /// Becomes the writer of `camera`'s stream.
    ///
    /// # Errors
    /// [`LinkError::Busy`] if there is one already, also one of this user in another folder that readers look in, as
    /// far as it publishes when this one begins; the other kinds as their texts say.
    pub fn open(camera: &str) -> Result<Self, LinkError> {
        Self::open_besides(&place::runtime_dir(), Folders::OfReaders, camera)
    }

    /// As [`open`](Self::open), in another installation's folder, and looking for other writers in that alone.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_at(folder: &Path, camera: &str) -> Result<Self, LinkError> {
        Self::open_besides(folder, Folders::These(Vec::new()), camera)
    }

    fn open_besides(folder: &Path, besides: Folders, camera: &str) -> Result<Self, LinkError> {
        check_camera(camera)?;
        let folder = place::from_here(folder);
        Ok(Self {
            made: Some(Made::new(&folder, &besides, camera)?),
            folder,
            besides,
            camera: camera.to_owned(),
        })
    }

    /// Copies `message` into shared memory and wakes the readers. Never waits: a reader that is too slow loses its
    /// oldest. Where somebody removed or cut the files under it, they are made anew; what killed readers left is freed.
    ///
    /// # Errors
    /// [`LinkError::SharedMemory`]; while they are made anew, as [`open`](Self::open).
    pub fn publish(&mut self, message: &M) -> Result<(), LinkError> {
        // First of all into the file: a reader that is just joining finds it in one of both.
        let number = self.write(message)?;
        self.send(number, message)
    }

    /// Writes a message into the stream's file; returns its number.
    ///
    /// # Errors
    /// As [`publish`](Self::publish).
    pub(crate) fn write(&mut self, message: &M) -> Result<u64, LinkError> {
        if self.made.as_ref().is_some_and(|m| m.ring.is_lost()) {
            self.made = None;
        }
        let made = match &mut self.made {
            Some(made) => made,
            none => none.insert(Made::new(&self.folder, &self.besides, &self.camera)?),
        };
        let written = made.ring.write(message);
        written.map_err(|e| LinkError::failed(&service_name::<M>(&self.camera), e))
    }

    /// Sends message `number`, which is in the file, and wakes the readers that get it.
    ///
    /// # Errors
    /// [`LinkError::SharedMemory`].
    pub(crate) fn send(&mut self, number: u64, message: &M) -> Result<(), LinkError> {
        let Some(made) = &mut self.made else {
            return Ok(());
        };
        let failed =
            |e: &dyn core::fmt::Display| LinkError::failed(&service_name::<M>(&self.camera), e);
        let mut slot = made.port.loan_uninit().map_err(|e| failed(&e))?;
        *slot.user_header_mut() = number;
        slot.write_payload(*message)
            .send()
            .map_err(|e| failed(&e))?;
        // A reader that died without cleaning up makes this fail; the message itself has been delivered.
        let _ = made.notifier.notify();
        if made.cleaned.elapsed() > CLEAN_UP_EVERY {
            made.link.clean_up();
            made.cleaned = Instant::now();
        }
        Ok(())
    }

    /// Readers connected through iceoryx2 now; those that copy from the stream's file are known to nobody.
    pub fn subscriber_count(&self) -> usize {
        let count = |m: &Made<M>| m.link.messages.dynamic_config().number_of_subscribers();
        self.made.as_ref().map_or(0, count)
    }

    /// Frees what killed readers left behind, now: [`publish`](Self::publish) does it every ten seconds.
    pub fn clean_up(&self) {
        if let Some(made) = &self.made {
            made.link.clean_up();
        }
    }
}

impl<M: Message> Made<M> {
    fn new(folder: &Path, besides: &Folders, camera: &str) -> Result<Self, LinkError> {
        let service = service_name::<M>(camera);
        let place = Place::enter_at(folder)?;
        let folder = place.folder();
        let other = |what| move |e: io::Error| LinkError::place(folder, format!("{what}: {e}"));
        let busy = || LinkError::Busy {
            service: service.clone(),
        };
        let stem = file_stem::<M>(camera);
        let mut others = own_besides(besides.now(), folder).into_iter();
        if others.any(|o| claim::is_taken(&o, &stem, PATIENCE)) {
            return Err(busy());
        }
        let claim = Claim::take(folder, &stem, PATIENCE);
        let claim = claim
            .map_err(other("claiming the stream"))?
            .ok_or_else(busy)?;
        let (claim, path) = (Arc::new(claim), ring_path::<M>(folder, camera));
        claim
            .remove_others()
            .map_err(other("removing its old files"))?;
        match place.sweep() {
            // Root's, which nobody uses any more and only root removes. Where another process clears away, that does.
            Err(e) if e.kind() == io::ErrorKind::PermissionDenied => {}
            swept => drop(swept.map_err(other("removing what the dead left"))?),
        }

        let failed = |e: &dyn core::fmt::Display| LinkError::failed(&service, e);
        // Nothing may be written into memory that is not there: first a look, then what is there is reserved.
        let room = |e: io::Error, bytes: u64| {
            if is_full(&e) {
                full(&service, folder, bytes)
            } else {
                failed(&e)
            }
        };
        let needed = RingWriter::<M>::length() + domain_bytes::<M>();
        reserve_for_a_moment(folder, needed).map_err(|e| room(e, needed))?;
        let domain = Domain::create(folder)?;
        let ring = RingWriter::<M>::create(&path, domain.id(), place.readers());
        let mut ring = ring.map_err(|e| room(e, needed))?;
        let link = Link::<M>::open(domain, camera, Side::Writer)?;
        let port = link
            .messages
            .publisher_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| failed(&e))?;
        let notifier = link
            .wake
            .notifier_builder()
            .create()
            .map_err(|e| failed(&e))?;
        link.domain.reserve().map_err(|e| room(e, needed))?;
        ring.show(&path, claim.clone())
            .map_err(other("naming the stream"))?;
        Ok(Self {
            ring,
            port,
            notifier,
            link,
            cleaned: Instant::now(),
            _claim: claim,
            _place: place,
        })
    }
}

/// What a stream of `M` takes in iceoryx2, bytes: messages that readers have not read or hold, and as much again of
/// bookkeeping as 2 MiB can hold.
const fn domain_bytes<M>() -> u64 {
    let readers = (crate::link::MAX_SUBSCRIBERS + crate::link::RESERVED) as u64;
    readers * (BUFFER as u64 + 4) * size_of::<M>() as u64 + (2 << 20)
}

fn full(service: &str, folder: &Path, bytes: u64) -> LinkError {
    let free = rustix::fs::statvfs(folder).map_or(0, |s| s.f_bavail * s.f_frsize);
    LinkError::Full {
        service: service.to_owned(),
        folder: folder.to_owned(),
        needed: bytes.div_ceil(1024),
        free: free / 1024,
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, OpenOptions};
    use std::os::unix::fs::FileExt;

    use super::*;
    use crate::message::EventFrame;
    use crate::subscriber::Subscriber;

    #[test]
    fn a_stream_that_another_session_publishes_is_refused() {
        let [here, there] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let open = |camera| {
            let besides = Folders::These(vec![there.path().to_owned(), here.path().to_owned()]);
            Publisher::<EventFrame>::open_besides(here.path(), besides, camera)
        };
        let first = Publisher::<EventFrame>::open_at(there.path(), "camera0").unwrap();
        let second = open("camera0").unwrap_err();
        assert!(matches!(second, LinkError::Busy { .. }), "{second}");
        let mut other = open("camera1").unwrap();
        drop(first);
        let mut second = open("camera0").unwrap();
        for publisher in [&mut second, &mut other] {
            // Made anew it does not find itself.
            publisher.made = None;
            publisher.publish(&EventFrame::default()).unwrap();
        }
    }

    #[test]
    fn a_file_that_is_cut_short_or_overwritten_is_made_anew() {
        let folder = tempfile::tempdir().unwrap();
        let mut publisher = Publisher::<EventFrame>::open_at(folder.path(), "camera0").unwrap();
        let path = ring_path::<EventFrame>(folder.path(), "camera0");
        let length = fs::metadata(&path).unwrap().len();
        for left in [0, 44, 64, length - 1, length] {
            let file = OpenOptions::new().write(true).open(&path).unwrap();
            file.set_len(left).unwrap();
            if left == length {
                file.write_all_at(&[0; 8], 0).unwrap();
            }
            publisher.publish(&EventFrame::default()).unwrap();
            assert_eq!(fs::metadata(&path).unwrap().len(), length, "of {left}");
            // On a busy machine signs of life may come late, and what came before them is not read.
            let is_read = (0..1000).any(|_| {
                let reader = Subscriber::<EventFrame>::open_at(folder.path(), "camera0").unwrap();
                publisher.publish(&EventFrame::default()).unwrap();
                let got = reader.next(Duration::from_millis(10)).unwrap();
                got.is_some() && reader.publisher_count() == 1
            });
            assert!(is_read, "cut to {left}");
        }
    }
}
