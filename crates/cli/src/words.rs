//! A flight in words: the summary on the terminal and the facts at the top of a page.

use alula_messages::Fallback;
use alula_runtime::belief::BeliefLog;
use alula_runtime::flight::{FlightSummary, Outcome};

use crate::page::{Fact, Row, Status, Table};

/// The facts of a flight as short cards for a page, the most important first.
pub fn cards(summary: &FlightSummary) -> Vec<Fact> {
    let estimation = &summary.estimation;
    let reached = summary.outcome == Outcome::Reached;
    let card = |label: &str, value: String, status: Status| Fact {
        label: label.to_owned(),
        value,
        status,
    };
    let plain = |label: &str, value: String| card(label, value, Status::Neutral);
    let good_if = |good: bool| if good { Status::Good } else { Status::Warning };
    let outcome = if reached { Status::Good } else { Status::Bad };
    let people = summary.min_person_distance_m.map(|distance_m| {
        let status = good_if(summary.contacts.is_empty());
        card("nearest person", format!("{distance_m:.2} m"), status)
    });
    let mut cards = vec![card("outcome", outcome_word(summary), outcome)];
    cards.extend(people);
    cards.extend([
        card(
            "guard",
            guard(summary.guard).to_owned(),
            good_if(summary.guard == Fallback::None),
        ),
        card(
            "landed from the take-off point",
            format!("{:.2} m", summary.landing_distance_m),
            good_if(summary.landing_distance_m < 1.0),
        ),
        plain("duration", format!("{:.1} s", summary.duration_s)),
        plain("path", format!("{:.1} m", summary.path_length_m)),
        plain("top speed", format!("{:.2} m/s", summary.max_speed_m_s)),
        plain("least clearance", metres_or_none(summary.min_clearance_m)),
        plain(
            "position error (RMSE)",
            format!("{:.3} m", estimation.position_rmse_m),
        ),
        plain(
            "velocity error (RMSE)",
            format!("{:.3} m/s", estimation.velocity_rmse_m_s),
        ),
        plain(
            "tilt error (RMSE)",
            format!("{:.2} deg", estimation.tilt_rmse_deg),
        ),
        plain(
            "heading error (RMSE)",
            format!("{:.2} deg", estimation.yaw_rmse_deg),
        ),
        plain(
            "from the reference (RMSE)",
            format!("{:.3} m", summary.tracking_rmse_m),
        ),
    ]);
    cards
}

/// How it ended, with the word for what stopped it.
fn outcome_word(summary: &FlightSummary) -> String {
    match &summary.failure {
        Some(failure) => format!("{}: {failure}", summary.outcome.name()),
        None => summary.outcome.name().to_owned(),
    }
}

/// How near people came; `None` where there were none.
fn people(summary: &FlightSummary) -> Option<String> {
    let distance_m = summary.min_person_distance_m?;
    let (all, unseen) = (summary.contacts.len(), summary.unseen_contacts);
    let contacts = match (all, unseen) {
        (0, _) => "0 contacts".to_owned(),
        (1, 0) => "1 contact".to_owned(),
        (1, _) => "1 contact, by someone from outside the field of view".to_owned(),
        (_, 0) => format!("{all} contacts"),
        _ => format!("{all} contacts, {unseen} of them from outside the field of view"),
    };
    Some(format!(
        "kept {distance_m:.2} m from them (centre to ellipsoid), {contacts}"
    ))
}

fn metres_or_none(value: Option<f64>) -> String {
    value.map_or("nothing around".to_owned(), |metres| {
        format!("{metres:.2} m")
    })
}

/// The lines of the summary on a terminal: what, and how much.
fn lines(summary: &FlightSummary) -> Vec<(&'static str, String)> {
    let estimation = &summary.estimation;
    let mut lines = vec![
        (
            "outcome",
            format!("{}: {}", summary.outcome.name(), summary.reason),
        ),
        (
            "flown",
            format!(
                "{:.1} m in {:.1} s, at up to {:.2} m/s",
                summary.path_length_m, summary.duration_s, summary.max_speed_m_s
            ),
        ),
        (
            "landed",
            format!(
                "{:.2} m from the take-off point",
                summary.landing_distance_m
            ),
        ),
        ("least clearance", metres_or_none(summary.min_clearance_m)),
    ];
    lines.extend(people(summary).map(|text| ("people", text)));
    lines.extend([
        (
            "estimate",
            format!(
                "position {:.3} m, velocity {:.3} m/s, tilt {:.2} deg, heading {:.2} deg (RMSE)",
                estimation.position_rmse_m,
                estimation.velocity_rmse_m_s,
                estimation.tilt_rmse_deg,
                estimation.yaw_rmse_deg
            ),
        ),
        (
            "tracking",
            format!(
                "{:.3} m from the reference (RMSE, true)",
                summary.tracking_rmse_m
            ),
        ),
        ("guard", guard(summary.guard).to_owned()),
        (
            "speed of simulation",
            format!("{:.0} times real time", summary.real_time_factor),
        ),
    ]);
    lines
}

fn guard(worst: Fallback) -> &'static str {
    match worst {
        Fallback::None => "had nothing to do",
        Fallback::Hold => "held the vehicle",
        Fallback::Land => "landed the vehicle",
        Fallback::Descend => "flew a descent",
        Fallback::Cut => "cut the motors",
    }
}

/// The same for a terminal.
pub fn print(summary: &FlightSummary) {
    println!("\n{} (seed {})", summary.scenario, summary.seed);
    for (what, how_much) in lines(summary) {
        print_line(what, &how_much);
    }
}

/// What was seen, for a terminal; nothing where the vehicle did not look.
pub fn print_sights(belief: &BeliefLog) {
    if belief.images > 0 {
        let (tracked, images) = (belief.tracked(), belief.images);
        let text = format!("{tracked} tracked in {images} depth images");
        print_line("obstacles", &text);
    }
}

fn print_line(what: &str, how_much: &str) {
    println!("  {what:<20} {how_much}");
}

/// Durations of the parts of a step.
pub fn timing_table(summary: &FlightSummary) -> Table {
    let rows = summary
        .timing_ms
        .iter()
        .map(|(name, d)| Row {
            cells: vec![
                (*name).to_owned(),
                format!("{:.4}", d.p50),
                format!("{:.4}", d.p99),
                format!("{:.4}", d.max),
            ],
            status: Status::Neutral,
        })
        .collect();
    Table {
        title: "Duration of a step".to_owned(),
        header: ["part", "median (ms)", "p99 (ms)", "worst (ms)"]
            .map(str::to_owned)
            .to_vec(),
        rows,
        caption: "Wall-clock time on the machine that simulated the flight.".to_owned(),
    }
}

/// Prints a table: numbers flush right, words flush left.
pub fn print_columns(header: &[String], rows: &[Vec<String>]) {
    let table = Table {
        header: header.to_vec(),
        rows: rows
            .iter()
            .map(|cells| Row {
                cells: cells.clone(),
                status: Status::Neutral,
            })
            .collect(),
        ..Table::default()
    };
    for line in table.to_lines() {
        println!("  {line}");
    }
}
