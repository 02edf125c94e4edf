//! A EuRoC folder as input of an estimator: the real inertial data, and what the recording lacks made
//! from its truth.

use alula_estimation::{EstimatorConfig, FlowCalibration};
use alula_geometry::{Pose, TimeDelta, Timestamp, so3};
use alula_messages::{
    FlightMode, FlowSample, ImuSample, Looking, Mount, PoseSample, RangeSample, SensorBatch,
};
use alula_record::euroc::{Folder, ImuFacts, TruthSample};
use alula_stack::EstimationConfig;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::{Feed, Job, PoseFeed, TrueMotion};
use crate::RunError;
use crate::config::{ConfigText, resolved_text};

/// The estimator when none is named: a EuRoC folder without images offers poses.
const DEFAULT_ESTIMATOR: &str = "pose-imu";

/// Distance of the imagined floor below the lowest true place, m: far enough for a flow camera.
const FLOOR_BELOW_LOWEST_M: f64 = 0.5;

/// Noise of the flow made from truth, rad/s: that of the simulator's flow camera averaged over the
/// longer interval between true poses.
const FLOW_SIGMA_RAD_S: f64 = 0.01;

/// Noise of the range made from truth, m (document S, table 2.4).
const RANGE_SIGMA_M: f64 = 0.02;

/// Reach of the ranger made from truth, m.
const RANGE_LIMITS_M: [f64; 2] = [0.05, 14.0];

/// Noise and reach of the sonar made from truth, m (document S, table 2.3 and section 2.10.2).
const SONAR_SIGMA_M: f64 = 0.05;
const SONAR_LIMITS_M: [f64; 2] = [0.3, 5.0];

/// True speed from which the vehicle counts as moving, m/s.
const MOVING_M_S: f64 = 0.03;

/// Duration at the start during which the vehicle is taken to stand still, s.
const STILL_S: f64 = 0.5;

/// Reads a EuRoC folder for the estimator of the job.
pub(super) fn read(job: &Job) -> Result<Feed, RunError> {
    let folder = Folder::open(&job.log)?;
    let imu = folder.imu()?;
    let facts = folder.imu_facts()?;
    let mut warnings: Vec<String> = imu.warnings.iter().map(ToString::to_string).collect();
    let truth = match &job.truth {
        Some(path) => truth_of(&super::read_truth(path)?),
        None => {
            let truth = folder.truth()?;
            warnings.extend(truth.warnings.iter().map(ToString::to_string));
            truth.samples
        }
    };
    let name = job
        .estimator
        .clone()
        .unwrap_or_else(|| DEFAULT_ESTIMATOR.to_owned());
    let mut feed = if name == "pose-imu" {
        pose_feed(job, &imu.samples, &truth)
    } else {
        flow_feed(job, &imu.samples, &truth)
    };
    feed.notes.splice(0..0, warnings);
    feed.estimation.estimator = name;
    set_noise(&mut feed.estimation.parameters, &facts);
    feed.estimation = ConfigText {
        file: "the configuration for this log".into(),
        text: resolved_text(&feed.estimation)?,
    }
    .with_overrides(&job.overrides)?
    .read()?;
    Ok(feed)
}

/// A trajectory of the IMU from elsewhere as the truth, with its velocity by central differences.
fn truth_of(motion: &[TrueMotion]) -> Vec<TruthSample> {
    let place = |i: usize| motion[i].world_from_body.translation.vector;
    (0..motion.len())
        .map(|i| {
            let (before, after) = (i.saturating_sub(1), (i + 1).min(motion.len() - 1));
            let dt_s = motion[after].time.seconds_since(motion[before].time);
            let velocity = if dt_s > 0.0 {
                (place(after) - place(before)) / dt_s
            } else {
                Vector3::zeros()
            };
            TruthSample {
                time: motion[i].time,
                world_from_imu: motion[i].world_from_body,
                velocity_world: velocity,
                gyroscope_bias: Vector3::zeros(),
                accelerometer_bias: Vector3::zeros(),
            }
        })
        .collect()
}

/// The noise that the log states for its inertial unit.
fn set_noise(parameters: &mut EstimatorConfig, facts: &ImuFacts) {
    let noise = &mut parameters.pose_imu.imu_noise;
    noise.accelerometer_noise_m_s2_sqrt_hz = VIBRATION * facts.accelerometer_noise_m_s2_sqrt_hz;
    noise.gyroscope_noise_rad_s_sqrt_hz = VIBRATION * facts.gyroscope_noise_rad_s_sqrt_hz;
    noise.accelerometer_bias_walk_m_s3_sqrt_hz = facts.accelerometer_random_walk_m_s3_sqrt_hz;
    noise.gyroscope_bias_walk_rad_s2_sqrt_hz = facts.gyroscope_random_walk_rad_s2_sqrt_hz;
    parameters.flow_odometry.imu_noise = noise.clone();
    parameters.cascade.imu_noise = noise.clone();
}

/// Factor from the noise of a data sheet, measured at rest, to that in flight.
const VIBRATION: f64 = 10.0;

/// Inertial data and external poses; the body frame is that of the IMU.
fn pose_feed(job: &Job, imu: &[ImuSample], truth: &[TruthSample]) -> Feed {
    let mut steps = batches(imu);
    let poses: Vec<PoseSample> = truth
        .iter()
        .map(|t| PoseSample {
            time: t.time,
            sensor: 0,
            world_from_body: t.world_from_imu,
        })
        .collect();
    let arriving = arriving_poses(&poses, &job.poses, job.seed);
    let count = arriving.len();
    deliver_poses(
        steps.iter_mut().map(|(batch, _)| batch).collect(),
        &arriving,
    );
    Feed {
        steps,
        truth: truth
            .iter()
            .map(|t| true_motion(t, &UnitQuaternion::identity()))
            .collect(),
        estimation: EstimationConfig::default(),
        notes: vec![format!(
            "{count} external poses were taken from the truth: {} Hz, {} s late",
            job.poses
                .rate_hz
                .map_or("all".to_owned(), |rate| rate.to_string()),
            job.poses.delay_s
        )],
    }
}

/// Inertial data with flow and range made from truth; the body frame is forward-left-up.
fn flow_feed(job: &Job, imu: &[ImuSample], truth: &[TruthSample]) -> Feed {
    let imu_from_body = levelled(imu);
    let body_samples: Vec<ImuSample> = imu
        .iter()
        .map(|sample| ImuSample {
            time: sample.time,
            specific_force: imu_from_body.inverse() * sample.specific_force,
            angular_rate: imu_from_body.inverse() * sample.angular_rate,
        })
        .collect();
    let truth: Vec<TrueMotion> = truth
        .iter()
        .map(|t| true_motion(t, &imu_from_body))
        .collect();
    let calibration = FlowCalibration {
        flow_camera: Mount::at([0.0; 3], Looking::Down),
        infrared: Mount::at([0.0; 3], Looking::Down),
    };
    let mut estimation = EstimationConfig {
        calibration: Some(calibration.clone()),
        ..EstimationConfig::default()
    };
    let heights = || truth.iter().map(|t| t.world_from_body.translation.z);
    let floor_m = heights().fold(f64::INFINITY, f64::min) - FLOOR_BELOW_LOWEST_M;
    let start_m = heights().next().unwrap_or(floor_m);
    let parameters = &mut estimation.parameters;
    for alignment in [
        &mut parameters.flow_odometry.alignment,
        &mut parameters.cascade.alignment,
    ] {
        alignment.start_position_m = [0.0, 0.0, start_m - floor_m];
        alignment.duration_s = STILL_S;
    }
    let mut steps = batches(&body_samples);
    let mut imagined = Imagined::new(&calibration, floor_m, job.seed);
    imagined.deliver(&truth, &mut steps);
    set_modes(&truth, &mut steps);
    Feed {
        steps,
        truth,
        estimation,
        notes: vec![
            "flow and range were made from the truth, over an imagined flat floor; only the \
             inertial data are real"
                .into(),
            "when the vehicle stands and when it flies was taken from the truth".into(),
        ],
    }
}

fn true_motion(sample: &TruthSample, imu_from_body: &UnitQuaternion<f64>) -> TrueMotion {
    let rotation = sample.world_from_imu.rotation * imu_from_body;
    TrueMotion {
        time: sample.time,
        world_from_body: Pose::from_parts(sample.world_from_imu.translation, rotation),
        velocity_world: Some(sample.velocity_world),
    }
}

/// One batch for each inertial sample.
fn batches(imu: &[ImuSample]) -> Vec<(SensorBatch, FlightMode)> {
    imu.iter()
        .map(|sample| {
            let batch = SensorBatch {
                now: sample.time,
                imu: vec![*sample],
                ..SensorBatch::default()
            };
            (batch, FlightMode::Disarmed)
        })
        .collect()
}

/// Orientation of a level body in the frame of a resting IMU: up is against gravity, forward is the
/// optical axis of the sensor rig, which is the IMU's z axis.
fn levelled(imu: &[ImuSample]) -> UnitQuaternion<f64> {
    let Some(first) = imu.first() else {
        return UnitQuaternion::identity();
    };
    let still = imu
        .iter()
        .take_while(|s| s.time.seconds_since(first.time) < STILL_S);
    let up = still
        .map(|s| s.specific_force)
        .sum::<Vector3<f64>>()
        .normalize();
    let forward = (Vector3::z() - up * up.z).normalize();
    let axes = Matrix3::from_columns(&[forward, up.cross(&forward), up]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

/// The poses that arrive, with the time at which they do.
pub(super) fn arriving_poses(
    poses: &[PoseSample],
    feed: &PoseFeed,
    seed: u64,
) -> Vec<(Timestamp, PoseSample)> {
    let Some(start) = poses.first().map(|p| p.time) else {
        return Vec::new();
    };
    let mut random = Pcg64::seed_from_u64(seed);
    let mut next_s = 0.0;
    let mut arriving = Vec::new();
    for pose in poses {
        let t_s = pose.time.seconds_since(start);
        if let Some(rate_hz) = feed.rate_hz {
            // Half a millisecond of slack: logged periods are not exact.
            if t_s < next_s - 5e-4 {
                continue;
            }
            next_s += 1.0 / rate_hz;
        }
        let lost = random.random::<f64>() < feed.loss_share;
        let out = feed
            .outages_s
            .iter()
            .any(|[from, long]| t_s >= *from && t_s < from + long);
        if !lost && !out {
            arriving.push((pose.time + TimeDelta::from_s(feed.delay_s), *pose));
        }
    }
    arriving
}

/// Puts each pose into the first batch that is not before its arrival.
pub(super) fn deliver_poses(batches: Vec<&mut SensorBatch>, arriving: &[(Timestamp, PoseSample)]) {
    let mut waiting = arriving.iter().peekable();
    for batch in batches {
        while let Some((_, pose)) = waiting.next_if(|(arrival, _)| *arrival <= batch.now) {
            batch.poses.push(*pose);
        }
    }
}

/// Sets the flight mode: the vehicle stands before it first moves and after it last did.
fn set_modes(truth: &[TrueMotion], steps: &mut [(SensorBatch, FlightMode)]) {
    let moves = |t: &&TrueMotion| t.velocity_world.is_some_and(|v| v.norm() > MOVING_M_S);
    let first = truth.iter().find(moves).map(|t| t.time);
    let last = truth.iter().rfind(moves).map(|t| t.time);
    for (batch, mode) in steps {
        let flies = first.is_some_and(|t| t <= batch.now) && last.is_some_and(|t| batch.now <= t);
        *mode = if flies {
            FlightMode::Flying
        } else {
            FlightMode::Disarmed
        };
    }
}

/// Downward sensors that were not on board.
struct Imagined {
    body_from_camera: Pose,
    floor_m: f64,
    random: Pcg64,
    /// The sonar draws its own noise, so that the others do not depend on it.
    sonar_random: Pcg64,
}

impl Imagined {
    fn new(calibration: &FlowCalibration, floor_m: f64, seed: u64) -> Self {
        Self {
            body_from_camera: calibration.flow_camera.body_from_sensor(),
            floor_m,
            random: Pcg64::seed_from_u64(seed),
            sonar_random: Pcg64::seed_from_u64(!seed),
        }
    }

    /// Puts the readings between each two true poses into the batch in which they arrive.
    fn deliver(&mut self, truth: &[TrueMotion], steps: &mut [(SensorBatch, FlightMode)]) {
        let mut waiting = truth.windows(2).peekable();
        for (batch, _) in steps {
            while let Some(pair) = waiting.next_if(|pair| pair[1].time <= batch.now) {
                batch.flow.extend(self.flow(&pair[0], &pair[1]));
                batch.infrared.push(self.range(&pair[1]));
                batch.sonar.push(self.sonar(&pair[1]));
            }
        }
    }

    /// Mean image motion between two true poses (document S, equation 2.21, with f = 1).
    fn flow(&mut self, before: &TrueMotion, after: &TrueMotion) -> Option<FlowSample> {
        let interval_s = after.time.seconds_since(before.time);
        let (q0, q1) = (
            before.world_from_body.rotation,
            after.world_from_body.rotation,
        );
        let turned = so3::log(&(q0.inverse() * q1));
        let middle = q0 * so3::exp(&(turned * 0.5));
        let (p0, p1) = (
            before.world_from_body.translation.vector,
            after.world_from_body.translation.vector,
        );
        let (v0, v1) = (before.velocity_world?, after.velocity_world?);
        // Cubic between the poses: the mean of the ends lacks an eighth of the change of velocity.
        let position = 0.5 * (p0 + p1) + (v0 - v1) * (interval_s / 8.0);
        let pose = Pose::from_parts(Translation3::from(position), middle);
        let camera = pose * self.body_from_camera;
        let distance = self.distance_m(&camera)?;
        let velocity = camera.rotation.inverse() * ((p1 - p0) / interval_s);
        let rate = self.body_from_camera.rotation.inverse() * (turned / interval_s);
        let flow = Vector2::new(
            -velocity.x / distance + -rate.y,
            -velocity.y / distance + rate.x,
        );
        Some(FlowSample {
            time: before.time + TimeDelta::from_s(0.5 * interval_s),
            interval_s,
            flow_rad_s: flow + Vector2::from_fn(|_, _| FLOW_SIGMA_RAD_S * self.normal()),
            quality: 1.0,
        })
    }

    fn range(&mut self, truth: &TrueMotion) -> RangeSample {
        let [min_m, max_m] = RANGE_LIMITS_M;
        let beam = truth.world_from_body * self.body_from_camera;
        let range_m = self.distance_m(&beam).unwrap_or(f64::INFINITY);
        RangeSample {
            time: truth.time,
            range_m: range_m + RANGE_SIGMA_M * self.normal(),
            min_m,
            max_m,
        }
    }

    /// Height of the flow camera, whose sonar it is.
    fn sonar(&mut self, truth: &TrueMotion) -> RangeSample {
        let [min_m, max_m] = SONAR_LIMITS_M;
        let sonar = truth.world_from_body * self.body_from_camera;
        let drawn: f64 = StandardNormal.sample(&mut self.sonar_random);
        RangeSample {
            time: truth.time,
            range_m: sonar.translation.z - self.floor_m + SONAR_SIGMA_M * drawn,
            min_m,
            max_m,
        }
    }

    /// Distance to the floor along the z axis of a sensor; `None` if it does not look down.
    fn distance_m(&self, world_from_sensor: &Pose) -> Option<f64> {
        let down = -(world_from_sensor.rotation * Vector3::z()).z;
        (down > 0.1).then(|| (world_from_sensor.translation.z - self.floor_m) / down)
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.random)
    }
}
