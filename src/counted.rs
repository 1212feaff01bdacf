//! Numbers before the words of what is counted.

use std::fmt::Display;

/// `1 frame`, `2 frames`: a number and the word that goes with it.
pub fn counted<N: Display + PartialEq + From<u8>>(n: N, one: &str, more: &str) -> String {
    let word = if n == N::from(1) { one } else { more };
    format!("{n} {word}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_has_a_word_of_its_own() {
        let said = [0_u64, 1, 2].map(|n| counted(n, "person", "people"));
        assert_eq!(said, ["0 people", "1 person", "2 people"]);
    }
}
