//! Other users, other processes and what they leave: nobody can keep a publisher out, bring it down or feed its readers
//! lies.
//!
//! Tests start this program again as another process (`role`), under another user where they run as root.

use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::{PermissionsExt, chown};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, ObservationFrame};
use edgecap_client::place::clear_at;
use edgecap_client::{LinkError, Publisher, Subscriber};

const ROLE: &str = "EDGECAP_TEST_ROLE";
const PLACE: &str = "EDGECAP_RUNTIME_DIR";
const CAMERA: &str = "camera0";
const PATIENCE: Duration = Duration::from_secs(20);
/// Numbers that nobody has.
const OWNER: u32 = 61001;
const MEMBER: u32 = 61002;
const STRANGER: u32 = 61003;
const GROUP: u32 = 61001;

/// What a process of a test does; without a role this is no test.
#[test]
fn role() {
    match std::env::var(ROLE).as_deref() {
        Ok("writer") => {
            let mut publisher = Publisher::<BodyFrame>::open(CAMERA).unwrap();
            println!("\npublishes");
            // A minute long, and so slowly that a reader who waits for the processor for a while loses none.
            for sequence in 0..1500 {
                let message = BodyFrame {
                    sequence,
                    ..BodyFrame::default()
                };
                publisher.publish(&message).unwrap();
                std::thread::sleep(Duration::from_millis(40));
            }
        }
        Ok("reader") => match Subscriber::<BodyFrame>::open(CAMERA) {
            Ok(reader) => {
                println!("\nopen");
                let mut was = None;
                let start = Instant::now();
                while start.elapsed() < 3 * PATIENCE {
                    let got = reader.next(Duration::from_millis(20)).unwrap().is_some();
                    let now = reader.publisher_count();
                    if got && was != Some(1) {
                        println!("\nreads");
                    }
                    if now == 0 && was == Some(1) {
                        println!("\ngone");
                    }
                    was = if got {
                        Some(1)
                    } else {
                        was.filter(|_| now == 1).or(was.map(|_| 0))
                    };
                }
            }
            Err(e) => println!("\nrefused: {e}"),
        },
        Ok("counter") => {
            let reader = Subscriber::<BodyFrame>::open(CAMERA).unwrap();
            let first = reader.next(PATIENCE).unwrap().map(|m| m.sequence);
            let mut last = first;
            for _ in 0..150 {
                last = reader.next(PATIENCE).unwrap().map(|m| m.sequence);
            }
            println!("\nread {}", last.unwrap() - first.unwrap());
            // Until it is killed.
            std::thread::sleep(3 * PATIENCE);
        }
        Ok("full") => {
            let error = Publisher::<BodyFrame>::open(CAMERA).unwrap_err();
            println!("\nrefused: {error}");
        }
        Ok("harm") => harm(Path::new(&std::env::var(PLACE).unwrap())),
        _ => {}
    }
}

/// All that a reader could try against a publisher, as far as it is let.
fn harm(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else {
        println!("\nno entry");
        return;
    };
    let mut held = vec![fs::File::open(folder).unwrap()];
    for path in entries.map(|e| e.unwrap().path()) {
        let wrote = fs::OpenOptions::new().write(true).open(&path).is_ok();
        let gone = fs::remove_file(&path).is_ok() || fs::rename(&path, path.join("x")).is_ok();
        let entered = path.is_dir() && fs::read_dir(&path).is_ok();
        assert!(!wrote && !gone && !entered, "{}", path.display());
        held.extend(fs::File::open(&path));
    }
    assert!(fs::write(folder.join("camera0.bodies.lock2"), "").is_err());
    assert!(held.len() > 1, "the stream can be read");
    for file in &held {
        rustix::fs::flock(file, rustix::fs::FlockOperation::NonBlockingLockExclusive).ok();
    }
    println!("\nholds what it can");
    std::thread::sleep(PATIENCE);
}

/// A process of a test, killed at its end.
struct Player(Child, BufReader<ChildStdout>);

impl Drop for Player {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Player {
    fn start(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let out = BufReader::new(child.stdout.take().unwrap());
        Self(child, out)
    }

    /// Waits for a line that begins so.
    fn says(&mut self, word: &str) -> String {
        for line in (&mut self.1).lines() {
            let line = line.unwrap();
            if line.starts_with(word) {
                return line;
            }
        }
        panic!("it ended without saying '{word}': {:?}", self.0.wait());
    }
}

fn role_of(name: &str, folder: &Path) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "strangers::role", "--nocapture"]);
    command.env(ROLE, name).env(PLACE, folder);
    command
}

fn place() -> (tempfile::TempDir, PathBuf) {
    let parent = tempfile::tempdir().unwrap();
    // A neighbouring test's reader may just have the umask changed, and the folder would not let anybody in.
    fs::set_permissions(&parent, fs::Permissions::from_mode(0o700)).unwrap();
    let folder = parent.path().join("edgecap");
    (parent, folder)
}

/// This program where others may run it: not what lies in a home. Copied by a child: a program that this process holds
/// open for writing cannot be run while a neighbouring test's fork holds it as well.
pub fn copied_program(folder: &Path) -> PathBuf {
    let program = folder.join("program");
    let mut copy = Command::new("cp");
    copy.arg(std::env::current_exe().unwrap()).arg(&program);
    assert!(copy.status().unwrap().success());
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    program
}

fn is_root(what: &str) -> bool {
    let root = rustix::process::geteuid().is_root();
    if !root {
        eprintln!("skipped: {what} needs root");
    }
    root
}

/// All files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .flat_map(|e| match e.path() {
            p if p.is_dir() => files(&p),
            p => vec![p],
        })
        .collect()
}

fn publishes_and_is_read(folder: &Path) {
    let mut publisher = Publisher::<BodyFrame>::open_at(folder, CAMERA).unwrap();
    let reader = Subscriber::<BodyFrame>::open_at(folder, CAMERA).unwrap();
    publisher.publish(&BodyFrame::default()).unwrap();
    assert!(reader.next(PATIENCE).unwrap().is_some());
    assert_eq!(publisher.subscriber_count(), 1);
}

#[test]
fn a_group_reads_and_cannot_write_and_strangers_see_nothing() {
    if !is_root("acting as three users") {
        return;
    }
    let (parent, folder) = place();
    let program = copied_program(parent.path());
    fs::set_permissions(parent.path(), fs::Permissions::from_mode(0o755)).unwrap();
    fs::create_dir(&folder).unwrap();
    chown(&folder, Some(OWNER), Some(GROUP)).unwrap();
    fs::set_permissions(&folder, fs::Permissions::from_mode(0o750)).unwrap();
    let play = |role: &str, user: u32, group: u32| {
        let mut command = Command::new(&program);
        command.args(["--exact", "strangers::role", "--nocapture"]);
        command.env(ROLE, role).env(PLACE, &folder).current_dir("/");
        Player::start({
            command.uid(user).gid(group);
            command
        })
    };
    let mut reader = play("reader", MEMBER, GROUP);
    reader.says("open");
    let mut writer = play("writer", OWNER, GROUP);
    writer.says("publishes");
    reader.says("reads");
    let refused = play("reader", STRANGER, STRANGER).says("refused");
    assert!(refused.contains("add this user to the group"), "{refused}");
    play("harm", STRANGER, STRANGER).says("no entry");

    // Root may do everything, and leaves nothing that the owner could not remove.
    let mut counter = play("counter", 0, 0);
    assert_eq!(counter.says("read "), "read 150");
    drop(counter);

    let mut harm = play("harm", MEMBER, GROUP);
    harm.says("holds what it can");
    drop(writer);
    reader.says("gone");
    let mut writer = play("writer", OWNER, GROUP);
    writer.says("publishes");
    reader.says("reads");

    // The clone may lie in somebody's home, too.
    let client = parent.path().join("client");
    fs::create_dir(&client).unwrap();
    let from = concat!(env!("CARGO_MANIFEST_DIR"), "/../python/edgecap");
    let copied = Command::new("cp").arg("-r").arg(from).arg(&client).status();
    let opened = Command::new("chmod")
        .args(["-R", "a+rX"])
        .arg(&client)
        .status();
    assert!(copied.unwrap().success() && opened.unwrap().success());
    let script =
        "import edgecap\ns = edgecap.bodies('camera0')\nassert s.next(20) and s.publishers() == 1";
    let mut python = Command::new("python3");
    python.args(["-B", "-c", script]).current_dir("/");
    python.env("PYTHONPATH", &client).env(PLACE, &folder);
    if crate::tools::has("python3") {
        assert!(python.uid(MEMBER).gid(GROUP).status().unwrap().success());
    }
}

/// iceoryx2 keeps all but 0600 back from the whole process while it binds a socket: folders that a neighbouring thread
/// makes then, or a child that is started then, get no more.
#[test]
fn a_process_from_which_permissions_are_kept_back_publishes_and_reads() {
    if !is_root("acting as a user whom permissions bind") {
        return;
    }
    let (parent, folder) = place();
    let program = copied_program(parent.path());
    chown(parent.path(), Some(OWNER), Some(GROUP)).unwrap();
    let play = |role: &str| {
        let mut command = Command::new("sh");
        command.args([
            "-c",
            "umask 0177 && exec \"$0\" --exact strangers::role --nocapture",
        ]);
        command.arg(&program).env(ROLE, role).env(PLACE, &folder);
        command.current_dir("/").uid(OWNER).gid(GROUP);
        Player::start(command)
    };
    let mut writer = play("writer");
    writer.says("publishes");
    play("reader").says("reads");
}

/// A way to damage a file, by its name.
type Spoil = (&'static str, fn(&Path));

#[test]
fn whatever_the_dead_left_the_next_start_succeeds() {
    let spoil: [Spoil; 5] = [
        ("emptied", |f| drop(fs::File::create(f).unwrap())),
        ("noise", |f| fs::write(f, vec![0xa5; 70_000]).unwrap()),
        ("zeros", |f| fs::write(f, vec![0; 70_000]).unwrap()),
        ("cut", |f| {
            let file = fs::OpenOptions::new().write(true).open(f).unwrap();
            file.set_len(file.metadata().unwrap().len() / 2).unwrap();
        }),
        ("mode 200", |f| {
            fs::set_permissions(f, fs::Permissions::from_mode(0o200)).unwrap();
        }),
    ];
    let (_parent, folder) = place();
    for (how, spoil) in spoil {
        let mut writer = Player::start(role_of("writer", &folder));
        writer.says("publishes");
        let mut reader = Player::start(role_of("reader", &folder));
        reader.says("reads");
        drop((writer, reader));
        let left = files(&folder);
        assert!(left.len() > 10, "{left:?}");
        for file in left
            .iter()
            .filter(|f| f.metadata().is_ok_and(|m| m.is_file()))
        {
            if fs::metadata(file).unwrap().permissions().mode() & 0o200 == 0 {
                fs::set_permissions(file, fs::Permissions::from_mode(0o600)).unwrap();
            }
            spoil(file);
        }
        eprintln!("{how}");
        publishes_and_is_read(&folder);
        assert_eq!(files(&folder), Vec::<PathBuf>::new(), "{how}");
    }
}

#[test]
fn damage_of_one_camera_does_not_reach_another() {
    let (_parent, folder) = place();
    let mut well = Publisher::<BodyFrame>::open_at(&folder, "well").unwrap();
    let reader = Subscriber::<BodyFrame>::open_at(&folder, "well").unwrap();
    let before = files(&folder);
    let mut writer = Player::start(role_of("writer", &folder));
    writer.says("publishes");
    for file in files(&folder).iter().filter(|f| !before.contains(f)) {
        // Cut below a living process: that one may die of it.
        if let Ok(file) = fs::OpenOptions::new().write(true).open(file) {
            let _ = file.set_len(0);
        }
    }
    for _ in 0..20 {
        well.publish(&BodyFrame::default()).unwrap();
        assert!(reader.next(PATIENCE).unwrap().is_some());
    }
    drop(writer);
    let _third = Publisher::<BodyFrame>::open_at(&folder, "third").unwrap();
    well.publish(&BodyFrame::default()).unwrap();
    assert!(reader.next(PATIENCE).unwrap().is_some());
}

#[test]
fn a_kill_at_any_moment_of_the_start_leaves_nothing_that_matters() {
    let (_parent, folder) = place();
    let begin = Instant::now();
    let mut whole = Player::start(role_of("writer", &folder));
    whole.says("publishes");
    let start = begin.elapsed();
    drop(whole);
    let mut left = 0;
    for kill in 0..40 {
        let mut child = role_of("writer", &folder)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(start * kill / 32);
        child.kill().unwrap();
        assert_eq!(child.wait().unwrap().signal(), Some(9));
        left += usize::from(files(&folder).len() > 1);
    }
    assert!(left > 0, "all were killed before they made anything");
    publishes_and_is_read(&folder);
    // A domain that was killed before its lock was made stays for ten seconds; it holds nothing.
    assert_eq!(files(&folder), Vec::<PathBuf>::new());
}

#[test]
fn readers_that_are_killed_leave_the_writer_alone() {
    let (_parent, folder) = place();
    let mut publisher = Publisher::<BodyFrame>::open_at(&folder, CAMERA).unwrap();
    for kill in 0..30 {
        let mut child = role_of("reader", &folder)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        for _ in 0..=kill {
            publisher.publish(&BodyFrame::default()).unwrap();
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
    }
    // The writer frees what the dead left while it publishes. Of nodes that joined a service its own stays, in two.
    let joined = |f: &&PathBuf| f.extension().is_some_and(|e| e == "service_tag");
    let tags = || files(&folder).iter().filter(joined).count();
    let begin = Instant::now();
    while tags() > 2 || publisher.subscriber_count() > 0 {
        assert!(
            begin.elapsed() < 3 * PATIENCE,
            "nobody frees what the dead left"
        );
        publisher.publish(&BodyFrame::default()).unwrap();
        std::thread::sleep(Duration::from_millis(20));
    }
    let reader = Subscriber::<BodyFrame>::open_at(&folder, CAMERA).unwrap();
    publisher.publish(&BodyFrame::default()).unwrap();
    assert!(reader.next(PATIENCE).unwrap().is_some());
    assert_eq!((publisher.subscriber_count(), tags()), (1, 4));
}

#[test]
fn files_that_are_cleaned_away_come_back_and_no_second_writer_with_them() {
    let (_parent, folder) = place();
    let mut publisher = Publisher::<ObservationFrame>::open_at(&folder, CAMERA).unwrap();
    let reader = Subscriber::<ObservationFrame>::open_at(&folder, CAMERA).unwrap();
    for whole in [false, true] {
        if whole {
            fs::remove_dir_all(&folder).unwrap();
        } else {
            files(&folder)
                .iter()
                .for_each(|f| fs::remove_file(f).unwrap());
        }
        let second = Publisher::<ObservationFrame>::open_at(&folder, CAMERA).unwrap_err();
        assert!(matches!(second, LinkError::Busy { .. }), "{second}");
        let (start, mut sequence) = (Instant::now(), 0);
        loop {
            sequence += 1;
            let message = ObservationFrame {
                sequence,
                ..ObservationFrame::default()
            };
            publisher.publish(&message).unwrap();
            std::thread::sleep(Duration::from_millis(20));
            let fresh = Subscriber::<ObservationFrame>::open_at(&folder, CAMERA).unwrap();
            if fresh.publisher_count() == 1 {
                break;
            }
            assert!(start.elapsed() < PATIENCE, "nobody finds it any more");
        }
        let mut newest = 0;
        while newest < sequence {
            let got = reader.newest(PATIENCE).unwrap().expect("a message");
            newest = got.sequence;
        }
    }
}

#[test]
fn memory_that_is_full_is_told_and_kills_nobody() {
    if !is_root("a file system of its own") {
        return;
    }
    let (parent, _) = place();
    let mounted = |size: &str, script: &str| {
        let program = std::env::current_exe().unwrap();
        let out = Command::new("unshare")
            .args(["-m", "sh", "-ec"])
            .arg(format!(
                "mount -t tmpfs -o size={size},mode=700 none {0}; {script}",
                parent.path().display()
            ))
            .env("PROGRAM", program)
            .env("HERE", parent.path())
            .env(PLACE, parent.path().join("edgecap"))
            .output()
            .unwrap();
        (
            out.status,
            String::from_utf8(out.stdout).unwrap() + &String::from_utf8(out.stderr).unwrap(),
        )
    };
    let (status, _) = mounted("1m", "true");
    if !status.success() {
        eprintln!("skipped: no mount namespace here");
        return;
    }
    let (status, said) = mounted(
        "1m",
        &format!("{ROLE}=full $PROGRAM --exact strangers::role --nocapture"),
    );
    assert!(status.success(), "{said}");
    assert!(
        said.contains("no room in") && said.contains("found 1024 KiB"),
        "{said}"
    );
    // Filled up by somebody else once it runs: it goes on, and is read, however little is left. 135 is SIGBUS: a reader
    // wrote into memory that is not there.
    let (status, said) = mounted(
        "64m",
        &format!(
            "{ROLE}=writer $PROGRAM --exact strangers::role --nocapture > $HERE/said & writer=$!; \
             while ! grep -q publishes $HERE/said; do sleep 0.05; done; \
             mkfifo $HERE/heard; \
             for left in 0 8 12 32; do \
                 dd if=/dev/zero of=$HERE/fill bs=4k 2> /dev/null || true; \
                 truncate -s -${{left}}K $HERE/fill; \
                 {ROLE}=reader $PROGRAM --exact strangers::role --nocapture > $HERE/heard & reader=$!; \
                 timeout 30 grep -m 1 reads $HERE/heard || echo silent; \
                 kill $reader || true; \
                 ended=0; wait $reader || ended=$?; \
                 echo \"with $left KiB left: $ended\"; \
                 test $ended -ne 135; \
             done; \
             kill -0 $writer; kill $writer"
        ),
    );
    assert!(status.success(), "{status} {said}");
    assert_eq!(said.matches("reads").count(), 4, "{said}");
}

#[test]
fn a_reader_finds_out_that_the_writer_is_gone_and_that_it_is_back() {
    let (_parent, folder) = place();
    let reader = Subscriber::<BodyFrame>::open_at(&folder, CAMERA).unwrap();
    let mut took = Vec::new();
    for _ in 0..3 {
        let mut writer = Player::start(role_of("writer", &folder));
        writer.says("publishes");
        assert!(reader.next(PATIENCE).unwrap().is_some());
        let start = Instant::now();
        // On a busy machine signs of life may come late.
        while reader.publisher_count() != 1 {
            assert!(start.elapsed() < PATIENCE, "it publishes");
            std::thread::sleep(Duration::from_millis(10));
        }
        drop(writer);
        let start = Instant::now();
        while reader.publisher_count() == 1 {
            assert!(start.elapsed() < PATIENCE, "it died long ago");
            std::thread::sleep(Duration::from_millis(10));
        }
        took.push(start.elapsed());
        while reader.next(Duration::ZERO).unwrap().is_some() {}
    }
    // The shortest: this process may have waited for the processor.
    let shortest = took.into_iter().min().unwrap();
    assert!(shortest < Duration::from_secs(1), "{shortest:?}");
    assert_eq!(clear_at(&folder).unwrap(), Vec::<String>::new());
    assert_eq!(files(&folder), Vec::<PathBuf>::new());
}

#[test]
fn python_finds_out_too() {
    let (_parent, folder) = place();
    let script = "import edgecap, time\n\
        s = edgecap.bodies('camera0')\n\
        for life in range(3):\n\
        \x20   while s.next(0.1) is None: pass\n\
        \x20   end = time.monotonic() + 20\n\
        \x20   while s.publishers() != 1 and time.monotonic() < end: time.sleep(0.01)\n\
        \x20   assert s.publishers() == 1\n\
        \x20   print('reads', flush=True)\n\
        \x20   while s.publishers(): s.next(0.02)\n\
        \x20   print('gone', flush=True)\n\
        \x20   while s.next(0) is not None: pass\n";
    let mut command = Command::new("python3");
    command.args(["-B", "-c", script]).env(PLACE, &folder);
    command.env(
        "PYTHONPATH",
        concat!(env!("CARGO_MANIFEST_DIR"), "/../python"),
    );
    if !crate::tools::has("python3") {
        return;
    }
    let mut python = Player::start(command);
    let mut took = Vec::new();
    for _ in 0..3 {
        let mut writer = Player::start(role_of("writer", &folder));
        writer.says("publishes");
        python.says("reads");
        drop(writer);
        let start = Instant::now();
        python.says("gone");
        took.push(start.elapsed());
    }
    // The shortest: either process may have waited for the processor.
    let shortest = took.into_iter().min().unwrap();
    assert!(shortest < Duration::from_secs(2), "{shortest:?}");
    assert!(python.0.wait().unwrap().success());
}
