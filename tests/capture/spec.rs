//! What a user may name as input.

use edgecap::capture::InputSpec;

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
