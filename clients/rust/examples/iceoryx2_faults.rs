//! What edgecap works around in iceoryx2, each case as small as it gets, for its maintainers and for whoever updates
//! it.
//!
//! ```text
//! cargo run -p edgecap-client --example iceoryx2_faults
//! ```
//!
//! Nothing of edgecap is used: plain iceoryx2 with its own kind of service, a root folder and a prefix of this run's.
//! Every case runs in a process of its own, because some of them end it. A line a case says what was seen; where one
//! says "nothing wrong", the work-around (`domain.rs`, `service.rs`, `link.rs`) may go.

use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path as FilePath, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use std::{env, fs, process, thread};

use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

type Failed = Box<dyn std::error::Error>;
const SHARED_MEMORY: &str = "/dev/shm";
const PATIENCE: Duration = Duration::from_secs(10);

fn main() -> Result<(), Failed> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    if let [role, root, prefix] = arguments.as_slice() {
        return child(role, root, prefix);
    }
    modes()?;
    half_made()?;
    truncated_count()?;
    for kind in [".dynamic", ".service", ".connection", ".event_mgmt"] {
        damaged(kind)?;
    }
    readers_keep_the_writer_out()
}

/// A root folder and a prefix that nobody else has; what is called so goes in the end.
struct Place {
    root: tempfile::TempDir,
    prefix: String,
}

impl Place {
    fn new() -> Result<Self, Failed> {
        static NEXT: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        let next = NEXT.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        Ok(Self {
            root: tempfile::tempdir()?,
            prefix: format!("faults{}x{next}_", process::id()),
        })
    }

    fn start(&self, role: &str) -> Result<Child, Failed> {
        Ok(Command::new(env::current_exe()?)
            .arg(role)
            .arg(self.root.path())
            .arg(&self.prefix)
            .env("IOX2_LOG_LEVEL", "Fatal")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()?)
    }

    /// What a new process sees that makes or opens the service.
    fn tries(&self, role: &str) -> Result<String, Failed> {
        let mut child = self.start(role)?;
        let start = Instant::now();
        let status = loop {
            match child.try_wait()? {
                Some(status) => break status,
                None if start.elapsed() > PATIENCE => {
                    child.kill()?;
                    child.wait()?;
                    return Ok(format!("hangs (killed after {PATIENCE:?})"));
                }
                None => thread::sleep(Duration::from_millis(10)),
            }
        };
        if let Some(signal) = status.signal() {
            return Ok(format!("dies of signal {signal}"));
        }
        let said = child.stdout.take().map(std::io::read_to_string);
        Ok(said.transpose()?.unwrap_or_default().trim().to_owned())
    }

    /// A writer and its reader that were killed, and all that they left.
    fn dead_pair(&self) -> Result<(), Failed> {
        let mut writer = self.start("hold")?;
        wait_for_line(&mut writer)?;
        let mut reader = self.start("read")?;
        wait_for_line(&mut reader)?;
        // The writer sees the reader with its next message, within 10 ms.
        thread::sleep(Duration::from_millis(200));
        for mut process in [writer, reader] {
            process.kill()?;
            process.wait()?;
        }
        Ok(())
    }

    fn files(&self) -> Vec<PathBuf> {
        let mut found = Vec::new();
        let mut folders = vec![self.root.path().to_owned()];
        let mine = |path: &FilePath| {
            path.file_name()
                .is_some_and(|n| n.to_string_lossy().contains(&self.prefix))
        };
        found.extend(
            entries(FilePath::new(SHARED_MEMORY))
                .into_iter()
                .filter(|p| mine(p)),
        );
        while let Some(folder) = folders.pop() {
            for path in entries(&folder) {
                if path.is_dir() {
                    folders.push(path);
                } else {
                    found.push(path);
                }
            }
        }
        found
    }

    fn ending(&self, with: &str) -> Vec<PathBuf> {
        let ends = |p: &PathBuf| p.to_string_lossy().ends_with(with);
        self.files().into_iter().filter(ends).collect()
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        for file in self.files() {
            let _ = fs::remove_file(file);
        }
    }
}

fn entries(folder: &FilePath) -> Vec<PathBuf> {
    let read = fs::read_dir(folder).into_iter().flatten();
    read.flatten().map(|e| e.path()).collect()
}

fn wait_for_line(child: &mut Child) -> Result<(), Failed> {
    let out = child.stdout.take().ok_or("no output")?;
    let mut line = String::new();
    BufReader::new(out).read_line(&mut line)?;
    match line.trim() {
        "ready" => Ok(()),
        other => Err(format!("expected a process that is ready, found '{other}'").into()),
    }
}

/// 1. Objects in shared memory that every login may write, in a folder that everybody sees.
fn modes() -> Result<(), Failed> {
    let place = Place::new()?;
    let mut writer = place.start("hold")?;
    wait_for_line(&mut writer)?;
    let mut open = Vec::new();
    for file in place.files() {
        let mode = fs::metadata(&file)?.permissions().mode() & 0o777;
        if mode & 0o022 != 0 {
            open.push(format!("{} {mode:04o}", file.display()));
        }
    }
    writer.kill()?;
    writer.wait()?;
    say(
        "who may write",
        &if open.is_empty() {
            nothing()
        } else {
            open.join(", ")
        },
    );
    Ok(())
}

/// 2. A first start that was killed between making the file that counts nodes and giving it its mode.
fn half_made() -> Result<(), Failed> {
    let place = Place::new()?;
    place.dead_pair()?;
    for file in place.ending(".global_mgmt") {
        fs::set_permissions(file, fs::Permissions::from_mode(0o200))?;
    }
    say(
        "start after a first start that was killed half-way",
        &place.tries("make")?,
    );
    Ok(())
}

/// 3. The same file, made empty, as every login may.
fn truncated_count() -> Result<(), Failed> {
    let place = Place::new()?;
    place.dead_pair()?;
    for file in place.ending(".global_mgmt") {
        fs::write(file, [])?;
    }
    say(
        "start after a stranger emptied .global_mgmt",
        &place.tries("make")?,
    );
    Ok(())
}

/// 4. What dead processes left, cut to nothing or overwritten.
fn damaged(kind: &str) -> Result<(), Failed> {
    for (how, content) in [("emptied", None), ("overwritten", Some(0xa5_u8))] {
        let place = Place::new()?;
        place.dead_pair()?;
        let files = place.ending(kind);
        if files.is_empty() {
            continue;
        }
        for file in files {
            let length = fs::metadata(&file)?.len();
            let _ = fs::set_permissions(&file, fs::Permissions::from_mode(0o600));
            fs::write(
                &file,
                content.map_or(vec![], |byte| vec![byte; length as usize]),
            )?;
        }
        say(
            &format!("start after {kind} of dead processes was {how}"),
            &place.tries("make")?,
        );
    }
    Ok(())
}

/// 5. As many readers as there is room for, and a writer that starts again.
fn readers_keep_the_writer_out() -> Result<(), Failed> {
    let place = Place::new()?;
    let mut writer = place.start("hold")?;
    wait_for_line(&mut writer)?;
    let mut readers = Vec::new();
    for _ in 0..24 {
        let mut reader = place.start("read")?;
        if wait_for_line(&mut reader).is_err() {
            let _ = reader.kill();
            reader.wait()?;
            break;
        }
        readers.push(reader);
    }
    writer.kill()?;
    writer.wait()?;
    // One more takes the place that became free.
    let mut late = place.start("read")?;
    let took = wait_for_line(&mut late).is_ok();
    let seen = place.tries("make")?;
    say(
        &format!(
            "writer's start beside {} readers",
            readers.len() + usize::from(took)
        ),
        &seen,
    );
    for reader in readers.iter_mut().chain([&mut late]) {
        reader.kill()?;
        reader.wait()?;
    }
    Ok(())
}

fn say(case: &str, seen: &str) {
    println!("{case}: {seen}");
}

fn nothing() -> String {
    "nothing wrong".into()
}

fn child(role: &str, root: &str, prefix: &str) -> Result<(), Failed> {
    let opened = open(root, prefix);
    let (_node, service) = match opened {
        Ok(both) => both,
        Err(e) => {
            println!("{e}");
            return Ok(());
        }
    };
    if role == "read" {
        let _reader = service.subscriber_builder().create()?;
        println!("ready");
        thread::sleep(6 * PATIENCE);
        return Ok(());
    }
    match service.publisher_builder().create() {
        Err(e) => println!("{e:?}"),
        Ok(writer) if role == "hold" => {
            println!("ready");
            let start = Instant::now();
            while start.elapsed() < 6 * PATIENCE {
                writer.send_copy(1)?;
                thread::sleep(Duration::from_millis(10));
            }
        }
        Ok(_writer) => println!("{}", nothing()),
    }
    Ok(())
}

type Opened = (Node<ipc::Service>, PortFactory<ipc::Service, u64, ()>);

fn open(root: &str, prefix: &str) -> Result<Opened, String> {
    let failed = |e: &dyn core::fmt::Debug| format!("{e:?}");
    let mut config = Config::default();
    config
        .global
        .set_root_path(&Path::new(root.as_bytes()).map_err(|e| failed(&e))?);
    config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|e| failed(&e))?;
    let node = NodeBuilder::new()
        .config(&config)
        .create::<ipc::Service>()
        .map_err(|e| failed(&e))?;
    let name = ServiceName::new("faults").map_err(|e| failed(&e))?;
    let service = node
        .service_builder(&name)
        .publish_subscribe::<u64>()
        .max_subscribers(64)
        .open_or_create()
        .map_err(|e| failed(&e))?;
    Ok((node, service))
}
