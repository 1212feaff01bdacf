//! In: guesses from random samples, and what each costs over all data. Out: the best of them, refined by all data that
//! agree with them. Random sample consensus (Fischler and Bolles 1981) with reweighted least squares behind it.

/// How much is tried.
#[derive(Debug, Clone, Copy)]
pub struct Search {
    /// Samples that guesses are made from.
    pub samples: usize,
    /// Guesses that are refined: those that cost least.
    pub finalists: usize,
    /// Rounds in which all data are weighed and used.
    pub refinements: usize,
}

impl Search {
    /// Guesses with their costs, the best first. `guess` makes one from a sample of its own, if the sample allows it;
    /// `better` is what all data say, each weighed by how well it agrees with a guess.
    pub fn run<T>(
        &self,
        mut guess: impl FnMut() -> Option<T>,
        cost: impl Fn(&T) -> f64,
        better: impl Fn(&T) -> Option<T>,
    ) -> Vec<(f64, T)> {
        let guesses = (0..self.samples).filter_map(|_| guess());
        let mut all: Vec<(f64, T)> = guesses.map(|g| (cost(&g), g)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all.truncate(self.finalists);
        for (least, found) in &mut all {
            for _ in 0..self.refinements {
                match better(found) {
                    Some(better) if cost(&better) < *least => {
                        (*least, *found) = (cost(&better), better);
                    }
                    _ => break,
                }
            }
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    }
}

/// The first `most` that are all different from each other.
pub fn distinct<T>(
    found: impl IntoIterator<Item = T>,
    most: usize,
    is_different: impl Fn(&T, &T) -> bool,
) -> Vec<T> {
    let mut kept: Vec<T> = Vec::new();
    for one in found {
        if kept.len() < most && kept.iter().all(|k| is_different(k, &one)) {
            kept.push(one);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_guesses_are_refined() {
        // Whole numbers by how far they are from 40; a round halves the distance.
        let mut next = 0;
        let guess = || {
            next += 1;
            (next % 2 == 0).then_some(f64::from(next * 100))
        };
        let cost = |x: &f64| (x - 40.0).abs();
        let better = |x: &f64| Some(40.0 + (x - 40.0) / 2.0);
        let search = Search {
            samples: 6,
            finalists: 2,
            refinements: 3,
        };
        let found = search.run(guess, cost, better);
        assert_eq!(found, [(20.0, 60.0), (45.0, 85.0)]);
    }

    #[test]
    fn what_is_best_once_refined_comes_first() {
        let mut guesses = [3.0, 5.0].into_iter();
        let better = |x: &f64| (*x == 5.0).then_some(1.0);
        let search = Search {
            samples: 2,
            finalists: 2,
            refinements: 1,
        };
        let found = search.run(|| guesses.next(), |x: &f64| *x, better);
        assert_eq!(found, [(1.0, 1.0), (3.0, 3.0)]);
    }

    #[test]
    fn what_a_round_makes_worse_stays_as_it_was() {
        let search = Search {
            samples: 1,
            finalists: 1,
            refinements: 5,
        };
        let found = search.run(|| Some(3.0), |x: &f64| *x, |x| Some(x + 1.0));
        assert_eq!(found, [(3.0, 3.0)]);
    }

    #[test]
    fn answers_near_a_better_one_are_left_out() {
        let far = |a: &i32, b: &i32| (a - b).abs() > 5;
        assert_eq!(distinct([10, 12, 30, 18, 70], 3, far), [10, 30, 18]);
    }
}
