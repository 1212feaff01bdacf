//! One camera's pictures of a board: photos or a film go in, corners come out.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::Path;

use crate::board::{Board, Corner, Finder};
use crate::capture::{
    self, CaptureError, Frame, InputSpec, OpenOptions, Orientation, PhotoSource, Source,
};
use crate::commands::exit::Failure;
use crate::commands::progress;

/// Of a film so many pictures a second are looked at, each the first at or after its moment: a board is moved slowly.
const FILM_RATE: f64 = 2.0;
/// A picture this little before a moment is of it, seconds.
const SLACK: f64 = 1e-6;
/// Endings of photos' names; what else follows a dot is a name's own.
const ENDINGS: [&str; 5] = ["jpg", "jpeg", "jpe", "jfif", "png"];
/// Why a damaged picture is refused.
const UNREADABLE: &str = "cannot be read";
/// More refused pictures than this are told by their reasons.
const MOST_LINES: usize = 8;

/// A picture that shows the board.
#[derive(Debug, Clone)]
pub struct Picture {
    /// File without ending, or the seconds since the film began: cameras may have rates of their own.
    pub moment: String,
    /// Corners.
    pub corners: Vec<Corner>,
}

/// What a camera's pictures show.
#[derive(Debug, Clone, Default)]
pub struct Pictures {
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Pictures looked at.
    pub count: usize,
    /// Those with the board.
    pub found: Vec<Picture>,
    /// Moments without it, and why.
    pub refused: Vec<(String, String)>,
    /// Why nothing behind the last picture could be read, of a film that is damaged or cut off.
    broken_off: Option<String>,
    /// What is wrong with the first picture of a film that could not be read, looked at or not.
    damaged: Option<String>,
    /// The first picture with the board, and how it was turned upright.
    first: Option<(String, Orientation)>,
}

impl Pictures {
    /// Looks at every photo of a folder, or at two pictures a second of a film, which may be cut off.
    ///
    /// # Errors
    /// When there are no pictures, they have several sizes, two with the board are of one moment or were turned
    /// differently, or none shows it.
    pub fn read(camera: &str, path: &Path, board: &Board) -> anyhow::Result<Self> {
        let finder = Finder::new(board).map_err(Failure::usage)?;
        if path.is_dir() {
            let mut photos = PhotoSource::folder(path, None)?;
            return Self::of(
                camera,
                &mut photos,
                PhotoSource::orientation,
                board,
                &finder,
            );
        }
        let mut source = capture::open(&InputSpec::Path(path.into()), &OpenOptions::default())?;
        if source.is_live() {
            return Err(Failure::usage(format!(
                "expected photos or a film of camera {camera}, found the camera {}; record it first",
                path.display()
            ))
            .into());
        }
        let as_stored = Orientation::default();
        Self::of(camera, &mut *source, |_| as_stored, board, &finder)
    }

    /// `turned` tells how the source's newest picture was turned upright.
    fn of<S: Source + ?Sized>(
        camera: &str,
        source: &mut S,
        turned: impl Fn(&S) -> Orientation,
        board: &Board,
        finder: &Finder,
    ) -> anyhow::Result<Self> {
        let mut film = None;
        let bar = progress::bar(source.frame_count().unwrap_or(0), camera);
        let mut read = Self::default();
        let mut frame = Frame::default();
        for number in 0_u64.. {
            let next = next_into(source, &mut frame);
            // A pipe's rate comes before its first picture.
            let film = film.get_or_insert_with(|| Moments::of(source));
            match next {
                Ok(false) => break,
                Ok(true) => {
                    let time_ns = Some(frame.time_ns);
                    if let Some(moment) = moment(film, source, number, time_ns) {
                        read.look(camera, &frame, turned(source), moment, finder)?;
                    }
                }
                Err(e) if e.is_skippable() => {
                    if !source.is_stills() {
                        read.damaged.get_or_insert_with(|| e.to_string());
                    }
                    if let Some(moment) = moment(film, source, number, None) {
                        read.count += 1;
                        read.refused.push((moment, UNREADABLE.into()));
                    }
                }
                // What was seen of it tells the lens as well as that of a shorter one.
                Err(e @ CaptureError::Data { .. }) if !read.found.is_empty() => {
                    read.broken_off = Some(e.to_string());
                    break;
                }
                Err(e) => return Err(e.into()),
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        if read.found.is_empty() {
            return Err(Failure::data(format!(
                "camera {camera}: expected the board {board} in some picture, found it in none of {} ({}); check --board, and that all of it is in view, sharp and lit evenly",
                read.count,
                read.reasons().first().map_or("no picture", |(reason, _)| reason)
            ))
            .into());
        }
        Ok(read)
    }

    fn look(
        &mut self,
        camera: &str,
        frame: &Frame,
        turned: Orientation,
        moment: String,
        finder: &Finder,
    ) -> anyhow::Result<()> {
        let size = [frame.width, frame.height];
        let found = finder.find(&frame.rgb, size);
        if found.is_ok() {
            // Before sizes, which a quarter turn exchanges.
            self.expect_turn(camera, turned, &moment)?;
        }
        if self.count == 0 || self.size == [0; 2] {
            self.size = size;
        } else if self.size != size {
            return Err(Failure::data(format!(
                "camera {camera}: expected pictures of one size, found {}x{} and, in {moment}, {}x{}; a lens is calibrated at the size it is used at",
                self.size[0], self.size[1], size[0], size[1]
            ))
            .into());
        }
        self.count += 1;
        match found {
            Ok(_) if self.found.iter().any(|p| p.moment == moment) => {
                return Err(Failure::data(format!(
                    "camera {camera}: expected one picture called {moment} that shows the board, found several, which differ in their ending only; rename or leave out all but one"
                ))
                .into());
            }
            Ok(corners) => self.found.push(Picture { moment, corners }),
            Err(miss) => self.refused.push((moment, miss.to_string())),
        }
        Ok(())
    }

    /// Fails where a picture with the board was turned upright otherwise than the first one.
    fn expect_turn(
        &mut self,
        camera: &str,
        turned: Orientation,
        moment: &str,
    ) -> Result<(), Failure> {
        let new = || (moment.to_owned(), turned);
        let (first, as_first) = self.first.get_or_insert_with(new);
        if *as_first == turned {
            return Ok(());
        }
        Err(Failure::data(format!(
            "camera {camera}: expected photos that are all turned the same way by their EXIF orientation, found {first} {} and {moment} {}: a lens is turned with its pictures; take them all one way up",
            told_turn(*as_first),
            told_turn(turned)
        )))
    }

    /// Whether all pictures could be read.
    pub fn are_whole(&self) -> bool {
        let is_read = |(_, reason): &(String, String)| reason != UNREADABLE;
        let is_film_whole = self.broken_off.is_none() && self.damaged.is_none();
        is_film_whole && self.refused.iter().all(is_read)
    }

    /// Why nobody knows whether there is a picture of this moment: it lies behind what could be read of a film.
    pub fn lacks(&self, moment: &str) -> Option<&str> {
        let reason = self.broken_off.as_deref()?;
        let at = seconds(moment)?;
        let looked_at = self.found.iter().map(|p| &p.moment);
        let looked_at = looked_at.chain(self.refused.iter().map(|(moment, _)| moment));
        let last = looked_at.filter_map(|m| seconds(m)).fold(0.0, f64::max);
        (at > last).then_some(reason)
    }

    /// Reasons, the most frequent first, and their pictures.
    fn reasons(&self) -> Vec<(&str, Vec<&str>)> {
        let mut by_reason: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for (moment, reason) in &self.refused {
            by_reason.entry(reason).or_default().push(moment);
        }
        let mut all: Vec<_> = by_reason.into_iter().collect();
        all.sort_by_key(|(_, moments)| std::cmp::Reverse(moments.len()));
        all
    }

    /// A line for every picture without the board, or for every reason where they are many; more for a film that is
    /// damaged or cut off.
    pub fn told(&self, camera: &str) -> Vec<String> {
        let one = |(reason, moments): (&str, Vec<&str>)| {
            let more = moments.len().saturating_sub(MOST_LINES);
            let rest = match more {
                0 => String::new(),
                n => format!(" and {n} more"),
            };
            let named = &moments[..moments.len() - more];
            format!(
                "camera {camera}: not used: {}{rest}: {reason}",
                named.join(", ")
            )
        };
        let damaged = self.damaged.as_ref().map(|reason| {
            format!("{reason}; of camera {camera} only the pictures that can be read are looked at")
        });
        let lacking = self.broken_off.as_ref().map(|reason| {
            format!("{reason}; of camera {camera} only the pictures before that are looked at")
        });
        let refused = self.reasons().into_iter().map(one);
        refused.chain(damaged).chain(lacking).collect()
    }
}

/// What was done to a photo so that it is upright.
fn told_turn(how: Orientation) -> &'static str {
    match how {
        Orientation::Upright => "as it is stored",
        Orientation::MirroredAcross => "mirrored left to right",
        Orientation::HalfTurn => "turned by half",
        Orientation::MirroredDown => "mirrored top to bottom",
        Orientation::Transposed => "with rows for columns",
        Orientation::QuarterClockwise => "turned clockwise",
        Orientation::Transversed => "with rows for columns and turned by half",
        Orientation::QuarterCounterClockwise => "turned counter-clockwise",
    }
}

/// The next picture, as [`Source::next_into`], however long the writer of a pipe takes for it.
fn next_into(source: &mut (impl Source + ?Sized), frame: &mut Frame) -> Result<bool, CaptureError> {
    loop {
        match source.next_into(frame) {
            Err(CaptureError::NoPictureYet { .. }) => {}
            next => return next,
        }
    }
}

/// What the source's newest picture is called: pictures of one moment have one name. `None` between the moments of a
/// film.
fn moment(
    film: &mut Option<Moments>,
    source: &(impl Source + ?Sized),
    number: u64,
    time_ns: Option<u64>,
) -> Option<String> {
    if let Some(film) = film {
        return film.next(time_ns);
    }
    if !source.is_stills() {
        return Some(number.to_string());
    }
    let name = without_ending(Path::new(&source.picture()));
    Some(name.unwrap_or_else(|| number.to_string()))
}

/// A photo's name without its ending: shot.1 and shot.2 are two.
fn without_ending(path: &Path) -> Option<String> {
    let is_ending = |e: &OsStr| ENDINGS.iter().any(|k| e.eq_ignore_ascii_case(k));
    let name = match path.extension().is_some_and(is_ending) {
        true => path.file_stem(),
        false => path.file_name(),
    };
    name.map(|name| name.to_string_lossy().into_owned())
}

/// When a moment of a film is by its name, seconds; `None` of photos.
fn seconds(moment: &str) -> Option<f64> {
    moment.strip_suffix('s')?.parse().ok()
}

/// The moments of a film, by the times of its pictures: films of phones have no even rate, others repeat pictures.
struct Moments {
    /// Seconds between two pictures, as far as the rate tells.
    step: f64,
    /// When the first picture was, seconds on the film's clock.
    began: Option<f64>,
    /// When the newest picture was, seconds after the first one.
    now: Option<f64>,
    /// The newest moment that has a picture, in moments.
    newest: Option<f64>,
}

impl Moments {
    /// `None` of photos, which have no rate.
    fn of(source: &(impl Source + ?Sized)) -> Option<Self> {
        let fps = source.fps().filter(|_| !source.is_stills());
        fps.map(Self::new)
    }

    fn new(fps: f64) -> Self {
        Self {
            step: 1.0 / fps,
            began: None,
            now: None,
            newest: None,
        }
    }

    /// The name of the next picture's moment, `None` between moments; `time_ns` is unknown of a picture that cannot be
    /// read.
    fn next(&mut self, time_ns: Option<u64>) -> Option<String> {
        let expected = self.now.map_or(0.0, |now| now + self.step);
        let now = time_ns.map_or(expected, |ns| {
            let own = ns as f64 * 1e-9;
            own - *self.began.get_or_insert(own - expected)
        });
        self.now = Some(now);
        // A time just short of a moment by rounding counts as that one.
        let newest = ((now + SLACK) * FILM_RATE).floor();
        let is_first = self.newest.is_none_or(|before| newest > before);
        is_first.then(|| {
            self.newest = Some(newest);
            format!("{:.1}s", newest / FILM_RATE)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six grey pictures, four a second.
    struct Film {
        /// How often the next picture is waited for before it comes.
        waits: usize,
        waited: usize,
        pictures: u64,
    }

    impl Source for Film {
        fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
            if self.waited < self.waits {
                self.waited += 1;
                return Err(CaptureError::NoPictureYet {
                    device: self.name().into(),
                    reason: "nothing has come yet".into(),
                    is_away: false,
                });
            }
            self.waited = 0;
            (frame.width, frame.height) = (64, 48);
            frame.rgb = vec![90; 3 * 64 * 48];
            frame.time_ns = 250_000_000 * self.pictures;
            self.pictures += 1;
            Ok(self.pictures <= 6)
        }

        /// As a pipe's, it comes with the first picture.
        fn fps(&self) -> Option<f64> {
            (self.waits == 0 || self.pictures > 0).then_some(4.0)
        }

        fn name(&self) -> &str {
            "film"
        }
    }

    #[test]
    fn a_pipe_that_is_waited_for_shows_what_a_file_shows() {
        let board = "9x6".parse().unwrap();
        let finder = Finder::new(&board).unwrap();
        let shown = |waits| {
            let mut film = Film {
                waits,
                waited: 0,
                pictures: 0,
            };
            let as_stored = Orientation::default();
            let failed = Pictures::of("hall", &mut film, |_| as_stored, &board, &finder);
            failed.expect_err("no board is in them").to_string()
        };
        let of_file = shown(0);
        assert!(of_file.contains("in none of 3 "), "{of_file}");
        assert_eq!(shown(2), of_file);
    }

    #[test]
    fn only_a_photo_s_ending_is_cut_off_its_name() {
        for (file, name) in [
            ("photos/3.png", "3"),
            ("photos/3.JPG", "3"),
            ("photos/shot.1", "shot.1"),
            ("photos/2026.11.30.jpeg", "2026.11.30"),
            ("photos/board", "board"),
        ] {
            assert_eq!(without_ending(Path::new(file)).as_deref(), Some(name));
        }
    }

    /// A board of 9x6 corners that fills the picture, upright or turned by a quarter.
    fn shown([width, height]: [u32; 2]) -> Frame {
        let colour = |k: u32| {
            let (x, y) = (k % width / 40, k / width / 40);
            let [columns, rows] = [width, height].map(|side| side / 40 - 1);
            let is_on = (1..columns).contains(&x) && (1..rows).contains(&y);
            [if is_on && (x + y) % 2 == 0 { 40 } else { 215 }; 3]
        };
        Frame {
            width,
            height,
            rgb: (0..width * height).flat_map(colour).collect(),
            ..Frame::default()
        }
    }

    /// Such as 3.png beside 3.jpg.
    #[test]
    fn two_pictures_of_one_moment_are_refused() {
        let frame = shown([480, 360]);
        let finder = Finder::new(&"9x6".parse().unwrap()).unwrap();
        let mut read = Pictures::default();
        let upright = Orientation::default();
        let mut look = |moment: &str| read.look("hall", &frame, upright, moment.into(), &finder);
        look("3").unwrap();
        look("4").unwrap();
        let said = look("3").unwrap_err().to_string();
        assert!(
            said.contains("camera hall") && said.contains("one picture called 3 "),
            "{said}"
        );
        assert_eq!(read.found.len(), 2);
    }

    /// A photo without the board tells nothing of the lens, however it was turned.
    #[test]
    fn photos_of_the_board_that_are_turned_differently_are_of_no_one_lens() {
        let upright = shown([480, 360]);
        let blank = Frame {
            rgb: vec![90; upright.rgb.len()],
            ..upright.clone()
        };
        let finder = Finder::new(&"9x6".parse().unwrap()).unwrap();
        let turned = shown([360, 480]);
        for (other, frame) in [
            (Orientation::HalfTurn, &upright),
            (Orientation::QuarterClockwise, &turned),
        ] {
            let mut read = Pictures::default();
            let mut look = |frame: &Frame, how, moment: &str| {
                let looked = read.look("hall", frame, how, moment.into(), &finder);
                looked.map_err(|e| e.to_string())
            };
            look(&blank, other, "2").unwrap();
            look(&upright, Orientation::Upright, "3").unwrap();
            look(&blank, other, "4").unwrap();
            let said = look(frame, other, "5").unwrap_err();
            for word in ["camera hall", "found 3 as it is", "and 5 turned"] {
                assert!(said.contains(word), "{said}");
            }
        }
    }

    #[test]
    fn what_lies_behind_a_cut_is_not_known() {
        let cut = Pictures {
            refused: vec![("2.5s".into(), "no corners".into())],
            broken_off: Some("cut".into()),
            ..Pictures::default()
        };
        let whole = Pictures {
            broken_off: None,
            ..cut.clone()
        };
        for (moment, why) in [("3.0s", Some("cut")), ("2.0s", None), ("floor", None)] {
            assert_eq!(cut.lacks(moment), why);
            assert_eq!(whole.lacks(moment), None);
        }
    }

    /// Names of the pictures at these times, seconds.
    fn names(fps: f64, seconds: impl Iterator<Item = f64>) -> Vec<Option<String>> {
        let mut moments = Moments::new(fps);
        let ns = |s: f64| (1e9 * s).round() as u64;
        seconds.map(|s| moments.next(Some(ns(s)))).collect()
    }

    #[test]
    fn films_of_different_rates_show_the_same_moments() {
        for fps in [15.0, 24.0, 25.0, 29.97, 30.0, 59.94, 60.0] {
            let seconds = |number: usize| number as f64 / fps;
            let times = (0..2000).map(seconds).take_while(|s| *s < 10.02);
            let each = names(fps, times).into_iter().enumerate();
            let shown: Vec<(usize, String)> = each.filter_map(|(n, s)| Some((n, s?))).collect();
            assert_eq!(shown.len(), 21, "{fps}");
            for (k, (number, name)) in shown.iter().enumerate() {
                let moment = 0.5 * k as f64;
                assert_eq!(*name, format!("{moment:.1}s"), "{fps}");
                let late = seconds(*number) - moment;
                assert!((-1e-6..1.0 / fps).contains(&late), "{fps}: {late}");
            }
        }
        let slow: Vec<_> = names(1.0, [0.0, 1.0, 2.0].into_iter());
        let slow: Vec<_> = slow.into_iter().flatten().collect();
        assert_eq!(slow, ["0.0s", "1.0s", "2.0s"]);
    }

    #[test]
    fn moments_go_by_time_where_the_rate_is_uneven() {
        // 30 frames a second for a second, then 10, on a clock that does not begin at 0.
        let fast = (0..30).map(|k| f64::from(k) / 30.0);
        let uneven: Vec<f64> = fast.chain((10..31).map(|k| f64::from(k) / 10.0)).collect();
        let shown = names(17.0, uneven.iter().map(|s| 7.0 + s));
        for (name, seconds) in shown.iter().zip(&uneven) {
            let is_moment = (2.0 * seconds - (2.0 * seconds).round()).abs() < 1e-6;
            let wanted = is_moment.then(|| format!("{seconds:.1}s"));
            assert_eq!(*name, wanted, "{seconds}");
        }
        assert_eq!(shown.into_iter().flatten().count(), 7);
    }

    #[test]
    fn pictures_that_cannot_be_read_have_their_time() {
        let mut moments = Moments::new(4.0);
        let times = [None, Some(250_000_000), None, Some(750_000_000), None];
        let shown = times.map(|ns| moments.next(ns));
        let wanted = [Some("0.0s"), None, Some("0.5s"), None, Some("1.0s")];
        assert_eq!(shown, wanted.map(|name| name.map(str::to_owned)));
    }
}
