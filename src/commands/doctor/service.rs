//! The same checks as the service's user, who may do less than whoever asks.

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use rustix::process::geteuid;

use crate::commands::exit::Failure;
use crate::commands::settings::ConfigArgs;
use crate::config::{FILE_NAME, SYSTEM_FOLDER};

/// Who the service is.
const USER: &str = "edgecap";
/// Changes who a process is, with all of the user's groups.
const SETPRIV: &str = "setpriv";

/// Becomes this verb as the service's user; returns only what went wrong.
pub fn become_service(config: &ConfigArgs) -> anyhow::Error {
    if !geteuid().is_root() {
        return Failure::permission(
            "doctor --as-service becomes another user: run it with sudo, or without --as-service as yourself",
        )
        .into();
    }
    let users = std::fs::read_to_string("/etc/passwd").unwrap_or_default();
    if !is_among(USER, &users) {
        return Failure::unavailable(format!(
            "doctor --as-service: expected the user '{USER}', found none: 'edgecap install --system' makes it"
        ))
        .into();
    }
    let program = match std::env::current_exe() {
        Ok(program) => program,
        Err(e) => return e.into(),
    };
    let settings = Path::new(SYSTEM_FOLDER).join(FILE_NAME);
    let failed = Command::new(SETPRIV)
        .args(arguments())
        .arg(&program)
        .args(["doctor", "--config"])
        .arg(config.config.as_ref().unwrap_or(&settings))
        .current_dir("/")
        .exec();
    Failure::unavailable(format!(
        "doctor --as-service: cannot start {SETPRIV}: {failed}; install util-linux"
    ))
    .into()
}

fn arguments() -> [String; 6] {
    [
        format!("--reuid={USER}"),
        format!("--regid={USER}"),
        "--init-groups".to_owned(),
        // What the service does not have: capabilities, and a way to get more.
        "--bounding-set=-all".to_owned(),
        "--no-new-privs".to_owned(),
        // Variables of whoever asks are not the service's.
        "--reset-env".to_owned(),
    ]
}

/// Whether the text of `/etc/passwd` has a user.
fn is_among(user: &str, users: &str) -> bool {
    let name = |line: &str| line.split(':').next().map(ToOwned::to_owned);
    users.lines().any(|l| name(l).as_deref() == Some(user))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_user_is_known_by_the_whole_name() {
        let users = "root:x:0:0::/root:/bin/sh\nedgecap-test:x:7:7::/:/bin/false\n";
        assert!(!is_among("edgecap", users));
        assert!(is_among("root", users));
    }
}
