//! A smoothed mean.

/// Share of a new value.
const SMOOTH: f32 = 0.1;

/// Follows what changes slowly; the mean of all until there are ten.
#[derive(Debug, Clone, Copy, Default)]
pub struct Mean {
    /// How many values there were.
    pub count: u32,
    /// Their mean; 0 before the first.
    pub value: f32,
}

impl Mean {
    /// Takes in one more.
    pub fn take(&mut self, value: f32) {
        self.count = self.count.saturating_add(1);
        self.value += (value - self.value) * SMOOTH.max(1.0 / self.count as f32);
    }
}
