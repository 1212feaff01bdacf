//! How far a verb has come, and how long it still takes: on a terminal only.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar of so many steps, on the terminal's stderr; nothing where there is none.
pub fn bar(steps: u64, what: &str) -> ProgressBar {
    let template = format!("{{bar:40}} {{pos}}/{{len}} {what}, {{eta}} left");
    let style = ProgressStyle::with_template(&template).expect("a valid template");
    ProgressBar::new(steps).with_style(style)
}
