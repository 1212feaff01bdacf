//! The client against real processes: places, shared memory, other users, other languages.

#[path = "../../../../tests/program/tools.rs"]
mod tools;

mod found;
mod place;
mod python_layout;
mod shared_memory;
mod strangers;
