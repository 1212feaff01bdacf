//! Publisher and subscriber over real shared memory.

use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM, ObservationFrame};
use edgecap_client::{BUFFER, LinkError, MAX_SUBSCRIBERS, Priority, Publisher, Subscriber};

fn camera(test: &str) -> String {
    format!("test-{test}-{}", std::process::id())
}

const PATIENCE: Duration = Duration::from_secs(5);

#[test]
fn messages_arrive_in_order_and_whole() {
    let camera = camera("order");
    let publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
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
fn no_patience_is_no_wait() {
    let camera = camera("impatient");
    let publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
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
    let publisher = Publisher::<ObservationFrame>::open(&camera).unwrap();
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
    let publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
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
    let publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let subscriber = Subscriber::<BodyFrame>::open(&camera).unwrap();
    publisher.publish(&BodyFrame::default()).unwrap();
    assert!(subscriber.next(PATIENCE).unwrap().is_some());
    // The wake-up of that message has not been waited for.
    let wait = Duration::from_millis(300);
    let began = Instant::now();
    assert!(subscriber.next(wait).unwrap().is_none());
    assert!(began.elapsed() >= wait, "{:?}", began.elapsed());
}

#[test]
fn readers_cannot_keep_the_writer_or_our_own_processes_out() {
    let camera = camera("crowd");
    let publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let readers: Vec<_> = (0..MAX_SUBSCRIBERS)
        .map(|_| Subscriber::<BodyFrame>::open(&camera).unwrap())
        .collect();
    let one_more = Subscriber::<BodyFrame>::open(&camera).unwrap_err();
    assert!(matches!(one_more, LinkError::Readers { .. }), "{one_more}");
    assert!(
        one_more.to_string().contains("too many readers"),
        "{one_more}"
    );
    let own = Subscriber::<BodyFrame>::open_with(&camera, Priority::Reserved).unwrap();
    for _ in 0..3 {
        assert!(Subscriber::<BodyFrame>::open(&camera).is_err());
    }
    drop(publisher);
    let publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    publisher.publish(&BodyFrame::default()).unwrap();
    assert!(own.next(PATIENCE).unwrap().is_some());
    drop(readers);
}

#[test]
fn the_host_programs_log_level_stays() {
    use iceoryx2_log::{LogLevel, get_log_level, set_log_level};
    set_log_level(LogLevel::Error);
    let _open = Subscriber::<BodyFrame>::open(&camera("log")).unwrap();
    assert_eq!(get_log_level(), LogLevel::Error as u8);
}
