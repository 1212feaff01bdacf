//! Which predicted frame belongs to which frame of the truth.

use std::collections::HashMap;
use std::path::Path;

use super::names::{claims, last};
use super::{EvalError, PredictedFrame, Predictions, TruthFrame, TruthSet};

/// Every frame of the truth with its prediction: by frame index in films, else by the longest common end of the paths.
pub(crate) fn pair<'a>(
    truth: &'a TruthSet,
    predictions: &'a Predictions,
) -> Result<Vec<(&'a TruthFrame, Option<&'a PredictedFrame>)>, EvalError> {
    expect_film(truth, predictions)?;
    expect_same_film(truth, predictions)?;
    let of_film = truth.frames.iter().any(|f| f.frame.is_some());
    let by_index = match of_film {
        true => by_index(predictions)?,
        false => HashMap::new(),
    };
    // Frames of a film have a number, whatever the name.
    let name = |f: &'a TruthFrame| f.frame.map_or(f.source.as_str(), |_| "");
    let names: Vec<&str> = truth.frames.iter().map(name).collect();
    let predicted = predictions.frames.iter().map(|f| f.source.as_str());
    let by_name = claims(&names, &predicted.collect::<Vec<_>>())?;
    let find = |(t, claimed): (&'a TruthFrame, Option<usize>)| {
        let found = match t.frame {
            Some(index) => by_index.get(&index).copied(),
            None => claimed.map(|p| &predictions.frames[p]),
        };
        (t, found)
    };
    let pairs: Vec<_> = truth.frames.iter().zip(by_name).map(find).collect();
    if !pairs.is_empty() && pairs.iter().all(|(_, p)| p.is_none()) {
        return Err(disjoint(truth, predictions));
    }
    expect_same_size(&pairs)?;
    Ok(pairs)
}

/// What is wrong where no frame of the truth has a prediction: numbers of a film do not meet, or names of pictures.
fn disjoint(truth: &TruthSet, predictions: &Predictions) -> EvalError {
    let numbers: Option<Vec<u64>> = truth.frames.iter().map(|f| f.frame).collect();
    let expected = numbers.and_then(|all| first_and_last(all.into_iter()));
    let found = first_and_last(predictions.frames.iter().map(|f| f.frame));
    match expected.zip(found) {
        Some((expected, found)) => EvalError::OtherFrames { expected, found },
        None => EvalError::Disjoint {
            truth: truth.frames.len(),
            predictions: predictions.frames.len(),
        },
    }
}

fn first_and_last(numbers: impl Iterator<Item = u64> + Clone) -> Option<[u64; 2]> {
    Some([numbers.clone().min()?, numbers.max()?])
}

/// Pixels of a picture that was turned or scaled, or of another one, are no measure.
fn expect_same_size(pairs: &[(&TruthFrame, Option<&PredictedFrame>)]) -> Result<(), EvalError> {
    for (t, p) in pairs {
        if let (Some(expected), Some(found)) = (t.size, p.map(|p| p.size))
            && found.iter().all(|pixels| *pixels > 0.0)
            && found != expected
        {
            let picture = t.frame.map(|index| format!("frame {index}"));
            return Err(EvalError::Size {
                picture: picture.unwrap_or_else(|| t.source.clone()),
                expected,
                found,
            });
        }
    }
    Ok(())
}

/// Predictions of a film by their number; two of one number are of two films, or of one film twice.
fn by_index(predictions: &Predictions) -> Result<HashMap<u64, &PredictedFrame>, EvalError> {
    let mut all = HashMap::with_capacity(predictions.frames.len());
    for f in &predictions.frames {
        if all.insert(f.frame, f).is_some() {
            return Err(EvalError::Twice { frame: f.frame });
        }
    }
    Ok(all)
}

/// Pictures have numbers, too, which would go with those of any film.
fn expect_film(truth: &TruthSet, predictions: &Predictions) -> Result<(), EvalError> {
    let is_picture = |source: &&str| {
        let ending = Path::new(source).extension();
        ending.is_some_and(|e| {
            ["jpg", "jpeg", "png"]
                .iter()
                .any(|p| e.eq_ignore_ascii_case(p))
        })
    };
    let mut sources = predictions.frames.iter().map(|f| f.source.as_str());
    match sources.find(is_picture).filter(|_| truth.clip) {
        Some(found) => {
            let mut named = truth.frames.iter().map(|f| f.source.as_str());
            let named = named.find(|s| !s.is_empty());
            Err(EvalError::Picture {
                expected: named.unwrap_or("a film").to_owned(),
                found: found.to_owned(),
            })
        }
        None => Ok(()),
    }
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
    let Some(expected) = of_film.map(|f| f.source.as_str()).find(known) else {
        return Ok(());
    };
    let own = stem(expected);
    let sources = predictions.frames.iter().map(|f| f.source.as_str());
    match sources.filter(known).find(|s| stem(s) != own) {
        Some(found) => Err(EvalError::Unrelated {
            expected: expected.to_owned(),
            found: found.to_owned(),
        }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth(source: &str) -> TruthSet {
        TruthSet {
            frames: vec![TruthFrame {
                source: source.to_owned(),
                frame: Some(0),
                ..TruthFrame::default()
            }],
            video: true,
            ..TruthSet::default()
        }
    }

    fn of(source: &str) -> Predictions {
        Predictions {
            frames: vec![PredictedFrame {
                frame: 0,
                time_ns: 0,
                source: source.to_owned(),
                size: [0.0; 2],
                people: Vec::new(),
            }],
            bodies: true,
            ..Predictions::default()
        }
    }

    #[test]
    fn predictions_of_another_film_are_refused() {
        assert!(pair(&truth("a.avi"), &of("films/a.y4m")).is_ok());
        assert!(pair(&truth(""), &of("films/b.avi")).is_ok());
        let e = pair(&truth("a.avi"), &of("films/b.avi"))
            .unwrap_err()
            .to_string();
        assert!(e.contains("a.avi") && e.contains("films/b.avi"), "{e}");
    }

    #[test]
    fn so_are_those_of_other_frames_of_a_film_by_their_numbers() {
        let mut late = truth("a.avi");
        late.frames[0].frame = Some(5000);
        late.frames.extend(late.frames.clone());
        late.frames[1].frame = Some(5119);
        let mut early = of("a.avi");
        early.frames.extend(of("a.avi").frames);
        early.frames[1].frame = 119;
        let e = pair(&late, &early).unwrap_err().to_string();
        assert!(e.contains("5000 to 5119") && e.contains("0 to 119"), "{e}");
        assert!(!e.contains("file names"), "{e}");
    }

    #[test]
    fn so_are_those_of_pictures_whatever_the_truth_is_called() {
        for (name, said) in [("", "a film"), ("a.avi", "a.avi")] {
            let clip = TruthSet {
                clip: true,
                ..truth(name)
            };
            let e = pair(&clip, &of("photos/a.JPG")).unwrap_err().to_string();
            assert!(e.contains(said) && e.contains("photos/a.JPG"), "{e}");
            assert!(pair(&clip, &of("a.avi")).is_ok());
        }
        // Frames of a film may be pictures.
        assert!(pair(&truth(""), &of("frames/0.jpg")).is_ok());
    }

    /// A film of the same name that was filmed, or one that was turned or scaled.
    #[test]
    fn so_are_those_of_pictures_of_another_size() {
        let sized = |mut truth: TruthSet| {
            truth.frames[0].size = Some([640.0, 400.0]);
            truth
        };
        let photo = TruthSet {
            frames: vec![TruthFrame {
                source: "a.jpg".to_owned(),
                ..TruthFrame::default()
            }],
            ..TruthSet::default()
        };
        for (truth, source, named) in [
            (truth("a.avi"), "a.mp4", "frame 0"),
            (truth(""), "b.mp4", "frame 0"),
            (photo, "a.jpg", "a.jpg"),
        ] {
            let truth = sized(truth);
            let mut predictions = of(source);
            assert!(pair(&truth, &predictions).is_ok(), "the size is not known");
            predictions.frames[0].size = [640.0, 400.0];
            assert!(pair(&truth, &predictions).is_ok());
            predictions.frames[0].size = [1080.0, 1920.0];
            let e = pair(&truth, &predictions).unwrap_err().to_string();
            for word in [named, "640x400", "1080x1920"] {
                assert!(e.contains(word), "{e}");
            }
        }
    }

    #[test]
    fn so_are_those_that_follow_the_right_ones() {
        let mut both = of("a.avi");
        both.frames.extend(of("b.avi").frames);
        both.frames[1].frame = 1;
        let e = pair(&truth("a.avi"), &both).unwrap_err().to_string();
        assert!(e.contains("b.avi"), "{e}");
        let mut twice = of("");
        twice.frames.extend(of("").frames);
        let e = pair(&truth("a.avi"), &twice).unwrap_err().to_string();
        assert!(e.contains("frame 0"), "{e}");
    }
}
