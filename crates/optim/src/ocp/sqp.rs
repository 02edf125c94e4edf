//! Sequential quadratic programming over a horizon.

use nalgebra::SVector;

use super::acceleration::Acceleration;
use super::kernels::add_times;
use super::problem::OptimalControl;
use super::qp::{StageQp, StageQpExit, StageQpSettings};
use super::qp_solver::StageQpSolver;
use super::trajectory::{Change, Trajectory};

/// A step must bring this share of the decrease that the model promises.
const DECREASE_SHARE: f64 = 1e-3;
/// A gap of the dynamics this small, relative to `1 + |x|`, is rounding.
const ROUNDING: f64 = 1e-12;
/// A promised decrease this small, relative to the cost, is none.
const FLAT: f64 = 1e-10;
/// The step is halved at most this often.
const MAX_HALVINGS: u32 = 12;
/// Steps are not trusted to shrink faster than this.
const MIN_CONTRACTION: f64 = 0.1;
/// Steps that shrink slower than this are no sign of the distance that is left.
const MAX_CONTRACTION: f64 = 0.9;

/// Settings of [`OcpSolver`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OcpSettings {
    /// Greatest number of subproblems in a solve.
    pub max_iterations: u32,
    /// Greatest number of Newton steps in all subproblems of a solve, which bounds its time.
    pub max_newton_steps: u32,
    /// Distance of the inputs from a stationary point that counts as none, as a share of the width
    /// of their bounds in the first interval (of 1 for an input without bounds), and gap of the
    /// dynamics, relative to `1 + |x|`, that counts as none in the start.
    pub tolerance: f64,
    /// Settings of the subproblems.
    pub qp: StageQpSettings,
}

impl Default for OcpSettings {
    fn default() -> Self {
        Self {
            max_iterations: 15,
            max_newton_steps: 100,
            tolerance: 1e-3,
            // What a subproblem leaves undone, the next one goes on with from a better point.
            qp: StageQpSettings {
                max_iterations: 12,
                tolerance: 1e-5,
                ..StageQpSettings::default()
            },
        }
    }
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OcpExit {
    /// The trajectory is stationary to the tolerance.
    Converged,
    /// The iterations or the Newton steps ran out; the trajectory is the best that was found.
    IterationLimit,
    /// No step along the subproblem's solution lowers the cost; the trajectory is the best that
    /// was found.
    NoProgress {
        /// What the model promised to lower the cost by.
        promised: f64,
    },
    /// A number is not finite: in the initial state, in the guess (then the trajectory stays
    /// what it was), or in the problem's answers.
    NotFinite,
}

/// How a solve went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OcpReport {
    /// How it ended.
    pub exit: OcpExit,
    /// Subproblems solved.
    pub iterations: u32,
    /// Newton steps in all of them.
    pub qp_iterations: u32,
    /// Cost of the trajectory with its penalties; infinite when none was found.
    pub cost: f64,
    /// Greatest violation of a softened constraint; infinite when no trajectory was found.
    pub max_violation: f64,
    /// Estimate of the largest distance of an input from its stationary value, as a share of the
    /// width of its bounds.
    pub stationarity: f64,
    /// Greatest difference between a state and what the dynamics make of the one before: zero when
    /// a trajectory was found, as it is flown through the dynamics, and infinite otherwise.
    pub feasibility: f64,
}

/// Counters and measures of a running solve.
#[derive(Clone, Copy, Debug)]
struct Progress {
    iterations: u32,
    qp_iterations: u32,
    /// Size of the last subproblem's step.
    step: f64,
    /// Estimate of what is left after that step.
    distance: f64,
}

impl Progress {
    fn new() -> Self {
        Self {
            iterations: 0,
            qp_iterations: 0,
            step: f64::INFINITY,
            distance: f64::INFINITY,
        }
    }

    /// Steps that shrink by a factor `c` sum up to `c / (1 - c)` times the last.
    fn measure(&mut self, step: f64) {
        let contraction = (step / self.step).clamp(MIN_CONTRACTION, MAX_CONTRACTION);
        self.distance = if self.step.is_finite() {
            step * contraction / (1.0 - contraction)
        } else {
            step
        };
        self.step = step;
    }
}

/// What is known of a step before it is tried.
#[derive(Clone, Copy, Debug)]
struct Direction {
    is_accelerated: bool,
    /// After it, nothing of note is left: it ends at the solution of a subproblem that was solved.
    is_last: bool,
    /// The subproblem was solved to its end.
    is_solved: bool,
}

/// Solver of optimal control problems with its workspace; keeps trajectory and multipliers from
/// solve to solve.
#[derive(Clone, Debug)]
pub struct OcpSolver<const NX: usize, const NU: usize> {
    settings: OcpSettings,
    qp: StageQp<NX, NU>,
    qp_solver: StageQpSolver<NX, NU>,
    /// The result.
    best: Trajectory<NX, NU>,
    /// Where the problem is linearised.
    base: Trajectory<NX, NU>,
    trial: Trajectory<NX, NU>,
    acceleration: Acceleration<NU>,
    /// The change of the states that goes with an accelerated change of the inputs.
    accelerated_states: Vec<SVector<f64, NX>>,
    accelerated_inputs: Vec<SVector<f64, NU>>,
}

impl<const NX: usize, const NU: usize> OcpSolver<NX, NU> {
    /// A solver for horizons of `intervals` with at most `max_constraints` at a point.
    ///
    /// A problem that turns out larger is solved too, but memory is allocated for it.
    pub fn new(intervals: usize, max_constraints: usize, settings: OcpSettings) -> Self {
        Self {
            settings,
            qp: StageQp::new(intervals, max_constraints),
            qp_solver: StageQpSolver::new(intervals, max_constraints, settings.qp),
            best: Trajectory::new(intervals),
            base: Trajectory::new(intervals),
            trial: Trajectory::new(intervals),
            acceleration: Acceleration::new(intervals),
            accelerated_states: vec![SVector::zeros(); intervals + 1],
            accelerated_inputs: vec![SVector::zeros(); intervals],
        }
    }

    /// The states x_0..x_N of the trajectory.
    pub fn states(&self) -> &[SVector<f64, NX>] {
        &self.best.states
    }

    /// The inputs u_0..u_{N-1} of the trajectory.
    pub fn inputs(&self) -> &[SVector<f64, NU>] {
        &self.best.inputs
    }

    /// Sets the trajectory from which the next solve starts. It need not meet the dynamics; what is
    /// missing at the end of the slices stays.
    pub fn set_guess(&mut self, states: &[SVector<f64, NX>], inputs: &[SVector<f64, NU>]) {
        for (own, given) in self.best.states.iter_mut().zip(states) {
            *own = *given;
        }
        for (own, given) in self.best.inputs.iter_mut().zip(inputs) {
            *own = *given;
        }
    }

    /// Moves trajectory and multipliers one interval earlier; the last are repeated.
    pub fn shift(&mut self) {
        self.best.states.copy_within(1.., 0);
        self.best.inputs.copy_within(1.., 0);
        self.qp_solver.shift();
    }

    /// Forgets the multipliers, not the trajectory.
    pub fn forget(&mut self) {
        self.qp_solver.forget();
    }

    /// Improves the trajectory from the initial state `x0`, starting from the last one (or the
    /// guess) with the last multipliers.
    ///
    /// Whatever the exit but for [`OcpExit::NotFinite`] at the start, the trajectory begins at
    /// `x0`, meets the dynamics and the input bounds, and costs no more than the start's inputs
    /// flown as they are.
    pub fn solve<P: OptimalControl<NX, NU>>(
        &mut self,
        problem: &P,
        x0: &SVector<f64, NX>,
    ) -> OcpReport {
        self.fit(problem);
        let mut progress = Progress::new();
        let exit = if self.start(problem, x0) {
            self.iterate(problem, &mut progress)
        } else {
            OcpExit::NotFinite
        };
        let is_found = self.best.cost.is_finite();
        OcpReport {
            exit,
            iterations: progress.iterations,
            qp_iterations: progress.qp_iterations,
            cost: self.best.cost,
            max_violation: self.best.violation,
            stationarity: progress.distance,
            feasibility: if is_found { 0.0 } else { f64::INFINITY },
        }
    }

    /// Fits the memory to the horizon; allocates only when its length is another.
    fn fit<P: OptimalControl<NX, NU>>(&mut self, problem: &P) {
        let intervals = problem.intervals();
        if intervals != self.qp.intervals() {
            *self = Self::new(intervals, problem.max_constraints(), self.settings);
        }
    }

    /// Sets the base to the last trajectory, brought to the initial state, and the best to its
    /// inputs flown as they are. Whether the numbers are finite.
    fn start<P: OptimalControl<NX, NU>>(&mut self, problem: &P, x0: &SVector<f64, NX>) -> bool {
        self.best.cost = f64::INFINITY;
        self.best.violation = f64::INFINITY;
        self.base.copy_from(&self.best);
        self.base.states[0] = *x0;
        if !self.base.is_finite() {
            return false;
        }
        self.base.clamp_inputs(problem);
        self.trial.roll_out(problem, &self.base);
        if self.trial.cost.is_finite() {
            self.best.copy_from(&self.trial);
        }
        true
    }

    fn iterate<P: OptimalControl<NX, NU>>(
        &mut self,
        problem: &P,
        progress: &mut Progress,
    ) -> OcpExit {
        let mut is_flown = false;
        self.acceleration.forget();
        while progress.iterations < self.settings.max_iterations {
            let newton_steps = self.settings.max_newton_steps - progress.qp_iterations;
            if newton_steps == 0 {
                break;
            }
            progress.iterations += 1;
            let Some(gap) = self.linearise(problem) else {
                return OcpExit::NotFinite;
            };
            let report = self.qp_solver.solve_within(&self.qp, newton_steps);
            progress.qp_iterations += report.iterations;
            if report.exit == StageQpExit::NotFinite {
                return OcpExit::NotFinite;
            }
            is_flown |= gap <= ROUNDING;
            let is_accelerated = is_flown && self.accelerate();
            progress.measure(self.step_size(is_accelerated));
            let is_solved = report.exit == StageQpExit::Converged;
            let is_last = is_solved && progress.distance <= self.settings.tolerance;
            let direction = Direction {
                is_accelerated,
                is_last,
                is_solved,
            };
            let exit = if is_flown {
                self.descend(problem, direction)
            } else {
                self.close_gaps(problem, is_last && gap <= self.settings.tolerance)
            };
            if let Some(exit) = exit {
                return exit;
            }
            is_flown = true;
        }
        OcpExit::IterationLimit
    }

    /// States the subproblem at the base. The greatest gap of the dynamics there, relative to
    /// `1 + |x|`; none when a number is not finite.
    fn linearise<P: OptimalControl<NX, NU>>(&mut self, problem: &P) -> Option<f64> {
        let (last, qp, base) = (self.base.inputs.len(), &mut self.qp, &self.base);
        let (mut sum, mut gap) = (0.0, 0.0_f64);
        for k in 0..=last {
            let x = &base.states[k];
            let u = base.inputs.get(k).copied().unwrap_or_else(SVector::zeros);
            let cost = &mut qp.costs[k];
            problem.cost(k, x, &u, cost);
            sum += cost.value + cost.x.sum() + cost.u.sum();
            sum += cost.xx.sum() + cost.ux.sum() + cost.uu.sum();
            if k < last {
                let step = &mut qp.steps[k];
                *step = problem.step(k, x, &u);
                step.next -= base.states[k + 1];
                sum += step.next.sum() + step.a.sum() + step.b.sum();
                gap = gap.max(step.next.amax() / (1.0 + x.amax()));
                let (lower, upper) = problem.input_bounds(k);
                qp.bounds[k] = (lower - u, upper - u);
            }
            if k > 0 {
                let rows = &mut qp.constraints[k];
                rows.clear();
                problem.constraints(k, x, &mut |row| {
                    sum += row.value + row.gradient.sum() + row.linear + row.quadratic;
                    rows.push(row.clone());
                });
            }
        }
        sum.is_finite().then_some(gap)
    }

    /// The units of the inputs: the widths of their bounds in the first interval.
    fn input_scales(&self) -> SVector<f64, NU> {
        let (lower, upper) = &self.qp.bounds[0];
        SVector::from_fn(|i, _| {
            let width = upper[i] - lower[i];
            if width.is_finite() && width > 0.0 {
                width
            } else {
                1.0
            }
        })
    }

    /// The largest change of an input by the plain and by the accelerated step.
    fn step_size(&self, is_accelerated: bool) -> f64 {
        let scales = self.input_scales();
        let plain = size_of(self.qp_solver.inputs(), &scales);
        if is_accelerated {
            plain.max(size_of(&self.accelerated_inputs, &scales))
        } else {
            plain
        }
    }

    /// Prepares the accelerated step within the bounds; whether there is one.
    fn accelerate(&mut self) -> bool {
        let scales = self.input_scales();
        let steps = self.qp_solver.inputs();
        let Some(inputs) = self
            .acceleration
            .accelerate(&self.base.inputs, steps, &scales)
        else {
            return false;
        };
        self.accelerated_states[0] = SVector::zeros();
        for (k, step) in self.qp.steps.iter().enumerate() {
            let (lower, upper) = &self.qp.bounds[k];
            let input = inputs[k].zip_zip_map(lower, upper, |u, low, high| u.max(low).min(high));
            let mut next = SVector::zeros();
            add_times(&mut next, &step.a, &self.accelerated_states[k]);
            add_times(&mut next, &step.b, &input);
            self.accelerated_inputs[k] = input;
            self.accelerated_states[k + 1] = next;
        }
        true
    }

    /// Flies a share of the subproblem's step from the base into the trial.
    fn try_share<P: OptimalControl<NX, NU>>(&mut self, problem: &P, share: f64) {
        let change = Change {
            states: self.qp_solver.states(),
            inputs: self.qp_solver.inputs(),
            riccati: self.qp_solver.riccati(),
        };
        self.trial
            .roll_out_changed(problem, &self.base, &change, share);
    }

    fn try_accelerated<P: OptimalControl<NX, NU>>(&mut self, problem: &P) {
        let change = Change {
            states: &self.accelerated_states,
            inputs: &self.accelerated_inputs,
            riccati: self.qp_solver.riccati(),
        };
        self.trial
            .roll_out_changed(problem, &self.base, &change, 1.0);
    }

    /// From a base with gaps: the full step closes them. The inputs flown as they are stay when they
    /// cost less. Returns the exit if this ends the solve.
    fn close_gaps<P: OptimalControl<NX, NU>>(
        &mut self,
        problem: &P,
        is_last: bool,
    ) -> Option<OcpExit> {
        self.try_share(problem, 1.0);
        if self.trial.cost < self.best.cost {
            std::mem::swap(&mut self.best, &mut self.trial);
        }
        self.base.copy_from(&self.best);
        if !self.best.cost.is_finite() {
            return Some(OcpExit::NoProgress {
                promised: f64::INFINITY,
            });
        }
        is_last.then_some(OcpExit::Converged)
    }

    /// From a base that is flown: the accelerated step if there is one; else, or if it does not
    /// bring a share of the decrease that the model promises, the plain step, halved again and
    /// again until it does. Returns the exit if this ends the solve.
    fn descend<P: OptimalControl<NX, NU>>(
        &mut self,
        problem: &P,
        step: Direction,
    ) -> Option<OcpExit> {
        let (dx, du) = (self.qp_solver.states(), self.qp_solver.inputs());
        let saved = self.qp_solver.saved_beyond_bounds(&self.qp);
        let promised = self.best.cost - self.qp.objective(dx, du) - saved;
        let is_flat = step.is_solved && promised <= FLAT * (1.0 + self.best.cost.abs());
        if step.is_accelerated {
            self.try_accelerated(problem);
            if self.take_trial(DECREASE_SHARE * promised) {
                return step.is_last.then_some(OcpExit::Converged);
            }
            self.acceleration.forget();
        }
        let mut share = 1.0;
        for _ in 0..=MAX_HALVINGS {
            self.try_share(problem, share);
            if self.take_trial(DECREASE_SHARE * share * promised) {
                return step.is_last.then_some(OcpExit::Converged);
            }
            if step.is_last || is_flat {
                // The step is too small to matter.
                return Some(OcpExit::Converged);
            }
            share *= 0.5;
        }
        if !step.is_solved {
            // The subproblem is gone on with at the same point.
            self.acceleration.forget();
            return None;
        }
        Some(OcpExit::NoProgress { promised })
    }

    /// Makes the trial the best and the base if it costs less by `needed`.
    fn take_trial(&mut self, needed: f64) -> bool {
        let decrease = self.best.cost - self.trial.cost;
        let is_better = decrease > 0.0 && decrease >= needed;
        if is_better {
            std::mem::swap(&mut self.best, &mut self.trial);
            self.base.copy_from(&self.best);
        }
        is_better
    }
}

/// The largest entry, in units of `scales`.
fn size_of<const NU: usize>(inputs: &[SVector<f64, NU>], scales: &SVector<f64, NU>) -> f64 {
    let sizes = inputs.iter().map(|u| u.component_div(scales).amax());
    sizes.fold(0.0, f64::max)
}
