//! Motion-JPEG in an AVI container: bytes go in, frames come out, and the other way round.
//!
//! The container is RIFF: a chunk is a four-letter code, a little-endian u32 length, that many bytes, and one byte of
//! padding after an odd length. A file is `RIFF("AVI " LIST("hdrl" avih LIST("strl" strh strf vprp)) LIST("movi" 00dc…)
//! idx1)`; files over 1 GiB go on with `RIFF("AVIX" LIST("movi" …))` (OpenDML). Every `00dc` chunk is one whole JPEG
//! picture. Any player opens what [`AviWriter`] writes; [`AviReader`] needs no other program.

mod chunks;
mod read;
mod write;

pub(super) use chunks::is_avi;
pub use read::AviReader;
pub use write::AviWriter;
