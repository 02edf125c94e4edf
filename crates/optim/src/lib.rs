//! Quadratic programs: no robot words.
//!
//! - [`ActiveSetSolver`]: strictly convex programs with equalities and inequalities, dense, by the
//!   dual active-set method of Goldfarb and Idnani (Mathematical Programming 27, 1983).
//! - [`solve_equality`]: programs with equalities only, by one linear solve; the Hessian need only
//!   be positive definite where the equalities leave freedom.
//! - [`AssignmentSolver`]: which row goes with which column, at the least total cost.
//! - [`BandedCholesky`]: positive definite systems whose matrix is a narrow band.
//! - [`ocp`]: optimal control over a horizon, by sequential quadratic programming with Riccati
//!   recursions.
//! - [`KktResidual`]: how well a point meets the optimality conditions, for whichever solver.

mod active_set;
mod assignment;
mod banded;
mod equality;
mod factor;
pub mod ocp;
mod problem;

pub use active_set::{ActiveSetSettings, ActiveSetSolver, Report};
pub use assignment::AssignmentSolver;
pub use banded::BandedCholesky;
pub use equality::{EqualitySolution, solve_equality};
pub use problem::{Exit, KktResidual, LinearRows, QuadraticProgram};
