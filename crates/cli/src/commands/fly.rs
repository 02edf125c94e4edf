//! `alula fly`: a simulated mission in closed loop.

use std::path::{Path, PathBuf};

use alula_runtime::flight::{self, Flight, Outcome as FlightOutcome, RecordTo};
use alula_runtime::{RunError, Scenario};
use indicatif::{ProgressBar, ProgressStyle};

use super::{Outcome, Verdict, print_json};
use crate::belief::BeliefFigures;
use crate::figures::{self, FlightFigures};
use crate::words;

/// Fly a simulated mission in closed loop.
///
/// Without a scenario, the built-in one is flown: through a room with two people and two pillars, on
/// its own sensors. The folder of the flight gets a recording (flight.mcap, opens in
/// Foxglove), a report (report.html, report.png) and its figures (summary.json).
#[derive(clap::Args)]
pub struct Arguments {
    /// Scenario file (TOML); the built-in mission if absent.
    scenario: Option<PathBuf>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Folder for the recording and the report [default: out/NAME-SEED].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object instead of the summary.
    #[arg(long)]
    json: bool,
    /// Change a key of the scenario, or remove it (KEY=); may be given often.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Write neither recording nor report.
    #[arg(long, conflicts_with = "out")]
    no_record: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Outcome {
    let scenario = Scenario::load(arguments.scenario.as_deref(), &arguments.overrides)?;
    let folder = output_folder(arguments, &scenario)?;
    let record_to = match &folder {
        Some(folder) => RecordTo::File(folder.join("flight.mcap")),
        None => RecordTo::Nothing,
    };
    let bar = progress_bar(arguments.json);
    let flight = flight::fly(&scenario, arguments.seed, &record_to, &mut |progress| {
        show_now_and_then(&bar, progress);
    })?;
    bar.finish_and_clear();
    if let Some(folder) = &folder {
        write_report(folder, &scenario, &flight)?;
    }
    if arguments.json {
        print_json(&flight.summary);
    } else {
        words::print(&flight.summary);
        words::print_sights(&flight.belief);
        if let Some(folder) = &folder {
            print_where(folder);
        }
    }
    Ok(Verdict::of(
        flight.summary.outcome == FlightOutcome::Reached,
    ))
}

fn output_folder(arguments: &Arguments, scenario: &Scenario) -> Result<Option<PathBuf>, RunError> {
    if arguments.no_record {
        return Ok(None);
    }
    let name = format!("{}-{}", scenario.config().name, arguments.seed);
    let folder = arguments
        .out
        .clone()
        .unwrap_or_else(|| Path::new("out").join(name));
    alula_runtime::make_folder(&folder)?;
    Ok(Some(folder))
}

pub(super) fn write_report(
    folder: &Path,
    scenario: &Scenario,
    flight: &Flight,
) -> Result<(), RunError> {
    let summary = &flight.summary;
    let subtitle = format!(
        "seed {}: {}, {}",
        summary.seed,
        summary.outcome.name(),
        summary.reason
    );
    let figures = FlightFigures::new(
        &summary.scenario,
        &subtitle,
        &flight.log,
        &flight.world,
        &scenario.config().mission.waypoints_m,
    )
    .with_belief(BeliefFigures::of_flight(
        scenario,
        &flight.belief,
        &flight.log,
        &flight.world,
    ));
    let page = figures.page(
        words::cards(summary),
        vec![words::timing_table(summary)],
        Vec::new(),
    );
    figures::write(folder, &page, &figures)?;
    let json = serde_json::to_vec_pretty(summary).unwrap_or_default();
    alula_runtime::write_file(&folder.join("summary.json"), &json)
}

pub(super) fn print_where(folder: &Path) {
    println!("\n  report     {}", folder.join("report.html").display());
    println!("  picture    {}", folder.join("report.png").display());
    println!(
        "  recording  {}  (opens in Foxglove)",
        folder.join("flight.mcap").display()
    );
}

pub(super) fn progress_bar(quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {msg}") {
        bar.set_style(style);
    }
    bar
}

/// Ten times a simulated second.
pub(super) fn show_now_and_then(bar: &ProgressBar, progress: &flight::Progress) {
    if (progress.t_s * 10.0).fract() < 0.05 {
        show(bar, progress);
    }
}

fn show(bar: &ProgressBar, progress: &flight::Progress) {
    let place = progress.output.state.position_world();
    bar.set_message(format!(
        "{:5.1} s  {:<10}  at ({:6.2}, {:6.2}, {:5.2}) m  {:4.2} m/s",
        progress.t_s,
        format!("{:?}", progress.output.mode).to_lowercase(),
        place.x,
        place.y,
        place.z,
        progress.velocity_world.norm()
    ));
    bar.tick();
}
