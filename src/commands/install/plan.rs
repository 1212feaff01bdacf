//! Which files are written or removed, and which commands follow.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use edgecap_client::place::SERVICE_FOLDER;

use super::below;
use super::layout::{Layout, SERVICE};
use super::step::{Step, digest};
use crate::commands::settings::SAMPLE;

/// The service's recordings.
const STATE_FOLDER: &str = "/var/lib/edgecap";
const SERVICE_PATTERN: &str = "edgecap.service*";

/// Everything that makes, or undoes, an installation below `root`.
///
/// # Errors
/// If this program cannot be read, or a unit cannot name it.
pub fn plan(layout: &Layout, uninstall: bool, root: Option<&Path>) -> anyhow::Result<Vec<Step>> {
    let files = layout.files()?;
    let config = layout.config().to_owned();
    let outdated = layout.outdated_pages(&files, root).into_iter();
    let outdated = outdated.map(|page| without(layout, page));
    let systemctl: &[&str] = if layout.is_system() {
        &["systemctl"]
    } else {
        &["systemctl", "--user"]
    };
    if uninstall {
        let steps = undoing(layout, files, systemctl, root);
        return Ok(outdated.chain(steps).collect());
    }
    let mut steps: Vec<Step> = files
        .into_iter()
        .map(|(path, bytes, mode)| Step::Write {
            path,
            bytes,
            mode,
            kept: false,
        })
        .chain(outdated)
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
        mode: if layout.is_system() { 0o640 } else { 0o600 },
        kept: true,
    });
    if layout.is_system() {
        let conf = |kind: &str| {
            layout
                .rules()
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
    let unit = match layout.is_system() {
        true => SERVICE.to_owned(),
        false => layout.unit().display().to_string(),
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
    let other = layout.other(root);
    // What the machine runs is the other one then.
    let is_behind = other.as_ref().is_some_and(|other| other.comes_before);
    // Of what was taken away before nothing runs.
    if layout.unit().exists() && !is_behind {
        steps.push(Step::serve(
            &[systemctl, &["disable", "--now", SERVICE]].concat(),
        ));
    }
    steps.extend(files.into_iter().map(|(path, ..)| without(layout, path)));
    steps.push(Step::RemoveEmpty {
        path: layout.drop_ins(),
    });
    // All installations of a machine have the same settings.
    if other.is_none() {
        let noted = layout.config_digest();
        let digests = fs::read_to_string(below(root, &noted)).unwrap_or_default();
        let digests = digests.split_whitespace().take(1).map(str::to_owned);
        let unchanged = digests.chain([digest(SAMPLE.as_bytes())]).collect();
        steps.push(without(layout, noted));
        steps.push(Step::Remove {
            path: layout.config().to_owned(),
            unless_changed_from: Some(unchanged),
            emptied_below: layout.own().to_vec(),
        });
    }
    steps.extend([
        Step::try_run(&[systemctl, &["daemon-reload"]].concat()),
        // Else what had failed stays so until the machine starts again. A pattern: where nothing has failed, the name
        // alone is a mistake.
        Step::try_run(&[systemctl, &["reset-failed", SERVICE_PATTERN]].concat()),
    ]);
    if layout.is_system() && !is_behind {
        // The unit keeps it while the service is stopped.
        steps.push(Step::Clear {
            path: SERVICE_FOLDER.into(),
        });
        steps.push(Step::RemoveEmpty {
            path: STATE_FOLDER.into(),
        });
    }
    steps
}

/// Takes a file away, with folders of the installation that nothing is left in.
fn without(layout: &Layout, path: PathBuf) -> Step {
    Step::Remove {
        path,
        unless_changed_from: None,
        emptied_below: layout.own().to_vec(),
    }
}
