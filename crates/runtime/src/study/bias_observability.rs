//! How far a multirotor must tilt to tell the bias of its accelerometer from a tilt.

use alula_estimation::{Estimator, EstimatorConfig, FlowCalibration, by_name};
use alula_geometry::{GRAVITY_M_S2, TimeDelta, Timestamp, so3};
use alula_messages::{
    FlightMode, FlowSample, ImuSample, Looking, Mount, RangeSample, SensorBatch, error_index,
};
use nalgebra::{Vector2, Vector3};
use rand::SeedableRng;
use rand_distr::{Distribution as _, StandardNormal};
use rand_pcg::Pcg64;

use super::{Chart, Column, Curve, Demand, Request, Results, Row, Study, Tone, Watch};
use crate::RunError;

/// Document S, figure 2.6.
pub const STUDY: Study = Study {
    name: "bias-observability",
    source: "document S, section 2.10.1, figure 2.6",
    about: "error of the accelerometer's bias along x while a pitch angle is held",
    runs_are: "flights",
    default_runs: 20,
    execute,
};

/// Angles that are held, degrees.
const PITCH_DEG: [f64; 5] = [0.0, 5.0, 10.0, 15.0, 20.0];

/// Stand, climb, hover, tilt and hold: times in s, height in m.
const CLIMB_S: f64 = 2.0;
const TOP_S: f64 = 5.0;
const TILT_S: f64 = 8.0;
const TILTED_S: f64 = 8.5;
const END_S: f64 = 28.5;
const STAND_M: f64 = 0.2;
const HOVER_M: f64 = 2.0;

/// Time between inertial samples; each third ends a flow sample, each fifth has a range.
const STEP: TimeDelta = TimeDelta::from_ns(4_000_000);

/// Standard deviation of the true gyroscope bias on each axis, rad/s (document S, table 2.4).
const GYROSCOPE_BIAS_RAD_S: f64 = 0.004;

/// What the filter believes about the bias before the flight, m/s^2; the true one is drawn from it.
const START_SIGMA_M_S2: f64 = 0.05;

/// Observed means here: tilting takes away half the variance.
const HALF_THE_VARIANCE: f64 = 0.7;

/// Root mean square of twenty draws over their standard deviation: 1, give or take 0.16; thrice that.
const HONEST: f64 = 1.5;

/// What balances the tilted thrust.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Held {
    /// Nothing: the vehicle speeds up along x, as the source has it.
    SpeedingUp,
    /// The drag of a steady wind: it stays where it is.
    AgainstWind,
}

impl Held {
    const ALL: [Self; 2] = [Self::SpeedingUp, Self::AgainstWind];

    fn name(self) -> &'static str {
        match self {
            Self::SpeedingUp => "speeding up",
            Self::AgainstWind => "against wind",
        }
    }
}

/// Bias along x: time since the tilt began, error and claimed standard deviation, m/s^2.
type Track = Vec<(f64, f64, f64)>;

fn execute(request: &Request, watch: &Watch) -> Result<Results, RunError> {
    let cases = Held::ALL.len() * PITCH_DEG.len();
    let tasks: Vec<u64> = (0..request.runs * cases as u64).collect();
    let tracks = request.do_all(&tasks, watch, &|task| {
        let (held, pitch_deg) = case(task as usize % cases);
        let seed = request.seed.wrapping_add(task / cases as u64);
        fly(held, pitch_deg.to_radians(), seed)
    })?;
    let of_case = |i: usize| -> Vec<&Track> { tracks.iter().skip(i).step_by(cases).collect() };
    let summaries: Vec<Summary> = (0..cases).map(|i| Summary::of(i, &of_case(i))).collect();
    Ok(results(request.runs * cases as u64, &summaries))
}

fn case(i: usize) -> (Held, f64) {
    (
        Held::ALL[i / PITCH_DEG.len()],
        PITCH_DEG[i % PITCH_DEG.len()],
    )
}

/// A vehicle that moves in the plane of x and z.
struct Motion {
    held: Held,
    pitch_rad: f64,
    /// Velocity along x at the present and at the sample before, m/s.
    speed: [f64; 2],
}

/// Smooth from 0 to 1, at rest up to the second derivative at both ends.
fn smooth(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * s * (10.0 + s * (6.0 * s - 15.0))
}

impl Motion {
    fn pitch(&self, t: f64) -> f64 {
        self.pitch_rad * smooth((t - TILT_S) / (TILTED_S - TILT_S))
    }

    fn height(&self, t: f64) -> f64 {
        STAND_M + (HOVER_M - STAND_M) * smooth((t - CLIMB_S) / (TOP_S - CLIMB_S))
    }

    /// Vertical velocity by differences; 1e-4 s leaves 1e-7.
    fn climb(&self, t: f64) -> f64 {
        (self.height(t + 1e-4) - self.height(t - 1e-4)) / 2e-4
    }

    /// The true mean of what an inertial unit feels from `t` - `dt` to `t`: specific force and rate.
    fn advance(&mut self, t: f64, dt: f64) -> [Vector3<f64>; 2] {
        let up = (self.climb(t) - self.climb(t - dt)) / dt + GRAVITY_M_S2;
        let pitch = self.pitch(t - 0.5 * dt);
        // Thrust along the mast that keeps the height; in the wind, drag undoes its level part.
        let along = match self.held {
            Held::SpeedingUp => up * pitch.tan(),
            Held::AgainstWind => 0.0,
        };
        self.speed = [self.speed[0] + along * dt, self.speed[0]];
        let attitude = so3::from_roll_pitch_yaw(0.0, pitch, 0.0);
        let rate = (self.pitch(t) - self.pitch(t - dt)) / dt;
        [
            attitude.inverse() * Vector3::new(along, 0.0, up),
            Vector3::y() * rate,
        ]
    }
}

/// The true sensors.
struct Rig {
    motion: Motion,
    random: Pcg64,
    bias: [Vector3<f64>; 2],
    config: EstimatorConfig,
    mount: Mount,
    speeds: [f64; 4],
}

impl Rig {
    fn new(held: Held, pitch_rad: f64, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut config = EstimatorConfig::default();
        let alignment = &mut config.flow_odometry.alignment;
        alignment.start_position_m = [0.0, 0.0, STAND_M];
        alignment.accelerometer_bias_sigma_m_s2 = START_SIGMA_M_S2;
        let mut draw = || Vector3::from_fn(|_, _| StandardNormal.sample(&mut random));
        let bias = [draw() * START_SIGMA_M_S2, draw() * GYROSCOPE_BIAS_RAD_S];
        Self {
            motion: Motion {
                held,
                pitch_rad,
                speed: [0.0; 2],
            },
            random,
            bias,
            config,
            mount: Mount::at([0.0; 3], Looking::Down),
            speeds: [0.0; 4],
        }
    }

    fn draw(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| StandardNormal.sample(&mut self.random))
    }

    /// What is measured in the step that ends at `now`.
    fn measure(&mut self, step: i64, now: Timestamp, batch: &mut SensorBatch) {
        let (t, dt) = (now.as_s(), STEP.as_s());
        batch.clear();
        batch.now = now;
        let [force, rate] = self.motion.advance(t, dt);
        self.speeds.rotate_left(1);
        self.speeds[3] = self.motion.speed[0];
        let noise = self.config.flow_odometry.imu_noise.clone();
        let root = dt.sqrt();
        batch.imu.push(ImuSample {
            time: now,
            specific_force: force
                + self.bias[0]
                + self.draw() * (noise.accelerometer_noise_m_s2_sqrt_hz / root),
            angular_rate: rate
                + self.bias[1]
                + self.draw() * (noise.gyroscope_noise_rad_s_sqrt_hz / root),
        });
        if step % 3 == 0 {
            let flow = self.flow(t, 3.0 * dt);
            batch.flow.push(flow);
        }
        if step % 5 == 0 {
            let range = self.range(now);
            batch.infrared.push(range);
        }
    }

    /// Mean image motion over the last three steps: its middle lies between two known speeds.
    fn flow(&mut self, end_s: f64, interval_s: f64) -> FlowSample {
        let middle_s = end_s - 0.5 * interval_s;
        let motion = &self.motion;
        let pitch = motion.pitch(middle_s);
        let rate = (motion.pitch(end_s) - motion.pitch(end_s - interval_s)) / interval_s;
        let velocity = Vector3::new(
            0.5 * (self.speeds[1] + self.speeds[2]),
            0.0,
            motion.climb(middle_s),
        );
        let camera_from_body = self.mount.body_from_sensor().rotation.inverse();
        let attitude = so3::from_roll_pitch_yaw(0.0, pitch, 0.0);
        let velocity_camera = camera_from_body * (attitude.inverse() * velocity);
        let rate_camera = camera_from_body * (Vector3::y() * rate);
        let distance_m = motion.height(middle_s) / pitch.cos();
        let sigma = self.config.flow_odometry.flow_sigma_rad_s;
        let flow = Vector2::new(-rate_camera.y, rate_camera.x) - velocity_camera.xy() / distance_m;
        FlowSample {
            time: Timestamp::from_s(middle_s),
            interval_s,
            flow_rad_s: flow + self.draw().xy() * sigma,
            quality: 1.0,
        }
    }

    fn range(&mut self, now: Timestamp) -> RangeSample {
        let t = now.as_s();
        let distance_m = self.motion.height(t) / self.motion.pitch(t).cos();
        RangeSample {
            time: now,
            range_m: distance_m + self.draw().x * self.config.flow_odometry.range_sigma_m,
            min_m: 0.05,
            max_m: 14.0,
        }
    }
}

fn mode(t: f64) -> FlightMode {
    if t < CLIMB_S {
        FlightMode::Armed
    } else if t < TOP_S {
        FlightMode::TakingOff
    } else {
        FlightMode::Flying
    }
}

fn fly(held: Held, pitch_rad: f64, seed: u64) -> Result<Track, RunError> {
    let mut rig = Rig::new(held, pitch_rad, seed);
    let calibration = FlowCalibration {
        flow_camera: rig.mount.clone(),
        infrared: rig.mount.clone(),
    };
    let mut filter: Box<dyn Estimator> = by_name("flow-odometry", &rig.config, Some(&calibration))
        .map_err(|error| RunError::Input {
            what: "flow-odometry".into(),
            finding: error.to_string(),
            remedy: "Report this: the configuration is the study's own".into(),
        })?;
    let mut batch = SensorBatch::default();
    let mut track = Track::new();
    let mut now = Timestamp::ZERO;
    let mut step = 0;
    while now.as_s() < END_S {
        now += STEP;
        step += 1;
        rig.measure(step, now, &mut batch);
        filter.update(&batch, mode(now.as_s()));
        // Ten points a second.
        if step % 25 == 0 && now.as_s() >= TOP_S {
            let state = filter.state();
            let error = state.accelerometer_bias.x - rig.bias[0].x;
            let sigma = state.sigma(error_index::ACCELEROMETER_BIAS).x;
            track.push((now.as_s() - TILT_S, error, sigma));
        }
    }
    Ok(track)
}

/// One case over all seeds.
struct Summary {
    held: Held,
    pitch_deg: f64,
    /// Time since the tilt began, root mean square of the error and of the claim.
    points: Vec<(f64, f64, f64)>,
}

impl Summary {
    fn of(i: usize, tracks: &[&Track]) -> Self {
        let (held, pitch_deg) = case(i);
        let length = tracks.iter().map(|track| track.len()).min().unwrap_or(0);
        let count = tracks.len() as f64;
        let points = (0..length).map(|k| {
            let mean = |pick: fn(&(f64, f64, f64)) -> f64| {
                let squares = tracks.iter().map(|track| pick(&track[k]).powi(2));
                (squares.sum::<f64>() / count).sqrt()
            };
            (tracks[0][k].0, mean(|p| p.1), mean(|p| p.2))
        });
        Self {
            held,
            pitch_deg,
            points: points.collect(),
        }
    }

    /// Error and claim `after_s` the tilt began.
    fn at(&self, after_s: f64) -> (f64, f64) {
        let found = self.points.iter().find(|p| p.0 >= after_s - 1e-6);
        found.map_or((f64::NAN, f64::NAN), |p| (p.1, p.2))
    }

    fn row(&self) -> Row {
        let (error, claim) = self.at(20.0);
        Row::new()
            .with("held", self.held.name())
            .with("pitch_deg", self.pitch_deg)
            .with("error_before_m_s2", self.at(0.0).0)
            .with("error_after_2_s_m_s2", self.at(2.0).0)
            .with("error_after_10_s_m_s2", self.at(10.0).0)
            .with("error_after_20_s_m_s2", error)
            .with("claimed_after_20_s_m_s2", claim)
    }
}

fn results(runs: u64, summaries: &[Summary]) -> Results {
    let last = |held: Held, pitch_deg: f64| -> (f64, f64) {
        let found = summaries
            .iter()
            .find(|s| s.held == held && s.pitch_deg == pitch_deg);
        found.map_or((f64::NAN, f64::NAN), |s| s.at(20.0))
    };
    let share = |held| last(held, 20.0).0 / last(held, 0.0).0;
    let claims: Vec<f64> = summaries
        .iter()
        .map(|s| {
            let (error, claim) = s.at(20.0);
            error / claim
        })
        .collect();
    Results {
        runs,
        columns: columns(),
        rows: summaries.iter().map(Summary::row).collect(),
        demands: vec![
            Demand::at_most(
                "error after 20 s at 20 degrees against wind, over that of hovering",
                "",
                HALF_THE_VARIANCE,
                share(Held::AgainstWind),
            ),
            Demand::at_most(
                "error after 20 s at 20 degrees while speeding up, over that of hovering",
                "",
                1.0,
                share(Held::SpeedingUp),
            ),
            Demand::at_least(
                "share of the uncertainty at the start that is still claimed after hovering",
                "",
                0.9,
                last(Held::AgainstWind, 0.0).1 / START_SIGMA_M_S2,
            ),
            Demand::at_most(
                "error over claim in any case",
                "",
                HONEST,
                claims.iter().copied().fold(0.0, f64::max),
            ),
        ],
        charts: Held::ALL
            .map(|held| chart(held, summaries.iter().filter(|s| s.held == held)))
            .into(),
        notes: vec![
            "Root mean squares over the flights. The vehicle stands, climbs to 2 m, hovers, and holds \
             a pitch angle from 8.5 s on; the filter is the flow odometry with its usual \
             configuration. The source shows curves and states no figures."
                .to_owned(),
            "A vehicle that speeds up feels its thrust, which points along its mast whatever the \
             pitch: gravity has no part along its x axis, and the bias stays tied to the tilt. Held \
             against the drag of a wind, gravity does."
                .to_owned(),
        ],
    }
}

fn columns() -> Vec<Column> {
    vec![
        Column::new("held", "held", 0),
        Column::new("pitch_deg", "pitch (deg)", 0),
        Column::new("error_before_m_s2", "error before (m/s²)", 4),
        Column::new("error_after_2_s_m_s2", "after 2 s", 4),
        Column::new("error_after_10_s_m_s2", "after 10 s", 4),
        Column::new("error_after_20_s_m_s2", "after 20 s", 4),
        Column::new("claimed_after_20_s_m_s2", "claimed", 4),
    ]
}

fn chart<'a>(held: Held, summaries: impl Iterator<Item = &'a Summary>) -> Chart {
    let tones = [
        Tone::Limit,
        Tone::Truth,
        Tone::Third,
        Tone::Second,
        Tone::Measured,
    ];
    let curves = summaries.zip(tones).map(|(summary, tone)| {
        let points = summary.points.iter().map(|p| (p.0, p.1)).collect();
        Curve::line(&format!("{}°", summary.pitch_deg), tone, points)
    });
    Chart::Curves {
        title: format!("error of the accelerometer's bias along x, {}", held.name()),
        x_label: "time since the tilt began (s)".to_owned(),
        y_label: "m/s²".to_owned(),
        curves: curves.collect(),
        bands: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    use super::*;

    #[test]
    fn tilting_against_wind_observes_the_bias_and_hovering_does_not() {
        let request = Request {
            seed: 3,
            runs: 8,
            jobs: NonZeroUsize::MIN,
        };
        let results = execute(&request, &|_| {}).unwrap();
        // Fewer flights than the bound on errors over claims is made for.
        for demand in &results.demands[..3] {
            assert!(demand.met(), "{demand:?}");
        }
    }
}
