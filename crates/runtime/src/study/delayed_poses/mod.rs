//! Two pose sensors that are heard late: fused at their own time, and as if they were current.

mod report;

use alula_estimation::{Estimator, PoseImu, PoseImuConfig, PoseSensorConfig};
use alula_geometry::{Pose, TimeDelta, Timestamp, so3};
use alula_messages::{EstimateHealth, FlightMode, ImuSample, PoseSample, SensorBatch};
use nalgebra::{Translation3, Vector3};
use rand::SeedableRng;
use rand_distr::{Distribution as _, StandardNormal};
use rand_pcg::Pcg64;

use super::velocity::scenario;
use super::{Request, Results, Study, Watch};
use crate::flight::{self, Progress, RecordTo};
use crate::{RunError, Scenario};

/// Document O, table 2.1.
pub const STUDY: Study = Study {
    name: "delayed-poses",
    source: "document O, section 2.4.3, table 2.1 and figures 2.11 to 2.15",
    about: "two 10 Hz pose sensors, 0.1 s late, with a 100 Hz inertial unit of drifting bias",
    runs_are: "flights",
    default_runs: 20,
    execute,
};

/// The source's root mean squares: position x, y, z in m, then roll, pitch, yaw in rad.
const THEIRS: [f64; 6] = [0.0116, 0.0295, 0.0161, 0.0088, 0.0057, 0.0084];

/// Places of the two sensors in the body: position (m), roll, pitch, yaw (rad) (equation 2.64).
const PLACES: [[[f64; 3]; 2]; 2] = [
    [[0.03, -0.07, 0.1], [0.2, -0.1, 0.3]],
    [[-0.05, 0.08, 0.1], [-0.1, 0.2, -0.3]],
];

/// Rates of the inertial unit and the pose sensors, Hz, and the delay of the latter, s.
const IMU_HZ: f64 = 100.0;
const POSE_HZ: f64 = 10.0;
const DELAY_S: f64 = 0.1;

/// White noise of the pose sensors on each axis. The source does not state it; this is twice what its
/// filter leaves, or more, in most parts, so that passing the poses through would not do.
const POSE_NOISE_M: f64 = 0.02;
const POSE_NOISE_RAD: f64 = 0.02;

/// Initial biases (standard deviation on each axis) and their random walks: over the flight they
/// change by as much as they are.
const BIAS_M_S2: f64 = 0.05;
const BIAS_RAD_S: f64 = 0.005;
const WALK_M_S3_SQRT_HZ: f64 = 0.01;
const WALK_RAD_S2_SQRT_HZ: f64 = 0.001;

/// Time after the first pose from which errors count, s: biases are not known before.
const SETTLED_S: f64 = 5.0;

/// How poses are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    /// At the time at which they were measured.
    AtTheirTime,
    /// As if they had been measured when they were heard.
    AsCurrent,
}

/// What was true and measured at one time.
struct Instant {
    time: Timestamp,
    world_from_body: Pose,
    imu: Option<ImuSample>,
    /// True biases of accelerometer and gyroscope.
    bias: [Vector3<f64>; 2],
    poses: Vec<PoseSample>,
}

/// Errors of one filter over one flight.
#[derive(Clone, Debug, Default)]
struct Errors {
    /// Time, error (position m, roll pitch yaw rad) as in [`THEIRS`].
    pose: Vec<(f64, [f64; 6])>,
    /// Time, estimated and true bias along x of accelerometer and gyroscope.
    bias: Vec<(f64, [[f64; 2]; 2])>,
    /// Sums of squared errors of the biases of either kind, and of the biases themselves.
    bias_squares: [f64; 2],
    bias_sizes: [f64; 2],
    /// Bias components within three claimed standard deviations, and all.
    within: [u64; 2],
}

fn execute(request: &Request, watch: &Watch) -> Result<Results, RunError> {
    let scenario = scenario(&[
        "simulation.state=truth".to_owned(),
        "simulation.link.control_rate_hz=200".to_owned(),
        format!("simulation.sensors.imu.rate_hz={IMU_HZ:?}"),
        "simulation.sensors.imu.accelerometer_bias_m_s2=[0.0, 0.0, 0.0]".to_owned(),
        "simulation.sensors.imu.gyroscope_bias_rad_s=[0.0, 0.0, 0.0]".to_owned(),
        "simulation.sensors.imu.accelerometer_bias_walk_m_s3_sqrt_hz=0.0".to_owned(),
        "simulation.sensors.imu.gyroscope_bias_walk_rad_s2_sqrt_hz=0.0".to_owned(),
        // The source's inertial unit has no errors of scale (equations 2.47, 2.48).
        "simulation.sensors.imu.accelerometer_scale=[1.0, 1.0, 1.0]".to_owned(),
        "simulation.sensors.imu.gyroscope_scale=[1.0, 1.0, 1.0]".to_owned(),
    ])?;
    let flights = request.do_all(&request.seeds(), watch, &|seed| {
        let tape = fly(&scenario, seed)?;
        Ok([
            follow(&tape, Use::AtTheirTime)?,
            follow(&tape, Use::AsCurrent)?,
        ])
    })?;
    Ok(report::results(&flights))
}

/// Flies the scenario on the true state and measures what happens.
fn fly(scenario: &Scenario, seed: u64) -> Result<Vec<Instant>, RunError> {
    let mut rig = Rig::new(seed);
    let mut tape = Vec::new();
    let mut note = |progress: &Progress| tape.push(rig.measure(progress));
    flight::fly(scenario, seed, &RecordTo::Nothing, &mut note)?;
    Ok(tape)
}

/// Pose sensors and biases.
struct Rig {
    random: Pcg64,
    bias: [Vector3<f64>; 2],
    next_pose: [Timestamp; 2],
}

impl Rig {
    fn new(seed: u64) -> Self {
        // A stream of its own: the simulator's noise has the same seed.
        let mut random = Pcg64::seed_from_u64(seed ^ 0x706f_7365_7300);
        let mut draw = || Vector3::from_fn(|_, _| StandardNormal.sample(&mut random));
        Self {
            bias: [draw() * BIAS_M_S2, draw() * BIAS_RAD_S],
            random,
            // The second sensor measures half a period after the first.
            next_pose: [
                Timestamp::from_s(1.0 / POSE_HZ),
                Timestamp::from_s(1.5 / POSE_HZ),
            ],
        }
    }

    fn draw(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| StandardNormal.sample(&mut self.random))
    }

    fn measure(&mut self, progress: &Progress) -> Instant {
        let time = progress.batch.now;
        let imu = progress.batch.imu.last().map(|sample| self.spoil(sample));
        let poses = (0..2)
            .filter_map(|i| self.pose(i, time, &progress.world_from_body))
            .collect();
        Instant {
            time,
            world_from_body: progress.world_from_body,
            imu,
            bias: self.bias,
            poses,
        }
    }

    /// Adds the biases, which walk.
    fn spoil(&mut self, sample: &ImuSample) -> ImuSample {
        let root = (1.0 / IMU_HZ).sqrt();
        let walked = [self.draw(), self.draw()];
        self.bias[0] += walked[0] * (WALK_M_S3_SQRT_HZ * root);
        self.bias[1] += walked[1] * (WALK_RAD_S2_SQRT_HZ * root);
        ImuSample {
            time: sample.time,
            specific_force: sample.specific_force + self.bias[0],
            angular_rate: sample.angular_rate + self.bias[1],
        }
    }

    /// A pose of sensor `i` if it is due (equations 2.50, 2.51).
    fn pose(&mut self, i: usize, time: Timestamp, world_from_body: &Pose) -> Option<PoseSample> {
        if time < self.next_pose[i] {
            return None;
        }
        self.next_pose[i] += TimeDelta::from_hz(POSE_HZ);
        let [position, [roll, pitch, yaw]] = PLACES[i];
        let body_from_sensor = Pose::from_parts(
            Translation3::from(Vector3::from(position)),
            so3::from_roll_pitch_yaw(roll, pitch, yaw),
        );
        let mut pose = world_from_body * body_from_sensor;
        pose.translation.vector += self.draw() * POSE_NOISE_M;
        pose.rotation *= so3::exp(&(self.draw() * POSE_NOISE_RAD));
        Some(PoseSample {
            time,
            sensor: i as u8,
            world_from_body: pose,
        })
    }
}

/// What the filter is told: the true noise, except that it need not be told about delays.
fn config() -> PoseImuConfig {
    let sensor = |[position_m, roll_pitch_yaw]: [[f64; 3]; 2]| PoseSensorConfig {
        position_m,
        roll_pitch_yaw_deg: roll_pitch_yaw.map(f64::to_degrees),
        position_sigma_m: POSE_NOISE_M,
        orientation_sigma_rad: POSE_NOISE_RAD,
    };
    let mut config = PoseImuConfig {
        sensors: PLACES.map(sensor).to_vec(),
        ..PoseImuConfig::default()
    };
    config.imu_noise.accelerometer_noise_m_s2_sqrt_hz = 0.02;
    config.imu_noise.gyroscope_noise_rad_s_sqrt_hz = 2.5e-4;
    config.imu_noise.accelerometer_bias_walk_m_s3_sqrt_hz = WALK_M_S3_SQRT_HZ;
    config.imu_noise.gyroscope_bias_walk_rad_s2_sqrt_hz = WALK_RAD_S2_SQRT_HZ;
    config
}

/// Runs the filter over a tape; poses are heard late, whatever it takes them for.
fn follow(tape: &[Instant], how: Use) -> Result<Errors, RunError> {
    let mut filter = PoseImu::new(&config())?;
    let mut waiting = Vec::new();
    let mut batch = SensorBatch::default();
    let mut errors = Errors::default();
    let mut started: Option<Timestamp> = None;
    for instant in tape {
        batch.clear();
        batch.now = instant.time;
        batch.imu.extend(instant.imu);
        waiting.extend_from_slice(&instant.poses);
        let heard = waiting.partition_point(|pose: &PoseSample| {
            instant.time.seconds_since(pose.time) >= DELAY_S - 1e-9
        });
        for mut pose in waiting.drain(..heard) {
            if how == Use::AsCurrent {
                pose.time = instant.time;
            }
            batch.poses.push(pose);
        }
        filter.update(&batch, FlightMode::Flying);
        let usable = filter.state().health != EstimateHealth::Initialising;
        if usable && instant.imu.is_some() {
            let since = *started.get_or_insert(instant.time);
            if instant.time.seconds_since(since) >= SETTLED_S {
                errors.add(&filter, instant);
            }
        }
    }
    Ok(errors)
}

impl Errors {
    fn add(&mut self, filter: &PoseImu, instant: &Instant) {
        use alula_messages::error_index::{ACCELEROMETER_BIAS, GYROSCOPE_BIAS};
        let state = filter.state();
        let t_s = instant.time.as_s();
        let place = state.position_world() - instant.world_from_body.translation.vector;
        let (roll, pitch, yaw) = so3::to_roll_pitch_yaw(&state.world_from_body.rotation);
        let truth = so3::to_roll_pitch_yaw(&instant.world_from_body.rotation);
        let turn = [roll - truth.0, pitch - truth.1, yaw - truth.2].map(so3::wrap_angle);
        let [x, y, z] = place.into();
        self.pose.push((t_s, [x, y, z, turn[0], turn[1], turn[2]]));

        let estimates = [state.accelerometer_bias, state.gyroscope_bias];
        let along_x = [0, 1].map(|kind| [estimates[kind].x, instant.bias[kind].x]);
        self.bias.push((t_s, along_x));
        let rows = [ACCELEROMETER_BIAS, GYROSCOPE_BIAS];
        for kind in 0..2 {
            let error = estimates[kind] - instant.bias[kind];
            let sigma = state.sigma(rows[kind]);
            self.bias_squares[kind] += error.norm_squared() / 3.0;
            self.bias_sizes[kind] += instant.bias[kind].norm_squared() / 3.0;
            let within = (0..3)
                .filter(|i| error[*i].abs() <= 3.0 * sigma[*i])
                .count();
            self.within[0] += within as u64;
            self.within[1] += 3;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    use super::*;

    fn study(jobs: usize) -> Results {
        let request = Request {
            seed: 3,
            runs: 2,
            jobs: NonZeroUsize::new(jobs).unwrap(),
        };
        execute(&request, &|_| {}).unwrap()
    }

    #[test]
    fn two_flights_meet_all_demands() {
        let results = study(1);
        for demand in &results.demands {
            assert!(demand.met(), "{demand:?}");
        }
    }

    #[test]
    fn the_figures_do_not_depend_on_the_threads() {
        assert_eq!(study(1).rows, study(2).rows);
    }
}
