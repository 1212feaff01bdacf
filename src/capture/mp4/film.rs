//! H.264 films in MP4 files: a path goes in, frames come out.
//!
//! The container is read by `re_mp4`, pictures by Cisco's OpenH264, built from source. Other codecs are left to ffmpeg.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use openh264::decoder::{DecodeOptions, DecodedYUV, Decoder, Flush};
use openh264::formats::YUVSource;
use re_mp4::{Mp4, Sample, StsdBoxContent, Track, TrackKind};

use super::boxes::{Guarded, Walk};
use super::sps;
use crate::capture::error::{CaptureError, name_of};
use crate::capture::exif::Orientation;
use crate::capture::frame::Frame;
use crate::capture::limits::check_size;
use crate::capture::quiet::quietly;
use crate::capture::source::Source;
use crate::capture::square::PixelShape;
use crate::capture::yuv::{Matrix, Range, YuvToRgb};

/// Height from which untagged film is taken for BT.709, as players do.
const HIGH_DEFINITION_LINES: usize = 720;
/// What stands before every unit of an H.264 stream outside a container.
const START_CODE: [u8; 4] = [0, 0, 0, 1];

/// Plays H.264 from an MP4 file.
pub struct Mp4Source {
    name: String,
    file: File,
    file_bytes: u64,
    /// In the order of decoding.
    samples: Vec<Sample>,
    /// When pictures are shown, in that order; those that were given or left out are gone.
    moments: VecDeque<Moment>,
    /// The moment that was given last.
    last: Moment,
    shape: Option<PixelShape>,
    fps: Option<f64>,
    /// Bytes of the length before each unit.
    length_bytes: usize,
    orientation: Orientation,
    range: Range,
    decoder: Decoder,
    /// Next sample to decode.
    position: usize,
    /// Pictures that were still in the decoder after the last sample.
    rest: VecDeque<Frame>,
    ended: bool,
    /// The tables end before the film does.
    is_fragment_cut: bool,
    /// Why there are no more pictures, once those before it are given.
    cut: Option<CaptureError>,
    sample: Vec<u8>,
    stream: Vec<u8>,
}

/// When a picture is shown.
#[derive(Debug, Clone, Copy)]
struct Moment {
    /// Nanoseconds after the first picture.
    time_ns: u64,
    /// How many are shown before it.
    sequence: u64,
    /// The sample that it comes of.
    sample: usize,
}

/// When the pictures of samples are shown, ticks of the track's clock, in the order of decoding. The library moves
/// those of the film's own tables, so that the first one is shown at 0, and tells those of fragments by the first
/// fragment's time alone, offsets without their sign. `None` where fragments do not tell the samples that it found.
fn stamps(mp4: &Mp4, track: &Track) -> Option<Vec<i64>> {
    let trak = track.trak(mp4);
    let fragments = mp4.moofs.iter().flat_map(|moof| &moof.trafs);
    let fragments = fragments.filter(|traf| traf.tfhd.track_id == track.track_id);
    let runs = fragments.clone().flat_map(|traf| &traf.truns);
    let in_fragments: usize = runs.map(|run| run.sample_count as usize).sum();
    let own = &track.samples[..track.samples.len().checked_sub(in_fragments)?];
    // The sample that is decoded first is decoded at 0.
    let offsets = trak.mdia.minf.stbl.ctts.as_ref();
    let offset = offsets.and_then(|ctts| Some(ctts.entries.first()?.sample_offset));
    let moved = own.first().map_or(0, |first| {
        i64::from(offset.unwrap_or(0)) - first.composition_timestamp
    });
    let each = own
        .iter()
        .map(|s| s.composition_timestamp.saturating_add(moved));
    let mut all: Vec<i64> = each.collect();
    let mut decoded = own.first().zip(own.last()).map_or(0, |(first, last)| {
        (last.decode_timestamp - first.decode_timestamp).saturating_add_unsigned(last.duration)
    });
    let defaults = mp4.moov.mvex.as_ref();
    let defaults = defaults.and_then(|m| m.trexs.iter().find(|t| t.track_id == track.track_id));
    for traf in fragments {
        if let Some(begin) = &traf.tfdt {
            decoded = i64::try_from(begin.base_media_decode_time).ok()?;
        }
        let usual = defaults.map_or(0, |d| d.default_sample_duration);
        let usual = traf.tfhd.default_sample_duration.unwrap_or(usual);
        for run in &traf.truns {
            for k in 0..run.sample_count as usize {
                let offset = run.sample_cts.get(k).map_or(0, |ticks| ticks.cast_signed());
                all.push(decoded.saturating_add(offset.into()));
                let ticks = run.sample_durations.get(k).copied().unwrap_or(usual);
                decoded = decoded.saturating_add(ticks.into());
            }
        }
    }
    Some(all)
}

/// When pictures are shown, in that order, by [`stamps`]; `tick`: nanoseconds.
fn moments(stamps: &[i64], tick: f64) -> VecDeque<Moment> {
    let mut stamps: Vec<(i64, usize)> = stamps.iter().copied().zip(0..).collect();
    stamps.sort_unstable();
    let first = stamps.first().map_or(0, |(stamp, _)| *stamp);
    let shown = stamps.into_iter().zip(0..);
    let moment = |((stamp, sample), sequence): ((i64, usize), u64)| Moment {
        time_ns: (stamp.saturating_sub(first) as f64 * tick).round() as u64,
        sequence,
        sample,
    };
    shown.map(moment).collect()
}

/// Whether an edit list shows anything else than all pictures one after the other. `edits`: where in the track each
/// begins, and for how long it shows that, 0 for all of it; `first`: when the first picture is shown there; `least`:
/// how long it must show it for no more than the last picture to be missing, which writers of such lists forget. An
/// edit without pictures only delays the others.
pub(super) fn is_cut(edits: impl IntoIterator<Item = (u64, f64)>, first: i64, least: f64) -> bool {
    // -1 stands for no pictures; its 32 or 64 bits are read without their sign.
    let is_empty = |begin: u64| [u64::from(u32::MAX), u64::MAX].contains(&begin);
    let mut shown = edits.into_iter().filter(|edit| !is_empty(edit.0));
    let edit = shown.next();
    let is_part = |(begin, lasts): (u64, f64)| {
        i128::from(begin) > i128::from(first) || (lasts > 0.0 && lasts < least)
    };
    shown.next().is_some() || edit.is_some_and(is_part)
}

impl Mp4Source {
    /// Reads the headers. `None`: the film is in another codec than H.264, or in a kind of it that OpenH264 does not
    /// read (10 bits, 4:2:2, interlaced), or its edit list leaves pictures out.
    ///
    /// # Errors
    /// [`CaptureError::Data`] when the file is damaged or has no video, [`CaptureError::Io`] when it cannot be read.
    pub fn open(path: &Path) -> Result<Option<Self>, CaptureError> {
        let name = name_of(path);
        let io = |e| CaptureError::from_io(path, e);
        let file = File::open(path).map_err(io)?;
        let file_bytes = file.metadata().map_err(io)?.len();
        let damaged = |what: &str| {
            CaptureError::data(
                name.clone(),
                format!(
                    "expected an MP4 film, {what}; check the file, copy it again if it was cut off"
                ),
            )
        };
        let mut reader = BufReader::new(file.try_clone().map_err(io)?);
        let (reader, end, pixel, is_fragment_cut) = Walk::through(&mut reader, file_bytes)
            .and_then(|walk| {
                let (end, pixel, is_cut) = (walk.end(), walk.pixel(), walk.is_fragment_cut());
                Ok((Guarded::new(reader, walk, file_bytes)?, end, pixel, is_cut))
            })
            .map_err(|e| damaged(&format!("found damage ({e})")))?;
        let mp4 = quietly(move || Mp4::read(reader, end))
            .ok_or_else(|| damaged("its tables contradict each other"))?
            .map_err(|e| damaged(&format!("found damage ({e})")))?;
        let track = mp4
            .tracks()
            .values()
            .find(|t| t.kind == Some(TrackKind::Video))
            .ok_or_else(|| damaged("found no video in it"))?;
        let trak = track.trak(&mp4);
        let StsdBoxContent::Avc1(avc) = &trak.mdia.minf.stbl.stsd.contents else {
            return Ok(None);
        };
        if track.samples.is_empty() || track.timescale == 0 {
            return Err(damaged("found no pictures in it"));
        }
        let edits = trak.edts.as_ref().and_then(|edts| edts.elst.as_ref());
        let Some(stamps) = stamps(&mp4, track) else {
            return Ok(None);
        };
        let first = stamps.iter().copied().min().unwrap_or(0);
        let tick = 1e9 / track.timescale as f64;
        let moments = moments(&stamps, tick);
        let last = moments
            .iter()
            .rev()
            .take(2)
            .map(|moment| moment.time_ns as f64);
        let least = if moments.len() > 1 {
            last.sum::<f64>() / 2.0
        } else {
            0.0
        };
        let movie_tick = 1e9 / f64::from(mp4.moov.mvhd.timescale.max(1));
        let edits = edits.into_iter().flat_map(|list| list.entries.iter());
        // Of a film in fragments it may be that of the part before them.
        let is_whole = mp4.moofs.is_empty();
        let edits = edits.map(|e| {
            let ticks = if is_whole { e.segment_duration } else { 0 };
            (e.media_time, ticks as f64 * movie_tick)
        });
        if is_cut(edits, first, least) {
            return Ok(None);
        }
        let config = &avc.avcc.contents;
        let mut stream = Vec::new();
        let mut sets = config.sequence_parameter_sets.iter();
        for unit in sets.clone().chain(&config.picture_parameter_sets) {
            stream.extend_from_slice(&START_CODE);
            stream.extend_from_slice(&unit.bytes);
        }
        let mut decoder = Decoder::new().map_err(|e| damaged(&e.to_string()))?;
        if decoder.decode_with_options(&stream, no_flush()).is_err() {
            return Ok(None);
        }
        let range = sets.find_map(|set| sps::range(&set.bytes));
        let seconds = moments.back().map_or(0, |last| last.time_ns) as f64 / 1e9;
        let matrix = &trak.tkhd.matrix;
        let orientation = orientation([matrix.a, matrix.b, matrix.c, matrix.d]);
        let shape = pixel.and_then(|(across, down)| PixelShape::new(across.into(), down.into()));
        Ok(Some(Self {
            fps: (seconds > 0.0).then(|| (moments.len() - 1) as f64 / seconds),
            length_bytes: usize::from(config.length_size_minus_one & 3) + 1,
            shape: match orientation {
                Orientation::QuarterClockwise | Orientation::QuarterCounterClockwise => {
                    shape.map(PixelShape::turned)
                }
                _ => shape,
            },
            orientation,
            range: range.unwrap_or_default(),
            samples: track.samples.clone(),
            last: Moment {
                time_ns: 0,
                sequence: 0,
                sample: 0,
            },
            moments,
            name,
            file,
            file_bytes,
            decoder,
            position: 0,
            rest: VecDeque::new(),
            ended: false,
            is_fragment_cut,
            cut: None,
            sample: Vec::new(),
            stream,
        }))
    }

    /// How wide the pixels of its pictures are, where it says so.
    pub(crate) fn pixel_shape(&self) -> Option<PixelShape> {
        self.shape
    }

    /// Whether the file ends inside the next sample.
    fn is_cut_off(&self) -> bool {
        let sample = &self.samples[self.position];
        let end = sample.offset.checked_add(sample.size);
        end.is_none_or(|end| end > self.file_bytes)
    }

    /// Why there are no pictures from this place on.
    fn cut_off(&self) -> CaptureError {
        CaptureError::data(
            self.name.clone(),
            format!(
                "the file ends inside picture {}; the pictures before it were read, copy the file again for the rest",
                self.position
            ),
        )
    }

    /// Reads the next sample and rewrites its lengths as start codes.
    fn read_sample(&mut self) -> Result<(), CaptureError> {
        let sample = self.samples[self.position];
        self.position += 1;
        // At most the file's own size.
        self.sample.resize(sample.size as usize, 0);
        self.file
            .seek(SeekFrom::Start(sample.offset))
            .and_then(|_| self.file.read_exact(&mut self.sample))
            .map_err(|e| CaptureError::from_io_named(&self.name, e))?;
        self.stream.clear();
        let mut left = &self.sample[..];
        while left.len() > self.length_bytes {
            let (length, body) = left.split_at(self.length_bytes);
            let length = length.iter().fold(0, |n, b| n << 8 | usize::from(*b));
            let length = length.min(body.len());
            self.stream.extend_from_slice(&START_CODE);
            self.stream.extend_from_slice(&body[..length]);
            left = &body[length..];
        }
        Ok(())
    }

    /// Gives a picture its place in time and turns it upright.
    fn finish(&mut self, frame: &mut Frame) {
        self.orientation.apply(frame);
        if let Some(moment) = self.moments.pop_front() {
            self.last = moment;
        }
        (frame.sequence, frame.time_ns) = (self.last.sequence, self.last.time_ns);
    }

    /// Leaves out the picture of the sample that was decoded last: those after it keep their times.
    fn leave_out(&mut self) {
        let sample = self.position - 1;
        self.moments.retain(|moment| moment.sample != sample);
    }
}

impl Source for Mp4Source {
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        while !self.ended && self.position < self.samples.len() {
            if self.is_cut_off() {
                self.cut = Some(self.cut_off());
                // What the decoder still holds is of samples before.
                let position = self.position;
                self.moments.retain(|moment| moment.sample < position);
                break;
            }
            self.read_sample()?;
            let name = format!("{}, picture {}", self.name, self.position - 1);
            let picture = |reason| CaptureError::Picture {
                input: name,
                reason,
            };
            match self.decoder.decode_with_options(&self.stream, no_flush()) {
                Ok(None) => {}
                Ok(Some(yuv)) => {
                    let drawn = to_rgb(&yuv, self.range, frame);
                    self.finish(frame);
                    return drawn.map(|()| true).map_err(picture);
                }
                Err(e) => {
                    self.leave_out();
                    return Err(picture(format!(
                        "the picture is damaged ({e}); it is left out"
                    )));
                }
            }
        }
        if !self.ended {
            self.ended = true;
            if self.is_fragment_cut && self.cut.is_none() {
                self.cut = Some(self.cut_off());
            }
            let rest = self.decoder.flush_remaining().unwrap_or_default();
            for yuv in &rest {
                let mut frame = Frame::default();
                if to_rgb(yuv, self.range, &mut frame).is_ok() {
                    self.rest.push_back(frame);
                }
            }
        }
        match self.rest.pop_front() {
            Some(last) => {
                *frame = last;
                self.finish(frame);
                Ok(true)
            }
            None => self.cut.take().map_or(Ok(false), Err),
        }
    }

    fn frame_count(&self) -> Option<u64> {
        Some(self.samples.len() as u64)
    }

    fn fps(&self) -> Option<f64> {
        self.fps
    }

    fn name(&self) -> &str {
        &self.name
    }
}

/// Pictures come in the order in which they are shown only when the decoder may hold some back.
fn no_flush() -> DecodeOptions {
    DecodeOptions::new().flush_after_decode(Flush::NoFlush)
}

/// The decoder's planes → RGB.
fn to_rgb(yuv: &DecodedYUV<'_>, range: Range, frame: &mut Frame) -> Result<(), String> {
    let (width, height) = yuv.dimensions();
    check_size(width as u64, height as u64)?;
    frame.width = width as u32;
    frame.height = height as u32;
    frame.rgb.resize(3 * width * height, 0);
    let matrix = if height >= HIGH_DEFINITION_LINES {
        Matrix::Bt709
    } else {
        Matrix::Bt601
    };
    let (y, u, _) = yuv.strides();
    YuvToRgb::new(matrix, range).planar(
        [yuv.y(), yuv.u(), yuv.v()],
        [y, u],
        (1, 1),
        width,
        &mut frame.rgb,
    );
    Ok(())
}

/// A track's matrix (a, b, c, d) as one of the eight orientations; anything skewed counts as upright.
fn orientation(matrix: [i32; 4]) -> Orientation {
    match matrix.map(i32::signum) {
        [-1, 0, 0, -1] => Orientation::HalfTurn,
        [0, 1, -1, 0] => Orientation::QuarterClockwise,
        [0, -1, 1, 0] => Orientation::QuarterCounterClockwise,
        [-1, 0, 0, 1] => Orientation::MirroredAcross,
        [1, 0, 0, -1] => Orientation::MirroredDown,
        _ => Orientation::Upright,
    }
}
