//! A buffer with a layout, checked once so that kernels need not check.

use crate::{KernelError, Layout};

/// Element type of a tensor: `u8` (quantised) or `f32`.
pub trait Element: Copy + Default + Send + Sync + sealed::Sealed + 'static {
    /// Name for messages.
    const NAME: &'static str;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for u8 {}
    impl Sealed for f32 {}
}

impl Element for u8 {
    const NAME: &'static str = "u8";
}

impl Element for f32 {
    const NAME: &'static str = "f32";
}

/// A readable tensor.
#[derive(Debug, Clone, Copy)]
pub struct Tensor<'a, T> {
    /// The whole buffer.
    pub data: &'a [T],
    /// Where the tensor lies in it.
    pub layout: Layout,
}

/// A writable tensor.
#[derive(Debug)]
pub struct TensorMut<'a, T> {
    /// The whole buffer.
    pub data: &'a mut [T],
    /// Where the tensor lies in it.
    pub layout: Layout,
}

impl<'a, T> Tensor<'a, T> {
    /// A view of `data`.
    pub fn new(data: &'a [T], layout: Layout) -> Self {
        Self { data, layout }
    }
}

impl<'a, T> TensorMut<'a, T> {
    /// A writable view of `data`.
    pub fn new(data: &'a mut [T], layout: Layout) -> Self {
        Self { data, layout }
    }
}

/// What an operation expects of one tensor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Expected {
    /// Role in messages: input, output, residual.
    pub role: &'static str,
    pub height: usize,
    pub width: usize,
    pub channels: usize,
    /// Least halo.
    pub halo: usize,
}

impl Expected {
    /// Checks `layout` against this expectation and against a buffer of `len` elements.
    ///
    /// # Errors
    /// [`KernelError::Tensor`] where size, channels, halo or buffer are other than expected.
    pub fn check(&self, layout: &Layout, len: usize) -> Result<(), KernelError> {
        let Self { role, .. } = self;
        if (layout.height(), layout.width(), layout.channels())
            != (self.height, self.width, self.channels)
        {
            return Err(KernelError::Tensor(format!(
                "{role}: expected {}x{}x{} (height, width, channels), found {}x{}x{}; check the network's wiring",
                self.height,
                self.width,
                self.channels,
                layout.height(),
                layout.width(),
                layout.channels()
            )));
        }
        if layout.halo() < self.halo {
            return Err(KernelError::Tensor(format!(
                "{role}: expected a halo of at least {} pixels, found {}; place the tensor with a wider halo",
                self.halo,
                layout.halo()
            )));
        }
        if layout.buffer_len() > len {
            return Err(KernelError::Tensor(format!(
                "{role}: expected a buffer of at least {} elements, found {len}; allocate Layout::buffer_len()",
                layout.buffer_len()
            )));
        }
        Ok(())
    }
}
