//! Flags over the file over the defaults, field by field.

use std::collections::BTreeMap;

use serde_json::Value;

use super::mistake::Mistake;
use super::table::{Place, Section};

/// Where a value came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// The command line.
    Flag,
    /// The file.
    File(Place),
    /// Nobody said anything.
    Default,
}

/// What the user typed, and where nothing was typed what the file says.
///
/// # Errors
/// Never for sections that read what they write.
pub fn merge<T: Section>(
    typed: &T,
    file: &T,
    places: &BTreeMap<String, Place>,
) -> Result<(T, BTreeMap<String, Origin>), Mistake> {
    let broken = |e: serde_json::Error| Mistake {
        file: "settings".into(),
        place: None,
        what: e.to_string(),
    };
    let fields = |section: &T| -> Result<_, Mistake> {
        match serde_json::to_value(section).map_err(broken)? {
            Value::Object(fields) => Ok(fields),
            _ => Ok(serde_json::Map::new()),
        }
    };
    let nothing = fields(&T::default())?;
    let mut merged = fields(file)?;
    let mut origins = BTreeMap::new();
    for (key, value) in fields(typed)? {
        let origin = if nothing.get(&key) != Some(&value) {
            merged.insert(key.clone(), value);
            Origin::Flag
        } else {
            places
                .get(&key)
                .map_or(Origin::Default, |p| Origin::File(*p))
        };
        origins.insert(key, origin);
    }
    let merged = serde_json::from_value(Value::Object(merged)).map_err(broken)?;
    Ok((merged, origins))
}
