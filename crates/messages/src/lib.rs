//! What flows between the parts of alula: plain data, and the [`Vehicle`] trait.
//!
//! Every arrow of the architecture is a type here and every one is recorded. Frames and units are
//! in the names: world ENU, body FLU, optical frame x right, y down, z forward, SI.

mod command;
mod health;
mod intent;
mod mount;
mod obstacle;
mod output;
mod plan;
mod reference;
mod sensors;
mod state;
mod vehicle;

pub use command::Command;
pub use health::{Fallback, Finding, Fusion, GuardReport, Rejection, Sensor, Violation};
pub use intent::{FlightMode, Intent, Refusal};
pub use mount::{Looking, Mount};
pub use obstacle::{
    Cut, Detection, Footprint, Obstacle, ObstacleCovariance, ObstacleMotion, PixelBox, Sight,
};
pub use output::StackOutput;
pub use plan::{
    Hindrance, NO_OBSTACLE, PLAN_INTERVALS, PLAN_OBSTACLES, PLAN_POINTS, Plan, PlanExit, PlanPoint,
};
pub use reference::Reference;
pub use sensors::{
    AutopilotStatus, DepthImage, FlowSample, ImuSample, MAX_DEPTH_CAMERAS, PoseSample, RangeSample,
    SensorBatch,
};
pub use state::{ErrorCovariance, EstimateHealth, FlightPhase, NavState, Unobserved, error_index};
pub use vehicle::{Vehicle, VehicleError};
