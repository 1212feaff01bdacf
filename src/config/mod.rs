//! `edgecap.toml`, whatever it holds: where it is looked for, what is wrong with it and in which line, where each value
//! came from.
//!
//! What the file may hold the verbs say: their options are its keys (`src/commands/settings`).

mod find;
mod merge;
mod mistake;
mod setting;
mod table;

pub use find::{FILE_NAME, SYSTEM_FOLDER, find};
pub use merge::{Origin, merge};
pub use mistake::Mistake;
pub use setting::Setting;
pub use table::{Place, Section, Table, keys_of};
