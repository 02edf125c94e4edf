//! The commands, one file each: what they accept, what they do, what they print.

pub mod campaign;
pub mod check;
pub mod estimate;
pub mod fly;
pub mod replay;
pub mod report;
pub mod study;

use std::num::NonZeroUsize;
use std::thread;
use std::time::Duration;

use alula_runtime::RunError;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

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

/// As many tasks at a time as there are cores.
fn all_cores() -> NonZeroUsize {
    thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

/// A bar that counts tasks, named in the plural. Drawn on stderr, and only on a terminal.
fn task_bar(tasks: &str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
    let template = format!(
        "{{spinner}} {{pos}}/{{len}} {tasks}  {{msg}}  {{elapsed}} passed, {{eta}} to go {{wide_bar}}"
    );
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}
