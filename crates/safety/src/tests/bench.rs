//! A vehicle without faults that the tests spoil one thing at a time.

use std::sync::Arc;

use alula_geometry::{GRAVITY_M_S2, PinholeCamera, Pose, TimeDelta, Timestamp, so3};
use alula_messages::{
    Command, DepthImage, EstimateHealth, Fallback, FlightMode, FlowSample, GuardReport, ImuSample,
    NavState, RangeSample, SensorBatch, Violation,
};
use nalgebra::{Translation3, Vector2, Vector3};

use crate::{Guard, GuardConfig, GuardInput, GuardVehicle};

pub const STEP_S: f64 = 0.005;
pub const MASS_KG: f64 = 1.2;
pub const HOVER_N: f64 = MASS_KG * GRAVITY_M_S2;

/// What a ranger does.
#[derive(Clone, Copy, PartialEq)]
pub enum Range {
    Works,
    Silent,
    Invalid,
    Stuck,
}

/// By how much the clocks of sensors run ahead, s.
#[derive(Clone, Copy, Default)]
pub struct Ahead {
    pub imu: f64,
    pub flow: f64,
    pub range: f64,
    pub depth: f64,
}

pub struct Bench {
    pub guard: Guard,
    pub mode: FlightMode,
    pub requested: Command,
    /// True motion: the vehicle moves with this velocity and this roll.
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub acceleration: Vector3<f64>,
    pub roll_rad: f64,
    pub roll_rate_rad_s: f64,
    pub imu_works: bool,
    /// Whether the inertial sensor repeats its last sample.
    pub imu_stuck: bool,
    /// By how much each second sample is off, m/s^2.
    pub imu_jump_m_s2: f64,
    pub flow_quality: f64,
    /// What all pixels of the depth camera show; without it there is none.
    pub depth_mm: Option<u16>,
    /// Whether a second depth camera, which looks elsewhere, shows the same.
    pub second_depth: bool,
    /// Whether it repeats one image.
    pub depth_stuck: bool,
    pub range: Range,
    pub ahead_s: Ahead,
    /// Turns the honest estimate into another.
    pub spoil: Box<dyn Fn(&mut NavState)>,
    /// Whether the flight modes obey the guard.
    pub obedient: bool,
    batch: SensorBatch,
    step: i64,
    last_range_m: f64,
    last_imu: Option<ImuSample>,
}

impl Bench {
    /// Hovers 1.5 m above the ground, after one second on the ground.
    pub fn hovering() -> Self {
        let mut bench = Self::on_ground();
        bench.mode = FlightMode::Armed;
        bench.run(0.1);
        bench.take_off_to(1.5);
        bench
    }

    pub fn on_ground() -> Self {
        let vehicle = GuardVehicle {
            mass_kg: MASS_KG,
            max_thrust_n: 2.5 * HOVER_N,
        };
        let mut bench = Self {
            guard: Guard::new(&GuardConfig::default(), &vehicle).unwrap(),
            mode: FlightMode::Disarmed,
            requested: Command::Disarm,
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            roll_rad: 0.0,
            roll_rate_rad_s: 0.0,
            imu_works: true,
            imu_stuck: false,
            imu_jump_m_s2: 0.0,
            last_imu: None,
            flow_quality: 0.9,
            depth_mm: None,
            second_depth: false,
            depth_stuck: false,
            range: Range::Works,
            ahead_s: Ahead::default(),
            spoil: Box::new(|_| {}),
            obedient: true,
            batch: SensorBatch::default(),
            step: 0,
            last_range_m: 0.0,
        };
        bench.run(1.0);
        bench
    }

    pub fn take_off_to(&mut self, height_m: f64) {
        self.mode = FlightMode::TakingOff;
        self.requested = thrust(HOVER_N);
        self.velocity.z = 0.5;
        self.run(height_m / 0.5);
        self.velocity.z = 0.0;
        self.mode = FlightMode::Hovering;
        self.run(2.0);
        assert_eq!(self.guard.report().findings, vec![]);
    }

    pub fn flying() -> Self {
        let mut bench = Self::hovering();
        bench.mode = FlightMode::Flying;
        bench
    }

    pub fn now(&self) -> Timestamp {
        Timestamp::from_s(50.0) + TimeDelta::from_ns(self.step * 5_000_000)
    }

    pub fn step(&mut self) -> &GuardReport {
        self.step += 1;
        self.position += self.velocity * STEP_S;
        self.roll_rad += self.roll_rate_rad_s * STEP_S;
        self.sense();
        let state = self.estimate();
        let input = GuardInput {
            batch: &self.batch,
            state: &state,
            mode: self.mode,
            requested: &self.requested,
        };
        self.guard.update(&input);
        if self.obedient {
            self.obey();
        }
        self.guard.report()
    }

    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP_S).round() as i64 {
            self.step();
        }
    }

    /// Seconds until the fallback is at least `fallback`.
    pub fn seconds_until(&mut self, fallback: Fallback, limit_s: f64) -> Option<f64> {
        let begin = self.now();
        while self.now().seconds_since(begin) < limit_s {
            if self.step().fallback >= fallback {
                return Some(self.now().seconds_since(begin));
            }
        }
        None
    }

    /// The guard reaches `fallback` after `low_s` to `high_s`, because of `violation`.
    pub fn expect(&mut self, violation: Violation, fallback: Fallback, low_s: f64, high_s: f64) {
        let seconds = self.seconds_until(fallback, high_s + 1.0);
        let found: Vec<_> = self.guard.report().findings.clone();
        assert!(
            seconds.is_some_and(|s| s >= low_s && s <= high_s),
            "{fallback:?} after {seconds:?} s, expected {low_s} to {high_s}; {found:?}"
        );
        assert!(found.iter().any(|f| f.violation == violation), "{found:?}");
        assert_eq!(self.guard.report().fallback, fallback);
    }

    /// Nothing is found for `seconds`.
    pub fn expect_nothing(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP_S).round() as i64 {
            let report = self.step().clone();
            assert_eq!(report, GuardReport::default(), "at {}", self.now());
        }
    }

    fn obey(&mut self) {
        use FlightMode::{Flying, Hovering, Killed, Landing, TakingOff};
        let airborne = matches!(self.mode, TakingOff | Hovering | Flying | Landing);
        self.mode = match (self.guard.report().fallback, self.mode) {
            (Fallback::Hold, TakingOff | Flying) => Hovering,
            (Fallback::Land | Fallback::Descend, _) if airborne => Landing,
            (Fallback::Cut, _) if airborne => Killed,
            (_, mode) => mode,
        };
    }

    fn world_from_body(&self) -> Pose {
        Pose::from_parts(
            Translation3::from(self.position),
            so3::from_roll_pitch_yaw(self.roll_rad, 0.0, 0.0),
        )
    }

    fn ahead(&self, seconds: f64) -> Timestamp {
        self.now() + TimeDelta::from_s(seconds)
    }

    fn estimate(&self) -> NavState {
        let mut state = NavState {
            time: self.now(),
            world_from_body: self.world_from_body(),
            velocity_world: self.velocity,
            angular_rate_body: Vector3::x() * self.roll_rate_rad_s,
            acceleration_world: self.acceleration,
            health: EstimateHealth::Good,
            ..NavState::default()
        };
        (self.spoil)(&mut state);
        state
    }

    /// A fixed dither in place of noise, so that no reading repeats.
    fn dither(&self) -> f64 {
        (self.step as f64 * 0.7).sin()
    }

    fn sense(&mut self) {
        self.batch.clear();
        self.batch.now = self.now();
        if self.imu_works {
            let mut imu = self.imu();
            if let Some(last) = self.last_imu.filter(|_| self.imu_stuck) {
                imu = ImuSample {
                    time: imu.time,
                    ..last
                };
            }
            self.last_imu = Some(imu);
            imu.specific_force.x += self.imu_jump_m_s2 * (self.step % 2) as f64;
            self.batch.imu.push(imu);
        }
        if self.step % 2 == 0 {
            let flow = self.flow();
            self.batch.flow.push(flow);
        }
        if self.step % 4 == 0 && self.range != Range::Silent {
            let range = self.range();
            self.batch.infrared.push(range);
        }
        if let Some(depth_mm) = self.depth_mm.filter(|_| self.step % 7 == 0) {
            self.batch.depth.push(self.image(0, depth_mm));
            if self.second_depth {
                self.batch.depth.push(self.image(1, depth_mm));
            }
        }
    }

    fn image(&self, sensor: u8, depth_mm: u16) -> Arc<DepthImage> {
        let camera = PinholeCamera::from_field_of_view(64, 48, 1.5, 1.0);
        Arc::new(DepthImage {
            time: self.ahead(self.ahead_s.depth),
            sensor,
            camera,
            body_from_camera: Pose::identity(),
            depth_mm: self.pixels(depth_mm),
        })
    }

    /// A flat scene with a dither, unless there is nothing to see.
    fn pixels(&self, depth_mm: u16) -> Vec<u16> {
        let dither = (self.step % 5) as u16;
        let shown = if depth_mm == 0 || self.depth_stuck {
            depth_mm
        } else {
            depth_mm + dither
        };
        vec![shown; 64 * 48]
    }

    fn imu(&self) -> ImuSample {
        let body_from_world = self.world_from_body().rotation.inverse();
        let up = Vector3::z() * GRAVITY_M_S2;
        ImuSample {
            time: self.ahead(self.ahead_s.imu),
            specific_force: body_from_world * (self.acceleration + up)
                + Vector3::repeat(0.3 * self.dither()),
            angular_rate: Vector3::new(self.roll_rate_rad_s + 0.01, -0.01, 0.01),
        }
    }

    /// The flow of a camera that looks down: the gyroscope's bias is not in it.
    fn flow(&self) -> FlowSample {
        let velocity_body = self.world_from_body().rotation.inverse() * self.velocity;
        let slant_m = self.slant_m();
        let rotation = Vector2::new(self.roll_rate_rad_s, 0.0);
        let motion = Vector2::new(velocity_body.y, velocity_body.x) / slant_m;
        FlowSample {
            time: self.ahead(self.ahead_s.flow),
            interval_s: 0.01,
            flow_rad_s: motion + rotation + Vector2::repeat(0.02 * self.dither()),
            quality: self.flow_quality,
        }
    }

    fn slant_m(&self) -> f64 {
        (self.position.z + 0.08) / self.roll_rad.cos().max(0.2)
    }

    fn range(&mut self) -> RangeSample {
        let range_m = match self.range {
            Range::Stuck => self.last_range_m,
            Range::Invalid => 99.0,
            Range::Works | Range::Silent => self.slant_m() + 0.01 * self.dither(),
        };
        self.last_range_m = range_m;
        RangeSample {
            time: self.ahead(self.ahead_s.range),
            range_m,
            min_m: 0.05,
            max_m: 30.0,
        }
    }
}

pub fn thrust(thrust_n: f64) -> Command {
    Command::AttitudeThrust {
        roll_rad: 0.02,
        pitch_rad: -0.03,
        yaw_rate_rad_s: 0.1,
        thrust_n,
    }
}
