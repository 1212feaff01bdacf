//! Identities over time: IDF1 (Ristani et al. 2016) and identity switches (CLEAR MOT, Bernardin and Stiefelhagen 2008).

use std::collections::BTreeMap;

use serde::Serialize;

use crate::assignment::Matcher;

/// Gathers who was seen where, frame by frame, in order.
#[derive(Debug, Clone, Default)]
pub struct Identity {
    matcher: Matcher,
    /// Frames in which a true and a predicted identity lie on each other.
    together: BTreeMap<(u64, u64), usize>,
    truth: BTreeMap<u64, usize>,
    predicted: BTreeMap<u64, usize>,
    /// Predicted identity that a true one had when it was last matched.
    last: BTreeMap<u64, u64>,
    switches: usize,
    matched: usize,
}

/// How well identities hold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct IdentityScore {
    /// 2 IDTP / (true + predicted appearances), under the best one-to-one mapping of identities.
    pub idf1: f64,
    /// How often a person's predicted identity changed.
    pub switches: usize,
    /// Appearances of people in the truth.
    pub truth: usize,
    /// Appearances predicted.
    pub predicted: usize,
    /// Appearances found, whatever their identity.
    pub matched: usize,
    /// Different identities in the truth.
    pub truth_identities: usize,
    /// Different identities predicted.
    pub predicted_identities: usize,
}

impl Identity {
    /// Adds a frame: identities of the truth and of the predictions, and `[prediction][person]` similarities; pairs
    /// below `least` do not lie on each other.
    pub fn add(&mut self, truth: &[u64], predicted: &[u64], similarity: &[Vec<f64>], least: f64) {
        for t in truth {
            *self.truth.entry(*t).or_default() += 1;
        }
        for p in predicted {
            *self.predicted.entry(*p).or_default() += 1;
        }
        let mut scores = vec![0.0_f32; truth.len() * predicted.len()];
        for (p, row) in similarity.iter().enumerate() {
            for (t, s) in row.iter().enumerate().filter(|(_, s)| **s >= least) {
                *self.together.entry((truth[t], predicted[p])).or_default() += 1;
                // A match that still holds is kept before any new one is made: two outweigh every sum of others.
                let kept = self.last.get(&truth[t]) == Some(&predicted[p]);
                scores[p * truth.len() + t] = *s as f32 + if kept { 2.0 } else { 0.0 };
            }
        }
        let pairs = self.matcher.solve(predicted.len(), truth.len(), &scores);
        for (p, t) in pairs
            .iter()
            .enumerate()
            .filter_map(|(p, t)| t.map(|t| (p, t)))
        {
            self.matched += 1;
            let before = self.last.insert(truth[t], predicted[p]);
            self.switches += usize::from(before.is_some_and(|b| b != predicted[p]));
        }
    }

    /// The scores so far.
    pub fn score(&mut self) -> IdentityScore {
        let truth: Vec<u64> = self.truth.keys().copied().collect();
        let predicted: Vec<u64> = self.predicted.keys().copied().collect();
        let both = |t: u64, p: u64| self.together.get(&(t, p)).copied().unwrap_or(0);
        let table: Vec<f32> = predicted
            .iter()
            .flat_map(|&p| truth.iter().map(move |&t| (t, p)))
            .map(|(t, p)| both(t, p) as f32)
            .collect();
        let pairs = self.matcher.solve(predicted.len(), truth.len(), &table);
        let right: usize = pairs
            .iter()
            .enumerate()
            .filter_map(|(p, t)| t.map(|t| both(truth[t], predicted[p])))
            .sum();
        let (all_truth, all_predicted) = (
            self.truth.values().sum::<usize>(),
            self.predicted.values().sum::<usize>(),
        );
        IdentityScore {
            idf1: 2.0 * right as f64 / (all_truth + all_predicted).max(1) as f64,
            switches: self.switches,
            truth: all_truth,
            predicted: all_predicted,
            matched: self.matched,
            truth_identities: truth.len(),
            predicted_identities: predicted.len(),
        }
    }
}
