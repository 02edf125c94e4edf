//! The figures of late poses: table, demands and charts.

use nalgebra::Vector3;

use super::{
    BIAS_M_S2, BIAS_RAD_S, DELAY_S, Errors, IMU_HZ, POSE_HZ, POSE_NOISE_M, POSE_NOISE_RAD,
    SETTLED_S, THEIRS, WALK_M_S3_SQRT_HZ, WALK_RAD_S2_SQRT_HZ,
};
use crate::study::{Chart, Column, Curve, Demand, Results, Row, Tone};

/// Root mean squares over flights.
struct Summary {
    pose: [f64; 6],
    bias: [f64; 2],
    bias_size: [f64; 2],
    within: f64,
}

impl Summary {
    fn of<'a>(flights: impl Iterator<Item = &'a Errors>) -> Self {
        let (mut pose, mut bias, mut bias_size) = ([0.0; 6], [0.0; 2], [0.0; 2]);
        let mut within = [0, 0];
        let mut count = 0.0;
        for errors in flights {
            count += errors.pose.len() as f64;
            for (_, error) in &errors.pose {
                for i in 0..6 {
                    pose[i] += error[i] * error[i];
                }
            }
            for i in 0..2 {
                bias[i] += errors.bias_squares[i];
                bias_size[i] += errors.bias_sizes[i];
                within[i] += errors.within[i];
            }
        }
        let root = |sum: f64| (sum / count).sqrt();
        Self {
            pose: pose.map(root),
            bias: bias.map(root),
            bias_size: bias_size.map(root),
            within: within[0] as f64 / within[1] as f64,
        }
    }

    fn row(&self, name: &str) -> Row {
        let row = Row::new().with("filter", name);
        KEYS.iter()
            .zip(self.pose)
            .fold(row, |row, (key, value)| row.with(key, value))
            .with("accelerometer_bias_m_s2", self.bias[0])
            .with("gyroscope_bias_rad_s", self.bias[1])
            .with("biases_within_3_sigma", self.within)
    }
}

const KEYS: [&str; 6] = ["x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad"];
const NAMES: [&str; 2] = ["at their own time", "as if current"];

pub(super) fn results(flights: &[[Errors; 2]]) -> Results {
    let [proper, naive] = [0, 1].map(|i| Summary::of(flights.iter().map(|f| &f[i])));
    let mut first = proper.row(NAMES[0]);
    for (key, value) in KEYS.iter().zip(THEIRS) {
        first = first.theirs(key, value);
    }
    let mut rows = vec![first, naive.row(NAMES[1])];
    for (i, flight) in flights.iter().enumerate() {
        rows.push(Summary::of([&flight[0]].into_iter()).row(&format!("flight {}", i + 1)));
    }
    let mut demands: Vec<Demand> = (0..6)
        .map(|i| {
            let unit = if i < 3 { "m" } else { "rad" };
            let what = format!("RMS error of {}", KEYS[i].split('_').next().unwrap_or(""));
            Demand::at_most(&what, unit, THEIRS[i], proper.pose[i])
        })
        .collect();
    let place = |summary: &Summary| Vector3::from_column_slice(&summary.pose[..3]).norm();
    for (kind, name) in ["accelerometer", "gyroscope"].into_iter().enumerate() {
        demands.push(Demand::at_most(
            &format!("error of the {name}'s bias over its size"),
            "",
            0.5,
            proper.bias[kind] / proper.bias_size[kind],
        ));
    }
    demands.push(Demand::at_least(
        "share of bias errors within three claimed standard deviations",
        "",
        0.97,
        proper.within,
    ));
    demands.push(Demand::at_least(
        "position error of the filter that takes late poses for current ones, over that of this one",
        "",
        1.5,
        place(&naive) / place(&proper),
    ));
    Results {
        runs: flights.len() as u64,
        columns: columns(),
        rows,
        demands,
        charts: flights.first().map(charts).unwrap_or_default(),
        notes: vec![
            format!(
                "Poses at {POSE_HZ} Hz from each of two sensors at the places of equation 2.64, heard \
                 {DELAY_S} s late, the second half a period after the first; inertial data at \
                 {IMU_HZ} Hz."
            ),
            format!(
                "The source does not state its noise. Here: poses {POSE_NOISE_M} m and \
                 {POSE_NOISE_RAD} rad; biases {BIAS_M_S2} m/s^2 and {BIAS_RAD_S} rad/s, walking by \
                 {WALK_M_S3_SQRT_HZ} m/s^3/sqrt(Hz) and {WALK_RAD_S2_SQRT_HZ} rad/s^2/sqrt(Hz)."
            ),
            format!(
                "Errors count from {SETTLED_S} s after the first pose, at each inertial sample."
            ),
        ],
    }
}

fn columns() -> Vec<Column> {
    let mut columns = vec![Column::new("filter", "late poses are fused", 0)];
    let titles = [
        "x (m)",
        "y (m)",
        "z (m)",
        "roll (rad)",
        "pitch (rad)",
        "yaw (rad)",
    ];
    columns.extend(
        KEYS.iter()
            .zip(titles)
            .map(|(key, title)| Column::new(key, title, 4)),
    );
    columns.push(Column::new(
        "accelerometer_bias_m_s2",
        "accelerometer bias (m/s²)",
        4,
    ));
    columns.push(Column::new(
        "gyroscope_bias_rad_s",
        "gyroscope bias (rad/s)",
        5,
    ));
    columns.push(Column::new(
        "biases_within_3_sigma",
        "biases within 3 sigma",
        3,
    ));
    columns
}

fn charts(flight: &[Errors; 2]) -> Vec<Chart> {
    let [proper, naive] = flight;
    let error = |title: &str, unit: &str, part: usize| {
        let points = |errors: &Errors| {
            let points = errors.pose.iter().step_by(2);
            points.map(|(t, error)| (*t, error[part])).collect()
        };
        curves(
            title,
            unit,
            vec![
                Curve::line(NAMES[1], Tone::Second, points(naive)),
                Curve::line(NAMES[0], Tone::Measured, points(proper)),
            ],
        )
    };
    let bias = |title: &str, unit: &str, kind: usize| {
        let points = |which: usize| {
            let points = proper.bias.iter().step_by(5);
            points.map(|(t, bias)| (*t, bias[kind][which])).collect()
        };
        curves(
            title,
            unit,
            vec![
                Curve::line("truth", Tone::Truth, points(1)),
                Curve::line("estimate", Tone::Measured, points(0)),
            ],
        )
    };
    vec![
        error("position error along x", "m", 0),
        error("position error along y", "m", 1),
        error("position error along z", "m", 2),
        error("error of pitch", "rad", 4),
        bias("accelerometer bias along x", "m/s²", 0),
        bias("gyroscope bias about x", "rad/s", 1),
    ]
}

fn curves(title: &str, unit: &str, curves: Vec<Curve>) -> Chart {
    Chart::Curves {
        title: format!("{title}, first flight"),
        x_label: "time (s)".to_owned(),
        y_label: unit.to_owned(),
        curves,
        bands: Vec::new(),
    }
}
