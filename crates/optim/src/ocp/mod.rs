//! Optimal control over a horizon: programs whose stages are linked by dynamics.
//!
//! - [`OptimalControl`]: what a problem must answer.
//! - [`OcpSolver`]: sequential quadratic programming with roll-outs; every iterate meets the
//!   dynamics and the input bounds.
//! - [`StageQpSolver`]: its subproblems, by Riccati recursions within a semi-smooth Newton method
//!   on the augmented Lagrangian.
//!
//! The page `docs/derivations/optimal-control.md` gives the equations.

mod acceleration;
mod augmented;
mod kernels;
mod line_search;
mod problem;
mod qp;
mod qp_solver;
mod riccati;
mod sqp;
mod trajectory;

pub use problem::{OptimalControl, SoftConstraint, StageCost, Step};
pub use qp::{StageQp, StageQpExit, StageQpReport, StageQpSettings};
pub use qp_solver::StageQpSolver;
pub use riccati::Riccati;
pub use sqp::{OcpExit, OcpReport, OcpSettings, OcpSolver};
pub use trajectory::weigh;
