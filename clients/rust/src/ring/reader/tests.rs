//! Readers beside publishers of this process.

use std::fs::{File, OpenOptions};
use std::os::fd::OwnedFd;
use std::os::unix::fs::FileExt;

use rustix::fs::Mode;

use super::*;
use crate::message::{BodyFrame, EventFrame, FLAG_END_OF_STREAM, PictureFrame};
use crate::publisher::Publisher;
use crate::ring::{COUNT_AT, now};

fn silent() -> (
    tempfile::TempDir,
    Publisher<BodyFrame>,
    RingReader<BodyFrame>,
) {
    let folder = tempfile::tempdir().unwrap();
    let publisher = Publisher::open_at(folder.path(), "camera0").unwrap();
    let reader =
        RingReader::new(Folders::These(vec![folder.path().to_owned()]), "camera0").unwrap();
    (folder, publisher, reader)
}

#[test]
fn a_message_wakes_who_waits_for_it() {
    let (_folder, mut publisher, mut reader) = silent();
    let mut took = Vec::new();
    for sequence in 0..10 {
        let message = BodyFrame {
            sequence,
            ..BodyFrame::default()
        };
        took.push(std::thread::scope(|s| {
            let waits = s.spawn(|| {
                let begin = Instant::now();
                while reader.read().unwrap().is_none() {
                    reader.wait(Duration::from_secs(5));
                }
                begin.elapsed()
            });
            std::thread::sleep(Duration::from_millis(10));
            publisher.publish(&message).unwrap();
            waits.join().unwrap()
        }));
    }
    // The shortest: any of them may have waited for the processor.
    let shortest = took.into_iter().min().unwrap();
    assert!(shortest < LOOK_EVERY / 2, "{shortest:?}");
}

#[test]
fn a_short_wait_for_a_silent_publisher_is_short() {
    let (_folder, _publisher, reader) = silent();
    let wait = |_| {
        let begin = Instant::now();
        reader.wait(Duration::from_millis(1));
        begin.elapsed()
    };
    let shortest = (0..10).map(wait).min().unwrap();
    assert!(shortest < LOOK_EVERY / 2, "{shortest:?}");
}

#[test]
fn a_run_is_searched_for_seldom_once_the_wait_is_long() {
    let folder = tempfile::tempdir().unwrap();
    let folders = Folders::These(vec![folder.path().to_owned()]);
    let mut reader = RingReader::<BodyFrame>::new(folders, "camera0").unwrap();
    assert_eq!(reader.look_every(), SEARCH_EVERY);
    reader.searches_since = Instant::now().checked_sub(SEARCH_EAGERLY).unwrap();
    let begin = Instant::now();
    assert!(reader.wait(Duration::from_secs(5)));
    assert!(begin.elapsed() >= LOOK_EVERY, "{:?}", begin.elapsed());
    let _publisher = Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
    reader.look().unwrap();
    assert!(reader.source().is_some());
    reader.close();
    assert_eq!(reader.look_every(), SEARCH_EVERY, "it is new again");
}

#[test]
fn a_user_who_has_no_inotify_left_reads_too() {
    // None at all, and one that takes no file more.
    let refuses = || OwnedFd::from(File::open("/dev/null").unwrap());
    for watch in [None, Some(refuses())] {
        let folder = tempfile::tempdir().unwrap();
        let folders = Folders::These(vec![folder.path().to_owned()]);
        let mut reader = RingReader::<BodyFrame>::new(folders, "camera0").unwrap();
        reader.watch = Watch(watch);
        let mut publisher = Publisher::<BodyFrame>::open_at(folder.path(), "camera0").unwrap();
        for sequence in 3..6 {
            let message = BodyFrame {
                sequence,
                ..BodyFrame::default()
            };
            publisher.publish(&message).unwrap();
            let read = (0..1000).find_map(|_| {
                reader.look_now().unwrap();
                reader.wait(STEP);
                reader.read().unwrap()
            });
            assert_eq!(read.map(|m| m.sequence), Some(sequence));
        }
        assert!(reader.is_alive());
        let watched = |r: &RingReader<_>| r.open.as_ref().unwrap().watched;
        assert!(watched(&reader).is_none());
        // One is given back, or a file more may be watched.
        reader.watch = Watch::new();
        let is_watched = (0..1000).any(|n| {
            // On a busy machine signs of life may come late.
            std::thread::sleep(Duration::from_millis(10 * n.min(1)));
            reader.look_now().unwrap();
            watched(&reader).is_some()
        });
        assert!(is_watched, "it is tried at each look");
    }
}

#[test]
fn in_what_the_dead_left_nothing_is_waited_for_in_steps() {
    let (_folder, _publisher, mut reader) = silent();
    reader.watch = Watch(None);
    reader.open.as_mut().unwrap().watched = None;
    reader.take_for_dead();
    let begin = Instant::now();
    assert!(reader.wait(Duration::from_secs(5)));
    assert!(begin.elapsed() >= LOOK_EVERY, "{:?}", begin.elapsed());
}

#[test]
fn a_count_that_nobody_wrote_is_survived_and_the_next_message_read() {
    let (folder, mut publisher, mut reader) = silent();
    let path = folder.path().join("camera0.bodies.v2");
    let file = OpenOptions::new().write(true).open(path).unwrap();
    let last = [0, 1, SLOTS - 1, SLOTS].map(|n| u64::MAX - n);
    for (sequence, count) in last.into_iter().chain([0, 1000]).enumerate() {
        publish(&mut publisher, 10 * sequence as u64, u64::MAX);
        file.write_all_at(&count.to_ne_bytes(), COUNT_AT).unwrap();
        let read = (0..=SLOTS).filter(|_| reader.read().unwrap().is_some());
        assert!(
            read.count() < SLOTS as usize,
            "what was there, once: {count}"
        );
        let sequence = 10 * sequence as u64 + 1;
        publish(&mut publisher, sequence, u64::MAX);
        let finds = (0..1000).any(|n| {
            // On a busy machine signs of life may come late, and what came before them is not read.
            std::thread::sleep(Duration::from_millis(10 * n.min(1)));
            reader.look_now().unwrap();
            let found = unread(&mut reader).ends_with(&[sequence]);
            if !found {
                publish(&mut publisher, sequence, u64::MAX);
            }
            found
        });
        assert!(finds, "{count}");
    }
}

#[test]
fn a_reader_returns_to_the_folder_that_comes_first() {
    let [own, service] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let open = |folder: &Path| Publisher::<BodyFrame>::open_at(folder, "camera0").unwrap();
    let _service = open(service.path());
    let folders = [&own, &service].map(|f| f.path().to_owned());
    let folders = Folders::These(folders.to_vec());
    let mut reader = RingReader::<BodyFrame>::new(folders, "camera0").unwrap();
    assert_eq!(reader.source().unwrap().0, service.path());
    let _own = open(own.path());
    // On a busy machine signs of life may come late.
    let returns = (0..1000).any(|n| {
        std::thread::sleep(Duration::from_millis(10 * n.min(1)));
        reader.looked_before = Instant::now().checked_sub(RETURN_EVERY).unwrap();
        reader.look_now().unwrap();
        reader.source().unwrap().0 == own.path()
    });
    assert!(returns);
}

#[test]
fn another_path_to_what_is_read_is_no_other_publisher() {
    let [all, real] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (own, path) = (all.path().join("own"), real.path().join("run"));
    let _publisher = Publisher::<BodyFrame>::open_at(&path, "camera0").unwrap();
    let folders = Folders::These(vec![own.join("run"), path.clone()]);
    let mut reader = RingReader::<BodyFrame>::new(folders, "camera0").unwrap();
    std::os::unix::fs::symlink(real.path(), &own).unwrap();
    assert!(reader.open_in(&own.join("run")).unwrap().is_some());
    reader.looked_before = Instant::now().checked_sub(RETURN_EVERY).unwrap();
    reader.return_to_those_before();
    assert_eq!(reader.source().unwrap().0, path);
}

/// Two publishers, and a reader that waits for a third.
fn two() -> (
    [tempfile::TempDir; 2],
    [Publisher<BodyFrame>; 2],
    RingReader<BodyFrame>,
) {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let publishers = folders
        .each_ref()
        .map(|f| Publisher::open_at(f.path(), "camera0").unwrap());
    let reader = RingReader::new(Folders::These(Vec::new()), "camera0").unwrap();
    (folders, publishers, reader)
}

fn go_over(reader: &mut RingReader<BodyFrame>, folder: &Path) {
    let mut found = reader.open_in(folder).unwrap().unwrap();
    // On a busy machine signs of life may come late.
    found.is_alive = true;
    reader.follow(found);
}

fn publish(publisher: &mut Publisher<BodyFrame>, sequence: u64, publish_ns: u64) {
    let message = BodyFrame {
        sequence,
        publish_ns,
        ..BodyFrame::default()
    };
    publisher.publish(&message).unwrap();
}

fn unread(reader: &mut RingReader<BodyFrame>) -> Vec<u64> {
    std::iter::from_fn(|| reader.read().unwrap().map(|m| m.sequence)).collect()
}

#[test]
fn who_goes_over_to_another_folder_and_returns_reads_nothing_twice() {
    let ([own, service], [mut first, mut second], mut reader) = two();
    go_over(&mut reader, own.path());
    publish(&mut first, 1, u64::MAX);
    publish(&mut second, 11, u64::MAX);
    assert_eq!(unread(&mut reader), [1]);
    go_over(&mut reader, service.path());
    assert_eq!(unread(&mut reader), [11]);
    publish(&mut first, 2, u64::MAX);
    go_over(&mut reader, own.path());
    assert_eq!(unread(&mut reader), [2]);
    go_over(&mut reader, service.path());
    assert!(unread(&mut reader).is_empty());
    for sequence in 0..2 * SLOTS {
        publish(&mut first, sequence, u64::MAX);
    }
    go_over(&mut reader, own.path());
    let newest: Vec<_> = (SLOTS + 1..2 * SLOTS).collect();
    assert_eq!(unread(&mut reader), newest);
}

#[test]
fn nobody_who_was_seen_long_ago_is_shown_to_who_goes_over_to_another_folder() {
    let ([own, service], [_first, mut second], mut reader) = two();
    let long_ago = now().saturating_sub(10_000_000_000).max(1);
    go_over(&mut reader, own.path());
    publish(&mut second, 11, long_ago);
    go_over(&mut reader, service.path());
    assert!(unread(&mut reader).is_empty());
    publish(&mut second, 12, u64::MAX);
    assert_eq!(unread(&mut reader), [12]);
    // Left before it was read.
    publish(&mut second, 13, long_ago);
    go_over(&mut reader, own.path());
    go_over(&mut reader, service.path());
    assert!(unread(&mut reader).is_empty());
}

/// The first message that a reader gets who comes after one of `sent` was published.
fn first<M: Message>(sent: &M) -> Option<Box<M>> {
    let folder = tempfile::tempdir().unwrap();
    let mut publisher = Publisher::<M>::open_at(folder.path(), "camera0").unwrap();
    publisher.publish(sent).unwrap();
    let open = |_| {
        let folders = Folders::These(vec![folder.path().to_owned()]);
        let reader = RingReader::<M>::new(folders, "camera0").unwrap();
        // On a busy machine signs of life may come late.
        reader.is_alive().then_some(reader)
    };
    let reader = (0..100_000).find_map(open);
    reader.expect("it publishes").read().unwrap()
}

#[test]
fn nobody_who_was_seen_long_ago_is_shown_to_a_new_reader() {
    let long_ago = now().saturating_sub(10_000_000_000).max(1);
    let seen = |publish_ns, flags| BodyFrame {
        publish_ns,
        flags,
        ..BodyFrame::default()
    };
    assert!(first(&seen(long_ago, 0)).is_none());
    // Published in the future: nothing takes so long that it is stale.
    assert!(first(&seen(u64::MAX, 0)).is_some());
    assert!(first(&seen(0, 0)).is_some(), "nobody knows how old it is");
    assert!(first(&seen(long_ago, FLAG_END_OF_STREAM)).is_some());
    let happened = EventFrame {
        publish_ns: long_ago,
        ..EventFrame::default()
    };
    assert!(first(&happened).is_some(), "it has happened");
    let picture = PictureFrame {
        publish_ns: long_ago,
        ..PictureFrame::default()
    };
    assert!(first(&picture).is_some(), "it holds until the next");
}

#[test]
fn a_pipe_in_the_place_of_a_stream_is_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let (said, hears) = std::sync::mpsc::channel();
    for (camera, version) in [("camera0", 999), ("camera1", BodyFrame::VERSION)] {
        let path = folder.path().join(format!("{camera}.bodies.v{version}"));
        let (kind, mode) = (rustix::fs::FileType::Fifo, Mode::RUSR | Mode::WUSR);
        rustix::fs::mknodat(rustix::fs::CWD, &path, kind, mode, 0).unwrap();
        let folders = Folders::These(vec![folder.path().to_owned()]);
        let said = said.clone();
        std::thread::spawn(move || {
            let opened = RingReader::<BodyFrame>::new(folders, camera);
            said.send(opened.is_ok()).unwrap();
        });
    }
    let mut heard = [(); 2].map(|()| hears.recv_timeout(Duration::from_secs(20)).unwrap());
    heard.sort_unstable();
    assert_eq!(
        heard,
        [false, true],
        "nothing is published, and what is no stream is refused"
    );
}
