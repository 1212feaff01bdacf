//! A tiny network that has everything the shipped ones have, pictures for it, and a reference that computes it naively.

use edgecap::engine::model::FloatConv;
use edgecap::engine::network::{Graph, Network, Op};
use edgecap::engine::{HEAD2D_CHANNELS, Maps};

/// SelecSLS modules with groups and skips, bottlenecks with both kinds of shortcut, pooling, deconvolution,
/// concatenation. Groups read multiples of eight channels, or none of the vector kernels would run them.
pub fn tiny() -> Network {
    let text = r#"
        name = "tiny"
        about = "every kind of layer once"
        input = { channels = 3, multiple = 16 }
        output = { head2d = "head2d.out", head3d = "head3d.out" }
        layers = [
          { kind = "conv", name = "stem", out = 8, kernel = 7, stride = 2 },
          { kind = "maxpool", name = "pool", kernel = 3, stride = 2 },
          { kind = "bottlenecks", name = "res", width = 8, out = 32, blocks = 2, stride = 1 },
          { kind = "selecsls", name = "features", groups = [[10, 2], [20, 4]], modules = [
            [32, 0, 32, 32, 2],
            [32, 32, 32, 32, 1],
            [32, 32, 32, 40, 1],
          ] },
          { kind = "bottlenecks", name = "deep", width = 8, out = 32, blocks = 1, stride = 2 },
          { kind = "deconv", name = "up", out = 16, kernel = 4, stride = 2, groups = 4 },
          { kind = "conv", name = "head2d.conv1", out = 20, kernel = 3 },
          { kind = "conv", name = "head2d.out", out = 40, kernel = 3, norm = false, relu = false },
          { kind = "conv", name = "head3d.conv1", from = ["up"], out = 12, kernel = 3 },
          { kind = "conv", name = "head3d.conv2", from = ["head3d.conv1", "head2d.conv1"], out = 16, kernel = 1 },
          { kind = "conv", name = "head3d.out", out = 63, kernel = 3, norm = false, relu = false },
        ]
    "#;
    Network::parse(text).unwrap()
}

/// A network of which two layers join the first one with others, or with a copy of it: the last reads `first` in its
/// place. Whether it ends in ReLU is `relu`.
pub fn joined_twice(first: &str, relu: bool) -> Network {
    let text = format!(
        r#"
        name = "joined"
        about = "a layer beside one and beside another"
        input = {{ channels = 3, multiple = 16 }}
        output = {{ head2d = "d", head3d = "e" }}
        layers = [
          {{ kind = "conv", name = "a", out = 8, kernel = 3, stride = 8, relu = {relu} }},
          {{ kind = "conv", name = "b", from = ["input"], out = 8, kernel = 3, stride = 8 }},
          {{ kind = "conv", name = "c", from = ["input"], out = 8, kernel = 5, stride = 8 }},
          {{ kind = "maxpool", name = "a.copy", from = ["a"], kernel = 1, stride = 1 }},
          {{ kind = "conv", name = "d", from = ["a", "b"], out = 40, kernel = 3, norm = false, relu = false }},
          {{ kind = "conv", name = "e", from = ["{first}", "c"], out = 63, kernel = 1, norm = false, relu = false }},
        ]
    "#
    );
    Network::parse(&text).unwrap()
}

/// A picture of smooth shapes and some noise.
pub fn picture((width, height): (usize, usize), seed: u64) -> Vec<u8> {
    let mut state = seed.wrapping_mul(2).wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut pixels = Vec::new();
    for i in 0..3 * width * height {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        let (x, y, c) = (i / 3 % width, i / 3 / width, i % 3);
        let wave = ((x + 7 * c) as f32 / 9.0 + seed as f32).sin() * (y as f32 / 6.0).cos();
        pixels.push((128.0 + 90.0 * wave + (state >> 59) as f32) as u8);
    }
    pixels
}

/// One value, `[channels][height][width]`.
struct Planes(Vec<Vec<Vec<f32>>>);

impl Planes {
    fn size(&self) -> (usize, usize) {
        (self.0[0].len(), self.0[0][0].len())
    }

    /// 0 outside.
    fn at(&self, c: usize, y: isize, x: isize) -> f32 {
        let row = usize::try_from(y).ok().and_then(|y| self.0[c].get(y));
        let value = row.and_then(|r| usize::try_from(x).ok().and_then(|x| r.get(x)));
        value.copied().unwrap_or(0.0)
    }
}

/// Computes the network by its definition.
pub fn naive(
    graph: &Graph,
    weights: &[Option<FloatConv>],
    rgb: &[u8],
    (width, height): (usize, usize),
) -> Maps {
    let pixel = |c, y, x| f32::from(rgb[(y * width + x) * 3 + c]) / 255.0 - 0.5;
    let mut values: Vec<Option<Planes>> = graph.values.iter().map(|_| None).collect();
    values[0] = Some(planes(3, (height, width), pixel));
    for (node, conv) in graph.nodes.iter().zip(weights) {
        let parts: Vec<&Planes> = node
            .inputs
            .iter()
            .map(|&v| values[v].as_ref().unwrap())
            .collect();
        let input = Planes(parts.iter().flat_map(|p| p.0.clone()).collect());
        let (h, w) = input.size();
        let size = (node.output_len(h), node.output_len(w));
        let out = match &node.op {
            Op::MaxPool { shape } => planes(input.0.len(), size, |c, y, x| {
                let (kernel, stride) = (shape.kernel(), shape.stride());
                let inside = |at: usize, tap: usize, len: usize| {
                    let at = (at * stride + tap).checked_sub(shape.padding());
                    at.filter(|&at| at < len)
                };
                let window = (0..kernel * kernel).filter_map(|t| {
                    let (y, x) = (inside(y, t / kernel, h)?, inside(x, t % kernel, w)?);
                    Some(input.0[c][y][x])
                });
                window.fold(f32::NEG_INFINITY, f32::max)
            }),
            Op::Conv { shape: s, relu, .. } => {
                let conv = conv.as_ref().unwrap();
                let (gi, go) = (s.group_in(), s.group_out());
                let weight = |o: usize, i: usize, ky: usize, kx: usize| {
                    conv.weight[((o * gi + i) * s.kernel() + ky) * s.kernel() + kx]
                };
                planes(s.out_channels(), size, |o, y, x| {
                    let mut sum = conv.bias[o];
                    for i in 0..gi {
                        for ky in 0..s.kernel() {
                            for kx in 0..s.kernel() {
                                let value = |y, x| input.at(o / go * gi + i, y, x);
                                let (p, st) = (s.padding() as isize, s.stride() as isize);
                                let (ay, ax) = (y as isize, x as isize);
                                let (ky_, kx_) = (ky as isize, kx as isize);
                                sum += weight(o, i, ky, kx)
                                    * if s.transposed() {
                                        // Output y gets input iy through ky where y = iy * stride - padding + ky.
                                        let (ny, nx) = (ay + p - ky_, ax + p - kx_);
                                        if ny % st == 0 && nx % st == 0 {
                                            value(ny / st, nx / st)
                                        } else {
                                            0.0
                                        }
                                    } else {
                                        value(ay * st - p + ky_, ax * st - p + kx_)
                                    };
                            }
                        }
                    }
                    if let Some(r) = node.residual {
                        sum += values[r].as_ref().unwrap().0[o][y][x];
                    }
                    if *relu { sum.max(0.0) } else { sum }
                })
            }
        };
        values[node.output] = Some(out);
    }
    let mut maps = Maps::new(width / Maps::STRIDE, height / Maps::STRIDE);
    for (name, v) in &graph.outputs {
        let map = values[*v].as_ref().unwrap();
        let to = if name == "head2d" {
            &mut maps.head2d
        } else {
            &mut maps.head3d
        };
        let channels = map.0.len();
        assert_eq!(name == "head2d", channels == HEAD2D_CHANNELS);
        for (i, to) in to.iter_mut().enumerate() {
            let (pixel, c) = (i / channels, i % channels);
            *to = map.0[c][pixel / maps.width][pixel % maps.width];
        }
    }
    maps
}

fn planes(
    channels: usize,
    (h, w): (usize, usize),
    value: impl Fn(usize, usize, usize) -> f32,
) -> Planes {
    let row = |c, y| (0..w).map(|x| value(c, y, x)).collect();
    let plane = |c| (0..h).map(|y| row(c, y)).collect();
    Planes((0..channels).map(plane).collect())
}
