//! `deploy/release` and `deploy/wheel`: what they need, what they find in the folder that they are given, what they
//! pack, and what they tell the build.

mod folder;
mod packed;
mod third_party;
mod wheel;

use std::path::PathBuf;
use std::process::{Command, Output};

use crate::program::{script, stderr, stdout};

/// As cargo: puts the program and the library where its variables say, or below `TRIPLE`, which stands for a key of
/// its settings, and says so. The program says its commit.
const CARGO: &str = r#"for folder in "$CARGO_TARGET_DIR" "$CARGO_BUILD_TARGET_DIR" target; do
  [ -z "$folder" ] || break
done
case $folder in /*) ;; *) folder=$PWD/$folder ;; esac
to=$folder/$CARGO_BUILD_TARGET/$TRIPLE/release
mkdir -p "$to"
printf '#!/bin/sh\necho "edgecap %s (commit %s)"\n' "$VERSION" "$EDGECAP_COMMIT" >"$to/edgecap"
chmod 755 "$to/edgecap"
echo library >"$to/libedgecap_c.so"
echo library >"$to/libedgecap_c.a"
printf '{"filenames":["%s"],"executable":"%s"}\n' "$to/edgecap" "$to/edgecap"
printf '{"filenames":["%s"],"executable":null}\n' "$to/libedgecap_c.so"
"#;
/// The commit that [`GIT`] tells.
const COMMIT: &str = "0123456789ab";
/// A repository that knows what the archives need.
const GIT: &str = r"case $1 in
  ls-files) printf '%s\0' README.md pyproject.toml models/open/attribution.txt ;;
  describe) echo 0123456789ab ;;
  log) echo 1000000000 ;;
esac";
/// As git in a repository around the sources, which are none of its files.
const FOREIGN_GIT: &str = r"case $1 in
  describe) echo fedcba987654 ;;
  log) echo 2000000000 ;;
esac";

/// A working folder with a copy of what the scripts read, and programs in place of those that they run.
struct Sources(tempfile::TempDir);

impl Sources {
    /// As they are unpacked from an archive: without a repository.
    fn unpacked() -> Self {
        let sources = Self(tempfile::tempdir().unwrap());
        let to = sources.at("sources");
        std::fs::create_dir(&to).unwrap();
        // By a child: what this process has open for writing while a neighbour forks cannot be run for as long as the
        // fork has it open, too.
        let copied = Command::new("cp")
            .args(["--recursive", "--parents"])
            .args(["Cargo.toml", "pyproject.toml", "README.md"])
            .args(["LICENSE", "LICENSE-MIT", "LICENSE-APACHE", "deploy"])
            .args(["models/open/attribution.txt", "clients/c/install"])
            .args([
                "clients/c/include",
                "clients/c/cmake",
                "clients/c/pkgconfig",
            ])
            .arg(&to)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .status();
        assert!(copied.unwrap().success());
        sources.stand_in("cargo", CARGO);
        sources.stand_in("maturin", "exit 9");
        sources.stand_in("git", FOREIGN_GIT);
        sources
    }

    /// As they are cloned.
    fn cloned() -> Self {
        let sources = Self::unpacked();
        std::fs::create_dir(sources.at("sources/.git")).unwrap();
        sources.stand_in("git", GIT);
        sources
    }

    /// A path below the working folder.
    fn at(&self, path: &str) -> PathBuf {
        self.0.path().join(path)
    }

    /// Puts a program where it is found before the machine's own.
    fn stand_in(&self, name: &str, text: &str) {
        std::fs::create_dir_all(self.at("bin")).unwrap();
        script(&self.at("bin").join(name), &format!("#!/bin/sh\n{text}\n"));
    }

    /// One of the scripts with the folder `out`, in the working folder.
    fn script(&self, name: &str) -> Command {
        let path = std::env::var("PATH").unwrap_or_default();
        let mut command = Command::new(self.at("sources/deploy").join(name));
        command
            .arg("out")
            .current_dir(self.0.path())
            .env("PATH", format!("{}:{path}", self.at("bin").display()))
            .env("VERSION", env!("CARGO_PKG_VERSION"));
        for variable in [
            "CARGO_BUILD_TARGET",
            "CARGO_BUILD_TARGET_DIR",
            "CARGO_TARGET_DIR",
            "EDGECAP_COMMIT",
            "EDGECAP_LIBRARIES",
            "FEATURES",
            "PROFILE",
            "SOURCE_DATE_EPOCH",
            "TRIPLE",
        ] {
            command.env_remove(variable);
        }
        command
    }

    /// Runs one of the scripts to its end.
    fn output(&self, name: &str) -> Output {
        self.script(name).output().unwrap()
    }

    /// Makes a maturin that makes a wheel for this machine; its name.
    fn with_maturin(&self) -> String {
        // Where the wheel goes is its last argument.
        let wheel = format!("edgecap-9.9.9-py3-none-manylinux_2_34_{}.whl", machine());
        let maturin = format!("for out; do :; done\necho built >\"$out/{wheel}\"");
        self.stand_in("maturin", &maturin);
        wheel
    }
}

/// As `uname -m` names the architecture.
fn machine() -> String {
    let machine = Command::new("uname").arg("-m").output().unwrap();
    stdout(&machine).trim().to_owned()
}

#[test]
fn without_maturin_nothing_is_built_or_removed() {
    let sources = Sources::cloned();
    let earlier = sources.at("out/edgecap-0.1.0-py3-none-any.whl");
    std::fs::create_dir(sources.at("out")).unwrap();
    std::fs::write(&earlier, "").unwrap();
    // Nothing but the shell is found.
    let bin = sources.at("shell");
    std::fs::create_dir(&bin).unwrap();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut shells = std::env::split_paths(&path).map(|folder| folder.join("bash"));
    let shell = shells.find(|shell| shell.exists()).expect("bash");
    std::os::unix::fs::symlink(shell, bin.join("bash")).unwrap();
    for name in ["release", "wheel"] {
        let out = sources.script(name).env("PATH", &bin).output().unwrap();
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(69), "{name}: {said}");
        assert!(said.contains("expected maturin"), "{name}: {said}");
        assert!(earlier.exists(), "{name}");
    }
}
