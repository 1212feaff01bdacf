//! What a record holds, by its first bytes.

use std::io::{BufRead, Read};

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::binary::MAGIC;
use super::rows::{BodiesRow, ObservationsRow, Row};

/// What some editors and shells put before the first line of a text in UTF-8.
const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";
/// A longer line is no frame.
const MOST: u64 = 8 << 20;

/// What a record holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// [`ObservationsRow`].
    Observations,
    /// [`BodiesRow`].
    Bodies,
}

/// What tells the two apart in a line of JSON.
#[derive(Deserialize)]
struct Line {
    people: Vec<Person>,
    /// Only bodies are fitted.
    fit_us: Option<IgnoredAny>,
}

#[derive(Deserialize)]
struct Person {
    id: Option<IgnoredAny>,
}

/// A record's first line without a byte order mark, which is none of its text.
pub(super) fn without_mark(line: &[u8]) -> &[u8] {
    line.strip_prefix(BYTE_ORDER_MARK).unwrap_or(line)
}

impl Kind {
    /// Of what `input` begins with; `None` of anything else. What is read of it is gone.
    pub fn of(input: &mut impl BufRead) -> Option<Self> {
        let mut read = Vec::new();
        let mut start = &read[..];
        while start.trim_ascii().is_empty() {
            read.clear();
            if input.take(MOST).read_until(b'\n', &mut read).ok()? == 0 {
                return None;
            }
            start = without_mark(&read);
        }
        if let Some(rest) = start.strip_prefix(MAGIC) {
            return match rest.first() {
                Some(&ObservationsRow::KIND) => Some(Self::Observations),
                Some(&BodiesRow::KIND) => Some(Self::Bodies),
                _ => None,
            };
        }
        let line: Line = serde_json::from_slice(start).ok()?;
        let is_bodies = line.fit_us.is_some() || line.people.iter().any(|p| p.id.is_some());
        Some(match is_bodies {
            true => Self::Bodies,
            false => Self::Observations,
        })
    }
}
