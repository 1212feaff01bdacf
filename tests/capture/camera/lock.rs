//! The lock that keeps a camera to one program.

use edgecap::capture::camera::InstanceLock;

#[test]
fn one_program_per_camera() {
    let folder = tempfile::tempdir().unwrap();
    let acquire = |key| InstanceLock::acquire_in(folder.path(), key);
    let first = acquire("/dev/video0").unwrap();
    assert!(first.is_held());
    let error = acquire("/dev/video0").unwrap_err();
    assert_eq!(error.exit_code(), 75);
    let text = error.to_string();
    assert!(
        text.contains("/dev/video0") && text.contains(&format!("process {}", std::process::id())),
        "{text}"
    );
    assert!(acquire("/dev/video1").unwrap().is_held());
    drop(first);
    assert!(acquire("/dev/video0").unwrap().is_held());
}

/// Where everybody may write, anybody could keep a camera from its owner for ever.
#[test]
fn a_lock_that_others_can_take_is_none() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let everyones = std::fs::Permissions::from_mode(0o777);
    std::fs::set_permissions(folder.path(), everyones).unwrap();
    let path = folder.path().join("edgecap-dev-video0.lock");
    let strangers = std::fs::File::create(path).unwrap();
    strangers.lock().unwrap();
    let lock = InstanceLock::acquire_in(folder.path(), "/dev/video0").unwrap();
    assert!(!lock.is_held());
}

#[test]
fn a_lock_given_back_is_free_while_a_neighbour_starts_programs() {
    let folder = tempfile::tempdir().unwrap();
    let started = std::sync::atomic::AtomicBool::new(true);
    std::thread::scope(|s| {
        s.spawn(|| {
            // A child has all open files of its parent until it becomes another program.
            for _ in 0..100 {
                std::process::Command::new("true").status().unwrap();
            }
            started.store(false, std::sync::atomic::Ordering::Relaxed);
        });
        while started.load(std::sync::atomic::Ordering::Relaxed) {
            let lock = InstanceLock::acquire_in(folder.path(), "/dev/video0").unwrap();
            assert!(lock.is_held());
        }
    });
}

#[test]
fn a_lock_file_that_is_a_link_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let victim = folder.path().join("victim");
    std::fs::write(&victim, "precious").unwrap();
    std::os::unix::fs::symlink(&victim, folder.path().join("edgecap-dev-video0.lock")).unwrap();
    let lock = InstanceLock::acquire_in(folder.path(), "/dev/video0").unwrap();
    assert!(!lock.is_held());
    assert_eq!(std::fs::read_to_string(&victim).unwrap(), "precious");
}
