//! Photos: damaged ones among others, stills by their bytes, shapes that the lens is not for.

use std::path::{Path, PathBuf};

use super::{SMALL, count, photo};
use crate::program::{assert_fails, edgecap, stderr, stdout, stream};

#[test]
fn one_bad_picture_among_many_is_left_out_and_the_rest_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos_with_a_damaged_one(folder.path());
    let (drawn, lines) = (folder.path().join("drawn"), folder.path().join("b.jsonl"));
    // As of a whole run before, which this one replaces.
    std::fs::write(&lines, "{}\n".repeat(100_000)).unwrap();
    let out = edgecap()
        .args(["run", "--name", &stream("bad")])
        .args(SMALL)
        .arg("--input")
        .arg(&photos)
        .arg("--overlay")
        .arg(&drawn)
        .arg("--jsonl")
        .arg(&lines)
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(65), "{}", stderr(&out));
    let last = stderr(&out).lines().last().unwrap().to_owned();
    assert!(
        last.contains("left out") && last.contains("2.jpg"),
        "{last}"
    );
    assert_eq!(count(&lines), 2);
    let places = format!(" → {}; 2 pictures → {}", lines.display(), drawn.display());
    assert!(stdout(&out).contains(&places), "{}", stdout(&out));
    // Lines say of which picture they are, and nobody is in two of them.
    let text = std::fs::read_to_string(&lines).unwrap();
    let rows: Vec<serde_json::Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let ids = |row: &serde_json::Value| -> Vec<u64> {
        let people = row["people"].as_array().unwrap();
        people.iter().map(|p| p["id"].as_u64().unwrap()).collect()
    };
    for (row, name) in rows.iter().zip(["1.jpg", "3.jpg"]) {
        assert!(row["source"].as_str().unwrap().ends_with(name), "{row}");
        assert!(!ids(row).is_empty(), "{row}");
    }
    assert!(ids(&rows[0]).iter().all(|id| !ids(&rows[1]).contains(id)));
    let mut names: Vec<_> = std::fs::read_dir(drawn)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["1.png", "3.png"]);
}

/// Three photos, of which one is damaged.
fn photos_with_a_damaged_one(folder: &Path) -> PathBuf {
    let photos = folder.join("photos");
    std::fs::create_dir(&photos).unwrap();
    for name in ["1.jpg", "3.jpg"] {
        std::fs::write(photos.join(name), photo()).unwrap();
    }
    std::fs::write(photos.join("2.jpg"), b"\xff\xd8\xff damaged").unwrap();
    photos
}

/// A folder that was read to its end gives a whole record, whatever was left out of it.
#[test]
fn a_bad_picture_leaves_no_older_record_in_place_and_the_new_one_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos_with_a_damaged_one(folder.path());
    let (seen, drawn) = (
        folder.path().join("seen.jsonl"),
        folder.path().join("drawn"),
    );
    std::fs::write(&seen, "{\"a longer line\": 0}\n".repeat(10_000)).unwrap();
    let out = edgecap()
        .args(["infer", "--input"])
        .arg(&photos)
        .arg("--jsonl")
        .arg(&seen)
        .arg("--overlay")
        .arg(&drawn)
        .args(SMALL)
        .output()
        .unwrap();
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(65), "{said}");
    assert_eq!(count(&seen), 2, "{said}");
    assert!(!said.contains("seen-cut"), "{said}");
    let lines: Vec<&str> = said.lines().collect();
    let [.., result, failure] = lines[..] else {
        panic!("{said}")
    };
    let places = format!("→ {}; 2 pictures → {}", seen.display(), drawn.display());
    assert!(result.starts_with("2 frames, 2 with people → "), "{said}");
    assert!(result.ends_with(&places), "{said}");
    assert!(failure.starts_with("edgecap: left out: "), "{said}");
}

/// Of none of them there is a result: what was there stays.
#[test]
fn a_folder_of_bad_pictures_replaces_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos_with_a_damaged_one(folder.path());
    for name in ["1.jpg", "3.jpg"] {
        std::fs::remove_file(photos.join(name)).unwrap();
    }
    std::fs::write(photos.join("4.jpg"), "damaged, too").unwrap();
    let seen = folder.path().join("seen.jsonl");
    std::fs::write(&seen, "{}\n").unwrap();
    let (photos, jsonl) = (photos.to_str().unwrap(), seen.to_str().unwrap());
    let args = ["infer", "--input", photos, "--jsonl", jsonl];
    assert_fails(&[&args[..], &SMALL].concat(), 65, &["left out 2 pictures"]);
    assert_eq!(std::fs::read_to_string(&seen).unwrap(), "{}\n");
}

#[test]
fn a_picture_is_a_still_by_its_bytes_whatever_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let results: Vec<Vec<u8>> = ["a.jpg", "b.jfif", "c"]
        .into_iter()
        .map(|name| {
            let (path, out) = (folder.path().join(name), folder.path().join("out.jsonl"));
            std::fs::write(&path, photo()).unwrap();
            let done = edgecap()
                .args(["run", "--name", &stream("still")])
                .arg("--input")
                .arg(&path)
                .arg("--jsonl")
                .arg(&out)
                .output()
                .unwrap();
            assert!(done.status.success(), "{}", stderr(&done));
            let line: serde_json::Value =
                serde_json::from_slice(&std::fs::read(&out).unwrap()).unwrap();
            serde_json::to_vec(&line["people"]).unwrap()
        })
        .collect();
    assert!(results[0].len() > 100, "somebody is in the picture");
    assert!(results[0] == results[1] && results[1] == results[2]);
}

#[test]
fn photos_of_another_shape_than_the_lens_are_left_out_aloud() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let text = "fx = 90.0\ncx = 47.5\ncy = 31.5\nwidth = 96\nheight = 64\n";
    std::fs::write(at("lens.toml"), text).unwrap();
    std::fs::create_dir(at("photos")).unwrap();
    for (name, (width, height)) in [("1", (64, 64)), ("2", (96, 64)), ("3", (64, 96))] {
        let photo = image::RgbImage::new(width, height);
        photo
            .save(at("photos").join(format!("{name}.png")))
            .unwrap();
    }
    let look = || {
        let looked = edgecap()
            .args(["infer", "--size", "64x64", "--threads", "1", "--input"])
            .arg(at("photos"))
            .arg("--camera")
            .arg(at("lens.toml"))
            .arg("--jsonl")
            .arg(at("seen.jsonl"))
            .output()
            .unwrap();
        (looked.status.code(), stderr(&looked))
    };
    let (code, said) = look();
    assert_eq!(code, Some(65), "{said}");
    assert_eq!(said.matches("another shape").count(), 3, "{said}");
    assert_eq!(said.matches("; skipped").count(), 2, "{said}");
    assert!(said.contains("left out 2 pictures, the first"), "{said}");
    let seen = std::fs::read_to_string(at("seen.jsonl")).unwrap();
    assert_eq!(seen.lines().count(), 1);
    assert!(seen.contains("2.png"), "{seen}");
    // Where it fits none of them, the lens is what is wrong.
    for gone in ["photos/2.png", "seen.jsonl"] {
        std::fs::remove_file(at(gone)).unwrap();
    }
    let (code, said) = look();
    assert_eq!(code, Some(78), "{said}");
    assert!(
        said.contains("edgecap: ") && said.contains("96x64"),
        "{said}"
    );
    assert!(!at("seen.jsonl").exists());
}
