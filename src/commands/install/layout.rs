//! Which files an installation has, and where.

use std::fs;
use std::path::{Path, PathBuf};

use super::below;
use super::pages::{Shell, completions, manual};
use super::unit::{program_of, word};
use crate::commands::exit::Failure;
use crate::config::{FILE_NAME, SYSTEM_FOLDER};

const UNIT: &str = include_str!("../../../deploy/edgecap.service");
const USER_UNIT: &str = include_str!("../../../deploy/edgecap-user.service");
const SYSUSERS: &str = include_str!("../../../deploy/edgecap.sysusers");
const TMPFILES: &str = include_str!("../../../deploy/edgecap.tmpfiles");
const UDEV: &str = include_str!("../../../deploy/70-edgecap.rules");
/// Licences of what the program holds of others, who ask for them wherever it goes.
const THIRD_PARTY: &str = include_str!("../../../deploy/THIRD-PARTY.txt");
/// Where the unit in `deploy/` looks for the program.
const PACKAGED: &str = "/usr/bin/edgecap";
/// Where a person's unit in `deploy/` looks for the settings.
const USUAL_CONFIG: &str = "%h/.config/edgecap/edgecap.toml";
/// The unit's name.
pub const SERVICE: &str = "edgecap.service";
/// Where the administrator's own units lie, and those that are masked.
const ADMINISTRATORS: &str = "/etc/systemd/system";
/// Where the machine's units lie; those of a folder come before those of the next one.
const UNIT_FOLDERS: [&str; 4] = [
    ADMINISTRATORS,
    "/usr/local/lib/systemd/system",
    "/usr/lib/systemd/system",
    "/lib/systemd/system",
];
/// Prefixes whose folders belong to the machine, whatever is in them.
const SHARED_PREFIXES: [&str; 3] = ["/", "/usr", "/usr/local"];

/// What tells of another installation of the machine.
#[derive(Debug, Clone)]
pub struct Other {
    /// Its unit.
    pub unit: PathBuf,
    /// The program that the unit starts.
    pub program: PathBuf,
    /// Whether the machine takes that unit instead of this installation's.
    pub comes_before: bool,
}

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
    /// Folders below these hold nothing but installations.
    own: Vec<PathBuf>,
}

impl Layout {
    /// For the machine: below `/usr` as packages have it, elsewhere with what an administrator adds in `/etc`.
    pub fn system(prefix: &Path) -> Self {
        let rules = if prefix == Path::new("/usr") {
            PathBuf::from("/usr/lib")
        } else {
            PathBuf::from("/etc")
        };
        // A prefix of its own goes, too, but not a folder that every machine has, as /opt.
        let own = match prefix.parent() {
            Some(above) if above.parent().is_some() => above,
            _ => prefix,
        };
        let is_shared = SHARED_PREFIXES.iter().any(|p| prefix == Path::new(p));
        Self {
            system: true,
            program: prefix.join("bin/edgecap"),
            config: Path::new(SYSTEM_FOLDER).join(FILE_NAME),
            units: rules.join("systemd/system"),
            share: prefix.join("share"),
            rules,
            own: match is_shared {
                true => Vec::new(),
                false => vec![own.to_owned()],
            },
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
            own: vec![home, share.clone()],
            share,
            rules: PathBuf::new(),
        })
    }

    /// Where `sysusers.d` and `tmpfiles.d` lie.
    pub fn rules(&self) -> &Path {
        &self.rules
    }

    /// Folders below these hold nothing but installations.
    pub fn own(&self) -> &[PathBuf] {
        &self.own
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

    /// The folder in which `systemctl edit` leaves changes to the unit.
    pub fn drop_ins(&self) -> PathBuf {
        self.mask().with_added_extension("d")
    }

    /// The unit of another installation of the machine below `root`; of several the one that the machine takes.
    pub fn other(&self, root: Option<&Path>) -> Option<Other> {
        let folders = UNIT_FOLDERS.iter().map(Path::new);
        let mut others = folders.filter(|_| self.system).filter_map(|folder| {
            let unit = folder.join(SERVICE);
            let text = fs::read_to_string(below(root, &unit)).ok()?;
            let program = program_of(&text)?;
            // The same program is a copy that the administrator has changed; one of another name is the
            // administrator's, too.
            let is_other = program.ends_with("edgecap") && program != self.program;
            let place = |folder| UNIT_FOLDERS.iter().position(|f| folder == Path::new(f));
            is_other.then(|| Other {
                comes_before: place(folder) < place(&self.units),
                unit,
                program,
            })
        });
        others.next()
    }

    /// Where its unit goes.
    pub fn unit(&self) -> PathBuf {
        self.units.join(SERVICE)
    }

    /// Where the program goes.
    pub fn program(&self) -> &Path {
        &self.program
    }

    /// What tells settings that nobody has changed from others, when the program that wrote them has gone.
    pub fn config_digest(&self) -> PathBuf {
        self.config.with_added_extension("blake3")
    }

    /// All files with their permissions, the settings left out.
    ///
    /// # Errors
    /// If this program cannot be read, or a unit cannot name it.
    pub fn files(&self) -> anyhow::Result<Vec<(PathBuf, Vec<u8>, u32)>> {
        let this = std::env::current_exe()?;
        let program = std::fs::read(&this).map_err(|e| Failure::no_input(&this, &e))?;
        let mut files = vec![(self.program.clone(), program, 0o755)];
        let mut text = |path: PathBuf, text: String| files.push((path, text.into_bytes(), 0o644));
        if self.system {
            let unit = UNIT.replace(PACKAGED, &word(&self.program)?);
            text(self.unit(), unit);
            text(self.rules.join("sysusers.d/edgecap.conf"), SYSUSERS.into());
            text(self.rules.join("tmpfiles.d/edgecap.conf"), TMPFILES.into());
            text(
                self.rules.join("udev/rules.d/70-edgecap.rules"),
                UDEV.into(),
            );
        } else {
            let unit = USER_UNIT.replace(USUAL_CONFIG, &word(&self.config)?);
            text(self.unit(), unit);
        }
        let licences = self.share.join("doc/edgecap/THIRD-PARTY.txt");
        text(licences, THIRD_PARTY.into());
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

    /// Pages of the manual that another version has brought, of verbs that this one, which has `files`, does not know.
    pub fn outdated_pages(
        &self,
        files: &[(PathBuf, Vec<u8>, u32)],
        root: Option<&Path>,
    ) -> Vec<PathBuf> {
        let folder = self.share.join("man/man1");
        let found = fs::read_dir(below(root, &folder)).into_iter().flatten();
        let mut pages: Vec<PathBuf> = found
            .flatten()
            .filter(|page| {
                let name = page.file_name();
                let is_verbs = name.to_string_lossy().starts_with("edgecap-");
                is_verbs && fs::read_to_string(page.path()).is_ok_and(|text| is_own_page(&text))
            })
            .map(|page| folder.join(page.file_name()))
            .filter(|page| !files.iter().any(|(path, ..)| path == page))
            .collect();
        pages.sort();
        pages
    }
}

/// Whether the text of a page is of those that [`manual`] makes, of any version: others may have pages of such names.
fn is_own_page(text: &str) -> bool {
    let is_title = |l: &str| l.starts_with(".TH edgecap-") && l.ends_with("\" edgecap");
    text.lines().any(is_title)
}
