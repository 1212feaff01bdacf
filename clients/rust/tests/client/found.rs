//! Where programs look for streams without being told: the same in every language.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use edgecap_client::message::BodyFrame;
use edgecap_client::place::{SERVICE_FOLDER, reading_dirs, runtime_dir};
use edgecap_client::{Publisher, Subscriber};

use crate::strangers::copied_program;

const ROLE: &str = "EDGECAP_TEST_ROLE";
const NAMED: &str = "EDGECAP_RUNTIME_DIR";
const SESSION: &str = "XDG_RUNTIME_DIR";
/// A number that nobody has.
const STRANGER: u32 = 61003;

const PYTHON: &str = "from edgecap import place\n\
    print('folders', place.runtime_dir(), *place.reading_dirs())";

/// A process that says where it would publish and read; without a role this is no test.
#[test]
fn role() {
    if std::env::var(ROLE).is_ok_and(|role| role == "folders") {
        let read = reading_dirs().into_iter().map(|d| d.display().to_string());
        let read: Vec<String> = read.collect();
        println!("\nfolders {} {}", runtime_dir().display(), read.join(" "));
    }
    if std::env::var(ROLE).is_ok_and(|role| role == "moves") {
        let mut publisher = Publisher::<BodyFrame>::open("camera0").unwrap();
        let reader = Subscriber::<BodyFrame>::open("camera0").unwrap();
        std::env::set_current_dir("/").unwrap();
        // On a busy machine signs of life may come late.
        let found = (0..1000).any(|n| {
            std::thread::sleep(Duration::from_millis(10 * n.min(1)));
            publisher.publish(&BodyFrame::default()).unwrap();
            let late = Subscriber::<BodyFrame>::open("camera0").unwrap();
            reader.publisher_count() + late.publisher_count() == 2
        });
        println!("\nfolders {} {found}", runtime_dir().display());
    }
}

fn rust() -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "found::role", "--nocapture"]);
    command.env(ROLE, "folders");
    command
}

fn python() -> Option<Command> {
    crate::tools::has("python3").then(|| {
        let mut command = Command::new("python3");
        command.args(["-B", "-c", PYTHON]);
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../python");
        command.env("PYTHONPATH", path);
        command
    })
}

/// Where one publishes, then where one reads.
fn said(mut command: Command, session: Option<&Path>, named: Option<&Path>) -> Vec<String> {
    command.env_remove(NAMED).env_remove(SESSION);
    command.envs(named.map(|n| (NAMED, n)));
    command.envs(session.map(|s| (SESSION, s)));
    folders(command)
}

fn folders(mut command: Command) -> Vec<String> {
    let out = command.output().unwrap();
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    let line = text.lines().find_map(|l| l.strip_prefix("folders "));
    let line = line.unwrap_or_else(|| panic!("{text}{}", String::from_utf8_lossy(&out.stderr)));
    line.split(' ').map(str::to_owned).collect()
}

#[test]
fn a_folder_that_is_named_is_the_only_one() {
    let named = Path::new("/somewhere/else");
    let expected = vec!["/somewhere/else"; 2];
    assert_eq!(said(rust(), None, Some(named)), expected);
    if let Some(python) = python() {
        assert_eq!(said(python, None, Some(named)), expected);
    }
}

#[test]
fn a_folder_that_is_named_from_here_stays_where_it_is_when_the_process_moves() {
    let here = tempfile::tempdir().unwrap();
    let mut moves = rust();
    moves.env(ROLE, "moves").current_dir(here.path());
    let named = here.path().canonicalize().unwrap().join("run");
    let expected = vec![named.display().to_string(), "true".to_owned()];
    assert_eq!(said(moves, None, Some(Path::new("run"))), expected);
}

#[test]
fn a_session_has_its_own_and_a_strange_one_is_none() {
    let own = tempfile::tempdir().unwrap();
    // Whoever is root owns the one of the system.
    let strange = Path::new("/nowhere");
    let user = rustix::process::geteuid().as_raw();
    let is_service = fs::metadata(SERVICE_FOLDER).is_ok_and(|m| m.uid() == user);
    for session in [Some(own.path()), Some(strange), None] {
        let found = said(rust(), session, None);
        if let Some(python) = python() {
            assert_eq!(found, said(python, session, None), "{session:?}");
        }
        if session == Some(own.path()) && !is_service {
            assert_eq!(Path::new(&found[0]), own.path().join("edgecap"));
        } else {
            assert!(!found[0].starts_with("/nowhere"), "{found:?}");
        }
        assert_eq!(found[0], found[1]);
    }
}

/// Root alone can make the service's folder, in a place of its own.
#[test]
fn the_folder_of_a_service_is_read_by_those_who_may() {
    if !rustix::process::geteuid().is_root() {
        eprintln!("skipped: making {SERVICE_FOLDER} needs root");
        return;
    }
    let here = tempfile::tempdir().unwrap();
    fs::set_permissions(here.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let session = here.path().join("session");
    fs::create_dir(&session).unwrap();
    // A neighbouring test's reader may just have the umask changed, and the folder would let nobody in.
    fs::set_permissions(&session, fs::Permissions::from_mode(0o700)).unwrap();
    chown(&session, Some(STRANGER), Some(STRANGER)).unwrap();
    let program = copied_program(here.path());
    let own_memory = format!("/dev/shm/edgecap-{STRANGER}");
    let seen = |made: &str, owner: u32, group: u32| {
        let script = format!(
            "mount -t tmpfs -o mode=755 none /run; mount -t tmpfs -o mode=1777 none /dev/shm; \
             mkdir -m 750 {made}; chown {owner}:{group} {made}; cd /; \
             exec setpriv --reuid {STRANGER} --regid {STRANGER} --clear-groups \
             {} --exact found::role --nocapture",
            program.display()
        );
        let mut command = Command::new("unshare");
        command.args(["-m", "sh", "-ec", &script]);
        command.env(ROLE, "folders");
        command.env_remove(NAMED).env(SESSION, &session);
        command
    };
    let mut tried = Command::new("unshare");
    tried.args(["-m", "mount", "-t", "tmpfs", "none", "/run"]);
    if !tried.status().is_ok_and(|s| s.success()) || !crate::tools::has("setpriv") {
        eprintln!("skipped: no mount namespace here");
        return;
    }
    let own = session.join("edgecap").display().to_string();
    let service = SERVICE_FOLDER.to_owned();
    // Closed to them; their group's; their own; and where they publish without a session.
    let closed = vec![own.clone(), own.clone()];
    assert_eq!(folders(seen(SERVICE_FOLDER, 0, 0)), closed);
    let read = vec![own.clone(), own.clone(), service.clone()];
    assert_eq!(folders(seen(SERVICE_FOLDER, 0, STRANGER)), read);
    let theirs = vec![service.clone(), service];
    assert_eq!(folders(seen(SERVICE_FOLDER, STRANGER, 0)), theirs);
    assert_eq!(folders(seen(&own_memory, 0, 0)), closed);
    let read = vec![own.clone(), own, own_memory.clone()];
    assert_eq!(folders(seen(&own_memory, STRANGER, 0)), read);
}

/// Root alone can take a user's session away, in places of its own.
#[test]
fn a_stream_that_is_published_without_a_session_is_refused_within_one() {
    if !rustix::process::geteuid().is_root() {
        eprintln!("skipped: a /dev/shm of its own needs root");
        return;
    }
    let here = tempfile::tempdir().unwrap();
    let session = here.path().join("session");
    fs::create_dir(&session).unwrap();
    // A neighbouring test's reader may just have the umask changed.
    fs::set_permissions(&session, fs::Permissions::from_mode(0o700)).unwrap();
    let inside = |script: &str| {
        let mounts =
            "mount -t tmpfs -o mode=755 none /run; mount -t tmpfs -o mode=1777 none /dev/shm";
        let mut command = Command::new("unshare");
        command.args(["-m", "sh", "-ec", &format!("{mounts}; {script}")]);
        command.env("PROGRAM", std::env::current_exe().unwrap());
        command.env("HERE", here.path());
        command.env_remove(NAMED).env_remove(SESSION);
        command.output().unwrap()
    };
    if !inside("true").status.success() {
        eprintln!("skipped: no mount namespace here");
        return;
    }
    let out = inside(
        "EDGECAP_TEST_ROLE=writer $PROGRAM --exact strangers::role --nocapture > $HERE/said 2>&1 & \
         writer=$!; \
         until grep -qs publishes $HERE/said; do kill -0 $writer; sleep 0.05; done; \
         export XDG_RUNTIME_DIR=$HERE/session EDGECAP_TEST_ROLE=full; \
         ended=0; $PROGRAM --exact strangers::role --nocapture || ended=$?; \
         kill $writer; exit $ended",
    );
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(
        out.status.success() && said.contains("already publishes"),
        "{said}"
    );
}
