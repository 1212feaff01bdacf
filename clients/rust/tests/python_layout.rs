//! The Python client's structures must lie in memory as ours do.

use std::mem::{offset_of, size_of};
use std::process::Command;

use edgecap_client::message::{Body, BodyFrame, Observation, ObservationFrame};

#[test]
fn python_structures_have_the_same_layout() {
    let script = "import edgecap as e, ctypes\n\
        for t in (e.Observation, e.ObservationFrame, e.Body, e.BodyFrame): print(ctypes.sizeof(t))\n\
        print(e.ObservationFrame.flags.offset, e.ObservationFrame._people.offset)\n\
        print(e.Body.joints3d.offset, e.Body._joint_states.offset, e.BodyFrame.fit_us.offset, e.BodyFrame._bodies.offset)";
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../python");
    let run = Command::new("python3")
        .args(["-B", "-c", script])
        .env("PYTHONPATH", folder)
        .output();
    let Ok(output) = run else {
        eprintln!("skipped: no python3 on this machine");
        return;
    };
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let found: Vec<usize> = String::from_utf8(output.stdout)
        .unwrap()
        .split_whitespace()
        .map(|n| n.parse().unwrap())
        .collect();
    let expected = [
        size_of::<Observation>(),
        size_of::<ObservationFrame>(),
        size_of::<Body>(),
        size_of::<BodyFrame>(),
        offset_of!(ObservationFrame, flags),
        offset_of!(ObservationFrame, people),
        offset_of!(Body, joints3d),
        offset_of!(Body, joint_states),
        offset_of!(BodyFrame, fit_us),
        offset_of!(BodyFrame, bodies),
    ];
    assert_eq!(found, expected);
}
