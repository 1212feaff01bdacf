//! Several cameras round one scene: films, their truth, their calibration, masks and observations in one folder.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use image::ImageEncoder;
use image::codecs::png::PngEncoder;
use indicatif::ProgressBar;

use super::strip::{Part, Room, Stopped, render};
use super::{SynthArgs, jpeg};
use crate::bounded::DATA;
use crate::camera::calibration::write_pose2sim;
use crate::capture::AviWriter;
use crate::commands::empty::expect_empty;
use crate::commands::exit::Failure;
use crate::commands::progress;
use crate::counted::counted;
use crate::lab::synth::TruthFrame;
use crate::lab::synth::detector::{Detector, Flaws};
use crate::lab::synth::frames::FrameWriter;
use crate::lab::synth::shoot::Reel;
use crate::lab::synth::studio::{Studio, name};
use crate::lab::synth::survey::Survey;
use crate::lab::synth::world::{FORMAT, VERSION, WorldFrame, WorldTruth};
use crate::output::AtomicFolder;
use crate::record::{Format, ObservationsRow, RecordWriter};

/// What is true about all views.
const WORLD: &str = "world.json";

/// Writes the folder, which appears only when it is complete: all views as far as the film of one before, or its truth,
/// has room. They are made one after the other: there is nothing of them all before the last is being made, so that
/// nothing is kept of what the user stops.
pub(super) fn write(
    args: &SynthArgs,
    views: usize,
    out: &Path,
    is_stopped: &Stopped<'_>,
) -> anyhow::Result<()> {
    expect_empty(out, |_| false)?;
    let size = (args.width, args.height);
    let (people, fps) = (args.people as usize, args.fps as f32);
    let frames = args.frames;
    let studio = Studio::until(args.seed, size, views, people, frames, fps, is_stopped);
    if studio.frames() < frames {
        return Err(Failure::stopped(0).into());
    }
    let folder = AtomicFolder::create(out).map_err(|e| Failure::output(out, &e))?;
    let failed = |e: io::Error| Failure::output(out, &e);
    let calibration = folder.beside().join("Calib.toml");
    std::fs::write(calibration, write_pose2sim(&studio.views())).map_err(failed)?;
    if is_surveyed(args) {
        studio.prepare();
    }
    let bar = progress::bar(args.frames * views as u64, "frames");
    let (mut wanted, mut lengths) = (args.frames, Vec::new());
    let mut ended = Ok(());
    for number in 0..views {
        let view = Seen {
            args,
            studio: &studio,
            number,
            folder: folder.beside(),
            bar: &bar,
            is_stopped,
        };
        let room = expect_whole(view.write(wanted)?)?;
        wanted = room.taken();
        lengths.push(wanted);
        ended = ended.and(room.ended(&out.join(view.film()), &out.join(view.truth())));
    }
    // Each is wanted as long as the one before.
    let longest = lengths.first().copied().unwrap_or_default();
    let room = expect_whole(world(args, &studio, longest, folder.beside(), is_stopped)?)?;
    ended = ended.and(room.ended(out, &out.join(WORLD)));
    ended = tell_lengths(ended, &lengths);
    bar.finish_and_clear();
    folder.finish().map_err(failed)?;
    ended
}

/// Adds to what is said of a view without room that the views differ in length, where they do.
///
/// # Errors
/// Those of `ended`.
fn tell_lengths(ended: anyhow::Result<()>, lengths: &[u64]) -> anyhow::Result<()> {
    match (lengths.first(), lengths.last()) {
        (Some(first), Some(last)) if first > last => ended.map_err(|e| {
            e.context(format!(
                "views differ in length, from {} of {} to {last} of {}: use the first {last} of each",
                counted(*first, "frame", "frames"),
                name(0),
                name(lengths.len() - 1),
            ))
        }),
        _ => ended,
    }
}

/// Refuses a part that the user stopped.
fn expect_whole(part: Room) -> anyhow::Result<Room> {
    match part.is_stopped() {
        true => Err(Failure::stopped(0).into()),
        false => Ok(part),
    }
}

/// Whether anybody has to look which pixels show whom.
fn is_surveyed(args: &SynthArgs) -> bool {
    args.masks || !args.truth_only
}

/// Writes where everybody is in the world, so many frames.
fn world(
    args: &SynthArgs,
    studio: &Studio,
    frames: u64,
    folder: &Path,
    is_stopped: &Stopped<'_>,
) -> anyhow::Result<Room> {
    let path = folder.join(WORLD);
    let failed = |_: Part, e: io::Error| Failure::output(&path, &e);
    let no_world = |e: io::Error| failed(Part::Truth, e);
    let about = WorldTruth {
        format: FORMAT.to_owned(),
        version: VERSION,
        seed: args.seed,
        fps: args.fps as f32,
        frames: Vec::new(),
    };
    let text = BufWriter::new(File::create(&path).map_err(no_world)?);
    let mut text = FrameWriter::new(text, &about.head(), DATA).map_err(no_world)?;
    let no_film = None::<&mut AviWriter<File>>;
    let one = |k: u64| Ok((Vec::new(), studio.world(k)));
    let taken = |_: &WorldFrame| Ok(());
    let room = render(frames, no_film, &mut text, one, taken, is_stopped, failed)?;
    text.finish().map_err(no_world)?;
    Ok(room)
}

/// One camera of a studio, and where what it sees is written.
struct Seen<'a> {
    args: &'a SynthArgs,
    studio: &'a Studio,
    number: usize,
    folder: &'a Path,
    bar: &'a ProgressBar,
    is_stopped: &'a Stopped<'a>,
}

impl Seen<'_> {
    /// The film's name, also where no film is made: frame numbers of one camera's truth are no other one's.
    fn film(&self) -> String {
        format!("{}.avi", name(self.number))
    }

    fn truth(&self) -> String {
        format!("{}.truth.json", name(self.number))
    }

    /// Writes the camera's film, masks, truth and what a detector would tell, as many frames as are wanted and have
    /// room.
    fn write(&self, wanted: u64) -> anyhow::Result<Room> {
        let (args, clip) = (self.args, self.film());
        let (film, truth) = (self.folder.join(&clip), self.folder.join(self.truth()));
        let no_film = |e: io::Error| Failure::output(&film, &e);
        let no_truth = |e: io::Error| Failure::output(&truth, &e);
        let mut avi = if args.truth_only {
            None
        } else {
            let file = BufWriter::new(File::create(&film).map_err(no_film)?);
            let rate = (args.fps, 1);
            Some(AviWriter::new(file, args.width, args.height, rate).map_err(no_film)?)
        };
        let text = BufWriter::new(File::create(&truth).map_err(no_truth)?);
        let mut text = super::truth(args, Some(Path::new(&clip)), text).map_err(no_truth)?;
        let masks = self.folder.join("masks").join(name(self.number));
        if args.masks {
            std::fs::create_dir_all(&masks).map_err(|e| Failure::output(&masks, &e))?;
        }
        let mask_of = |k: u64| masks.join(format!("{k:06}.png"));
        let mut observed = args.observed.then(|| self.detector()).transpose()?;
        let size = [args.width, args.height];
        let taken = |frame: &TruthFrame| {
            if let Some((detector, file)) = &mut observed {
                let mut told = detector.observe(frame, size);
                told.frame_total = wanted as u32;
                file.write(&told, &clip)?;
            }
            Ok(())
        };
        let failed = |part: Part, e: io::Error| match part {
            Part::Film => no_film(e),
            Part::Truth => no_truth(e),
        };
        let one = self.shooting(&mask_of);
        let film = avi.as_mut();
        let room = render(wanted, film, &mut text, one, taken, self.is_stopped, failed)?;
        if let Some(avi) = avi {
            avi.finish().map_err(no_film)?;
        }
        text.finish().map_err(no_truth)?;
        if let Some((_, file)) = observed {
            file.finish()?;
        }
        for path in room.beyond().filter(|_| args.masks).map(mask_of) {
            super::remove(&path)?;
        }
        Ok(room)
    }

    /// Makes the picture of a frame, where there is to be one, its mask and the truth about it.
    fn shooting(
        &self,
        mask_of: &(impl Fn(u64) -> PathBuf + Sync),
    ) -> impl Fn(u64) -> anyhow::Result<(Vec<u8>, TruthFrame)> + Sync {
        let args = self.args;
        let reel = is_surveyed(args).then(|| Reel::of(self.studio.seen_by(self.number)));
        let ids: Vec<u8> = (1..=args.people as u8).collect();
        move |k: u64| {
            let (picture, survey, known) = match &reel {
                None => (Vec::new(), None, self.studio.outline(self.number, k)),
                Some(reel) if args.truth_only => {
                    let (survey, known) = reel.survey(k);
                    (Vec::new(), Some(survey), known)
                }
                Some(reel) => {
                    let shot = reel.shot(k);
                    let picture = jpeg(&shot.frame, args.quality.unwrap_or(60))?;
                    (picture, Some(shot.picture.survey), shot.truth)
                }
            };
            if let Some(survey) = survey.filter(|_| args.masks) {
                mask(args, &survey, &ids, &mask_of(k))?;
            }
            self.bar.inc(1);
            Ok((picture, known))
        }
    }

    /// What tells of the view as a network would, and the record that it is told to.
    fn detector(&self) -> anyhow::Result<(Detector, RecordWriter<ObservationsRow>)> {
        let args = self.args;
        let seed = args.seed.wrapping_mul(64).wrapping_add(self.number as u64);
        let path = self.folder.join(format!("{}.jsonl", name(self.number)));
        let file = RecordWriter::create(&path, Format::Jsonl)?;
        Ok((Detector::new(Flaws::MEASURED, args.fps as f32, seed), file))
    }
}

fn mask(args: &SynthArgs, survey: &Survey, ids: &[u8], path: &Path) -> anyhow::Result<()> {
    let failed = |e: io::Error| Failure::output(path, &e);
    let mut file = BufWriter::new(File::create(path).map_err(failed)?);
    PngEncoder::new(&mut file).write_image(
        &survey.owners(ids),
        args.width,
        args.height,
        image::ExtendedColorType::L8,
    )?;
    file.flush().map_err(failed)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::exit;

    #[test]
    fn views_that_differ_in_length_are_told() {
        let full = || {
            let full = io::Error::from(io::ErrorKind::FileTooLarge);
            Err(anyhow::Error::from(full).context("cam02.avi: full after 7 frames"))
        };
        let said = |lengths: &[u64]| exit::told(&tell_lengths(full(), lengths).unwrap_err());
        let told = said(&[9, 7, 7]);
        assert!(
            told.contains("from 9 frames of cam01 to 7 of cam03"),
            "{told}"
        );
        assert!(told.contains("cam02.avi: full"), "{told}");
        assert!(!said(&[7, 7]).contains("differ"), "both have as many");
        tell_lengths(Ok(()), &[7, 7]).unwrap();
    }
}
