//! What somebody else has decided: a mask, an installation of another prefix, a package.

use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use super::{files, install, mode, try_install};
use crate::program::{script, stderr, stdout};

/// To write through such a link would change the device for the whole machine.
#[test]
fn a_masked_service_stays_masked() {
    let root = tempfile::tempdir().unwrap();
    let units = root.path().join("etc/systemd/system");
    std::fs::create_dir_all(&units).unwrap();
    symlink("/dev/null", units.join("edgecap.service")).unwrap();
    let device = mode(Path::new("/dev/null"));
    for more in [&["--system"][..], &["--system", "--prefix", "/usr"]] {
        let out = try_install(root.path(), more);
        assert_eq!(out.status.code(), Some(69), "{}", stderr(&out));
        let words = "'sudo systemctl unmask edgecap'";
        assert!(stderr(&out).contains(words), "{}", stderr(&out));
    }
    let unit = units.join("edgecap.service");
    let said = stdout(&install(root.path(), &["--system", "--uninstall"]));
    let line = format!("keep      {} (masked)", unit.display());
    assert!(said.lines().any(|l| l == line), "{line} in {said}");
    assert!(unit.is_symlink());
    assert_eq!(files(root.path()), ["etc/systemd/system/edgecap.service"]);
    assert_eq!(mode(Path::new("/dev/null")), device);
}

/// The administrator's units come before those of packages, of whatever version they are.
#[test]
fn an_installation_that_another_one_comes_before_is_refused() {
    let unit = "etc/systemd/system/edgecap.service";
    let packaged = ["--system", "--prefix", "/usr"];
    let options = ["", " --prefix /opt/edge \"cap\" 50%"];
    for (prefix, option) in ["/usr/local", "/opt/edge \"cap\" 50%"]
        .into_iter()
        .zip(options)
    {
        let root = tempfile::tempdir().unwrap();
        let earlier = ["--system", "--prefix", prefix];
        install(root.path(), &earlier);
        let there = files(root.path());
        let out = try_install(root.path(), &packaged);
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(69), "{said}");
        let unit = root.path().join(unit);
        let remedy = format!("'sudo {prefix}/bin/edgecap install --system --uninstall{option}'");
        for words in [unit.to_str().unwrap(), &remedy] {
            assert!(said.contains(words), "{words} in {said}");
        }
        assert_eq!(files(root.path()), there, "nothing is written");
        // It may be repeated, and gives way.
        install(root.path(), &earlier);
        install(root.path(), &[&earlier[..], &["--uninstall"]].concat());
        install(root.path(), &packaged);
    }
    // What 'systemctl edit --full' leaves is the same service.
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &packaged);
    let own = root.path().join("usr/lib/systemd/system/edgecap.service");
    let copy = root.path().join(unit);
    std::fs::create_dir_all(copy.parent().unwrap()).unwrap();
    let text = std::fs::read_to_string(own).unwrap();
    let wrapped = text.replace("=/usr/bin/edgecap", "=/usr/bin/taskset 3 /usr/bin/edgecap");
    for text in [text, wrapped] {
        std::fs::write(&copy, text).unwrap();
        install(root.path(), &packaged);
    }
}

/// All of them have the same settings and the same shared memory.
#[test]
fn another_installation_is_not_taken_away_in_place_of_one_that_is_not_there() {
    for (prefix, remedy) in [
        ("/usr", "'sudo apt remove edgecap'"),
        (
            "/opt/x",
            "'sudo /opt/x/bin/edgecap install --system --uninstall --prefix /opt/x'",
        ),
    ] {
        for is_masked in [false, true] {
            let root = tempfile::tempdir().unwrap();
            install(root.path(), &["--system", "--prefix", prefix]);
            let mask = root.path().join("etc/systemd/system/edgecap.service");
            if is_masked && prefix == "/usr" {
                std::fs::create_dir_all(mask.parent().unwrap()).unwrap();
                symlink("/dev/null", mask).unwrap();
            }
            let there = files(root.path());
            let runtime = root.path().join("run/edgecap");
            std::fs::create_dir_all(&runtime).unwrap();
            for more in [&["--uninstall"][..], &["--uninstall", "--dry-run"]] {
                let out = try_install(root.path(), &[&["--system"], more].concat());
                let said = stderr(&out);
                assert_eq!(out.status.code(), Some(69), "{said}");
                let program = format!("found that of {prefix}/bin/edgecap in ");
                assert!(said.contains(&program) && said.contains(remedy), "{said}");
                assert_eq!(files(root.path()), there, "{prefix}");
                assert!(runtime.exists());
            }
            install(
                root.path(),
                &["--system", "--prefix", prefix, "--uninstall"],
            );
            let left = files(root.path());
            let settings = "etc/edgecap/edgecap.toml";
            assert!(!left.iter().any(|f| f == settings), "{left:?}");
            assert!(!runtime.exists());
        }
    }
}

#[test]
fn of_two_installations_one_goes_and_the_other_stays_whole() {
    let (packaged, own) = (["--system", "--prefix", "/usr"], ["--system"]);
    for (stays, goes, is_run) in [(&packaged[..], &own[..], false), (&own, &packaged, true)] {
        let alone = tempfile::tempdir().unwrap();
        install(alone.path(), stays);
        let root = tempfile::tempdir().unwrap();
        install(root.path(), &packaged);
        install(root.path(), &own);
        let runtime = root.path().join("run/edgecap");
        std::fs::create_dir_all(&runtime).unwrap();
        install(root.path(), &[goes, &["--uninstall"]].concat());
        assert_eq!(files(root.path()), files(alone.path()), "{stays:?}");
        // The machine runs the administrator's.
        assert_eq!(runtime.exists(), is_run, "{stays:?}");
    }
}

/// A package cannot refuse halfway: it says what the machine runs instead.
#[test]
fn a_package_says_that_another_installation_comes_first() {
    let root = tempfile::tempdir().unwrap();
    let bin = root.path().join("bin");
    std::fs::create_dir(&bin).unwrap();
    for name in [
        "systemd-sysusers",
        "systemd-tmpfiles",
        "udevadm",
        "systemctl",
        "deb-systemd-helper",
        "deb-systemd-invoke",
    ] {
        script(&bin.join(name), "#!/bin/sh\n");
    }
    let unit = root.path().join("edgecap.service");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/debian/postinst");
    let text = std::fs::read_to_string(source).unwrap();
    let place = "/etc/systemd/system/edgecap.service";
    assert!(text.contains(place));
    let postinst = root.path().join("postinst");
    script(&postinst, &text.replace(place, unit.to_str().unwrap()));
    let path = std::env::var("PATH").unwrap_or_default();
    let said = || {
        let out = Command::new(&postinst)
            .arg("configure")
            .env("PATH", format!("{}:{path}", bin.display()))
            .output()
            .unwrap();
        assert!(out.status.success(), "{}", stderr(&out));
        stderr(&out)
    };
    assert_eq!(said(), "");
    for (program, is_other) in [("/opt/bin/edgecap", true), ("/usr/bin/edgecap", false)] {
        std::fs::write(&unit, format!("[Service]\nExecStart={program} run\n")).unwrap();
        let said = said();
        assert_eq!(said.contains("comes first"), is_other, "{said}");
        assert_eq!(said.contains(program), is_other, "{said}");
        assert_eq!(said.is_empty(), !is_other, "{said}");
    }
    std::fs::remove_file(&unit).unwrap();
    symlink("/dev/null", &unit).unwrap();
    assert_eq!(said(), "", "a mask is wanted");
}
