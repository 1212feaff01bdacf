//! Who is found and who is not: recall by a person's height, by how much of them can be seen, by how many people there
//! are.

use serde::Serialize;

use super::{Finding, ImageOks, TruthPerson, find_people};

/// OKS of a find.
const FOUND: f64 = 0.5;
/// Heights, network input pixels, at which rows begin.
const HEIGHTS: [f64; 5] = [0.0, 60.0, 100.0, 150.0, 300.0];
/// Numbers of labelled evidence joints at which rows begin: fewer when the frame or somebody else cuts a person off.
const JOINTS: [f64; 4] = [1.0, 8.0, 11.0, 14.0];
/// Numbers of people in a picture at which rows begin.
const COMPANY: [f64; 4] = [1.0, 2.0, 3.0, 5.0];

/// Recall of people of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RecallRow {
    /// Least value.
    pub from: f64,
    /// Values are below this; null in JSON for the last row.
    pub to: f64,
    /// People.
    pub people: usize,
    /// Share found.
    pub recall: f64,
}

/// A picture's similarities and truth, and network input pixels per pixel where its size is known.
pub(super) type Picture<'a> = (&'a ImageOks, &'a [TruthPerson], Option<f64>);

/// Which people are asked for, by who they are and the picture's scale.
pub(super) type Asked<'a> = &'a dyn Fn(&TruthPerson, Option<f64>) -> bool;

/// Labelled evidence joints.
pub(super) fn labelled(t: &TruthPerson) -> usize {
    let points = t.points.iter();
    points
        .filter(|k| k.joint.is_some() && k.is_labelled())
        .count()
}

/// Rows of height, network input pixels, of people who are asked for; pictures of unknown size are left out.
pub(super) fn by_height(pictures: &[Picture], asked: Asked<'_>) -> Vec<RecallRow> {
    rows(&HEIGHTS, |from, to| {
        let counts = |t: &TruthPerson, scale: Option<f64>| {
            let height = scale.map(|s| t.height() * s);
            asked(t, scale) && height.is_some_and(|h| (from..to).contains(&h))
        };
        find_people(pictures.iter().copied(), FOUND, &counts)
    })
}

/// Rows of labelled evidence joints, of people who are `tall` enough to be asked for.
pub(super) fn by_joints(pictures: &[Picture], tall: Asked<'_>) -> Vec<RecallRow> {
    rows(&JOINTS, |from, to| {
        let counts = |t: &TruthPerson, scale: Option<f64>| {
            tall(t, scale) && (from..to).contains(&(labelled(t) as f64))
        };
        find_people(pictures.iter().copied(), FOUND, &counts)
    })
}

/// Rows of people in the picture, of people who are asked for.
pub(super) fn by_company(pictures: &[Picture], asked: Asked<'_>) -> Vec<RecallRow> {
    rows(&COMPANY, |from, to| {
        let some = pictures.iter().copied().filter(|(image, ..)| {
            let people = image.ignored.iter().filter(|i| !**i).count();
            (from..to).contains(&(people as f64))
        });
        find_people(some, FOUND, asked)
    })
}

/// Every row that somebody belongs to.
fn rows(begins: &[f64], found: impl Fn(f64, f64) -> Finding) -> Vec<RecallRow> {
    let ends = begins.iter().skip(1).chain([&f64::INFINITY]);
    let row = |(&from, &to)| {
        let Finding { people, recall, .. } = found(from, to);
        Some(RecallRow {
            from,
            to,
            people,
            recall: recall?,
        })
    };
    begins.iter().zip(ends).filter_map(row).collect()
}
