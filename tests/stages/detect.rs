//! Association: perfect maps give the people back, bad maps give nothing and never panic.

use crate::detect_maps::{Figure, crowd, render};
use edgecap::detect::{AssociationConfig, Associator, Detection};
use edgecap::engine::{HEAD2D_CHANNELS, HEAD3D_CHANNELS, Maps};
use edgecap::joints::{EVIDENCE_JOINTS, NECK};
use proptest::prelude::*;

/// Mean distance of the joints found, pixels, and how many joints lie further than a cell from the truth.
fn compare(d: &Detection, p: &Figure) -> (f32, usize) {
    let error = |j: usize| {
        let [u, v, c] = d.joints[j];
        if c > 0.0 {
            (u - p.joints[j][0]).hypot(v - p.joints[j][1])
        } else {
            f32::INFINITY
        }
    };
    let good: Vec<f32> = (0..EVIDENCE_JOINTS)
        .map(error)
        .filter(|e| *e < 8.0)
        .collect();
    let mean = good.iter().sum::<f32>() / good.len().max(1) as f32;
    (mean, EVIDENCE_JOINTS - good.len())
}

fn with_neck_at<'a>(found: &'a [Detection], p: &Figure) -> Option<&'a Detection> {
    found.iter().find(|d| {
        let [u, v, _] = d.joints[NECK];
        (u - p.joints[NECK][0]).hypot(v - p.joints[NECK][1]) < 6.0
    })
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 64,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn any_values_pass_without_panic(
        seed in any::<u64>(),
        width in 0_usize..9,
        height in 0_usize..9,
        odd in prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1.0, 1.0]),
    ) {
        use rand::{Rng, SeedableRng};
        let mut rng = rand::rngs::SmallRng::seed_from_u64(seed);
        let mut maps = Maps::new(width, height);
        for v in maps.head2d.iter_mut().chain(&mut maps.head3d) {
            *v = if rng.random_bool(0.2) { odd } else { rng.random_range(-1.0..1.0) };
        }
        let config = AssociationConfig { min_joints: 1, ..Default::default() };
        let mut associator = Associator::new(config);
        for d in associator.associate(&maps) {
            prop_assert!(d.score.is_finite());
            prop_assert!(d.joints.iter().flatten().all(|v| v.is_finite()));
            prop_assert!(d.encodings.iter().flatten().all(|v| v.is_finite()));
        }
    }
}

/// How many joints of how many people are right is a matter of figures, which hold for these crowds: another one may
/// hold people whom nobody can tell apart.
#[test]
fn perfect_maps_give_the_people_back() {
    for seed in 0..64 {
        let people = crowd(1 + (seed % 8) as usize, 1000 + seed);
        let maps = render(&people);
        let mut associator = Associator::new(AssociationConfig::default());
        let found = associator.associate(&maps);
        assert_eq!(found.len(), people.len(), "crowd {seed}");
        for p in &people {
            let d = with_neck_at(found, p);
            let d = d.unwrap_or_else(|| panic!("crowd {seed}: nobody at {:?}", p.joints[NECK]));
            let (mean, wrong) = compare(d, p);
            // Where two trunks lie on each other the fields cannot tell whose hip is whose: at most one leg is
            // exchanged.
            assert!(
                wrong <= 3,
                "crowd {seed}: {wrong} joints wrong at {:?}",
                p.joints[NECK]
            );
            assert!(mean < 1.5, "crowd {seed}: mean error {mean} px");
        }
        assert!(found.windows(2).all(|w| w[0].score >= w[1].score));
        assert_eq!(associator.without_neck(), 0, "crowd {seed}");
    }
}

#[test]
fn of_two_trunks_in_line_the_lengths_decide() {
    // The hips of the upper person lie on the trunk of the lower one: both fields hold along both lines.
    let people = crowd(4, 3550019167088140234);
    let mut associator = Associator::new(AssociationConfig::default());
    let found = associator.associate(&render(&people));
    for p in &people {
        let d = with_neck_at(found, p).expect("the person is found");
        let (_, wrong) = compare(d, p);
        assert_eq!(wrong, 0, "of the person at {:?}", p.joints[NECK]);
    }
}

#[test]
fn hardly_a_joint_goes_to_the_wrong_person() {
    let mut associator = Associator::new(AssociationConfig::default());
    let (mut joints, mut wrong) = (0, 0);
    for seed in 0..150 {
        let people = crowd(1 + (seed % 8) as usize, seed);
        let found = associator.associate(&render(&people));
        for p in &people {
            joints += EVIDENCE_JOINTS;
            wrong += with_neck_at(found, p).map_or(EVIDENCE_JOINTS, |d| compare(d, p).1);
        }
    }
    assert!(joints > 8000);
    assert!(wrong * 500 <= joints, "{wrong} of {joints} joints");
}

#[test]
fn constant_maps_hold_nobody() {
    for value in [0.0, 1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut maps = Maps::new(64, 40);
        maps.head2d.fill(value);
        maps.head3d.fill(value);
        let mut associator = Associator::new(AssociationConfig::default());
        // A plateau is one peak a joint: all joints in one cell are nobody either.
        let found = associator.associate(&maps).len();
        assert_eq!(found, 0, "value {value}");
    }
}

#[test]
fn encodings_are_those_of_the_joint_s_own_person() {
    let people = crowd(4, 7);
    let maps = render(&people);
    let mut associator = Associator::new(AssociationConfig::default());
    let found = associator.associate(&maps);
    let mut read = 0;
    for (who, p) in people.iter().enumerate() {
        let d = with_neck_at(found, p).expect("the person is found");
        for (j, e) in d.encodings.iter().enumerate() {
            assert_eq!(e.len(), HEAD3D_CHANNELS);
            let owner = e[0] - 1.0;
            // Where another joint lies nearer, the cell is his.
            let contested = people.iter().enumerate().any(|(k, q)| {
                k != who
                    && q.joints
                        .iter()
                        .any(|b| (b[0] - p.joints[j][0]).hypot(b[1] - p.joints[j][1]) < 24.0)
            });
            if !contested {
                assert_eq!(owner, who as f32, "joint {j}");
                read += 1;
            }
        }
    }
    assert!(read > 20, "only {read} joints could be checked");
}

#[test]
fn a_person_without_neck_is_counted_and_left_out() {
    let people = crowd(2, 3);
    let mut maps = render(&people);
    let neck = people[0].joints[NECK];
    for cell in 0..maps.width * maps.height {
        let (u, v) = (
            8.0 * (cell % maps.width) as f32 + 3.5,
            8.0 * (cell / maps.width) as f32 + 3.5,
        );
        if (u - neck[0]).hypot(v - neck[1]) < 40.0 {
            maps.head2d[cell * HEAD2D_CHANNELS + NECK] = 0.0;
        }
    }
    let mut associator = Associator::new(AssociationConfig::default());
    let found = associator.associate(&maps).len();
    assert_eq!((found, associator.without_neck()), (1, 1));
}

#[test]
fn a_neck_seen_twice_is_one_person() {
    let people = crowd(1, 11);
    let mut maps = render(&people);
    let neck = people[0].joints[NECK];
    let (column, row) = (
        ((neck[0] - 3.5) / 8.0).round() as usize,
        ((neck[1] - 3.5) / 8.0).round() as usize,
    );
    let value = |c: usize, r: usize| (r * 64 + c) * HEAD2D_CHANNELS + NECK;
    let (from, beside) = (value(column, row), value(column + 1, row));
    maps.head2d[from] = 1.0;
    maps.head2d[beside] = 0.6;
    maps.head2d[value(column + 2, row)] = 0.9;
    let config = AssociationConfig {
        min_joints: 1,
        merge_distance: 0.2,
        ..Default::default()
    };
    let mut associator = Associator::new(config);
    let found = associator.associate(&maps);
    assert_eq!(found.len(), 1);
    assert!(found[0].joints.iter().all(|j| j[2] > 0.0));
}

#[test]
fn a_limb_to_a_far_stranger_is_not_taken() {
    // The right wrist is missing; a wrist twelve cells away, joined by a perfect field, is no wrist of this person.
    let people = crowd(1, 5);
    let p = &people[0];
    let mut maps = render(&people);
    let mut far = p.clone();
    let elbow = p.joints[3];
    let side = if elbow[0] > 256.0 { -1.0 } else { 1.0 };
    far.joints[4] = [elbow[0] + side * p.stature * 0.9, elbow[1]];
    let wrong = render(&[far]);
    for cell in 0..maps.width * maps.height {
        let i = cell * HEAD2D_CHANNELS;
        maps.head2d[i + 4] = wrong.head2d[i + 4];
        for k in 0..2 {
            let channel = i + EVIDENCE_JOINTS + 2 * 3 + k;
            maps.head2d[channel] = wrong.head2d[channel];
        }
    }
    let mut associator = Associator::new(AssociationConfig::default());
    let found = associator.associate(&maps);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].joints[4], [0.0; 3]);
    assert_eq!(found[0].joints.iter().filter(|j| j[2] > 0.0).count(), 13);
}

#[test]
fn results_do_not_depend_on_earlier_frames() {
    let (busy, calm) = (render(&crowd(8, 1)), render(&crowd(2, 2)));
    let mut reused = Associator::new(AssociationConfig::default());
    reused.associate(&busy);
    let again = reused.associate(&calm).to_vec();
    let fresh = Associator::new(AssociationConfig::default())
        .associate(&calm)
        .to_vec();
    assert_eq!(again, fresh);
}
