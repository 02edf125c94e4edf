//! Ten minutes of loops in closed loop on the flow odometry alone.

use nalgebra::Vector3;

use super::{
    Chart, Column, Curve, Demand, Request, Results, Row, Study, Tape, Tone, Watch, built_in,
};
use crate::RunError;
use crate::flight::Progress;
use crate::timing::Distribution;

/// Document S, figure 2.14.
pub const STUDY: Study = Study {
    name: "long-loops",
    source: "document S, section 2.10.2, figure 2.14",
    about: "where ten minutes of loops at 1 m/s end that are flown on the estimate alone",
    runs_are: "flights",
    default_runs: 20,
    execute,
};

const SCENARIO: &str = include_str!("../../../../scenarios/loops.toml");

/// The source's flight: errors at its end, and root mean squares, m.
const THEIR_END_M: [f64; 3] = [0.73, 1.65, 0.028];
const THEIR_RMSE_M: [f64; 3] = [0.47, 0.67, 0.035];

/// Errors at the end that the median flight may have, m: the source's.
const ASKED_END_M: [f64; 3] = [0.73, 1.65, 0.03];

/// Time that the loops have to take, s: "almost 10 min".
const ASKED_DURATION_S: f64 = 570.0;

/// Instants between two points of a chart.
const THINNED: usize = 50;

/// One instant in the air.
#[derive(Clone, Copy, Debug)]
struct Instant {
    t_s: f64,
    error: Vector3<f64>,
}

/// The figures of one flight.
#[derive(Clone, Copy, Debug)]
struct Figures {
    /// Absolute errors at the end, m.
    end: [f64; 3],
    /// Root mean squares from take-off to the end, m.
    rmse: [f64; 3],
    duration_s: f64,
    path_m: f64,
}

fn execute(request: &Request, watch: &Watch) -> Result<Results, RunError> {
    let scenario = built_in(SCENARIO, &[])?;
    let seeds = request.seeds();
    let tapes = request.do_all(&seeds, watch, &|seed| Tape::of(&scenario, seed, look))?;
    Ok(results(&seeds, &tapes))
}

/// What is believed less what is true; nothing on the ground.
fn look(progress: &Progress) -> Option<Instant> {
    let output = progress.output;
    output.mode.is_airborne().then(|| Instant {
        t_s: progress.t_s,
        error: output.state.position_world() - progress.world_from_body.translation.vector,
    })
}

impl Figures {
    /// `None` of a flight that never left the ground.
    fn of(tape: &Tape<Instant>) -> Option<Self> {
        let (first, last) = (tape.instants.first()?, tape.instants.last()?);
        let squares: Vector3<f64> = tape
            .instants
            .iter()
            .map(|i| i.error.component_mul(&i.error))
            .sum();
        let mean = squares / tape.instants.len() as f64;
        Some(Self {
            end: last.error.abs().into(),
            rmse: mean.map(f64::sqrt).into(),
            duration_s: last.t_s - first.t_s,
            path_m: tape.path_m,
        })
    }

    /// One of the quantiles of each figure over the flights.
    fn quantile(all: &[Self], pick: fn(&Distribution) -> f64) -> Self {
        let of = |figure: &dyn Fn(&Self) -> f64| {
            let values: Vec<f64> = all.iter().map(figure).collect();
            pick(&Distribution::of(&values))
        };
        Self {
            end: std::array::from_fn(|i| of(&|f| f.end[i])),
            rmse: std::array::from_fn(|i| of(&|f| f.rmse[i])),
            duration_s: of(&|f| f.duration_s),
            path_m: of(&|f| f.path_m),
        }
    }

    fn row(&self, name: &str, seed: Option<u64>) -> Row {
        let row = Row::new()
            .with("flight", name)
            .with("seed", seed)
            .with("duration_s", self.duration_s)
            .with("path_m", self.path_m);
        let row = (0..3).fold(row, |row, i| row.with(END_KEYS[i], self.end[i]));
        (0..3).fold(row, |row, i| row.with(RMSE_KEYS[i], self.rmse[i]))
    }
}

const END_KEYS: [&str; 3] = ["end_x_m", "end_y_m", "end_z_m"];
const RMSE_KEYS: [&str; 3] = ["rmse_x_m", "rmse_y_m", "rmse_z_m"];

fn results(seeds: &[u64], tapes: &[Tape<Instant>]) -> Results {
    let flights: Vec<(u64, Figures)> = seeds
        .iter()
        .zip(tapes)
        .filter_map(|(seed, tape)| Some((*seed, Figures::of(tape)?)))
        .collect();
    let figures: Vec<Figures> = flights.iter().map(|(_, figures)| *figures).collect();
    let median = Figures::quantile(&figures, |d| d.p50);
    let worst = Figures::quantile(&figures, |d| d.max);
    let with_theirs = (0..3).fold(median.row("median flight", None), |row, i| {
        row.theirs(END_KEYS[i], THEIR_END_M[i])
            .theirs(RMSE_KEYS[i], THEIR_RMSE_M[i])
    });
    let mut rows = vec![with_theirs, worst.row("worst flight", None)];
    rows.extend(
        flights
            .iter()
            .map(|(seed, figures)| figures.row(&format!("seed {seed}"), Some(*seed))),
    );
    Results {
        runs: tapes.len() as u64,
        columns: columns(),
        rows,
        demands: demands(tapes, &figures, &median),
        charts: tapes.first().map(chart).into_iter().collect(),
        notes: vec![
            "The vehicle flies rounds of about 10 m on this estimate alone, take-off and landing \
             included, and never sees where it has been. Errors at the end are those at touch-down. \
             The source shows one flight; its figures at the end are the greatest there."
                .to_owned(),
        ],
    }
}

fn demands(tapes: &[Tape<Instant>], figures: &[Figures], median: &Figures) -> Vec<Demand> {
    let ends = ["x", "y", "z"].into_iter().enumerate().map(|(i, axis)| {
        let what = format!("error of {axis} at the end, median flight");
        Demand::at_most(&what, "m", ASKED_END_M[i], median.end[i])
    });
    let shortest = figures
        .iter()
        .map(|f| f.duration_s)
        .fold(f64::INFINITY, f64::min);
    let reached = tapes.iter().filter(|tape| tape.reached).count();
    ends.chain([
        Demand::at_least("shortest flight", "s", ASKED_DURATION_S, shortest),
        Demand::at_least(
            "flights that reached their end",
            "",
            tapes.len() as f64,
            reached as f64,
        ),
    ])
    .collect()
}

fn columns() -> Vec<Column> {
    vec![
        Column::new("flight", "flight", 0),
        Column::new("duration_s", "duration (s)", 0),
        Column::new("path_m", "path (m)", 0),
        Column::new(END_KEYS[0], "end: x (m)", 3),
        Column::new(END_KEYS[1], "y (m)", 3),
        Column::new(END_KEYS[2], "z (m)", 4),
        Column::new(RMSE_KEYS[0], "RMSE: x (m)", 3),
        Column::new(RMSE_KEYS[1], "y (m)", 3),
        Column::new(RMSE_KEYS[2], "z (m)", 4),
    ]
}

fn chart(tape: &Tape<Instant>) -> Chart {
    let curve = |name, tone, axis: usize| {
        let thinned = tape.instants.iter().step_by(THINNED);
        Curve::line(
            name,
            tone,
            thinned.map(|i| (i.t_s, i.error[axis])).collect(),
        )
    };
    Chart::Curves {
        title: "error of the position, first flight".to_owned(),
        x_label: "time (s)".to_owned(),
        y_label: "estimate less truth (m)".to_owned(),
        curves: vec![
            curve("x", Tone::Measured, 0),
            curve("y", Tone::Second, 1),
            curve("z", Tone::Truth, 2),
        ],
        bands: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flight whose error grows evenly to `end` in ten minutes.
    fn tape(end: f64) -> Tape<Instant> {
        let instant = |i: u32| Instant {
            t_s: f64::from(i),
            error: Vector3::new(1.0, -1.0, 0.1) * end * f64::from(i) / 600.0,
        };
        Tape {
            instants: (0..=600).map(instant).collect(),
            reached: true,
            path_m: 500.0,
        }
    }

    #[test]
    fn the_median_flight_is_judged_by_its_end() {
        let seeds = [1, 2, 3];
        let met = |ends: [f64; 3]| -> Vec<bool> {
            let demands = results(&seeds, &ends.map(tape)).demands;
            demands.iter().map(Demand::met).collect()
        };
        assert_eq!(met([0.1, 0.2, 9.0]), [true; 5]);
        assert_eq!(met([0.1, 0.8, 9.0]), [false, true, false, true, true]);
    }

    /// The mean square of a ramp is a third of that of its end.
    #[test]
    fn the_root_mean_square_is_over_the_whole_flight() {
        let figures = Figures::of(&tape(3.0)).unwrap();
        assert!((figures.rmse[0] - 3.0_f64.sqrt()).abs() < 0.01);
        assert_eq!(figures.end, [3.0, 3.0, 3.0 * 0.1]);
        assert_eq!(figures.duration_s, 600.0);
    }
}
