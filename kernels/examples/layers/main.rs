//! Times every kind of layer of SelecSLS at 512×320, one thread: a table of GMAC/s and share of the measured peak.
//!
//! `cargo run --release -p edgecap-kernels --example layers [int8|f32] [rounds]`; `EDGECAP_ISA` chooses the tier.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

mod network;

use edgecap_kernels::{
    Algorithm, ConvShape, Epilogue, FConv, FConvParams, Isa, Layout, Part, Peak, QConv,
    QConvParams, Scratch,
};
use network::{table, weights};

struct Layer {
    label: String,
    times: usize,
    macs: u64,
    run: Box<dyn FnMut()>,
    seconds: Vec<f64>,
}

/// Buffers that layers share as they do in a network: what one wrote last is warm for the next.
struct Pool<T> {
    /// Input and output change places from layer to layer.
    buffers: [Vec<T>; 2],
    scratch: Scratch,
}

impl<T: Copy + From<u8>> Pool<T> {
    fn new() -> Rc<RefCell<Self>> {
        let buffer: Vec<T> = (0..6 << 20)
            .map(|i| T::from((i * 37 % 101) as u8))
            .collect();
        Rc::new(RefCell::new(Self {
            buffers: [buffer.clone(), buffer],
            scratch: Scratch::new(8 << 20),
        }))
    }
}

/// From a buffer's first cache line on: the engine's tensors begin with one.
fn aligned<T>(buffer: &mut [T]) -> &mut [T] {
    let first = buffer.as_ptr().align_offset(64);
    &mut buffer[first..]
}

fn int8(
    isa: Isa,
    algorithm: Algorithm,
    height: usize,
    width: usize,
    shape: ConvShape,
    pool: &Rc<RefCell<Pool<u8>>>,
) -> (String, Box<dyn FnMut()>) {
    let conv = QConv::new(
        isa,
        &QConvParams {
            shape,
            weights: &weights(&shape),
            bias: &vec![0; shape.out_channels()],
            input_max: if shape.in_channels() == 4 { 255 } else { 127 },
            epilogue: Epilogue::U8 {
                scale: vec![1e-4; shape.out_channels()],
                max: 127,
                residual_scale: None,
            },
            algorithm,
        },
    )
    .unwrap();
    let input = Layout::dense(height, width, shape.in_channels(), 1).unwrap();
    let output = Layout::dense(
        shape.output_len(height),
        shape.output_len(width),
        shape.out_channels(),
        1,
    )
    .unwrap();
    let name = conv.name().to_owned();
    let pool = pool.clone();
    let run = move || {
        let pool = &mut *pool.borrow_mut();
        let [data, result] = &mut pool.buffers;
        let (data, result) = (aligned(data), aligned(result));
        conv.check((&input, data.len()), None, (&output, result.len()))
            .unwrap();
        let part = Part::whole(output.height(), shape.groups());
        // SAFETY: checked above; the buffers are borrowed here alone.
        unsafe {
            conv.run_part(
                data.as_ptr(),
                &input,
                None,
                result.as_mut_ptr(),
                &output,
                &part,
                &mut pool.scratch,
            );
        }
        pool.buffers.swap(0, 1);
    };
    (name, Box::new(run))
}

fn f32(
    isa: Isa,
    algorithm: Algorithm,
    height: usize,
    width: usize,
    shape: ConvShape,
    pool: &Rc<RefCell<Pool<f32>>>,
) -> (String, Box<dyn FnMut()>) {
    let weights: Vec<f32> = weights(&shape)
        .iter()
        .map(|&w| f32::from(w) / 1270.0)
        .collect();
    let conv = FConv::new(
        isa,
        &FConvParams {
            shape,
            weights: &weights,
            bias: &vec![0.0; shape.out_channels()],
            relu: true,
            residual: false,
            algorithm,
        },
    )
    .unwrap();
    let input = Layout::dense(height, width, shape.in_channels(), 1).unwrap();
    let output = Layout::dense(
        shape.output_len(height),
        shape.output_len(width),
        shape.out_channels(),
        1,
    )
    .unwrap();
    let name = conv.name().to_owned();
    let pool = pool.clone();
    let run = move || {
        let pool = &mut *pool.borrow_mut();
        let [data, result] = &mut pool.buffers;
        let (data, result) = (aligned(data), aligned(result));
        conv.check((&input, data.len()), None, (&output, result.len()))
            .unwrap();
        let part = Part::whole(output.height(), shape.groups());
        // SAFETY: checked above; the buffers are borrowed here alone.
        unsafe {
            conv.run_part(
                data.as_ptr(),
                &input,
                None,
                result.as_mut_ptr(),
                &output,
                &part,
                &mut pool.scratch,
            );
        }
        pool.buffers.swap(0, 1);
    };
    (name, Box::new(run))
}

/// Seconds that this thread has been running: other processes on a shared machine do not count.
fn cpu_seconds() -> f64 {
    let mut time = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: `time` is a valid timespec to write to.
    let status = unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &mut time) };
    assert_eq!(status, 0, "the thread's clock can be read");
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// The median, and the least.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[if std::env::var_os("BEST").is_some() {
        0
    } else {
        values.len() / 2
    }]
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let floats = arguments.get(1).is_some_and(|kind| kind == "f32");
    let rounds: usize = arguments
        .get(2)
        .map_or(15, |n| n.parse().expect("rounds is a number"));
    let isa = Isa::detect().expect("EDGECAP_ISA names a tier of this CPU");
    let (pool_u8, pool_f32) = (Pool::new(), Pool::new());
    let mut all = Vec::new();
    for (height, width, times, shape) in table() {
        let macs = shape.macs(height, width);
        for &algorithm in Algorithm::candidates(&shape) {
            let (name, run) = if floats {
                f32(isa, algorithm, height, width, shape, &pool_f32)
            } else {
                int8(isa, algorithm, height, width, shape, &pool_u8)
            };
            let label = format!(
                "{:>3}x{:<3} {:>3}->{:<3} g{} k{} s{} {name}",
                height,
                width,
                shape.in_channels(),
                shape.out_channels(),
                shape.groups(),
                shape.kernel(),
                shape.stride()
            );
            all.push((label, times, macs, algorithm, run));
        }
    }
    let mut layers: Vec<Layer> = Vec::new();
    for (label, times, macs, _, run) in all {
        layers.push(Layer {
            label,
            times,
            macs,
            run,
            seconds: Vec::new(),
        });
    }
    // A third argument keeps the layers whose line contains it, to profile one.
    if let Some(pattern) = arguments.get(3) {
        layers.retain(|layer| layer.label.contains(pattern.as_str()));
    }
    let mut peaks = Vec::new();
    for _ in 0..rounds {
        // The peak is measured again in every round: the machine may be shared.
        let peak = Peak::measure(isa, Duration::from_millis(4)).unwrap();
        peaks.push(if floats { peak.f32 } else { peak.int8 });
        for layer in &mut layers {
            (layer.run)();
            let start = cpu_seconds();
            (layer.run)();
            layer.seconds.push(cpu_seconds() - start);
        }
    }
    // Every layer once with weights of its own, in the order of the network: caches are as cold as in a real frame.
    let mut network = Vec::new();
    if arguments.get(3).is_none() {
        for (height, width, times, shape) in table() {
            for _ in 0..times {
                network.push(if floats {
                    let algorithm = Algorithm::preferred(&shape);
                    f32(isa, algorithm, height, width, shape, &pool_f32).1
                } else {
                    int8(
                        isa,
                        Algorithm::preferred(&shape),
                        height,
                        width,
                        shape,
                        &pool_u8,
                    )
                    .1
                });
            }
        }
    }
    let mut cold = vec![Vec::new(); network.len()];
    let mut passes = Vec::new();
    for _ in 0..rounds {
        let start = cpu_seconds();
        for (cold, layer) in cold.iter_mut().zip(&mut network) {
            let start = cpu_seconds();
            layer();
            cold.push(cpu_seconds() - start);
        }
        passes.push(cpu_seconds() - start);
    }
    let pass = median(&mut passes);
    let peak = median(&mut peaks);
    println!("{isa}: peak {peak:.1} GMAC/s on one thread");
    let (mut total, mut total_macs) = (0.0, 0);
    let mut place = 0;
    let mut i = 0;
    while i < layers.len() {
        // Lines of one layer differ in the algorithm; the network takes the fastest.
        let key = |label: &str| label.rsplit_once(' ').map(|(key, _)| key.to_owned());
        let mut end = i + 1;
        while end < layers.len() && key(&layers[end].label) == key(&layers[i].label) {
            end += 1;
        }
        let mut least = f64::INFINITY;
        for layer in &mut layers[i..end] {
            let seconds = median(&mut layer.seconds);
            let rate = layer.macs as f64 / seconds / 1e9;
            println!(
                "{:>7.1} GMAC/s {:>4.0} %  {:>7.3} ms x{}  {}",
                rate,
                rate / peak * 100.0,
                seconds * 1e3,
                layer.times,
                layer.label
            );
            least = least.min(seconds);
        }
        let times = layers[i].times;
        if let Some(cold) = cold.get_mut(place..place + times) {
            let mean = cold.iter_mut().map(|cold| median(cold)).sum::<f64>() / times as f64;
            println!("{:>22.3} ms as part of the network", mean * 1e3);
            place += times;
        }
        total += least * layers[i].times as f64;
        total_macs += layers[i].macs * layers[i].times as u64;
        i = end;
    }
    println!("one pass through all layers: {:.2} ms", pass * 1e3);
    let rate = total_macs as f64 / total / 1e9;
    println!(
        "whole: {:.2} GMAC, {:.2} ms, {rate:.1} GMAC/s, {:.0} % of peak",
        total_macs as f64 / 1e9,
        total * 1e3,
        rate / peak * 100.0
    );
}
