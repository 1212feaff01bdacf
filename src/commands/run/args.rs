//! What a run makes of its options: what its `infer` gets, and the line at its end.

use super::RunArgs;
use crate::commands::infer::InferTask;
use crate::commands::input::NamedInput;
use crate::commands::say;
use crate::commands::tally::Tally;
use crate::counted::counted;

impl RunArgs {
    pub(super) fn infer_task(&self, chosen: &NamedInput) -> InferTask {
        InferTask {
            input: self.input.resolved(chosen),
            engine: self.engine.clone(),
            waits: !self.no_wait,
            show_picture: self.show_picture,
            pace: self.pace.clone(),
            cameras: self.engine.cameras,
        }
    }

    /// Says what there is now.
    pub(super) fn conclude(&self, tally: &Tally, words: &[String]) {
        let done = format!(
            "{}, {}",
            counted(tally.frames, "frame", "frames"),
            counted(tally.people, "person", "people")
        );
        let say = if self.record.takes_stdout() {
            say::err
        } else {
            say::out
        };
        say(&say::concluded(&done, words));
    }
}
