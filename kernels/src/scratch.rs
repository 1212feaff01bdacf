//! Working memory of one thread, allocated once.

/// Bytes aligned to a cache line that kernels may use while they run; contents carry nothing from call to call.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    lines: Vec<Line>,
}

#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Line([u8; 64]);

impl Scratch {
    /// At least `bytes` bytes, zeroed.
    pub fn new(bytes: usize) -> Self {
        Self {
            lines: vec![Line([0; 64]); bytes.div_ceil(64)],
        }
    }

    /// Bytes available.
    pub fn len(&self) -> usize {
        self.lines.len() * 64
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// The first byte, aligned to 64.
    pub(crate) fn as_mut_ptr(&mut self) -> *mut u8 {
        self.lines.as_mut_ptr().cast()
    }
}
