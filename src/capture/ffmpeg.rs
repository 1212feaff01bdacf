//! Films of any kind through an installed `ffmpeg`: a path goes in, frames come out of the child's pipe.
//!
//! The child writes every decoded picture as a PPM (`P6`, width, height, 255, RGB bytes), so that rotation and sizes
//! that change need no care here. Times come from `ffprobe`. The child, and what it has started, is killed and reaped
//! when the source is dropped; if this process dies first, the child's next write fails and it ends by itself.

use std::collections::HashSet;
use std::ffi::OsString;
use std::fs;
use std::io::{BufReader, ErrorKind, Read};
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;

use rustix::process::{Pid, Signal, kill_process_group};

use super::error::{CaptureError, name_of};
use super::frame::Frame;
use super::limits::check_size;
use super::source::Source;
use crate::counted::counted;

/// Bytes read from the pipe at once: the size of a pipe that Linux grants everyone.
const BUFFER_BYTES: usize = 1 << 20;
/// How much of the child's complaints is kept.
const MAX_COMPLAINT: usize = 4096;
/// Rate for films that do not say theirs.
const DEFAULT_FPS: f64 = 25.0;
/// Most pictures by which codecs have one decoded before it is shown.
const MOST_REORDERED: f64 = 17.0;
/// More packets a picture than this are fields.
const FIELDS: f64 = 1.5;
/// What ffprobe calls the order of fields where there are such: coded first, shown first.
const FIELD_ORDERS: [&str; 4] = ["tt", "bb", "tb", "bt"];
/// Codecs of streams that may lie in a file without a container.
const BARE_CODECS: [&str; 2] = ["h264", "hevc"];
/// The rate that ffprobe gives to such a stream where it tells none.
const INVENTED_FPS: f64 = 25.0;
/// What ffmpeg says of a file that ends before its container does, whatever came out of it.
const CUT_OFF: [&str; 2] = ["ended prematurely", "partial file"];

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

/// What is known before the first picture.
struct Probe {
    fps: f64,
    /// Times of the pictures in the order in which they are shown, nanoseconds from the first.
    times: Vec<u64>,
    /// Number of pictures according to the file's header, without those that its edit list leaves out.
    announced: Option<u64>,
    /// Number of pictures according to the packets that there are.
    counted: Option<u64>,
    /// Whether pixels are as wide as they are high.
    is_square: bool,
    /// Whether there are packets, and none of them tells when its picture is shown or decoded.
    is_timeless: bool,
    /// Whether the rate is nobody's word.
    is_rate_invented: bool,
}

impl Probe {
    /// Takes the user's word for the rate where the file has no times, or says that a rate is assumed.
    fn ask_user(&mut self, fps: Option<f64>, name: &str) {
        if !self.is_timeless {
            return;
        }
        if let Some(fps) = fps {
            self.fps = fps;
        } else if self.is_rate_invented {
            tracing::warn!(
                "{name}: the film tells neither times nor a rate: {} frames a second are assumed; give --fps",
                self.fps
            );
        }
    }
}

/// A film as far as it is known: the same each time it is played.
struct Film {
    path: PathBuf,
    name: String,
    ffmpeg: PathBuf,
    rate_option: [&'static str; 2],
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
        Ok(Self {
            rate_option: passthrough_option(&programs.ffmpeg, &name)?,
            file,
            probe,
            path: path.to_owned(),
            name,
            ffmpeg: programs.ffmpeg.clone(),
        })
    }

    /// Starts the child.
    fn play(&self) -> Result<Playing, CaptureError> {
        let mut child = command(&self.ffmpeg)
            .args([
                "-nostdin",
                "-v",
                "error",
                "-protocol_whitelist",
                "file",
                "-i",
            ])
            .arg(input(&self.path))
            .args(["-map", "0:V:0"])
            // A lens is one for both directions. No pixel is thrown away.
            .args(match self.probe.is_square {
                true => &[][..],
                false => &[
                    "-vf",
                    "scale=w='max(iw,iw*sar)':h='max(ih,ih/sar)',setsar=1",
                ],
            })
            .args(self.rate_option)
            .args([
                "-f",
                "image2pipe",
                "-c:v",
                "ppm",
                "-pix_fmt",
                "rgb24",
                "pipe:1",
            ])
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
            complaints: Some(std::thread::spawn(move || keep_end(stderr))),
            is_reaped: false,
        })
    }
}

/// A child, and what it writes.
struct Playing {
    child: Child,
    pipe: BufReader<ChildStdout>,
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
    index: u64,
    ended: bool,
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
            index: 0,
            ended: false,
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
        let short = expected.filter(|n| self.index < *n);
        let is_cut =
            cut_inside || cut_line.is_some() || (short.is_some() && lines().next().is_some());
        let said = cut_line.or(lines().next_back());
        if status.success() && !is_cut && self.index > 0 {
            // No failure: streams that begin between two key pictures are complained of, too, and are whole.
            if let (false, Some(line)) = (has_number, said) {
                tracing::warn!(
                    "{name}: ffmpeg says: {line}; if the film plays longer, copy it again"
                );
            }
            return Ok(false);
        }
        let reason = said.map_or_else(|| status.to_string(), str::to_owned);
        Err(CaptureError::data(
            name.clone(),
            format!(
                "the film ends after {}{}; ffmpeg says: {reason}; check the file, copy it again if it was cut off",
                counted(self.index, "picture", "pictures"),
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
        let known = self.film.probe.times.get(self.index as usize).copied();
        frame.time_ns =
            known.unwrap_or_else(|| (self.index as f64 * 1e9 / self.film.probe.fps).round() as u64);
        frame.sequence = self.index;
        self.index += 1;
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
        (self.index, self.ended) = (0, false);
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

/// The option that gives every picture once, whatever its time. It was renamed in version 5.1.
fn passthrough_option(ffmpeg: &Path, film: &str) -> Result<[&'static str; 2], CaptureError> {
    let output = command(ffmpeg)
        .arg("-version")
        .output()
        .map_err(|e| missing(ffmpeg, film, e))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let version = text
        .strip_prefix("ffmpeg version ")
        .and_then(|rest| rest.split([' ', '-', '+']).next());
    Ok(if version.is_some_and(is_before_5_1) {
        ["-vsync", "passthrough"]
    } else {
        ["-fps_mode", "passthrough"]
    })
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

/// Asks ffprobe for rate, number of pictures and their times.
fn probe(ffprobe: &Path, input: &OsString, name: &str) -> Result<Probe, CaptureError> {
    let output = command(ffprobe)
        .args([
            "-v",
            "error",
            "-protocol_whitelist",
            "file",
            "-select_streams",
            "V:0",
        ])
        .args([
            "-show_entries",
            "stream=codec_name,field_order,sample_aspect_ratio,avg_frame_rate,nb_frames:packet=pts_time,dts_time,flags",
        ])
        .args(["-of", "csv"])
        .arg(input)
        .output()
        .map_err(|e| missing(ffprobe, name, e))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let probe = parse_probe(&text);
    match probe {
        Some(probe) if output.status.success() => Ok(probe),
        _ => {
            let complaint = String::from_utf8_lossy(&output.stderr);
            let last = complaint.lines().last().unwrap_or("no video stream").trim();
            let last = last.strip_prefix(&format!("file:{name}: ")).unwrap_or(last);
            Err(CaptureError::data(
                name,
                format!(
                    "expected a film, ffprobe says: {last}; check the file, copy it again if it was cut off"
                ),
            ))
        }
    }
}

/// What is told of a packet.
struct Packet {
    /// When its picture is shown and when it is decoded, seconds.
    shown: Option<f64>,
    decoded: Option<f64>,
    is_key: bool,
    /// To be decoded for the sake of others and not shown: ffmpeg does not give its picture.
    is_left_out: bool,
}

impl Packet {
    /// `TIME,DECODED,FLAGS`; other fields may follow.
    fn parse<'a>(mut fields: impl Iterator<Item = &'a str>) -> Self {
        let number = |text: &str| text.parse::<f64>().ok().filter(|t| t.is_finite());
        let is_flags = |text: &str| !text.is_empty() && text.bytes().all(|b| b"KDC_".contains(&b));
        let shown = fields.next().and_then(number);
        let (mut decoded, mut flags) = (None, "");
        for field in fields {
            if is_flags(field) {
                flags = field;
                break;
            }
            decoded = decoded.or(number(field));
        }
        Self {
            shown,
            decoded,
            is_key: flags.contains('K'),
            is_left_out: flags.contains('D'),
        }
    }

    fn is_timeless(&self) -> bool {
        self.shown.is_none() && self.decoded.is_none()
    }
}

/// Lines `packet,TIME,DECODED,FLAGS` and one `stream,CODEC,SHAPE,FIELDS,RATE,COUNT`, its fields in any order and `N/A`
/// where unknown; `None` without a stream.
fn parse_probe(text: &str) -> Option<Probe> {
    let mut packets = Vec::new();
    let mut left_out = 0_u64;
    let mut stream = None;
    let mut is_square = true;
    let (mut has_fields, mut has_hidden, mut is_bare) = (false, false, false);
    for line in text.lines() {
        let mut fields = line.trim().split(',');
        match fields.next() {
            Some("packet") => {
                let packet = Packet::parse(fields);
                match packet.is_left_out {
                    true => left_out += 1,
                    false => packets.push(packet),
                }
            }
            Some("stream") => {
                let (mut fps, mut announced) = (None, None);
                for field in fields {
                    fps = fps.or_else(|| parse_rate(field));
                    announced = announced.or_else(|| field.parse().ok());
                    has_fields |= FIELD_ORDERS.contains(&field);
                    has_hidden |= field == "vp8";
                    is_bare |= BARE_CODECS.contains(&field);
                    if let Some((across, down)) = field.split_once(':') {
                        is_square = across == down || across == "0" || down == "0";
                    }
                }
                stream = Some((fps, announced));
            }
            _ => {}
        }
    }
    let (told, announced) = stream?;
    let announced = announced.map(|n: u64| n.saturating_sub(left_out));
    let mut fps = told.unwrap_or(DEFAULT_FPS);
    let mut pieces = pieces(&packets, fps).unwrap_or_default();
    if has_hidden {
        // A packet of a picture that others refer to and that is not shown has its neighbour's time.
        pieces.iter_mut().for_each(Vec::dedup);
    }
    let mut times = joined(&pieces, fps);
    let steps = times.len().saturating_sub(1) as f64;
    let seconds = 1e-9 * times.last().copied().unwrap_or(0) as f64;
    match told {
        // Interlaced films may have a packet a field, and pictures of two. Of others a rate that is too low is
        // ffprobe's guess, of a film whose pictures do not come at even steps.
        Some(fps) if has_fields && times.len() as f64 > FIELDS * (1.0 + fps * seconds) => {
            times.clear();
        }
        None if seconds > 0.0 => fps = steps / seconds,
        _ => {}
    }
    // What is shown before the first key picture refers to pictures that are not in the file.
    let key = packets.iter().find(|p| p.is_key).and_then(|p| p.shown);
    let early = pieces.first().zip(key).map_or(0, |(piece, key)| {
        piece.iter().filter(|time| **time < key).count()
    });
    Some(Probe {
        fps,
        counted: (!times.is_empty()).then(|| (times.len() - early) as u64),
        times,
        announced,
        is_square,
        is_timeless: !packets.is_empty() && packets.iter().all(Packet::is_timeless),
        is_rate_invented: told.is_none_or(|told| is_bare && told == INVENTED_FPS),
    })
}

/// The times at which packets are shown, which lie in the order of decoding: each piece in order, and a new one where
/// the clock begins anew, as where two films were written one behind the other. `None` where one has no time.
fn pieces(packets: &[Packet], fps: f64) -> Option<Vec<Vec<f64>>> {
    let reach = (MOST_REORDERED / fps).max(1.0);
    let times: Vec<f64> = packets.iter().map(|p| p.shown).collect::<Option<_>>()?;
    let mut pieces = Vec::new();
    let mut piece = Vec::new();
    let mut seen = HashSet::new();
    let (mut highest, mut decoded) = (f64::NEG_INFINITY, None);
    for (k, (time, packet)) in times.iter().zip(packets).enumerate() {
        let again = |k: usize| times.get(k).is_some_and(|t| seen.contains(&t.to_bits()));
        // One time alone that comes twice may be a picture that is not shown.
        let falls = *time < highest - reach || (again(k) && again(k + 1));
        // Pictures of films with long pauses are far apart, but are decoded in order.
        let may_fall = decoded.zip(packet.decoded).is_none_or(|(a, b)| b < a);
        if falls && may_fall {
            pieces.push(std::mem::take(&mut piece));
            seen.clear();
            highest = f64::NEG_INFINITY;
        }
        piece.push(*time);
        seen.insert(time.to_bits());
        highest = highest.max(*time);
        decoded = packet.decoded.or(decoded);
    }
    pieces.push(piece);
    for piece in &mut pieces {
        piece.sort_by(f64::total_cmp);
    }
    Some(pieces)
}

/// One clock for all pieces, nanoseconds: each goes on a picture after the one before.
fn joined(pieces: &[Vec<f64>], fps: f64) -> Vec<u64> {
    let step = (1e9 / fps).round() as u64;
    let mut times = Vec::new();
    let mut begin = 0;
    for piece in pieces {
        let start = piece.first().copied().unwrap_or(0.0);
        let since = piece.iter().map(|t| ((t - start) * 1e9).round() as u64);
        times.extend(since.map(|t| t.saturating_add(begin)));
        begin = times
            .last()
            .map_or(0, |last: &u64| last.saturating_add(step));
    }
    times
}

/// `30000/1001` → 29.97; `None` for 0/0.
fn parse_rate(text: &str) -> Option<f64> {
    let (n, d) = text.split_once('/')?;
    let rate = n.parse::<f64>().ok()? / d.parse::<f64>().ok()?;
    (rate.is_finite() && rate > 0.0).then_some(rate)
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
fn keep_end<R: Read>(mut pipe: R) -> String {
    let mut kept = Vec::new();
    let mut piece = [0; 1024];
    loop {
        match pipe.read(&mut piece) {
            Ok(0) => break,
            Ok(n) => kept.extend_from_slice(&piece[..n]),
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(_) => break,
        }
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
    fn times_are_sorted_and_start_at_zero() {
        let probe = parse_probe("packet,0.5\npacket,0.7\npacket,0.6\nstream,10/1,3\n").unwrap();
        assert_eq!(probe.times, [0, 100_000_000, 200_000_000]);
        assert_eq!((probe.fps, probe.announced), (10.0, Some(3)));
        assert!(parse_probe("packet,0.5\n").is_none());
        let probe = parse_probe("packet,N/A\npacket,1\nstream,0/0,N/A\n").unwrap();
        assert!(probe.times.is_empty());
        assert_eq!((probe.fps, probe.announced), (DEFAULT_FPS, None));
        assert!(probe.is_square);
        for (shape, square) in [("1:1", true), ("0:1", true), ("N/A", true), ("4:3", false)] {
            let probe = parse_probe(&format!("stream,{shape},25/1,50\n")).unwrap();
            assert_eq!((probe.fps, probe.announced), (25.0, Some(50)));
            assert_eq!(probe.is_square, square, "{shape}");
        }
    }

    #[test]
    fn packets_that_an_edit_list_leaves_out_are_not_pictures() {
        for (flags, letters) in [("KD_", "D__"), ("KD", "D_"), ("_D_", "_D_")] {
            let text = format!(
                "packet,-0.2,{flags}\npacket,N/A,{letters}\npacket,0.1,___\npacket,0.0,K__\nstream,10/1,4\n"
            );
            let probe = parse_probe(&text).unwrap();
            assert_eq!(probe.times, [0, 100_000_000]);
            assert_eq!(probe.announced, Some(2));
        }
        let probe = parse_probe("packet,0.0,K_\npacket,0.1,__\nstream,10/1,2\n").unwrap();
        assert_eq!((probe.times.len(), probe.announced), (2, Some(2)));
        let probe = parse_probe("packet,0.0,_D\nstream,10/1,N/A\n").unwrap();
        assert_eq!((probe.times.len(), probe.announced), (0, None));
    }

    #[test]
    fn times_that_begin_anew_go_on_where_they_were() {
        let at = |text: &str| {
            let probe = parse_probe(text).unwrap();
            let in_ms = probe.times.iter().map(|t| t / 1_000_000);
            in_ms.collect::<Vec<_>>()
        };
        // Two films of two pictures, one behind the other.
        let joined = at("packet,0,K_\npacket,0.04\npacket,0\npacket,0.04\nstream,25/1,N/A\n");
        assert_eq!(joined, [0, 40, 80, 120]);
        // Longer ones whose pictures are not decoded in order.
        let film: String = (0..30)
            .flat_map(|k| [2 * k + 1, 2 * k])
            .map(|k| format!("packet,{},N/A,___\n", 1.4 + 0.04 * f64::from(k)))
            .collect();
        let joined = at(&format!("{film}{film}stream,25/1,N/A\n"));
        assert_eq!(joined, (0..120).map(|k| 40 * k).collect::<Vec<_>>());
        // A clock that wraps.
        let wrapped = at("packet,95443.6\npacket,95443.64\npacket,0.01\nstream,25/1,N/A\n");
        assert_eq!(wrapped, [0, 40, 80]);
        // Far apart, and decoded in order: a film with pauses.
        let paused = "packet,0,-2,K_\npacket,30,-1,__\npacket,10,0,__\npacket,20,10,__\n";
        assert_eq!(
            at(&format!("{paused}stream,25/1,N/A\n")),
            [0, 10_000, 20_000, 30_000]
        );
        // Slow, and without times of decoding.
        let slow = "packet,0\npacket,8\npacket,4\npacket,2\npacket,6\n";
        assert_eq!(
            at(&format!("{slow}stream,1/2,N/A\n")),
            [0, 2000, 4000, 6000, 8000]
        );
        // One picture twice is none of a new film.
        let twice = "packet,0\npacket,0.04\npacket,0.04\npacket,0.08\n";
        assert_eq!(at(&format!("{twice}stream,25/1,N/A\n")), [0, 40, 40, 80]);
    }

    #[test]
    fn packets_that_are_fields_tell_no_times() {
        let times = |step: f64, stream: &str| {
            let packets = (0..50).map(|k| format!("packet,{:.3},N/A,___\n", step * f64::from(k)));
            let text = packets.collect::<String>() + &format!("stream,{stream},N/A\n");
            let probe = parse_probe(&text).unwrap();
            (probe.times.len(), probe.counted)
        };
        for order in FIELD_ORDERS {
            let stream = format!("h264,1:1,{order},25/1");
            assert_eq!(times(0.04, &stream), (50, Some(50)), "{order}");
            assert_eq!(times(0.02, &stream), (0, None), "{order}");
        }
        // Whole pictures, whose rate was guessed too low, or which tell none.
        for stream in [
            "vp8,1:1,progressive,25/1",
            "theora,1:1,unknown,0/0",
            "h264,1:1,tt,0/0",
        ] {
            assert_eq!(times(0.02, stream), (50, Some(50)), "{stream}");
        }
    }

    #[test]
    fn without_a_rate_times_tell_it() {
        let packets: String = (0..121)
            .map(|k| format!("packet,{:.6},N/A,___\n", f64::from(k) / 60.0))
            .collect();
        let probe = parse_probe(&format!("{packets}stream,theora,1:1,unknown,0/0,N/A\n")).unwrap();
        assert!((probe.fps - 60.0).abs() < 0.01, "{}", probe.fps);
        assert_eq!(probe.times.last(), Some(&2_000_000_000));
    }

    #[test]
    fn hidden_pictures_of_vp8_have_no_time_of_their_own() {
        let packets =
            "packet,0,0,K_\npacket,0.04,0.04,__\npacket,0.04,0.04,__\npacket,0.08,0.08,__\n";
        let times = |codec: &str| {
            let text = format!("{packets}stream,{codec},1:1,progressive,25/1,N/A\n");
            let probe = parse_probe(&text).unwrap();
            let in_ms: Vec<u64> = probe.times.iter().map(|t| t / 1_000_000).collect();
            (in_ms, probe.counted)
        };
        assert_eq!(times("vp8"), (vec![0, 40, 80], Some(3)));
        assert_eq!(times("mpeg4"), (vec![0, 40, 40, 80], Some(4)));
    }

    #[test]
    fn streams_without_times_take_the_users_rate() {
        let of = |text: &str, fps: Option<f64>| {
            let mut probe = parse_probe(text).unwrap();
            probe.ask_user(fps, "film");
            (probe.fps, probe.is_timeless && probe.is_rate_invented)
        };
        let bare = "packet,N/A,N/A,K_\npacket,N/A,N/A,__\nstream,hevc,1:1,unknown,25/1,N/A\n";
        assert_eq!(of(bare, None), (25.0, true));
        assert_eq!(of(bare, Some(50.0)).0, 50.0);
        let told = bare.replace("25/1", "60/1");
        assert_eq!(of(&told, None), (60.0, false));
        assert_eq!(of(&told, Some(50.0)).0, 50.0);
        // Times count for more than what the user says, also those of decoding alone.
        let timed = "packet,N/A,0.0,K_\npacket,N/A,0.04,__\nstream,hevc,1:1,unknown,25/1,N/A\n";
        assert_eq!(of(timed, Some(50.0)), (25.0, false));
    }

    #[test]
    fn pictures_before_the_first_key_picture_are_not_counted() {
        let packets = "packet,0.0,__\npacket,0.12,K_\npacket,0.04,__\npacket,0.16,__\n";
        let probe = parse_probe(&format!("{packets}stream,25/1,N/A\n")).unwrap();
        assert_eq!((probe.times.len(), probe.counted), (4, Some(2)));
        let probe = parse_probe("packet,N/A,N/A,K_\nstream,25/1,N/A\n").unwrap();
        assert_eq!(probe.counted, None);
    }

    #[test]
    fn what_follows_the_flags_is_not_read() {
        let probe = parse_probe("packet,0.0,0.0,K__,MPEGTS Stream ID,224\nstream,25/1,N/A\n");
        assert_eq!(probe.unwrap().times, [0]);
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
}
