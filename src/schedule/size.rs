//! The size of the network's input, as it is written: `512x320`, or `auto`.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// The network's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum InputSize {
    /// Pixels across and down.
    Fixed(usize, usize),
    /// As those in view want it.
    Auto,
}

impl FromStr for InputSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            size => parse_size(size)
                .map(|(w, h)| Self::Fixed(w, h))
                .map_err(|e| format!("{e}, or 'auto'")),
        }
    }
}

impl TryFrom<String> for InputSize {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<InputSize> for String {
    fn from(size: InputSize) -> Self {
        size.to_string()
    }
}

impl fmt::Display for InputSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fixed(w, h) => write!(f, "{w}x{h}"),
            Self::Auto => f.write_str("auto"),
        }
    }
}

/// WIDTHxHEIGHT in multiples of 16.
///
/// # Errors
/// What was expected.
pub fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let wrong = || {
        format!("'{text}': expected WIDTHxHEIGHT, multiples of 16 from 64 to 4096, such as 512x320")
    };
    let (w, h) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
    let size = (
        w.parse().map_err(|_| wrong())?,
        h.parse().map_err(|_| wrong())?,
    );
    let ok = |n: usize| (64..=4096).contains(&n) && n.is_multiple_of(16);
    if ok(size.0) && ok(size.1) {
        Ok(size)
    } else {
        Err(wrong())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_they_are_written() {
        for text in ["auto", "512x320", "64x4096"] {
            assert_eq!(text.parse::<InputSize>().unwrap().to_string(), text);
        }
        assert_eq!(parse_size("64X128"), Ok((64, 128)));
        for text in ["", "512", "500x320", "48x320", "512x4112", "-64x64", "Auto"] {
            let refused = text.parse::<InputSize>().unwrap_err();
            assert!(refused.contains("multiples of 16"), "{refused}");
            assert!(refused.ends_with("or 'auto'"), "{refused}");
        }
    }
}
