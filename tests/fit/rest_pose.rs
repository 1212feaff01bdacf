//! How far surfaces are apart, against known distances; and how near the mesh body can come to people of `synth`.

use edgecap::body::mesh::{MeshBody, Skin};
use edgecap::lab::multiview::{Bare, Shell, apart};
use edgecap::lab::synth::studio::Studio;
use glam::{Quat, Vec3};
use rayon::prelude::*;

fn mean_body(turn: Quat, shift: Vec3) -> Shell {
    let body = MeshBody::shipped();
    let skin = Skin::new(body, &body.person(&[]));
    let at = skin.rest().map(|v| turn * v + shift).collect();
    Shell::new(at, body.faces().to_vec())
}

/// A ball about the origin.
fn ball(radius: f32) -> Shell {
    const RINGS: u32 = 60;
    let angle = |k: u32| std::f32::consts::PI * k as f32 / RINGS as f32;
    let at = |ring: u32, k: u32| {
        let (t, p) = (angle(ring), 2.0 * angle(k));
        radius * Vec3::new(t.sin() * p.cos(), t.cos(), t.sin() * p.sin())
    };
    let all = (0..=RINGS).flat_map(|r| (0..RINGS).map(move |k| at(r, k)));
    let faces = (0..RINGS * RINGS).flat_map(|a| {
        let next = a - a % RINGS + (a + 1) % RINGS;
        [[a, next, a + RINGS], [next, next + RINGS, a + RINGS]]
    });
    Shell::new(all.collect(), faces.collect())
}

#[test]
fn a_surface_lies_on_itself_wherever_it_was_moved() {
    let (here, there) = (
        mean_body(Quat::IDENTITY, Vec3::ZERO),
        mean_body(Quat::from_rotation_y(0.1), Vec3::new(0.03, -0.02, 0.04)),
    );
    let same = apart(&here, &here).map(|d| 1e3 * d);
    let moved = apart(&there, &here).map(|d| 1e3 * d);
    println!("{same:.3?} {moved:.3?} mm");
    assert!(same.iter().all(|d| *d < 0.01), "{same:?} mm");
    assert!(moved.iter().all(|d| *d < 0.5), "{moved:?} mm");
}

#[test]
fn what_is_larger_stays_as_far_away_as_it_is_larger() {
    let (small, large) = (ball(0.5), ball(0.53));
    for (a, b) in [(&small, &large), (&large, &small)] {
        let mm = apart(a, b).map(|d| 1e3 * d);
        assert!(mm.iter().all(|d| (d - 30.0).abs() < 1.0), "{mm:?} mm");
    }
    let off = small.nearest(Vec3::new(0.9, 0.0, 0.0)) - Vec3::new(0.5, 0.0, 0.0);
    assert!(off.length() < 1e-3, "{off}");
    assert!(small.vertices().len() > 3000);
}

/// What no fit can do better than: the shape that lies nearest to the very skin; and what none does.
#[test]
#[ignore = "prints a table; minutes"]
fn best_shape_in_rest_pose() {
    let people: Vec<Bare> = (1..=5)
        .map(|seed| Studio::new(seed, (64, 48), 2, 1, 2, 30.0))
        .map(|studio| Bare::new(&studio.clip.scene.people[0]))
        .collect();
    let each = people.par_iter().map(|bare| {
        let worth = |betas: &[f64]| bare.apart(betas).iter().sum::<f64>();
        let (mut betas, mut least) = (vec![0.0; 10], worth(&[0.0; 10]));
        for step in [1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.12] {
            for k in 0..betas.len() {
                for by in [step, -step] {
                    let mut tried = betas.clone();
                    tried[k] += by;
                    let now = worth(&tried);
                    if now < least {
                        (betas, least) = (tried, now);
                    }
                }
            }
        }
        [bare.apart(&[]), bare.apart(&betas)]
    });
    let all: Vec<[[f64; 2]; 2]> = each.collect();
    let mean = |k: usize, side: usize| {
        let sum: f64 = all.iter().map(|of| of[k][side]).sum();
        1e3 * sum / all.len() as f64
    };
    for (k, name) in ["mean shape", "best shape"].into_iter().enumerate() {
        let of = all.iter().map(|p| p[k].map(|d| (1e4 * d).round() / 10.0));
        println!(
            "{name}: {:.1} / {:.1} mm, {:?}",
            mean(k, 0),
            mean(k, 1),
            of.collect::<Vec<_>>()
        );
    }
    assert!(mean(1, 0) < mean(0, 0) && mean(1, 1) < mean(0, 1));
}
