//! Whether the filters of the flow odometry know how wrong they are: document S, figure 2.7.

use alula_estimation::SensorSet;
use alula_estimation::eskf::{FilterKind, Nominal, QuaternionIntegration, Truncation, Variant};
use alula_estimation::metrics::{AneesBand, anees_band, nees_of};
use alula_messages::error_index::{ORIENTATION, POSITION};

use super::odometry::{Flight, STEP_S, Shape, fly};
use super::{Chart, Column, Curve, CurveBand, Demand, Request, Results, Row, Study, Tone, Watch};
use crate::RunError;

/// Document S, figure 2.7.
pub const STUDY: Study = Study {
    name: "anees",
    source: "document S, section 2.10.1, figure 2.7",
    about: "whether the errors of the flow odometry are as large as its covariance says",
    runs_are: "flights",
    default_runs: 500,
    execute,
};

/// Flights of the source's experiment; more flights repeat it with other seeds.
const RUNS: usize = 25;

const DURATION_S: f64 = 60.0;
const LENGTH_M: f64 = 50.0;

/// Steps between two looks.
const LOOK_EACH: usize = 10;

/// Share of the flight that the average has to be inside the band: in the median experiment, and over
/// all flights.
const ASKED_INSIDE: f64 = 0.95;

/// Rows of the pose: the six numbers of document S, equation 2.91.
const POSE: [usize; 6] = [
    POSITION,
    POSITION + 1,
    POSITION + 2,
    ORIENTATION,
    ORIENTATION + 1,
    ORIENTATION + 2,
];

/// The source's two extremes, the simplest and the most exact.
const EXTREMES: [Variant; 2] = [
    Variant {
        filter: FilterKind::Extended,
        integration: QuaternionIntegration::Q0B,
        transition: Truncation::F1,
    },
    Variant {
        filter: FilterKind::ErrorStateGlobal,
        integration: QuaternionIntegration::Q1,
        transition: Truncation::F3,
    },
];

/// Sensor sets, with their name.
const SETS: [(SensorSet, &str); 2] = [
    (SensorSet::FlowAndInfrared, "flow and infrared"),
    (SensorSet::VelocityAndSonar, "velocity and sonar"),
];

/// Normalised errors of a flight: for each sensor set and variant, one for each look.
type Errors = [[Vec<f64>; 2]; 2];

/// The normalised errors of one flight, a function of its seed.
fn normalised_errors(seed: u64) -> Errors {
    SETS.map(|(sensors, _)| {
        let flight = Flight {
            shape: Shape::Line,
            length_m: LENGTH_M,
            duration_s: DURATION_S,
            sensors,
        };
        let mut errors = [Vec::new(), Vec::new()];
        let mut step = 0;
        fly(&flight, seed, &EXTREMES, |_, truth, filters| {
            step += 1;
            if step % LOOK_EACH == 0 {
                for (errors, filter) in errors.iter_mut().zip(filters) {
                    errors.push(nees_of_pose(&filter.nominal, truth, &filter.covariance()));
                }
            }
        });
        errors
    })
}

/// A covariance without inverse counts as infinitely wrong.
fn nees_of_pose(
    estimate: &Nominal,
    truth: &Nominal,
    covariance: &alula_messages::ErrorCovariance,
) -> f64 {
    nees_of(&estimate.error_to(truth), covariance, POSE).unwrap_or(f64::INFINITY)
}

/// An average over the flights of an experiment at each look, and how much of it is inside the band.
struct Average {
    values: Vec<f64>,
    inside: f64,
}

impl Average {
    fn new(set: usize, extreme: usize, flights: &[Errors], band: &AneesBand) -> Self {
        let looks = flights.first().map_or(0, |f| f[set][extreme].len());
        let values: Vec<f64> = (0..looks)
            .map(|i| {
                let sum: f64 = flights.iter().map(|f| f[set][extreme][i]).sum();
                sum / flights.len() as f64
            })
            .collect();
        let inside = values.iter().filter(|v| (band.low..=band.high).contains(v));
        Self {
            inside: inside.count() as f64 / values.len() as f64,
            values,
        }
    }
}

/// The experiment with one variant and sensor set, done again and again.
struct Repeated {
    variant: Variant,
    sensors: &'static str,
    /// Share of the flight that the first of them was inside.
    first_inside: f64,
    /// From the one that was inside the least.
    experiments: Vec<Average>,
    /// Of all flights together, in the same band.
    pooled: Average,
}

impl Repeated {
    fn new(set: usize, extreme: usize, flights: &[Errors], band: &AneesBand) -> Self {
        let mut experiments: Vec<Average> = flights
            .chunks(RUNS)
            .map(|flights| Average::new(set, extreme, flights, band))
            .collect();
        let first_inside = experiments.first().map_or(f64::NAN, |first| first.inside);
        experiments.sort_by(|a, b| a.inside.total_cmp(&b.inside));
        Self {
            variant: EXTREMES[extreme],
            sensors: SETS[set].1,
            first_inside,
            experiments,
            pooled: Average::new(set, extreme, flights, band),
        }
    }

    /// The lower one of the two in the middle.
    fn median(&self) -> Option<&Average> {
        self.experiments
            .get((self.experiments.len().max(1) - 1) / 2)
    }

    fn median_inside(&self) -> f64 {
        self.median().map_or(f64::NAN, |average| average.inside)
    }

    fn demands(&self) -> [Demand; 2] {
        let demand = |which: &str, inside: f64| {
            let what = format!(
                "share of the flight inside the band, {which}, {}, {}",
                self.variant, self.sensors
            );
            Demand::at_least(&what, "", ASKED_INSIDE, inside)
        };
        [
            demand("median experiment", self.median_inside()),
            demand("all flights together", self.pooled.inside),
        ]
    }

    fn row(&self, band: &AneesBand) -> Row {
        let count = self.experiments.len() as f64;
        let mean_inside = self.experiments.iter().map(|a| a.inside).sum::<f64>() / count;
        let pooled = &self.pooled.values;
        let mean = pooled.iter().sum::<f64>() / pooled.len() as f64;
        let greatest = pooled.iter().copied().fold(0.0, f64::max);
        let row = Row::new()
            .with("variant", self.variant.to_string())
            .with("sensors", self.sensors)
            .with("experiments", self.experiments.len())
            .with("median_inside", self.median_inside())
            .with("mean_inside", mean_inside)
            .with("first_inside", self.first_inside)
            .with("pooled_inside", self.pooled.inside)
            .with("mean", mean)
            .with("greatest", greatest)
            .with("band_low", band.low)
            .with("band_high", band.high);
        if self.is_theirs() {
            row.theirs("band_low", 4.719).theirs("band_high", 7.432)
        } else {
            row
        }
    }

    /// Whether the source shows it.
    fn is_theirs(&self) -> bool {
        self.sensors == SETS[0].1
    }
}

fn execute(request: &Request, watch: &Watch) -> Result<Results, RunError> {
    let flights = request.do_all(&request.seeds(), watch, &|seed| Ok(normalised_errors(seed)))?;
    let band = anees_band(6, flights.len().min(RUNS) as u32, 0.95);
    let repeated = [(0, 0), (0, 1), (1, 0), (1, 1)]
        .map(|(set, extreme)| Repeated::new(set, extreme, &flights, &band));
    Ok(Results {
        runs: request.runs,
        columns: vec![
            Column::new("variant", "variant", 0),
            Column::new("sensors", "sensors", 0),
            Column::new("experiments", "experiments", 0),
            Column::new("median_inside", "inside the band, median", 3),
            Column::new("mean_inside", "inside, mean", 3),
            Column::new("first_inside", "first experiment", 3),
            Column::new("pooled_inside", "all flights together", 3),
            Column::new("mean", "their mean, of 6", 2),
            Column::new("greatest", "their greatest", 2),
        ],
        rows: repeated.iter().map(|a| a.row(&band)).collect(),
        demands: repeated.iter().flat_map(Repeated::demands).collect(),
        charts: SETS
            .iter()
            .map(|(_, sensors)| chart(sensors, &repeated, &band))
            .collect(),
        notes: vec![
            format!(
                "An experiment is {RUNS} flights of a minute, 50 m in a straight line with swings \
                 forward and back, left and right, up and down; noise and uncertainty at the start \
                 as in the source's table 2.4. The normalised squared error of the pose is averaged \
                 over its flights, ten times a second; shown is the experiment in the middle."
            ),
            "At one time the average of a filter that knows its errors is inside with 95 %. Errors \
             of place and heading last, so that most experiments are inside for nearly all of the \
             flight, some for half of it, and 95 % is the mean of them. The average over all \
             flights does not depend on luck: above 6 the filter is too sure of itself, below it \
             is not sure enough."
                .to_owned(),
        ],
    })
}

fn chart(sensors: &str, repeated: &[Repeated], band: &AneesBand) -> Chart {
    let time_s = |i: usize| (i + 1) as f64 * LOOK_EACH as f64 * STEP_S;
    let shown = repeated.iter().filter(|a| a.sensors == sensors);
    let curves = shown.zip([Tone::Measured, Tone::Second]).map(|(a, tone)| {
        let values = a.median().into_iter().flat_map(|average| &average.values);
        let points = values.enumerate().map(|(i, value)| (time_s(i), *value));
        Curve::line(&a.variant.to_string(), tone, points.collect())
    });
    Chart::Curves {
        title: format!("average normalised error of the pose, {sensors}"),
        x_label: "time (s)".to_owned(),
        y_label: "average normalised squared error".to_owned(),
        curves: curves.collect(),
        bands: vec![CurveBand {
            name: "95 % of consistent filters".to_owned(),
            points: [0.0, DURATION_S].map(|t| (t, band.low, band.high)).into(),
            tone: Tone::Limit,
        }],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_average_is_judged_at_each_look() {
        let flight = |a: f64| -> Errors {
            let values = vec![a, 6.0, 6.0, 20.0];
            [
                [values.clone(), values.clone()],
                [values.clone(), values.clone()],
            ]
        };
        let band = anees_band(6, 2, 0.95);
        let average = Average::new(0, 0, &[flight(4.0), flight(8.0)], &band);
        assert_eq!(average.values, [6.0, 6.0, 6.0, 20.0]);
        assert!((average.inside - 0.75).abs() < 1e-12);
    }
}
