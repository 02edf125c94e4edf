//! The interface to a vehicle: simulated, recorded or real.

use crate::{Command, SensorBatch};

/// A vehicle that senses and obeys.
///
/// The caller alternates [`Vehicle::sense`] and [`Vehicle::command`]; a simulated vehicle lets time
/// pass in `sense`, a real one waits in it.
pub trait Vehicle {
    /// Waits for the next control period and fills `batch` with all that arrived in it.
    ///
    /// `batch` is cleared first. Returns `false` when there will be no more data.
    ///
    /// # Errors
    /// When the vehicle cannot be reached any more.
    fn sense(&mut self, batch: &mut SensorBatch) -> Result<bool, VehicleError>;

    /// Passes a command on.
    ///
    /// # Errors
    /// When the vehicle cannot be reached, or cannot execute this kind of command.
    fn command(&mut self, command: &Command) -> Result<(), VehicleError>;
}

/// Why a vehicle does not answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VehicleError {
    /// The connection is gone.
    #[error("the vehicle cannot be reached: {reason}")]
    Unreachable {
        /// What the transport said.
        reason: String,
    },
    /// The command needs an interface that this vehicle does not have.
    #[error("the vehicle does not accept the command {command:?}")]
    Unsupported {
        /// The command.
        command: Command,
    },
}
