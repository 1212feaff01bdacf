//! `edgecap install`: what it writes, twice, and takes away again; and what systemd thinks of the unit.

use std::collections::BTreeMap;
use std::fs::Permissions;
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

/// `install` below a folder, of which nothing is expected.
fn try_install(root: &Path, more: &[&str]) -> Output {
    let mut install = edgecap();
    install.args(["install", "--root", root.to_str().unwrap()]);
    install.args(more).output().unwrap()
}

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
    assert_eq!(files(root.path()), ["etc/systemd/system/edgecap.service"]);
    assert_eq!(mode(Path::new("/dev/null")), device);
}

/// The administrator's units come before those of packages, of whatever version they are.
#[test]
fn an_installation_that_another_one_comes_before_is_refused() {
    let unit = "etc/systemd/system/edgecap.service";
    let packaged = ["--system", "--prefix", "/usr"];
    for prefix in ["/usr/local", "/opt/edge \"cap\" 50%"] {
        let root = tempfile::tempdir().unwrap();
        let earlier = ["--system", "--prefix", prefix];
        install(root.path(), &earlier);
        let there = files(root.path());
        let out = try_install(root.path(), &packaged);
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(69), "{said}");
        let unit = root.path().join(unit);
        let remedy = format!("'sudo {prefix}/bin/edgecap install --system --uninstall'");
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

/// A package or a person's home is no place for them.
#[test]
fn a_prefix_is_of_the_machines_service_alone() {
    let args = ["install", "--user", "--prefix", "/opt", "--dry-run"];
    assert_fails(&args, 64, &["--user", "--prefix"]);
}

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
    let out = Command::new("/bin/sh")
        .args(["-c", "exec /bin/sh \"$0\" remove 3>&1"])
        .arg(removal)
        .env("PATH", &bin)
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", stderr(&out));
    let done = stdout(&out);
    assert!(done.lines().any(|l| l == "rm -rf /run/edgecap"), "{done}");
    // Nobody but a package would take a mask away again.
    assert!(!done.contains(" mask "), "{done}");
}

/// The commands of a document's block of a shell that holds `word`.
fn printed_commands<'a>(document: &'a str, word: &str) -> Vec<&'a str> {
    let blocks = document.split("```sh\n").skip(1);
    let mut blocks = blocks.filter_map(|rest| rest.split("```").next());
    let block = blocks.find(|block| block.contains(word)).expect(word);
    block.lines().collect()
}

#[test]
fn a_package_is_made_of_this_version_alone() {
    let place = tempfile::tempdir().unwrap();
    let at = |path: &str| place.path().join(path);
    let old = at("target/package/usr/share/man/man1/edgecap-gone.1");
    let settings = at("target/package/etc/edgecap/edgecap.toml");
    for (file, text) in [(&old, "gone"), (&settings, "# Of an earlier version.\n")] {
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    }
    std::fs::create_dir_all(at("target/release")).unwrap();
    symlink(edgecap().get_program(), at("target/release/edgecap")).unwrap();
    let manual = include_str!("../../docs/operate.md");
    for line in printed_commands(manual, "--root target/package") {
        if line.starts_with("cargo ") || line.starts_with("sudo ") {
            continue;
        }
        let mut shell = Command::new("sh");
        let out = shell.args(["-c", line]).current_dir(place.path()).output();
        let out = out.unwrap();
        assert!(out.status.success(), "{line}: {}", stderr(&out));
    }
    assert!(!old.exists());
    let sample = include_str!("../../deploy/edgecap.toml");
    assert_eq!(std::fs::read_to_string(settings).unwrap(), sample);
}

/// Python's own environment is the system's on most of them, and takes no packages of others.
#[test]
fn what_is_printed_for_pip_has_an_environment_of_its_own() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for file in [
        "README.md",
        "docs/clients.md",
        "docs/operate.md",
        "deploy/release",
        "deploy/wheel",
        "src/commands/run/hints.rs",
    ] {
        let text = std::fs::read_to_string(root.join(file)).unwrap();
        for (at, _) in text.match_indices("pip install") {
            let line = text[at..].lines().next();
            assert!(text[..at].ends_with("/bin/"), "{file}: {line:?}");
        }
    }
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

/// `install` for a person whose `systemctl` fails at this verb.
fn install_with_systemctl(home: &Path, verb: &str, more: &[&str]) -> Output {
    let systemctl = home.join("systemctl");
    let text = format!(
        "#!/bin/sh\n[ \"$2\" != {verb} ] || {{ echo 'Unit edgecap.service is masked.' >&2; exit 1; }}\n"
    );
    script(&systemctl, &text);
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
    let folder = tempfile::tempdir().unwrap();
    let mut somebody = match rustix::process::geteuid().is_root() {
        true if !tools::has("setpriv") => return,
        true => as_stranger(folder.path()),
        false => edgecap(),
    };
    let out = somebody.args(["install", "--system"]).output().unwrap();
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
