//! What became of things that are done many times a second goes in, what is worth a line in the log comes out.

use std::io::{self, ErrorKind};

/// So many times in a row it must go well before all is well again: what fails now and then must not fill the log.
const WELL_AGAIN: u32 = 100;

/// Which failures were told.
#[derive(Debug, Default)]
pub struct Outcomes {
    /// One of each kind.
    told: Vec<Option<i32>>,
    well: u32,
}

impl Outcomes {
    /// A failure is told the first time that one of its kind comes, and that all is well once it has been so for a
    /// while. A full buffer is no failure: what comes next is newer.
    pub fn note(&mut self, outcome: io::Result<()>) -> Option<io::Result<()>> {
        match outcome {
            Ok(()) if self.told.is_empty() => None,
            Ok(()) => {
                self.well += 1;
                let is_well = self.well >= WELL_AGAIN;
                is_well.then(|| {
                    *self = Self::default();
                    Ok(())
                })
            }
            Err(e) if e.kind() == ErrorKind::WouldBlock => None,
            Err(e) => {
                self.well = 0;
                let kind = e.raw_os_error();
                let is_new = !self.told.contains(&kind);
                is_new.then(|| {
                    self.told.push(kind);
                    Err(e)
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_is_told_once_and_that_it_is_over() {
        let mut outcomes = Outcomes::default();
        let fails = |code: i32| Err(io::Error::from_raw_os_error(code));
        let told = |said: Option<io::Result<()>>| said.map(|s| s.map_err(|e| e.raw_os_error()));
        assert!(outcomes.note(Ok(())).is_none());
        assert!(outcomes.note(fails(libc::EAGAIN)).is_none());
        for _ in 0..2 {
            for code in [libc::ENETUNREACH, libc::EACCES] {
                assert_eq!(told(outcomes.note(fails(code))), Some(Err(Some(code))));
            }
            // Both again and again, with what goes well in between.
            for _ in 0..50 {
                for code in [libc::ENETUNREACH, libc::EACCES] {
                    assert!(outcomes.note(fails(code)).is_none());
                    assert!(outcomes.note(Ok(())).is_none());
                }
            }
            let over = (0..1000).find_map(|n| Some((n, outcomes.note(Ok(()))?)));
            assert!(matches!(over, Some((98, Ok(())))), "{over:?}");
            assert!(outcomes.note(Ok(())).is_none());
        }
    }
}
