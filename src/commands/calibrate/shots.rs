//! One camera's pictures of a board: photos or a film go in, corners come out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::board::{Board, Corner, Finder};
use crate::capture::{self, Frame, InputSpec, OpenOptions, Source};
use crate::commands::exit::Failure;
use crate::commands::progress;

/// Of a film so many pictures a second are looked at, each the first at or after its moment: a board is moved slowly.
const FILM_RATE: f64 = 2.0;
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
#[derive(Debug, Clone)]
pub struct Pictures {
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Pictures looked at.
    pub count: usize,
    /// Those with the board.
    pub found: Vec<Picture>,
    /// Moments without it, and why.
    pub refused: Vec<(String, String)>,
}

impl Pictures {
    /// Looks at every photo of a folder, or at two pictures a second of a film.
    ///
    /// # Errors
    /// When there are no pictures, they have several sizes, or none shows the board.
    pub fn read(camera: &str, path: &Path, board: &Board) -> anyhow::Result<Self> {
        let finder = Finder::new(board).map_err(Failure::usage)?;
        let mut source = capture::open(&InputSpec::Path(path.into()), &OpenOptions::default())?;
        if source.is_live() {
            return Err(Failure::usage(format!(
                "expected photos or a film of camera {camera}, found the camera {}; record it first",
                path.display()
            ))
            .into());
        }
        let fps = source.fps().filter(|_| !source.is_stills());
        let bar = progress::bar(source.frame_count().unwrap_or(0), camera);
        let mut read = Self {
            size: [0; 2],
            count: 0,
            found: Vec::new(),
            refused: Vec::new(),
        };
        let mut frame = Frame::default();
        for number in 0_u64.. {
            match source.next_into(&mut frame) {
                Ok(false) => break,
                Ok(true) => {
                    if let Some(moment) = moment(&*source, number, fps) {
                        read.look(camera, &frame, moment, &finder)?;
                    }
                }
                Err(e) if e.is_skippable() => {
                    if let Some(moment) = moment(&*source, number, fps) {
                        read.count += 1;
                        read.refused.push((moment, "cannot be read".into()));
                    }
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
        moment: String,
        finder: &Finder,
    ) -> anyhow::Result<()> {
        let size = [frame.width, frame.height];
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
        match finder.find(&frame.rgb, size) {
            Ok(corners) => self.found.push(Picture { moment, corners }),
            Err(miss) => self.refused.push((moment, miss.to_string())),
        }
        Ok(())
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

    /// A line for every picture without the board, or for every reason where they are many.
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
        self.reasons().into_iter().map(one).collect()
    }
}

/// What the source's newest picture is called: pictures of one moment have one name. `None` between the moments of a
/// film.
fn moment(source: &dyn Source, number: u64, fps: Option<f64>) -> Option<String> {
    if let Some(fps) = fps {
        return moment_of_film(number, fps);
    }
    let path = PathBuf::from(source.picture());
    let stem = path.file_stem().filter(|_| source.is_stills());
    Some(stem.map_or_else(|| number.to_string(), |s| s.to_string_lossy().into_owned()))
}

fn moment_of_film(number: u64, fps: f64) -> Option<String> {
    // The newest moment by a frame; a time just short of one by rounding counts as that one.
    let newest = |number: u64| (number as f64 * FILM_RATE / fps + 1e-6).floor();
    let is_first = number == 0 || newest(number) > newest(number - 1);
    is_first.then(|| format!("{:.1}s", newest(number) / FILM_RATE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn films_of_different_rates_show_the_same_moments() {
        for fps in [15.0, 24.0, 25.0, 29.97, 30.0, 59.94, 60.0] {
            let seconds = |number| f64::from(number) / fps;
            let shown: Vec<(u32, String)> = (0..2000)
                .take_while(|n| seconds(*n) < 10.02)
                .filter_map(|n| Some((n, moment_of_film(n.into(), fps)?)))
                .collect();
            assert_eq!(shown.len(), 21, "{fps}");
            for (k, (number, name)) in shown.iter().enumerate() {
                let moment = 0.5 * k as f64;
                assert_eq!(*name, format!("{moment:.1}s"), "{fps}");
                let late = seconds(*number) - moment;
                assert!((-1e-6..1.0 / fps).contains(&late), "{fps}: {late}");
            }
        }
        let slow: Vec<_> = (0..3).map(|n| moment_of_film(n, 1.0).unwrap()).collect();
        assert_eq!(slow, ["0.0s", "1.0s", "2.0s"]);
    }
}
