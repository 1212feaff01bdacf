//! Pictures whose people are known, and what `infer` reports of them.

use std::path::{Path, PathBuf};

use image::DynamicImage;
use image::imageops::FilterType;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::{output, stderr};

/// Pixels of [`rendered`]'s pictures.
const SIZE: (u32, u32) = (512, 320);
/// How many times nearer a [`close_up`] is.
const NEARER: u32 = 3;

/// People by picture of `input` as `infer` with `options` writes them, on one thread.
pub fn people(input: &Path, options: &[&str]) -> Vec<Vec<Value>> {
    let result = tempfile::tempdir().unwrap();
    let file = result.path().join("people.jsonl");
    let [input, jsonl] = [input, &file].map(|p| p.to_str().unwrap());
    let fixed = [
        "infer",
        "--threads",
        "1",
        "--input",
        input,
        "--jsonl",
        jsonl,
    ];
    let out = output(&[&fixed[..], options].concat());
    assert!(out.status.success(), "{}", stderr(&out));
    let text = std::fs::read_to_string(file).unwrap();
    let frame = |line: &str| serde_json::from_str::<Value>(line).unwrap();
    text.lines()
        .map(|line| frame(line)["people"].as_array().unwrap().clone())
        .collect()
}

/// A person's joints: (u, v, confidence) of `infer`'s, (u, v) of the truth's.
pub fn joints<J: DeserializeOwned>(person: &Value) -> Vec<J> {
    serde_json::from_value(person["joints2d"].clone()).unwrap()
}

/// Stills in a new folder: pictures, and the truth about them.
pub fn rendered(folder: &Path, options: &[&str]) -> (Vec<PathBuf>, Vec<Value>) {
    let fixed = ["synth", "--stills", "--out", folder.to_str().unwrap()];
    let made = output(&[&fixed[..], options].concat());
    assert!(made.status.success(), "{}", stderr(&made));
    let truth = std::fs::read_to_string(folder.join("truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    let frames = truth["frames"].as_array().unwrap().clone();
    let file = |frame: &Value| folder.join(frame["file"].as_str().unwrap());
    (frames.iter().map(file).collect(), frames)
}

/// Head and chest of somebody, as large as the whole picture.
pub fn close_up(picture: &DynamicImage, person: &Value) -> DynamicImage {
    let at = joints::<[f64; 2]>(person);
    let (w, h) = (SIZE.0 / NEARER, SIZE.1 / NEARER);
    let left = (at[1][0] as u32).saturating_sub(w / 2).min(SIZE.0 - w);
    let upper = (at[0][1] as u32).saturating_sub(10).min(SIZE.1 - h);
    picture
        .crop_imm(left, upper, w, h)
        .resize_exact(SIZE.0, SIZE.1, FilterType::CatmullRom)
}
