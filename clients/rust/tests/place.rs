//! The folder and the objects of an installation: whose they are, and what becomes of what the dead leave.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::time::{Duration, SystemTime};

use edgecap_client::LinkError;
use edgecap_client::place::{Cleared, Place, clear_at};

#[test]
fn a_place_is_made_once_and_for_one_user() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("edgecap");
    let place = Place::enter_at(&folder).unwrap();
    assert_eq!(fs::metadata(&folder).unwrap().mode() & 0o777, 0o700);
    let prefix = fs::read_to_string(folder.join("prefix")).unwrap();
    let again = Place::enter_at(&folder).unwrap();
    assert_eq!(
        prefix,
        fs::read_to_string(again.folder().join("prefix")).unwrap()
    );
    let other = Place::enter_at(&parent.path().join("other")).unwrap();
    assert_ne!(
        prefix,
        fs::read_to_string(other.folder().join("prefix")).unwrap()
    );
    drop(place);
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
    refused(&parent.path().join("a/b"), "No such file");
}

#[test]
fn a_place_is_cleared_only_when_nobody_uses_it() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("edgecap");
    let place = Place::enter_at(&folder).unwrap();
    let prefix = fs::read_to_string(folder.join("prefix")).unwrap();
    let object = std::path::PathBuf::from(format!("/dev/shm/{prefix}left.dynamic"));
    fs::write(&object, "damaged").unwrap();
    fs::create_dir(folder.join("services")).unwrap();
    assert_eq!(clear_at(&folder).unwrap(), Cleared::InUse);
    assert!(object.exists());
    drop(place);
    assert_eq!(clear_at(&folder).unwrap(), Cleared::All);
    assert!(!object.exists() && !folder.join("services").exists());
    Place::enter_at(&folder).unwrap();
    assert_ne!(prefix, fs::read_to_string(folder.join("prefix")).unwrap());
}

#[test]
fn what_was_never_finished_is_removed_once_it_is_old() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("edgecap");
    drop(Place::enter_at(&folder).unwrap());
    let prefix = fs::read_to_string(folder.join("prefix")).unwrap();
    let unfinished = |name: &str, age: u64| {
        let path = std::path::PathBuf::from(format!("/dev/shm/{prefix}{name}"));
        let file = fs::File::create(&path).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(age))
            .unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o200)).unwrap();
        path
    };
    let (old, new) = (unfinished("old", 60), unfinished("new", 0));
    drop(Place::enter_at(&folder).unwrap());
    assert!(!old.exists() && new.exists());
    fs::remove_file(new).unwrap();
}
