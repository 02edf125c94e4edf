//! The subproblem's solver: Newton's method on the augmented Lagrangian, its systems solved by
//! Riccati recursions.

use nalgebra::SVector;

use super::augmented::{Piece, Response, bound, bound_of, soft, soft_of};
use super::kernels::{add_outer, dot};
use super::line_search::least;
use super::qp::{StageQp, StageQpExit, StageQpReport, StageQpSettings};
use super::riccati::Riccati;

/// Steps this much below the tolerance count as none.
const STEP_SHARE: f64 = 1e-2;
/// The stiffness grows by this factor when a new multiplier has not cut the residual by it.
const STIFFEN: f64 = 10.0;
/// Greatest growth of the stiffness.
const MAX_STIFFENING: f64 = 1e6;

/// A bound or a softened constraint: where it is and what it does there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Held {
    /// The input, or the constraint's value.
    value: f64,
    /// How the value changes over the Newton step.
    change: f64,
    /// The multiplier known so far.
    prior: f64,
    stiffness: f64,
    response: Response,
}

/// Solver of stage programs with its workspace; the multipliers stay from solve to solve.
#[derive(Clone, Debug)]
pub struct StageQpSolver<const NX: usize, const NU: usize> {
    settings: StageQpSettings,
    riccati: Riccati<NX, NU>,
    bounds: Vec<[Held; NU]>,
    rows: Vec<Vec<Held>>,
    states: Vec<SVector<f64, NX>>,
    inputs: Vec<SVector<f64, NU>>,
    trial_states: Vec<SVector<f64, NX>>,
    trial_inputs: Vec<SVector<f64, NU>>,
    stiffening: f64,
}

impl<const NX: usize, const NU: usize> StageQpSolver<NX, NU> {
    /// A solver for programs of this size.
    pub fn new(intervals: usize, max_constraints: usize, settings: StageQpSettings) -> Self {
        Self {
            settings,
            riccati: Riccati::new(intervals),
            bounds: vec![[Held::default(); NU]; intervals],
            rows: (0..=intervals)
                .map(|_| Vec::with_capacity(max_constraints))
                .collect(),
            states: vec![SVector::zeros(); intervals + 1],
            inputs: vec![SVector::zeros(); intervals],
            trial_states: vec![SVector::zeros(); intervals + 1],
            trial_inputs: vec![SVector::zeros(); intervals],
            stiffening: 1.0,
        }
    }

    /// The states x_0..x_N of the last solution.
    pub fn states(&self) -> &[SVector<f64, NX>] {
        &self.states
    }

    /// The inputs u_0..u_{N-1} of the last solution.
    pub fn inputs(&self) -> &[SVector<f64, NU>] {
        &self.inputs
    }

    /// The last recursion, with the feedback that belongs to the last solution.
    pub fn riccati(&self) -> &Riccati<NX, NU> {
        &self.riccati
    }

    /// Multiplier of the bounds of input `i` in interval `k`; positive at the upper bound.
    pub fn bound_multiplier(&self, k: usize, i: usize) -> f64 {
        self.bounds[k][i].response.multiplier
    }

    /// Multiplier of softened constraint `i` at point `k`; not negative.
    pub fn constraint_multiplier(&self, k: usize, i: usize) -> f64 {
        self.rows[k][i].response.multiplier
    }

    /// What the solution costs too little because inputs exceed their bounds by what the tolerance
    /// allows.
    pub(super) fn saved_beyond_bounds(&self, qp: &StageQp<NX, NU>) -> f64 {
        let mut saved = 0.0;
        for (held, (lower, upper)) in self.bounds.iter().zip(&qp.bounds) {
            for i in 0..NU {
                let h = &held[i];
                let excess = (h.value - upper[i]).max(lower[i] - h.value).max(0.0);
                saved += h.response.multiplier.abs() * excess;
            }
        }
        saved
    }

    /// Forgets the multipliers.
    pub fn forget(&mut self) {
        for held in self.all_held_mut() {
            *held = Held::default();
        }
    }

    /// Moves the multipliers one interval earlier; the last are repeated.
    pub fn shift(&mut self) {
        let last = self.bounds.len();
        self.bounds.copy_within(1.., 0);
        for k in 1..last {
            let (now, later) = self.rows.split_at_mut(k + 1);
            now[k].clone_from(&later[0]);
        }
    }

    /// Solves `qp`, starting from the multipliers of the last solve.
    ///
    /// The point lands in [`Self::states`] and [`Self::inputs`].
    pub fn solve(&mut self, qp: &StageQp<NX, NU>) -> StageQpReport {
        self.solve_within(qp, self.settings.max_iterations)
    }

    /// As [`Self::solve`], in at most so many Newton steps; one is always taken.
    pub fn solve_within(&mut self, qp: &StageQp<NX, NU>, newton_steps: u32) -> StageQpReport {
        let most = newton_steps.min(self.settings.max_iterations);
        self.start(qp);
        let (mut iterations, mut factorisations) = (1, 1);
        self.factor(qp, qp.intervals());
        self.newton(qp);
        self.adopt();
        self.set_values(qp);
        let mut stale = self.respond(qp);
        let mut settled = stale.is_none();
        let mut last_residual = f64::INFINITY;
        let exit = loop {
            if !self.is_finite() {
                break StageQpExit::NotFinite;
            }
            let residual = self.residual();
            if settled {
                if residual <= self.settings.tolerance {
                    break StageQpExit::Converged;
                }
                if residual > last_residual / STIFFEN {
                    self.stiffen();
                }
                last_residual = residual;
                self.take_multipliers();
                stale = stale.max(self.respond(qp));
            }
            if iterations >= most {
                break StageQpExit::IterationLimit { residual };
            }
            if let Some(point) = stale {
                self.factor(qp, point);
                factorisations += 1;
            }
            self.newton(qp);
            iterations += 1;
            let (step, largest) = self.advance(qp);
            stale = self.respond(qp);
            let tiny = largest <= STEP_SHARE * self.settings.tolerance;
            settled = tiny || (step >= 1.0 && stale.is_none());
        };
        if exit == StageQpExit::NotFinite {
            self.forget();
        } else {
            self.take_multipliers();
        }
        StageQpReport {
            exit,
            iterations,
            factorisations,
        }
    }

    /// The pieces on which the multipliers known so far lie.
    fn start(&mut self, qp: &StageQp<NX, NU>) {
        self.resize(qp.intervals());
        self.stiffening = 1.0;
        let stiffness = self.settings.bound_stiffness * largest_input_curvature(qp);
        for (held, bounds) in self.bounds.iter_mut().zip(&qp.bounds) {
            for i in 0..NU {
                let h = &mut held[i];
                (h.stiffness, h.value) = (stiffness, 0.0);
                h.response = bound_of(bounds.0[i], bounds.1[i], stiffness, h.prior);
            }
        }
        for (rows, constraints) in self.rows.iter_mut().zip(&qp.constraints).skip(1) {
            rows.resize(constraints.len(), Held::default());
            for (held, row) in rows.iter_mut().zip(constraints) {
                let weight = row.linear + 2.0 * row.quadratic;
                held.stiffness = (self.settings.kink_stiffness * weight).max(f64::MIN_POSITIVE);
                held.value = row.value;
                held.response = soft_of(
                    row.linear,
                    row.quadratic,
                    held.stiffness,
                    held.prior,
                    row.value,
                );
            }
        }
    }

    /// Fits the memory to the horizon; allocates only when its length is another.
    fn resize(&mut self, intervals: usize) {
        if self.riccati.intervals() == intervals {
            return;
        }
        let room = self.rows.first().map_or(0, Vec::capacity);
        *self = Self::new(intervals, room, self.settings);
    }

    /// Sets multipliers and curvatures of all pieces; the last point where a piece changed.
    fn respond(&mut self, qp: &StageQp<NX, NU>) -> Option<usize> {
        let mut changed = None;
        let mut set = |point: usize, held: &mut Held, response: Response| {
            if !held.response.is_alike(&response) {
                changed = changed.max(Some(point));
            }
            held.response = response;
        };
        let bounds = self.bounds.iter_mut().zip(&qp.bounds);
        for (k, (held, (lower, upper))) in bounds.enumerate() {
            for i in 0..NU {
                let h = &mut held[i];
                let response = bound(lower[i], upper[i], h.stiffness, h.prior, h.value);
                set(k, h, response);
            }
        }
        let rows = self.rows.iter_mut().zip(&qp.constraints);
        for (k, (rows, constraints)) in rows.enumerate().skip(1) {
            for (h, row) in rows.iter_mut().zip(constraints) {
                let response = soft(row.linear, row.quadratic, h.stiffness, h.prior, h.value);
                set(k, h, response);
            }
        }
        changed
    }

    /// Factors what changed up to a point; nothing may have changed beyond it.
    fn factor(&mut self, qp: &StageQp<NX, NU>, point: usize) {
        let (rows, bounds) = (&self.rows, &self.bounds);
        self.riccati.refactor(
            point,
            &qp.steps,
            &qp.costs,
            |k, xx| {
                for (held, row) in rows[k].iter().zip(&qp.constraints[k]) {
                    if held.response.curvature > 0.0 {
                        add_outer(xx, held.response.curvature, &row.gradient);
                    }
                }
            },
            |k| SVector::from_fn(|i, _| bounds[k][i].response.curvature),
        );
    }

    /// The minimum of the quadratic pieces, into the trial point.
    fn newton(&mut self, qp: &StageQp<NX, NU>) {
        let (rows, bounds) = (&self.rows, &self.bounds);
        self.riccati.solve(
            &qp.steps,
            |k| {
                let mut slope = qp.costs[k].x;
                for (held, row) in rows[k].iter().zip(&qp.constraints[k]) {
                    if held.response.piece != Piece::Off {
                        let push = held.response.multiplier
                            + held.response.curvature * (held.value - row.value);
                        slope -= row.gradient * push;
                    }
                }
                slope
            },
            |k| {
                let push = |i: usize, _| {
                    let held = &bounds[k][i];
                    held.response.multiplier - held.response.curvature * held.value
                };
                qp.costs[k].u + SVector::from_fn(push)
            },
            &qp.initial,
            &mut self.trial_states,
            &mut self.trial_inputs,
        );
    }

    /// Takes the trial point as it is.
    fn adopt(&mut self) {
        std::mem::swap(&mut self.states, &mut self.trial_states);
        std::mem::swap(&mut self.inputs, &mut self.trial_inputs);
    }

    fn set_values(&mut self, qp: &StageQp<NX, NU>) {
        for (held, input) in self.bounds.iter_mut().zip(&self.inputs) {
            for i in 0..NU {
                held[i].value = input[i];
            }
        }
        for k in 1..self.states.len() {
            let x = &self.states[k].data.0[0];
            for (held, row) in self.rows[k].iter_mut().zip(&qp.constraints[k]) {
                held.value = row.value + dot(&row.gradient.data.0[0], x);
            }
        }
    }

    /// Moves towards the trial point, to the least value of the augmented Lagrangian on the way.
    /// Returns the share of the step and the largest change of an input or a constraint.
    fn advance(&mut self, qp: &StageQp<NX, NU>) -> (f64, f64) {
        let largest = self.set_changes(qp);
        let step = if self.pieces_hold(qp) {
            1.0
        } else {
            let (slope, curvature) = self.cost_along(qp);
            least(|t| slope + t * curvature + self.push_along(qp, t))
        };
        if step >= 1.0 {
            self.adopt();
            self.set_values(qp);
        } else {
            for (x, trial) in self.states.iter_mut().zip(&self.trial_states) {
                *x += (trial - *x) * step;
            }
            for (u, trial) in self.inputs.iter_mut().zip(&self.trial_inputs) {
                *u += (trial - *u) * step;
            }
            for held in self.all_held_mut() {
                held.value += step * held.change;
            }
        }
        (step, step * largest)
    }

    fn set_changes(&mut self, qp: &StageQp<NX, NU>) -> f64 {
        let mut largest = 0.0_f64;
        for (held, input) in self.bounds.iter_mut().zip(&self.trial_inputs) {
            for i in 0..NU {
                held[i].change = input[i] - held[i].value;
                largest = largest.max(held[i].change.abs());
            }
        }
        for k in 1..self.trial_states.len() {
            let x = &self.trial_states[k].data.0[0];
            for (held, row) in self.rows[k].iter_mut().zip(&qp.constraints[k]) {
                held.change = row.value + dot(&row.gradient.data.0[0], x) - held.value;
                largest = largest.max(held.change.abs());
            }
        }
        largest
    }

    /// Whether every piece at the trial point is the one that the Newton step assumed.
    fn pieces_hold(&self, qp: &StageQp<NX, NU>) -> bool {
        let inputs = self.bounds.iter().zip(&qp.bounds).all(|(held, bounds)| {
            (0..NU).all(|i| {
                let (h, value) = (&held[i], held[i].value + held[i].change);
                let response = bound(bounds.0[i], bounds.1[i], h.stiffness, h.prior, value);
                response.is_alike(&h.response)
            })
        });
        inputs
            && self.soft_rows(qp).all(|(h, row)| {
                let value = h.value + h.change;
                let response = soft(row.linear, row.quadratic, h.stiffness, h.prior, value);
                response.is_alike(&h.response)
            })
    }

    fn soft_rows<'a>(
        &'a self,
        qp: &'a StageQp<NX, NU>,
    ) -> impl Iterator<Item = (&'a Held, &'a super::SoftConstraint<NX>)> {
        let points = self.rows.iter().zip(&qp.constraints).skip(1);
        points.flat_map(|(rows, constraints)| rows.iter().zip(constraints))
    }

    /// Slope at the start and curvature of the quadratic costs along the step.
    fn cost_along(&self, qp: &StageQp<NX, NU>) -> (f64, f64) {
        let (mut slope, mut curvature) = (0.0, 0.0);
        for (k, cost) in qp.costs.iter().enumerate() {
            let dx = self.trial_states[k] - self.states[k];
            let mut bent = cost.xx * dx;
            if let Some(u) = self.inputs.get(k) {
                let du = self.trial_inputs[k] - u;
                let bent_u = cost.ux * dx + cost.uu * du;
                bent += cost.ux.tr_mul(&du);
                curvature += du.dot(&bent_u);
                slope += cost.u.dot(&du) + u.dot(&bent_u);
            }
            curvature += dx.dot(&bent);
            slope += cost.x.dot(&dx) + self.states[k].dot(&bent);
        }
        (slope, curvature)
    }

    /// Slope of bounds and penalties at share `t` of the step.
    fn push_along(&self, qp: &StageQp<NX, NU>, t: f64) -> f64 {
        let mut slope = 0.0;
        for (held, bounds) in self.bounds.iter().zip(&qp.bounds) {
            for i in 0..NU {
                let h = &held[i];
                let value = h.value + t * h.change;
                let push = bound(bounds.0[i], bounds.1[i], h.stiffness, h.prior, value);
                slope += push.multiplier * h.change;
            }
        }
        for (h, row) in self.soft_rows(qp) {
            let value = h.value + t * h.change;
            let push = soft(row.linear, row.quadratic, h.stiffness, h.prior, value);
            slope -= push.multiplier * h.change;
        }
        slope
    }

    /// What bounds are exceeded and kinks missed by.
    fn residual(&self) -> f64 {
        let off = |h: &Held| (h.response.multiplier - h.prior).abs() / h.stiffness;
        let rows = self.rows.iter().skip(1).flatten();
        let all = self.bounds.iter().flatten().chain(rows);
        all.map(off).fold(0.0, f64::max)
    }

    fn take_multipliers(&mut self) {
        for held in self.all_held_mut() {
            held.prior = held.response.multiplier;
        }
    }

    fn stiffen(&mut self) {
        if self.stiffening < MAX_STIFFENING {
            self.stiffening *= STIFFEN;
            for held in self.all_held_mut() {
                held.stiffness *= STIFFEN;
            }
        }
    }

    fn all_held_mut(&mut self) -> impl Iterator<Item = &mut Held> {
        let bounds = self.bounds.iter_mut().flatten();
        bounds.chain(self.rows.iter_mut().skip(1).flatten())
    }

    fn is_finite(&self) -> bool {
        let states: f64 = self.states.iter().map(|x| x.sum()).sum();
        let inputs: f64 = self.inputs.iter().map(|u| u.sum()).sum();
        (states + inputs).is_finite()
    }
}

/// The largest diagonal entry of the curvatures in the inputs.
fn largest_input_curvature<const NX: usize, const NU: usize>(qp: &StageQp<NX, NU>) -> f64 {
    let costs = &qp.costs[..qp.intervals()];
    let entries = costs
        .iter()
        .flat_map(|c| (0..NU).map(move |i| c.uu[(i, i)]));
    let largest = entries.fold(0.0, f64::max);
    if largest > 0.0 { largest } else { 1.0 }
}
