//! Settings: whose they are, who may read them, when they go.

use std::fs::Permissions;
use std::os::unix::fs::{PermissionsExt, symlink};

use super::{install, install_with_systemctl, mode};
use crate::program::{edgecap, stderr, stdout};

/// Variables of a shell say nothing to the service manager.
#[test]
fn a_persons_service_is_found_wherever_the_shell_has_settings() {
    let root = tempfile::tempdir().unwrap();
    let out = edgecap()
        .args(["install", "--user", "--root", root.path().to_str().unwrap()])
        .env("HOME", "/home/somebody")
        .env("XDG_CONFIG_HOME", "/home/somebody/my settings")
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", stderr(&out));
    let home = root.path().join("home/somebody");
    assert!(home.join("my settings/edgecap/edgecap.toml").exists());
    let unit = home.join(".config/systemd/user/edgecap.service");
    let unit = std::fs::read_to_string(unit).unwrap();
    let settings = "\"/home/somebody/my settings/edgecap/edgecap.toml\"";
    let line = format!("ExecStart=%h/.local/bin/edgecap run --config {settings}");
    assert!(unit.lines().any(|l| l == line), "{unit}");
}

/// What was installed by this or an earlier version, as the digest beside it says.
#[test]
fn settings_that_nobody_has_changed_go_with_the_service() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    let run = |more: &[&str]| {
        let out = install_with_systemctl(home, "nothing", more);
        assert!(out.status.success(), "{}", stderr(&out));
        stdout(&out)
    };
    let folder = home.join(".config/edgecap");
    let (settings, digest) = (
        folder.join("edgecap.toml"),
        folder.join("edgecap.toml.blake3"),
    );
    let earlier = "# Settings of an earlier version.\n";
    for (later, stay) in [
        (None, false),
        (Some(earlier), false),
        (Some("[network]\n"), true),
    ] {
        let said = run(&[]);
        let unit = home.join(".config/systemd/user/edgecap.service");
        let enable = format!("systemctl --user enable {}", unit.display());
        assert!(said.contains(&enable), "{said}");
        let noted = std::fs::read_to_string(&digest).unwrap();
        let written = std::fs::read(&settings).unwrap();
        let hex = |bytes: &[u8]| format!("{}  edgecap.toml\n", blake3::hash(bytes).to_hex());
        assert_eq!(noted, hex(&written));
        if let Some(later) = later {
            std::fs::write(&settings, later).unwrap();
            std::fs::write(&digest, hex(earlier.as_bytes())).unwrap();
            // Another version leaves both alone.
            run(&[]);
        }
        run(&["--uninstall"]);
        assert_eq!(settings.exists(), stay, "{later:?}");
        assert_eq!(folder.exists(), stay, "{later:?}");
        assert!(!digest.exists());
    }
}

/// They may hold a token, and whoever wrote them had permissions for everybody.
#[test]
fn settings_that_are_kept_are_closed_to_others() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("home/somebody/.config/edgecap");
    std::fs::create_dir_all(&folder).unwrap();
    let settings = folder.join("edgecap.toml");
    let text = "[bridges]\nview = \"0.0.0.0:9744\"\ntoken = \"open-sesame\"\n";
    std::fs::write(&settings, text).unwrap();
    let set = |mode| std::fs::set_permissions(&settings, Permissions::from_mode(mode)).unwrap();
    let says = |more: &[&str], mode: u32| {
        let said = stdout(&install(root.path(), &[&["--user"], more].concat()));
        let line = format!("keep      {} ({mode:o})", settings.display());
        assert!(said.lines().any(|l| l == line), "{line} in {said}");
    };
    for (found, wanted) in [(0o644, 0o600), (0o600, 0o600), (0o440, 0o400)] {
        set(found);
        says(&["--dry-run"], wanted);
        assert_eq!(mode(&settings), found, "a dry run changes nothing");
        says(&[], wanted);
        assert_eq!(mode(&settings), wanted);
    }
    assert_eq!(std::fs::read_to_string(&settings).unwrap(), text);
    // What a link leads to is left alone, and what it lets others do is said.
    let elsewhere = root.path().join("elsewhere.toml");
    set(0o644);
    std::fs::rename(&settings, &elsewhere).unwrap();
    symlink(&elsewhere, &settings).unwrap();
    says(&[], 0o644);
    assert_eq!(mode(&elsewhere), 0o644);
}

/// Whoever looks may not be able to read what root can.
#[test]
fn what_cannot_be_looked_at_is_not_called_absent() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("etc/edgecap");
    std::fs::create_dir_all(&folder).unwrap();
    // Not even root reads a link that leads to itself.
    symlink("edgecap.toml", folder.join("edgecap.toml")).unwrap();
    let out = install(root.path(), &["--system", "--uninstall", "--dry-run"]);
    let said = stdout(&out);
    let line = said.lines().find(|l| l.contains("edgecap.toml: "));
    let line = line.unwrap_or_else(|| panic!("{said}"));
    assert!(line.starts_with("failed"), "{line}");
    assert!(line.contains("cannot be seen"), "{line}");
}
