//! Which files go where, and which commands follow.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use edgecap_client::place::SERVICE_FOLDER;

use super::below;
use super::pages::{Shell, completions, manual};
use super::step::{Step, digest};
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
/// Where a person's unit in `deploy/` looks for the settings.
const USUAL_CONFIG: &str = "%h/.config/edgecap/edgecap.toml";
const SERVICE: &str = "edgecap.service";
/// Where the administrator's own units lie, and those that are masked.
const ADMINISTRATORS: &str = "/etc/systemd/system";

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
        let usual = home.join(".config");
        let config = absolute("XDG_CONFIG_HOME").unwrap_or_else(|| usual.clone());
        let share = absolute("XDG_DATA_HOME").unwrap_or_else(|| home.join(".local/share"));
        Ok(Self {
            system: false,
            program: home.join(".local/bin/edgecap"),
            config: config.join("edgecap").join(FILE_NAME),
            // The person's service manager has not read what sets the variables of a shell.
            units: usual.join("systemd/user"),
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

    /// What a person types to speak to the service manager.
    pub fn systemctl(&self) -> &'static str {
        match self.system {
            true => "sudo systemctl",
            false => "systemctl --user",
        }
    }

    /// The unit's place that leads nowhere where somebody wants no such service (`systemctl mask`).
    pub fn mask(&self) -> PathBuf {
        match self.system {
            true => Path::new(ADMINISTRATORS).join(SERVICE),
            false => self.units.join(SERVICE),
        }
    }

    /// The place of a unit that the machine takes instead of this installation's.
    pub fn comes_before(&self) -> Option<PathBuf> {
        let is_behind = self.system && self.units != Path::new(ADMINISTRATORS);
        is_behind.then(|| Path::new(ADMINISTRATORS).join(SERVICE))
    }

    /// Where the program goes.
    pub fn program(&self) -> &Path {
        &self.program
    }

    /// What tells settings that nobody has changed from others, when the program that wrote them has gone.
    fn config_digest(&self) -> PathBuf {
        self.config.with_added_extension("blake3")
    }

    /// All files with their permissions, the settings left out.
    fn files(&self) -> anyhow::Result<Vec<(PathBuf, Vec<u8>, u32)>> {
        let this = std::env::current_exe()?;
        let program = std::fs::read(&this).map_err(|e| Failure::no_input(&this, &e))?;
        let mut files = vec![(self.program.clone(), program, 0o755)];
        let mut text = |path: PathBuf, text: String| files.push((path, text.into_bytes(), 0o644));
        if self.system {
            let unit = UNIT.replace(PACKAGED, &word(&self.program)?);
            text(self.units.join(SERVICE), unit);
            text(self.rules.join("sysusers.d/edgecap.conf"), SYSUSERS.into());
            text(self.rules.join("tmpfiles.d/edgecap.conf"), TMPFILES.into());
            text(
                self.rules.join("udev/rules.d/70-edgecap.rules"),
                UDEV.into(),
            );
        } else {
            let unit = USER_UNIT.replace(USUAL_CONFIG, &word(&self.config)?);
            text(self.units.join(SERVICE), unit);
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

/// A path as one word of a unit's command line.
///
/// # Errors
/// Exit code 64 where a unit cannot name it.
fn word(path: &Path) -> Result<String, Failure> {
    // What stands behind a dollar is a variable, but not in the program's own name.
    let is_kept = |text: &&str| !text.contains(|c: char| c == '$' || c.is_control());
    let Some(text) = path.to_str().filter(is_kept) else {
        return Err(Failure::usage(format!(
            "{}: expected a path in UTF-8 that a unit of systemd can name, without '$' and line breaks; choose another",
            path.display()
        )));
    };
    let escaped = text
        .replace('\\', r"\\")
        .replace('"', "\\\"")
        .replace('%', "%%");
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+%".contains(c);
    Ok(match escaped.chars().all(is_plain) {
        true => escaped,
        false => format!("\"{escaped}\""),
    })
}

/// The program that a unit starts, as [`word`] writes it; `None` where it says none.
pub fn program_of(unit: &str) -> Option<PathBuf> {
    // An empty one takes back those before; what stands before a path says how it is started.
    let how = |c: char| "-@:+!|".contains(c) || c.is_whitespace();
    let commands = unit.lines().filter_map(|l| l.strip_prefix("ExecStart="));
    let mut commands = commands.map(|command| command.trim_start_matches(how));
    let command = commands.rfind(|command| !command.is_empty())?;
    let (mut text, mut rest) = (String::new(), command.chars());
    let is_quoted = rest.as_str().starts_with('"');
    if is_quoted {
        rest.next();
    }
    while let Some(c) = rest.next() {
        match c {
            '"' if is_quoted => break,
            c if c.is_whitespace() && !is_quoted => break,
            '\\' | '%' => text.extend(rest.next()),
            c => text.push(c),
        }
    }
    (!text.is_empty()).then(|| text.into())
}

/// Everything that makes, or undoes, an installation below `root`.
///
/// # Errors
/// If this program cannot be read, or a unit cannot name it.
pub fn plan(layout: &Layout, uninstall: bool, root: Option<&Path>) -> anyhow::Result<Vec<Step>> {
    let files = layout.files()?;
    let config = layout.config.clone();
    let systemctl: &[&str] = if layout.system {
        &["systemctl"]
    } else {
        &["systemctl", "--user"]
    };
    if uninstall {
        return Ok(undoing(layout, files, systemctl, root));
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
    let is_ours = match fs::read(&config) {
        Ok(found) => found == SAMPLE.as_bytes(),
        Err(e) => e.kind() == ErrorKind::NotFound,
    };
    // A package has an account of its own of what was changed.
    if is_ours && root.is_none() {
        let name = config.file_name().unwrap_or_default().display();
        steps.push(Step::Write {
            path: layout.config_digest(),
            bytes: format!("{}  {name}\n", digest(SAMPLE.as_bytes())).into(),
            mode: 0o644,
            kept: false,
        });
    }
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
    // A person's service manager that looks elsewhere for units is given a link to the one that is named by its path.
    let unit = match layout.system {
        true => SERVICE.to_owned(),
        false => layout.units.join(SERVICE).display().to_string(),
    };
    steps.extend([
        Step::try_run(&[systemctl, &["daemon-reload"]].concat()),
        Step::serve(&[systemctl, &["enable", &unit]].concat()),
        // One that ran before is another program now.
        Step::serve(&[systemctl, &["restart", SERVICE]].concat()),
    ]);
    Ok(steps)
}

/// What takes an installation away, of whatever version its settings are.
fn undoing(
    layout: &Layout,
    files: Vec<(PathBuf, Vec<u8>, u32)>,
    systemctl: &[&str],
    root: Option<&Path>,
) -> Vec<Step> {
    let mut steps = Vec::new();
    // Of what was taken away before nothing runs.
    if layout.units.join(SERVICE).exists() {
        steps.push(Step::serve(
            &[systemctl, &["disable", "--now", SERVICE]].concat(),
        ));
    }
    let remove = |path| Step::Remove {
        path,
        unless_changed_from: None,
    };
    steps.extend(files.into_iter().map(|(path, ..)| remove(path)));
    let noted = layout.config_digest();
    let digests = fs::read_to_string(below(root, &noted)).unwrap_or_default();
    let digests = digests.split_whitespace().take(1).map(str::to_owned);
    let unchanged = digests.chain([digest(SAMPLE.as_bytes())]).collect();
    steps.push(remove(noted));
    steps.push(Step::Remove {
        path: layout.config.clone(),
        unless_changed_from: Some(unchanged),
    });
    steps.push(Step::try_run(&[systemctl, &["daemon-reload"]].concat()));
    if layout.system {
        // The unit keeps it while the service is stopped.
        steps.push(Step::Clear {
            path: SERVICE_FOLDER.into(),
        });
    }
    steps
}
