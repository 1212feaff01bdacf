//! Shows what an input gives: one line per picture, and every change of a camera's state.
//!
//! `cargo run --example camera_probe -- INPUT [PICTURES]`: INPUT as after `edgecap --input`; ends after that many
//! pictures, or after 60 s without one.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use edgecap::camera::monotonic_ns;
use edgecap::capture::{CaptureError, Frame, InputSpec, OpenOptions, list_cameras, open};

/// Longest wait for a picture.
const PATIENCE: Duration = Duration::from_secs(60);

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let input = arguments.next().unwrap_or_else(|| "camera".into());
    let wanted = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(30);
    match list_cameras() {
        Ok(cameras) => cameras.iter().for_each(|camera| println!("{camera:?}")),
        Err(e) => println!("{e}"),
    }
    match probe(&input, wanted) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::from(e.exit_code())
        }
    }
}

fn probe(input: &str, wanted: u64) -> Result<(), CaptureError> {
    let Ok(spec) = input.parse::<InputSpec>();
    let mut source = open(&spec, &OpenOptions::default())?;
    println!(
        "{}: fps {:?}, pictures {:?}",
        source.name(),
        source.fps(),
        source.frame_count()
    );
    let mut frame = Frame::default();
    let (mut pictures, mut waiting) = (0, String::new());
    let mut last = Instant::now();
    while pictures < wanted && last.elapsed() < PATIENCE {
        match source.next_into(&mut frame) {
            Ok(true) => {
                let age = monotonic_ns().saturating_sub(frame.time_ns) as f64 / 1e6;
                let mean =
                    frame.rgb.iter().map(|v| f64::from(*v)).sum::<f64>() / frame.rgb.len() as f64;
                println!(
                    "picture {}: {}x{}, {:.1} ms after the last, age {age:.1} ms, mean {mean:.1}",
                    frame.sequence,
                    frame.width,
                    frame.height,
                    last.elapsed().as_secs_f64() * 1e3,
                );
                pictures += 1;
                waiting.clear();
                last = Instant::now();
            }
            Ok(false) => break,
            Err(e) if e.is_skippable() => {
                if e.to_string() != waiting {
                    waiting = e.to_string();
                    println!("waiting: {waiting}");
                }
            }
            Err(e) => return Err(e),
        }
    }
    println!("{pictures} pictures");
    Ok(())
}
