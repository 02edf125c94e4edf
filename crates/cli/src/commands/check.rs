//! `alula check`: validates files.

use std::path::PathBuf;

use alula_runtime::check::check;

use super::{Outcome, Verdict};

/// Validate any file that alula reads.
///
/// Scenarios (.toml), recordings (.mcap), trajectories (.tum, .txt), people's tracks (.csv) and EuRoC
/// folders. Ends with exit code 2 at the first file that is not good, with one message that names
/// file, place, finding and remedy.
#[derive(clap::Args)]
pub struct Arguments {
    /// Files and EuRoC folders.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Change a key of the scenarios; may be given often.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Outcome {
    for file in &arguments.files {
        let finding = check(file, &arguments.overrides)?;
        println!("{}: {}", file.display(), finding.what);
        for line in finding.details {
            println!("  {line}");
        }
    }
    Ok(Verdict::Success)
}
