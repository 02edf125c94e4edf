//! `alula campaign`: one scenario, many seeds.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use alula_runtime::RunError;
use alula_runtime::campaign::{
    self, Campaign, CampaignSummary, ClearanceFigures, Difference, Request, Shard, Tally,
};
use indicatif::ProgressBar;
use serde::Serialize;

use super::{Outcome, Verdict, all_cores, fly, print_json, task_bar};
use crate::words;

/// Fly one scenario with many seeds, on all cores.
///
/// The folder gets one row a flight as soon as it is over (rows.jsonl), and in the end a table of
/// all flights (flights.csv) and their figures (summary.json). The same command goes on where a
/// killed one ended, and a larger --runs adds flights.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Scenario file (TOML); the built-in mission if absent [with --out alone: the folder's own].
    scenario: Option<PathBuf>,
    /// Number of flights; needed for the first command only.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    runs: Option<u64>,
    /// Flights at a time [default: one for each core].
    #[arg(long, value_name = "J")]
    jobs: Option<NonZeroUsize>,
    /// Folder of the campaign [default: out/NAME-campaign].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Seed of the first flight; the others count up [default: 1].
    #[arg(long, value_name = "S")]
    first_seed: Option<u64>,
    /// Change a key of the scenario, or remove it (KEY=); may be given often.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Print one JSON object instead of the summary.
    #[arg(long)]
    json: bool,
    /// Fly only part I of K (I from 0), so that K machines share the work.
    #[arg(long, value_name = "I/K")]
    shard: Option<Shard>,
    /// Add the flights of these folders to those in --out, and fly none.
    #[arg(
        long,
        value_name = "DIR",
        num_args = 1..,
        requires = "out",
        conflicts_with_all = ["scenario", "runs", "jobs", "first_seed", "overrides", "shard", "refly"]
    )]
    merge: Vec<PathBuf>,
    /// Fly one flight of --out again, record it in full and compare it with its row.
    #[arg(
        long,
        value_name = "SEED",
        requires = "out",
        conflicts_with_all = ["scenario", "runs", "jobs", "first_seed", "overrides", "shard"]
    )]
    refly: Option<u64>,
}

const EXAMPLES: &str = "Examples:
  alula campaign scenarios/first-flight.toml --runs 1000
  alula campaign --out out/first-flight-campaign             go on after a kill
  alula campaign forest.toml --runs 1000 --set simulation.wind.mean_m_s=[3,0,0] --out out/windy
  alula campaign forest.toml --runs 1000 --shard 2/8 --out part-2         on machine 2 of 8
  alula campaign --merge part-0 part-1 part-2 --out whole
  alula campaign --refly 17 --out whole      record flight 17 into whole/seed-17

Exit codes: 0 all flights asked for were flown and reached their goal, or the flight flown again is
the same; 1 not so; 2 bad input.";

/// Runs the command.
pub fn run(arguments: &Arguments) -> Outcome {
    match (&arguments.out, arguments.refly) {
        (Some(folder), Some(seed)) => refly(folder, seed, arguments.json),
        (Some(folder), None) if !arguments.merge.is_empty() => merge(folder, arguments),
        _ => fly_campaign(arguments),
    }
}

fn fly_campaign(arguments: &Arguments) -> Outcome {
    let campaign = Campaign::begin(&Request {
        scenario: arguments.scenario.as_deref(),
        overrides: &arguments.overrides,
        runs: arguments.runs,
        first_seed: arguments.first_seed,
        folder: arguments.out.as_deref(),
    })?;
    let jobs = arguments.jobs.unwrap_or_else(all_cores);
    let shard = arguments.shard.unwrap_or(Shard::WHOLE);
    let bar = task_bar("flights");
    let tally = campaign.fly_missing(shard, jobs, &mut |tally| show(&bar, tally))?;
    bar.finish_and_clear();
    conclude(&campaign, arguments.json)?;
    Ok(Verdict::of(tally.all_reached()))
}

fn merge(folder: &Path, arguments: &Arguments) -> Outcome {
    let campaign = campaign::merge(&arguments.merge, folder)?;
    let summary = conclude(&campaign, arguments.json)?;
    Ok(Verdict::of(
        summary.missing == 0 && summary.reached == summary.runs,
    ))
}

fn conclude(campaign: &Campaign, json: bool) -> Result<CampaignSummary, RunError> {
    let summary = campaign.conclude()?;
    if json {
        print_json(&summary);
    } else {
        print(&summary, campaign.folder());
    }
    Ok(summary)
}

fn show(bar: &ProgressBar, tally: &Tally) {
    if bar.length() != Some(tally.asked) {
        bar.set_length(tally.asked);
        bar.set_position(tally.flown);
        // Flights of earlier commands took no time of this one.
        bar.reset_eta();
    }
    bar.set_message(format!(
        "{} reached, {} collided",
        tally.reached, tally.collided
    ));
    bar.set_position(tally.flown);
}

fn print(summary: &CampaignSummary, folder: &Path) {
    let last_seed = summary.first_seed + (summary.runs + summary.missing).saturating_sub(1);
    println!(
        "\n{} (seeds {} to {last_seed})",
        summary.scenario, summary.first_seed
    );
    for (what, how_much) in lines(summary) {
        println!("  {what:<20} {how_much}");
    }
    for (kind, seeds) in &summary.failed_seeds {
        println!("    {kind:<24} {:>5}   {}", seeds.len(), seed_list(seeds));
    }
    println!("\n  table      {}", folder.join("flights.csv").display());
    if let Some(seed) = summary.failed_seeds.values().flatten().next() {
        let folder = folder.display();
        println!("  look at it alula campaign --refly {seed} --out {folder}");
    }
}

/// The lines of the summary on a terminal: what, and how much.
fn lines(summary: &CampaignSummary) -> Vec<(&'static str, String)> {
    let flights = match summary.missing {
        0 => format!("{}", summary.runs),
        missing => format!("{}, {missing} not flown yet", summary.runs),
    };
    let mut lines = vec![
        ("flights", flights),
        (
            "reached",
            rate(
                summary.reached,
                summary.success_rate,
                summary.success_rate_ci95,
            ),
        ),
        (
            "collisions",
            rate(
                summary.collisions,
                summary.collision_rate,
                summary.collision_rate_ci95,
            ),
        ),
    ];
    if let Some(figures) = &summary.min_clearance_m {
        lines.push(("least clearance", clearance(figures)));
    }
    if let Some(figures) = &summary.min_person_distance_m {
        lines.push(("nearest person", clearance(figures)));
        let seeds = &summary.unseen_contact_seeds;
        let unseen = match summary.unseen_contacts {
            0 => "none".to_owned(),
            contacts => format!("{contacts}, seeds {}", seed_list(seeds)),
        };
        lines.push(("contacts unseen", unseen));
    }
    let failed: u64 = summary.failures.values().sum();
    lines.push(("failed", format!("{failed}")));
    lines
}

fn rate(count: u64, rate: f64, [low, high]: [f64; 2]) -> String {
    format!(
        "{count}: {:.2} %, with 95 % confidence {:.2} to {:.2} % (Clopper-Pearson)",
        100.0 * rate,
        100.0 * low,
        100.0 * high
    )
}

fn clearance(figures: &ClearanceFigures) -> String {
    let ClearanceFigures { min, p01, p50 } = figures;
    format!("{min:.3} m, in 99 % of the flights above {p01:.3} m, median {p50:.3} m")
}

/// The first seeds of a list.
fn seed_list(seeds: &[u64]) -> String {
    const SHOWN: usize = 8;
    let shown: Vec<String> = seeds.iter().take(SHOWN).map(u64::to_string).collect();
    let more = if seeds.len() > SHOWN { ", ..." } else { "" };
    format!("{}{more}", shown.join(", "))
}

/// The JSON object of `--refly`.
#[derive(Serialize)]
struct ReflyReport<'a> {
    seed: u64,
    same: bool,
    differences: &'a [Difference],
    folder: &'a Path,
    version: &'a str,
}

fn refly(folder: &Path, seed: u64, json: bool) -> Outcome {
    let campaign = Campaign::open(folder)?;
    let bar = fly::progress_bar(json);
    let refly = campaign.refly(seed, &mut |progress| fly::show_now_and_then(&bar, progress))?;
    bar.finish_and_clear();
    if let Some(flight) = &refly.flight {
        fly::write_report(&refly.folder, campaign.scenario(), flight)?;
    }
    let same = refly.differences.is_empty();
    if json {
        print_json(&ReflyReport {
            seed,
            same,
            differences: &refly.differences,
            folder: &refly.folder,
            version: alula_runtime::VERSION,
        });
        return Ok(Verdict::of(same));
    }
    if let Some(flight) = &refly.flight {
        words::print(&flight.summary);
        fly::print_where(&refly.folder);
    }
    if same {
        println!("\n  The flight is the one of the campaign: every figure is the same.");
    }
    for Difference {
        column,
        row,
        reflown,
    } in &refly.differences
    {
        println!("  {column}: the campaign has {row}, this flight {reflown}");
    }
    Ok(Verdict::of(same))
}
