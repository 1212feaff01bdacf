//! A picture file goes in, the network's input comes out.

use std::path::Path;

use anyhow::{Context, Result};
use image::imageops::{self, FilterType};
use image::{ImageDecoder, Rgb, RgbImage};

/// Reads a picture upright and fits it into `width` × `height`, centred, its sides kept in proportion, the rest mid-grey (which
/// the network sees as 0). Row-major `[height, width, 3]`.
pub(super) fn letterboxed(path: &Path, width: usize, height: usize) -> Result<Vec<u8>> {
    let picture = upright(path)?;
    let (w, h) = (picture.width() as f32, picture.height() as f32);
    let scale = (width as f32 / w).min(height as f32 / h);
    Ok(placed(&picture, scale, width, height))
}

/// As [`letterboxed`], but scaled to cover `width` × `height` and cropped round the centre: no margins.
pub(super) fn covering(path: &Path, width: usize, height: usize) -> Result<Vec<u8>> {
    let picture = upright(path)?;
    let (w, h) = (picture.width() as f32, picture.height() as f32);
    let scale = (width as f32 / w).max(height as f32 / h);
    Ok(placed(&picture, scale, width, height))
}

fn upright(path: &Path) -> Result<RgbImage> {
    let read = || -> Result<RgbImage, image::ImageError> {
        let mut decoder = image::ImageReader::open(path)?
            .with_guessed_format()?
            .into_decoder()?;
        let orientation = decoder.orientation()?;
        let mut picture = image::DynamicImage::from_decoder(decoder)?;
        picture.apply_orientation(orientation);
        Ok(picture.to_rgb8())
    };
    read().with_context(|| {
        format!(
            "cannot read {}: expected a JPEG or PNG picture",
            path.display()
        )
    })
}

/// The picture, scaled, its centre on that of a grey `width` × `height`.
fn placed(picture: &RgbImage, scale: f32, width: usize, height: usize) -> Vec<u8> {
    let side = |n: u32| ((n as f32 * scale).round() as u32).max(1);
    let (w, h) = (side(picture.width()), side(picture.height()));
    let small = imageops::resize(picture, w, h, FilterType::Triangle);
    let mut canvas = RgbImage::from_pixel(width as u32, height as u32, Rgb([128; 3]));
    let left = (width as i64 - i64::from(w)) / 2;
    let top = (height as i64 - i64::from(h)) / 2;
    imageops::replace(&mut canvas, &small, left, top);
    canvas.into_raw()
}
