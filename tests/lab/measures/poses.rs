//! Errors of poses in space: MPJPE, 3DPCK, Procrustes, MuPoTS-3D.

use edgecap::joints::{BODY_JOINTS, PELVIS};
use edgecap::lab::eval::{
    EvalOptions, Mupots, MupotsPerson, Pose3d, PoseErrors, Predictions, Protocol, align_similarity,
    evaluate,
};

use super::{body, exact, line, observation, synthetic};
use crate::near;

#[test]
fn procrustes_undoes_turn_scale_and_shift_but_no_mirror() {
    let from = body();
    let (s, c) = (0.6, 0.8);
    let moved = from.map(|[x, y, z]| {
        [
            1.7 * (c * x - s * y) + 1.0,
            1.7 * (s * x + c * y) - 2.0,
            1.7 * z + 3.0,
        ]
    });
    let aligned = align_similarity(&from, &moved);
    for (a, b) in aligned.iter().zip(&moved) {
        for k in 0..3 {
            near(a[k], b[k]);
        }
    }
    let mirrored = from.map(|[x, y, z]| [-x, y, z]);
    let aligned = align_similarity(&from, &mirrored);
    let worst = aligned
        .iter()
        .zip(&mirrored)
        .map(|(a, b)| (a[0] - b[0]).abs());
    assert!(worst.fold(0.0, f64::max) > 0.1);
}

#[test]
fn pose_errors_are_root_aligned() {
    let truth = body();
    // Everything shifted by a metre, then two joints moved by 102 mm and 200 mm.
    let mut predicted = truth.map(|[x, y, z]| [x + 1.0, y, z]);
    predicted[4][1] += 0.102;
    predicted[7][2] -= 0.2;
    let errors = PoseErrors::new(&truth.map(Some), &predicted).unwrap();
    let squares = |e: &[f64]| e.iter().map(|e| e * e).sum::<f64>();
    assert!(squares(&errors.procrustes) < squares(&errors.aligned));
    let pooled = Pose3d::pool(
        std::slice::from_ref(&errors),
        std::slice::from_ref(&errors),
        2,
        &[0.5],
    )
    .unwrap();
    near(pooled.mpjpe_mm, 302.0 / 21.0);
    assert_eq!(pooled.joints, 21);
    // Of the evidence joints alone: the pelvis is right whatever is said of it.
    near(pooled.pck150, 13.0 / 14.0);
    // 12 joints are right from 5 mm on (30 of 31 thresholds), one from 105 mm on (10), one never.
    near(pooled.auc, (12.0 * 30.0 + 10.0) / 31.0 / 14.0);
    assert_eq!(
        (pooled.people, pooled.truth, pooled.root_mm),
        (1, 2, Some(500.0))
    );
    // A spine that is off counts in MPJPE alone, as in MPI-INF-3DHP's own tool.
    let mut bent = predicted;
    bent[15][0] += 0.2;
    let bent = PoseErrors::new(&truth.map(Some), &bent).unwrap();
    let of_bent = Pose3d::pool(&[bent], &[], 1, &[]).unwrap();
    near(of_bent.mpjpe_mm, 502.0 / 21.0);
    assert_eq!((of_bent.pck150, of_bent.auc), (pooled.pck150, pooled.auc));
    // Without those two and a third too large: only N-MPJPE and PA-MPJPE do not mind.
    let larger = truth.map(|p| p.map(|x| 4.0 / 3.0 * x));
    let grown = PoseErrors::new(&truth.map(Some), &larger).unwrap();
    let own_size = PoseErrors::new(&truth.map(Some), &truth).unwrap();
    let grown = Pose3d::pool(&[grown], &[own_size], 1, &[]).unwrap();
    assert!(grown.canonical_mpjpe_mm.unwrap() < 1e-6);
    assert!(
        grown.mpjpe_mm > 50.0 && grown.n_mpjpe_mm < 1e-6,
        "{grown:?}"
    );
    // Scaled as suits best: of two joints at 1 m that are predicted at 1 m and not at all, no factor helps the second.
    let mut flat = [[0.0; 3]; BODY_JOINTS];
    flat[0] = [1.0, 0.0, 0.0];
    flat[1] = [0.0, 1.0, 0.0];
    let mut half = flat;
    half[0] = [0.5, 0.0, 0.0];
    half[1] = [0.0; 3];
    let errors = PoseErrors::new(&flat.map(Some), &half).unwrap();
    near(errors.scaled[0], 0.0);
    near(errors.scaled[1], 1.0);
    let mut rootless = truth.map(Some);
    rootless[PELVIS] = None;
    assert_eq!(PoseErrors::new(&rootless, &predicted), None);
    // A trunk without limbs has no joint of 3DPCK.
    let mut trunk = [None; BODY_JOINTS];
    (14..18).for_each(|j| trunk[j] = Some(truth[j]));
    assert!(!PoseErrors::can_be(&trunk));
    assert!(PoseErrors::can_be(&truth.map(Some)) && !PoseErrors::can_be(&rootless));
}

#[test]
fn joints_all_in_one_point_are_no_truth() {
    let text = line(0, "", &observation(0.9, &exact()));
    let predictions = Predictions::parse(&text, "p").unwrap();
    let report = |joints: [[f64; 3]; BODY_JOINTS]| {
        let joints = joints.to_vec();
        let truth = synthetic(|p| p["joints3d"] = serde_json::json!(joints)).unwrap();
        evaluate(&predictions, &truth, &EvalOptions::default()).unwrap()
    };
    let known = report(body());
    assert!(known.pose3d.is_some() && known.mupots.len() == 2);
    for point in [[0.0; 3], [0.0, 0.0, 4.0]] {
        let unknown = report([point; BODY_JOINTS]);
        assert_eq!((unknown.pose3d, unknown.mupots.len()), (None, 0));
        assert_eq!(unknown.finding[2].found, 1);
    }
}

fn mupots_person(shift: f64, scale: f64) -> MupotsPerson {
    MupotsPerson {
        joints2d: std::array::from_fn(|j| Some([10.0 * j as f64 + shift, 5.0 * j as f64])),
        joints3d: body().map(|p| Some(p.map(|x| scale * x + shift))),
    }
}

#[test]
fn mupots_matches_in_order_and_rescales_bones() {
    let truth = [mupots_person(0.0, 1.0), mupots_person(100.0, 1.0)];
    // One prediction, between both but within 40 px of the first only, half as large.
    let predicted = [mupots_person(39.0, 0.5)];
    let mut m = Mupots::default();
    m.begin_sequence();
    m.add(&truth, &predicted);
    let all = m.score(Protocol::All).unwrap();
    let matched = m.score(Protocol::Matched).unwrap();
    near(matched.pck150, 1.0);
    near(all.pck150, 0.5);
    // Exact after rescaling: right at every threshold but 0.
    near(matched.auc, 30.0 / 31.0);
    near(all.auc, 15.0 / 31.0);
    // A second sequence with nobody found: pooled over people, but the mean is over sequences.
    m.begin_sequence();
    m.add(&truth[..1], &[]);
    let all = m.score(Protocol::All).unwrap();
    near(all.pck150, 1.0 / 3.0);
    near(all.pck150_per_sequence, 0.25);
    near(m.score(Protocol::Matched).unwrap().pck150_per_sequence, 1.0);
}
