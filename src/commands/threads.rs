//! How many threads a verb may compute with that has all cores otherwise.

use std::io;

use super::exit::Failure;

/// What the stack of a thread holds that runs a verb, bytes: as much as the program's first one.
const STACK: usize = 8 << 20;

/// The option.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::Args)]
pub struct ThreadsArgs {
    /// Threads to compute with [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
}

impl ThreadsArgs {
    /// Works on so many threads; on all cores where none are given.
    ///
    /// # Errors
    /// Those of `work`; exit code 69 where the system has no threads.
    pub fn run<T: Send>(
        self,
        work: impl FnOnce() -> anyhow::Result<T> + Send,
    ) -> anyhow::Result<T> {
        let Some(threads) = self.threads else {
            return work();
        };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.into())
            .stack_size(STACK)
            .build()
            .map_err(|e| Failure::no_thread("to compute with", &io::Error::other(e)))?;
        pool.install(work)
    }
}

/// How many threads there are for the work that is done here; `None` where nobody has said.
pub fn given() -> Option<usize> {
    rayon::current_thread_index().map(|_| rayon::current_num_threads())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_has_the_threads_that_are_given_and_no_other() {
        let on = |threads| ThreadsArgs { threads }.run(|| Ok(given())).unwrap();
        assert_eq!(on(None), None);
        assert_eq!(on(Some(3)), Some(3));
    }
}
