//! A picture file goes in, the network's input comes out.

use std::path::Path;

use anyhow::{Context, Result, anyhow};

use crate::capture::{Frame, PhotoDecoder, Resizer};

/// Reads a picture upright and fits it into `width` × `height` as every input of the program is. Row-major
/// `[height, width, 3]`.
pub(super) fn letterboxed(path: &Path, width: usize, height: usize) -> Result<Vec<u8>> {
    Ok(fitted(&upright(path)?, width, height))
}

/// As [`letterboxed`], but cropped round the centre to the proportions of `width` × `height` first: no margins.
pub(super) fn covering(path: &Path, width: usize, height: usize) -> Result<Vec<u8>> {
    let picture = upright(path)?;
    let (w, h) = (picture.width as usize, picture.height as usize);
    let (to_w, to_h) = (
        w.min((h * width / height).max(1)),
        h.min((w * height / width).max(1)),
    );
    let (left, top) = ((w - to_w) / 2, (h - to_h) / 2);
    let rows = picture.rgb.chunks_exact(3 * w).skip(top).take(to_h);
    let cropped = Frame {
        width: to_w as u32,
        height: to_h as u32,
        rgb: rows
            .flat_map(|row| &row[3 * left..3 * (left + to_w)])
            .copied()
            .collect(),
        ..picture
    };
    Ok(fitted(&cropped, width, height))
}

fn upright(path: &Path) -> Result<Frame> {
    let name = || path.display().to_string();
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", name()))?;
    let mut frame = Frame::default();
    PhotoDecoder::default()
        .decode(&bytes, &mut frame)
        .map_err(|e| anyhow!("{}: {e}", name()))?;
    Ok(frame)
}

fn fitted(frame: &Frame, width: usize, height: usize) -> Vec<u8> {
    let mut resizer = Resizer::new(width as u32, height as u32);
    let mut input = vec![0; resizer.output_bytes()];
    resizer.run(frame, &mut input);
    input
}
