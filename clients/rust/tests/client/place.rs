//! The folder of an installation: where it is, and whose.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::time::Duration;

use edgecap_client::message::BodyFrame;
use edgecap_client::place::{Place, clear_at};
use edgecap_client::{LinkError, Publisher, Subscriber};

#[test]
fn a_place_is_made_for_one_user_and_a_group_may_be_let_in() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("edgecap");
    let place = Place::enter_at(&folder).unwrap();
    assert_eq!(fs::metadata(&folder).unwrap().mode() & 0o777, 0o700);
    assert_eq!(place.readers(), None);
    let mode = |folder: &std::path::Path| {
        let _publisher = Publisher::<BodyFrame>::open_at(folder, "camera0").unwrap();
        let meta = fs::metadata(folder.join("camera0.bodies.v2")).unwrap();
        meta.mode() & 0o777
    };
    assert_eq!(mode(&folder), 0o600);
    fs::set_permissions(&folder, fs::Permissions::from_mode(0o750)).unwrap();
    let place = Place::enter_at(&folder).unwrap();
    assert_eq!(place.readers(), Some(fs::metadata(&folder).unwrap().gid()));
    assert_eq!(mode(&folder), 0o640);
}

#[test]
fn a_place_that_others_could_change_is_refused() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("open");
    fs::create_dir(&folder).unwrap();
    fs::set_permissions(&folder, fs::Permissions::from_mode(0o777)).unwrap();
    let refused = |folder: &std::path::Path, word: &str| {
        let error = Place::enter_at(folder).unwrap_err();
        assert!(matches!(error, LinkError::Place { .. }));
        assert!(error.to_string().contains(word), "{error}");
        assert!(error.to_string().contains("EDGECAP_RUNTIME_DIR"), "{error}");
    };
    refused(&folder, "mode 777");
    let link = parent.path().join("link");
    symlink(parent.path(), &link).unwrap();
    refused(&link, "expected a folder");
    let error = Place::enter_at(&parent.path().join("a/b")).unwrap_err();
    assert!(matches!(error, LinkError::NoPlace { .. }), "{error}");
    assert!(error.to_string().contains("a is not there"), "{error}");
}

#[test]
fn clearing_takes_what_the_dead_left_and_leaves_the_living() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("edgecap");
    let publisher = Publisher::<BodyFrame>::open_at(&folder, "camera0").unwrap();
    let dead = folder.join("d0123456789abcdef");
    fs::create_dir_all(dead.join("services")).unwrap();
    fs::write(dead.join("lock"), "").unwrap();
    fs::write(dead.join("services/e_1.dynamic"), "damaged").unwrap();
    fs::write(folder.join("gone.bodies.v2"), "damaged").unwrap();
    let strange = folder.join("strange");
    fs::write(&strange, "not ours").unwrap();
    assert_eq!(clear_at(&folder).unwrap(), ["camera0.bodies"]);
    assert!(!dead.exists() && !folder.join("gone.bodies.v2").exists());
    drop(publisher);
    assert_eq!(clear_at(&folder).unwrap(), Vec::<String>::new());
    let left: Vec<_> = fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    assert_eq!(left, [strange]);
}

#[test]
fn a_reader_may_come_through_a_link_however_long() {
    let parent = tempfile::tempdir().unwrap();
    let [real, link] = ["real", &"x".repeat(150)].map(|name| parent.path().join(name));
    fs::create_dir(&real).unwrap();
    // A neighbouring test's reader may just have the umask changed.
    fs::set_permissions(&real, fs::Permissions::from_mode(0o700)).unwrap();
    symlink(&real, &link).unwrap();
    let mut publisher = Publisher::<BodyFrame>::open_at(&real.join("edgecap"), "camera0").unwrap();
    let reader = Subscriber::<BodyFrame>::open_at(&link.join("edgecap"), "camera0").unwrap();
    publisher.publish(&BodyFrame::default()).unwrap();
    assert!(reader.next(Duration::from_secs(20)).unwrap().is_some());
    assert_eq!(publisher.subscriber_count(), 1, "in place");
}

#[test]
fn a_path_too_long_for_a_socket_is_refused() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("x".repeat(60));
    let error = Publisher::<BodyFrame>::open_at(&folder, "camera0").unwrap_err();
    assert!(error.to_string().contains("characters, found"), "{error}");
}
