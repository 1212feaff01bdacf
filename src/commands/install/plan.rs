//! Which files go where, and which commands follow.

use std::path::{Path, PathBuf};

use super::pages::{Shell, completions, manual};
use super::step::Step;
use crate::commands::exit::Failure;
use crate::commands::settings::SAMPLE;
use crate::config::{FILE_NAME, SYSTEM_FOLDER};

const UNIT: &str = include_str!("../../../deploy/edgecap.service");
const USER_UNIT: &str = include_str!("../../../deploy/edgecap-user.service");
const SYSUSERS: &str = include_str!("../../../deploy/edgecap.sysusers");
const TMPFILES: &str = include_str!("../../../deploy/edgecap.tmpfiles");
const UDEV: &str = include_str!("../../../deploy/70-edgecap.rules");
/// Where the unit in `deploy/` looks for the program.
const PACKAGED: &str = "/usr/bin/edgecap";
const SERVICE: &str = "edgecap.service";

/// The folders of an installation.
#[derive(Debug, Clone)]
pub struct Layout {
    system: bool,
    program: PathBuf,
    config: PathBuf,
    units: PathBuf,
    share: PathBuf,
    /// With `sysusers.d`, `tmpfiles.d` and `udev/rules.d`, for the machine.
    rules: PathBuf,
}

impl Layout {
    /// For the machine: below `/usr` as packages have it, elsewhere with what an administrator adds in `/etc`.
    pub fn system(prefix: &Path) -> Self {
        let rules = if prefix == Path::new("/usr") {
            PathBuf::from("/usr/lib")
        } else {
            PathBuf::from("/etc")
        };
        Self {
            system: true,
            program: prefix.join("bin/edgecap"),
            config: Path::new(SYSTEM_FOLDER).join(FILE_NAME),
            units: rules.join("systemd/system"),
            share: prefix.join("share"),
            rules,
        }
    }

    /// For this user.
    ///
    /// # Errors
    /// Without a home.
    pub fn user() -> anyhow::Result<Self> {
        let absolute = |variable| {
            std::env::var_os(variable)
                .map(PathBuf::from)
                .filter(|p| p.is_absolute())
        };
        let home = absolute("HOME").ok_or_else(|| {
            Failure::usage("install --user: expected this user's home in HOME, found none")
        })?;
        let config = absolute("XDG_CONFIG_HOME").unwrap_or_else(|| home.join(".config"));
        let share = absolute("XDG_DATA_HOME").unwrap_or_else(|| home.join(".local/share"));
        Ok(Self {
            system: false,
            program: home.join(".local/bin/edgecap"),
            config: config.join("edgecap").join(FILE_NAME),
            units: config.join("systemd/user"),
            share,
            rules: PathBuf::new(),
        })
    }

    /// Whether it is the machine's.
    pub fn is_system(&self) -> bool {
        self.system
    }

    /// The settings.
    pub fn config(&self) -> &Path {
        &self.config
    }

    /// All files with their permissions, the settings left out.
    fn files(&self) -> anyhow::Result<Vec<(PathBuf, Vec<u8>, u32)>> {
        let this = std::env::current_exe()?;
        let program = std::fs::read(&this).map_err(|e| Failure::no_input(&this, &e))?;
        let mut files = vec![(self.program.clone(), program, 0o755)];
        let mut text = |path: PathBuf, text: String| files.push((path, text.into_bytes(), 0o644));
        if self.system {
            let unit = UNIT.replace(PACKAGED, &self.program.display().to_string());
            text(self.units.join(SERVICE), unit);
            text(self.rules.join("sysusers.d/edgecap.conf"), SYSUSERS.into());
            text(self.rules.join("tmpfiles.d/edgecap.conf"), TMPFILES.into());
            text(
                self.rules.join("udev/rules.d/70-edgecap.rules"),
                UDEV.into(),
            );
        } else {
            text(self.units.join(SERVICE), USER_UNIT.into());
        }
        for (name, page) in manual()? {
            text(self.share.join("man/man1").join(name), page);
        }
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            let place = match shell {
                Shell::Bash => "bash-completion/completions/edgecap",
                Shell::Zsh => "zsh/site-functions/_edgecap",
                Shell::Fish => "fish/vendor_completions.d/edgecap.fish",
            };
            text(self.share.join(place), completions(shell)?);
        }
        Ok(files)
    }
}

/// Everything that makes, or undoes, an installation.
///
/// # Errors
/// If this program cannot be read.
pub fn plan(layout: &Layout, uninstall: bool) -> anyhow::Result<Vec<Step>> {
    let files = layout.files()?;
    let config = layout.config.clone();
    let systemctl: &[&'static str] = if layout.system {
        &["systemctl"]
    } else {
        &["systemctl", "--user"]
    };
    let with = |more: &[&'static str]| [systemctl, more].concat();
    if uninstall {
        let mut steps = Vec::new();
        // Of what was taken away before nothing runs.
        if layout.units.join(SERVICE).exists() {
            steps.push(Step::serve(&with(&["disable", "--now", SERVICE])));
        }
        steps.extend(files.into_iter().map(|(path, ..)| Step::Remove {
            path,
            unless_changed_from: None,
        }));
        steps.push(Step::Remove {
            path: config,
            unless_changed_from: Some(SAMPLE.into()),
        });
        steps.push(Step::try_run(&with(&["daemon-reload"])));
        return Ok(steps);
    }
    let mut steps: Vec<Step> = files
        .into_iter()
        .map(|(path, bytes, mode)| Step::Write {
            path,
            bytes,
            mode,
            kept: false,
        })
        .collect();
    steps.push(Step::Write {
        path: config,
        bytes: SAMPLE.into(),
        // It may hold a token. The service's group is given it by the rule in `edgecap.tmpfiles`.
        mode: if layout.system { 0o640 } else { 0o600 },
        kept: true,
    });
    if layout.system {
        let conf = |kind: &str| {
            layout
                .rules
                .join(kind)
                .join("edgecap.conf")
                .display()
                .to_string()
        };
        steps.extend([
            Step::run(&["systemd-sysusers", &conf("sysusers.d")]),
            Step::run(&["systemd-tmpfiles", "--create", &conf("tmpfiles.d")]),
            Step::try_run(&["udevadm", "control", "--reload"]),
            Step::try_run(&["udevadm", "trigger", "--subsystem-match=video4linux"]),
        ]);
    }
    steps.extend([
        Step::try_run(&with(&["daemon-reload"])),
        Step::serve(&with(&["enable", SERVICE])),
        // One that ran before is another program now.
        Step::serve(&with(&["restart", SERVICE])),
    ]);
    Ok(steps)
}
