//! Something else that is wanted, and for how long.

/// How long the machine must have been too slow before less is asked of it, nanoseconds.
pub const SLOW_NS: u64 = 2_000_000_000;
/// How long it must have promised to be fast enough for more.
pub const FAST_NS: u64 = 10_000_000_000;

/// What is wanted other than what is, and from when on, nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wish<T>(Option<(T, u64)>);

impl<T> Default for Wish<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T: PartialEq> Wish<T> {
    /// Whether `wanted`, which is wanted at `now`, has been so for `patience` nanoseconds; it is then forgotten.
    pub fn lasts(&mut self, now: u64, wanted: T, patience: u64) -> bool {
        // A clock that went backwards begins anew.
        let since = match self.0.take() {
            Some((before, since)) if before == wanted && since <= now => since,
            _ => now,
        };
        let lasts = now - since >= patience;
        if !lasts {
            self.0 = Some((wanted, since));
        }
        lasts
    }

    /// Nothing else is wanted, or it is not known what was.
    pub fn forget(&mut self) {
        self.0 = None;
    }
}
