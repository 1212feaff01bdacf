//! Prints what each part of the fit is worth: `cargo test --release --test fit -- ablation --ignored --nocapture`; with
//! `PROFILE=measured` under the errors that were measured on rendered pictures.

use crate::scene::measure::{Report, all, line, run};
use crate::scene::{Noise, Scene, people};
use edgecap::fit::FitConfig;

/// The errors asked for.
fn profile() -> Noise {
    match std::env::var("PROFILE").as_deref() {
        Ok("measured") => Noise::MEASURED,
        Ok("assumed") | Err(_) => Noise::REAL,
        Ok(other) => panic!("PROFILE={other}: expected assumed or measured"),
    }
}

#[test]
#[ignore = "prints a table; slow"]
fn quick_look() {
    for seed in [5, 6] {
        for (name, people, frames) in [
            ("everyday", people::everyday(), 600),
            ("crossing", people::crossing(), 900),
            ("wanderers", people::wanderers(300.0, seed), 9000),
        ] {
            let mut scene = Scene::new(people, profile(), 30.0, seed);
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

/// A name and what it changes in the defaults.
type Variant = (&'static str, fn(&mut FitConfig));

const VARIANTS: &[Variant] = &[
    ("everything", |_| {}),
    ("without 1€ 2D", |c| c.filter2d.enabled = false),
    ("without 1€ 3D", |c| c.filter3d.enabled = false),
    ("without both 1€", |c| {
        c.filter2d.enabled = false;
        c.filter3d.enabled = false;
    }),
    ("1€ as in the paper", |c| {
        (
            c.filter2d.min_cutoff,
            c.filter2d.beta,
            c.filter2d.derivative_cutoff,
        ) = (1.7, 0.3, 1.0);
        (
            c.filter3d.min_cutoff,
            c.filter3d.beta,
            c.filter3d.derivative_cutoff,
        ) = (0.8, 0.4, 1.0);
    }),
    ("without E3D", |c| c.terms.position = 0.0),
    ("without E2D", |c| c.terms.reprojection = 0.0),
    ("without Etemp", |c| c.terms.temporal = 0.0),
    ("without contact", |c| c.terms.contact = 0.0),
];

#[test]
#[ignore = "prints a table; slow"]
fn ablation() {
    println!(
        "| variant | II seen | III seen | II hidden | III hidden | missed | jitter II → III | lag, frames | slide, m/s | root, mm | depth, % |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    let only = std::env::var("ONLY").ok();
    let mut by_joint = None;
    for (name, change) in VARIANTS
        .iter()
        .filter(|v| only.as_ref().is_none_or(|o| v.0.contains(o)))
    {
        let mut config = FitConfig::default();
        change(&mut config);
        let mut total = Report::default();
        for (cast, frames, seed) in [
            (people::everyday(), 600, 5),
            (people::crossing(), 600, 5),
            (people::wanderers(60.0, 2), 1200, 2),
        ] {
            let mut scene = Scene::new(cast, profile(), 30.0, seed);
            total.merge(&run(&mut scene, config.clone(), frames, 60, true));
        }
        println!(
            "| {name} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} → {:.1} | {:+.1} | {:.2} → {:.2} | {:.0} | {:.1} |",
            1e3 * all(&total.stage2, Some(0)),
            1e3 * all(&total.stage3, Some(0)),
            1e3 * all(&total.stage2, Some(1)),
            1e3 * all(&total.stage3, Some(1)),
            1e3 * total.predicted.get(),
            total.jitter2.get(),
            total.jitter3.get(),
            Report::lag_frames(&total.lag3) - Report::lag_frames(&total.lag2),
            total.sliding2.get(),
            total.sliding3.get(),
            1e3 * total.root_known.get(),
            100.0 * total.depth_known.get(),
        );
        by_joint.get_or_insert(total);
    }
    let total = by_joint.expect("at least one variant");
    println!("\n| joint | II seen | III seen | II hidden | III hidden |\n|---|---|---|---|---|");
    for (j, name) in edgecap::joints::JOINT_NAMES.iter().enumerate() {
        println!(
            "| {name} | {:.1} | {:.1} | {:.1} | {:.1} |",
            1e3 * total.stage2[j][0].get(),
            1e3 * total.stage3[j][0].get(),
            1e3 * total.stage2[j][1].get(),
            1e3 * total.stage3[j][1].get(),
        );
    }
}
