//! The processor, and how fast it is.

use std::fs;
use std::time::{Duration, Instant};

use super::finding::{Finding, State};
use crate::capture::{self, Frame, demo};
use crate::commands::exit;
use crate::commands::infer::{EngineArgs, Pipelines};
use crate::commands::pipeline::SCALAR_ONLY;
use crate::engine::{Algorithms, Isa};
use crate::machine::Machine;
use crate::schedule::inputs::Quality;
use crate::schedule::spacing::NEAR;

/// Pictures of the bundled clip that speed is measured with.
const FRAMES: u32 = 20;
/// From one of them to the next, as a camera takes them, nanoseconds.
const APART_NS: u64 = 33_333_333;
/// As many as fit into this, at least one.
const MEASURED_FOR: Duration = Duration::from_secs(5);
/// Below this many pictures a second movement looks broken.
const FLUENT: f64 = 12.0;
/// Below this many nothing can be done with it.
const USABLE: f64 = 3.0;

pub const PROCESSOR: &str = "processor";
pub const SPEED: &str = "speed";

/// What it is, and which kernels it has.
pub fn processor() -> Finding {
    let broken = |e: String| Finding::new(PROCESSOR, State::Broken(exit::USAGE), e);
    let isa = match Isa::detect() {
        Ok(isa) => isa,
        Err(e) => return broken(e.to_string()),
    };
    match Algorithms::detect(isa) {
        Ok(algorithms) => processor_with(isa, Isa::available().last(), algorithms),
        Err(e) => broken(e.to_string()),
    }
}

/// Of kernels of `isa` on a CPU whose fastest are those of `fastest`.
fn processor_with(isa: Isa, fastest: Option<Isa>, algorithms: Algorithms) -> Finding {
    let machine = Machine::here(isa);
    let mut text = format!("{}, {} cores, {}", machine.cpu, machine.cores, machine.isa);
    let mut state = State::Fine;
    let driver = fs::read_to_string("/sys/devices/system/cpu/cpu0/cpufreq/scaling_driver");
    if is_slow_governor(machine.governor.as_deref(), driver.ok().as_deref()) {
        text += "; governor 'powersave' may slow it down: 'performance' is steadier";
        state = State::Note;
    }
    if let Some(load) = machine.load.filter(|_| machine.is_disturbed()) {
        text += &format!("; {load:.1} other processes run, which takes speed");
        state = State::Note;
    }
    let fastest = fastest.filter(|fastest| isa < *fastest);
    match (isa, fastest) {
        (Isa::Scalar, _) => {
            text += &format!("; {SCALAR_ONLY}");
            state = State::Warning;
        }
        (_, Some(fastest)) => {
            text += &format!("; EDGECAP_ISA is '{isa}', '{fastest}' is faster here: unset it");
            state = match isa {
                Isa::Sse41 => State::Warning,
                _ => State::Note,
            };
        }
        (Isa::Sse41, None) => {
            text += "; no AVX2, which the network is made for: expected a CPU with it, such as a Core since 2013, a Ryzen or an N100";
            state = State::Warning;
        }
        _ => {}
    }
    if state != State::Warning && algorithms != Algorithms::fastest(isa) {
        let (set, fastest) = (algorithms.name(), Algorithms::fastest(isa).name());
        text += &format!("; EDGECAP_ALGORITHM is '{set}', '{fastest}' is faster here in int8");
        state = State::Note;
    }
    Finding::new(PROCESSOR, state, text)
}

/// Whether the governor keeps the cores at their slowest. Drivers that leave the frequency to the processor call that
/// `powersave`, too.
fn is_slow_governor(governor: Option<&str>, driver: Option<&str>) -> bool {
    let driver = driver.map(str::trim);
    governor == Some("powersave") && !matches!(driver, Some("intel_pstate" | "amd-pstate-epp"))
}

/// The bundled clip through every stage of `infer`, at the size and quality of the settings.
pub fn speed(engine: &EngineArgs) -> Finding {
    let threads = engine.most_threads();
    match measured(engine, threads) {
        Ok((took, _)) => {
            let seconds = took.of_camera(engine.looks_apart());
            judged(seconds, took.people, threads, engine.quality)
        }
        Err(e) => Finding::failed(SPEED, e),
    }
}

/// What pictures of the bundled clip took.
struct Measured {
    /// Seconds a picture, looked at or not.
    picture: f64,
    /// Seconds a picture that was looked at.
    look: f64,
    /// People in a picture.
    people: f64,
}

impl Measured {
    /// Seconds a picture of a camera, with looks `apart` nanoseconds apart where that is asked for: where a look takes
    /// too long for people to be followed to the next one, every picture is looked at.
    fn of_camera(&self, apart: Option<u64>) -> f64 {
        let apart = apart.map_or(0.0, |ns| ns as f64 * 1e-9);
        if self.look < apart.max(NEAR.into()) {
            self.picture
        } else {
            self.look
        }
    }
}

/// Goes through the bundled clip; how many of [`FRAMES`] pictures were looked at.
fn measured(engine: &EngineArgs, threads: usize) -> anyhow::Result<(Measured, u32)> {
    // All of them from the first picture on: with fewer it would be tried first what is faster.
    let threads = u16::try_from(threads).unwrap_or(u16::MAX);
    let engine = EngineArgs {
        threads: Some(threads),
        ..engine.clone()
    };
    let mut pipelines = Pipelines::new(&engine, true, None)?;
    let camera = demo::camera();
    let mut clip = capture::open_bytes("demo", demo::CLIP)?;
    let mut frame = Frame::default();
    let mut next = || -> anyhow::Result<Option<(Duration, usize, bool)>> {
        if !clip.next_into(&mut frame)? {
            return Ok(None);
        }
        frame.time_ns = frame.sequence * APART_NS;
        let lens = camera.for_frame(frame.width, frame.height);
        let lens = lens.map_err(anyhow::Error::msg)?;
        let start = Instant::now();
        pipelines.choose(&frame)?;
        let seen = pipelines.process(&frame, &lens)?;
        let is_looked_at = seen.times.stage1_us > 0;
        Ok(Some((start.elapsed(), seen.people.len(), is_looked_at)))
    };
    // The first picture makes room for all others.
    next()?;
    let (mut pictures, mut people, mut looks) = (0u32, 0, 0);
    let (mut took, mut looking) = (Duration::ZERO, Duration::ZERO);
    while pictures < FRAMES
        && took < MEASURED_FOR
        && let Some((time, seen, is_looked_at)) = next()?
    {
        took += time;
        people += seen;
        if is_looked_at {
            looking += time;
            looks += 1;
        }
        pictures += 1;
    }
    let each = |sum: f64| sum / f64::from(pictures);
    let took = Measured {
        picture: each(took.as_secs_f64()),
        look: looking.as_secs_f64() / f64::from(looks.max(1)),
        people: each(people as f64),
    };
    Ok((took, looks))
}

fn judged(seconds: f64, people: f64, threads: usize, quality: Option<Quality>) -> Finding {
    let rate = 1.0 / seconds;
    let mut text = format!(
        "{:.0} ms a picture of {people:.1} people on {threads} of the cores: up to {rate:.*} a second",
        1e3 * seconds,
        usize::from(rate < 10.0)
    );
    let state = match rate {
        r if r >= FLUENT => State::Fine,
        r if r >= USABLE => State::Note,
        _ => State::Warning,
    };
    if state != State::Fine && quality != Some(Quality::Fast) {
        text += "; --quality fast takes less, for people who stand near";
    }
    Finding::new(SPEED, state, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_processor_without_fast_kernels_is_told_loudly() {
        let with = |isa| processor_with(isa, Some(isa), Algorithms::fastest(isa));
        let scalar = with(Isa::Scalar);
        assert!(scalar.text.contains("only scalar kernels are left"));
        assert!(scalar.to_string().starts_with("WARNING processor"));
        assert_eq!(with(Isa::Sse41).state, State::Warning);
        for isa in Isa::available().filter(|isa| *isa > Isa::Sse41) {
            assert_ne!(with(isa).state, State::Warning);
        }
    }

    #[test]
    fn slower_kernels_than_the_processor_has_are_the_variables_doing() {
        let forced = |isa, fastest| {
            let found = processor_with(isa, Some(fastest), Algorithms::fastest(isa));
            (found.state, found.text)
        };
        let (state, text) = forced(Isa::Sse41, Isa::Avx512Vnni);
        assert_eq!(state, State::Warning);
        assert!(
            text.contains("EDGECAP_ISA is 'sse41', 'avx512vnni' is faster"),
            "{text}"
        );
        assert!(!text.contains("no AVX2"), "{text}");
        let (state, text) = forced(Isa::Avx2, Isa::AvxVnni);
        assert_eq!(state, State::Note);
        assert!(text.contains("EDGECAP_ISA is 'avx2'"), "{text}");
        let (_, text) = forced(Isa::Sse41, Isa::Sse41);
        assert!(
            text.contains("no AVX2") && !text.contains("EDGECAP_ISA"),
            "{text}"
        );
    }

    /// `intel_cpufreq` and `amd-pstate` are the same drivers where the kernel chooses.
    #[test]
    fn a_governor_is_slow_with_the_drivers_that_take_it_at_its_word() {
        let powersave = |driver| is_slow_governor(Some("powersave"), driver);
        for driver in [
            "acpi-cpufreq\n",
            "intel_cpufreq\n",
            "amd-pstate\n",
            "cpufreq-dt\n",
        ] {
            assert!(powersave(Some(driver)), "{driver}");
            assert!(
                !is_slow_governor(Some("schedutil"), Some(driver)),
                "{driver}"
            );
        }
        assert!(powersave(None));
        assert!(!powersave(Some("intel_pstate\n")) && !powersave(Some("amd-pstate-epp\n")));
        assert!(!is_slow_governor(None, None));
    }

    #[test]
    fn slower_algorithms_are_told() {
        let told = |isa, algorithms| {
            let text = processor_with(isa, Some(isa), algorithms).text;
            text.contains("is faster here in int8")
        };
        assert!(told(Isa::Amx, Algorithms::Portable));
        assert!(told(Isa::Avx2, Algorithms::Direct));
        assert!(!told(Isa::Amx, Algorithms::Direct));
        assert!(!told(Isa::Avx2, Algorithms::Portable));
    }

    #[test]
    fn what_the_settings_say_of_the_network_is_measured() {
        let engine = EngineArgs {
            size: Some("64x64".parse().unwrap()),
            ..EngineArgs::default()
        };
        let found = speed(&engine).text;
        // An input as small as that shows nobody of the clip.
        assert!(found.contains("ms a picture of 0.0 people"), "{found}");
    }

    #[test]
    fn pictures_between_looks_are_measured_as_such() {
        let engine = EngineArgs {
            size: Some("128x80".parse().unwrap()),
            looks: Some(10.0),
            ..EngineArgs::default()
        };
        let (_, looks) = measured(&engine, 1).unwrap();
        assert!((1..FRAMES).contains(&looks), "{looks}");
    }

    #[test]
    fn where_nobody_can_be_followed_every_picture_of_a_camera_is_a_look() {
        let seconds = |look, apart: Option<f64>| {
            let took = Measured {
                picture: 0.06,
                look,
                people: 1.0,
            };
            took.of_camera(apart.map(|s| (s * 1e9) as u64))
        };
        assert_eq!(seconds(0.095, Some(0.067)), 0.06);
        assert_eq!(seconds(0.11, Some(0.067)), 0.11);
        assert_eq!(seconds(0.15, Some(0.067)), 0.15);
        assert_eq!(seconds(0.15, Some(0.5)), 0.06);
        assert_eq!(seconds(0.15, None), 0.15);
    }

    #[test]
    fn speed_is_judged_by_pictures_a_second() {
        let states = [0.04, 0.2, 1.5].map(|s| judged(s, 1.0, 2, None).state);
        assert_eq!(states, [State::Fine, State::Note, State::Warning]);
    }

    #[test]
    fn who_has_the_fast_quality_is_not_told_of_it() {
        let told = |quality| judged(0.2, 1.0, 2, quality).text.contains("fast");
        assert!(told(None) && told(Some(Quality::Balanced)));
        assert!(!told(Some(Quality::Fast)));
    }
}
