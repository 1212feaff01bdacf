//! What the units say, and what systemd thinks of them.

use std::process::{Command, Output};

use super::{install, try_install};
use crate::program::{stderr, tools};

/// What locks the service up or lets it do its work, and a score of all of it would not miss.
const OF_THE_SERVICE: &[&str] = &[
    "User=edgecap",
    "Group=edgecap",
    "SupplementaryGroups=video",
    "UMask=0027",
    "RuntimeDirectoryMode=0750",
    "StateDirectoryMode=0750",
    "DevicePolicy=closed",
    "DeviceAllow=char-video4linux rw",
    "CapabilityBoundingSet=",
    "ProtectSystem=strict",
    "ProtectHome=yes",
    "PrivateTmp=yes",
    // Else a camera that comes after the start may never be opened.
    "Wants=modprobe@videodev.service",
    "After=modprobe@videodev.service",
    "IPAddressDeny=any",
    "IPAddressAllow=localhost",
];

const OF_BOTH_UNITS: &[&str] = &[
    "Type=notify",
    "Restart=always",
    "RestartPreventExitStatus=64 65 78",
    "WatchdogSec=40",
    "LimitCORE=0",
    "NoNewPrivileges=yes",
    "MemoryDenyWriteExecute=yes",
];

#[test]
fn the_units_say_what_they_have_to() {
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &["--system"]);
    install(root.path(), &["--user"]);
    let both = OF_BOTH_UNITS.to_vec();
    for (path, expected) in [
        (
            "etc/systemd/system/edgecap.service",
            [OF_THE_SERVICE, OF_BOTH_UNITS].concat(),
        ),
        ("home/somebody/.config/systemd/user/edgecap.service", both),
    ] {
        let unit = std::fs::read_to_string(root.path().join(path)).unwrap();
        for line in expected {
            assert!(unit.lines().any(|l| l == line), "{path} lacks {line}");
        }
    }
}

#[test]
fn a_unit_names_any_folder() {
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &["--system", "--prefix", "/opt/edge cap 50%"]);
    let unit = root.path().join("etc/systemd/system/edgecap.service");
    let unit = std::fs::read_to_string(unit).unwrap();
    let line =
        "ExecStart=\"/opt/edge cap 50%%/bin/edgecap\" run --config /etc/edgecap/edgecap.toml";
    assert!(unit.lines().any(|l| l == line), "{unit}");
    let out = try_install(root.path(), &["--system", "--prefix", "/opt/$x"]);
    assert_eq!(out.status.code(), Some(64), "{}", stderr(&out));
    assert!(stderr(&out).contains("/opt/$x/bin/edgecap"));
}

fn systemd_analyze(args: &[&str]) -> Option<Output> {
    tools::has("systemd-analyze").then(|| {
        let out = Command::new("systemd-analyze").args(args).output();
        out.unwrap()
    })
}

#[test]
fn systemd_finds_the_units_right_and_the_service_locked_up() {
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &["--system"]);
    install(root.path(), &["--user"]);
    // The unit's program has to be there to be right.
    let program = root.path().join("usr/local/bin/edgecap");
    for path in [
        "etc/systemd/system/edgecap.service",
        "home/somebody/.config/systemd/user/edgecap.service",
    ] {
        let unit = root.path().join(path);
        let text = std::fs::read_to_string(&unit).unwrap();
        let here = program.to_str().unwrap();
        let text = text
            .replace("/usr/local/bin/edgecap", here)
            .replace("%h/.local/bin/edgecap", here);
        std::fs::write(&unit, text).unwrap();
        let Some(out) = systemd_analyze(&["verify", "--man=no", unit.to_str().unwrap()]) else {
            return;
        };
        let said = stderr(&out);
        let ours: Vec<&str> = said.lines().filter(|l| l.contains("edgecap")).collect();
        assert!(ours.is_empty(), "{ours:?}");
    }
    let unit = root.path().join("etc/systemd/system/edgecap.service");
    let args = [
        "security",
        "--offline=true",
        "--threshold=25",
        unit.to_str().unwrap(),
    ];
    let Some(out) = systemd_analyze(&args) else {
        return;
    };
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    if stderr(&out).contains("unrecognized option") {
        tools::skip("systemd-analyze", "this systemd-analyze knows no --offline");
        return;
    }
    assert!(
        out.status.success(),
        "more than 2.5 exposed: {}",
        said.lines().last().unwrap_or("")
    );
}
