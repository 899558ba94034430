//! Holds a plugin against its contract: its texts, and what its code does with ordinary, odd and broken input.
//!
//! [`texts`] reads alone. A [`Probe`] runs the plugin's code, which may end the process: `pegbar plugin check` has it do so in one of its own.

mod checks;
mod guard;
mod literals;
mod make;
mod probe;
mod texts;

use serde::{Deserialize, Serialize};

pub use make::{Kind, Sizes};
pub use probe::{CHECKS, Probe};
pub use texts::texts;

/// What came of one check.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Name of the check.
    pub check: String,
    /// The node type that was looked at; nothing where it was the whole plugin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub node: Option<String>,
    /// What came of it.
    pub outcome: Outcome,
    /// `expected X, found Y`; why it was not tried. Empty where all is well.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub found: String,
    /// What to do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub help: Option<String>,
}

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// All is well.
    Passed,
    /// The contract is broken.
    Failed,
    /// It could not be tried.
    NotTried,
}

/// Why a check ended before its end.
struct Stop {
    outcome: Outcome,
    found: String,
    help: Option<String>,
}

/// How a check goes.
type Checked = Result<(), Stop>;

impl Stop {
    fn failed(found: impl Into<String>) -> Self {
        Self { outcome: Outcome::Failed, found: found.into(), help: None }
    }

    fn not_tried(why: impl Into<String>) -> Self {
        Self { outcome: Outcome::NotTried, found: why.into(), help: None }
    }

    fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

impl Finding {
    fn of(check: &str, node: Option<&str>, done: Checked) -> Self {
        let stop = done.err().unwrap_or(Stop { outcome: Outcome::Passed, found: String::new(), help: None });
        Self { check: check.to_owned(), node: node.map(str::to_owned), outcome: stop.outcome, found: stop.found, help: stop.help }
    }

    /// A check that failed.
    pub fn failed(check: &str, node: Option<&str>, found: impl Into<String>, help: Option<String>) -> Self {
        Self { help, ..Self::of(check, node, Err(Stop::failed(found))) }
    }

    /// A check that passed.
    pub fn passed(check: &str, node: Option<&str>) -> Self {
        Self::of(check, node, Ok(()))
    }
}
