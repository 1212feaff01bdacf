//! A picture file goes in, the network's input comes out, row-major `[height, width, 3]`.

use std::path::Path;

use crate::capture::{CaptureError, Frame, PhotoSource, Resizer, Source};

/// Reads a picture, as one of an input is read, and turns it upright.
///
/// # Errors
/// If it cannot be read, is none, or has more bytes than a photo can have.
pub(super) fn upright(path: &Path) -> Result<Frame, CaptureError> {
    let mut frame = Frame::default();
    PhotoSource::file(path, None).next_into(&mut frame)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// With the same words and exit codes, and no file without an end.
    #[test]
    fn pictures_are_read_as_those_of_an_input() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        std::fs::write(&path, b"\xFF\xD8\xFFno picture").unwrap();
        let spec = path.to_str().unwrap().parse().unwrap();
        let mut input = crate::capture::open(&spec, &Default::default()).unwrap();
        let as_input = input.next_into(&mut Frame::default()).unwrap_err();
        let alone = upright(&path).unwrap_err();
        assert_eq!(alone.to_string(), as_input.to_string());
        assert_eq!(alone.exit_code(), as_input.exit_code());
    }
}
