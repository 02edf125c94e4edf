//! The program `alula`: guidance for micro aerial vehicles, close to things.
//!
//! This is the one place that talks to a terminal and ends a process.
#![allow(clippy::print_stdout, clippy::print_stderr)]

mod belief;
mod campaign_page;
mod commands;
mod depth_pictures;
mod figures;
mod outlines;
mod page;
mod plot;
mod study_page;
mod words;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Guidance for micro aerial vehicles, close to things.
///
/// alula estimates a multirotor's motion from what it carries on board, plans, controls, and keeps a
/// guard over all of it. Without hardware it flies a simulated vehicle.
#[derive(Parser)]
#[command(version, max_term_width = 100, after_help = EXAMPLES)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "Examples:
  alula fly                                  fly the built-in mission and draw it
  alula fly --seed 7 --set simulation.wind.mean_m_s=[2,0,0]
  alula fly scenarios/forest.toml --json     one JSON object, for scripts
  alula campaign scenarios/forest.toml --runs 1000
  alula report out/among-people-1            draw a flight again
  alula replay out/among-people-1/flight.mcap
  alula estimate V1_01_easy --estimator pose-imu --pose-rate-hz 10 --pose-delay-s 0.1
  alula study obstacle-tracking              a table of a source document, measured anew
  alula check scenarios/forest.toml flight.mcap

Exit codes: 0 success, 1 the flight or comparison failed, 2 bad input.";

/// The commands, each explained where its arguments are.
#[derive(Subcommand)]
enum Command {
    Fly(commands::fly::Arguments),
    Campaign(commands::campaign::Arguments),
    Replay(commands::replay::Arguments),
    Estimate(commands::estimate::Arguments),
    Study(commands::study::Arguments),
    Check(commands::check::Arguments),
    Report(commands::report::Arguments),
}

fn main() -> ExitCode {
    let outcome = match Arguments::parse().command {
        Command::Fly(arguments) => commands::fly::run(&arguments),
        Command::Campaign(arguments) => commands::campaign::run(&arguments),
        Command::Replay(arguments) => commands::replay::run(&arguments),
        Command::Estimate(arguments) => commands::estimate::run(&arguments),
        Command::Study(arguments) => commands::study::run(&arguments),
        Command::Check(arguments) => commands::check::run(&arguments),
        Command::Report(arguments) => commands::report::run(&arguments),
    };
    match outcome {
        Ok(commands::Verdict::Success) => ExitCode::SUCCESS,
        Ok(commands::Verdict::Failure) => ExitCode::from(1),
        Err(error) => {
            eprintln!("alula: {error}");
            ExitCode::from(2)
        }
    }
}
