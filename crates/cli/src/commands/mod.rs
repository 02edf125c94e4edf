//! The commands, one file each: what they accept, what they do, what they print.

pub mod campaign;
pub mod check;
pub mod estimate;
pub mod fly;
pub mod replay;
pub mod report;

use alula_runtime::RunError;

/// How a command ended when its input was good.
pub enum Verdict {
    /// As wished: exit code 0.
    Success,
    /// The flight failed, or a difference was found: exit code 1.
    Failure,
}

impl Verdict {
    /// Success if `good`.
    pub fn of(good: bool) -> Self {
        if good { Self::Success } else { Self::Failure }
    }
}

/// What a command returns: bad input is an error and ends with exit code 2.
pub type Outcome = Result<Verdict, RunError>;

/// Prints one JSON object on stdout.
pub fn print_json(value: &impl serde::Serialize) {
    // A summary is plain data with text keys: it always has a JSON form.
    if let Ok(text) = serde_json::to_string_pretty(value) {
        println!("{text}");
    }
}
