//! Filters of the flow odometry over simulated flights, as in document S, section 2.10.1: smooth
//! true motion, and synchronous samples of all sensors at 100 Hz.

mod course;

pub use course::{Shape, Truth};

use alula_estimation::SensorSet;
use alula_estimation::eskf::{ErrorVector, Filter, ImuNoise, InertialInput, Nominal, Variant};
use alula_estimation::measurement::{
    FlowMeasurement, Gates, Measurement, PlanarVelocityMeasurement, RangeMeasurement,
    SonarMeasurement,
};
use alula_geometry::{Pose, TimeDelta, Timestamp, gravity_world, so3};
use alula_messages::{ErrorCovariance, Looking, Mount, Sensor};
use course::Course;
use nalgebra::{Vector2, Vector3};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// Time between samples, s.
pub const STEP_S: f64 = 0.01;

/// Standard deviations of a sample (document S, tables 2.3 and 2.4). 10 pixels per second of flow
/// are 0.015 rad/s at the 667 pixels of the PX4Flow's focal length.
const FORCE_SIGMA_M_S2: f64 = 0.4;
const RATE_SIGMA_RAD_S: f64 = 0.005;
const FLOW_SIGMA_RAD_S: f64 = 0.015;
const RANGE_SIGMA_M: f64 = 0.02;
const VELOCITY_SIGMA_M_S: f64 = 0.1;
const SONAR_SIGMA_M: f64 = 0.05;

/// Standard deviations at the start: height, tilt and biases of document S, table 2.4, without bias
/// of the gyroscope about the vertical. What the source has as null is small here, so that the
/// covariance has an inverse.
const START_SIGMA: [[f64; 3]; 5] = [
    [0.01, 0.01, 0.05],
    [0.01, 0.01, 0.01],
    [0.05, 0.05, 0.01],
    [0.02, 0.02, 0.02],
    [0.004, 0.004, 1e-7],
];

/// Share of good measurements that pass the gate. The source's 0.95 refuses one in twenty.
const GATE_PROBABILITY: f64 = 0.999;

/// What is flown.
#[derive(Clone, Copy, Debug)]
pub struct Flight {
    /// Where.
    pub shape: Shape,
    /// How far, m.
    pub length_m: f64,
    /// How long, s.
    pub duration_s: f64,
    /// What corrects the inertial data.
    pub sensors: SensorSet,
}

/// Flies once, with everything random drawn from `seed`, and runs all `variants` on the same
/// samples; `look` sees time, truth and filters after each step.
pub fn fly(
    flight: &Flight,
    seed: u64,
    variants: &[Variant],
    mut look: impl FnMut(f64, &Nominal, &[Filter]),
) {
    let mut samples = Samples::new(flight, seed);
    let start = samples.first_estimate();
    let mut filters: Vec<Filter> = variants.iter().map(|v| start.in_variant(*v)).collect();
    let noise = imu_noise();
    let gates = Gates::new(GATE_PROBABILITY);
    let steps = (flight.duration_s / STEP_S).round() as usize;
    for step in 1..=steps {
        let taken = samples.take(step as f64 * STEP_S);
        for filter in &mut filters {
            filter.propagate(&taken.input, STEP_S, &noise);
            for measurement in &taken.measurements {
                measurement.fuse(taken.time, filter, &gates);
            }
        }
        look(step as f64 * STEP_S, &samples.truth, &filters);
    }
}

/// The noise as the filters know it: that of the samples, as a density.
fn imu_noise() -> ImuNoise {
    ImuNoise {
        accelerometer_noise_m_s2_sqrt_hz: FORCE_SIGMA_M_S2 * STEP_S.sqrt(),
        gyroscope_noise_rad_s_sqrt_hz: RATE_SIGMA_RAD_S * STEP_S.sqrt(),
        accelerometer_bias_walk_m_s3_sqrt_hz: 0.0,
        gyroscope_bias_walk_rad_s2_sqrt_hz: 0.0,
    }
}

/// What the sensors say at one time.
struct Taken {
    time: Timestamp,
    input: InertialInput,
    measurements: [Measurement; 2],
}

/// The sensors on a flight.
struct Samples {
    course: Course,
    sensors: SensorSet,
    random: Pcg64,
    body_from_camera: Pose,
    body_from_ranger: Pose,
    /// The true state at the last step.
    truth: Nominal,
    last_rate: Vector3<f64>,
}

impl Samples {
    fn new(flight: &Flight, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let course = Course::new(
            flight.shape,
            flight.length_m,
            flight.duration_s,
            &mut random,
        );
        let bias = |random: &mut Pcg64, sigma: [f64; 3]| {
            normal(random).component_mul(&Vector3::from(sigma))
        };
        let first = course.truth(0.0);
        let truth = Nominal {
            accelerometer_bias: bias(&mut random, START_SIGMA[3]),
            gyroscope_bias: bias(&mut random, START_SIGMA[4]),
            ..nominal(&first, &Nominal::default())
        };
        let mut samples = Self {
            course,
            sensors: flight.sensors,
            body_from_camera: Mount::at([0.05, 0.0, -0.04], Looking::Down).body_from_sensor(),
            body_from_ranger: Mount::at([-0.03, 0.02, -0.04], Looking::Down).body_from_sensor(),
            truth,
            last_rate: Vector3::zeros(),
            random,
        };
        samples.last_rate = samples.read_rate(&first);
        samples
    }

    /// An estimate whose error is drawn from its covariance; it takes the biases to be zero.
    fn first_estimate(&mut self) -> Filter {
        let sigma = ErrorVector::from_fn(|i, _| START_SIGMA[i / 3][i % 3]);
        let mut error = ErrorVector::zeros();
        for part in 0..3 {
            error
                .fixed_rows_mut::<3>(3 * part)
                .copy_from(&normal(&mut self.random));
        }
        error.component_mul_assign(&sigma);
        let estimate = Nominal {
            accelerometer_bias: Vector3::zeros(),
            gyroscope_bias: Vector3::zeros(),
            ..self.truth.plus(&error)
        };
        let covariance = ErrorCovariance::from_diagonal(&sigma.component_mul(&sigma));
        Filter::with_covariance(estimate, &covariance, Variant::default())
    }

    fn take(&mut self, t: f64) -> Taken {
        let truth = self.course.truth(t);
        self.truth = nominal(&truth, &self.truth);
        let rate = self.read_rate(&truth);
        let force = truth.world_from_body.inverse() * (truth.acceleration_world - gravity_world())
            + self.truth.accelerometer_bias
            + normal(&mut self.random) * FORCE_SIGMA_M_S2;
        let input = InertialInput {
            previous_angular_rate: self.last_rate,
            interval_s: STEP_S,
            ..InertialInput::steady(force, rate)
        };
        self.last_rate = rate;
        Taken {
            time: Timestamp::ZERO + TimeDelta::from_s(t),
            input,
            measurements: match self.sensors {
                SensorSet::FlowAndInfrared => [self.flow(&truth, rate), self.infrared()],
                SensorSet::VelocityAndSonar => [self.velocity(&truth, rate), self.sonar()],
            },
        }
    }

    fn read_rate(&mut self, truth: &Truth) -> Vector3<f64> {
        truth.angular_rate + self.truth.gyroscope_bias + normal(&mut self.random) * RATE_SIGMA_RAD_S
    }

    /// True velocity and rate of the camera, optical frame.
    fn camera_twist(&self, truth: &Truth) -> (Vector3<f64>, Vector3<f64>) {
        let camera_from_body = self.body_from_camera.rotation.inverse();
        let velocity_body = truth.world_from_body.inverse() * truth.velocity_world
            + truth
                .angular_rate
                .cross(&self.body_from_camera.translation.vector);
        (
            camera_from_body * velocity_body,
            camera_from_body * truth.angular_rate,
        )
    }

    /// Distance to the ground along the z axis of a sensor.
    fn distance_m(&self, body_from_sensor: &Pose) -> f64 {
        let q = &self.truth.world_from_body;
        let height = self.truth.position_world.z + (q * body_from_sensor.translation.vector).z;
        -height / (q * (body_from_sensor.rotation * Vector3::z())).z
    }

    /// The flow of a point at rest on the optical axis: it moves by -v - w x (0, 0, d).
    fn flow(&mut self, truth: &Truth, angular_rate: Vector3<f64>) -> Measurement {
        let (velocity, rate) = self.camera_twist(truth);
        let distance = self.distance_m(&self.body_from_camera);
        let point = -velocity - rate.cross(&(Vector3::z() * distance));
        Measurement::Flow(FlowMeasurement {
            flow_rad_s: point.xy() / distance + self.plane_noise(FLOW_SIGMA_RAD_S),
            angular_rate,
            interval_s: STEP_S,
            body_from_camera: self.body_from_camera,
            // The turning part is predicted from the gyroscope, noise and all.
            sigma_rad_s: FLOW_SIGMA_RAD_S.hypot(RATE_SIGMA_RAD_S),
            min_distance_m: 0.3,
        })
    }

    fn infrared(&mut self) -> Measurement {
        Measurement::Range(RangeMeasurement {
            sensor: Sensor::Infrared,
            range_m: self.distance_m(&self.body_from_ranger)
                + normal(&mut self.random).x * RANGE_SIGMA_M,
            body_from_ranger: self.body_from_ranger,
            sigma_m: RANGE_SIGMA_M,
        })
    }

    /// A velocity out of which the camera has taken the turning itself.
    fn velocity(&mut self, truth: &Truth, angular_rate: Vector3<f64>) -> Measurement {
        let (velocity, _) = self.camera_twist(truth);
        Measurement::PlanarVelocity(PlanarVelocityMeasurement {
            apparent_velocity: velocity.xy() + self.plane_noise(VELOCITY_SIGMA_M_S),
            turning_distance_m: 0.0,
            angular_rate,
            interval_s: STEP_S,
            body_from_camera: self.body_from_camera,
            sigma_m_s: VELOCITY_SIGMA_M_S,
        })
    }

    fn sonar(&mut self) -> Measurement {
        let lever = self.truth.world_from_body * self.body_from_ranger.translation.vector;
        Measurement::Sonar(SonarMeasurement {
            range_m: self.truth.position_world.z
                + lever.z
                + normal(&mut self.random).x * SONAR_SIGMA_M,
            body_from_sonar: self.body_from_ranger,
            sigma_m: SONAR_SIGMA_M,
        })
    }

    fn plane_noise(&mut self, sigma: f64) -> Vector2<f64> {
        normal(&mut self.random).xy() * sigma
    }
}

/// The motion, with the biases of `before`.
fn nominal(motion: &Truth, before: &Nominal) -> Nominal {
    Nominal {
        position_world: motion.position_world,
        velocity_world: motion.velocity_world,
        world_from_body: motion.world_from_body,
        ..*before
    }
}

fn normal(random: &mut Pcg64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(random))
}

/// The rotation error index of document S, equation 2.90: tr(I - R^T R_estimated) / 2, which is
/// 1 - cos of the angle between the two.
pub fn orientation_index(estimate: &Nominal, truth: &Nominal) -> f64 {
    let turn = so3::log(&(truth.world_from_body.inverse() * estimate.world_from_body));
    2.0 * (0.5 * turn.norm()).sin().powi(2)
}
