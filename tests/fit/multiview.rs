//! The check of one view against the others, on a synthetic scene that four cameras see: every figure is known
//! beforehand.

use crate::scene::gauss;
use crate::scene::people::{self, Activity, Person};
use edgecap::camera::{Brown, View};
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::{L_HIP, PELVIS, R_HIP};
use edgecap::lab::eval::multiview::{MultiviewCheck, MultiviewReport};
use edgecap::message::{BodyFrame, Observation, ObservationFrame};
use glam::{DMat3, DVec2, DVec3};
use rand::SeedableRng;
use rand::rngs::SmallRng;

/// Cameras round the middle of the scene, 4.5 m away, upright pictures, with a lens that distorts.
fn views() -> Vec<View> {
    [10.0, 95.0, 190.0, 280.0f64]
        .iter()
        .enumerate()
        .map(|(k, degrees)| {
            let rotation =
                DMat3::from_rotation_x(0.1) * DMat3::from_rotation_y(degrees.to_radians());
            let middle = DVec3::new(0.0, 0.5, 4.0);
            View {
                name: format!("cam{k}"),
                size: [1088, 1920],
                focal: DVec2::new(1680.0, 1684.0),
                centre: DVec2::new(533.0, 948.0),
                distortion: Brown {
                    radial: [-0.046, 0.14, 0.0],
                    tangential: [0.0006, 0.0007],
                },
                rotation,
                position: middle - rotation.transpose() * DVec3::new(0.0, 0.0, 4.5),
            }
        })
        .collect()
}

/// Who tells what is right.
#[derive(Clone, Copy, PartialEq)]
enum Truth {
    OtherViews,
    OtherDetector,
}

/// Runs the check; `pixels`: error per axis of the 2D of the last view; `space`: how far every joint of Stage II but
/// the hips is off, metres. The other detector sees everything exactly.
fn check(truth: Truth, pixels: f64, space: f64) -> MultiviewReport {
    let views = views();
    let legs = people::walk(0.0, 0.7, &[(-0.4, 4.0), (0.4, 4.2), (-0.4, 4.0)]);
    let person = Person::new(3, legs, Activity::Wave).of_height(1.82);
    let mut rng = SmallRng::seed_from_u64(4);
    let mut fitters: Vec<Fitter> = views
        .iter()
        .map(|_| Fitter::new(FitConfig::default()).unwrap())
        .collect();
    let mut check = MultiviewCheck::new(views.clone(), 20.0);
    for k in 0..90u64 {
        let (_, joints) = person.at(k as f64 / 30.0);
        let (mut moment, mut exact) = (Vec::new(), Vec::new());
        for (v, view) in views.iter().enumerate() {
            let mut seen = Observation {
                score: 0.98,
                ..Observation::default()
            };
            let mut told = seen;
            for (out, joint) in told.joints2d.iter_mut().zip(joints) {
                let p = view.project(joint).expect("in front");
                *out = [p.x as f32, p.y as f32, 0.8];
            }
            for (out, joint) in seen.joints2d.iter_mut().zip(joints) {
                let sigma = if v == 3 { pixels } else { 0.0 };
                let noise = DVec2::new(gauss(&mut rng), gauss(&mut rng)) * sigma;
                let p = view.project(joint).expect("in front") + noise;
                *out = [p.x as f32, p.y as f32, 0.8];
            }
            for (j, out) in seen.joints3d.iter_mut().enumerate() {
                let fixed = [R_HIP, L_HIP, PELVIS].contains(&j);
                let off = DVec3::new(gauss(&mut rng), gauss(&mut rng), gauss(&mut rng))
                    .normalize_or_zero()
                    * if fixed { 0.0 } else { space };
                let p = view.rotation * (joints[j] - joints[PELVIS]) + off;
                *out = (p * (1.70 / 1.82)).as_vec3().to_array();
            }
            let mut frame = ObservationFrame {
                sequence: k,
                capture_ns: k * 33_333_333 + 1,
                width: view.size[0],
                height: view.size[1],
                intrinsics: view.intrinsics(),
                count: 2,
                ..ObservationFrame::default()
            };
            // Somebody who is not there, elsewhere in every view, with the better score.
            let mut nobody = seen;
            for j in &mut nobody.joints2d {
                j[0] += 250.0 - 120.0 * v as f32;
                j[1] += 90.0 * v as f32;
            }
            let mut other = frame;
            (other.count, other.people[0]) = (1, told);
            exact.push(other);
            (frame.people[0], frame.people[1]) = (nobody, seen);
            let mut bodies = BodyFrame::default();
            fitters[v].update(&frame, &mut bodies);
            moment.push((frame, bodies));
        }
        match truth {
            Truth::OtherViews => check.add(&moment),
            Truth::OtherDetector => check.add_against(&exact, &moment),
        }
    }
    check.finish()
}

#[test]
fn exact_views_agree() {
    let r = check(Truth::OtherViews, 0.0, 0.0);
    print!("{r}");
    assert_eq!((r.judged, r.triangulated, r.found[0]), (360, 360, 360));
    assert_eq!(
        r.found[1], 360,
        "every view's fit names a clearly seen person at once, and loses them never"
    );
    assert!(r.all_pixels[0].unwrap() < 0.01);
    assert!(r.mpjpe[0].unwrap() < 1e-3 && r.pa_mpjpe[0].unwrap() < 1e-3);
    // The fitted skeleton has not this person's shrugs and tilts.
    assert!(r.all_pixels[1].unwrap() < 25.0);
    assert!(r.mpjpe[1].unwrap() < 0.05);
}

#[test]
fn errors_come_out_as_they_went_in() {
    let r = check(Truth::OtherViews, 8.0, 0.06);
    print!("{r}");
    // One view in four is 8 px off per axis; the others' triangulations suffer where it takes part, and their own 2D
    // not.
    assert_eq!(r.found[0], 360);
    let mpjpe = r.mpjpe[0].unwrap();
    // Two of fourteen joints, the hips, are exact; sizes are made equal, which takes a little away.
    let expected = 0.06 * 12.0 / 14.0;
    assert!((mpjpe - expected).abs() < 0.008, "{mpjpe}");
    assert!(r.pa_mpjpe[0].unwrap() < mpjpe);
    assert!(r.mpjpe[1].unwrap() < mpjpe, "the fit smooths");
    let shoulder = r.pixels[2][0].unwrap();
    assert_eq!(shoulder.1, 360);
    assert!(shoulder.0 > 0.5 && shoulder.0 < 9.4, "{shoulder:?}");
}

#[test]
fn another_detector_is_the_truth_of_every_view() {
    let r = check(Truth::OtherDetector, 8.0, 0.06);
    print!("{r}");
    assert_eq!((r.judged, r.triangulated, r.found[0]), (360, 360, 360));
    assert_eq!(
        (r.pixels[0][0], r.pixels[1][0]),
        (None, None),
        "head top, neck"
    );
    let shoulder = r.pixels[2][0].unwrap();
    assert_eq!(shoulder.1, 360);
    assert!(
        shoulder.0 < 0.01,
        "the view that is off has no part in the truth: {shoulder:?}"
    );
    // Two of twelve joints, the hips, are exact.
    let (mpjpe, expected) = (r.mpjpe[0].unwrap(), 0.06 * 10.0 / 12.0);
    assert!((mpjpe - expected).abs() < 0.008, "{mpjpe}");
}

#[test]
fn who_is_far_off_is_not_found() {
    let r = check(Truth::OtherDetector, 200.0, 0.0);
    print!("{r}");
    assert_eq!(
        (r.triangulated, r.found[0]),
        (360, 270),
        "three views of four"
    );
    assert!(r.mpjpe[0].unwrap() < 1e-3);
}
