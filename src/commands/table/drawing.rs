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
        let draws = move || draw(terminal, &taken);
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

fn draw(terminal: Term, orders: &Receiver<Order>) {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::term(terminal, RATE));
    bar.set_style(spinner());
    for order in orders {
        match order {
            Order::Table {
                position,
                total,
                message,
            } => {
                if let Some(total) = total
                    && bar.length().is_none()
                {
                    bar.set_length(total);
                    bar.set_style(progress());
                }
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

fn spinner() -> ProgressStyle {
    ProgressStyle::with_template("{spinner} frame {pos}  {msg}").expect("a valid template")
}

fn progress() -> ProgressStyle {
    ProgressStyle::with_template("{bar:40} {pos}/{len} frames, {eta} left  {msg}")
        .expect("a valid template")
}
