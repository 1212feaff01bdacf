//! How near the truth people are, in which pose, and how they are published.

use std::collections::BTreeSet;

use edgecap::body::skeleton::{Pose, Posed, Skeleton, rotation_vector};
use edgecap::message::{BodyState, JointState};
use glam::{DQuat, DVec3};

use super::{NOISY, of_one, run, walker};
use crate::scene::people::{Activity, Person, walk};
use crate::scene::ring::{Spoil, error, views};

/// Six who walk, wave and stand within two metres of the middle.
fn six() -> Vec<Person> {
    let still = |x, z| walk(0.0, 1.0, &[(x, z), (x, z)]);
    vec![
        walker(1),
        Person::new(2, still(-1.5, 4.4), Activity::Wave),
        Person::new(3, still(1.5, 4.0), Activity::Reach),
        Person::new(4, still(0.2, 6.0), Activity::Stand),
        Person::new(
            5,
            walk(1.0, 0.9, &[(1.2, 5.4), (-1.2, 5.6), (1.0, 5.3)]),
            Activity::Stand,
        ),
        Person::new(6, still(-0.9, 2.6), Activity::Squat),
    ]
}

#[test]
fn exact_views_give_the_truth_and_the_stature() {
    let person = walker(3).of_height(1.86);
    for count in 2..=4 {
        let views = views(count);
        let shutters = vec![(30.0, 0.0); count];
        let frames = run(
            &views,
            &shutters,
            std::slice::from_ref(&person),
            4.0,
            &|_, _| Some(Spoil::default()),
        );
        let off = of_one(&frames, &person);
        let (_, last) = &frames[frames.len() - 1];
        let body = &last.bodies[0];
        println!("{count} views: {:.1} mm, {:.3} m", 1e3 * off, body.height);
        // Shoulders that shrug and a head that tilts by 2 cm are none of the skeleton's.
        assert!(off < 0.035, "{count} views: {off}");
        assert!(
            (body.height - 1.86).abs() < 0.03,
            "{count} views: {}",
            body.height
        );
        assert_eq!(body.state, BodyState::TRACKED);
        assert!(body.joint_states.iter().all(|s| *s == JointState::OBSERVED));
        assert!(
            last.world.is_known(),
            "cameras that hang level tell what is up"
        );
        let up = last.world.direction([0.0, -1.0, 0.0]);
        assert!((up[1] - 1.0).abs() < 1e-5, "{up:?}");
    }
}

#[test]
fn cameras_of_other_rates_and_times_with_noise_agree() {
    let person = walker(4);
    let shutters = [(30.0, 0.0), (25.0, 0.011), (29.0, 0.007), (20.0, 0.023)];
    for count in [2, 4] {
        let views = views(count);
        let frames = run(
            &views,
            &shutters[..count],
            std::slice::from_ref(&person),
            5.0,
            &|_, _| Some(NOISY),
        );
        let off = of_one(&frames, &person);
        println!("{count} views with noise: {:.1} mm", 1e3 * off);
        assert!(off < [0.06, 0.045][count / 4], "{count} views: {off}");
    }
}

#[test]
fn six_people_keep_their_identities_before_four_cameras() {
    let people = six();
    let views = views(4);
    let shutters = [(15.0, 0.0), (15.0, 0.01), (15.0, 0.02), (15.0, 0.03)];
    let frames = run(&views, &shutters, &people, 6.0, &|_, _| Some(NOISY));
    let mut owners: Vec<Option<u32>> = vec![None; people.len()];
    let (mut right, mut all) = (0, 0);
    let mut sum = 0.0;
    for (t, frame) in frames.iter().filter(|(t, _)| *t > 1.5) {
        for (person, owner) in people.iter().zip(&mut owners) {
            all += 1;
            let near = frame
                .bodies()
                .iter()
                .map(|b| (error(&b.joints3d, person, *t), b.id))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((off, id)) = near.filter(|(off, _)| *off < 0.2) else {
                continue;
            };
            if *owner.get_or_insert(id) == id {
                right += 1;
                sum += off;
            }
        }
    }
    let ids: BTreeSet<u32> = frames
        .iter()
        .flat_map(|(_, f)| f.bodies().iter().map(|b| b.id))
        .collect();
    println!(
        "{right} of {all} right, {:.1} mm, identities {ids:?}",
        1e3 * sum / f64::from(right)
    );
    assert!(
        f64::from(right) >= 0.98 * f64::from(all),
        "{right} of {all}"
    );
    assert_eq!(ids.len(), 6, "{ids:?}");
}

#[test]
fn rotation_vectors_of_the_pelvis_follow_each_other_without_a_leap() {
    let person = walker(6);
    let shutters = [(30.0, 0.0); 3];
    let frames = run(
        &views(3),
        &shutters,
        std::slice::from_ref(&person),
        6.0,
        &|_, _| Some(Spoil::default()),
    );
    let mut last: Option<(DVec3, DQuat)> = None;
    let mut leaps = 0;
    for (t, frame) in &frames {
        for body in frame.bodies() {
            let turn = DVec3::from_array([3, 4, 5].map(|k| f64::from(body.angles[k])));
            let q = DQuat::from_array(body.orientation.map(f64::from));
            if let Some((from, before)) = last.replace((turn, q)) {
                let step = turn.distance(from);
                assert!(step < 1.5, "{t:.2} s: from {from} to {turn}");
                let shortest = rotation_vector(q).distance(rotation_vector(before));
                leaps += u32::from(shortest > 4.0);
            }
        }
    }
    assert!(leaps > 0, "the shortest ones do not leap here");
}

#[test]
fn angles_and_lengths_give_the_joints() {
    let person = walker(8);
    let frames = run(
        &views(3),
        &[(30.0, 0.0); 3],
        std::slice::from_ref(&person),
        2.0,
        &|_, _| Some(NOISY),
    );
    let body = &frames[frames.len() - 1].1.bodies[0];
    let a = body.angles.map(f64::from);
    let pose = Pose {
        position: DVec3::new(a[0], a[1], a[2]),
        rotation: DQuat::from_scaled_axis(DVec3::new(a[3], a[4], a[5])),
        angles: std::array::from_fn(|k| a[6 + k]),
    };
    let mut posed = Posed::default();
    Skeleton::builtin().pose(&pose, &body.bone_lengths.map(f64::from), &mut posed);
    for (p, q) in posed.joints.iter().zip(body.joints3d) {
        assert!(p.distance(DVec3::from(q.map(f64::from))) < 1e-4);
    }
    assert!(body.velocity.iter().all(|v| v.abs() < 3.0));
}
