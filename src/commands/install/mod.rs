//! `edgecap install`: the service, for the machine or for one person, from files that this program carries.

mod layout;
mod pages;
mod plan;
mod step;
mod unit;

use std::path::{Path, PathBuf};

use rustix::fs::Mode;
use rustix::process::{geteuid, umask};

use super::exit::Failure;
use super::say;
use layout::{Layout, Other};
use plan::plan;
use step::{Done, Loss, Step, is_masked};

pub use pages::{Shell, completions};

/// Options of `edgecap install`.
#[derive(Debug, clap::Args)]
pub struct InstallArgs {
    #[command(flatten)]
    whose: Whose,
    /// Take it away again; changed settings, recordings, changes to the unit and the user stay
    #[arg(long)]
    uninstall: bool,
    /// Print every file and command, and do nothing
    #[arg(long)]
    dry_run: bool,
    /// Install below this folder, for images and packages: only files, no commands
    #[arg(long, value_name = "DIR")]
    root: Option<PathBuf>,
    /// Where the program itself goes with --system; /usr in packages
    #[arg(
        long,
        value_name = "DIR",
        default_value = "/usr/local",
        conflicts_with = "user"
    )]
    prefix: PathBuf,
}

#[derive(Debug, clap::Args)]
#[group(required = true, multiple = false)]
struct Whose {
    /// A service of the machine, with a user of its own: starts with the machine
    #[arg(long)]
    system: bool,
    /// A service of this user: starts with the first login
    #[arg(long)]
    user: bool,
}

/// Installs or uninstalls the service. What is there and right is left alone, settings always.
///
/// # Errors
/// Missing rights, files that cannot be written, commands that fail. Where only the service is not as it should be, all
/// the rest is done first.
pub fn install(args: InstallArgs) -> anyhow::Result<()> {
    let layout = if args.whose.system {
        if !args.prefix.is_absolute() {
            return Err(Failure::usage(format!(
                "--prefix {}: expected a folder from / on, found one of the working folder",
                args.prefix.display()
            ))
            .into());
        }
        if args.root.is_none() && !args.dry_run && !geteuid().is_root() {
            return Err(Failure::permission(
                "install --system changes the machine: run it with sudo, or use --user, or look first with --dry-run",
            )
            .into());
        }
        // The service's user has to enter the folders that are made, others read the manual.
        umask(Mode::from_raw_mode(0o022));
        Layout::system(&args.prefix)
    } else {
        Layout::user()?
    };
    let root = args.root.as_deref();
    if args.uninstall {
        expect_this(&layout, root)?;
    } else {
        expect_no_mask(&layout, root)?;
        expect_no_other(&layout, root)?;
    }
    let steps = plan(&layout, args.uninstall, root)?;
    let mut lost = None;
    let mut was_there = false;
    for step in &steps {
        let wanted = root.is_none() || !matches!(step, Step::Run { .. });
        let done = match args.dry_run {
            true if wanted => step.look(root),
            false if wanted => step.take(root)?,
            _ => Done::Skipped,
        };
        let is_of_file = !matches!(step, Step::Run { .. });
        was_there |= is_of_file && matches!(done, Done::Removed | Done::Failed { .. });
        let mut line = format!("{:9} {}", done.word(), step.describe(root));
        if let Done::Failed { why, loss } = done {
            line = format!("{line}: {why}");
            if loss == Loss::Service {
                lost.get_or_insert(format!("{}: {why}", step.describe(root)));
            }
        }
        say::out(&line);
    }
    if let Some(why) = lost {
        return Err(Failure::unavailable(without_service(args.uninstall, &why)).into());
    }
    if !args.dry_run && root.is_none() {
        say::out(&match (args.uninstall, was_there) {
            (false, _) => how_to_go_on(&layout),
            (true, true) => "edgecap is uninstalled".to_owned(),
            (true, false) => "nothing was installed here".to_owned(),
        });
    }
    Ok(())
}

/// Refuses to install a service that somebody wants nobody to have.
fn expect_no_mask(layout: &Layout, root: Option<&Path>) -> Result<(), Failure> {
    let unit = below(root, &layout.mask());
    match is_masked(&unit) {
        true => Err(Failure::unavailable(format!(
            "{} leads to /dev/null: the service is masked, which '{} unmask edgecap' ends; then install again",
            unit.display(),
            layout.systemctl()
        ))),
        false => Ok(()),
    }
}

/// Refuses to install a unit that the machine would not take, as one of another program comes before it.
///
/// # Errors
/// Exit code 69.
fn expect_no_other(layout: &Layout, root: Option<&Path>) -> Result<(), Failure> {
    match layout.other(root).filter(|other| other.comes_before) {
        Some(other) => Err(Failure::unavailable(format!(
            "{} comes first, so that the service would run another installation: {}; then install again",
            below(root, &other.unit).display(),
            taken_away_by(&other)
        ))),
        None => Ok(()),
    }
}

/// Refuses to uninstall what is not there while another installation is, whose settings and memory would go.
///
/// # Errors
/// Exit code 69.
fn expect_this(layout: &Layout, root: Option<&Path>) -> Result<(), Failure> {
    let own = below(root, &layout.unit());
    let is_there = own.exists() && !is_masked(&own);
    match layout.other(root) {
        Some(other) if !is_there || other.unit == layout.unit() => {
            Err(Failure::unavailable(format!(
                "expected the service of {}, found that of {} in {}: {}",
                layout.program().display(),
                other.program.display(),
                below(root, &other.unit).display(),
                taken_away_by(&other)
            )))
        }
        _ => Ok(()),
    }
}

/// What takes another installation away.
fn taken_away_by(other: &Other) -> String {
    let program = other.program.display();
    let prefix = other.program.parent().filter(|bin| bin.ends_with("bin"));
    let Some(prefix) = prefix.and_then(Path::parent) else {
        return "'sudo systemctl disable --now edgecap' ends it, and its files are yours to remove"
            .to_owned();
    };
    let uninstall = format!("'sudo {program} install --system --uninstall");
    match prefix.to_str() {
        Some("/usr/local") => format!("{uninstall}' takes that away"),
        Some("/usr") => format!(
            "'sudo apt remove edgecap' takes that away where a package has brought it, \
             else {uninstall} --prefix /usr'"
        ),
        _ => format!("{uninstall} --prefix {}' takes that away", prefix.display()),
    }
}

fn without_service(uninstall: bool, why: &str) -> String {
    match uninstall {
        true => {
            format!("the files of edgecap are gone, but the service may still run ({why}); end it")
        }
        false => format!(
            "the files of edgecap are there, but the service is not as it should be ({why}); \
             mend that and install again, or use --root / where no systemd runs"
        ),
    }
}

/// What is to be done after an installation, with commands that this shell finds.
fn how_to_go_on(layout: &Layout) -> String {
    let journalctl = match layout.is_system() {
        true => "journalctl",
        false => "journalctl --user",
    };
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let mut folders = std::env::split_paths(&folders);
    let program = match folders.any(|folder| Some(&*folder) == layout.program().parent()) {
        true => Path::new("edgecap"),
        false => layout.program(),
    };
    format!(
        "edgecap is installed. Say which camera and lens in {}, then '{} restart edgecap'.\n\
         '{} status' says how it is doing, '{journalctl} -u edgecap' what it said.",
        layout.config().display(),
        layout.systemctl(),
        program.display()
    )
}

/// `path` below `root`.
fn below(root: Option<&Path>, path: &Path) -> PathBuf {
    match root {
        Some(root) => root.join(path.strip_prefix("/").unwrap_or(path)),
        None => path.to_owned(),
    }
}
