//! Numbers of bodies. Those of observations, which begin anew with another `infer` or another record, go in; what comes
//! out goes back only with another `fit`, by which readers of a record know that ids begin anew. A replay numbers what
//! its record holds in the same way.

/// Keeps numbers from going back.
#[derive(Debug, Default)]
pub struct Numbers {
    newest: u64,
    /// What is added to those of the observations.
    offset: u64,
    /// Whether the next observation is another one whatever its number.
    begins_anew: bool,
}

impl Numbers {
    /// The number of the bodies of an observation: the same again for the same one.
    pub fn go_on(&mut self, observed: u64) -> u64 {
        let begins_anew = std::mem::take(&mut self.begins_anew);
        if begins_anew || observed.saturating_add(self.offset) < self.newest {
            self.offset = self.newest.saturating_add(1).saturating_sub(observed);
        }
        self.newest = observed.saturating_add(self.offset);
        self.newest
    }

    /// Says that what comes next is no observation of before.
    pub fn begin_anew(&mut self) {
        self.begins_anew = true;
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

    #[test]
    fn another_one_of_the_same_number_has_the_next() {
        let mut numbers = Numbers::default();
        let mut given = Vec::new();
        for _ in 0..3 {
            given.extend([70, 71, 0, 1].map(|n| numbers.go_on(n)));
            numbers.begin_anew();
        }
        assert_eq!(given, (70..82).collect::<Vec<_>>());
        numbers.go_on(5);
        numbers.begin_anew();
        assert_eq!(numbers.go_on(5), 83);
    }
}
