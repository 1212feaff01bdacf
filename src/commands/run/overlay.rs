//! Pictures with the fitted skeletons drawn: reads the input a second time, beside the two processes.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use edgecap_client::message::BodyFrame;

use crate::capture::{Frame, Source};
use crate::commands::exit::Failure;
use crate::overlay;

/// Draws in a thread of its own, so that the messages keep being read.
#[derive(Debug)]
pub struct OverlayWriter {
    bodies: Sender<Box<BodyFrame>>,
    thread: JoinHandle<anyhow::Result<u64>>,
}

impl OverlayWriter {
    /// Writes `folder/<frame>.png` for every body frame that follows.
    ///
    /// # Errors
    /// If the folder cannot be made.
    pub fn start(source: Box<dyn Source>, folder: PathBuf) -> anyhow::Result<Self> {
        std::fs::create_dir_all(&folder).map_err(|e| Failure::output(&folder, &e))?;
        let (bodies, receiver) = channel();
        let thread = std::thread::spawn(move || draw_all(source, &folder, &receiver));
        Ok(Self { bodies, thread })
    }

    /// Queues one frame.
    pub fn push(&self, frame: &BodyFrame) {
        // The thread ends early only with an error, which `finish` reports.
        let _ = self.bodies.send(Box::new(*frame));
    }

    /// Waits for the last picture; the number written.
    ///
    /// # Errors
    /// If a picture could not be read or written.
    pub fn finish(self) -> anyhow::Result<u64> {
        drop(self.bodies);
        self.thread
            .join()
            .map_err(|_| anyhow::anyhow!("drawing stopped unexpectedly"))?
    }
}

fn draw_all(
    mut source: Box<dyn Source>,
    folder: &std::path::Path,
    bodies: &Receiver<Box<BodyFrame>>,
) -> anyhow::Result<u64> {
    let mut frame = Frame::default();
    let mut read_to = None;
    let mut written = 0;
    for message in bodies {
        while read_to < Some(message.sequence) {
            if !source.next_into(&mut frame)? {
                return Ok(written);
            }
            read_to = Some(frame.sequence);
        }
        if read_to != Some(message.sequence) {
            continue;
        }
        let path = folder.join(format!("{:06}.png", message.sequence));
        overlay::draw(&mut frame, message.bodies());
        overlay::write_png(&frame, &path)?;
        written += 1;
    }
    Ok(written)
}
