//! The simulator: a world with people, multirotors and their sensors, deterministic to the bit for
//! a seed and faster than real time. It implements [`alula_messages::Vehicle`] and knows nothing of
//! the stack that flies it.

pub mod multirotor;
pub mod render;
pub mod sensors;
mod truth;
mod vehicle;
pub mod wind;
pub mod world;

pub use truth::Truth;
pub use vehicle::{Collision, LinkConfig, SimulatedVehicle, StartConfig, VehicleSetup};
