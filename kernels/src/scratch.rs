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

    /// All bytes; the first is aligned to 64.
    pub(crate) fn as_mut_bytes(&mut self) -> &mut [u8] {
        // SAFETY: a Line is 64 bytes without padding, so the vector's lines are `64 · lines.len()` initialised bytes.
        unsafe {
            std::slice::from_raw_parts_mut(self.lines.as_mut_ptr().cast(), self.lines.len() * 64)
        }
    }
}
