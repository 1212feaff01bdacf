//! Films of any kind through an installed `ffmpeg`: a path goes in, frames come out of the child's pipe.
//!
//! The child writes every decoded picture as a PPM (`P6`, width, height, 255, RGB bytes), so that rotation needs no
//! care here; where pictures change their size, it scales them to that of the first, whatever their shape. Times come
//! from `ffprobe` ([`probe`]), and which of them a picture has from the child ([`shown`]). The child, and what it has
//! started, is killed and reaped when the source is dropped; if this process dies first, the child's next write fails
//! and it ends by itself.

mod probe;
mod shown;

use std::ffi::OsString;
use std::fs;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;

use rustix::process::{Pid, Signal, kill_process_group};

use self::probe::{Probe, probe};
use self::shown::{Progress, Told};
use super::error::{CaptureError, name_of};
use super::frame::Frame;
use super::limits::check_size;
use super::source::Source;
use crate::counted::counted;

/// Bytes read from the pipe at once: the size of a pipe that Linux grants everyone.
const BUFFER_BYTES: usize = 1 << 20;
/// How much of the child's complaints is kept.
const MAX_COMPLAINT: usize = 4096;
/// What ffmpeg says of a file that ends before its container does, whatever came out of it.
const CUT_OFF: [&str; 2] = ["ended prematurely", "partial file"];
/// What it says where the file's clock begins anew. What it writes for us has no times: nothing is wrong.
const CLOCK_BACK: &str = "non monotonically increasing dts to muxer";
/// Makes pixels square: a lens is one for both directions. None is thrown away.
const SQUARE: &str = "scale=w='max(iw,iw*sar)':h='max(ih,ih/sar)',setsar=1";

/// Where the two programs are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ffmpeg {
    /// The decoder.
    pub ffmpeg: PathBuf,
    /// The one that reads headers.
    pub ffprobe: PathBuf,
}

impl Default for Ffmpeg {
    /// As found on `PATH`.
    fn default() -> Self {
        Self {
            ffmpeg: "ffmpeg".into(),
            ffprobe: "ffprobe".into(),
        }
    }
}

/// A film as far as it is known: the same each time it is played.
struct Film {
    path: PathBuf,
    name: String,
    ffmpeg: PathBuf,
    rate_option: [&'static str; 2],
    /// Whether ffmpeg is asked when each picture is shown.
    is_told: bool,
    /// Which file it was, as far as the system tells.
    file: Option<FileId>,
    probe: Probe,
}

/// Device, number, bytes and the time of the last change, seconds and nanoseconds.
type FileId = (u64, u64, u64, i64, i64);

/// Which file lies there; another one of the same name is another one.
fn file_id(path: &Path) -> Option<FileId> {
    let m = fs::metadata(path).ok()?;
    Some((m.dev(), m.ino(), m.len(), m.mtime(), m.mtime_nsec()))
}

/// What ffmpeg and ffprobe are told to read. The prefix keeps names with a colon or a leading dash from being taken for
/// something else.
fn input(path: &Path) -> OsString {
    let mut input = OsString::from("file:");
    input.push(path);
    input
}

impl Film {
    /// Asks both programs what there is.
    fn look(path: &Path, programs: &Ffmpeg, fps: Option<f64>) -> Result<Self, CaptureError> {
        let name = name_of(path);
        // A file that is replaced while it is probed counts as another one.
        let file = file_id(path);
        let mut probe = probe(&programs.ffprobe, &input(path), &name)?;
        probe.ask_user(fps, &name);
        let release = Release::of(&programs.ffmpeg, &name)?;
        Ok(Self {
            rate_option: release.passthrough_option(),
            is_told: !probe.listed.is_empty() && release.tells_times(&programs.ffmpeg),
            file,
            probe,
            path: path.to_owned(),
            name,
            ffmpeg: programs.ffmpeg.clone(),
        })
    }

    /// Starts the child.
    fn play(&self) -> Result<Playing, CaptureError> {
        let mut command = command(&self.ffmpeg);
        let mut told = None;
        if self.is_told {
            let pipe = Told::new().map_err(|e| CaptureError::from_io_named(&self.name, e))?;
            command.stdin(pipe.1);
            told = Some(pipe.0);
        }
        let filters = [
            self.is_told.then_some(shown::FILTERS),
            (!self.probe.is_square).then_some(SQUARE),
        ];
        let filters: Vec<&str> = filters.into_iter().flatten().collect();
        command
            .args(["-nostdin", "-v", "error", "-protocol_whitelist", "file"])
            .args(self.is_told.then_some("-copyts"))
            .arg("-i")
            .arg(input(&self.path))
            .args(["-map", "0:V:0"]);
        if !filters.is_empty() {
            command.arg("-vf").arg(filters.join(","));
        }
        let mut child = command
            .args(self.rate_option)
            .args(["-f", "image2pipe", "-c:v", "ppm"])
            .args(["-pix_fmt", "rgb24", "pipe:1"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| missing(&self.ffmpeg, &self.name, e))?;
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        let (Some(stdout), Some(stderr)) = (stdout, stderr) else {
            unreachable!("both pipes were asked for");
        };
        Ok(Playing {
            child,
            pipe: BufReader::with_capacity(BUFFER_BYTES, stdout),
            told,
            // Where the system has no thread to spare, they are not heard.
            complaints: std::thread::Builder::new()
                .spawn(move || keep_end(stderr))
                .ok(),
            is_reaped: false,
        })
    }
}

/// A child, and what it writes.
struct Playing {
    child: Child,
    pipe: BufReader<ChildStdout>,
    told: Option<Told>,
    complaints: Option<JoinHandle<String>>,
    is_reaped: bool,
}

impl Playing {
    fn wait(&mut self) -> std::io::Result<ExitStatus> {
        let status = self.child.wait()?;
        self.is_reaped = true;
        Ok(status)
    }

    fn take_complaints(&mut self) -> String {
        self.complaints
            .take()
            .and_then(|thread| thread.join().ok())
            .unwrap_or_default()
    }
}

impl Drop for Playing {
    fn drop(&mut self) {
        // What is called ffmpeg may be a script that has started it: the group is the child's own, and its number
        // nobody else's until the child is reaped. Failing means that there is nobody left to kill.
        let group = Pid::from_raw(self.child.id().cast_signed());
        if let (false, Some(group)) = (self.is_reaped, group) {
            let _ = kill_process_group(group, Signal::KILL);
            let _ = self.child.wait();
        }
        self.take_complaints();
    }
}

/// Plays a film through ffmpeg.
pub struct FfmpegSource {
    film: Film,
    playing: Playing,
    progress: Progress,
    ended: bool,
    /// Whether it was told what ffmpeg says of the film.
    has_told: bool,
}

impl FfmpegSource {
    /// Starts the child.
    ///
    /// # Errors
    /// [`CaptureError::Unavailable`] when ffmpeg or ffprobe is not installed, [`CaptureError::Data`] when the file is
    /// no film that they can read.
    pub fn open(path: &Path, programs: &Ffmpeg) -> Result<Self, CaptureError> {
        Self::open_at(path, programs, None)
    }

    /// As [`open`](Self::open); `fps`: at which the film was taken, where its file has no times.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_at(path: &Path, programs: &Ffmpeg, fps: Option<f64>) -> Result<Self, CaptureError> {
        let film = Film::look(path, programs, fps)?;
        Ok(Self {
            playing: film.play()?,
            film,
            progress: Progress::default(),
            ended: false,
            has_told: false,
        })
    }

    /// Process id of the child.
    pub fn child_id(&self) -> u32 {
        self.playing.child.id()
    }

    /// Reaps the child after its last picture and judges how it ended.
    fn finish(&mut self, cut_inside: bool) -> Result<bool, CaptureError> {
        self.ended = true;
        let Film { name, probe, .. } = &self.film;
        let status = self.playing.wait();
        let status = status.map_err(|e| CaptureError::from_io_named(name, e))?;
        let complaints = self.playing.take_complaints();
        let lines = || complaints.lines().map(str::trim).filter(|l| !l.is_empty());
        // Without a number in the header, packets are counted that are left in the file: of one that was cut off none
        // is missing, and only these words tell it.
        let has_number = probe.announced.is_some();
        let tells_cut = |line: &&str| !has_number && CUT_OFF.iter().any(|w| line.contains(w));
        let cut_line = lines().find(tells_cut);
        let expected = probe.announced.or(probe.counted);
        let Progress {
            given, undecoded, ..
        } = self.progress;
        let reached = self.progress.reached();
        let short = expected.filter(|n| reached < *n);
        let is_cut = cut_inside
            || cut_line.is_some()
            || ((short.is_some() || undecoded > 0) && lines().next().is_some());
        let said = cut_line.or(lines().next_back());
        if status.success() && !is_cut && given > 0 {
            // No failure: streams that begin between two key pictures are complained of, too, and are whole.
            if let (false, Some(line)) = (has_number, said)
                && !std::mem::replace(&mut self.has_told, true)
            {
                tracing::warn!(
                    "{name}: ffmpeg says: {line}; if the film plays longer, copy it again"
                );
            }
            return Ok(false);
        }
        let reason = said.map_or_else(|| status.to_string(), str::to_owned);
        if status.success() && !cut_inside && cut_line.is_none() && short.is_none() && undecoded > 0
        {
            // Nothing breaks off: the last picture is there.
            return Err(CaptureError::Picture {
                input: name.clone(),
                reason: format!(
                    "{} of {reached} could not be decoded; ffmpeg says: {reason}; check the file, copy it again if the original plays",
                    counted(undecoded, "picture", "pictures")
                ),
            });
        }
        let before = match undecoded {
            0 => String::new(),
            n => format!(", {n} before its end could not be decoded"),
        };
        Err(CaptureError::data(
            name.clone(),
            format!(
                "the film ends after {}{}{before}; ffmpeg says: {reason}; check the file, copy it again if it was cut off",
                counted(reached, "picture", "pictures"),
                short.map(|n| format!(" of {n}")).unwrap_or_default(),
            ),
        ))
    }
}

impl Source for FfmpegSource {
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        if self.ended {
            return Ok(false);
        }
        let (width, height) = match read_ppm_header(&mut self.playing.pipe) {
            Ok(Some(size)) => size,
            Ok(None) => return self.finish(false),
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => return self.finish(true),
            Err(e) => {
                self.ended = true;
                return Err(CaptureError::from_io_named(&self.film.name, e));
            }
        };
        if let Err(reason) = check_size(width.into(), height.into()) {
            self.ended = true;
            return Err(CaptureError::data(self.film.name.clone(), reason));
        }
        frame.width = width;
        frame.height = height;
        frame.rgb.resize(3 * width as usize * height as usize, 0);
        match self.playing.pipe.read_exact(&mut frame.rgb) {
            Ok(()) => {}
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => return self.finish(true),
            Err(e) => {
                self.ended = true;
                return Err(CaptureError::from_io_named(&self.film.name, e));
            }
        }
        let Probe {
            times, listed, fps, ..
        } = &self.film.probe;
        let shown = self.playing.told.as_mut().and_then(Told::next);
        let (place, first) = self.progress.take(listed, shown);
        frame.sequence = (place - first) as u64;
        frame.time_ns = match (times.get(place), times.get(first)) {
            (Some(time), Some(begin)) => time - begin,
            _ => (frame.sequence as f64 * 1e9 / fps).round() as u64,
        };
        Ok(true)
    }

    /// Packets of an hour take longer to list than its first pictures to decode. A file that was replaced meanwhile is
    /// another film.
    fn rewind(&mut self) -> Result<bool, CaptureError> {
        let film = &self.film;
        if film.file.is_none() || film.file != file_id(&film.path) {
            return Ok(false);
        }
        self.playing = film.play()?;
        (self.progress, self.ended) = (Progress::default(), false);
        Ok(true)
    }

    fn frame_count(&self) -> Option<u64> {
        let counted = Some(self.film.probe.times.len() as u64).filter(|n| *n > 0);
        counted.or(self.film.probe.announced)
    }

    fn fps(&self) -> Option<f64> {
        Some(self.film.probe.fps)
    }

    fn name(&self) -> &str {
        &self.film.name
    }
}

/// A child that hears neither our terminal nor its Ctrl-C: we decide when it ends.
fn command(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.stdin(Stdio::null()).process_group(0);
    command
}

/// What can be asked of an ffmpeg.
struct Release {
    is_before_5_1: bool,
}

impl Release {
    /// Asks it.
    fn of(ffmpeg: &Path, film: &str) -> Result<Self, CaptureError> {
        let output = command(ffmpeg)
            .arg("-version")
            .output()
            .map_err(|e| missing(ffmpeg, film, e))?;
        let text = String::from_utf8_lossy(&output.stdout);
        let version = text
            .strip_prefix("ffmpeg version ")
            .and_then(|rest| rest.split([' ', '-', '+']).next());
        Ok(Self {
            is_before_5_1: version.is_some_and(is_before_5_1),
        })
    }

    /// The option that gives every picture once, whatever its time. It was renamed in version 5.1.
    fn passthrough_option(&self) -> [&'static str; 2] {
        match self.is_before_5_1 {
            true => ["-vsync", "passthrough"],
            false => ["-fps_mode", "passthrough"],
        }
    }

    /// Whether it tells when a picture is shown before it hands it on. Of older ones, some do.
    fn tells_times(&self, ffmpeg: &Path) -> bool {
        let knows_how = || {
            let help = command(ffmpeg)
                .args(["-v", "quiet", "-h", "filter=metadata"])
                .output();
            help.is_ok_and(|help| String::from_utf8_lossy(&help.stdout).contains(shown::OPTION))
        };
        !self.is_before_5_1 || knows_how()
    }
}

/// Whether a release number is below 5.1; nightly builds have none and are not.
fn is_before_5_1(version: &str) -> bool {
    let mut numbers = version.trim_start_matches('n').split('.').map(str::parse);
    match (numbers.next(), numbers.next()) {
        (Some(Ok(major)), minor) => (major, minor.and_then(Result::ok).unwrap_or(0)) < (5u32, 1u32),
        _ => false,
    }
}

fn missing(program: &Path, film: &str, error: std::io::Error) -> CaptureError {
    let what = program.display();
    // With it the film was looked at, and is of a kind that only ffmpeg reads.
    let build = if cfg!(feature = "mp4") {
        ""
    } else {
        " build with --features mp4,"
    };
    match error.kind() {
        ErrorKind::NotFound => CaptureError::Unavailable {
            what: film.to_owned(),
            reason: format!(
                "this film needs {what}, which is not installed; install it (apt install ffmpeg),{build} or pipe YUV4MPEG2 into --input -"
            ),
        },
        _ => CaptureError::from_io_named(&what.to_string(), error),
    }
}

/// `P6\nWIDTH HEIGHT\n255\n`; `None` at the end of the pipe.
fn read_ppm_header<R: Read>(pipe: &mut R) -> std::io::Result<Option<(u32, u32)>> {
    let bad = || {
        std::io::Error::new(
            ErrorKind::InvalidData,
            "ffmpeg wrote something else than PPM",
        )
    };
    let mut header = Vec::with_capacity(24);
    let mut byte = [0];
    while header.iter().filter(|b| **b == b'\n').count() < 3 {
        match pipe.read(&mut byte) {
            Ok(0) if header.is_empty() => return Ok(None),
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(_) => header.push(byte[0]),
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
        if header.len() > 64 {
            return Err(bad());
        }
    }
    let text = String::from_utf8(header).map_err(|_| bad())?;
    let words: Vec<&str> = text.split_ascii_whitespace().collect();
    match words[..] {
        ["P6", w, h, "255"] => match (w.parse(), h.parse()) {
            (Ok(w), Ok(h)) => Ok(Some((w, h))),
            _ => Err(bad()),
        },
        _ => Err(bad()),
    }
}

/// Reads to the end and keeps the last part, so that the child never waits for us to listen.
fn keep_end<R: Read>(pipe: R) -> String {
    let mut pipe = BufReader::new(pipe);
    let (mut kept, mut line) = (Vec::new(), Vec::new());
    // What cannot be read is an end, too.
    while let Ok(1..) = (&mut pipe)
        .take(MAX_COMPLAINT as u64)
        .read_until(b'\n', &mut line)
    {
        if !String::from_utf8_lossy(&line).contains(CLOCK_BACK) {
            kept.append(&mut line);
        }
        line.clear();
        if kept.len() > 2 * MAX_COMPLAINT {
            kept.drain(..kept.len() - MAX_COMPLAINT);
        }
    }
    String::from_utf8_lossy(&kept).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_releases_are_told_from_new_ones() {
        for (version, old) in [
            ("4.4.2", true),
            ("5.0", true),
            ("5.1.9", false),
            ("6.1", false),
            ("n7.0.1", false),
            ("N", false),
        ] {
            assert_eq!(is_before_5_1(version), old, "{version}");
        }
    }

    #[test]
    fn ppm_headers_are_read_exactly() {
        let mut bytes = &b"P6\n640 360\n255\nxyz"[..];
        assert_eq!(read_ppm_header(&mut bytes).unwrap(), Some((640, 360)));
        assert_eq!(bytes, b"xyz");
        assert_eq!(read_ppm_header(&mut &b""[..]).unwrap(), None);
        assert!(read_ppm_header(&mut &b"P6\n64"[..]).is_err());
        assert!(read_ppm_header(&mut &b"P5\n1 1\n255\n"[..]).is_err());
        assert!(read_ppm_header(&mut &[b'x'; 100][..]).is_err());
    }

    #[test]
    fn of_complaints_the_last_are_kept_and_none_of_a_clock_that_begins_anew() {
        let clock = "[image2pipe @ 0x55] Application provided invalid, non monotonically increasing dts to muxer in stream 0: 63 >= 61\n";
        let said = format!("first\n{}last", clock.repeat(200));
        assert_eq!(keep_end(said.as_bytes()), "first\nlast");
        let many = format!("{}last\n", "another\n".repeat(5000));
        let kept = keep_end(many.as_bytes());
        assert!(kept.len() <= 2 * MAX_COMPLAINT && kept.ends_with("another\nlast\n"));
    }
}
