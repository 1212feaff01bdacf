//! The sample of the settings: right as it stands, and with every key switched on.

use super::config;
use crate::program::{self, stdout};

const SAMPLE: &str = include_str!("../../../deploy/edgecap.toml");

/// The sample with everything that is commented out switched on.
fn whole_sample() -> String {
    let setting = |line: &str| {
        let rest = line.strip_prefix('#')?;
        rest.starts_with(|c: char| c.is_ascii_lowercase())
            .then(|| rest.to_owned())
    };
    SAMPLE
        .lines()
        .map(|line| setting(line).unwrap_or_else(|| line.to_owned()) + "\n")
        .collect()
}

#[test]
fn the_sample_is_right_and_holds_every_key() {
    let printed = |text: &str| {
        let out = config("print", text, &[]);
        assert!(out.status.success(), "{}", program::stderr(&out));
        stdout(&out)
    };
    // What is printed names every key that there is, those without a value behind '#'.
    let keys = |text: &str| -> Vec<String> {
        let mut section = String::new();
        let mut keys: Vec<String> = text
            .lines()
            .filter_map(|line| {
                if line.starts_with('[') {
                    section = line.trim_matches(['[', ']']).to_owned();
                    return None;
                }
                let key = line.trim_start_matches('#').split(" =").next()?;
                let is_key = !key.is_empty()
                    && key
                        .chars()
                        .all(|c| c.is_ascii_lowercase() || "_0123456789".contains(c));
                (is_key && line.contains(" =")).then(|| format!("{section}.{key}"))
            })
            .collect();
        keys.sort();
        keys
    };
    let bare = printed(SAMPLE);
    assert_eq!(
        keys(SAMPLE),
        keys(&bare),
        "deploy/edgecap.toml must hold exactly the keys of the verbs' options"
    );
    // What stands behind '#' is right, too, and where there is a default it is that.
    let whole = whole_sample()
        .replace("fit = \"fit.toml\"\n", "")
        .replace("\nheight =", "\n#height =")
        .replace("\nfloor =", "\n#floor =")
        .replace("\nground =", "\n#ground =");
    let value = |line: &str| {
        line.rsplit_once(" # ")
            .map(|(value, _)| value.trim().to_owned())
    };
    let of = |text: &str| -> Vec<String> {
        let fit = text.split("\n[fit]").nth(1).unwrap();
        let fit = fit.split("\n[metrics]").next().unwrap();
        fit.lines().filter_map(value).collect()
    };
    assert_eq!(of(&printed(&whole)), of(&bare));
    let out = config(
        "check",
        &whole_sample()
            .replace("fit = \"fit.toml\"\n", "")
            .replace("model =", "#")
            .replace("stage2 =", "#")
            // It excludes the size.
            .replace("\nquality =", "\n#quality =")
            .replace("\ncalibration =", "\n#calibration ="),
        &[],
    );
    assert!(out.status.success(), "{}", program::stderr(&out));
}
