//! In: somebody else's weights. Out: everything that keeps them from being imported, at once.

use super::tensors::{Tensors, is_counter};
use super::{Contract, Model, ModelError, Stage2, Stage2Contract, contract_of, float, stage2};
use crate::engine::network::Network;

impl Model {
    /// Everything that keeps safetensors from being imported as `network`; nothing where
    /// [`from_safetensors`](Self::from_safetensors) takes them.
    ///
    /// # Errors
    /// No safetensors at all.
    pub fn mismatches(bytes: &[u8], network: &Network) -> Result<Vec<ModelError>, ModelError> {
        let mut t = Tensors::parse(bytes)?;
        let read = |json: &str| Contract::read(json, network).err().unwrap_or_default();
        let mut all = contract_of(&t).map_or_else(|e| vec![e], read);
        let wrong = float::mismatches(&mut t, network);
        all.extend(with_the_unused(&t, wrong));
        // What shows only when batch norm is folded.
        if all.is_empty() {
            all.extend(Self::from_safetensors(bytes, network.clone()).err());
        }
        Ok(all)
    }

    /// As [`mismatches`](Self::mismatches), of weights of Stage II.
    ///
    /// # Errors
    /// No safetensors at all.
    pub fn stage2_mismatches(bytes: &[u8]) -> Result<Vec<ModelError>, ModelError> {
        let mut t = Tensors::parse(bytes)?;
        let read = |json: &str| Stage2Contract::read(json).err().unwrap_or_default();
        let mut all = contract_of(&t).map_or_else(|e| vec![e], read);
        let wrong = stage2::mismatches(&mut t);
        all.extend(with_the_unused(&t, wrong));
        // What shows only when batch norm is folded.
        if all.is_empty() {
            all.extend(Stage2::from_safetensors(bytes).err());
        }
        Ok(all)
    }
}

/// Adds tensors that nobody asked for. Where most only have something before their names, that is all that is said of
/// them.
fn with_the_unused(t: &Tensors<'_>, wrong: Vec<ModelError>) -> Vec<ModelError> {
    let unused: Vec<&str> = t.unread().filter(|n| !is_counter(n)).collect();
    let missing = |e: &ModelError| match e {
        ModelError::Missing(name) => Some(name.clone()),
        _ => None,
    };
    let prefix = prefix(
        &wrong.iter().filter_map(missing).collect::<Vec<_>>(),
        &unused,
    );
    let mut all = Vec::new();
    if let Some((prefix, count)) = &prefix {
        all.push(ModelError::Prefix {
            prefix: prefix.clone(),
            count: *count,
        });
    }
    let explains = |name: &str| {
        let known = |p: &str| unused.contains(&&*format!("{p}{name}"));
        prefix.as_ref().is_some_and(|(p, _)| known(p))
    };
    let is_explained = |unused: &str| {
        let without = |p: &str| unused.strip_prefix(p).is_some_and(&explains);
        prefix.as_ref().is_some_and(|(p, _)| without(p))
    };
    let rest = unused.iter().filter(|n| !is_explained(n));
    let rest: Vec<ModelError> = rest
        .map(|n| ModelError::Unused {
            first: (*n).into(),
            count: 1,
        })
        .collect();
    all.extend(
        wrong
            .into_iter()
            .filter(|e| !missing(e).is_some_and(|n| explains(&n))),
    );
    all.extend(rest);
    all
}

/// What stands before most of the names that are missing, and how many it stands before.
fn prefix(missing: &[String], unused: &[&str]) -> Option<(String, usize)> {
    // One or the other may be missing altogether.
    let mut some = missing.iter().take(16);
    let prefix = some.find_map(|name| {
        let mut before = unused.iter().filter_map(|u| u.strip_suffix(&**name));
        before.find(|b| b.ends_with('.'))
    })?;
    let has = |name: &&String| unused.contains(&&*format!("{prefix}{name}"));
    let count = missing.iter().filter(has).count();
    (2 * count > missing.len()).then(|| (prefix.to_owned(), count))
}
