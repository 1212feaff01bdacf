//! Archives that are damaged, or do not say what they must.

use edgecap::lab::eval::{JointOrder, ReadOptions, TruthSet, Units};

use super::{Arrays, FIGURE, at, h36m, read, toolbox};

#[test]
fn what_is_wrong_with_an_archive_is_said() {
    let here = at(&FIGURE, [0.0, 0.0, 4.0]);
    let good = || toolbox(&[("a.jpg", here), ("b.jpg", here)]);
    let without = |name: &str| {
        let mut arrays = good();
        arrays.0.retain(|(n, _)| n != name);
        arrays
    };
    let (auto, own) = (ReadOptions::default(), h36m());
    let dhp = ReadOptions {
        joint_order: Some(JointOrder::MpiInf3dhp),
        ..ReadOptions::default()
    };
    let mm = ReadOptions {
        units: Some(Units::Mm),
        ..h36m()
    };
    let other = ReadOptions {
        split: Some("TS9".into()),
        ..h36m()
    };
    let pose = |xx: f64, x: f64| [xx, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let matrix = |fx: f64, cx: f64| [fx, 0.0, cx, 0.0, 500.0, 160.0, 0.0, 0.0, 1.0];
    let cases: Vec<(Arrays, &ReadOptions, &[&str])> = vec![
        (
            without("S"),
            &auto,
            &["positions_3d", "only imgname, center, part"],
        ),
        (Arrays::default(), &auto, &["no array at all"]),
        (good(), &auto, &["17 joints", "--joint-order"]),
        (good(), &dhp, &["another skeleton", "--joint-order"]),
        (good(), &mm, &["--units m"]),
        (good(), &other, &["TS9", "--split"]),
        (without("part"), &auto, &["--joint-order"]),
        (
            without("part").texts("joint_order", &["h36m"]),
            &auto,
            &["camera_matrix"],
        ),
        (
            good().texts("joint_order", &["lsp"]),
            &auto,
            &["h36m, mpi-inf-3dhp", "lsp"],
        ),
        (
            good().texts("sequence", &["1", "2", "3"]),
            &mm,
            &["2 strings", "3 strings"],
        ),
        (
            without("imgname").texts("imgname", &["a", "b", "c"]),
            &own,
            &["imgname", "3 strings"],
        ),
        (
            without("imgname").array("imgname", &[2], &[1.0, 2.0]),
            &own,
            &["imgname", "strings", "f8"],
        ),
        (
            without("S").texts("S", &["a"]),
            &auto,
            &["'S'", "numbers", "U1"],
        ),
        (
            without("S").array("S", &[2, 51], &[0.0; 102]),
            &auto,
            &["[2, 51]"],
        ),
        (
            without("S").array("S", &[2, 17, 5], &[0.0; 170]),
            &auto,
            &["[2, 17, 5]"],
        ),
        (
            without("S").array("S", &[0, 17, 3], &[0.0; 0]),
            &auto,
            &["[0, 17, 3]"],
        ),
        (
            without("S").array("S", &[2, 16, 3], &[0.0; 96]),
            &auto,
            &["[2, 1, 16]", "[2, 1, 17]"],
        ),
        (
            Arrays::default().array("S", &[1, 16, 3], &[0.0; 48]).array(
                "part",
                &[1, 16, 2],
                &[0.0; 32],
            ),
            &dhp,
            &["16 joints", "17 or 28"],
        ),
        (
            good().array("valid", &[3], &[1_u8; 3]),
            &mm,
            &["valid", "[2, 1]", "[3]"],
        ),
        (
            good().array("partial", &[3], &[1_u8; 3]),
            &own,
            &["partial", "[1] or [2]", "[3]"],
        ),
        (
            Arrays::default().array("S", &[1, 16, 3], &[0.0; 48]).array(
                "part",
                &[1, 16, 2],
                &[0.0; 32],
            ),
            &auto,
            &["16 joints", "17 or 28"],
        ),
        (
            without("imgname").array("frames", &[2], &[1.0, 0.5]),
            &mm,
            &["frames", "rise"],
        ),
        (
            good().array("camera_matrix", &[3, 3], &[0.0; 9]),
            &mm,
            &["camera_matrix", "fx"],
        ),
        (
            good().array("camera_pose", &[4, 4], &[0.0; 16]),
            &mm,
            &["camera_pose", "[3, 4]"],
        ),
        (
            good().array("camera_pose", &[3, 4], &[1.0; 12]),
            &mm,
            &["camera_pose", "rotation"],
        ),
        (
            good().array("camera_pose", &[3, 4], &pose(-1.0, 0.0)),
            &mm,
            &["camera_pose", "mirror"],
        ),
        (
            good().array("camera_pose", &[3, 4], &pose(1.0, f64::NAN)),
            &mm,
            &["camera_pose", "NaN"],
        ),
        (
            good().array("camera_matrix", &[3, 3], &matrix(f64::NAN, 256.0)),
            &mm,
            &["camera_matrix", "NaN"],
        ),
        (
            good().array("camera_matrix", &[3, 3], &matrix(500.0, f64::INFINITY)),
            &mm,
            &["camera_matrix", "inf"],
        ),
    ];
    for (arrays, options, words) in cases {
        let said = arrays.read(options).expect_err(&format!("{words:?}"));
        for word in words {
            assert!(said.contains(word), "{word} in: {said}");
        }
        assert!(!said.contains('\n') && said.contains("expected"), "{said}");
    }
    // Upside down: y points up.
    let flipped = at(&FIGURE.map(|p| [p[0], -p[1], p[2]]), [0.0, 0.0, 4.0]);
    let mut arrays = toolbox(&[("a.jpg", flipped)]);
    let upright = toolbox(&[("a.jpg", here)]);
    let part = |a: &Arrays| a.0.iter().position(|(n, _)| n == "part").unwrap();
    let k = part(&arrays);
    arrays.0[k] = upright.0[part(&upright)].clone();
    let said = arrays.read(&h36m()).unwrap_err();
    assert!(said.contains("y down"), "{said}");
}

#[test]
fn an_archive_cut_anywhere_is_refused() {
    let here = at(&FIGURE, [0.0, 0.0, 4.0]);
    let whole = toolbox(&[("a.jpg", here)]).bytes();
    assert!(read(&whole, &h36m()).is_ok());
    for cut in (4..whole.len()).step_by(37) {
        let said = read(&whole[..cut], &h36m()).unwrap_err();
        assert!(said.contains("cut short"), "{cut}: {said}");
    }
    // A byte changed anywhere is noticed, or lies where nothing depends on it; it never brings the program down.
    for k in (0..whole.len()).step_by(11) {
        let mut bytes = whole.clone();
        bytes[k] ^= 0x55;
        if let Ok(truth) = read(&bytes, &h36m()) {
            let intact = read(&whole, &h36m()).unwrap();
            let solid = |t: &TruthSet| t.frames[0].people[0].joints3d;
            assert_eq!(solid(&truth), solid(&intact), "byte {k}");
        }
    }
}
