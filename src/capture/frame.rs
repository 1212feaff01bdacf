//! A picture and when it was taken.

/// One picture, interleaved RGB, 8 bits a channel, rows without padding.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Frame {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// `3 * width * height` bytes.
    pub rgb: Vec<u8>,
    /// Capture time, nanoseconds: CLOCK_MONOTONIC for cameras, presentation time for files.
    pub time_ns: u64,
    /// Counts the frames of this input from 0; gaps are dropped frames, of a film also those that it repeats and those
    /// that cannot be decoded.
    pub sequence: u64,
}
