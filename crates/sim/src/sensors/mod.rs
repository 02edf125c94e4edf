//! Sensors: what the vehicle gets to know of the truth, with noise, bias, delay and failures.
//!
//! Every sensor takes its samples at exact multiples of its period, stamps them with the time at
//! which they were true and delivers them after its latency. Every sensor has its own seed, drawn
//! from the flight's seed and its name. Models: `docs/derivations/sensor-models.md`.

mod channel;
mod depth;
mod failure;
mod flow;
mod imu;
mod infrared;
mod motion_capture;
pub(crate) mod noise;
mod own;
mod sonar;
mod status;
mod step;

use alula_geometry::Timestamp;
use alula_messages::{Looking, MAX_DEPTH_CAMERAS, Mount, SensorBatch};
use alula_parameters::{ParameterError, Parameters, parameters};

use crate::Truth;
use crate::world::World;

use depth::Depth;
use flow::Flow;
use imu::Imu;
use infrared::Infrared;
use motion_capture::MotionCapture;
use sonar::Sonar;
use status::Status;
use step::Step;

pub use depth::{DepthModel, DepthSetup};
pub use failure::{FailureConfig, FailureKind};
pub use flow::{FlowModel, FlowSetup};
pub use imu::ImuModel;
pub use infrared::{InfraredModel, InfraredSetup};
pub use motion_capture::MotionCaptureModel;
pub use own::AutopilotSensing;
pub(crate) use own::OwnSense;
pub use sonar::{SonarModel, SonarSetup};
pub use status::StatusModel;
pub use step::MotorActivity;

parameters! {
    /// The sensors of a vehicle. Without a table for it, a sensor is not on board.
    pub struct SensorSuiteConfig {
        /// Inertial measurement unit at the body's origin.
        pub imu: ImuModel = ImuModel::default(), nested();
        /// Reports of the autopilot.
        pub status: StatusModel = StatusModel::default(), nested();
        /// Flow camera.
        pub flow: Option<FlowSetup> = None, nested();
        /// Ultrasonic ranger.
        pub sonar: Option<SonarSetup> = None, nested();
        /// Infrared ranger.
        pub infrared: Option<InfraredSetup> = None, nested();
        /// Depth camera that looks ahead.
        pub depth: Option<DepthSetup> = None, nested();
        /// Further depth cameras, for a vehicle that also sees to its sides or behind; numbered
        /// from 1.
        pub more_depth: Vec<DepthSetup> = Vec::new(), few(MAX_DEPTH_CAMERAS - 1);
        /// Motion capture around the flight space.
        pub motion_capture: Option<MotionCaptureModel> = None, nested();
    }
}

impl SensorSuiteConfig {
    /// Inertial sensors, flow camera, infrared ranger and depth camera on a small multirotor: the
    /// sensors of document S (setting B) for odometry and those of document L for obstacles.
    pub fn small_multirotor() -> Self {
        Self {
            flow: Some(FlowSetup {
                mount: Mount::at([0.02, 0.0, -0.03], Looking::Down),
                model: FlowModel::default(),
            }),
            infrared: Some(InfraredSetup {
                mount: Mount::at([-0.02, 0.0, -0.03], Looking::Down),
                model: InfraredModel::default(),
            }),
            depth: Some(DepthSetup {
                mount: Mount::at([0.1, 0.0, 0.0], Looking::Forward),
                model: DepthModel::default(),
            }),
            ..Self::default()
        }
    }

    /// All depth cameras with their numbers.
    pub fn depth_cameras(&self) -> impl Iterator<Item = (u8, &DepthSetup)> {
        let ahead = self.depth.iter().map(|setup| (0, setup));
        ahead.chain((1..).zip(&self.more_depth))
    }
}

/// All sensors of one vehicle.
pub struct SensorSuite {
    imu: Imu,
    status: Status,
    flow: Option<Flow>,
    sonar: Option<Sonar>,
    infrared: Option<Infrared>,
    depth: Vec<Depth>,
    motion_capture: Option<MotionCapture>,
}

impl SensorSuite {
    /// The sensors of a flight with seed `flight_seed`; time starts at zero.
    ///
    /// # Errors
    /// The first parameter that is out of range.
    pub fn new(config: &SensorSuiteConfig, flight_seed: u64) -> Result<Self, ParameterError> {
        config.validate()?;
        Ok(Self {
            imu: Imu::new(&config.imu, flight_seed),
            status: Status::new(&config.status, flight_seed),
            flow: config.flow.as_ref().map(|c| Flow::new(c, flight_seed)),
            sonar: config.sonar.as_ref().map(|c| Sonar::new(c, flight_seed)),
            infrared: config
                .infrared
                .as_ref()
                .map(|c| Infrared::new(c, flight_seed)),
            depth: depth_cameras(config, flight_seed),
            motion_capture: config
                .motion_capture
                .as_ref()
                .map(|c| MotionCapture::new(c, flight_seed)),
        })
    }

    /// Takes the samples that are due after `from` and up to `to`, two instants a short step
    /// apart. Consecutive calls must join.
    pub fn advance(&mut self, world: &World, from: &Truth, to: &Truth, motors: &MotorActivity) {
        let step = Step {
            world,
            from,
            to,
            motors,
        };
        self.imu.advance(&step);
        self.status.advance(&step);
        if let Some(flow) = &mut self.flow {
            flow.advance(&step);
        }
        if let Some(sonar) = &mut self.sonar {
            sonar.advance(&step);
        }
        if let Some(infrared) = &mut self.infrared {
            infrared.advance(&step);
        }
        for depth in &mut self.depth {
            depth.advance(&step);
        }
        if let Some(motion_capture) = &mut self.motion_capture {
            motion_capture.advance(&step);
        }
    }

    /// Appends to `batch` all samples that have arrived by `now`.
    pub fn deliver(&mut self, now: Timestamp, batch: &mut SensorBatch) {
        batch.now = now;
        self.imu.deliver(now, &mut batch.imu);
        self.status.deliver(now, &mut batch.autopilot);
        if let Some(flow) = &mut self.flow {
            flow.deliver(now, &mut batch.flow);
        }
        if let Some(sonar) = &mut self.sonar {
            sonar.deliver(now, &mut batch.sonar);
        }
        if let Some(infrared) = &mut self.infrared {
            infrared.deliver(now, &mut batch.infrared);
        }
        for depth in &mut self.depth {
            depth.deliver(now, &mut batch.depth);
        }
        // A stable sort would allocate.
        batch
            .depth
            .sort_unstable_by_key(|image| (image.time, image.sensor));
        if let Some(motion_capture) = &mut self.motion_capture {
            motion_capture.deliver(now, &mut batch.poses);
        }
    }
}

/// The depth cameras of a vehicle, in the order of their numbers.
fn depth_cameras(config: &SensorSuiteConfig, flight_seed: u64) -> Vec<Depth> {
    config
        .depth_cameras()
        .map(|(sensor, setup)| Depth::new(setup, sensor, flight_seed))
        .collect()
}

#[cfg(test)]
mod tests;
