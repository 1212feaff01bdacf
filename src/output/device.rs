//! Devices and pipes to write into, and what this process has open already.

use std::fs::{self, File};
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::fs::{OFlags, fcntl_setfl};
use rustix::io::Errno;

/// How long the reader of a pipe may take to open it.
const READER_PATIENCE: Duration = Duration::from_secs(2);

/// Opens a device or pipe to write into. Opening a pipe that nobody reads would wait for ever, whatever signal comes.
pub(super) fn open(path: &Path) -> io::Result<File> {
    let began = Instant::now();
    let mut options = File::options();
    options
        .write(true)
        .custom_flags(OFlags::NONBLOCK.bits().cast_signed());
    loop {
        match options.open(path) {
            Ok(device) => {
                fcntl_setfl(&device, OFlags::empty())?;
                return Ok(device);
            }
            Err(e) if Errno::from_io_error(&e) != Some(Errno::NXIO) => return Err(e),
            Err(e) if began.elapsed() > READER_PATIENCE => {
                return Err(io::Error::new(
                    e.kind(),
                    "nobody reads from this pipe: start its reader first",
                ));
            }
            Err(_) => std::thread::sleep(Duration::from_millis(20)),
        }
    }
}

/// What descriptor `number` is, which `path` names, to be written on where it stands: a file that is opened anew
/// begins at its start, also where it is to be added to.
pub(super) fn opened_before(number: u32, path: &Path) -> io::Result<File> {
    let same = match number {
        0 => io::stdin().as_fd().try_clone_to_owned()?,
        1 => io::stdout().as_fd().try_clone_to_owned()?,
        2 => io::stderr().as_fd().try_clone_to_owned()?,
        // No other can be had by its number alone: at the end of a file nothing is written over.
        _ if fs::metadata(path)?.is_file() => return File::options().append(true).open(path),
        _ => return open(path),
    };
    Ok(same.into())
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::os::fd::AsRawFd;

    use super::super::AtomicFile;
    use super::*;

    #[test]
    fn what_is_open_already_is_written_on_and_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("all.txt");
        fs::write(&path, "a line\n").unwrap();
        let open = File::options().append(true).open(&path).unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink("/dev/fd", &link).unwrap();
        let number = open.as_raw_fd();
        let own = std::process::id();
        for name in [
            format!("/dev/fd/{number}"),
            format!("/proc/self/fd/{number}"),
            format!("/proc/{own}/fd/{number}"),
            format!("{}/{number}", link.display()),
        ] {
            super::super::try_place(name.as_ref()).unwrap();
            super::super::write(name.as_ref(), b"{}\n").unwrap();
        }
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(text, format!("a line\n{}", "{}\n".repeat(4)));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_pipe_gets_the_bytes_and_stays_a_pipe() {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, 0o600.into()).unwrap();
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read_to_string(pipe).unwrap()
        });
        let mut file = AtomicFile::create(&pipe).unwrap();
        file.write_all(b"line").unwrap();
        file.sync().unwrap();
        file.finish().unwrap();
        assert_eq!(reader.join().unwrap(), "line");
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_pipe_that_nobody_reads_is_an_error_that_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, 0o600.into()).unwrap();
        let e = AtomicFile::create(&pipe).unwrap_err();
        assert!(e.to_string().contains("nobody reads"), "{e}");
        assert!(fs::metadata(&pipe).is_ok(), "the pipe stays");
    }
}
