//! Which of a film's pictures came out of ffmpeg: when each is shown goes in, its place among those that ffprobe lists
//! comes out. One that cannot be decoded leaves its place empty, and those after it keep theirs.
//!
//! ffmpeg tells the time of a picture before it hands it on, on a pipe that lies where its standard input would be: of
//! the descriptors that a child has, the one that it has no other use for. Times are those of the file's own clock,
//! with `-copyts`, as in ffprobe's list.

use std::io::{self, BufRead, BufReader, PipeReader, PipeWriter};

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};

/// Filters that have ffmpeg tell when a picture is shown, microseconds. Only pictures that have an entry are told of.
pub(super) const FILTERS: &str = r"settb=1/1000000,metadata=mode=add:key=edgecap:value=1,metadata=mode=print:key=edgecap:file='pipe\:0':direct=1";
/// The option without which what is told lies in a buffer when its picture comes: ffmpeg 4 may lack it.
pub(super) const OPTION: &str = "direct";
/// By so much two programs may round apart, microseconds.
const ROUNDING: i64 = 1;

/// Pictures as ffprobe lists them, in the order in which they are shown.
#[derive(Debug, Default)]
pub(super) struct Listed {
    /// When each is shown, microseconds of the file's clock, which may begin anew.
    shown: Vec<i64>,
    /// Where each piece of one clock ends.
    ends: Vec<usize>,
    /// How many come before the first key picture and refer to pictures that are not in the file.
    early: usize,
}

impl Listed {
    /// Of pieces of one clock each, seconds in order; `early`: pictures before the first key picture.
    pub fn new(pieces: &[Vec<f64>], early: usize) -> Self {
        let shown = pieces.iter().flatten();
        let ends = pieces.iter().scan(0, |end, piece| {
            *end += piece.len();
            Some(*end)
        });
        Self {
            shown: shown.map(|t| (t * 1e6).round() as i64).collect(),
            ends: ends.collect(),
            early,
        }
    }

    pub fn is_empty(&self) -> bool {
        self.shown.is_empty()
    }
}

/// How far a film has come.
#[derive(Debug, Default)]
pub(super) struct Progress {
    /// Pictures that came.
    pub given: u64,
    /// Pictures between them that could not be decoded, and should have been.
    pub undecoded: u64,
    /// Of those listed, where the next is expected.
    next: usize,
    /// The one that is counted as the film's first.
    first: usize,
    /// When the last that was told of is shown, microseconds.
    last: Option<i64>,
}

impl Progress {
    /// Takes in a picture that is `shown` then, microseconds, as far as that is told: where it is listed, and where the
    /// film's first is. One of another time than all that are listed has the place after the last.
    pub fn take(&mut self, listed: &Listed, shown: Option<i64>) -> (usize, usize) {
        let found = shown.and_then(|shown| self.find(listed, shown));
        let place = found.unwrap_or(self.next);
        if self.given == 0 && place >= listed.early {
            // The early ones were left out, as they may be.
            (self.first, self.next) = (listed.early, listed.early);
        }
        self.undecoded += place.saturating_sub(self.next.max(listed.early)) as u64;
        self.given += 1;
        self.next = place + 1;
        self.last = shown.or(self.last);
        (place, self.first)
    }

    /// Pictures up to the last that came, those that could not be decoded among them.
    pub fn reached(&self) -> u64 {
        (self.next - self.first) as u64
    }

    /// The place of a picture that is shown then; only a clock that goes back begins another piece.
    fn find(&self, listed: &Listed, shown: i64) -> Option<usize> {
        let goes_back = self.last.is_some_and(|last| shown < last);
        let present = listed.ends.partition_point(|end| *end <= self.next);
        let pieces = if goes_back { usize::MAX } else { 1 };
        let mut from = self.next;
        for end in listed.ends[present..].iter().take(pieces) {
            let piece = &listed.shown[from..*end];
            let at = piece.partition_point(|t| *t < shown - ROUNDING);
            if piece.get(at).is_some_and(|t| *t <= shown + ROUNDING) {
                return Some(from + at);
            }
            from = *end;
        }
        None
    }
}

/// What ffmpeg tells, read without waiting: what was not told when a picture came never will be.
pub(super) struct Told {
    pipe: BufReader<PipeReader>,
    line: Vec<u8>,
}

impl Told {
    /// The end that is read, and the one that is to be the child's standard input.
    ///
    /// # Errors
    /// The system's own: no descriptor is left.
    pub fn new() -> io::Result<(Self, PipeWriter)> {
        let (reader, writer) = io::pipe()?;
        fcntl_setfl(&reader, fcntl_getfl(&reader)? | OFlags::NONBLOCK)?;
        let told = Self {
            pipe: BufReader::new(reader),
            line: Vec::new(),
        };
        Ok((told, writer))
    }

    /// When the picture is shown that has come, microseconds; `None` where nobody says.
    pub fn next(&mut self) -> Option<i64> {
        loop {
            // A line that is not whole stays for the next time.
            self.pipe.read_until(b'\n', &mut self.line).ok()?;
            if self.line.pop()? != b'\n' {
                return None;
            }
            let line = std::mem::take(&mut self.line);
            let line = String::from_utf8_lossy(&line);
            // `frame:0    pts:83333   pts_time:0.083333`, `pts:NOPTS` where that is unknown.
            if line.starts_with("frame:") {
                let mut words = line.split_ascii_whitespace();
                return words.find_map(|w| w.strip_prefix("pts:"))?.parse().ok();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    /// The places of pictures that are shown then, and how many between them are missing.
    fn places(listed: &Listed, shown: &[Option<i64>]) -> (Vec<usize>, u64) {
        let mut progress = Progress::default();
        let places = shown.iter().map(|t| progress.take(listed, *t).0);
        (places.collect(), progress.undecoded)
    }

    #[test]
    fn pictures_are_found_by_their_times() {
        let listed = Listed::new(&[vec![-0.5, 0.0, 0.0, 0.0333334, 0.9, 1.0]], 0);
        let at = |shown: &[i64]| {
            let shown: Vec<Option<i64>> = shown.iter().copied().map(Some).collect();
            places(&listed, &shown)
        };
        let whole = [-500_000, 0, 0, 33_334, 900_000, 1_000_000];
        assert_eq!(at(&whole), ((0..6).collect(), 0));
        assert_eq!(at(&[0, 0, 900_000]), (vec![1, 2, 4], 2));
        assert_eq!(at(&[-500_000, 900_000, 1_000_000]), (vec![0, 4, 5], 3));
        // One that no packet tells of takes the next place.
        assert_eq!(at(&[-500_000, 7, 33_333]), (vec![0, 1, 3], 1));
        assert_eq!(places(&listed, &[None; 7]), ((0..7).collect(), 0));
        assert_eq!(
            places(&listed, &[None, Some(900_000), None]),
            (vec![0, 4, 5], 3)
        );
        let none = Listed::default();
        assert_eq!(places(&none, &[Some(3), Some(9)]), (vec![0, 1], 0));
    }

    #[test]
    fn another_piece_begins_where_the_clock_goes_back() {
        let listed = Listed::new(&[vec![0.0, 0.1, 0.2], vec![0.0, 0.1, 0.2, 0.3]], 0);
        let at = |shown: &[i64]| {
            let shown: Vec<Option<i64>> = shown.iter().map(|t| Some(100_000 * t)).collect();
            places(&listed, &shown)
        };
        assert_eq!(at(&[0, 1, 2, 0, 1, 2, 3]), ((0..7).collect(), 0));
        assert_eq!(at(&[0, 1, 0, 1]), (vec![0, 1, 3, 4], 1));
        assert_eq!(at(&[0, 2, 1, 3]), (vec![0, 2, 4, 6], 3));
        // A time of the second piece alone is none of the first.
        assert_eq!(at(&[0, 3, 2]), (vec![0, 1, 2], 0));
    }

    #[test]
    fn pictures_before_the_first_key_picture_may_be_left_out() {
        let listed = Listed::new(&[vec![0.0, 0.1, 0.2, 0.3]], 2);
        let mut left_out = Progress::default();
        assert_eq!(left_out.take(&listed, Some(200_000)), (2, 2));
        assert_eq!((left_out.reached(), left_out.undecoded), (1, 0));
        let mut damaged = Progress::default();
        assert_eq!(damaged.take(&listed, Some(300_000)), (3, 2));
        assert_eq!((damaged.reached(), damaged.undecoded), (2, 1));
        let mut shown_in_part = Progress::default();
        assert_eq!(shown_in_part.take(&listed, Some(0)), (0, 0));
        assert_eq!(shown_in_part.take(&listed, Some(300_000)), (3, 0));
        assert_eq!((shown_in_part.reached(), shown_in_part.undecoded), (4, 1));
    }

    #[test]
    fn what_is_told_is_read_without_waiting() {
        let (mut told, mut child) = Told::new().unwrap();
        assert_eq!(told.next(), None);
        let mut tell = |text: &str| child.write_all(text.as_bytes()).unwrap();
        tell("frame:0    pts:-40000  pts_time:-0.04\nedgecap=1\n");
        tell("frame:1    pts:NOPTS   pts_time:NOPTS\nedgecap=1\nframe:2 ");
        assert_eq!((told.next(), told.next()), (Some(-40_000), None));
        assert_eq!(told.next(), None);
        tell("   pts:40000   pts_time:0.04\n");
        drop(child);
        assert_eq!((told.next(), told.next()), (Some(40_000), None));
    }
}
