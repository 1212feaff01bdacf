//! How near the truth bodies are, and whose they are.

use edgecap::joints::{BODY_JOINTS, L_ANKLE, L_FOOT_TIP, PELVIS};
use edgecap::lab::multiview::own::{Walker, observe, own, ring, steady};
use edgecap::lab::multiview::{Line, TablesOptions, Trial, tables};
use edgecap::lab::synth::detector::{ARMS, Flaws, LEGS, exchange};
use edgecap::message::JointState;
use edgecap::multiview::{MultiviewFit, MultiviewOptions, bodies};
use glam::DVec3;

fn fitted(trial: &Trial, paths: bool) -> MultiviewFit {
    let options = MultiviewOptions {
        rate: trial.rate,
        paths,
        hierarchy: true,
    };
    trial.fit(options, None, &|_| ())
}

/// Mean distance of evidence joints, and of the rest meshes' vertices without their offset, millimetres.
fn errors(trial: &Trial, found: &MultiviewFit) -> (f64, f64) {
    let errors = trial.errors(found);
    let shape = errors.shape.expect("of the same model");
    (1e3 * errors.joints, 1e3 * shape)
}

#[test]
fn what_is_seen_exactly_is_found() {
    let trial = own(1, 3, 10, Flaws::NONE);
    let found = fitted(&trial, false);
    assert_eq!((found.people.len(), found.people[0].frames.len()), (1, 10));
    let (joints, shape) = errors(&trial, &found);
    assert!(
        joints < 8.0 && shape < 12.0,
        "{joints:.1} mm, shape {shape:.1} mm"
    );
}

#[test]
fn joints_that_no_view_tells_are_seen_where_the_joint_before_them_is() {
    let trial = own(1, 3, 3, Flaws::NONE);
    let mut found = fitted(&trial, false);
    let person = &mut found.people[0];
    let moments = person.frames.iter_mut().map(|f| &mut f.moment);
    for sight in moments.flat_map(|m| m.sights.iter_mut().flatten()) {
        sight.rays[L_ANKLE] = None;
    }
    let bodies = bodies(person, 1.7, trial.rate);
    assert_eq!(bodies.len(), 3);
    for (frame, body) in bodies {
        let unseen = |j: &usize| body.joint_states[*j] != JointState::OBSERVED;
        let unseen: Vec<usize> = (0..BODY_JOINTS).filter(unseen).collect();
        assert_eq!(unseen, [L_ANKLE, L_FOOT_TIP], "frame {frame}");
        assert!(body.confidence[L_FOOT_TIP] < body.confidence[PELVIS]);
    }
}

#[test]
fn a_detector_s_mistakes_are_outvoted() {
    let trial = own(2, 3, 40, steady(2));
    let (joints, shape) = errors(&trial, &fitted(&trial, true));
    println!("joints {joints:.1} mm, shape {shape:.1} mm");
    assert!(
        joints < 35.0 && shape < 20.0,
        "{joints:.1} mm, shape {shape:.1} mm"
    );
    let mut exchanged = trial.clone();
    for views in exchanged.seen.iter_mut().skip(10).take(12) {
        for seen in &mut views[0] {
            exchange(seen, LEGS);
        }
    }
    let found = fitted(&exchanged, true);
    let (healed, _) = errors(&exchanged, &found);
    let limbs: usize = found.people[0].frames.iter().map(|f| f.moment.healed).sum();
    println!("legs of one view exchanged in 30 %: {healed:.1} mm, {limbs} healed");
    assert!(
        healed < 1.1 * joints + 1.0,
        "{healed:.1} mm with exchanges, {joints:.1} mm without"
    );
}

/// With errors as measured, which stay for a second and exchange limbs themselves, in frames here and there.
#[test]
fn exchanges_are_healed_whatever_the_detector() {
    let trial = own(3, 3, 40, Flaws::MEASURED);
    let (joints, _) = errors(&trial, &fitted(&trial, true));
    let mut exchanged = trial.clone();
    for (k, views) in exchanged.seen.iter_mut().enumerate() {
        if k * 7 % 10 < 3 {
            for seen in &mut views[0] {
                exchange(seen, ARMS);
                exchange(seen, LEGS);
            }
        }
    }
    let (healed, _) = errors(&exchanged, &fitted(&exchanged, true));
    println!("{healed:.1} mm with exchanges, {joints:.1} mm without");
    assert!(healed < 1.05 * joints, "{healed} mm, not {joints} mm");
}

#[test]
fn everyone_keeps_their_identity() {
    let places = [
        DVec3::new(-0.9, 0.0, 0.0),
        DVec3::new(0.9, 0.0, 0.4),
        DVec3::new(0.0, 0.0, -1.1),
    ];
    let people: Vec<Walker> = (0..3)
        .map(|k| Walker::new(20, 10 + k, places[k as usize]))
        .collect();
    let views = ring(4);
    let trial = Trial {
        seen: observe(&views, &people, steady(3), 3),
        views,
        ..own(3, 1, 1, Flaws::NONE)
    };
    let found = fitted(&trial, false);
    assert_eq!(found.people.len(), 3);
    let mut taken = Vec::new();
    for p in &found.people {
        assert_eq!(p.frames.len(), 20, "person {}", p.id);
        let nearest = |f: &edgecap::multiview::PersonFrame| {
            let at = f.body.pose.pelvis;
            let off = |k: usize| people[k].poses[f.frame].pelvis.distance(at);
            (0..3)
                .min_by(|a, b| off(*a).total_cmp(&off(*b)))
                .expect("three people")
        };
        let who: Vec<usize> = p.frames.iter().map(nearest).collect();
        assert!(
            who.iter().all(|w| *w == who[0]),
            "person {} changes: {who:?}",
            p.id
        );
        taken.push(who[0]);
    }
    taken.sort_unstable();
    assert_eq!(taken, [0, 1, 2]);
}

/// The experiments of `eval --multiview`, few of them: every row is there, and in the direction in which it should be.
#[test]
#[ignore = "long: minutes"]
fn long_tables_of_views_and_paths() {
    let tables = tables(
        TablesOptions {
            seeds: 1,
            frames: 24,
        },
        &|_, _| (),
    );
    println!("{tables}");
    let at = |views: usize, paths: bool| {
        let of = |l: &&Line| l.views == views && l.paths == paths && l.hierarchy && !l.masks;
        tables.synth.iter().find(of).unwrap().errors
    };
    assert_eq!((tables.synth.len(), tables.model.len()), (24, 8));
    for paths in [false, true] {
        let joints = [1, 2, 3, 4].map(|views| at(views, paths).joints);
        assert!(
            joints.is_sorted_by(|fewer, more| fewer > more),
            "{joints:?}"
        );
    }
    for views in [1, 2, 3, 4] {
        let [every_frame, smooth] = [false, true].map(|paths| at(views, paths).joints);
        assert!(
            smooth < every_frame,
            "{views} views: {smooth}, {every_frame}"
        );
    }
    for line in tables.model.iter().chain(&tables.exchanged) {
        assert!(
            line.errors.found > 0.95 && line.errors.joints < 0.04,
            "{line:?}"
        );
    }
    assert!(tables.times.is_some());
}
