//! The weights that may be used commercially, beside the default ones.

use edgecap::engine::Model;

use crate::program::people_in;

const MODEL: &str = "models/open/edgecap-open.ecm";

#[test]
fn say_that_they_are_open_and_carry_their_own_settings() {
    let bytes = std::fs::read(MODEL).unwrap();
    let recorded = include_str!("../../models/open/edgecap-open.ecm.blake3");
    let digest = blake3::hash(&bytes).to_hex();
    assert_eq!(recorded.split_whitespace().next(), Some(&digest[..]));
    let model = Model::from_bytes(&bytes).unwrap();
    let stage2 = model.stage2().unwrap();
    for contract in [&model.contract().common, &stage2.contract.common] {
        let said = &contract.trained_on;
        assert!(said.starts_with("Open data only: "), "{said}");
    }
    let settings = include_str!("../../models/open/association.toml");
    assert_eq!(model.association(), Some(settings));
}

#[test]
fn find_the_people_of_a_photo() {
    let found = people_in("docs/demo.jpg", &["--model", MODEL]);
    assert!((3..=5).contains(&found), "{found} people, of four or five");
}
