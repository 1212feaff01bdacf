//! Prints what each part of the fit is worth: `cargo test --release --test fit_ablation -- --ignored --nocapture`.

mod fit_scene;

use edgecap::fit::FitConfig;
use fit_scene::measure::{line, run};
use fit_scene::{Noise, Scene, people};

#[test]
#[ignore = "prints a table; slow"]
fn quick_look() {
    for seed in [5, 6] {
        for (name, people, frames) in [
            ("everyday", people::everyday(), 600),
            ("crossing", people::crossing(), 900),
            ("wanderers", people::wanderers(300.0, seed), 9000),
        ] {
            let mut scene = Scene::new(people, Noise::REAL, 30.0, seed);
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
}

#[test]
#[ignore = "prints a table; slow"]
fn tuning() {
    let mut variants: Vec<(String, FitConfig)> = vec![("default".into(), FitConfig::default())];
    for temporal in [2.0, 4.0] {
        let mut c = FitConfig::default();
        c.terms.temporal = temporal;
        variants.push((format!("temporal {temporal}"), c));
    }
    for (cut, beta) in [
        (2.0, 2.0),
        (3.0, 3.0),
        (3.0, 6.0),
        (4.0, 4.0),
        (6.0, 3.0),
        (10.0, 6.0),
        (6.0, 12.0),
    ] {
        let mut c = FitConfig::default();
        c.filter2d.min_cutoff = cut;
        c.filter2d.beta = beta;
        c.filter3d = c.filter2d;
        variants.push((format!("filters {cut} {beta}"), c.clone()));
        c.terms.temporal = 2.0;
        variants.push((format!("filters {cut} {beta} temp 2"), c));
    }
    let mut c = FitConfig::default();
    c.filter2d.enabled = false;
    c.filter3d.enabled = false;
    for temporal in [1.0, 2.0, 4.0, 8.0] {
        c.terms.temporal = temporal;
        variants.push((format!("no filters, temp {temporal}"), c.clone()));
    }
    for (name, config) in variants {
        let mut scene = Scene::new(people::everyday(), Noise::REAL, 30.0, 5);
        let report = run(&mut scene, config.clone(), 600, 60, true);
        println!("{}", line(&name, &report));
        let mut scene = Scene::new(people::crossing(), Noise::REAL, 30.0, 5);
        let report = run(&mut scene, config, 450, 60, true);
        println!("{}", line("   crossing", &report));
    }
}

#[test]
#[ignore = "prints a table; slow"]
fn calibration() {
    for (name, people, frames) in [
        ("everyday", people::everyday(), 1500),
        ("crossing", people::crossing(), 900),
        ("wanderers", people::wanderers(120.0, 3), 3600),
    ] {
        let mut scene = Scene::new(people, Noise::REAL, 30.0, 9);
        let r = run(&mut scene, FitConfig::default(), frames, 30, false);
        println!("{name}: claimed → true (share), all joints | not observed");
        for bin in 0..10 {
            println!(
                "  {:.2} → {:.2} ({:6.0}) | {:.2} → {:.2} ({:6.0})",
                r.claimed[bin].get(),
                r.calibration[bin].get(),
                r.claimed[bin].n,
                r.claimed_hidden[bin].get(),
                r.calibration_hidden[bin].get(),
                r.claimed_hidden[bin].n
            );
        }
        for j in 0..21 {
            println!(
                "  joint {j:2} seen II {:5.1} III {:5.1}  hidden II {:5.1} III {:5.1} mm",
                1e3 * r.stage2[j][0].get(),
                1e3 * r.stage3[j][0].get(),
                1e3 * r.stage2[j][1].get(),
                1e3 * r.stage3[j][1].get()
            );
        }
    }
}
