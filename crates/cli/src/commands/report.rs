//! `alula report`: draws a flight again, or tabulates many.

use std::path::{Path, PathBuf};

use alula_runtime::RunError;
use alula_runtime::campaign::{self, Campaign};
use alula_runtime::flights::{FlightRow, read_rows};
use alula_runtime::replay::read_flight;

use super::{Outcome, Verdict};
use crate::belief::BeliefFigures;
use crate::campaign_page;
use crate::figures::{self, FlightFigures};
use crate::page::{Fact, Page, PageFigure, Row, Span, Status, Table};
use crate::plot::{Bar, Bars, Colour, Panel};

/// Draw what happened in a flight, or tabulate many flights.
///
/// A folder with flight.mcap gets report.html and report.png, drawn from the recording alone. A
/// folder of such folders, or of a campaign, gets a report.html with a table of its flights.
#[derive(clap::Args)]
pub struct Arguments {
    /// Folder of a flight, or of many.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Outcome {
    let folder = &arguments.folder;
    let recording = folder.join("flight.mcap");
    if recording.is_file() {
        report_flight(folder, &recording)?;
    } else if campaign::is_campaign(folder) {
        report_campaign(folder)?;
    } else {
        report_flights(folder)?;
    }
    println!("{}", folder.join("report.html").display());
    Ok(Verdict::Success)
}

fn report_flight(folder: &Path, recording: &Path) -> Result<(), RunError> {
    let flight = read_flight(recording)?;
    let config = flight.scenario.config();
    let figures = FlightFigures::new(
        &config.name,
        &format!("seed {}, drawn from its recording", flight.seed),
        &flight.log,
        &flight.world,
        &config.mission.waypoints_m,
    )
    .with_belief(BeliefFigures::of_flight(
        &flight.scenario,
        &flight.belief,
        &flight.log,
        &flight.world,
    ));
    let log = &flight.log;
    let errors = log.estimation_errors();
    let fact = |label: &str, value: String| Fact {
        label: label.to_owned(),
        value,
        status: Status::Neutral,
    };
    let summary = vec![
        fact(
            "flown",
            format!("{:.1} m in {:.1} s", log.path_length_m, log.duration_s()),
        ),
        fact(
            "landed",
            format!(
                "{:.2} m from the take-off point",
                log.distance_from_start_m()
            ),
        ),
        fact(
            "position error",
            format!("{:.3} m RMSE", errors.position_rmse_m),
        ),
        fact(
            "velocity error",
            format!("{:.3} m/s RMSE", errors.velocity_rmse_m_s),
        ),
    ];
    let notes = flight
        .damage
        .iter()
        .map(|d| format!("The recording is not whole: {d}"))
        .collect();
    figures::write(
        folder,
        &figures.page(summary, vec![events_table(log)], notes),
        &figures,
    )
}

fn events_table(log: &alula_runtime::flight_log::FlightLog) -> Table {
    Table {
        title: "What happened".to_owned(),
        header: ["time (s)", "event"].map(str::to_owned).to_vec(),
        rows: log
            .events
            .iter()
            .map(|event| Row {
                cells: vec![format!("{:.2}", event.t_s), event.describe()],
                status: Status::Neutral,
            })
            .collect(),
        caption: String::new(),
    }
}

fn report_campaign(folder: &Path) -> Result<(), RunError> {
    let campaign = Campaign::open(folder)?;
    let page = campaign_page::page(&campaign, &campaign.rows()?);
    alula_runtime::write_file(&folder.join("report.html"), page.to_html().as_bytes())
}

fn report_flights(folder: &Path) -> Result<(), RunError> {
    let rows = read_rows(folder)?;
    let page = Page {
        title: format!("{} flights", rows.len()),
        subtitle: folder.display().to_string(),
        summary: facts(&rows),
        figures: vec![landings(&rows)],
        tables: vec![table(&rows)],
        notes: Vec::new(),
        footer: format!("alula {}", alula_runtime::VERSION),
    };
    alula_runtime::write_file(&folder.join("report.html"), page.to_html().as_bytes())
}

fn facts(rows: &[FlightRow]) -> Vec<Fact> {
    let reached = rows.iter().filter(|row| row.outcome == "reached").count();
    let mut distances: Vec<f64> = rows.iter().map(|row| row.landing_distance_m).collect();
    distances.sort_by(f64::total_cmp);
    let below_1_m = distances.iter().filter(|d| **d < 1.0).count();
    let fact = |label: &str, value: String, good: bool| Fact {
        label: label.to_owned(),
        value,
        status: if good { Status::Good } else { Status::Warning },
    };
    vec![
        fact(
            "reached",
            format!("{reached} of {}", rows.len()),
            reached == rows.len(),
        ),
        fact(
            "landed within 1 m of the take-off point",
            format!("{below_1_m} of {}", rows.len()),
            below_1_m == rows.len(),
        ),
        fact(
            "distance at landing",
            format!(
                "median {:.3} m, worst {:.3} m",
                distances[distances.len() / 2],
                distances[distances.len() - 1]
            ),
            true,
        ),
    ]
}

fn landings(rows: &[FlightRow]) -> PageFigure {
    let bars = rows
        .iter()
        .map(|row| Bar {
            label: format!("seed {}", row.seed),
            value: row.landing_distance_m,
            colour: if row.outcome == "reached" {
                Colour::Blue
            } else {
                Colour::Vermillion
            },
        })
        .collect();
    let chart = Bars {
        title: "distance from the take-off point at landing".to_owned(),
        x_label: "distance (m)".to_owned(),
        bars,
        limit: Some(("1 m".to_owned(), 1.0)),
        decimals: 2,
    };
    PageFigure {
        svg: chart.to_svg(1000.0),
        caption: String::new(),
        span: Span::Full,
    }
}

fn table(rows: &[FlightRow]) -> Table {
    let worst = rows
        .iter()
        .map(|row| row.landing_distance_m)
        .fold(0.0, f64::max);
    let status = |row: &FlightRow| match row.outcome.as_str() {
        "reached" if row.landing_distance_m == worst => Status::Warning,
        "reached" => Status::Neutral,
        _ => Status::Bad,
    };
    Table {
        title: "All flights".to_owned(),
        header: [
            "seed",
            "outcome",
            "duration (s)",
            "path (m)",
            "landing distance (m)",
            "position (m)",
            "velocity (m/s)",
            "clearance (m)",
            "x real time",
        ]
        .map(str::to_owned)
        .to_vec(),
        rows: rows
            .iter()
            .map(|row| Row {
                cells: vec![
                    row.seed.to_string(),
                    row.outcome.clone(),
                    format!("{:.1}", row.duration_s),
                    format!("{:.1}", row.path_length_m),
                    format!("{:.3}", row.landing_distance_m),
                    format!("{:.3}", row.position_rmse_m),
                    format!("{:.3}", row.velocity_rmse_m_s),
                    row.min_clearance_m
                        .map_or("-".to_owned(), |c| format!("{c:.2}")),
                    format!("{:.0}", row.real_time_factor),
                ],
                status: status(row),
            })
            .collect(),
        caption: "Position and velocity: root mean square errors of the estimate. Clearance: the least. The \
                  worst landing is highlighted.".to_owned(),
    }
}
