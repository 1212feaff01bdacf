//! Numbers of bodies. Those of observations, which begin anew with another `infer` or another record, go in; what comes
//! out goes back only with another `fit`, by which readers of a record know that ids begin anew.

/// Keeps numbers from going back.
#[derive(Debug, Default)]
pub struct Numbers {
    newest: u64,
    /// What is added to those of the observations.
    offset: u64,
}

impl Numbers {
    /// The number of the bodies of an observation: the same again for the same one.
    pub fn go_on(&mut self, observed: u64) -> u64 {
        if observed.saturating_add(self.offset) < self.newest {
            self.offset = self.newest.saturating_add(1) - observed;
        }
        self.newest = observed.saturating_add(self.offset);
        self.newest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_begins_anew_goes_on_where_the_last_one_was() {
        let mut numbers = Numbers::default();
        let seen = [7, 7, 9, 0, 0, 1, 4, 2, u64::MAX, 3];
        let given = seen.map(|n| numbers.go_on(n));
        let most = u64::MAX;
        assert_eq!(given, [7, 7, 9, 10, 10, 11, 14, 15, most, most]);
    }
}
