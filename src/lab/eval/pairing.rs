//! Which predicted frame belongs to which frame of the truth.

use std::collections::HashMap;

use super::{EvalError, PredictedFrame, Predictions, TruthFrame, TruthSet};

/// Every frame of the truth with its prediction: by frame index in videos, else by the longest common end of the paths.
pub(crate) fn pair<'a>(
    truth: &'a TruthSet,
    predictions: &'a Predictions,
) -> Result<Vec<(&'a TruthFrame, Option<&'a PredictedFrame>)>, EvalError> {
    expect_same_film(truth, predictions)?;
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

/// Films are told by name, whatever their container: frame numbers would go with those of any other one.
fn expect_same_film(truth: &TruthSet, predictions: &Predictions) -> Result<(), EvalError> {
    let stem = |path: &str| {
        let name = last(path);
        name.rsplit_once('.')
            .map_or(name, |(stem, _)| stem)
            .to_owned()
    };
    let known = |source: &&str| !source.is_empty();
    let of_film = truth.frames.iter().filter(|f| f.frame.is_some());
    let expected = of_film.map(|f| f.source.as_str()).find(known);
    let found = predictions
        .frames
        .iter()
        .map(|f| f.source.as_str())
        .find(known);
    match (expected, found) {
        (Some(expected), Some(found)) if stem(expected) != stem(found) => {
            Err(EvalError::Unrelated {
                expected: expected.to_owned(),
                found: found.to_owned(),
            })
        }
        _ => Ok(()),
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn predictions_of_another_film_are_refused() {
        let truth = |source: &str| TruthSet {
            frames: vec![TruthFrame {
                source: source.to_owned(),
                frame: Some(0),
                ..TruthFrame::default()
            }],
            video: true,
            ..TruthSet::default()
        };
        let of = |source: &str| Predictions {
            frames: vec![PredictedFrame {
                frame: 0,
                time_ns: 0,
                source: source.to_owned(),
                size: [0.0; 2],
                people: Vec::new(),
            }],
            bodies: true,
        };
        assert!(pair(&truth("a.avi"), &of("films/a.y4m")).is_ok());
        assert!(pair(&truth(""), &of("films/b.avi")).is_ok());
        let e = pair(&truth("a.avi"), &of("films/b.avi"))
            .unwrap_err()
            .to_string();
        assert!(e.contains("a.avi") && e.contains("films/b.avi"), "{e}");
    }
}
