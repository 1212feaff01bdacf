//! How often a camera's bodies are published between its frames, typed or in the settings, with the same words for
//! both.

use std::fmt;
use std::ops::RangeInclusive;

use serde::Deserializer;
use serde::de::{Error, Unexpected, Visitor};

/// Bodies per second.
const RATES: RangeInclusive<u16> = 1..=240;

/// Reads a rate, Hz.
///
/// # Errors
/// What was expected.
pub fn parse_rate(text: &str) -> Result<u16, String> {
    let rate = text.parse().ok().filter(|rate| RATES.contains(rate));
    rate.ok_or_else(|| format!("expected {Rate}"))
}

/// Reads the rate of the settings.
///
/// # Errors
/// What was expected.
pub fn rate<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u16>, D::Error> {
    from.deserialize_option(Rate)
}

/// A rate that may be missing.
struct Rate;

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "a whole number from {} to {}",
            RATES.start(),
            RATES.end()
        )
    }
}

impl<'de> Visitor<'de> for Rate {
    type Value = Option<u16>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }

    fn visit_none<E: Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_some<D: Deserializer<'de>>(self, from: D) -> Result<Self::Value, D::Error> {
        from.deserialize_u16(self)
    }

    fn visit_i64<E: Error>(self, rate: i64) -> Result<Self::Value, E> {
        let whole = u16::try_from(rate).ok().filter(|rate| RATES.contains(rate));
        let refused = || E::invalid_value(Unexpected::Signed(rate), &self);
        whole.map(Some).ok_or_else(refused)
    }

    fn visit_u64<E: Error>(self, rate: u64) -> Result<Self::Value, E> {
        self.visit_i64(rate.try_into().unwrap_or(i64::MAX))
    }
}
