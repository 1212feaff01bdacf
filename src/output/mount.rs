//! What the system lets nobody replace, what can be moved by its name alone, and what can only be read.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use rustix::fs::{AtFlags, CWD, Statx, StatxAttributes, StatxFlags, statx};

/// Refuses a place that no file can take, before there is anything to write: it is mounted by itself, as containers
/// have single files, or may not be changed.
///
/// # Errors
/// What it is and what to do.
pub(super) fn expect_replaceable(path: &Path) -> io::Result<()> {
    match there(path, AtFlags::SYMLINK_NOFOLLOW).and_then(|there| hold(&there)) {
        Some(what) => Err(io::Error::new(io::ErrorKind::ResourceBusy, what)),
        None => Ok(()),
    }
}

/// What holds a file in its place.
fn hold(there: &Statx) -> Option<&'static str> {
    let has = |attribute| there.stx_attributes.contains(attribute);
    if has(StatxAttributes::MOUNT_ROOT) {
        return Some(
            "it is mounted by itself, and cannot be replaced: mount the folder that it is in",
        );
    }
    let is_held = has(StatxAttributes::IMMUTABLE) || has(StatxAttributes::APPEND);
    is_held.then_some("its attributes forbid to replace it: take them off (chattr -i -a)")
}

/// What is there; `None` where nothing is, or the system cannot tell.
fn there(path: &Path, flags: AtFlags) -> Option<Statx> {
    statx(CWD, path, flags | AtFlags::NO_AUTOMOUNT, StatxFlags::MNT_ID).ok()
}

/// Within what a folder's files can be moved by their names alone: its disk and, where the system tells it, its mount.
///
/// # Errors
/// If there is no such folder.
pub(super) fn realm(folder: &Path) -> io::Result<(u64, Option<u64>)> {
    let disk = fs::metadata(folder)?.dev();
    let tells = |there: &Statx| there.stx_mask & StatxFlags::MNT_ID.bits() != 0;
    let mount = there(folder, AtFlags::empty()).filter(tells);
    Ok((disk, mount.map(|there| there.stx_mnt_id)))
}

/// Whether the file system itself can only be read on which a path lies, or the first around it that is there. Where
/// just its mount can, a service's unit or a container keeps it from being written.
pub fn is_read_only(path: &Path) -> bool {
    let mount = path.ancestors().find_map(|place| {
        let place = match place.as_os_str().is_empty() {
            true => Path::new("."),
            false => place,
        };
        realm(place).ok()
    });
    let mounts = fs::read_to_string("/proc/self/mountinfo").unwrap_or_default();
    mount.is_some_and(|(_, mount)| mount.is_some_and(|mount| is_read_only_at(mount, &mounts)))
}

/// Whether the kernel's table of mounts says so of the file system of this one: with the options behind its device.
fn is_read_only_at(mount: u64, mounts: &str) -> bool {
    let number = |line: &str| line.split(' ').next()?.parse().ok();
    let line = mounts.lines().find(|line| number(line) == Some(mount));
    let options = line.and_then(|line| line.rsplit(' ').next());
    // The second is ext4's after an error of its disk.
    let is_such = |option| matches!(option, "ro" | "emergency_ro");
    options.is_some_and(|options| options.split(',').any(is_such))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_system_that_is_read_only_is_told_from_a_mount_that_is() {
        let mounts = "36 35 8:17 / /srv rw,noatime - ext4 /dev/sdb1 ro,errors=remount-ro\n\
            38 35 8:19 / /mnt rw,noatime - ext4 /dev/sdd1 rw,emergency_ro\n\
            40 35 8:18 / /data ro,nosuid shared:1 - ext4 /dev/sdc1 rw,errors=remount-ro\n";
        for (mount, is_read_only) in [(36, true), (38, true), (40, false), (3, false)] {
            assert_eq!(is_read_only_at(mount, mounts), is_read_only, "{mount}");
        }
        let folder = tempfile::tempdir().unwrap();
        assert!(!is_read_only(&folder.path().join("new/file")));
        assert!(!is_read_only(Path::new("nowhere/file")));
    }

    #[test]
    fn mounts_are_told_from_what_lies_in_them() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        expect_replaceable(&file).unwrap();
        fs::write(&file, "").unwrap();
        expect_replaceable(&file).unwrap();
        let within = folder.path().join("within");
        fs::create_dir(&within).unwrap();
        assert_eq!(realm(folder.path()).unwrap(), realm(&within).unwrap());
        assert_ne!(
            realm(folder.path()).unwrap(),
            realm("/proc".as_ref()).unwrap()
        );
        assert!(realm(&folder.path().join("none")).is_err());
        let Some(proc) = there("/proc".as_ref(), AtFlags::empty()) else {
            println!("skipped: this system has no statx");
            return;
        };
        if !proc
            .stx_attributes_mask
            .contains(StatxAttributes::MOUNT_ROOT)
        {
            println!("skipped: this system does not tell where mounts begin");
            return;
        }
        let e = expect_replaceable("/proc".as_ref())
            .unwrap_err()
            .to_string();
        assert!(e.contains("mount the folder"), "{e}");
    }
}
