//! `edgecap install`: what it writes, twice, and takes away again; and what systemd thinks of the unit.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

use crate::program::{assert_fails, edgecap, stderr, tools};

fn install(root: &Path, more: &[&str]) -> Output {
    let out = edgecap()
        .args(["install", "--root", root.to_str().unwrap()])
        .args(more)
        .env("HOME", "/home/somebody")
        .env_remove("XDG_CONFIG_HOME")
        .env_remove("XDG_DATA_HOME")
        .output()
        .unwrap();
    assert!(out.status.success(), "{more:?}: {}", stderr(&out));
    out
}

/// The words before the paths, counted.
fn words(out: &Output) -> BTreeMap<String, usize> {
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    let mut counts = BTreeMap::new();
    for line in said.lines() {
        *counts
            .entry(line.split(' ').next().unwrap().to_owned())
            .or_insert(0) += 1;
    }
    counts
}

fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut left = vec![folder.to_owned()];
    while let Some(next) = left.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                left.push(path);
            } else {
                found.push(path.strip_prefix(folder).unwrap().display().to_string());
            }
        }
    }
    found.sort();
    found
}

fn mode(path: &Path) -> u32 {
    use std::os::unix::fs::PermissionsExt;
    std::fs::metadata(path).unwrap().permissions().mode() & 0o777
}

#[test]
fn the_machines_service_comes_once_stays_and_goes() {
    let root = tempfile::tempdir().unwrap();
    let look = install(root.path(), &["--system", "--dry-run"]);
    assert!(files(root.path()).is_empty(), "a dry run writes nothing");
    let first = install(root.path(), &["--system"]);
    let written = words(&first)["write"];
    assert_eq!(words(&look)["write"], written);
    let there = files(root.path());
    assert_eq!(there.len(), written);
    for file in [
        "etc/edgecap/edgecap.toml",
        "etc/systemd/system/edgecap.service",
        "etc/sysusers.d/edgecap.conf",
        "etc/tmpfiles.d/edgecap.conf",
        "etc/udev/rules.d/70-edgecap.rules",
        "usr/local/bin/edgecap",
        "usr/local/share/bash-completion/completions/edgecap",
        "usr/local/share/fish/vendor_completions.d/edgecap.fish",
        "usr/local/share/man/man1/edgecap-run.1",
        "usr/local/share/man/man1/edgecap.1",
        "usr/local/share/zsh/site-functions/_edgecap",
    ] {
        assert!(there.iter().any(|f| f == file), "{file} in {there:?}");
    }
    let unit = std::fs::read_to_string(root.path().join("etc/systemd/system/edgecap.service"));
    assert!(
        unit.unwrap()
            .contains("ExecStart=/usr/local/bin/edgecap run")
    );

    let config = root.path().join("etc/edgecap/edgecap.toml");
    // It may hold a token; the rule below gives it to the service's group.
    assert_eq!(mode(&config), 0o640);
    // 'udevadm trigger' says "change" of the cameras that are there.
    let rules = root.path().join("etc/udev/rules.d/70-edgecap.rules");
    let rules = std::fs::read_to_string(rules).unwrap();
    assert!(!rules.contains("ACTION==\"add\""), "{rules}");
    let rule = std::fs::read_to_string(root.path().join("etc/tmpfiles.d/edgecap.conf")).unwrap();
    let line = "z /etc/edgecap/edgecap.toml 0640 root edgecap -";
    assert!(rule.lines().any(|l| l == line), "{rule}");
    std::fs::write(&config, "[network]\nthreads = 1\n").unwrap();
    let rules = root.path().join("etc/udev/rules.d/70-edgecap.rules");
    std::fs::write(&rules, "old").unwrap();
    let again = words(&install(root.path(), &["--system"]));
    assert_eq!((again["keep"], again["replace"]), (1, 1));
    assert_eq!(again["unchanged"], written - 2);
    assert_eq!(
        std::fs::read_to_string(&config).unwrap(),
        "[network]\nthreads = 1\n"
    );

    let gone = words(&install(root.path(), &["--system", "--uninstall"]));
    assert_eq!((gone["keep"], gone["remove"]), (1, written - 1));
    assert_eq!(files(root.path()), ["etc/edgecap/edgecap.toml"]);
}

/// Whatever an installation of a package has, the Debian package takes.
#[test]
fn the_debian_package_has_every_file() {
    let manifest: toml::Table = include_str!("../../Cargo.toml").parse().unwrap();
    let deb = &manifest["package"]["metadata"]["deb"];
    let sources: Vec<String> = deb["assets"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|a| a[0].as_str()?.strip_prefix("target/package/"))
        .map(|source| source.trim_end_matches('*').to_owned())
        .collect();
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &["--system", "--prefix", "/usr"]);
    let there = files(root.path());
    for file in &there {
        let folder = file.rsplit_once('/').unwrap().0.to_owned() + "/";
        assert!(
            sources.iter().any(|s| s == file || *s == folder),
            "{file} in {sources:?}"
        );
    }
    for source in &sources {
        assert!(
            there.iter().any(|f| f.starts_with(source)),
            "{source} in {there:?}"
        );
    }
    let settings = format!("/{}", there.iter().find(|f| f.ends_with(".toml")).unwrap());
    assert_eq!(deb["conf-files"][0].as_str(), Some(&*settings));
    let assets = deb["assets"].as_array().unwrap();
    let is_settings = |a: &&toml::Value| a[0].as_str().is_some_and(|s| s.ends_with(&settings));
    let asset = assets.iter().find(is_settings).unwrap();
    assert_eq!(asset[2].as_str(), Some("640"));
}

#[test]
fn a_persons_service_lies_in_that_persons_home() {
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &["--user"]);
    let there = files(root.path());
    assert!(
        there.iter().all(|f| f.starts_with("home/somebody/")),
        "{there:?}"
    );
    assert!(
        there
            .iter()
            .any(|f| f.ends_with(".config/systemd/user/edgecap.service"))
    );
    let settings = there.iter().find(|f| f.ends_with("edgecap.toml")).unwrap();
    assert_eq!(mode(&root.path().join(settings)), 0o600);
    install(root.path(), &["--user", "--uninstall"]);
    assert!(files(root.path()).is_empty());
}

/// `install` for a person whose `systemctl` fails at this verb.
fn install_with_systemctl(home: &Path, verb: &str, more: &[&str]) -> Output {
    use std::os::unix::fs::PermissionsExt;
    let systemctl = home.join("systemctl");
    let script = format!(
        "#!/bin/sh\n[ \"$2\" != {verb} ] || {{ echo 'Unit edgecap.service is masked.' >&2; exit 1; }}\n"
    );
    std::fs::write(&systemctl, script).unwrap();
    std::fs::set_permissions(&systemctl, std::fs::Permissions::from_mode(0o755)).unwrap();
    edgecap()
        .args(["install", "--user"])
        .args(more)
        .env("HOME", home)
        .env("PATH", home)
        .env_remove("XDG_CONFIG_HOME")
        .env_remove("XDG_DATA_HOME")
        .output()
        .unwrap()
}

#[test]
fn a_service_that_does_not_start_is_no_success() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    let out = install_with_systemctl(home, "restart", &[]);
    assert_eq!(out.status.code(), Some(69), "{}", stderr(&out));
    assert!(stderr(&out).contains("is masked"), "{}", stderr(&out));
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(!said.contains("is installed"), "{said}");
    let failed = said.lines().find(|l| l.starts_with("failed")).unwrap();
    assert!(failed.contains("restart") && failed.contains("is masked"));
    assert!(home.join(".local/bin/edgecap").exists(), "the rest is done");
    // What other commands fail of is said, and that is all.
    let out = install_with_systemctl(home, "daemon-reload", &[]);
    assert!(out.status.success(), "{}", stderr(&out));
    assert_eq!(words(&out)["failed"], 1);

    let out = install_with_systemctl(home, "disable", &["--uninstall"]);
    assert_eq!(out.status.code(), Some(69), "{}", stderr(&out));
    assert!(!home.join(".local/bin/edgecap").exists());
    // Nothing is there any more that could run.
    let out = install_with_systemctl(home, "disable", &["--uninstall"]);
    assert!(out.status.success(), "{}", stderr(&out));
}

#[test]
fn what_is_no_installation_is_refused() {
    let out = edgecap().args(["install"]).output().unwrap();
    assert_eq!(out.status.code(), Some(64));
    // Only root may, and a test that is root must not.
    if rustix::process::geteuid().is_root() {
        return;
    }
    let out = edgecap().args(["install", "--system"]).output().unwrap();
    assert_eq!(out.status.code(), Some(77), "{}", stderr(&out));
}

/// What one process of ours says to another is no option for people.
fn assert_no_hidden_option(what: &str, text: &str) {
    let words = || text.split(|c: char| !c.is_ascii_alphanumeric() && c != '-');
    // Fish writes `-l job`.
    let long: Vec<&str> = words()
        .zip(words().skip(1))
        .filter_map(|(a, b)| match a {
            "-l" => Some(b),
            _ => b.strip_prefix("--"),
        })
        .collect();
    assert!(
        long.contains(&"help"),
        "{what}: what is looked at are options"
    );
    let hidden = ["job"];
    assert!(!long.iter().any(|o| hidden.contains(o)), "{what}: {long:?}");
}

#[test]
fn pages_and_completions_know_the_verbs() {
    for (shell, word) in [
        ("bash", "complete -F _edgecap"),
        ("zsh", "#compdef edgecap"),
        ("fish", "complete -c edgecap"),
    ] {
        let out = edgecap().args(["completions", shell]).output().unwrap();
        let script = String::from_utf8(out.stdout).unwrap();
        assert!(script.contains(word), "{shell}");
        for word in [
            "doctor",
            "list-controls",
            "capture-size",
            "dry-run",
            "version",
        ] {
            assert!(script.contains(word), "{shell}: {word}");
        }
        assert_no_hidden_option(shell, &script);
    }
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &["--system"]);
    let pages = root.path().join("usr/local/share/man/man1");
    for page in std::fs::read_dir(pages).unwrap().flatten() {
        let text = std::fs::read_to_string(page.path()).unwrap();
        let bare = ["\\fB", "\\fI", "\\fR"]
            .iter()
            .fold(text, |t, font| t.replace(font, " "));
        let plain = bare.replace("\\-", "-");
        assert_no_hidden_option(&format!("{page:?}"), &plain);
    }
}

/// The service's user has to enter the folder of its settings.
#[test]
fn what_is_installed_can_be_read_whatever_root_keeps_to_itself() {
    let root = tempfile::tempdir().unwrap();
    let out = Command::new("sh")
        .args([
            "-c",
            "umask 077; exec \"$0\" install --system --root \"$1\"",
        ])
        .arg(edgecap().get_program())
        .arg(root.path())
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", stderr(&out));
    for folder in ["etc/edgecap", "usr/local/bin", "usr/local/share/man/man1"] {
        assert_eq!(mode(&root.path().join(folder)), 0o755, "{folder}");
    }
}

#[test]
fn a_prefix_of_the_working_folder_is_refused() {
    let args = ["install", "--system", "--prefix", "opt", "--dry-run"];
    assert_fails(&args, 64, &["--prefix opt", "from / on"]);
}

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
    "IPAddressDeny=any",
    "IPAddressAllow=localhost",
];
const OF_BOTH_UNITS: &[&str] = &[
    "Type=notify",
    "Restart=always",
    "RestartPreventExitStatus=64 65 78",
    "WatchdogSec=20",
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
