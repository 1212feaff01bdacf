//! Devices and pipes to write into.

use std::fs::File;
use std::io;
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

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Write;

    use super::super::AtomicFile;

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
