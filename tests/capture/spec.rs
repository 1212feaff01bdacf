//! What a user may name as input.

use std::path::PathBuf;

use edgecap::capture::{InputSpec, OpenOptions, open};

#[test]
fn words_become_inputs() {
    for (text, spec) in [
        ("camera", InputSpec::FirstCamera),
        ("-", InputSpec::Stdin),
        ("demo", InputSpec::Demo),
        ("./demo", InputSpec::Path("./demo".into())),
        ("/dev/video3", InputSpec::Path("/dev/video3".into())),
    ] {
        assert_eq!(text.parse::<InputSpec>().unwrap(), spec);
        assert_eq!(spec.to_string(), text);
    }
}

/// A script's variable that nobody has set.
#[test]
fn an_input_without_a_name_is_told() {
    let nameless = InputSpec::Path(PathBuf::new());
    let error = open(&nameless, &OpenOptions::default()).err().unwrap();
    assert_eq!(error.exit_code(), 66);
    let error = error.to_string();
    assert!(error.contains("expected a path, found none"), "{error}");
}
