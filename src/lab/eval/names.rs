//! Paths of pictures in the truth and in predictions go in, which is which comes out: the longest common end tells.

use std::collections::{BTreeMap, HashSet};

use super::EvalError;

/// The number of the prediction of every picture of the truth. A prediction is of one picture only, the one with which
/// most of the path is common. Where pictures of the truth share a name, as much of the path has to be common as tells
/// them apart: `img_000000.jpg` of another folder is another picture.
///
/// # Errors
/// When two are as good as each other, one is there twice, or nothing tells of which of several pictures one is.
pub(super) fn claims(truth: &[&str], predicted: &[&str]) -> Result<Vec<Option<usize>>, EvalError> {
    let mut groups: BTreeMap<&str, [Vec<usize>; 2]> = BTreeMap::new();
    for (k, path) in truth.iter().enumerate().filter(|(_, p)| !p.is_empty()) {
        groups.entry(last(path)).or_default()[0].push(k);
    }
    for (k, path) in predicted.iter().enumerate() {
        if let Some(group) = groups.get_mut(last(path)) {
            group[1].push(k);
        }
    }
    let mut claimed = vec![None; truth.len()];
    for [of_truth, of_predicted] in groups.values() {
        let mut common = Vec::new();
        for &t in of_truth {
            let least = telling(truth, of_truth, t);
            let each = of_predicted.iter();
            let each = each.map(|&p| (common_end(truth[t], predicted[p]), t, p));
            common.extend(each.filter(|c| c.0 >= least));
        }
        common.sort_by_key(|c| std::cmp::Reverse(c.0));
        let mut taken = HashSet::new();
        for equal in common.chunk_by(|a, b| a.0 == b.0) {
            let free = equal.iter();
            let free = free.filter(|(_, t, p)| claimed[*t].is_none() && !taken.contains(p));
            let free: Vec<(usize, usize)> = free.map(|&(_, t, p)| (t, p)).collect();
            for &(t, p) in &free {
                if let Some((u, q)) = free.iter().find(|(u, q)| (*u == t) != (*q == p)) {
                    let (of, both, one) = match *u == t {
                        true => ("predictions", [predicted[p], predicted[*q]], truth[t]),
                        false => ("truth", [truth[t], truth[*u]], predicted[p]),
                    };
                    // No folder tells what is the same.
                    return Err(match parts(both[0]).eq(parts(both[1])) {
                        true => EvalError::Repeated {
                            picture: both[0].to_owned(),
                            of,
                        },
                        false => EvalError::Ambiguous {
                            both: both.map(str::to_owned),
                            one: one.to_owned(),
                        },
                    });
                }
            }
            for (t, p) in free {
                claimed[t] = Some(p);
                taken.insert(p);
            }
        }
        // Left out in silence, it would be missing in the figures.
        for &p in of_predicted.iter().filter(|p| !taken.contains(p)) {
            let is_end =
                |t: &usize| common_end(truth[*t], predicted[p]) == parts(predicted[p]).count();
            let mut may_be = of_truth.iter().copied().filter(is_end);
            if let (Some(t), Some(u)) = (may_be.next(), may_be.next())
                && of_truth.iter().any(|k| is_end(k) && claimed[*k].is_none())
            {
                return Err(EvalError::Ambiguous {
                    both: [truth[t], truth[u]].map(str::to_owned),
                    one: predicted[p].to_owned(),
                });
            }
        }
    }
    Ok(claimed)
}

/// How many parts of a path, from its end, tell it from the others of its name; all where it is the end of another one.
fn telling(truth: &[&str], others: &[usize], t: usize) -> usize {
    let others = others.iter().filter(|o| **o != t);
    let shared = others.map(|&o| common_end(truth[t], truth[o])).max();
    (shared.unwrap_or(0) + 1).min(parts(truth[t]).count())
}

/// The name of a file without its folders.
pub(super) fn last(path: &str) -> &str {
    parts(path).next().unwrap_or(path)
}

/// The parts of a path, from its end; none for `.`, nor for `..` and what it leads out of.
fn parts(path: &str) -> impl Iterator<Item = &str> {
    let mut above = 0_usize;
    let is_part = move |part: &&str| match *part {
        "." => false,
        ".." => {
            above += 1;
            false
        }
        _ if above > 0 => {
            above -= 1;
            false
        }
        _ => true,
    };
    path.rsplit(['/', '\\']).filter(is_part)
}

/// Number of equal parts from the end.
fn common_end(a: &str, b: &str) -> usize {
    let both = parts(a).zip(parts(b));
    both.take_while(|(a, b)| a == b).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_one_name_are_told_by_their_folders() {
        let truth = ["TS1/a.jpg", "TS2/a.jpg", "TS3/a.jpg"];
        let found = claims(&truth, &["photos/TS2/a.jpg"]).unwrap();
        assert_eq!(found, [None, Some(0), None]);
        // One that is alone with its name needs none.
        assert_eq!(claims(&["TS1/a.jpg"], &["a.jpg"]).unwrap(), [Some(0)]);
        let deep = ["a/x/1.jpg", "b/x/1.jpg"];
        assert_eq!(claims(&deep, &["b/x/1.jpg"]).unwrap(), [None, Some(0)]);
        // Whatever way leads there.
        let around = claims(&deep, &["./a/../b/./x/1.jpg"]).unwrap();
        assert_eq!(around, [None, Some(0)]);
    }

    /// As `infer --input .` tells of them.
    #[test]
    fn pictures_that_may_be_of_several_folders_are_refused() {
        let truth = ["/s1/0.jpg", "/s2/0.jpg"];
        for predicted in [
            &["./0.jpg"][..],
            &["0.jpg", "s2/0.jpg"],
            &["../0.jpg", "s2/0.jpg"],
        ] {
            let said = claims(&truth, predicted).unwrap_err().to_string();
            assert!(
                said.contains(predicted[0]) && said.contains("/s1/0.jpg"),
                "{said}"
            );
        }
        // One that is of none of them changes nothing.
        let all = ["s1/0.jpg", "s2/0.jpg", "s3/0.jpg", "0.jpg"];
        assert_eq!(claims(&truth, &all).unwrap(), [Some(0), Some(1)]);
    }

    #[test]
    fn a_prediction_is_of_one_picture() {
        let truth = ["a.jpg", "x/a.jpg"];
        assert_eq!(claims(&truth, &["x/a.jpg"]).unwrap(), [None, Some(0)]);
        let both = claims(&truth, &["y/a.jpg", "x/a.jpg"]).unwrap();
        assert_eq!(both, [Some(0), Some(1)]);
    }

    #[test]
    fn what_is_as_good_as_another_is_refused() {
        for (truth, predicted) in [
            (&["a.jpg"][..], &["x/a.jpg", "y/a.jpg"][..]),
            (&["x/a.jpg"], &["y/x/a.jpg", "z/x/a.jpg"]),
        ] {
            let said = claims(truth, predicted).unwrap_err().to_string();
            assert!(
                said.contains("x/a.jpg") && said.contains("folder"),
                "{said}"
            );
        }
    }

    #[test]
    fn a_picture_that_is_there_twice_is_named_with_where_it_is() {
        for (truth, predicted, of) in [
            (&["x/a.jpg", "x/a.jpg"][..], &["x/a.jpg"][..], "the truth"),
            (&["a.jpg"], &["x/a.jpg", "x/a.jpg"], "the predictions"),
        ] {
            let said = claims(truth, predicted).unwrap_err().to_string();
            let expected = format!("found x/a.jpg twice in {of}; give it once");
            assert!(said.contains(&expected), "{said}");
        }
    }
}
