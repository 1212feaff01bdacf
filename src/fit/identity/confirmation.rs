//! In: newcomers, as whom they are recognised, and how far they are from where others stood who left. Out: of whom that
//! makes sure.

use crate::assignment::assign;

/// Small, so that one newcomer more counts for more than any distance.
const FARTHER: f64 = 1e-3;

/// Which newcomers are made sure of by one of so many who `left`. `pairs` says as whom each newcomer is recognised;
/// `far` says of a newcomer and of one who left what [`by_former_place`](super::by_former_place) does. Everybody who
/// left makes sure of one newcomer at most, so that as many are made sure of as can be, and of these the nearest.
pub fn confirmed(
    pairs: &[Option<usize>],
    left: usize,
    far: impl Fn(usize, usize) -> f64,
) -> Vec<bool> {
    let mut costs = Vec::with_capacity(pairs.len() * left);
    for (newcomer, pair) in pairs.iter().enumerate() {
        for k in 0..left {
            let is_free = pair.is_none() && !pairs.contains(&Some(k));
            let far = if is_free {
                far(newcomer, k)
            } else {
                f64::INFINITY
            };
            costs.push(match far <= 1.0 {
                true => FARTHER * far,
                false => f64::INFINITY,
            });
        }
    }
    let pairs = assign(&costs, pairs.len(), left, 1.0);
    pairs.iter().map(Option::is_some).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const NO: f64 = f64::INFINITY;

    #[test]
    fn everybody_who_left_makes_sure_of_one() {
        let one = |pairs: &[Option<usize>], far: [f64; 3]| confirmed(pairs, 1, |k, _| far[k]);
        assert_eq!(one(&[None; 3], [0.9, 0.2, 0.5]), [false, true, false]);
        assert_eq!(one(&[None; 3], [1.1, NO, 1.0]), [false, false, true]);
        let known = [Some(0), None, None];
        assert_eq!(one(&known, [0.0, 0.2, 0.5]), [false; 3], "recognised");
        assert_eq!(confirmed(&[None], 0, |_, _| 0.0), [false]);
    }

    #[test]
    fn as_many_are_made_sure_of_as_can_be() {
        let far = [[0.0, 0.9], [0.9, NO]];
        assert_eq!(confirmed(&[None; 2], 2, |k, left| far[k][left]), [true; 2]);
        let recognised = [Some(2), None, None];
        let of_others = |k: usize, left: usize| match left {
            2 => 0.0,
            left => far[k - 1][left],
        };
        assert_eq!(confirmed(&recognised, 3, of_others), [false, true, true]);
    }
}
