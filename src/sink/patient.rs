//! A record of what goes on without it. A thread of its own writes it: a disk that hangs, or a reader that stands
//! still, holds nothing up. Where its disk is full, results go everywhere else, and it is tried again.

use std::fs;
use std::io::{self, ErrorKind};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use rustix::io::Errno;

use super::error::name;
use super::{Packet, RecordSink, Sink, SinkError};
use crate::output::{is_read_only, is_stdout, no_room, parent};
use crate::record::{Format, Row, encode};

/// How often a record that failed is tried again.
const AGAIN: Duration = Duration::from_secs(60);
/// Most bytes of rows that wait to be written; what comes beyond is left out.
const ROOM: usize = 16 << 20;
/// How long the rows that wait may take at the end.
const LAST_ROWS: Duration = Duration::from_secs(5);

/// Writes every result to a file that grows under its name, as long as it can. Nothing waits for it but its end, and
/// that not for long.
#[derive(Debug)]
pub struct PatientRecord<T> {
    path: PathBuf,
    format: Format,
    /// `None` once the thread was told to end.
    orders: Option<Sender<Order>>,
    ended: Receiver<Ended>,
    /// Bytes of rows that wait, and how many may.
    waiting: Arc<AtomicUsize>,
    room: usize,
    trouble: Trouble,
    rows: PhantomData<fn(T)>,
}

/// What the thread is to do, in this order.
#[derive(Debug)]
enum Order {
    Write(Vec<u8>),
    BreakOff,
    Finish,
}

/// What there is in the end.
type Ended = Result<Option<String>, SinkError>;

impl<T: Row + 'static> PatientRecord<T> {
    /// Starts a record at `path`. A full disk is waited for. Who reads standard output (`-`) and leaves wants the end:
    /// that is an error of the next result.
    ///
    /// # Errors
    /// [`SinkError::Create`] for a place that cannot be one.
    pub fn create(path: &Path, format: Format) -> Result<Self, SinkError> {
        Self::with_room(path, format, ROOM)
    }

    fn with_room(path: &Path, format: Format, room: usize) -> Result<Self, SinkError> {
        let file = Growing::<T>::create(path, format)?;
        let waiting = Arc::new(AtomicUsize::new(0));
        let ((orders, todo), (end, ended)) = (channel(), channel());
        let thread = thread::Builder::new().name("record".to_owned());
        let written = Arc::clone(&waiting);
        let spawned = thread.spawn(move || write(file, todo, &written, end));
        spawned.map_err(|cause| SinkError::Create {
            path: path.to_owned(),
            cause,
        })?;
        Ok(Self {
            path: path.to_owned(),
            format,
            orders: Some(orders),
            ended,
            waiting,
            room,
            trouble: Trouble::default(),
            rows: PhantomData,
        })
    }

    fn take_at(&mut self, now: Instant, packet: &Packet<'_, T::Message>) -> Result<(), SinkError> {
        if self.trouble.must_wait(now) {
            return Ok(());
        }
        let mut row = Vec::new();
        if let Err(cause) = encode(
            &T::new(packet.message, packet.source),
            self.format,
            &mut row,
        ) {
            self.trouble.begins(now, self.stopped(cause));
            return Ok(());
        }
        let waiting = self.waiting.load(Ordering::Acquire);
        if waiting > 0 && waiting + row.len() > self.room {
            self.trouble.begins(now, self.stands_still());
            return Ok(());
        }
        self.trouble.ends(&self.path);
        self.waiting.fetch_add(row.len(), Ordering::AcqRel);
        let Some(orders) = &self.orders else {
            return Ok(());
        };
        if orders.send(Order::Write(row)).is_ok() {
            return Ok(());
        }
        self.orders = None;
        self.ended_within(LAST_ROWS).map(drop)
    }

    /// Has the thread write the rows that wait and complete the file, as long as that takes no longer than `patience`.
    fn finish_within(&mut self, patience: Duration) -> Ended {
        let Some(orders) = self.orders.take() else {
            return Ok(None);
        };
        // Where the thread has ended, it has said why.
        let _ = orders.send(Order::Finish);
        let ended = self.ended_within(patience);
        match self.trouble.0.take() {
            Some((why, _)) => Err(why),
            None => ended,
        }
    }

    fn ended_within(&self, patience: Duration) -> Ended {
        match self.ended.recv_timeout(patience) {
            Ok(ended) => ended,
            Err(RecvTimeoutError::Timeout) => Err(self.stands_still()),
            Err(RecvTimeoutError::Disconnected) => {
                Err(self.stopped(io::Error::other("the record's thread panicked")))
            }
        }
    }

    fn stands_still(&self) -> SinkError {
        let why = "nothing takes it any more: its disk hangs, or its reader stands still";
        self.stopped(io::Error::new(ErrorKind::TimedOut, why))
    }

    fn stopped(&self, cause: io::Error) -> SinkError {
        let path = self.path.clone();
        SinkError::Write { path, cause }
    }
}

impl<T: Row + 'static> Sink<T::Message> for PatientRecord<T> {
    fn take(&mut self, packet: &Packet<'_, T::Message>) -> Result<(), SinkError> {
        self.take_at(Instant::now(), packet)
    }

    fn break_off(&mut self) {
        if let Some(orders) = &self.orders {
            // Where the thread has ended, there is nothing that could be broken off.
            let _ = orders.send(Order::BreakOff);
        }
    }

    fn finish(mut self: Box<Self>) -> Ended {
        self.finish_within(LAST_ROWS)
    }
}

impl<T> Drop for PatientRecord<T> {
    fn drop(&mut self) {
        if let Some(orders) = self.orders.take() {
            drop(orders);
            // What has no name yet must be gone before this process is.
            let _ = self.ended.recv_timeout(LAST_ROWS);
        }
    }
}

/// Does what is ordered, until the file is finished, or has failed for good, or nobody orders anything any more.
fn write<T: Row>(
    mut file: Growing<T>,
    orders: Receiver<Order>,
    waiting: &AtomicUsize,
    end: Sender<Ended>,
) {
    for order in orders {
        let ended = match order {
            Order::Write(row) => {
                let written = file.take_at(Instant::now(), &row);
                waiting.fetch_sub(row.len(), Ordering::AcqRel);
                match written {
                    Ok(()) => continue,
                    Err(e) => Err(e),
                }
            }
            Order::BreakOff => {
                file.break_off();
                continue;
            }
            Order::Finish => file.finish(),
        };
        // Nobody may listen any more.
        let _ = end.send(ended);
        return;
    }
    // Whoever waits for the end hears it when the file is gone.
    drop(file);
    drop(end);
}

/// What a record failed of, told once, and when it is tried again.
#[derive(Debug, Default)]
struct Trouble(Option<(SinkError, Instant)>);

impl Trouble {
    fn must_wait(&self, now: Instant) -> bool {
        self.0.as_ref().is_some_and(|(_, next)| now < *next)
    }

    fn begins(&mut self, now: Instant, why: SinkError) {
        if self.0.is_none() {
            tracing::warn!("{why}; everything else goes on, and it is tried again every minute");
        }
        self.0 = Some((why, now + AGAIN));
    }

    fn ends(&mut self, path: &Path) {
        if self.0.take().is_some() {
            tracing::warn!("{}: is recorded again", name(path));
        }
    }
}

/// The file, begun anew where it has to be.
#[derive(Debug)]
struct Growing<T> {
    path: PathBuf,
    format: Format,
    /// `None` where it has to be begun.
    record: Option<RecordSink<T>>,
    trouble: Trouble,
}

impl<T: Row> Growing<T> {
    fn create(path: &Path, format: Format) -> Result<Self, SinkError> {
        Self::begun(path, format, RecordSink::create(path, format))
    }

    /// With a file that could be begun, or could not.
    fn begun(
        path: &Path,
        format: Format,
        file: Result<RecordSink<T>, SinkError>,
    ) -> Result<Self, SinkError> {
        let mut this = Self {
            path: path.to_owned(),
            format,
            record: None,
            trouble: Trouble::default(),
        };
        match file {
            Ok(file) => this.record = Some(file.growing()),
            Err(SinkError::Create { path, cause }) if is_full_or_away(&path, &cause) => {
                this.fails(Instant::now(), SinkError::Create { path, cause });
            }
            Err(e) => return Err(e),
        }
        Ok(this)
    }

    fn begin(&mut self) -> Result<(), SinkError> {
        self.record = Some(RecordSink::create(&self.path, self.format)?.growing());
        Ok(())
    }

    /// Fails where it is not to be tried again.
    fn take_at(&mut self, now: Instant, row: &[u8]) -> Result<(), SinkError> {
        if self.trouble.must_wait(now) {
            return Ok(());
        }
        match self.write(row) {
            Ok(()) => self.trouble.ends(&self.path),
            Err(e) if is_stdout(&self.path) => return Err(e),
            Err(e) => self.fails(now, e),
        }
        Ok(())
    }

    fn write(&mut self, row: &[u8]) -> Result<(), SinkError> {
        if self.record.is_none() {
            self.begin()?;
        }
        match &mut self.record {
            Some(record) => record.take_row(row),
            None => Ok(()),
        }
    }

    fn fails(&mut self, now: Instant, why: SinkError) {
        self.trouble.begins(now, why);
        // One that nobody can find any more takes room.
        if !self.record.as_mut().is_some_and(RecordSink::go_back) {
            self.record = None;
        }
    }

    fn break_off(&mut self) {
        if let Some(record) = &mut self.record {
            record.break_off();
        }
    }

    fn finish(self) -> Ended {
        // How it ends is newer than what it failed of before, and says where it lies.
        let said = self.record.map_or(Ok(None), |r| Box::new(r).finish())?;
        match self.trouble.0 {
            Some((why, _)) => Err(why),
            None => Ok(said),
        }
    }
}

/// Whether a disk was full, or away, where this was why no file or folder could be made at `path`: nothing of that is a
/// mistake in its name.
pub(crate) fn is_full_or_away(path: &Path, cause: &io::Error) -> bool {
    is_full_or_away_by(path, cause, |place| fs::metadata(place).map(drop))
}

/// With what a `look` at a place finds.
fn is_full_or_away_by(
    path: &Path,
    cause: &io::Error,
    look: impl Fn(&Path) -> io::Result<()>,
) -> bool {
    let is_away = |cause: &io::Error| is_away(cause, || is_read_only(path));
    // Where its mount is dead, making a folder there is told to find one. It may be the path itself.
    let is_dead = |place: &Path| look(place).is_err_and(|e| is_away(&e));
    no_room(cause).is_some() || is_away(cause) || [path, parent(path)].into_iter().any(is_dead)
}

/// Whether a disk fails, is on a machine that does not answer, or takes nothing any more because it `is_read_only`.
fn is_away(cause: &io::Error, is_read_only: impl FnOnce() -> bool) -> bool {
    match cause.kind() {
        ErrorKind::StaleNetworkFileHandle
        | ErrorKind::NotConnected
        | ErrorKind::TimedOut
        | ErrorKind::HostUnreachable => true,
        ErrorKind::ReadOnlyFilesystem => is_read_only(),
        // These have no kind.
        _ => matches!(
            Errno::from_io_error(cause),
            Some(Errno::IO | Errno::HOSTDOWN)
        ),
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::Read;
    use std::os::unix::fs::OpenOptionsExt;

    use rustix::fs::{CWD, OFlags, fcntl_setfl, mkfifoat};

    use super::*;
    use crate::message::BodyFrame;
    use crate::output::unnamed;
    use crate::record::{BodiesRow, RowReader};

    fn row() -> Vec<u8> {
        let mut row = Vec::new();
        encode(
            &BodiesRow::new(&BodyFrame::default(), ""),
            Format::Jsonl,
            &mut row,
        )
        .unwrap();
        row
    }

    /// A folder that is away stands in for a full disk: the record cannot get its name there.
    #[test]
    fn a_record_that_fails_is_tried_again_after_a_minute_and_nothing_else_ends() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("disk");
        let path = place.join("hall.jsonl");
        fs::create_dir(&place).unwrap();
        let mut record = Growing::<BodiesRow>::create(&path, Format::Jsonl).unwrap();
        fs::remove_dir_all(&place).unwrap();
        // No folder can be made there.
        fs::write(&place, "").unwrap();
        let (row, start) = (row(), Instant::now());
        record.take_at(start, &row).unwrap();
        assert!(record.trouble.0.is_some());
        fs::remove_file(&place).unwrap();
        record.take_at(start + AGAIN / 2, &row).unwrap();
        assert!(!path.exists(), "not yet");
        record.take_at(start + AGAIN, &row).unwrap();
        record.take_at(start + AGAIN, &row).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 2);
        assert!(record.finish().unwrap().is_some());
    }

    #[test]
    fn a_record_that_cannot_have_its_name_yet_loses_nothing_that_it_took() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        let mut record = Growing::<BodiesRow>::create(&path, Format::Jsonl).unwrap();
        fs::create_dir(&path).unwrap();
        let (row, start) = (row(), Instant::now());
        record.take_at(start, &row).unwrap();
        let (why, _) = record.trouble.0.as_ref().unwrap();
        assert!(why.to_string().ends_with("is kept"), "{why}");
        fs::remove_dir(&path).unwrap();
        record.take_at(start + AGAIN, &row).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 2);
        assert!(record.finish().unwrap().is_some());
        fs::remove_file(&path).unwrap();
        let mut record = Growing::<BodiesRow>::create(&path, Format::Jsonl).unwrap();
        fs::create_dir(&path).unwrap();
        record.take_at(start, &row).unwrap();
        let told = record.finish().unwrap_err().to_string();
        assert!(told.ends_with("hall-new.jsonl"), "{told}");
        let beside = folder.path().join("hall-new.jsonl");
        assert_eq!(fs::read_to_string(beside).unwrap().lines().count(), 1);
    }

    /// A service that ended over it would stay ended after the disk is back.
    #[test]
    fn a_record_whose_disk_is_away_at_the_start_is_tried_again_and_a_wrong_place_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.jsonl");
        let begun = |cause: io::Error| {
            let refused = SinkError::Create {
                path: path.clone(),
                cause,
            };
            Growing::<BodiesRow>::begun(&path, Format::Jsonl, Err(refused))
        };
        // As it is told of a file that is to have its name later, too.
        let both = |errno: Errno| {
            let told = io::Error::from(errno);
            let named = format!("{told} at path \"/srv/.edgecap-a.part\"");
            [errno.into(), unnamed(io::Error::new(told.kind(), named))]
        };
        for cause in [
            Errno::IO,
            Errno::STALE,
            Errno::NOTCONN,
            Errno::TIMEDOUT,
            Errno::HOSTUNREACH,
            Errno::HOSTDOWN,
            Errno::NOSPC,
        ]
        .into_iter()
        .flat_map(both)
        {
            let said = cause.to_string();
            let mut record = begun(cause).unwrap();
            assert!(record.trouble.0.is_some(), "{said}");
            record.take_at(Instant::now() + AGAIN, &row()).unwrap();
            assert_eq!(
                fs::read_to_string(&path).unwrap(),
                String::from_utf8(row()).unwrap()
            );
            fs::remove_file(&path).unwrap();
        }
        for cause in [
            Errno::ACCESS,
            Errno::NOTDIR,
            Errno::ISDIR,
            Errno::NAMETOOLONG,
            // Of a file system that is not read-only itself.
            Errno::ROFS,
        ]
        .into_iter()
        .flat_map(both)
        {
            let said = cause.to_string();
            assert!(begun(cause).is_err(), "{said}");
        }
    }

    #[test]
    fn a_disk_that_is_read_only_is_away_and_one_that_a_unit_keeps_closed_is_not() {
        let rofs = io::Error::from(Errno::ROFS);
        assert!(is_away(&rofs, || true));
        assert!(!is_away(&rofs, || false));
    }

    /// There is a folder, and no looking at it.
    #[test]
    fn a_place_whose_mount_or_that_around_it_is_dead_is_away() {
        let path = Path::new("/srv/last");
        let is_away_where = |dead: &str| {
            let look = |place: &Path| match place == Path::new(dead) {
                true => Err(Errno::NOTCONN.into()),
                false => Ok(()),
            };
            is_full_or_away_by(path, &Errno::EXIST.into(), look)
        };
        assert!(is_away_where("/srv/last") && is_away_where("/srv"));
        assert!(!is_away_where("/"));
    }

    fn take(record: &mut PatientRecord<BodiesRow>, now: Instant, sequence: u64) {
        let message = BodyFrame {
            sequence,
            ..BodyFrame::default()
        };
        let packet = Packet {
            message: &message,
            source: "",
            picture: None,
        };
        record.take_at(now, &packet).unwrap();
    }

    #[test]
    fn at_the_end_it_is_said_that_a_record_is_not_whole() {
        let full = Path::new("/dev/full");
        let mut record = PatientRecord::<BodiesRow>::create(full, Format::Jsonl).unwrap();
        take(&mut record, Instant::now(), 0);
        assert!(Box::new(record).finish().is_err());
    }

    #[test]
    fn a_record_is_whole_at_its_end_and_of_none_nothing_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/hall.jsonl");
        let create = || PatientRecord::<BodiesRow>::create(&path, Format::Jsonl).unwrap();
        drop(create());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        let mut record = create();
        for sequence in 0..100 {
            take(&mut record, Instant::now(), sequence);
        }
        let said = record.finish_within(Duration::MAX).unwrap().unwrap();
        assert!(said.contains("hall.jsonl"), "{said}");
        let text = fs::read(&path).unwrap();
        assert_eq!(frames(&text), (0..100).collect::<Vec<_>>());
    }

    fn frames(text: &[u8]) -> Vec<u64> {
        let mut rows = RowReader::<_, BodiesRow>::new(text, "record");
        let frames: Vec<u64> = std::iter::from_fn(|| rows.read().unwrap())
            .map(|row| row.frame)
            .collect();
        assert!(!rows.was_cut());
        frames
    }

    /// Takes more than a pipe and the queue hold of one whose reader stands still.
    fn stalled(folder: &Path, start: Instant) -> (PatientRecord<BodiesRow>, File) {
        let pipe = folder.join("pipe");
        mkfifoat(CWD, &pipe, 0o600.into()).unwrap();
        let flags = OFlags::NONBLOCK.bits().cast_signed();
        let mut options = File::options();
        let reader = options.read(true).custom_flags(flags).open(&pipe).unwrap();
        let mut record = PatientRecord::with_room(&pipe, Format::Jsonl, 4096).unwrap();
        for sequence in 0..10_000 {
            take(&mut record, start, sequence);
        }
        assert!(record.trouble.0.is_some());
        fcntl_setfl(&reader, OFlags::empty()).unwrap();
        (record, reader)
    }

    #[test]
    fn a_reader_that_stands_still_holds_nothing_up() {
        let folder = tempfile::tempdir().unwrap();
        let (mut record, mut reader) = stalled(folder.path(), Instant::now());
        let e = record.finish_within(Duration::ZERO).unwrap_err();
        assert!(e.to_string().contains("stands still"), "{e}");
        drop(record);
        // What it took before is whole, and in its order.
        let mut text = Vec::new();
        reader.read_to_end(&mut text).unwrap();
        let found = frames(&text);
        assert!(!found.is_empty());
        assert_eq!(found, (0..found.len() as u64).collect::<Vec<_>>());
    }

    #[test]
    fn a_reader_that_goes_on_gets_what_waited_and_after_a_minute_what_follows() {
        let folder = tempfile::tempdir().unwrap();
        let start = Instant::now();
        let (mut record, mut reader) = stalled(folder.path(), start);
        let reading = thread::spawn(move || {
            let mut text = Vec::new();
            reader.read_to_end(&mut text).unwrap();
            text
        });
        while record.waiting.load(Ordering::Acquire) > 0 {
            thread::yield_now();
        }
        take(&mut record, start + AGAIN / 2, 20_000);
        take(&mut record, start + AGAIN, 20_001);
        record.finish_within(Duration::MAX).unwrap();
        let found = frames(&reading.join().unwrap());
        let (last, before) = found.split_last().unwrap();
        assert_eq!(*last, 20_001);
        assert_eq!(before, (0..before.len() as u64).collect::<Vec<_>>());
    }
}
