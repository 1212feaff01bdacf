//! A picture file goes in, the network's input comes out, row-major `[height, width, 3]`.

use std::path::Path;

use anyhow::{Context, Result};

use super::exit::Failure;
use crate::capture::{Frame, PhotoDecoder, Resizer};

/// Reads a picture and turns it upright.
pub(super) fn upright(path: &Path) -> Result<Frame> {
    let name = || path.display().to_string();
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", name()))?;
    let mut frame = Frame::default();
    PhotoDecoder::default()
        .decode(&bytes, &mut frame)
        .map_err(|e| Failure::data(format!("{}: {e}", name())))?;
    Ok(frame)
}

/// Fits a picture into `width` × `height` as every input of the program is.
pub(super) fn letterboxed(picture: &Frame, (width, height): (usize, usize)) -> Vec<u8> {
    let mut resizer = Resizer::new(width as u32, height as u32);
    let mut input = vec![0; resizer.output_bytes()];
    resizer.run(picture, &mut input);
    input
}

/// As [`letterboxed`], but cropped round the centre to the proportions of `width` × `height` first: no margins.
pub(super) fn covering(picture: &Frame, (width, height): (usize, usize)) -> Vec<u8> {
    let (w, h) = (picture.width as usize, picture.height as usize);
    let to_w = w.min((h * width / height).max(1));
    let to_h = h.min((w * height / width).max(1));
    let (left, top) = ((w - to_w) / 2, (h - to_h) / 2);
    let rows = picture.rgb.chunks_exact(3 * w).skip(top).take(to_h);
    let columns = 3 * left..3 * (left + to_w);
    let cropped = Frame {
        width: to_w as u32,
        height: to_h as u32,
        rgb: rows
            .flat_map(|row| &row[columns.clone()])
            .copied()
            .collect(),
        ..Frame::default()
    };
    letterboxed(&cropped, (width, height))
}
