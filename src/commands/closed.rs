//! A folder of streams that is there and that this user may not look into: what to do about it.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use edgecap_client::place::{RUNTIME_DIR_VARIABLE, SERVICE_FOLDER};

/// May look into a folder, by its mode: the group, and everybody.
const OF_GROUP: u32 = 0o050;

/// What to do about the folder that a service publishes in, or about the one that the environment names; `None` where
/// this user may look into it, or there is none.
pub fn advice() -> Option<String> {
    let named = std::env::var_os(RUNTIME_DIR_VARIABLE).filter(|n| !n.is_empty());
    let folder = named.map_or_else(|| PathBuf::from(SERVICE_FOLDER), PathBuf::from);
    let refused = fs::read_dir(&folder).err()?;
    if refused.kind() != ErrorKind::PermissionDenied {
        return None;
    }
    let meta = fs::metadata(&folder).ok()?;
    let groups = fs::read_to_string("/etc/group").unwrap_or_default();
    Some(said(&folder, meta.mode(), &name_of(meta.gid(), &groups)))
}

fn said(folder: &Path, mode: u32, group: &str) -> String {
    let closed = format!("{} is closed to this user", folder.display());
    match mode & OF_GROUP == OF_GROUP {
        true => format!(
            "{closed}: 'sudo usermod -aG {group} $USER', then log in again: who is in the group '{group}' may read"
        ),
        false => {
            format!("{closed}: look as its owner, or 'sudo chmod 750' it for the group '{group}'")
        }
    }
}

/// A group's name by the text of `/etc/group`, else its number.
fn name_of(id: u32, groups: &str) -> String {
    let named = groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let (name, number) = (fields.next()?, fields.nth(1)?);
        (number.parse() == Ok(id)).then(|| name.to_owned())
    });
    named.unwrap_or_else(|| id.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_group_that_opens_a_folder_is_named() {
        let groups = "root:x:0:\nedgecap:x:998:anna\n";
        assert_eq!(name_of(998, groups), "edgecap");
        assert_eq!(name_of(99, groups), "99");
        let service = Path::new(SERVICE_FOLDER);
        let open = said(service, 0o40750, "edgecap");
        assert!(open.contains("usermod -aG edgecap $USER"), "{open}");
        let closed = said(service, 0o40700, "edgecap");
        assert!(
            !closed.contains("usermod") && closed.contains("owner"),
            "{closed}"
        );
    }
}
