//! What the service's unit holds back: bridges to other machines, records outside its own folders, and files where it
//! sees nothing.

use std::net::SocketAddr;
use std::path::{Component, Path, PathBuf};

use edgecap_client::place::SERVICE_FOLDER;

use super::finding::{Finding, State};
use crate::commands::bridges::BridgeArgs;
use crate::commands::settings::RunArgs;
use crate::config::{FILE_NAME, SYSTEM_FOLDER};
use crate::output::parent;

/// Where the service works, and its recordings lie.
const STATE: &str = "/var/lib/edgecap";
/// Where else it may write.
const OPEN: [&str; 2] = [SERVICE_FOLDER, "/dev"];
/// Where it sees nothing but files of its own, which go when it stops.
const PASSING: [&str; 2] = ["/tmp", "/var/tmp"];
/// What it does not even see.
const HOMES: [&str; 3] = ["/home", "/root", "/run/user"];

/// What of the machine's settings needs more of the unit than it has, the first of each kind; nothing of others. A run
/// `reads` what they name by these keys.
pub fn held_back(
    file: Option<&Path>,
    runs: &[RunArgs],
    reads: &[(&'static str, PathBuf)],
) -> Vec<Finding> {
    let machines = Path::new(SYSTEM_FOLDER).join(FILE_NAME);
    if file != Some(&*machines) {
        return Vec::new();
    }
    let bridge = runs.first().and_then(|run| bridge(&run.bridges));
    let all = [bridge, record(runs), unseen(reads)];
    all.into_iter().flatten().collect()
}

/// The first bridge that other machines are to see.
fn bridge(bridges: &BridgeArgs) -> Option<Finding> {
    let all = [
        ("view", bridges.view),
        ("osc", bridges.osc),
        ("vmc", bridges.vmc),
    ];
    let is_beyond = |address: &SocketAddr| !address.ip().is_loopback();
    let (key, address) = all
        .into_iter()
        .find_map(|(key, address)| Some((key, address.filter(is_beyond)?)))?;
    let allowed = match address.ip().is_unspecified() {
        true => "the network of those who look, such as 192.168.1.0/24".to_owned(),
        false => address.ip().to_string(),
    };
    let text = format!(
        "{key} = \"{address}\": the service's unit lets nothing through but to this machine, unless it has [Service] IPAddressAllow= with {allowed}: 'systemctl edit edgecap'"
    );
    Some(Finding::new("bridges", State::Note, text))
}

/// The first file or folder of results that lies elsewhere.
fn record(runs: &[RunArgs]) -> Option<Finding> {
    let results = |run: &RunArgs| {
        let (record, flight) = (run.record.clone(), run.bridges.flight.clone());
        let files = [("jsonl", record.jsonl), ("record", record.record)];
        let files = files.map(|(key, path)| (key, path.map(|path| parent(&path).to_owned())));
        [&files[..], &[("flight", flight)]].concat()
    };
    let (key, folder) = runs
        .iter()
        .flat_map(results)
        .find_map(|(key, folder)| Some((key, outside(&folder?)?)))?;
    let advice = match hidden(&folder) {
        Some(why) => format!("{why}: choose a folder below {STATE}"),
        None => format!(
            "lets nothing be written there, unless it has [Service] ReadWritePaths={}, a folder that is there and belongs to edgecap: 'systemctl edit edgecap'",
            folder.display()
        ),
    };
    let text = format!("{key} in {}: the service's unit {advice}", folder.display());
    Some(Finding::new("records", State::Note, text))
}

/// The first file that the service does not see, by its name or where that leads.
fn unseen(reads: &[(&'static str, PathBuf)]) -> Option<Finding> {
    let why = |path: &Path| {
        let real = path.canonicalize().ok();
        hidden(&whole(path)).or_else(|| hidden(&real?))
    };
    let (key, path, why) = reads
        .iter()
        .find_map(|(key, path)| Some((key, path, why(path)?)))?;
    let text = format!(
        "{key} = {}: the service's unit {why}: put it into {SYSTEM_FOLDER}, readable by edgecap",
        path.display()
    );
    Some(Finding::new("files", State::Note, text))
}

/// Why the service sees nothing of what lies there, if it does not.
fn hidden(path: &Path) -> Option<&'static str> {
    let is_below = |places: &[&str]| places.iter().any(|place| path.starts_with(place));
    if is_below(&HOMES) {
        return Some("shows it no homes");
    }
    is_below(&PASSING).then_some("gives it a /tmp and a /var/tmp of its own, empty at each start")
}

/// A path from the root on, where the service works in its own folder.
fn whole(path: &Path) -> PathBuf {
    let mut whole = PathBuf::new();
    for part in Path::new(STATE).join(path).components() {
        match part {
            Component::ParentDir => drop(whole.pop()),
            part => whole.push(part),
        }
    }
    whole
}

/// The whole path of a folder that the unit keeps the service from writing into.
fn outside(folder: &Path) -> Option<PathBuf> {
    let whole = whole(folder);
    let is_within = |open: &str| whole.starts_with(open);
    let is_open = is_within(STATE) || OPEN.into_iter().any(is_within);
    (!is_open).then_some(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MACHINES: &str = "/etc/edgecap/edgecap.toml";

    /// The lines about settings in this file.
    fn told(file: &str, run: &RunArgs) -> String {
        let found = held_back(Some(Path::new(file)), std::slice::from_ref(run), &[]);
        let lines: Vec<String> = found.into_iter().map(|finding| finding.text).collect();
        lines.join("\n")
    }

    #[test]
    fn what_the_unit_keeps_back_is_said_of_the_machines_settings_alone() {
        let to = |osc: &str| RunArgs {
            bridges: BridgeArgs {
                osc: Some(osc.parse().unwrap()),
                ..BridgeArgs::default()
            },
            ..RunArgs::default()
        };
        let (here, there) = (to("127.0.0.1:9000"), to("10.0.0.7:9000"));
        let found = told(MACHINES, &there);
        assert!(
            found.contains("osc") && found.contains("with 10.0.0.7"),
            "{found}"
        );
        assert_eq!(told(MACHINES, &here), "");
        assert_eq!(told("edgecap.toml", &there), "");
        assert!(held_back(None, &[there], &[]).is_empty());
    }

    #[test]
    fn records_that_the_unit_lets_nobody_write_are_told() {
        let to = |path: &str| {
            let mut run = RunArgs::default();
            run.record.record = Some(path.into());
            run
        };
        for inside in [
            "-",
            "a.bin",
            "b/../a.bin",
            "/var/lib/edgecap/b/a.bin",
            "/dev/null",
        ] {
            assert_eq!(told(MACHINES, &to(inside)), "", "{inside}");
        }
        for (outside, folder) in [
            ("/srv/takes/a.bin", "/srv/takes"),
            ("/var/lib/edgecap/../a.bin", "/var/lib"),
            ("../a/b.bin", "/var/lib/a"),
        ] {
            let found = told(MACHINES, &to(outside));
            let words = format!("[Service] ReadWritePaths={folder}, ");
            assert!(found.contains(&words), "{found}");
        }
        let found = told(MACHINES, &to("/home/somebody/a.bin"));
        assert!(found.contains("no homes"), "{found}");
        for passing in ["/tmp/a.bin", "/var/tmp/takes/a.bin"] {
            let found = told(MACHINES, &to(passing));
            assert!(found.contains("empty at each start"), "{found}");
            assert!(
                found.contains("choose a folder below /var/lib/edgecap"),
                "{found}"
            );
        }
        assert_eq!(told("edgecap.toml", &to("/srv/a.bin")), "");
        let mut flight = RunArgs::default();
        flight.bridges.flight = Some("/srv/last".into());
        let found = told(MACHINES, &flight);
        assert!(found.contains("flight in /srv/last: "), "{found}");
    }

    #[test]
    fn files_that_the_service_does_not_see_are_told() {
        let told = |path: &Path| {
            let reads = [
                ("model", "/etc/edgecap/a.ecm".into()),
                ("lens", path.to_owned()),
            ];
            let found = held_back(Some(Path::new(MACHINES)), &[], &reads);
            let lines: Vec<String> = found.into_iter().map(|finding| finding.text).collect();
            lines.join("\n")
        };
        for seen in [
            "/etc/edgecap/lens.toml",
            "/srv/lens.toml",
            "/home/../srv/lens.toml",
        ] {
            assert_eq!(told(Path::new(seen)), "", "{seen}");
        }
        for (hidden, words) in [
            ("/home/somebody/lens.toml", "no homes"),
            ("/etc/edgecap/../../root/lens.toml", "no homes"),
            ("/run/user/1000/lens.toml", "no homes"),
            ("/var/tmp/lens.toml", "of its own"),
        ] {
            let found = told(Path::new(hidden));
            let begins = format!("lens = {hidden}: ");
            assert!(
                found.starts_with(&begins) && found.contains(words),
                "{found}"
            );
        }
    }
}
