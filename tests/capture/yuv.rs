//! Colours: the conversion of every layout against the definition.

use edgecap::capture::{Matrix, Range, YuvToRgb};

/// The definition in ITU-R BT.601 and BT.709.
fn exact(y: u8, u: u8, v: u8, matrix: Matrix, range: Range) -> [f64; 3] {
    let (kr, kb) = match matrix {
        Matrix::Bt601 => (0.299, 0.114),
        Matrix::Bt709 => (0.2126, 0.0722),
    };
    let (y, u, v) = (f64::from(y), f64::from(u) - 128.0, f64::from(v) - 128.0);
    let (y, u, v) = match range {
        Range::Full => (y, u, v),
        Range::Limited => (
            (y - 16.0) * 255.0 / 219.0,
            u * 255.0 / 224.0,
            v * 255.0 / 224.0,
        ),
    };
    let r = y + 2.0 * (1.0 - kr) * v;
    let b = y + 2.0 * (1.0 - kb) * u;
    let g = (y - kr * r - kb * b) / (1.0 - kr - kb);
    [r, g, b].map(|c| c.clamp(0.0, 255.0))
}

#[test]
fn colours_are_within_one_of_the_definition() {
    for matrix in [Matrix::Bt601, Matrix::Bt709] {
        for range in [Range::Limited, Range::Full] {
            let convert = YuvToRgb::new(matrix, range);
            for u in (0..=255).step_by(5) {
                for v in (0..=255).step_by(5) {
                    let luma: Vec<u8> = (0..=255).collect();
                    let mut rgb = vec![0; 3 * 256];
                    convert.planar(
                        [&luma, &[u; 256], &[v; 256]],
                        [256; 2],
                        (0, 0),
                        256,
                        &mut rgb,
                    );
                    for (y, got) in luma.iter().zip(rgb.chunks_exact(3)) {
                        for (a, b) in got.iter().zip(exact(*y, u, v, matrix, range)) {
                            assert!((f64::from(*a) - b).abs() <= 1.0, "{y} {u} {v}: {a} {b}");
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn layouts_agree_on_the_same_picture() {
    // Narrow, one block, several blocks with a rest, odd and even.
    for (w, h) in [(1, 1), (7, 5), (64, 2), (131, 3), (192, 2)] {
        layouts_agree(w, h);
    }
}

fn layouts_agree(w: usize, h: usize) {
    // Chroma constant over 2 × 2 blocks, so that all subsamplings hold the same picture; odd sizes have half blocks.
    let y = |i: usize, j: usize| (16 + 29 * i + 13 * j) as u8;
    let u = |i: usize, j: usize| (60 + 40 * (i / 2) + 3 * (j / 2)) as u8;
    let v = |i: usize, j: usize| 200usize.wrapping_sub(30 * (i / 2) + 20 * (j / 2)) as u8;
    let plane = |f: &dyn Fn(usize, usize) -> u8, step: usize, step_y: usize| -> Vec<u8> {
        (0..h)
            .step_by(step_y)
            .flat_map(|j| (0..w).step_by(step).map(move |i| (i, j)))
            .map(|(i, j)| f(i, j))
            .collect()
    };
    let convert = YuvToRgb::new(Matrix::Bt601, Range::Limited);
    let luma = plane(&y, 1, 1);
    let planar = |step: usize, step_y: usize, shift| {
        let mut rgb = vec![0; 3 * w * h];
        convert.planar(
            [&luma, &plane(&u, step, step_y), &plane(&v, step, step_y)],
            [w, w.div_ceil(step)],
            shift,
            w,
            &mut rgb,
        );
        rgb
    };
    let expected = planar(1, 1, (0, 0));
    assert_eq!(planar(2, 2, (1, 1)), expected);
    assert_eq!(planar(2, 1, (1, 0)), expected);

    let stride = 2 * w.div_ceil(2) + 2;
    let padded: Vec<u8> = luma
        .chunks(w)
        .flat_map(|row| {
            let mut row = row.to_vec();
            row.resize(stride, 0);
            row
        })
        .collect();
    let (us, vs) = (plane(&u, 2, 2), plane(&v, 2, 2));
    let pairs: Vec<u8> = us
        .chunks(w.div_ceil(2))
        .zip(vs.chunks(w.div_ceil(2)))
        .flat_map(|(us, vs)| {
            let mut row: Vec<u8> = us.iter().zip(vs).flat_map(|(u, v)| [*u, *v]).collect();
            row.resize(stride, 0);
            row
        })
        .collect();
    let mut rgb = vec![0; 3 * w * h];
    convert.nv12(&padded, &pairs, stride, w, &mut rgb);
    assert_eq!(rgb, expected);

    let mut yuyv = Vec::new();
    for j in 0..h {
        for i in (0..w).step_by(2) {
            let second = if i + 1 < w { y(i + 1, j) } else { 0 };
            yuyv.extend_from_slice(&[y(i, j), u(i, j), second, v(i, j)]);
        }
        yuyv.extend_from_slice(&[9; 4]);
    }
    let mut rgb = vec![0; 3 * w * h];
    convert.yuyv(&yuyv, 4 * w.div_ceil(2) + 4, w, &mut rgb);
    assert_eq!(rgb, expected);
}
