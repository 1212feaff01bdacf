//! The same checks as the service's user, who may do less than whoever asks.

use std::io;
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

/// Becomes this verb as the service's user, with the same `config` and `threads`; returns only what went wrong.
pub fn become_service(config: &ConfigArgs, threads: Option<u16>) -> anyhow::Error {
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
    let command = std::env::current_exe()
        .and_then(|program| command(&program, config.config.as_deref(), threads));
    let failed = match command {
        Ok(mut command) => command.exec(),
        Err(e) => return e.into(),
    };
    Failure::unavailable(format!(
        "doctor --as-service: cannot start {SETPRIV}: {failed}; install util-linux"
    ))
    .into()
}

/// The verb as the service's user, who works in the root folder: `settings` are the machine's where none are named.
fn command(program: &Path, settings: Option<&Path>, threads: Option<u16>) -> io::Result<Command> {
    let settings = match settings {
        Some(named) => std::path::absolute(named)?,
        None => Path::new(SYSTEM_FOLDER).join(FILE_NAME),
    };
    let mut command = Command::new(SETPRIV);
    command
        .args(arguments())
        .arg(program)
        .args(["doctor", "--config"])
        .arg(settings);
    if let Some(threads) = threads {
        command.arg(format!("--threads={threads}"));
    }
    command.current_dir("/");
    Ok(command)
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
    fn the_services_user_is_given_what_was_asked_for() {
        let line = |settings: Option<&str>, threads| {
            let command = command(Path::new("/bin/edgecap"), settings.map(Path::new), threads);
            let command = command.unwrap();
            assert_eq!(command.get_current_dir(), Some(Path::new("/")));
            let words = command.get_args().map(|a| a.to_str().unwrap().to_owned());
            let words: Vec<String> = words.skip_while(|w| w != "/bin/edgecap").collect();
            words.join(" ")
        };
        let here = std::env::current_dir().unwrap().join("hall.toml");
        assert_eq!(
            line(Some("hall.toml"), Some(3)),
            format!(
                "/bin/edgecap doctor --config {} --threads=3",
                here.display()
            )
        );
        assert_eq!(
            line(None, None),
            "/bin/edgecap doctor --config /etc/edgecap/edgecap.toml"
        );
    }

    #[test]
    fn a_user_is_known_by_the_whole_name() {
        let users = "root:x:0:0::/root:/bin/sh\nedgecap-test:x:7:7::/:/bin/false\n";
        assert!(!is_among("edgecap", users));
        assert!(is_among("root", users));
    }
}
