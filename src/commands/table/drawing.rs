//! Drawing on a terminal in a thread of its own. A terminal may stop taking output at any moment, by Ctrl-S, Scroll
//! Lock or a connection that hangs: then what it shows is lost, and whoever draws goes on.

use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use console::Term;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::commands::say;

/// What may wait for the terminal. Beyond it is lost.
const WAITING: usize = 16;
/// How long the end waits for a terminal that is busy.
const PATIENCE: Duration = Duration::from_millis(300);
/// Most redraws a second.
const RATE: u8 = 20;

/// What is to be drawn.
#[derive(Debug)]
enum Order {
    /// The frames so far, of how many where that is known, and everything below.
    Table {
        position: u64,
        total: Option<u64>,
        message: String,
    },
    /// A line above the table.
    Line(String),
    /// Nothing any more; told when it is done.
    Clear(SyncSender<()>),
}

/// A terminal that is drawn on.
#[derive(Debug)]
pub struct Drawing {
    orders: SyncSender<Order>,
}

impl Drawing {
    /// Draws on `terminal`; `None` where the system has no thread for it.
    pub fn on(terminal: Term) -> Option<Self> {
        let (orders, taken) = sync_channel(WAITING);
        let draws = move || draw(ProgressDrawTarget::term(terminal, RATE), &taken);
        let thread = std::thread::Builder::new().name("table".into());
        thread.spawn(draws).ok().map(|_| Self { orders })
    }

    /// Shows a table.
    pub fn table(&self, position: u64, total: Option<u64>, message: String) {
        let _ = self.orders.try_send(Order::Table {
            position,
            total,
            message,
        });
    }

    /// Prints a line above it, or by itself once it is off the screen.
    pub fn line(&self, line: &str) {
        let sent = self.orders.try_send(Order::Line(line.to_owned()));
        if matches!(sent, Err(TrySendError::Disconnected(_))) {
            say::err(line);
        }
    }

    /// Takes it off the screen for good, if the terminal lets it.
    pub fn clear(&self) {
        let (done, cleared) = sync_channel(1);
        if self.orders.try_send(Order::Clear(done)).is_ok() {
            let _ = cleared.recv_timeout(PATIENCE);
        }
    }
}

/// Whoever fails has said something before, which is still to be shown.
impl Drop for Drawing {
    fn drop(&mut self) {
        self.clear();
    }
}

fn draw(target: ProgressDrawTarget, orders: &Receiver<Order>) {
    let bar = ProgressBar::with_draw_target(None, target);
    bar.set_style(spinner());
    for order in orders {
        match order {
            Order::Table {
                position,
                total,
                message,
            } => {
                set_total(&bar, total);
                bar.set_position(position);
                bar.set_message(message);
            }
            Order::Line(line) => bar.suspend(|| say::err(&line)),
            Order::Clear(done) => {
                bar.finish_and_clear();
                let _ = done.send(());
                return;
            }
        }
    }
}

/// Makes it a bar of so many frames, or a spinner where nobody knows how many: another film or a camera may follow one.
fn set_total(bar: &ProgressBar, total: Option<u64>) {
    if bar.length() == total {
        return;
    }
    match total {
        Some(total) => {
            bar.set_style(progress());
            bar.set_length(total);
        }
        None => {
            bar.set_style(spinner());
            bar.unset_length();
        }
    }
}

fn spinner() -> ProgressStyle {
    ProgressStyle::with_template("{spinner} frame {pos}  {msg}").expect("a valid template")
}

fn progress() -> ProgressStyle {
    ProgressStyle::with_template("{bar:40} {pos}/{len} frames, {eta} left  {msg}")
        .expect("a valid template")
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::sync::{Arc, Mutex};

    use indicatif::TermLike;

    use super::*;

    /// A terminal that keeps all that was ever written.
    #[derive(Debug, Clone, Default)]
    struct Paper(Arc<Mutex<String>>);

    impl TermLike for Paper {
        fn width(&self) -> u16 {
            200
        }

        fn move_cursor_up(&self, _: usize) -> io::Result<()> {
            Ok(())
        }

        fn move_cursor_down(&self, _: usize) -> io::Result<()> {
            Ok(())
        }

        fn move_cursor_right(&self, _: usize) -> io::Result<()> {
            Ok(())
        }

        fn move_cursor_left(&self, _: usize) -> io::Result<()> {
            Ok(())
        }

        fn write_line(&self, text: &str) -> io::Result<()> {
            self.write_str(&format!("{text}\n"))
        }

        fn write_str(&self, text: &str) -> io::Result<()> {
            self.0.lock().unwrap().push_str(text);
            Ok(())
        }

        fn clear_line(&self) -> io::Result<()> {
            Ok(())
        }

        fn flush(&self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn every_film_has_a_bar_of_its_own_length_and_a_camera_none() {
        let (orders, taken) = sync_channel(WAITING);
        for (position, total) in [(150, Some(300)), (1500, Some(3000)), (7, None)] {
            let message = String::new();
            let order = Order::Table {
                position,
                total,
                message,
            };
            orders.send(order).unwrap();
        }
        drop(orders);
        let paper = Paper::default();
        let target = ProgressDrawTarget::term_like(Box::new(paper.clone()));
        draw(target, &taken);
        let shown = paper.0.lock().unwrap().clone();
        for wanted in ["150/300 frames", "1500/3000 frames", "frame 7 "] {
            assert!(shown.contains(wanted), "{wanted}: {shown}");
        }
        for wrong in ["1500/300 ", "7/3"] {
            assert!(!shown.contains(wrong), "{wrong}: {shown}");
        }
    }
}
