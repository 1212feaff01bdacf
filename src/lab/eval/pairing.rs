//! Which predicted frame belongs to which frame of the truth.

use std::collections::HashMap;

use super::{EvalError, PredictedFrame, Predictions, TruthFrame, TruthSet};

/// Every frame of the truth with its prediction: by frame index in videos, else by the longest common end of the paths.
pub(crate) fn pair<'a>(
    truth: &'a TruthSet,
    predictions: &'a Predictions,
) -> Result<Vec<(&'a TruthFrame, Option<&'a PredictedFrame>)>, EvalError> {
    let by_index: HashMap<u64, &PredictedFrame> =
        predictions.frames.iter().map(|f| (f.frame, f)).collect();
    let mut by_name: HashMap<&str, Vec<&PredictedFrame>> = HashMap::new();
    for f in &predictions.frames {
        by_name.entry(last(&f.source)).or_default().push(f);
    }
    let find = |t: &TruthFrame| match t.frame {
        Some(index) => by_index.get(&index).copied(),
        None => {
            let same = by_name.get(last(&t.source))?.iter().copied();
            same.max_by_key(|f| common_end(&f.source, &t.source))
        }
    };
    let pairs: Vec<_> = truth.frames.iter().map(|t| (t, find(t))).collect();
    if !pairs.is_empty() && pairs.iter().all(|(_, p)| p.is_none()) {
        return Err(EvalError::Disjoint {
            truth: pairs.len(),
            predictions: predictions.frames.len(),
        });
    }
    Ok(pairs)
}

fn last(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

/// Number of equal path components from the end.
fn common_end(a: &str, b: &str) -> usize {
    let parts = |p: &'_ str| -> Vec<String> { p.rsplit(['/', '\\']).map(str::to_owned).collect() };
    parts(a)
        .iter()
        .zip(&parts(b))
        .take_while(|(a, b)| a == b)
        .count()
}
