//! Prints what each part of the fit is worth: `cargo test --release --test fit_ablation -- --ignored --nocapture`.

mod fit_scene;

use edgecap::fit::FitConfig;
use fit_scene::measure::{line, run};
use fit_scene::{Noise, Scene, people};

#[test]
#[ignore = "prints a table; slow"]
fn quick_look() {
    for (name, people, frames) in [
        ("everyday", people::everyday(), 600),
        ("crossing", people::crossing(), 900),
        ("wanderers", people::wanderers(300.0, 1), 9000),
    ] {
        let mut scene = Scene::new(people, Noise::REAL, 30.0, 5);
        let report = run(
            &mut scene,
            FitConfig::default(),
            frames,
            30,
            name == "everyday",
        );
        println!("{}", line(name, &report));
    }
}
