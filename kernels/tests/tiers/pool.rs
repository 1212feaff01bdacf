//! Max pooling: the same from every tier.

use edgecap_kernels::{Isa, MaxPool, PoolShape, Tensor, TensorMut};

use super::{Numbers, sliced};
use crate::guarded::Guarded;

#[test]
fn pool_equals_scalar() {
    for channels in [1, 5, 16, 31, 32, 64, 65, 100] {
        let layout = sliced(9, 7, channels, 2, 1);
        let mut numbers = Numbers(channels as u64 * 2 + 1);
        let bytes: Vec<u8> = (0..layout.buffer_len())
            .map(|_| numbers.within(0, 255) as u8)
            .collect();
        let floats: Vec<f32> = bytes.iter().map(|&b| f32::from(b) / 3.0).collect();
        let mut all = Vec::new();
        for isa in Isa::available() {
            let pool = MaxPool::new(isa, PoolShape::new(3, 2, 1).unwrap()).unwrap();
            let out = sliced(
                pool.shape().output_len(9),
                pool.shape().output_len(7),
                channels,
                1,
                0,
            );
            let (bytes, floats) = (Guarded::new(&bytes), Guarded::new(&floats));
            let mut q = Guarded::new(&vec![1u8; out.buffer_len()]);
            let mut f = Guarded::new(&vec![1.0f32; out.buffer_len()]);
            pool.run(Tensor::new(&bytes, layout), TensorMut::new(&mut q, out))
                .unwrap();
            pool.run(Tensor::new(&floats, layout), TensorMut::new(&mut f, out))
                .unwrap();
            all.push((q.to_vec(), f.to_vec()));
        }
        assert!(all.iter().all(|outputs| *outputs == all[0]));
    }
}
