//! What `--uninstall` takes away, and what it leaves.

use std::path::Path;
use std::process::Command;

use super::{install, install_with_systemctl};
use crate::program::{script, stderr, stdout};

#[test]
fn nothing_of_the_service_stays_in_memory() {
    let root = tempfile::tempdir().unwrap();
    let runtime = root.path().join("run/edgecap");
    std::fs::create_dir_all(runtime.join("d0123456789abcdef")).unwrap();
    std::fs::write(runtime.join("camera0.bodies.v2"), "").unwrap();
    install(root.path(), &["--system", "--uninstall"]);
    assert!(!runtime.exists());
    // The package's script does the same; its commands are replaced by ones that say what they were to do.
    let bin = root.path().join("bin");
    std::fs::create_dir(&bin).unwrap();
    for name in ["rm", "deb-systemd-helper", "systemctl"] {
        script(&bin.join(name), "#!/bin/sh\necho \"${0##*/} $*\" >&3\n");
    }
    let removal = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/debian/postrm");
    let text = std::fs::read_to_string(removal).unwrap();
    let text = text.replace("/run/systemd/system", bin.to_str().unwrap());
    let removal = root.path().join("postrm");
    script(&removal, &text);
    let out = Command::new("/bin/sh")
        .args(["-c", "exec /bin/sh \"$0\" remove 3>&1"])
        .arg(removal)
        .env("PATH", &bin)
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", stderr(&out));
    let done = stdout(&out);
    assert!(done.lines().any(|l| l == "rm -rf /run/edgecap"), "{done}");
    let reloaded = done.split_once("systemctl daemon-reload\n").unwrap().1;
    assert_eq!(reloaded, "systemctl reset-failed edgecap.service*\n");
    // Nobody but a package would take a mask away again.
    assert!(!done.contains(" mask "), "{done}");
}

/// Else the machine counts as degraded until it starts again.
#[test]
fn a_service_that_had_failed_is_forgotten_once_it_is_gone() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    install_with_systemctl(home, "nothing", &[]);
    let out = install_with_systemctl(home, "nothing", &["--uninstall"]);
    assert!(out.status.success(), "{}", stderr(&out));
    let said = stdout(&out);
    let at = |line: &str| {
        let found = said.lines().position(|l| l == line);
        found.unwrap_or_else(|| panic!("{line} in {said}"))
    };
    let unit = home.join(".config/systemd/user/edgecap.service");
    let lines = [
        "run       systemctl --user disable --now edgecap.service",
        &format!("remove    {}", unit.display()),
        "run       systemctl --user daemon-reload",
        "run       systemctl --user reset-failed edgecap.service*",
    ];
    assert!(lines.map(at).is_sorted(), "{said}");
}

#[test]
fn nothing_is_not_called_uninstalled() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    // Nor where no service manager runs.
    for (verb, more, words) in [
        ("daemon-reload", "--uninstall", "nothing was installed here"),
        ("nothing", "", "edgecap is installed."),
        ("nothing", "--uninstall", "edgecap is uninstalled"),
        ("nothing", "--uninstall", "nothing was installed here"),
    ] {
        let more: Vec<&str> = more.split_whitespace().collect();
        let out = install_with_systemctl(home, verb, &more);
        assert!(out.status.success(), "{}", stderr(&out));
        let said = stdout(&out);
        let is_last = |l: &str| {
            ["run ", "remove ", "absent ", "write ", "failed "]
                .iter()
                .all(|w| !l.starts_with(w))
        };
        let last = said.lines().find(|l| is_last(l)).unwrap_or_default();
        assert!(last.starts_with(words), "{words}: {said}");
    }
}

/// The machine's own folders may be a package's, whatever is in them.
#[test]
fn folders_of_an_installation_alone_go_with_it() {
    let root = tempfile::tempdir().unwrap();
    let at = |path: &str| root.path().join(path);
    let theirs = "opt/x/share/man/man1/theirs.1";
    for (prefix, other, stays) in [
        ("/opt/x", None, "opt"),
        ("/opt/x", Some(theirs), "opt/x/share/man/man1"),
        ("/opt", None, "opt"),
        ("/usr/local", None, "usr/local/share/man/man1"),
    ] {
        let _ = std::fs::remove_dir_all(at("opt"));
        let service = ["--system", "--prefix", prefix];
        install(root.path(), &service);
        if let Some(other) = other {
            std::fs::write(at(other), "").unwrap();
        }
        install(root.path(), &[&service[..], &["--uninstall"]].concat());
        let folder = at(stays);
        assert!(folder.is_dir(), "{prefix}: {stays}");
        let left = std::fs::read_dir(folder).unwrap().count();
        assert_eq!(left, usize::from(other.is_some()), "{prefix}");
        assert!(!at("opt/x/bin").exists() && !at("opt/bin").exists());
        for folder in ["etc/systemd/system", "etc/tmpfiles.d", "usr/local/bin"] {
            let is_there =
                at(folder).is_dir() || folder.starts_with("usr") && prefix != "/usr/local";
            assert!(is_there, "{prefix}: {folder}");
        }
    }
}

#[test]
fn recordings_and_changes_to_the_unit_stay_and_are_told() {
    for (is_empty, prefix) in [(true, "/usr/local"), (false, "/usr/local"), (false, "/usr")] {
        let root = tempfile::tempdir().unwrap();
        let service = ["--system", "--prefix", prefix];
        install(root.path(), &service);
        let folders = [
            root.path().join("var/lib/edgecap"),
            root.path().join("etc/systemd/system/edgecap.service.d"),
        ];
        for folder in &folders {
            std::fs::create_dir_all(folder).unwrap();
            if !is_empty {
                std::fs::write(folder.join("theirs"), "").unwrap();
            }
        }
        let uninstall = [&service[..], &["--uninstall"]].concat();
        let said = stdout(&install(root.path(), &uninstall));
        let word = if is_empty { "remove" } else { "keep" };
        for folder in folders {
            let line = format!("{word:9} {}", folder.display());
            assert!(said.lines().any(|l| l == line), "{line} in {said}");
            assert_eq!(folder.join("theirs").exists(), !is_empty);
            assert_eq!(folder.exists(), !is_empty);
        }
    }
}
