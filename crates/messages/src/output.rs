//! All that one step of the stack says.

use alula_geometry::Timestamp;

use crate::{
    Command, Detection, FlightMode, Fusion, GuardReport, Hindrance, Intent, NavState, Obstacle,
    Plan, Reference, Refusal,
};

/// The outcome of one step: every arrow between the parts of the stack, ready to be recorded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StackOutput {
    /// Time of the step: `now` of the batch that caused it.
    pub time: Timestamp,
    /// Where the vehicle believes it is.
    pub state: NavState,
    /// The measurements that met the estimator in this step.
    pub fusions: Vec<Fusion>,
    /// Mode of flight after the step.
    pub mode: FlightMode,
    /// Requests that were handled in this step, each with the reason if it was refused.
    pub requests: Vec<(Intent, Option<Refusal>)>,
    /// Time of exposure of the depth image that was looked at in this step, if one was.
    pub seen_at: Option<Timestamp>,
    /// Boxes in that image; empty when none was looked at.
    pub detections: Vec<Detection>,
    /// Obstacles as known after that image; empty when none was looked at.
    pub obstacles: Vec<Obstacle>,
    /// The plan, in the steps in which one was made.
    pub plan: Option<Plan>,
    /// Why the vehicle does not advance, if it does not.
    pub hindrance: Option<Hindrance>,
    /// Where the vehicle should be; `None` while the motors are off or idle.
    pub reference: Option<Reference>,
    /// The command of the controller.
    pub requested: Command,
    /// What the guard found and did.
    pub guard: GuardReport,
    /// The command after the guard: what the vehicle gets.
    pub command: Command,
}
