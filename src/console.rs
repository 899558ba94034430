//! Where results and messages go, and the exit codes.

use std::io::Write;

use pegbar_engine::diag::{Diagnostic, SourceMap};
use pegbar_engine::node::Cancel;
use serde::Serialize;

/// Every output that was asked for exists and is whole.
pub const EXIT_OK: u8 = 0;
/// A node failed, or an output is missing.
pub const EXIT_FAILED: u8 = 1;
/// The graph or the command line is wrong.
pub const EXIT_WRONG: u8 = 2;
/// Cancelled.
pub const EXIT_CANCELLED: u8 = 130;

/// The outside of a command: two streams, and the wish to stop.
pub struct Console<'a> {
    /// For results, and for nothing else.
    pub stdout: &'a mut (dyn Write + Send),
    /// For messages and progress.
    pub stderr: &'a mut (dyn Write + Send),
    /// Whether messages go to a terminal, which can show a moving bar.
    pub is_terminal: bool,
    /// Whether messages may be coloured.
    pub colour: bool,
    /// Ends a run.
    pub cancel: Cancel,
}

impl Console<'_> {
    /// Prints a result. A reader that has gone away (`pegbar nodes | head`) is no error.
    pub(crate) fn out(&mut self, text: &str) {
        let _ = self.stdout.write_all(text.as_bytes()).and_then(|()| self.stdout.flush());
    }

    /// Prints a message.
    pub(crate) fn say(&mut self, text: &str) {
        let _ = self.stderr.write_all(text.as_bytes()).and_then(|()| self.stderr.flush());
    }

    /// Prints a result as indented JSON.
    pub(crate) fn json(&mut self, value: &impl Serialize) -> u8 {
        match serde_json::to_string_pretty(value) {
            Ok(text) => {
                self.out(&format!("{text}\n"));
                EXIT_OK
            }
            Err(error) => {
                self.say(&format!("error: the result cannot be shown as JSON: {error}\n"));
                EXIT_FAILED
            }
        }
    }

    /// Prints diagnostics as text, a blank line between.
    pub(crate) fn diagnostics(&mut self, sources: &SourceMap, diagnostics: &[Diagnostic]) {
        if !diagnostics.is_empty() {
            let text = sources.render_all(diagnostics, self.colour);
            self.say(&text);
        }
    }

    /// Prints what clap has to say: help and version are results, all else is an error.
    pub(crate) fn clap(&mut self, error: &clap::Error) -> u8 {
        let text = error.render();
        let text = if self.colour { text.ansi().to_string() } else { text.to_string() };
        if error.use_stderr() {
            self.say(&text);
            EXIT_WRONG
        } else {
            self.out(&text);
            EXIT_OK
        }
    }
}

/// `1 error`, `2 errors`.
pub(crate) fn count(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}
