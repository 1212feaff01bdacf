//! In: the JSON of a contract and one that is right. Out: what of it can be read, and everything that cannot.

use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Map, Value};

use super::ModelError;

/// The contract, with what is missing or of another type taken from `ours` and told; `None` where it is none at all.
pub(super) fn completed<T>(json: &str, ours: &T) -> (Option<T>, Vec<ModelError>)
where
    T: Serialize + DeserializeOwned,
{
    let nothing = |found: String| (None, vec![mismatch("contract", "a JSON object", &found)]);
    let mut found = match serde_json::from_str(json) {
        Ok(Value::Object(found)) => found,
        Ok(other) => return nothing(shortened(&other)),
        Err(e) => return nothing(e.to_string()),
    };
    let Ok(Value::Object(ours)) = serde_json::to_value(ours) else {
        return nothing("nothing".into());
    };
    let mut all = Vec::new();
    // Only what has a fixed set of keys: maps of numbers by name have any.
    if let (Some(Value::Object(inner)), Some(Value::Object(right))) =
        (found.get_mut("input"), ours.get("input"))
    {
        fill(inner, right, "input.", &mut all);
    }
    fill(&mut found, &ours, "", &mut all);
    let keys: Vec<String> = found.keys().cloned().collect();
    for key in keys {
        let mut one = ours.clone();
        one.insert(key.clone(), found[&key].clone());
        let Err(e) = serde_json::from_value::<T>(Value::Object(one)) else {
            continue;
        };
        let found_value = match found.get(&key) {
            Some(value @ Value::Object(_)) => format!("{} ({e})", shortened(value)),
            Some(value) => shortened(value),
            None => continue,
        };
        match ours.get(&key) {
            Some(right) => {
                all.push(mismatch(&key, &shortened(right), &found_value));
                found.insert(key, right.clone());
            }
            None => {
                all.push(mismatch(&key, &e.to_string(), &found_value));
                found.remove(&key);
            }
        }
    }
    match serde_json::from_value(Value::Object(found)) {
        Ok(contract) => (Some(contract), all),
        Err(e) => {
            all.push(mismatch("contract", "what is documented", &e.to_string()));
            (None, all)
        }
    }
}

/// Adds what is missing, and tells it.
fn fill(
    found: &mut Map<String, Value>,
    right: &Map<String, Value>,
    within: &str,
    all: &mut Vec<ModelError>,
) {
    for (key, value) in right {
        // It has a default: older exporters do not write it, and networks without modules have none.
        let is_optional = within.is_empty() && ["encodings_trained", "modules"].contains(&&**key);
        if !is_optional && !found.contains_key(key) {
            all.push(mismatch(
                &format!("{within}{key}"),
                &shortened(value),
                "nothing",
            ));
            found.insert(key.clone(), value.clone());
        }
    }
}

fn mismatch(key: &str, expected: &str, found: &str) -> ModelError {
    ModelError::Contract {
        key: key.into(),
        expected: expected.into(),
        found: found.into(),
    }
}

fn shortened(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(200) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}
