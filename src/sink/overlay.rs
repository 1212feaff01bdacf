//! Pictures with the skeletons drawn, as a sink: a folder of them, or a film.

mod film;
mod pictures;
mod real_time;

use std::path::Path;

use self::film::Film;
use self::pictures::Pictures;
use self::real_time::Taken;
use super::{Packet, Sink, SinkError};
use crate::capture::{Frame, Rate};
use crate::message::{BodyFrame, FLAG_FILE_TIME, ObservationFrame};
use crate::overlay::{Person, draw};

/// What people call films and pictures that are not written.
const OTHER_FILES: [&str; 11] = [
    "mp4", "m4v", "mkv", "mov", "webm", "mpg", "gif", "y4m", "png", "jpg", "jpeg",
];

/// Draws into every picture that comes with its result, and writes it.
#[derive(Debug)]
pub struct OverlaySink {
    canvas: Frame,
    target: Target,
}

#[derive(Debug)]
enum Target {
    Pictures(Pictures),
    Film(Box<Film>),
}

/// Which picture it is.
#[derive(Debug, Clone, Copy)]
struct Which<'a> {
    sequence: u64,
    /// The photo's name.
    source: &'a str,
    taken: Taken,
}

impl<'a> Which<'a> {
    fn new(sequence: u64, source: &'a str, flags: u32, capture_ns: u64) -> Self {
        let taken = match flags & FLAG_FILE_TIME {
            0 => Taken::Live(capture_ns),
            _ => Taken::File(capture_ns),
        };
        Self {
            sequence,
            source,
            taken,
        }
    }
}

impl Target {
    fn break_off(&mut self) {
        if let Self::Film(film) = self {
            film.break_off();
        }
    }
}

impl OverlaySink {
    /// A film where `path` ends in `.avi`, with the `rate` that is known by its first picture; else a folder, which is
    /// made. Pictures in a folder are called like the photo that they are of, or by their number in a film (`is_stills`
    /// tells which). A film lasts as long as what it shows.
    ///
    /// # Errors
    /// [`SinkError::Kind`] for names of other films and of pictures, [`SinkError::Create`].
    pub fn create(path: &Path, rate: Rate, is_stills: bool) -> Result<Self, SinkError> {
        let is = |kind: &str| {
            path.extension()
                .is_some_and(|e| e.eq_ignore_ascii_case(kind))
        };
        if !path.is_dir() && OTHER_FILES.iter().any(|kind| is(kind)) {
            return Err(SinkError::Kind {
                path: path.to_owned(),
                expected: "a folder for pictures, or a film that ends in .avi",
            });
        }
        let target = if is("avi") {
            Target::Film(Box::new(Film::create(path, rate)?))
        } else {
            Target::Pictures(Pictures::create(path, is_stills)?)
        };
        Ok(Self {
            canvas: Frame::default(),
            target,
        })
    }

    fn write<P: Person>(
        &mut self,
        picture: Option<&Frame>,
        which: Which<'_>,
        people: &[P],
    ) -> Result<(), SinkError> {
        let Some(picture) = picture else {
            return Ok(());
        };
        self.canvas.clone_from(picture);
        draw(&mut self.canvas, people);
        match &mut self.target {
            Target::Pictures(all) => all.write(&self.canvas, which.sequence, which.source),
            Target::Film(film) => film.write(&self.canvas, which.taken),
        }
    }

    fn end(self) -> Result<Option<String>, SinkError> {
        match self.target {
            Target::Pictures(all) => Ok(Some(all.words())),
            Target::Film(film) => film.finish(),
        }
    }
}

impl Sink<ObservationFrame> for OverlaySink {
    fn take(&mut self, packet: &Packet<'_, ObservationFrame>) -> Result<(), SinkError> {
        let message = packet.message;
        let which = Which::new(
            message.sequence,
            packet.source,
            message.flags,
            message.capture_ns,
        );
        self.write(packet.picture, which, message.people())
    }

    fn break_off(&mut self) {
        self.target.break_off();
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        self.end()
    }
}

impl Sink<BodyFrame> for OverlaySink {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        let message = packet.message;
        let which = Which::new(
            message.sequence,
            packet.source,
            message.flags,
            message.capture_ns,
        );
        self.write(packet.picture, which, message.bodies())
    }

    fn break_off(&mut self) {
        self.target.break_off();
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        self.end()
    }
}
