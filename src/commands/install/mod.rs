//! `edgecap install`: the service, for the machine or for one person, from files that this program carries.

mod pages;
mod plan;
mod step;

use std::fs;
use std::path::{Path, PathBuf};

use rustix::fs::Mode;
use rustix::process::{geteuid, umask};

use super::exit::Failure;
use super::say;
use plan::{Layout, plan, program_of};
use step::{Done, Loss, Step};

pub use pages::{Shell, completions};

/// Options of `edgecap install`.
#[derive(Debug, clap::Args)]
pub struct InstallArgs {
    #[command(flatten)]
    whose: Whose,
    /// Take it away again; settings that were changed, recordings and the user stay
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
    if !args.uninstall {
        expect_no_mask(&layout, root)?;
        expect_no_other(&layout, root)?;
    }
    let steps = plan(&layout, args.uninstall, root)?;
    let mut lost = None;
    for step in &steps {
        let wanted = root.is_none() || !matches!(step, Step::Run { .. });
        let done = match args.dry_run {
            true if wanted => step.look(root),
            false if wanted => step.take(root)?,
            _ => Done::Skipped,
        };
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
        say::out(&last_words(&layout, args.uninstall));
    }
    Ok(())
}

/// Refuses to install a service that somebody wants nobody to have.
fn expect_no_mask(layout: &Layout, root: Option<&Path>) -> Result<(), Failure> {
    let unit = below(root, &layout.mask());
    match unit.canonicalize() {
        Ok(to) if to == Path::new("/dev/null") => Err(Failure::unavailable(format!(
            "{} leads to /dev/null: the service is masked, which '{} unmask edgecap' ends; then install again",
            unit.display(),
            layout.systemctl()
        ))),
        _ => Ok(()),
    }
}

/// Refuses to install a unit that the machine would not take, as one of another program comes before it.
///
/// # Errors
/// Exit code 69.
fn expect_no_other(layout: &Layout, root: Option<&Path>) -> Result<(), Failure> {
    let Some(unit) = layout.comes_before() else {
        return Ok(());
    };
    let unit = below(root, &unit);
    let text = fs::read_to_string(&unit).unwrap_or_default();
    // The same program is a copy that the administrator has changed; one of another name is the administrator's, too.
    let is_other = |program: &PathBuf| program.ends_with("edgecap") && program != layout.program();
    match program_of(&text).filter(is_other) {
        Some(program) => Err(Failure::unavailable(format!(
            "{} comes first, so that the service would run another installation: \
             'sudo {} install --system --uninstall' takes that away, with its --prefix if it had one; then install again",
            unit.display(),
            program.display()
        ))),
        None => Ok(()),
    }
}

fn without_service(uninstall: bool, why: &str) -> String {
    match uninstall {
        true => {
            format!("the files of edgecap are gone, but the service may still run ({why}); end it")
        }
        false => format!(
            "the files of edgecap are there, but the service is not as it should be ({why}); mend that and install again, or use --root / where no systemd runs"
        ),
    }
}

fn last_words(layout: &Layout, uninstall: bool) -> String {
    if uninstall {
        return "edgecap is uninstalled".to_owned();
    }
    let journalctl = match layout.is_system() {
        true => "journalctl",
        false => "journalctl --user",
    };
    format!(
        "edgecap is installed. Say which camera and lens in {}, then '{} restart edgecap'.\n\
         'edgecap status' says how it is doing, '{journalctl} -u edgecap' what it said.",
        layout.config().display(),
        layout.systemctl()
    )
}

/// `path` below `root`.
fn below(root: Option<&Path>, path: &Path) -> PathBuf {
    match root {
        Some(root) => root.join(path.strip_prefix("/").unwrap_or(path)),
        None => path.to_owned(),
    }
}
