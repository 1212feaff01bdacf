//! Publisher and subscriber over real shared memory.

use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, ObservationFrame};
use edgecap_client::{
    BUFFER, LinkError, MAX_SUBSCRIBERS, Message, Priority, Publisher, Subscriber,
};
use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, Immutable, IntoBytes};

fn camera(test: &str) -> String {
    format!("test-{test}-{}", std::process::id())
}

const PATIENCE: Duration = Duration::from_secs(5);

#[test]
fn messages_arrive_in_order_and_whole() {
    let camera = camera("order");
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let subscriber = Subscriber::<BodyFrame>::open(&camera).unwrap();
    let mut message = BodyFrame::default();
    for n in 0..BUFFER as u64 {
        message.sequence = n;
        message.bodies[31].height = n as f32;
        publisher.publish(&message).unwrap();
    }
    for n in 0..BUFFER as u64 {
        let got = subscriber.next(PATIENCE).unwrap().expect("a message");
        assert_eq!((got.sequence, got.bodies[31].height), (n, n as f32));
    }
    assert!(subscriber.next(Duration::from_millis(1)).unwrap().is_none());
}

#[test]
fn messages_end_where_a_file_does() {
    let camera = camera("end");
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let subscriber = Subscriber::<BodyFrame>::open(&camera).unwrap();
    for (sequence, flags) in [
        (0, 0),
        (1, FLAG_END_OF_STREAM),
        (2, FLAG_END_OF_STREAM | FLAG_FILE_TIME),
        (3, 0),
    ] {
        let message = BodyFrame {
            sequence,
            flags,
            ..BodyFrame::default()
        };
        publisher.publish(&message).unwrap();
    }
    let read: Vec<u64> = subscriber.messages().map(|m| m.unwrap().sequence).collect();
    assert_eq!(read, [0, 1, 2]);
    assert_eq!(subscriber.next(PATIENCE).unwrap().unwrap().sequence, 3);
}

#[test]
fn no_patience_is_no_wait() {
    let camera = camera("impatient");
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let subscriber = Subscriber::<BodyFrame>::open(&camera).unwrap();
    for timeout in [Duration::ZERO, Duration::from_nanos(500)] {
        assert!(subscriber.next(timeout).unwrap().is_none());
    }
    publisher.publish(&BodyFrame::default()).unwrap();
    assert!(subscriber.next(Duration::ZERO).unwrap().is_some());
    assert!(subscriber.next(Duration::ZERO).unwrap().is_none());
}

#[test]
fn a_slow_reader_loses_its_oldest_messages_only() {
    let camera = camera("overflow");
    let mut publisher = Publisher::<ObservationFrame>::open(&camera).unwrap();
    let subscriber = Subscriber::<ObservationFrame>::open(&camera).unwrap();
    let mut message = ObservationFrame::default();
    let total = 3 * BUFFER as u64;
    for n in 0..total {
        message.sequence = n;
        publisher.publish(&message).unwrap();
    }
    assert_eq!(
        subscriber.next(PATIENCE).unwrap().unwrap().sequence,
        total - BUFFER as u64
    );
    assert_eq!(
        subscriber.newest(PATIENCE).unwrap().unwrap().sequence,
        total - 1
    );
}

#[test]
fn a_connected_reader_gets_the_last_message_after_its_writer_has_gone() {
    let camera = camera("outlives");
    let subscriber = Subscriber::<BodyFrame>::open(&camera).unwrap();
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    publisher.publish(&BodyFrame::default()).unwrap();
    assert!(subscriber.next(PATIENCE).unwrap().is_some());
    let message = BodyFrame {
        flags: FLAG_END_OF_STREAM,
        ..BodyFrame::default()
    };
    publisher.publish(&message).unwrap();
    drop(publisher);
    assert_eq!(
        subscriber.next(PATIENCE).unwrap().unwrap().flags,
        FLAG_END_OF_STREAM
    );
    assert_eq!(subscriber.publisher_count(), 0);
}

#[test]
fn a_second_writer_and_a_bad_name_are_refused() {
    let camera = camera("second");
    let _first = Publisher::<BodyFrame>::open(&camera).unwrap();
    assert!(matches!(
        Publisher::<BodyFrame>::open(&camera),
        Err(LinkError::Busy { .. })
    ));
    for name in ["", "a/b", "a b", &"x".repeat(65)] {
        assert!(
            matches!(Publisher::<BodyFrame>::open(name), Err(LinkError::Name(_))),
            "{name}"
        );
    }
}

#[test]
fn a_wait_is_as_long_as_it_was_asked_for() {
    let camera = camera("wait");
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let subscriber = Subscriber::<BodyFrame>::open(&camera).unwrap();
    publisher.publish(&BodyFrame::default()).unwrap();
    assert!(subscriber.next(PATIENCE).unwrap().is_some());
    // The wake-up of that message has not been waited for.
    let wait = Duration::from_millis(300);
    let began = Instant::now();
    assert!(subscriber.next(wait).unwrap().is_none());
    assert!(began.elapsed() >= wait, "{:?}", began.elapsed());
    // A short one is short. The shortest: any of them may have waited for the processor.
    let short = |_| {
        let began = Instant::now();
        let none = subscriber.next(Duration::from_millis(1)).unwrap();
        assert!(none.is_none());
        began.elapsed()
    };
    let shortest = (0..10).map(short).min().unwrap();
    assert!(shortest < Duration::from_millis(100), "{shortest:?}");
}

#[test]
fn any_number_of_readers_keeps_nobody_out() {
    let camera = camera("crowd");
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let readers: Vec<_> = (0..2 * MAX_SUBSCRIBERS + 4)
        .map(|_| Subscriber::<BodyFrame>::open(&camera).unwrap())
        .collect();
    assert_eq!(publisher.subscriber_count(), MAX_SUBSCRIBERS);
    let own = Subscriber::<BodyFrame>::open_with(&camera, Priority::Reserved).unwrap();
    assert_eq!(publisher.subscriber_count(), MAX_SUBSCRIBERS + 1);
    for life in 0..3 {
        let message = BodyFrame {
            sequence: life,
            ..BodyFrame::default()
        };
        publisher.publish(&message).unwrap();
        for reader in readers.iter().chain([&own]) {
            assert_eq!(reader.next(PATIENCE).unwrap().unwrap().sequence, life);
        }
        drop(publisher);
        publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    }
}

/// Whoever looks whether a publisher lives holds its lock for a moment, removes it and closes it.
#[test]
fn somebody_who_looks_keeps_no_publisher_out() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("edgecap");
    drop(Publisher::<BodyFrame>::open_at(&folder, "camera0").unwrap());
    let lock = folder.canonicalize().unwrap().join("camera0.bodies.lock");
    let looks = std::fs::File::create(&lock).unwrap();
    std::fs::remove_file(&lock).unwrap();
    let closes = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(20));
        drop(looks);
    });
    Publisher::<BodyFrame>::open_at(&folder, "camera0").unwrap();
    closes.join().unwrap();
}

#[test]
fn a_reader_that_waited_misses_nothing_of_a_new_writer() {
    let camera = camera("early");
    let subscriber = Subscriber::<BodyFrame>::open(&camera).unwrap();
    assert!(
        subscriber
            .next(Duration::from_millis(30))
            .unwrap()
            .is_none()
    );
    assert_eq!(subscriber.publisher_count(), 0);
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    for sequence in 0..200 {
        let message = BodyFrame {
            sequence,
            ..BodyFrame::default()
        };
        publisher.publish(&message).unwrap();
        if sequence % 10 == 9 {
            for n in sequence - 9..=sequence {
                assert_eq!(subscriber.next(PATIENCE).unwrap().unwrap().sequence, n);
            }
        }
    }
    assert_eq!(publisher.subscriber_count(), 1, "it joined on the way");
}

/// A layout that no edgecap has.
#[derive(Debug, Clone, Copy, Default, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapTestFrameV9")]
#[repr(C)]
struct OtherFrame {
    sequence: u64,
}

impl Message for OtherFrame {
    const STREAM: &'static str = "bodies";
    const VERSION: u32 = 9;
}

#[test]
fn readers_of_another_version_are_told() {
    let camera = camera("version");
    let early = Subscriber::<BodyFrame>::open(&camera).unwrap();
    let other = Publisher::<OtherFrame>::open(&camera).unwrap();
    let told = |error: LinkError| {
        let text = error.to_string();
        let ours = BodyFrame::VERSION;
        assert!(
            text.contains(&format!(
                "expected messages of version {ours}, found version 9"
            )),
            "{text}"
        );
    };
    told(Subscriber::<BodyFrame>::open(&camera).unwrap_err());
    told(early.next(PATIENCE).unwrap_err());
    // Whatever they speak, they may not both.
    let second = Publisher::<BodyFrame>::open(&camera).unwrap_err();
    assert!(matches!(second, LinkError::Busy { .. }), "{second}");
    drop(other);
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    publisher.publish(&BodyFrame::default()).unwrap();
    assert!(early.next(PATIENCE).unwrap().is_some());
}

#[test]
fn the_host_programs_log_level_stays() {
    use iceoryx2_log::{LogLevel, get_log_level, set_log_level};
    set_log_level(LogLevel::Error);
    let _open = Subscriber::<BodyFrame>::open(&camera("log")).unwrap();
    assert_eq!(get_log_level(), LogLevel::Error as u8);
}
