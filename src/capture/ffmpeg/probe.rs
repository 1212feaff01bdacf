//! What is known of a film before its first picture: a path goes to `ffprobe`, rate, number of pictures and their times
//! come out.

use std::collections::HashSet;
use std::ffi::OsString;
use std::path::Path;

use super::shown::Listed;
use super::{command, missing};
use crate::capture::error::CaptureError;

/// Rate for films that do not say theirs.
const DEFAULT_FPS: f64 = 25.0;
/// Most pictures by which codecs have one decoded before it is shown.
const MOST_REORDERED: f64 = 17.0;
/// Farthest that a picture's time lies before that of the one before it in a file whose clock goes on, seconds.
const MOST_FALL: f64 = 1.0;
/// More packets a picture than this are fields.
const FIELDS: f64 = 1.5;
/// What ffprobe calls the order of fields where there are such: coded first, shown first.
const FIELD_ORDERS: [&str; 4] = ["tt", "bb", "tb", "bt"];
/// Codecs of streams that may lie in a file without a container.
const BARE_CODECS: [&str; 2] = ["h264", "hevc"];
/// The rate that ffprobe gives to such a stream where it tells none.
const INVENTED_FPS: f64 = 25.0;

/// What is known before the first picture.
pub(super) struct Probe {
    pub fps: f64,
    /// Times of the pictures in the order in which they are shown, nanoseconds from the first.
    pub times: Vec<u64>,
    /// The same pictures by the file's own clock; none where there are no times.
    pub listed: Listed,
    /// Number of pictures according to the file's header, without those that its edit list leaves out.
    pub announced: Option<u64>,
    /// Number of pictures according to the packets that there are.
    pub counted: Option<u64>,
    /// Whether pixels are as wide as they are high.
    pub is_square: bool,
    /// Whether there are packets, and none of them tells when its picture is shown or decoded.
    is_timeless: bool,
    /// Whether the rate is nobody's word.
    is_rate_invented: bool,
}

impl Probe {
    /// Takes the user's word for the rate where the file has no times, or says that a rate is assumed.
    pub fn ask_user(&mut self, fps: Option<f64>, name: &str) {
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

/// Asks ffprobe for rate, number of pictures and their times.
///
/// # Errors
/// [`CaptureError::Unavailable`] where it is not installed, [`CaptureError::Data`] where it finds no film.
pub(super) fn probe(ffprobe: &Path, input: &OsString, name: &str) -> Result<Probe, CaptureError> {
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
    let listed = match times.is_empty() || falls(&packets) {
        true => Listed::default(),
        false => Listed::new(&pieces, early),
    };
    Some(Probe {
        fps,
        counted: (!times.is_empty()).then(|| (times.len() - early) as u64),
        times,
        listed,
        announced,
        is_square,
        is_timeless: !packets.is_empty() && packets.iter().all(Packet::is_timeless),
        is_rate_invented: told.is_none_or(|told| is_bare && told == INVENTED_FPS),
    })
}

/// Whether pictures come in the order of decoding and not in that of their times, which are then not of single
/// pictures.
fn falls(packets: &[Packet]) -> bool {
    packets.iter().all(|p| p.decoded == p.shown)
        && packets.windows(2).any(|w| {
            let step = w[1].shown.zip(w[0].shown).map(|(now, before)| now - before);
            // A clock that begins anew goes back farther.
            step.is_some_and(|s| (-MOST_FALL..0.0).contains(&s))
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

#[cfg(test)]
mod tests {
    use super::*;

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
    fn times_of_single_pictures_are_not_told_where_they_fall_in_the_order_of_decoding() {
        let told = |text: &str| {
            let probe = parse_probe(text).unwrap();
            (probe.times.len(), !probe.listed.is_empty())
        };
        let packets = |times: &[(f64, f64)]| {
            let line = |(shown, decoded): &(f64, f64)| format!("packet,{shown},{decoded},K__\n");
            times.iter().map(line).collect::<String>() + "stream,25/1,4\n"
        };
        let falls = [(0.0, 0.0), (0.04, 0.04), (0.12, 0.12), (0.08, 0.08)];
        assert_eq!(told(&packets(&falls)), (4, false));
        let reordered = [(0.0, -0.04), (0.08, 0.0), (0.04, 0.04), (0.12, 0.08)];
        assert_eq!(told(&packets(&reordered)), (4, true));
        let risen = [(0.0, 0.0), (0.04, 0.04), (0.08, 0.08), (0.12, 0.12)];
        assert_eq!(told(&packets(&risen)), (4, true));
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
}
