//! A synthetic flight: known motion, and the samples that sensors would take of it.

// Each test program uses its part of this.
#![allow(dead_code)]

use alula_estimation::{FlowCalibration, FlowOdometryConfig};
use alula_geometry::{Pose, Timestamp, gravity_world, so3};
use alula_messages::{FlightMode, FlowSample, ImuSample, Looking, Mount, RangeSample, SensorBatch};
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

pub const STAND_HEIGHT_M: f64 = 0.1;
pub const TAKE_OFF_S: f64 = 3.0;
pub const UP_S: f64 = 6.0;
const DOWN_TAKES_S: f64 = 4.0;
const STEP_NS: i64 = 4_000_000;

/// True motion at one time.
#[derive(Clone, Copy)]
pub struct Truth {
    pub position_world: Vector3<f64>,
    pub velocity_world: Vector3<f64>,
    pub world_from_body: UnitQuaternion<f64>,
}

/// What is flown between take-off and landing.
#[derive(Clone, Copy, PartialEq)]
pub enum Path {
    /// Curves.
    Curves,
    /// Forward, left, backward, right, forward-left, backward-right (document O, section 2.5.3):
    /// each leg 2 m in 3 s from rest to rest, then 1 s of hovering.
    Legs,
}

/// Time at which all of [`Path::Legs`] are flown and the vehicle is down again, s.
pub const LEGS_LAND_S: f64 = UP_S + 1.0 + 6.0 * 4.0 + DOWN_TAKES_S;

/// Take-off at 3 s, at height at 6 s, the path, landing within 4 s before `land_s`.
pub struct Flight {
    pub land_s: f64,
    pub path: Path,
    pub noise: bool,
    /// Scale of each axis of the accelerometer and of the gyroscope (document O, 2.11, 2.12).
    pub scale: [Vector3<f64>; 2],
    /// Random walks of the two biases, m/s^3/sqrt(Hz) and rad/s^2/sqrt(Hz).
    pub walk: [f64; 2],
    /// From this time on the ground is this much higher.
    pub raised: Option<(f64, f64)>,
    rng: Pcg64,
    sonar_rng: Pcg64,
    accelerometer_bias: Vector3<f64>,
    gyroscope_bias: Vector3<f64>,
    config: FlowOdometryConfig,
    calibration: FlowCalibration,
    next: i64,
    delayed_flow: Vec<(Timestamp, FlowSample)>,
    delayed_range: Vec<(Timestamp, RangeSample)>,
}

pub fn calibration() -> FlowCalibration {
    FlowCalibration {
        flow_camera: Mount::at([0.05, 0.0, -0.04], Looking::Down),
        infrared: Mount::at([-0.03, 0.02, -0.04], Looking::Down),
    }
}

pub fn config() -> FlowOdometryConfig {
    let mut config = FlowOdometryConfig::default();
    config.alignment.start_position_m = [0.0, 0.0, STAND_HEIGHT_M];
    config
}

/// Smooth from 0 at `s` = 0 to 1 at `s` = 1, at rest up to the second derivative at both ends.
fn smooth(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * s * (10.0 + s * (6.0 * s - 15.0))
}

/// Where the legs have led `s` seconds after their start.
fn legs(s: f64) -> Vector3<f64> {
    const LEGS: [[f64; 2]; 6] = [
        [1.0, 0.0],
        [0.0, 1.0],
        [-1.0, 0.0],
        [0.0, -1.0],
        [1.0, 1.0],
        [-1.0, -1.0],
    ];
    let mut place = Vector3::zeros();
    for (i, [x, y]) in LEGS.into_iter().enumerate() {
        let way = Vector3::new(x, y, 0.0).normalize() * 2.0;
        place += way * smooth((s - 4.0 * i as f64) / 3.0);
    }
    place
}

impl Flight {
    pub fn new(seed: u64, land_s: f64) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let config = config();
        let bias = config.alignment.accelerometer_bias_sigma_m_s2;
        Self {
            land_s,
            path: Path::Curves,
            noise: true,
            scale: [Vector3::repeat(1.0); 2],
            walk: [0.0; 2],
            raised: None,
            accelerometer_bias: normal(&mut rng) * bias,
            gyroscope_bias: normal(&mut rng) * 0.01,
            rng,
            sonar_rng: Pcg64::seed_from_u64(!seed),
            config,
            calibration: calibration(),
            next: 0,
            delayed_flow: Vec::new(),
            delayed_range: Vec::new(),
        }
    }

    /// The legs of document O, section 2.5.3, flown with an inertial unit that has all errors of
    /// its section 2.2.4: scale (its table 2.2), bias, noise, and walks (document L, table A-1).
    pub fn legs(seed: u64) -> Self {
        Self {
            path: Path::Legs,
            scale: [
                Vector3::new(0.9963, 1.0053, 1.0098),
                Vector3::new(1.002, 0.998, 1.001),
            ],
            walk: [3.163e-4, 3.013e-6],
            ..Self::new(seed, LEGS_LAND_S)
        }
    }

    pub fn accelerometer_bias(&self) -> Vector3<f64> {
        self.accelerometer_bias
    }

    pub fn gyroscope_bias(&self) -> Vector3<f64> {
        self.gyroscope_bias
    }

    fn position(&self, t: f64) -> Vector3<f64> {
        let up = smooth((t - TAKE_OFF_S) / (UP_S - TAKE_OFF_S));
        let down = smooth((t - (self.land_s - DOWN_TAKES_S)) / DOWN_TAKES_S);
        let moving = smooth((t - UP_S) / 3.0) * (1.0 - smooth((t - self.land_s + 7.0) / 3.0));
        let s = t - UP_S;
        let way = match self.path {
            Path::Curves => {
                let wander = Vector3::new(
                    2.0 * (0.7 * s).sin(),
                    1.5 * (0.9 * s).sin(),
                    0.3 * (1.1 * s).sin(),
                );
                wander * moving
            }
            Path::Legs => legs(s - 1.0),
        };
        Vector3::z() * (STAND_HEIGHT_M + 1.4 * up * (1.0 - down)) + way
    }

    fn yaw(&self, t: f64) -> f64 {
        if self.path == Path::Legs {
            return 0.0;
        }
        let moving = smooth((t - UP_S) / 3.0) * (1.0 - smooth((t - self.land_s + 7.0) / 3.0));
        0.8 * (0.4 * (t - UP_S)).sin() * moving
    }

    /// Derivatives by differences of a smooth path; 1e-3 s leaves 1e-6.
    pub fn truth(&self, t: f64) -> Truth {
        const H: f64 = 1e-3;
        let (before, at, after) = (self.position(t - H), self.position(t), self.position(t + H));
        let acceleration = (after - at * 2.0 + before) / (H * H);
        let up = (acceleration - gravity_world()).normalize();
        let forward = Vector3::new(self.yaw(t).cos(), self.yaw(t).sin(), 0.0);
        let left = up.cross(&forward).normalize();
        let columns = Matrix3::from_columns(&[left.cross(&up), left, up]);
        Truth {
            position_world: at,
            velocity_world: (after - before) / (2.0 * H),
            world_from_body: UnitQuaternion::from_rotation_matrix(
                &Rotation3::from_matrix_unchecked(columns),
            ),
        }
    }

    pub fn mode(&self, t: f64) -> FlightMode {
        if t < TAKE_OFF_S {
            FlightMode::Armed
        } else if t < UP_S {
            FlightMode::TakingOff
        } else if t < self.land_s - DOWN_TAKES_S {
            FlightMode::Flying
        } else if t < self.land_s + 0.2 {
            FlightMode::Landing
        } else {
            FlightMode::Disarmed
        }
    }

    /// The next 4 ms: fills the batch and gives the time, s.
    pub fn step(&mut self, batch: &mut SensorBatch) -> f64 {
        batch.clear();
        self.next += 1;
        let now = Timestamp::from_ns(self.next * STEP_NS);
        let t = now.as_s();
        batch.now = now;
        let imu = self.imu(now);
        batch.imu.push(imu);
        if self.next % 3 == 0 {
            let flow = self.flow(t);
            let arrival = Timestamp::from_s(t + 0.012);
            self.delayed_flow.push((arrival, flow));
        }
        if self.next % 17 == 0 {
            batch.sonar.push(self.sonar(now));
        }
        if self.next % 5 == 0 {
            let range = self.range(now);
            let arrival = Timestamp::from_s(t + 0.006);
            self.delayed_range.push((arrival, range));
        }
        arrive(&mut self.delayed_flow, now, &mut batch.flow);
        arrive(&mut self.delayed_range, now, &mut batch.infrared);
        t
    }

    fn draw(&mut self) -> Vector3<f64> {
        let drawn = normal(&mut self.rng);
        if self.noise { drawn } else { Vector3::zeros() }
    }

    fn imu(&mut self, now: Timestamp) -> ImuSample {
        let dt = 1e-9 * STEP_NS as f64;
        let (before, after) = (self.truth(now.as_s() - dt), self.truth(now.as_s()));
        let turn = so3::log(&(before.world_from_body.inverse() * after.world_from_body));
        let middle = before.world_from_body * so3::exp(&(turn * 0.5));
        let acceleration = (after.velocity_world - before.velocity_world) / dt;
        let noise = self.config.imu_noise.clone();
        let root = dt.sqrt();
        if self.walk != [0.0; 2] {
            let [force_walk, rate_walk] = [self.draw(), self.draw()];
            self.accelerometer_bias += force_walk * (self.walk[0] * root);
            self.gyroscope_bias += rate_walk * (self.walk[1] * root);
        }
        let [force_scale, rate_scale] = self.scale;
        let force = middle.inverse() * (acceleration - gravity_world())
            + self.draw() * (noise.accelerometer_noise_m_s2_sqrt_hz / root);
        let rate = turn / dt + self.draw() * (noise.gyroscope_noise_rad_s_sqrt_hz / root);
        ImuSample {
            time: now,
            specific_force: force_scale.component_mul(&force) + self.accelerometer_bias,
            angular_rate: rate_scale.component_mul(&rate) + self.gyroscope_bias,
        }
    }

    fn flow(&mut self, end_s: f64) -> FlowSample {
        let interval_s = 3e-9 * STEP_NS as f64;
        let middle_s = end_s - 0.5 * interval_s;
        let mount = self.calibration.flow_camera.body_from_sensor();
        let pose = |t: f64| self.pose(t) * mount;
        let axis = pose(middle_s) * Vector3::z();
        let origin = pose(middle_s).translation.vector;
        let distance_m = (self.ground_m(middle_s) - origin.z) / axis.z;
        let ground = nalgebra::Point3::from(origin + axis * distance_m);
        let image = |t: f64| {
            let p = pose(t).inverse() * ground;
            p.coords.xy() / p.z
        };
        let flow = (image(end_s) - image(end_s - interval_s)) / interval_s;
        let sharp = distance_m > 0.3;
        let noise = self.draw().xy() * self.config.flow_sigma_rad_s;
        FlowSample {
            time: Timestamp::from_s(middle_s),
            interval_s,
            flow_rad_s: if sharp {
                flow + noise
            } else {
                Vector2::zeros()
            },
            quality: if sharp { 0.9 } else { 0.0 },
        }
    }

    fn range(&mut self, now: Timestamp) -> RangeSample {
        let pose = self.pose(now.as_s()) * self.calibration.infrared.body_from_sensor();
        let axis = pose * Vector3::z();
        let distance_m = (self.ground_m(now.as_s()) - pose.translation.vector.z) / axis.z;
        let range_m = distance_m + self.draw().x * self.config.range_sigma_m;
        RangeSample {
            time: now,
            range_m,
            min_m: 0.2,
            max_m: 14.0,
        }
    }

    /// Height of the flow camera, beside which the sonar sits. It has its own noise, so that the
    /// other sensors read the same with and without it.
    fn sonar(&mut self, now: Timestamp) -> RangeSample {
        let pose = self.pose(now.as_s()) * self.calibration.flow_camera.body_from_sensor();
        let height_m = pose.translation.vector.z - self.ground_m(now.as_s());
        let drawn = normal(&mut self.sonar_rng).x * self.config.sonar.height_sigma_m;
        RangeSample {
            time: now,
            range_m: height_m + if self.noise { drawn } else { 0.0 },
            min_m: 0.3,
            max_m: 5.0,
        }
    }

    fn ground_m(&self, t: f64) -> f64 {
        self.raised
            .filter(|(since, _)| t > *since)
            .map_or(0.0, |(_, height_m)| height_m)
    }

    fn pose(&self, t: f64) -> Pose {
        let truth = self.truth(t);
        Pose::from_parts(
            Translation3::from(truth.position_world),
            truth.world_from_body,
        )
    }
}

fn normal(rng: &mut Pcg64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(rng))
}

fn arrive<T: Copy>(delayed: &mut Vec<(Timestamp, T)>, now: Timestamp, arrived: &mut Vec<T>) {
    arrived.extend(delayed.iter().filter(|d| d.0 <= now).map(|d| d.1));
    delayed.retain(|d| d.0 > now);
}
