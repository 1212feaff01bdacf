//! Who is who: how many people were found, and how many predictions are nobody.

use serde::Serialize;

use super::{ImageOks, TruthPerson};
use crate::assignment::Matcher;

/// Recall and precision at one similarity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Finding {
    /// Least OKS of a find.
    pub oks: f64,
    /// People of the truth that count.
    pub people: usize,
    /// Those found.
    pub found: usize,
    /// Predictions that count: those on people to be ignored are left out.
    pub predictions: usize,
    /// Predictions that are nobody.
    pub false_people: usize,
    /// `found / people`; none where nobody is asked for.
    pub recall: Option<f64>,
    /// `found / predictions`; none without any, and where nobody is asked for, so that none could be right.
    pub precision: Option<f64>,
    /// Mean OKS of the found; none where nobody is.
    pub mean_oks: Option<f64>,
}

/// Finds people at an OKS of at least `least`, matching each picture so that the total OKS of people who count is
/// greatest; people to be ignored come after them.
///
/// Every picture comes with its scale to network input pixels, where its size is known. `counts` (person, scale) says
/// which people are asked for; the others may be found but are not missed, and a prediction on one of them (or on a
/// person to be ignored) is neither right nor wrong.
pub fn find_people<'a>(
    images: impl Iterator<Item = (&'a ImageOks, &'a [TruthPerson], Option<f64>)>,
    least: f64,
    counts: &dyn Fn(&TruthPerson, Option<f64>) -> bool,
) -> Finding {
    let mut matcher = Matcher::default();
    let (mut people, mut found, mut predictions, mut false_people, mut sum) = (0, 0, 0, 0, 0.0);
    for (image, truth, scale) in images {
        let asked: Vec<bool> = truth
            .iter()
            .zip(&image.ignored)
            .map(|(t, ignored)| !ignored && counts(t, scale))
            .collect();
        people += asked.iter().filter(|a| **a).count();
        let scores = image.matching_scores(least);
        let pairs = matcher.solve(image.scores.len(), truth.len(), &scores);
        for (p, pair) in pairs.iter().enumerate() {
            match *pair {
                Some(t) if asked[t] => {
                    found += 1;
                    predictions += 1;
                    sum += image.oks[p][t];
                }
                Some(_) => {}
                None => {
                    // A crowd swallows any number of predictions.
                    let mut ignored = image.ignored.iter().zip(&image.oks[p]);
                    let swallowed = ignored.any(|(ignored, o)| *ignored && *o >= least);
                    if !swallowed && !image.excused[p] {
                        predictions += 1;
                        false_people += 1;
                    }
                }
            }
        }
    }
    let of = |part: f64, whole: usize| (whole > 0).then(|| part / whole as f64);
    let recall = of(found as f64, people);
    Finding {
        oks: least,
        people,
        found,
        predictions,
        false_people,
        recall,
        precision: recall.and(of(found as f64, predictions)),
        mean_oks: of(sum, found),
    }
}
