//! `edgecap.toml`: mistakes with their places, where the file is found, what overrides what, how a run or `fit`
//! takes it.

mod check;
mod found;
mod overrides;
mod run;
mod sample;

use std::process::Output;

use crate::program::{assert_fails, edgecap};

/// `edgecap config …` with this text as the file.
fn config(verb: &str, text: &str, more: &[&str]) -> Output {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("edgecap.toml");
    std::fs::write(&file, text).unwrap();
    let config = ["config", verb, "--config", file.to_str().unwrap()];
    edgecap().args(config).args(more).output().unwrap()
}

#[test]
fn what_config_can_do_is_listed_where_nothing_is_asked_of_it() {
    let words = ["requires a subcommand", "check, print, sample"];
    assert_fails(&["config"], 64, &words);
}
