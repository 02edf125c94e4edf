//! Velocity, roll and pitch of the cascade estimator while a vehicle flies on it.

use alula_geometry::so3;

use super::{
    Chart, Column, Curve, Demand, Request, Results, Row, Study, Tape, Tone, Watch, built_in,
};
use crate::flight::Progress;
use crate::timing::Distribution;
use crate::{RunError, Scenario};

/// Document O, figures 2.17 to 2.19, 2.22 and 2.23.
pub const STUDY: Study = Study {
    name: "velocity",
    source: "document O, section 2.5.3, figures 2.17 to 2.23",
    about: "velocity and attitude of the two-stage estimator, flying forward, left, backward, right",
    runs_are: "flights",
    default_runs: 20,
    execute,
};

/// The flight of the source's section 2.5.3.
pub(super) const SCENARIO: &str = include_str!("../../../../scenarios/legs.toml");

/// What is asked: root mean square of each component, m/s and degrees.
const ASKED_M_S: f64 = 0.1;
const ASKED_DEG: f64 = 1.0;

/// One instant of a flight.
#[derive(Clone, Copy, Debug)]
struct Instant {
    t_s: f64,
    /// Estimated and true velocity, world, m/s.
    velocity: [[f64; 3]; 2],
    /// Estimated and true roll and pitch, degrees.
    tilt: [[f64; 2]; 2],
    /// Estimated and true height, m.
    height: [f64; 2],
}

pub(super) fn scenario(overrides: &[String]) -> Result<Scenario, RunError> {
    built_in(SCENARIO, overrides)
}

fn execute(request: &Request, watch: &Watch) -> Result<Results, RunError> {
    let scenario = scenario(&[])?;
    let seeds = request.seeds();
    let tapes = request.do_all(&seeds, watch, &|seed| Tape::of(&scenario, seed, look))?;
    Ok(results(&seeds, &tapes))
}

/// What is believed and what is true; nothing on the ground.
fn look(progress: &Progress) -> Option<Instant> {
    let output = progress.output;
    if !output.mode.is_airborne() {
        return None;
    }
    let tilt = |rotation| {
        let (roll, pitch, _) = so3::to_roll_pitch_yaw(rotation);
        [roll.to_degrees(), pitch.to_degrees()]
    };
    let state = &output.state;
    let truth = &progress.world_from_body;
    Some(Instant {
        t_s: progress.t_s,
        velocity: [state.velocity_world.into(), progress.velocity_world.into()],
        tilt: [tilt(&state.world_from_body.rotation), tilt(&truth.rotation)],
        height: [state.position_world().z, truth.translation.z],
    })
}

/// Root mean squares of one flight: velocity along x, y, z, roll, pitch, height.
fn errors(tape: &Tape<Instant>) -> [f64; 6] {
    let mut squares = [0.0; 6];
    for instant in &tape.instants {
        let [velocity, truth] = instant.velocity;
        let [tilt, true_tilt] = instant.tilt;
        let error = [
            velocity[0] - truth[0],
            velocity[1] - truth[1],
            velocity[2] - truth[2],
            tilt[0] - true_tilt[0],
            tilt[1] - true_tilt[1],
            instant.height[0] - instant.height[1],
        ];
        for (square, error) in squares.iter_mut().zip(error) {
            *square += error * error;
        }
    }
    squares.map(|square| (square / tape.instants.len() as f64).sqrt())
}

const KEYS: [&str; 6] = [
    "velocity_x_m_s",
    "velocity_y_m_s",
    "velocity_z_m_s",
    "roll_deg",
    "pitch_deg",
    "height_m",
];

fn row(name: &str, seed: Option<u64>, errors: &[f64; 6]) -> Row {
    let row = Row::new().with("flight", name).with("seed", seed);
    KEYS.iter()
        .zip(errors)
        .fold(row, |row, (key, error)| row.with(key, *error))
}

fn results(seeds: &[u64], tapes: &[Tape<Instant>]) -> Results {
    let each: Vec<[f64; 6]> = tapes.iter().map(errors).collect();
    let spread = |pick: fn(&Distribution) -> f64| {
        std::array::from_fn(|i| {
            let values: Vec<f64> = each.iter().map(|errors| errors[i]).collect();
            pick(&Distribution::of(&values))
        })
    };
    let worst: [f64; 6] = spread(|d| d.max);
    let mut rows = vec![
        row("median flight", None, &spread(|d| d.p50)),
        row("worst flight", None, &worst),
    ];
    rows.extend(
        seeds
            .iter()
            .zip(&each)
            .map(|(seed, errors)| row(&format!("seed {seed}"), Some(*seed), errors)),
    );
    let reached = tapes.iter().filter(|tape| tape.reached).count();
    let velocity = worst[..3].iter().copied().fold(0.0, f64::max);
    let tilt = worst[3].max(worst[4]);
    Results {
        runs: tapes.len() as u64,
        columns: columns(),
        rows,
        demands: vec![
            Demand::at_most(
                "worst RMSE of a component of velocity",
                "m/s",
                ASKED_M_S,
                velocity,
            ),
            Demand::at_most("worst RMSE of roll or pitch", "deg", ASKED_DEG, tilt),
            Demand::at_least(
                "flights that reached their end",
                "",
                tapes.len() as f64,
                reached as f64,
            ),
        ],
        charts: tapes.first().map(charts).unwrap_or_default(),
        notes: vec![
            "The vehicle flies in closed loop on this estimate. Errors are root mean squares from \
             take-off to landing; the source shows curves and states no figures."
                .to_owned(),
        ],
    }
}

fn columns() -> Vec<Column> {
    vec![
        Column::new("flight", "flight", 0),
        Column::new(KEYS[0], "velocity x (m/s)", 3),
        Column::new(KEYS[1], "y (m/s)", 3),
        Column::new(KEYS[2], "z (m/s)", 3),
        Column::new(KEYS[3], "roll (deg)", 2),
        Column::new(KEYS[4], "pitch (deg)", 2),
        Column::new(KEYS[5], "height (m)", 3),
    ]
}

fn charts(tape: &Tape<Instant>) -> Vec<Chart> {
    // Fifty points a second are enough for a line.
    let thinned = || tape.instants.iter().step_by(5);
    let chart = |title: &str, unit: &str, pick: &dyn Fn(&Instant, usize) -> f64| {
        let line = |name, tone, which| {
            let points = thinned().map(|instant| (instant.t_s, pick(instant, which)));
            Curve::line(name, tone, points.collect())
        };
        Chart::Curves {
            title: format!("{title}, first flight"),
            x_label: "time (s)".to_owned(),
            y_label: unit.to_owned(),
            curves: vec![
                line("truth", Tone::Truth, 1),
                line("estimate", Tone::Measured, 0),
            ],
            bands: Vec::new(),
        }
    };
    vec![
        chart("forward velocity", "m/s", &|i, which| i.velocity[which][0]),
        chart("lateral velocity", "m/s", &|i, which| i.velocity[which][1]),
        chart("vertical velocity", "m/s", &|i, which| i.velocity[which][2]),
        chart("height", "m", &|i, which| i.height[which]),
        chart("roll", "deg", &|i, which| i.tilt[which][0]),
        chart("pitch", "deg", &|i, which| i.tilt[which][1]),
    ]
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    use super::*;

    #[test]
    fn a_flight_on_the_estimate_meets_all_demands() {
        let request = Request {
            seed: 3,
            runs: 1,
            jobs: NonZeroUsize::MIN,
        };
        let results = execute(&request, &|_| {}).unwrap();
        for demand in &results.demands {
            assert!(demand.met(), "{demand:?}");
        }
    }
}
