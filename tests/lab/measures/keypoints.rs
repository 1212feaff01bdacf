//! Measures in the picture: OKS, average precision, PCK.

use edgecap::lab::eval::{ImageOks, JointSet, Pck, average_precision, oks};

use super::{exact, person};
use crate::near;

#[test]
fn oks_is_the_mean_of_the_joints_gaussians() {
    let truth = person(10_000.0);
    near(oks(&truth, &exact(), JointSet::All), 1.0);
    // A right ankle 17.8 px off lies one constant (k s = 2 · 0.089 · 100) away: exp(−½).
    let mut off = exact();
    off[10][0] += 17.8;
    near(
        oks(&truth, &off, JointSet::All),
        (13.0 + (-0.5_f64).exp()) / 14.0,
    );
    near(
        oks(&truth, &off, JointSet::Shared),
        (11.0 + (-0.5_f64).exp()) / 12.0,
    );
    // Head and neck are not shared with COCO.
    let mut headless = exact();
    headless[0] = [0.0; 3];
    headless[1] = [0.0; 3];
    near(oks(&truth, &headless, JointSet::Shared), 1.0);
    near(oks(&truth, &headless, JointSet::All), 12.0 / 14.0);
    // A joint that was not seen counts where it is expected.
    let mut expected = exact();
    expected[10] = [off[10][0], off[10][1], 0.0];
    near(
        oks(&truth, &expected, JointSet::All),
        oks(&truth, &off, JointSet::All),
    );
    // Unlabelled points do not count.
    let mut partly = truth.clone();
    for k in partly.points.iter_mut().skip(7) {
        k.visibility = 0;
    }
    near(oks(&partly, &off, JointSet::All), 1.0);
}

fn image(scores: &[f64], oks: &[&[f64]], ignored: &[bool]) -> ImageOks {
    ImageOks {
        scores: scores.to_vec(),
        ignored: ignored.to_vec(),
        crowd: vec![false; ignored.len()],
        excused: vec![false; scores.len()],
        oks: oks.iter().map(|r| r.to_vec()).collect(),
    }
}

#[test]
fn average_precision_follows_coco() {
    // Two people; the best prediction is right up to OKS 0.90, the second is nobody, the third right up to 0.60.
    let i = image(
        &[0.9, 0.8, 0.7],
        &[&[0.92, 0.0], &[0.0, 0.1], &[0.0, 0.62]],
        &[false, false],
    );
    let ap = average_precision(std::slice::from_ref(&i));
    // At 0.50–0.60 the curve is (½, 1), (½, ½), (1, ⅔): recalls 0–0.50 have precision 1, the 50 above ⅔. At 0.65–0.90
    // only the first is right: 51 of 101. At 0.95 nothing is.
    let both = (51.0 + 50.0 * 2.0 / 3.0) / 101.0;
    let one = 51.0 / 101.0;
    near(ap.ap50, both);
    near(ap.ap75, one);
    near(ap.ap, (3.0 * both + 6.0 * one) / 10.0);
    near(ap.ar, (3.0 * 1.0 + 6.0 * 0.5) / 10.0);
    assert_eq!(ap.people, 2);
    // An ignored person takes his prediction out of the count: then nothing false comes before the second person.
    let i = image(
        &[0.9, 0.8, 0.7],
        &[&[0.92, 0.0, 0.0], &[0.0, 0.1, 0.8], &[0.0, 0.62, 0.0]],
        &[false, false, true],
    );
    near(average_precision(&[i]).ap50, 1.0);
    // So does being excused, but whoever is right is.
    let mut i = image(
        &[0.9, 0.8, 0.7],
        &[&[0.92, 0.0], &[0.0, 0.1], &[0.0, 0.62]],
        &[false, false],
    );
    i.excused = vec![true; 3];
    near(average_precision(&[i]).ap50, 1.0);
    near(average_precision(&[]).ap, -1.0);
}

#[test]
fn every_person_is_claimed_once() {
    let i = image(&[0.9, 0.8], &[&[0.9], &[0.97]], &[false]);
    // The surer prediction takes the person although the other fits better; the other is false, after full recall. At
    // 0.95 it is the other way round, and what is right comes second.
    let ap = average_precision(&[i]);
    near(ap.ap50, 1.0);
    near(ap.ap, (9.0 + 0.5) / 10.0);
    near(ap.ar, 1.0);
}

#[test]
fn pck_counts_joints_within_a_fifth_of_the_torso() {
    // Left shoulder (50, 25) to right hip (80, 40): √1125 = 33.54 px, so the radius is 6.708 px.
    let truth = person(1.0);
    let mut predicted = exact();
    predicted[3][0] += 6.7;
    predicted[4][0] += 6.8;
    predicted[7] = [0.0; 3];
    predicted[9][2] = 0.0;
    let mut pck = Pck::new(0.2);
    assert!(pck.add(&truth, Some(&predicted)));
    near(pck.mean(), 12.0 / 14.0);
    assert!(pck.add(&truth, None));
    near(pck.mean(), 12.0 / 28.0);
    let joint = pck.per_joint();
    assert_eq!(
        (joint[3], joint[4], joint[7]),
        (Some(0.5), Some(0.0), Some(0.0))
    );
    assert_eq!(pck.people(), 2);
    let mut no_torso = truth;
    no_torso.points[5].visibility = 0;
    assert!(!pck.add(&no_torso, Some(&predicted)));
}
