//! What the program says: work goes in, its lines come out.

use std::io;
use std::sync::{Arc, Mutex};

/// What is said while `work` is done.
pub fn said(work: impl FnOnce()) -> String {
    #[derive(Clone, Default)]
    struct Said(Arc<Mutex<Vec<u8>>>);
    impl io::Write for Said {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().extend(bytes);
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let said = Said::default();
    let to = said.clone();
    let log = tracing_subscriber::fmt()
        .with_writer(move || to.clone())
        .finish();
    tracing::subscriber::with_default(log, work);
    let said = said.0.lock().unwrap();
    String::from_utf8(said.clone()).unwrap()
}
