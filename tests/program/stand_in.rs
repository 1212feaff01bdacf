//! A camera that a file stands for, and `edgecap run` on it.
#![allow(dead_code, reason = "every test file uses its own part")]

use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::Duration;

use super::{Running, command_of, edgecap, signal, stream};
use edgecap_client::{Message, Subscriber};

/// A camera's stand-in with a film of a few small pictures.
pub struct StandIn {
    folder: tempfile::TempDir,
    film: PathBuf,
    fps: f64,
}

impl StandIn {
    /// It is plugged in.
    pub fn new(fps: f64) -> Self {
        let absent = Self::absent(fps);
        absent.plug_in();
        absent
    }

    /// It is plugged in and shows another film.
    pub fn of(film: &Path, fps: f64) -> Self {
        let camera = Self {
            film: film.to_owned(),
            ..Self::absent(fps)
        };
        camera.plug_in();
        camera
    }

    /// It is not there yet.
    pub fn absent(fps: f64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.y4m");
        write_film(&path, (96, 64));
        Self {
            folder,
            film: path,
            fps,
        }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("camera.toml")
    }

    /// What to give as `--input`.
    pub fn input(&self) -> String {
        format!("stand-in:{}", self.path().display())
    }

    fn becomes(&self, silent: bool) {
        self.shows(&self.film, silent);
    }

    fn shows(&self, film: &Path, silent: bool) {
        let text = format!(
            "film = {film:?}\nfps = {:.1}\nsilent = {silent}\n",
            self.fps
        );
        let draft = self.folder.path().join("draft");
        std::fs::write(&draft, text).unwrap();
        std::fs::rename(draft, self.path()).unwrap();
    }

    /// Plugs it in.
    pub fn plug_in(&self) {
        self.becomes(false);
    }

    /// It stays plugged in, but sends nothing any more.
    pub fn fall_silent(&self) {
        self.becomes(true);
    }

    /// It sends pictures of another size, until it is plugged in.
    pub fn changes_size(&self, size: (u32, u32)) {
        let film = self.folder.path().join("other.y4m");
        write_film(&film, size);
        self.shows(&film, false);
    }

    /// Unplugs it.
    pub fn unplug(&self) {
        std::fs::remove_file(self.path()).unwrap();
    }
}

/// A film of a few grey pictures.
fn write_film(path: &Path, (width, height): (u32, u32)) {
    let mut film = format!("YUV4MPEG2 W{width} H{height} F30:1 Cmono\n").into_bytes();
    for picture in 0..8u8 {
        film.extend(b"FRAME\n");
        film.extend((0..width * height).map(|p| (p as u8).wrapping_mul(7).wrapping_add(picture)));
    }
    std::fs::write(path, film).unwrap();
}

/// `edgecap run` on a stand-in, with the smallest network.
pub struct Watched {
    pub run: Running,
    pub name: String,
}

impl Watched {
    pub fn start(test: &str, camera: &StandIn, more: &[&str]) -> Self {
        Self::start_with(test, camera, more, &[])
    }

    /// With variables of the environment.
    pub fn start_with(
        test: &str,
        camera: &StandIn,
        more: &[&str],
        environment: &[(&str, &str)],
    ) -> Self {
        let name = stream(test);
        let child = program()
            .args(["run", "--input", &camera.input(), "--name", &name])
            .args(["--size", "64x64", "--threads", "1"])
            .args(more)
            .envs(environment.iter().copied())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        Self {
            run: Running(child),
            name,
        }
    }

    /// A reader of its bodies or observations.
    pub fn listen<T: Message>(&self) -> Subscriber<T> {
        Subscriber::open(&self.name).unwrap()
    }

    /// Ends it politely.
    pub fn stop(self) -> Output {
        signal(self.run.pid(), "TERM");
        self.run.wait(Duration::from_secs(60))
    }
}

/// The program under test: the one named in `EDGECAP_PROGRAM`, such as the shipped one, else the one just built.
pub fn program() -> std::process::Command {
    match std::env::var_os("EDGECAP_PROGRAM") {
        Some(named) => command_of(&named),
        None => edgecap(),
    }
}

/// Processes alive whose command line names this stream, `except` these.
pub fn processes_of(name: &str, except: &[u32]) -> Vec<u32> {
    let all = std::fs::read_dir("/proc").unwrap().flatten();
    let pids = all.filter_map(|e| e.file_name().to_str()?.parse::<u32>().ok());
    let names_it = |pid: &u32| {
        let line = std::fs::read(Path::new("/proc").join(pid.to_string()).join("cmdline"));
        line.is_ok_and(|l| String::from_utf8_lossy(&l).contains(name))
    };
    pids.filter(|p| !except.contains(p) && *p != std::process::id())
        .filter(names_it)
        .collect()
}
