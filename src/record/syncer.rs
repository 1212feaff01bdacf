//! Brings a growing file onto the disk beside whoever writes it: a slow disk holds nothing up.

use std::fs::File;
use std::io;
use std::thread::{Builder, JoinHandle};

type Bring = fn(&File) -> io::Result<()>;

/// One file's.
#[derive(Debug)]
pub struct Syncer {
    bring: Bring,
    under_way: Option<JoinHandle<io::Result<()>>>,
}

impl Default for Syncer {
    fn default() -> Self {
        Self::by(File::sync_data)
    }
}

impl Syncer {
    fn by(bring: Bring) -> Self {
        Self {
            bring,
            under_way: None,
        }
    }

    /// Begins to bring what is in the file by now onto the disk, unless that is under way.
    ///
    /// # Errors
    /// Why the last time failed; the system's, where this cannot be begun.
    pub fn begin(&mut self, file: &File) -> io::Result<()> {
        if let Some(thread) = self.under_way.take_if(|thread| thread.is_finished()) {
            let outcome = thread.join();
            outcome.unwrap_or_else(|_| Err(io::Error::other("the disk's thread panicked")))?;
        }
        if self.under_way.is_none() {
            let (bring, file) = (self.bring, file.try_clone()?);
            let thread = Builder::new().name("disk".into());
            self.under_way = Some(thread.spawn(move || bring(&file))?);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
    use std::time::Duration;

    use super::*;

    static IS_SLOW: AtomicBool = AtomicBool::new(true);
    static BEGUN: AtomicUsize = AtomicUsize::new(0);

    /// A disk that takes as long as the test wants, and fails then.
    fn slowly(_: &File) -> io::Result<()> {
        BEGUN.fetch_add(1, Ordering::SeqCst);
        while IS_SLOW.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(1));
        }
        Err(io::Error::other("no disk"))
    }

    #[test]
    fn a_slow_disk_holds_nothing_up_and_its_failure_is_told() {
        let file = tempfile::tempfile().unwrap();
        let mut syncer = Syncer::by(slowly);
        for _ in 0..3 {
            // It would wait for ever here.
            syncer.begin(&file).unwrap();
        }
        IS_SLOW.store(false, Ordering::SeqCst);
        let told = (0..6000).find_map(|_| {
            std::thread::sleep(Duration::from_millis(10));
            syncer.begin(&file).err()
        });
        assert_eq!(told.unwrap().to_string(), "no disk");
        assert_eq!(BEGUN.load(Ordering::SeqCst), 1);
    }
}
