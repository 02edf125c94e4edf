//! `alula study`: a table or figure of a source document, measured anew.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use alula_runtime::RunError;
use alula_runtime::study::{Progress, Request, Results, Row, Study};
use serde::Serialize;

use super::{Outcome, Verdict, all_cores, print_json, task_bar};
use crate::{study_page, words};

/// Measure a table or figure of a source document anew, and show theirs beside.
///
/// Without a name, the studies are listed. The folder of a study gets its rows (rows.csv, opens in
/// pandas, Polars and DuckDB), its figures (summary.json) and a page with charts (report.html).
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Name of the study; all are listed if absent.
    name: Option<String>,
    /// Number of runs [default: that of the study].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    runs: Option<u64>,
    /// Runs at a time [default: one for each core].
    #[arg(long, value_name = "J")]
    jobs: Option<NonZeroUsize>,
    /// Seed of everything random; the runs count up from it.
    #[arg(long, default_value_t = 1, value_name = "S")]
    seed: u64,
    /// Folder of the study [default: out/study-NAME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object instead of the table.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "Examples:
  alula study                                list the studies
  alula study obstacle-tracking              measure, print and draw
  alula study obstacle-tracking --runs 3     fewer runs
  alula study chance-constraint --json       one JSON object, for scripts

Exit codes: 0 all that is asked of the figures is met; 1 it is not; 2 bad input.";

/// The JSON object of a study, and its file.
#[derive(Serialize)]
struct Summary<'a> {
    study: &'a str,
    source: &'a str,
    about: &'a str,
    runs: u64,
    seed: u64,
    met: bool,
    demands: &'a [alula_runtime::study::Demand],
    rows: &'a [Row],
    notes: &'a [String],
    version: &'a str,
}

/// The JSON object of the list.
#[derive(Serialize)]
struct Listed {
    study: &'static str,
    source: &'static str,
    about: &'static str,
    runs: u64,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Outcome {
    match &arguments.name {
        Some(name) => measure(Study::find(name)?, arguments),
        None => {
            list(arguments.json);
            Ok(Verdict::Success)
        }
    }
}

fn list(json: bool) {
    if json {
        let listed = |study: &Study| Listed {
            study: study.name,
            source: study.source,
            about: study.about,
            runs: study.default_runs,
        };
        let studies: Vec<Listed> = Study::all().iter().map(listed).collect();
        print_json(&serde_json::json!({ "studies": studies }));
        return;
    }
    println!("Studies, each with what it shows and where its source stands:\n");
    for study in Study::all() {
        println!(
            "  {}\n      {}\n      {}",
            study.name, study.about, study.source
        );
    }
    println!("\nMeasure one of them: alula study NAME");
}

fn measure(study: &Study, arguments: &Arguments) -> Outcome {
    let request = Request {
        seed: arguments.seed,
        runs: arguments.runs.unwrap_or(study.default_runs),
        jobs: arguments.jobs.unwrap_or_else(all_cores),
    };
    let default_folder = || Path::new("out").join(format!("study-{}", study.name));
    let folder = arguments.out.clone().unwrap_or_else(default_folder);
    let bar = task_bar(study.runs_are);
    let results = study.execute(&request, &|progress: Progress| {
        if bar.length() != Some(progress.asked) {
            bar.set_length(progress.asked);
        }
        bar.set_position(progress.done);
    })?;
    bar.finish_and_clear();
    let summary = Summary {
        study: study.name,
        source: study.source,
        about: study.about,
        runs: results.runs,
        seed: request.seed,
        met: results.met(),
        demands: &results.demands,
        rows: &results.rows,
        notes: &results.notes,
        version: alula_runtime::VERSION,
    };
    write(&folder, study, &summary, &results)?;
    if arguments.json {
        print_json(&summary);
    } else {
        print(study, &results, &folder);
    }
    Ok(Verdict::of(results.met()))
}

fn write(
    folder: &Path,
    study: &Study,
    summary: &Summary,
    results: &Results,
) -> Result<(), RunError> {
    alula_runtime::make_folder(folder)?;
    let write = |name: &str, bytes: &[u8]| alula_runtime::write_file(&folder.join(name), bytes);
    write("rows.csv", results.to_csv().as_bytes())?;
    let json = serde_json::to_vec_pretty(summary).unwrap_or_default();
    write("summary.json", &json)?;
    let page = study_page::page(study, summary.seed, results);
    write("report.html", page.to_html().as_bytes())
}

fn print(study: &Study, results: &Results, folder: &Path) {
    let (runs, runs_are) = (results.runs, study.runs_are);
    println!("\n{}: {}", study.name, study.about);
    println!("  {}; {runs} {runs_are}\n", study.source);
    let (header, rows) = study_page::table(results);
    words::print_columns(&header, &rows);
    println!();
    for demand in &results.demands {
        println!(
            "  {:<8} {}: {}, asked {}",
            study_page::verdict(demand),
            demand.what,
            demand.found(),
            demand.asked()
        );
    }
    for note in &results.notes {
        println!("  {note}");
    }
    println!("\n  report   {}", folder.join("report.html").display());
    println!("  table    {}", folder.join("rows.csv").display());
}
