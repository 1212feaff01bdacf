//! Bridges to other machines, which the service's unit does not let through.

use std::net::SocketAddr;
use std::path::Path;

use super::finding::{Finding, State};
use crate::commands::bridges::BridgeArgs;
use crate::config::{FILE_NAME, SYSTEM_FOLDER};

/// The first bridge of the machine's settings that other machines are to see, and what the unit has to say of it.
pub fn beyond(file: Option<&Path>, bridges: &BridgeArgs) -> Option<Finding> {
    let machines = Path::new(SYSTEM_FOLDER).join(FILE_NAME);
    file.filter(|file| **file == machines)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_unit_keeps_back_is_said_of_the_machines_settings_alone() {
        let machines = Path::new("/etc/edgecap/edgecap.toml");
        let to = |osc: &str| BridgeArgs {
            osc: Some(osc.parse().unwrap()),
            ..BridgeArgs::default()
        };
        let (here, there) = (to("127.0.0.1:9000"), to("10.0.0.7:9000"));
        let found = beyond(Some(machines), &there).unwrap().text;
        assert!(
            found.contains("osc") && found.contains("with 10.0.0.7"),
            "{found}"
        );
        assert!(beyond(Some(machines), &here).is_none());
        assert!(beyond(Some(Path::new("edgecap.toml")), &there).is_none());
        assert!(beyond(None, &there).is_none());
    }
}
