//! The filters of document S, table 2.1, over long flights: its table 2.2.

use alula_estimation::SensorSet;
use alula_estimation::eskf::{FilterKind, Nominal, QuaternionIntegration, Truncation, Variant};
use nalgebra::Vector3;

use super::odometry::{Flight, STEP_S, Shape, fly, orientation_index};
use super::{Chart, Column, Demand, Request, Results, Row, Study, StudyBar, Tone, Watch};
use crate::RunError;

/// Document S, table 2.2.
pub const STUDY: Study = Study {
    name: "odometry-variants",
    source: "document S, section 2.10.1, table 2.2",
    about: "errors of all variants of the flow odometry after 500 m in 10 minutes",
    runs_are: "flights",
    default_runs: 20,
    execute,
};

const LENGTH_M: f64 = 500.0;
const DURATION_S: f64 = 600.0;

/// What is asked: the source's least error of x, its height error, and its rotation index.
const ASKED_XY_M: f64 = 10.1;
const ASKED_Z_M: f64 = 7e-3;
const ASKED_INDEX: f64 = 2e-3;
/// Greatest departure of a variant from the mean of all, as a share.
const ASKED_SPREAD: f64 = 0.1;

use FilterKind::{ErrorStateGlobal, ErrorStateLocal, Extended};
use QuaternionIntegration::{Q0B, Q0F, Q1};
use Truncation::{F1, F2, F3};

/// The source's columns: x and y in m, z in mm.
const THEIRS: [(FilterKind, Truncation, QuaternionIntegration, [f64; 3]); 11] = [
    (Extended, F1, Q0F, [10.54, 11.13, 7.0]),
    (Extended, F1, Q0B, [10.48, 11.07, 6.0]),
    (Extended, F1, Q1, [10.30, 10.85, 7.0]),
    (Extended, F2, Q1, [10.26, 10.81, 6.0]),
    (Extended, F3, Q1, [10.26, 10.81, 6.0]),
    (ErrorStateGlobal, F1, Q0F, [10.58, 11.00, 7.0]),
    (ErrorStateGlobal, F1, Q0B, [10.37, 10.82, 7.0]),
    (ErrorStateGlobal, F1, Q1, [10.13, 10.55, 7.0]),
    (ErrorStateGlobal, F2, Q1, [10.12, 10.58, 7.0]),
    (ErrorStateGlobal, F3, Q1, [10.12, 10.58, 7.0]),
    (ErrorStateLocal, F1, Q0F, [10.38, 10.91, 7.0]),
];

/// The source's rotation index, the same for all.
const THEIR_INDEX: f64 = 2e-3;

/// What is left at the end of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
struct EndError {
    position: Vector3<f64>,
    orientation_index: f64,
}

impl EndError {
    fn of(estimate: &Nominal, truth: &Nominal) -> Self {
        Self {
            position: estimate.position_world - truth.position_world,
            orientation_index: orientation_index(estimate, truth),
        }
    }
}

/// The errors of all variants at the end of one flight: a function of its seed.
fn end_errors(shape: Shape, seed: u64, variants: &[Variant]) -> Vec<EndError> {
    let flight = Flight {
        shape,
        length_m: LENGTH_M,
        duration_s: DURATION_S,
        sensors: SensorSet::FlowAndInfrared,
    };
    let mut errors = Vec::new();
    fly(&flight, seed, variants, |t, truth, filters| {
        if t > DURATION_S - 0.5 * STEP_S {
            let of = filters.iter().map(|f| EndError::of(&f.nominal, truth));
            errors = of.collect();
        }
    });
    errors
}

fn execute(request: &Request, watch: &Watch) -> Result<Results, RunError> {
    let variants: Vec<Variant> = Variant::all().collect();
    let flights = request.do_all(&request.seeds(), watch, &|seed| {
        Ok([Shape::Line, Shape::Loops].map(|shape| end_errors(shape, seed, &variants)))
    })?;
    let figures: Vec<Figures> = (0..variants.len())
        .map(|i| Figures {
            variant: variants[i],
            line: Rmse::of(flights.iter().map(|[line, _]| &line[i])),
            loops: Rmse::of(flights.iter().map(|[_, loops]| &loops[i])),
        })
        .collect();
    Ok(results(request.runs, &figures))
}

/// Root mean squares over the flights (document S, equation 2.89, at the end of each).
#[derive(Clone, Copy, Debug)]
struct Rmse {
    position: Vector3<f64>,
    orientation_index: f64,
}

impl Rmse {
    fn of<'a>(errors: impl Iterator<Item = &'a EndError> + Clone) -> Self {
        let count = errors.clone().count() as f64;
        let mean = |figure: &dyn Fn(&EndError) -> f64| {
            let sum: f64 = errors.clone().map(|e| figure(e).powi(2)).sum();
            (sum / count).sqrt()
        };
        Self {
            position: Vector3::from_fn(|i, _| mean(&|e| e.position[i])),
            orientation_index: mean(&|e| e.orientation_index),
        }
    }
}

struct Figures {
    variant: Variant,
    line: Rmse,
    loops: Rmse,
}

impl Figures {
    fn row(&self) -> Row {
        let millimetres = 1000.0;
        let row = Row::new()
            .with("variant", self.variant.to_string())
            .with("x_m", self.line.position.x)
            .with("y_m", self.line.position.y)
            .with("z_mm", self.line.position.z * millimetres)
            .with("orientation_index", self.line.orientation_index)
            .with("loops_x_m", self.loops.position.x)
            .with("loops_y_m", self.loops.position.y)
            .with("loops_z_mm", self.loops.position.z * millimetres)
            .with("loops_orientation_index", self.loops.orientation_index);
        let v = &self.variant;
        let theirs = THEIRS
            .iter()
            .find(|t| (t.0, t.1, t.2) == (v.filter, v.transition, v.integration));
        match theirs {
            Some((_, _, _, [x, y, z])) => row
                .theirs("x_m", *x)
                .theirs("y_m", *y)
                .theirs("z_mm", *z)
                .theirs("orientation_index", THEIR_INDEX),
            None => row,
        }
    }

    /// The figures of the straight flights, in the order of [`MEASURES`].
    fn of_lines(&self) -> [f64; 4] {
        let p = &self.line.position;
        [p.x, p.y, p.z, self.line.orientation_index]
    }
}

/// Name, unit and limit of each figure.
const MEASURES: [(&str, &str, f64); 4] = [
    ("x", "m", ASKED_XY_M),
    ("y", "m", ASKED_XY_M),
    ("z", "m", ASKED_Z_M),
    ("rotation index", "", ASKED_INDEX),
];

fn demands(figures: &[Figures]) -> Vec<Demand> {
    let worst = MEASURES.iter().enumerate().map(|(i, (name, unit, limit))| {
        let worst = figures.iter().map(|f| f.of_lines()[i]).fold(0.0, f64::max);
        Demand::at_most(&format!("{name} of the worst variant"), unit, *limit, worst)
    });
    let spread = MEASURES[..3].iter().enumerate().map(|(i, (name, _, _))| {
        let what = format!("departure of {name} of a variant from the mean of all");
        let measured = spread(&figures.iter().map(|f| f.of_lines()[i]).collect::<Vec<_>>());
        Demand::at_most(&what, "", ASKED_SPREAD, measured)
    });
    worst.chain(spread).collect()
}

/// Greatest departure from the mean, as a share of it.
fn spread(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let departures = values.iter().map(|v| (v - mean).abs());
    departures.fold(0.0, f64::max) / mean
}

fn results(runs: u64, figures: &[Figures]) -> Results {
    Results {
        runs,
        columns: vec![
            Column::new("variant", "variant", 0),
            Column::new("x_m", "x (m)", 2),
            Column::new("y_m", "y (m)", 2),
            Column::new("z_mm", "z (mm)", 2),
            Column::new("orientation_index", "rotation index", 6),
            Column::new("loops_x_m", "loops: x (m)", 3),
            Column::new("loops_y_m", "loops: y (m)", 3),
            Column::new("loops_z_mm", "loops: z (mm)", 2),
        ],
        rows: figures.iter().map(Figures::row).collect(),
        demands: demands(figures),
        charts: vec![bars(figures)],
        notes: vec![
            "Errors are root mean squares over the flights of what is left at their end. All \
             variants run on the same samples of each flight: 500 m in 10 minutes in a straight \
             line of random direction, with swings forward and back, left and right, up and down; \
             and again in loops of 3 to 6 m radius."
                .to_owned(),
            "Noise of the samples and uncertainty at the start are those of the source's table \
             2.4; the source says of its simulator only that they are similar to the real units. \
             Its x and y errors are those of a heading that was off by 3.6 degrees at the end (its \
             rotation index of 0.002), and the noise of its table 2.4 turns the heading by 0.7 \
             degrees. The height, which is observed, is comparable."
                .to_owned(),
        ],
    }
}

fn bars(figures: &[Figures]) -> Chart {
    let horizontal_m = |f: &Figures| f.line.position.xy().norm();
    let bars = figures.iter().map(|f| StudyBar {
        label: f.variant.to_string(),
        value: horizontal_m(f),
        tone: Tone::Measured,
    });
    let theirs = StudyBar {
        label: "the source, ESKF F1 Q0B GE".to_owned(),
        value: 10.37_f64.hypot(10.82),
        tone: Tone::Theirs,
    };
    Chart::Bars {
        title: "horizontal error after 500 m in a straight line".to_owned(),
        x_label: "root mean square (m)".to_owned(),
        bars: bars.chain([theirs]).collect(),
        limit: None,
        decimals: 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_column_of_the_source_is_one_of_our_variants() {
        let figures = Variant::all().map(|variant| Figures {
            variant,
            line: Rmse::of([].iter()),
            loops: Rmse::of([].iter()),
        });
        let with_theirs = figures.filter(|f| f.row().their("x_m").is_some());
        assert_eq!(with_theirs.count(), THEIRS.len());
    }

    #[test]
    fn the_spread_is_a_share_of_the_mean() {
        assert!((spread(&[0.9, 1.0, 1.1]) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_flight_is_a_function_of_its_seed() {
        let flight = Flight {
            shape: Shape::Loops,
            length_m: 5.0,
            duration_s: 6.0,
            sensors: SensorSet::VelocityAndSonar,
        };
        let variants = [Variant::default()];
        let last = |seed| {
            let mut last = None;
            fly(&flight, seed, &variants, |_, _, filters| {
                last = Some(filters[0].nominal);
            });
            last.unwrap()
        };
        assert_eq!(last(1), last(1));
        assert_ne!(last(1), last(2));
    }
}
