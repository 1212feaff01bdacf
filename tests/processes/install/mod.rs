//! `edgecap install`: what it writes, twice; what of it others have a part in lies in files of their own.

mod others;
mod packages;
mod pages;
mod removal;
mod settings;
mod units;

use std::collections::BTreeMap;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;
use std::process::{Command, Output};

use crate::program::{as_stranger, assert_fails, edgecap, script, stderr, stdout, tools};

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
        "usr/local/share/doc/edgecap/THIRD-PARTY.txt",
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
    let home = root.path().join("home/somebody");
    assert!(std::fs::read_dir(home).unwrap().next().is_none());
}

/// `install` below a folder, of which nothing is expected.
fn try_install(root: &Path, more: &[&str]) -> Output {
    let mut install = edgecap();
    install.args(["install", "--root", root.to_str().unwrap()]);
    install.args(more).output().unwrap()
}

#[test]
fn what_a_link_leads_to_stays_as_it_is() {
    let root = tempfile::tempdir().unwrap();
    let bin = root.path().join("usr/local/bin");
    std::fs::create_dir_all(&bin).unwrap();
    let built = root.path().join("built");
    std::fs::write(&built, "somebody's").unwrap();
    symlink(&built, bin.join("edgecap")).unwrap();
    let again = words(&install(root.path(), &["--system"]));
    assert_eq!(again["replace"], 1);
    assert_eq!(std::fs::read_to_string(&built).unwrap(), "somebody's");
    let program = bin.join("edgecap");
    assert!(!program.is_symlink());
    assert_eq!(mode(&program), 0o755);
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

/// A package or a person's home is no place for them.
#[test]
fn a_prefix_is_of_the_machines_service_alone() {
    let args = ["install", "--user", "--prefix", "/opt", "--dry-run"];
    assert_fails(&args, 64, &["--user", "--prefix"]);
}

#[test]
fn a_prefix_of_the_working_folder_is_refused() {
    let args = ["install", "--system", "--prefix", "opt", "--dry-run"];
    assert_fails(&args, 64, &["--prefix opt", "from / on"]);
}

#[test]
fn what_is_no_installation_is_refused() {
    let out = edgecap().args(["install"]).output().unwrap();
    assert_eq!(out.status.code(), Some(64));
    // Only root may, and a test that is root must not.
    let folder = tempfile::tempdir().unwrap();
    let mut somebody = match rustix::process::geteuid().is_root() {
        true if !tools::has("setpriv") => return,
        true => as_stranger(folder.path()),
        false => edgecap(),
    };
    let out = somebody.args(["install", "--system"]).output().unwrap();
    assert_eq!(out.status.code(), Some(77), "{}", stderr(&out));
}

/// `install` for a person whose `systemctl` lies in the home and fails at this verb.
fn person_with_systemctl(home: &Path, verb: &str) -> Command {
    let systemctl = home.join("systemctl");
    let text = format!(
        "#!/bin/sh\n[ \"$2\" != {verb} ] || {{ echo 'Unit edgecap.service is masked.' >&2; exit 1; }}\n"
    );
    script(&systemctl, &text);
    let mut install = edgecap();
    install
        .args(["install", "--user"])
        .env("HOME", home)
        .env("PATH", home)
        .env_remove("XDG_CONFIG_HOME")
        .env_remove("XDG_DATA_HOME");
    install
}

fn install_with_systemctl(home: &Path, verb: &str, more: &[&str]) -> Output {
    let mut install = person_with_systemctl(home, verb);
    install.args(more).output().unwrap()
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

/// The folder of a person's programs is in `PATH` from a login on that finds it.
#[test]
fn commands_that_are_printed_are_found() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    let bin = home.join(".local/bin");
    for (path, program) in [
        (home.display().to_string(), bin.join("edgecap")),
        (
            format!("{}:{}", home.display(), bin.display()),
            "edgecap".into(),
        ),
    ] {
        let mut install = person_with_systemctl(home, "nothing");
        let out = install.env("PATH", path).output().unwrap();
        assert!(out.status.success(), "{}", stderr(&out));
        let words = format!("\n'{} status' says", program.display());
        assert!(stdout(&out).contains(&words), "{words} in {}", stdout(&out));
    }
}
