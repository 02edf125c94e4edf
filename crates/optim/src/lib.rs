//! Quadratic programs: no robot words.
//!
//! - [`ActiveSetSolver`]: strictly convex programs with equalities and inequalities, dense, by the
//!   dual active-set method of Goldfarb and Idnani (Mathematical Programming 27, 1983).
//! - [`solve_equality`]: programs with equalities only, by one linear solve; the Hessian need only
//!   be positive definite where the equalities leave freedom.
//! - [`BandedCholesky`]: positive definite systems whose matrix is a narrow band.
//! - [`KktResidual`]: how well a point meets the optimality conditions, for whichever solver.

mod active_set;
mod banded;
mod equality;
mod factor;
pub mod ocp;
mod problem;

pub use active_set::{ActiveSetSettings, ActiveSetSolver, Report};
pub use banded::BandedCholesky;
pub use equality::{EqualitySolution, solve_equality};
pub use problem::{Exit, KktResidual, LinearRows, QuadraticProgram};
