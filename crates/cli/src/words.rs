//! A flight in words: the summary on the terminal and the facts at the top of a page.

use alula_messages::Fallback;
use alula_runtime::flight::{FlightSummary, Outcome};

use crate::page::{Fact, Row, Status, Table};

/// The facts of a flight, the most important first.
pub fn facts(summary: &FlightSummary) -> Vec<Fact> {
    let estimation = &summary.estimation;
    let fact = |label: &str, value: String, status: Status| Fact {
        label: label.to_owned(),
        value,
        status,
    };
    let plain = |label: &str, value: String| fact(label, value, Status::Neutral);
    let good_if = |good: bool| if good { Status::Good } else { Status::Warning };
    vec![
        fact(
            "outcome",
            format!("{}: {}", summary.outcome.name(), summary.reason),
            if summary.outcome == Outcome::Reached {
                Status::Good
            } else {
                Status::Bad
            },
        ),
        plain(
            "flown",
            format!(
                "{:.1} m in {:.1} s, at up to {:.2} m/s",
                summary.path_length_m, summary.duration_s, summary.max_speed_m_s
            ),
        ),
        fact(
            "landed",
            format!(
                "{:.2} m from the take-off point",
                summary.landing_distance_m
            ),
            good_if(summary.landing_distance_m < 1.0),
        ),
        plain(
            "clearance",
            summary
                .min_clearance_m
                .map_or("nothing around".to_owned(), |c| {
                    format!("never less than {c:.2} m")
                }),
        ),
        plain(
            "estimate",
            format!(
                "position {:.3} m, velocity {:.3} m/s, tilt {:.2} deg, heading {:.2} deg (RMSE)",
                estimation.position_rmse_m,
                estimation.velocity_rmse_m_s,
                estimation.tilt_rmse_deg,
                estimation.yaw_rmse_deg
            ),
        ),
        plain(
            "tracking",
            format!(
                "{:.3} m from the reference (RMSE, true)",
                summary.tracking_rmse_m
            ),
        ),
        fact(
            "guard",
            guard(summary.guard).to_owned(),
            good_if(summary.guard == Fallback::None),
        ),
        plain(
            "speed of simulation",
            format!("{:.0} times real time", summary.real_time_factor),
        ),
    ]
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
    for fact in facts(summary) {
        println!("  {:<20} {}", fact.label, fact.value);
    }
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
