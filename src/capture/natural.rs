//! The order in which people number their pictures.

use std::cmp::Ordering;

/// Compares names letter by letter without regard to case, and runs of digits by their value: `img2` before `img10`.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a.as_bytes(), b.as_bytes());
    loop {
        match (a.first(), b.first()) {
            (Some(x), Some(y)) if x.is_ascii_digit() && y.is_ascii_digit() => {
                let (left, rest_a) = digits(a);
                let (right, rest_b) = digits(b);
                // Without leading zeros the longer run is the larger number, however many digits there are.
                let order = left.len().cmp(&right.len()).then_with(|| left.cmp(right));
                if order != Ordering::Equal {
                    return order;
                }
                (a, b) = (rest_a, rest_b);
            }
            (Some(x), Some(y)) => {
                let order = x.to_ascii_lowercase().cmp(&y.to_ascii_lowercase());
                if order != Ordering::Equal {
                    return order;
                }
                (a, b) = (&a[1..], &b[1..]);
            }
            (x, y) => return x.is_some().cmp(&y.is_some()),
        }
    }
}

/// The leading run of digits without its leading zeros, and what follows it.
fn digits(s: &[u8]) -> (&[u8], &[u8]) {
    let end = s.iter().take_while(|c| c.is_ascii_digit()).count();
    let zeros = s[..end].iter().take_while(|c| **c == b'0').count();
    (&s[zeros..end], &s[end..])
}
