//! `edgecap synth`: renders synthetic people with exact truth.

mod strip;
mod views;

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use indicatif::ProgressBar;

use self::strip::{Part, Stopped, render};
use super::apart::Apart;
use super::empty::expect_empty;
use super::exit::Failure;
use super::progress;
use super::say;
use super::stop::Stop;
use super::threads::ThreadsArgs;
use crate::bounded::DATA;
use crate::capture::{AviWriter, Frame};
use crate::lab::synth::frames::FrameWriter;
use crate::lab::synth::shoot::{Reel, Shot, outline_still, shoot_still};
use crate::lab::synth::stills::Stills;
use crate::lab::synth::truth::{FORMAT, VERSION};
use crate::lab::synth::{Truth, TruthFrame};
use crate::output::{AtomicFile, AtomicFolder, is_stdout};
use crate::sink::SinkError;

/// File type of single pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum PictureFormat {
    /// With the imitated camera's compression.
    Jpg,
    /// Without loss.
    Png,
}

/// Render moving, overlapping people with exact truth about them.
#[derive(Debug, Clone, clap::Args)]
pub struct SynthArgs {
    /// New or empty folder for numbered pictures and truth.json.
    #[arg(long, required_unless_present = "clip")]
    pub out: Option<PathBuf>,
    /// Write a Motion-JPEG clip to this AVI file instead; the truth goes to --out as truth.json,
    /// else beside the clip NAME.avi as NAME.truth.json.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["stills", "format"])]
    pub clip: Option<PathBuf>,
    /// Number of frames.
    #[arg(
        long,
        default_value_t = 150,
        value_parser = clap::value_parser!(u64).range(1..=1_000_000)
    )]
    pub frames: u64,
    /// People in the clip; with --stills at most this many.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(0..=32))]
    pub people: u32,
    /// Equal seeds give equal pictures.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Pixels across.
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(16..=4096))]
    pub width: u32,
    /// Pixels down.
    #[arg(long, default_value_t = 320, value_parser = clap::value_parser!(u32).range(16..=4096))]
    pub height: u32,
    /// Frames per second of a clip.
    #[arg(
        long,
        default_value_t = 15,
        conflicts_with = "stills",
        value_parser = clap::value_parser!(u32).range(1..=240)
    )]
    pub fps: u32,
    /// Every frame is an independent scene: new people, camera, light and place.
    #[arg(long)]
    pub stills: bool,
    /// With --stills: share of scenes that are seen from high up near by, as by a camera under a ceiling.
    #[arg(
        long,
        value_name = "0..1",
        default_value_t = 0.0,
        value_parser = share,
        requires = "stills"
    )]
    pub overhead: f32,
    /// So many calibrated cameras round one scene see the same people: in --out a film and its truth by camera,
    /// Calib.toml for 'multiview', and world.json with everybody's joints in its axes.
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=16),
        conflicts_with_all = ["stills", "clip", "format"]
    )]
    pub views: Option<u32>,
    /// With --views: who every pixel shows, as pictures masks/CAMERA/000000.png of identities, 0 where nobody is.
    #[arg(long, requires = "views")]
    pub masks: bool,
    /// With --views: what 'infer' would say of every view, as CAMERA.jsonl for 'multiview': the truth, with errors as
    /// large as those of the shipped weights.
    #[arg(long, requires = "views")]
    pub observed: bool,
    /// Only the truth about stills or views, no pictures: tens of thousands of people a second. Visible then means
    /// inside the picture; boxes and areas are absent unless --masks are made.
    #[arg(long, conflicts_with_all = ["quality", "format", "clip"])]
    pub truth_only: bool,
    /// JPEG quality; default: that of the imitated camera, 60 for a clip.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=100))]
    pub quality: Option<u8>,
    /// File type of single pictures.
    #[arg(long, value_enum, default_value_t = PictureFormat::Jpg)]
    pub format: PictureFormat,
    /// How many make frames.
    #[command(flatten)]
    pub threads: ThreadsArgs,
}

/// Runs the verb. What there is of it when the user stops it is kept, but for several views.
///
/// # Errors
/// The output folder holds files already, something cannot be written, threads cannot be started, or the user stops it.
pub fn synth(args: SynthArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    args.threads.run(|| write(&args, &|| stop.requested()))
}

fn write(args: &SynthArgs, is_stopped: &Stopped<'_>) -> anyhow::Result<()> {
    if args.truth_only && !args.stills && args.views.is_none() {
        return Err(Failure::usage(
            "expected --stills or --views beside --truth-only, found neither; a clip's truth comes with the clip",
        )
        .into());
    }
    if args.quality.is_some() && args.format == PictureFormat::Png {
        return Err(Failure::usage(
            "expected --quality with pictures that lose something, found --format png; leave one of them out",
        )
        .into());
    }
    if let (None, Some(out)) = (&args.clip, &args.out) {
        expect_empty(out, |_| false)?;
    }
    if let (Some(views), Some(out)) = (args.views, &args.out) {
        return views::write(args, views as usize, out, is_stopped);
    }
    if args.truth_only {
        let out = args.out.as_deref().unwrap_or(Path::new("."));
        return outlines(args, out, is_stopped);
    }
    let bar = progress::bar(args.frames, "frames");
    let done = match &args.clip {
        Some(file) => film(args, file, &bar, is_stopped),
        None => {
            let out = args.out.as_deref().unwrap_or(Path::new("."));
            album(args, out, &bar, is_stopped)
        }
    };
    bar.finish_and_clear();
    done
}

/// A share of a whole, from the command line.
fn share(text: &str) -> Result<f32, String> {
    let share: f32 = text
        .parse()
        .map_err(|_| format!("expected a number, found {text:?}"))?;
    if (0.0..=1.0).contains(&share) {
        return Ok(share);
    }
    Err(format!("expected a share from 0 to 1, found {text}"))
}

/// The stills that were asked for.
fn stills(args: &SynthArgs) -> Stills {
    Stills {
        seed: args.seed,
        size: (args.width, args.height),
        people: args.people as usize,
        overhead: args.overhead,
    }
}

/// What makes the picture of a frame, stills or those of a clip that is directed here, and tells `bar` of each.
///
/// # Errors
/// When the user stops it while people are directed.
fn shooting<'a>(
    args: &SynthArgs,
    bar: &'a ProgressBar,
    is_stopped: &Stopped<'_>,
) -> anyhow::Result<impl Fn(u64) -> Shot + Sync + use<'a>> {
    let stills = stills(args);
    let (frames, fps) = (args.frames, args.fps as f32);
    let directed = || {
        Reel::until(
            stills.seed,
            stills.size,
            stills.people,
            frames,
            fps,
            is_stopped,
        )
    };
    let reel = (!args.stills).then(directed);
    if reel.as_ref().is_some_and(|reel| reel.len() < frames) {
        return Err(Failure::stopped(0).into());
    }
    Ok(move |k: u64| {
        let shot = match &reel {
            Some(reel) => reel.shot(k),
            None => shoot_still(&stills, k),
        };
        bar.inc(1);
        shot
    })
}

/// Begins the truth about stills or a clip, a file of at most as many bytes as programs read.
fn truth<W: Write>(args: &SynthArgs, clip: Option<&Path>, out: W) -> io::Result<FrameWriter<W>> {
    let about = Truth {
        format: FORMAT.to_owned(),
        version: VERSION,
        seed: args.seed,
        width: args.width,
        height: args.height,
        fps: if args.stills { 0.0 } else { args.fps as f32 },
        clip: clip.map(name),
        frames: Vec::new(),
    };
    FrameWriter::new(out, &about.head(), DATA)
}

/// Writes numbered pictures and the truth into a folder that appears only when it is complete.
fn album(
    args: &SynthArgs,
    out: &Path,
    bar: &ProgressBar,
    is_stopped: &Stopped<'_>,
) -> anyhow::Result<()> {
    let shot = shooting(args, bar, is_stopped)?;
    let name = |k: u64| match args.format {
        PictureFormat::Jpg => format!("{k:06}.jpg"),
        PictureFormat::Png => format!("{k:06}.png"),
    };
    let one = |k: u64, folder: &Path| -> anyhow::Result<TruthFrame> {
        let mut shot = shot(k);
        let bytes = match args.format {
            PictureFormat::Jpg => jpeg(&shot.frame, args.quality.unwrap_or(shot.quality))?,
            PictureFormat::Png => png(&shot.frame)?,
        };
        let path = folder.join(name(k));
        std::fs::write(&path, bytes).map_err(|e| Failure::output(&path, &e))?;
        shot.truth.file = Some(name(k));
        Ok(shot.truth)
    };
    known(args, out, one, Some(&name), is_stopped)
}

/// Writes the truth about stills that nobody renders.
fn outlines(args: &SynthArgs, out: &Path, is_stopped: &Stopped<'_>) -> anyhow::Result<()> {
    let stills = stills(args);
    let one = |k: u64, _: &Path| Ok(outline_still(&stills, k));
    known(args, out, one, None, is_stopped)
}

/// Makes frames with `one`, which may put a picture of the name `picture(k)` into the folder, and writes the truth
/// about them; pictures of which it does not tell are removed.
fn known(
    args: &SynthArgs,
    out: &Path,
    one: impl Fn(u64, &Path) -> anyhow::Result<TruthFrame> + Sync,
    picture: Option<&dyn Fn(u64) -> String>,
    is_stopped: &Stopped<'_>,
) -> anyhow::Result<()> {
    let album = AtomicFolder::create(out).map_err(|e| Failure::output(out, &e))?;
    let folder = album.beside();
    let path = folder.join("truth.json");
    let failed = |_: Part, e: io::Error| Failure::output(&path, &e);
    let no_truth = |e: io::Error| failed(Part::Truth, e);
    let text = BufWriter::new(File::create(&path).map_err(no_truth)?);
    let mut text = truth(args, None, text).map_err(no_truth)?;
    let no_film = None::<&mut AviWriter<File>>;
    let each = |k: u64| Ok((Vec::new(), one(k, folder)?));
    let taken = |_: &TruthFrame| Ok(());
    let room = render(
        args.frames,
        no_film,
        &mut text,
        each,
        taken,
        is_stopped,
        failed,
    )?;
    text.finish().map_err(no_truth)?;
    for name in picture.iter().flat_map(|name| room.beyond().map(name)) {
        remove(&folder.join(name))?;
    }
    album.finish().map_err(|e| Failure::output(out, &e))?;
    let truth = out.join("truth.json");
    room.ended(out, &truth)
}

/// Removes a picture, if it was made.
fn remove(picture: &Path) -> anyhow::Result<()> {
    match std::fs::remove_file(picture) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(Failure::output(picture, &e).into()),
        _ => Ok(()),
    }
}

fn name(clip: &Path) -> String {
    let name = clip.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// Refuses to replace the truth about something else than `clip`.
fn expect_own(truth: &Path, clip: &Path) -> anyhow::Result<()> {
    if !truth.exists() {
        return Ok(());
    }
    let known = Truth::load(truth).ok();
    // Stills have no rate, and pictures of a folder have files of their own.
    let is_of_a_clip = |t: &Truth| t.fps > 0.0 && t.frames.iter().all(|f| f.file.is_none());
    let is_own = known.as_ref().is_some_and(|t| match &t.clip {
        Some(of) => *of == name(clip),
        // It may be of the clip that is there.
        None => clip.exists() && is_of_a_clip(t),
    });
    if is_own {
        return Ok(());
    }
    let of = known.and_then(|t| t.clip);
    let of = of.unwrap_or_else(|| "something else".to_owned());
    Err(Failure::exists(format!(
        "{}: expected a place for the truth about {}, found that about {of}; choose another folder, or --out",
        truth.display(),
        name(clip)
    ))
    .into())
}

/// Writes a clip and its truth, both as far as one file has room.
fn film(
    args: &SynthArgs,
    file: &Path,
    bar: &ProgressBar,
    is_stopped: &Stopped<'_>,
) -> anyhow::Result<()> {
    let no_file = |found: &str| {
        let of = match is_stdout(file) {
            true => "--clip".to_owned(),
            false => file.display().to_string(),
        };
        Failure::usage(format!(
            "{of}: expected a file that ends in .avi, as parts of a film are written again at its end, found {found}"
        ))
    };
    if is_stdout(file) {
        return Err(no_file("standard output").into());
    }
    let truth_path = match &args.out {
        Some(folder) => folder.join("truth.json"),
        None => file.with_extension("truth.json"),
    };
    Apart::default()
        .writes("--clip", file)
        .writes("its truth", &truth_path)
        .check()?;
    if file
        .extension()
        .is_some_and(|e| !e.eq_ignore_ascii_case("avi"))
    {
        return Err(SinkError::Kind {
            path: file.to_owned(),
            expected: "a film that ends in .avi",
        }
        .into());
    }
    expect_own(&truth_path, file)?;
    let no_clip = |e: io::Error| Failure::output(file, &e);
    let no_truth = |e: io::Error| Failure::output(&truth_path, &e);
    let mut clip = AtomicFile::create(file).map_err(no_clip)?;
    if !clip.can_seek() {
        return Err(no_file("a device or a pipe").into());
    }
    let mut text = AtomicFile::create(&truth_path).map_err(no_truth)?;
    let shot = shooting(args, bar, is_stopped)?;
    let mut about = truth(args, Some(file), &mut text).map_err(no_truth)?;
    let mut avi =
        AviWriter::new(&mut clip, args.width, args.height, (args.fps, 1)).map_err(no_clip)?;
    let one = |k: u64| {
        let shot = shot(k);
        Ok((jpeg(&shot.frame, args.quality.unwrap_or(60))?, shot.truth))
    };
    let failed = |part: Part, e: io::Error| match part {
        Part::Film => no_clip(e),
        Part::Truth => no_truth(e),
    };
    let film = Some(&mut avi);
    let taken = |_: &TruthFrame| Ok(());
    let room = render(
        args.frames,
        film,
        &mut about,
        one,
        taken,
        is_stopped,
        failed,
    )?;
    avi.finish().map_err(no_clip)?;
    about.finish().map_err(no_truth)?;
    end(
        clip.finish().map_err(no_clip),
        text.finish().map_err(no_truth),
    )?;
    room.ended(file, &truth_path)
}

/// How a clip and its truth end, of which neither goes for want of the other's name.
///
/// # Errors
/// The first's; the other's is said where both have one.
fn end(clip: Result<(), Failure>, truth: Result<(), Failure>) -> Result<(), Failure> {
    if let (Err(_), Err(e)) = (&clip, &truth) {
        say::err(&e.to_string());
    }
    clip.and(truth)
}

fn jpeg(frame: &Frame, quality: u8) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality).encode(
        &frame.rgb,
        frame.width,
        frame.height,
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}

fn png(frame: &Frame) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes).write_image(
        &frame.rgb,
        frame.width,
        frame.height,
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;
    use crate::commands::exit;

    /// Few small pictures.
    fn args(out: Option<PathBuf>, clip: Option<PathBuf>) -> SynthArgs {
        SynthArgs {
            out,
            clip,
            frames: 2,
            people: 1,
            seed: 9,
            width: 32,
            height: 32,
            fps: 10,
            stills: false,
            overhead: 0.0,
            views: None,
            masks: false,
            observed: false,
            truth_only: false,
            quality: None,
            format: PictureFormat::Jpg,
            threads: ThreadsArgs::default(),
        }
    }

    #[test]
    fn pictures_and_truth_are_kept_when_it_is_stopped_and_views_are_not() {
        // Batches are as long as on two cores.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2);
        let pool = pool.build().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let frames = 200;
        let stopped = |out: &str, after: u64, how: fn(SynthArgs) -> SynthArgs| {
            let out = folder.path().join(out);
            let args = how(SynthArgs {
                frames,
                stills: true,
                ..args(Some(out.clone()), None)
            });
            let asked = AtomicU64::new(0);
            let is_stopped = || asked.fetch_add(1, Ordering::Relaxed) >= after;
            let said = pool.install(|| write(&args, &is_stopped)).unwrap_err();
            assert_eq!(exit::code(&said), exit::INTERRUPTED);
            (out, exit::told(&said))
        };
        let count = |out: &Path| std::fs::read_dir(out).unwrap().count();
        let batch = 32;
        let (out, said) = stopped("stills", batch, |args| args);
        assert!(said.contains("stopped after 32 frames"), "{said}");
        assert_eq!(count(&out), 33);
        let known = Truth::load(&out.join("truth.json")).unwrap().frames;
        let files = known.iter().filter_map(|f| f.file.as_ref());
        assert_eq!(files.filter(|name| out.join(name).exists()).count(), 32);
        // It is asked once a frame that is directed, and then once a frame of each view.
        let (out, said) = stopped("views", frames + batch, |args| SynthArgs {
            stills: false,
            views: Some(2),
            truth_only: true,
            ..args
        });
        assert!(said.contains("nothing was written"), "{said}");
        assert!(!out.exists());
        assert_eq!(count(folder.path()), 1, "nothing unfinished is left");
    }

    #[test]
    fn it_is_stopped_while_people_are_directed_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| Some(folder.path().join(name));
        for (clip, views) in [(at("a.avi"), None), (None, None), (None, Some(2))] {
            let args = SynthArgs {
                frames: 200,
                views,
                ..args(clip.is_none().then(|| at("out")).flatten(), clip)
            };
            let asked = AtomicU64::new(0);
            let is_stopped = || asked.fetch_add(1, Ordering::Relaxed) >= 8;
            let said = write(&args, &is_stopped).unwrap_err();
            assert_eq!(exit::code(&said), exit::INTERRUPTED);
            assert!(exit::told(&said).contains("nothing was written"), "{said}");
            assert_eq!(asked.load(Ordering::Relaxed), 9);
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        }
    }

    #[test]
    fn a_clip_goes_into_a_file_alone() {
        let folder = tempfile::tempdir().unwrap();
        for (place, found) in [("-", "standard output"), ("/dev/null", "a device")] {
            let args = args(Some(folder.path().to_owned()), Some(place.into()));
            let said = write(&args, &|| false).unwrap_err();
            assert_eq!(exit::code(&said), exit::USAGE);
            assert!(exit::told(&said).contains(found), "{said}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_clip_that_cannot_have_its_name_has_its_truth() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let args = args(None, Some(at("a.avi")));
        // A folder comes into the clip's place while it is made.
        let is_stopped = || {
            let _ = std::fs::create_dir(at("a.avi"));
            false
        };
        let said = write(&args, &is_stopped).unwrap_err();
        assert_eq!(exit::code(&said), exit::CANNOT_CREATE);
        assert!(exit::told(&said).ends_with("a-new.avi"), "{said}");
        assert!(at("a-new.avi").is_file() && at("a.truth.json").is_file());
    }
}
