//! `alula replay`: the stack once more over a recording.

use std::path::PathBuf;

use alula_geometry::Timestamp;
use alula_runtime::replay::{ReplayReport, replay};

use super::{Outcome, Verdict, print_json};

/// Re-run the stack over a recording and report the first difference.
///
/// A recording replays to the same bits; a difference means that the program or the configuration
/// is not the one that flew. With --set, the replay shows what the stack would have said.
#[derive(clap::Args)]
pub struct Arguments {
    /// The recording.
    #[arg(value_name = "FILE.mcap")]
    file: PathBuf,
    /// Print one JSON object instead of the summary.
    #[arg(long)]
    json: bool,
    /// Change a key of the recorded configuration; may be given often.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Outcome {
    let report = replay(&arguments.file, &arguments.overrides)?;
    if arguments.json {
        print_json(&report);
    } else {
        print(&report);
    }
    Ok(Verdict::of(report.first_difference.is_none()))
}

fn print(report: &ReplayReport) {
    println!(
        "{}: {} (seed {}), recorded by alula {}",
        report.file.display(),
        report.scenario,
        report.seed,
        report.recorded_version
    );
    for damage in &report.damage {
        println!("  the recording is not whole: {damage}");
    }
    match &report.first_difference {
        None => println!("  no difference in {} steps", report.steps),
        Some(difference) => {
            println!(
                "  first difference at {}, step {}: {}",
                Timestamp::from_ns(difference.time_ns),
                difference.step,
                difference.field
            );
            println!("    recorded: {}", difference.recorded);
            println!("    replayed: {}", difference.replayed);
            if report.recorded_version != alula_runtime::VERSION {
                println!(
                    "  the recording is from version {}, this is {}",
                    report.recorded_version,
                    alula_runtime::VERSION
                );
            }
        }
    }
}
