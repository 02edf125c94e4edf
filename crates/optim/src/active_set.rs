//! The dual active-set method of Goldfarb and Idnani (1983) for strictly convex programs.
//!
//! It starts at the unconstrained minimum and makes violated constraints active one at a time,
//! keeping the point optimal for the active ones, so that no feasible start is needed. The page
//! `docs/derivations/quadratic-program.md` gives the steps.

use nalgebra::{DMatrix, DVector};

use crate::factor::{ActiveFactor, ROUNDING};
use crate::{Exit, LinearRows, QuadraticProgram};

/// Settings of the solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActiveSetSettings {
    /// Greatest number of constraints that are added or dropped.
    pub max_iterations: usize,
    /// Violation that counts as none, relative to `|row| + |bound|`.
    pub feasibility_tolerance: f64,
}

impl Default for ActiveSetSettings {
    fn default() -> Self {
        Self {
            max_iterations: 1000,
            feasibility_tolerance: 1e-10,
        }
    }
}

/// How a solve went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// How it ended.
    pub exit: Exit,
    /// Constraints added or dropped.
    pub iterations: usize,
}

/// A constraint of the program.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Source {
    Equality(usize),
    Inequality(usize),
}

/// A constraint that holds as the equality `sign * row . x = sign * bound`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Active {
    source: Source,
    sign: f64,
    multiplier: f64,
    /// `|row| + |bound|`, to which its violation is compared.
    scale: f64,
}

/// Solver with its workspace; memory is kept from solve to solve.
#[derive(Clone, Debug)]
pub struct ActiveSetSolver {
    settings: ActiveSetSettings,
    factor: ActiveFactor,
    x: DVector<f64>,
    active: Vec<Active>,
    /// Inequalities that the active constraints imply up to rounding.
    implied: Vec<usize>,
    normal: DVector<f64>,
    primal_step: DVector<f64>,
    dual_step: DVector<f64>,
    equality_multipliers: DVector<f64>,
    inequality_multipliers: DVector<f64>,
}

/// What became of an attempt to make one constraint active.
enum Attempt {
    Active,
    /// Linearly dependent on active constraints that already imply it.
    Redundant,
    Impossible,
    OutOfIterations,
}

impl ActiveSetSolver {
    /// A solver without memory.
    pub fn new(settings: ActiveSetSettings) -> Self {
        Self {
            settings,
            factor: ActiveFactor::new(),
            x: DVector::zeros(0),
            active: Vec::new(),
            implied: Vec::new(),
            normal: DVector::zeros(0),
            primal_step: DVector::zeros(0),
            dual_step: DVector::zeros(0),
            equality_multipliers: DVector::zeros(0),
            inequality_multipliers: DVector::zeros(0),
        }
    }

    /// The point found by the last solve.
    pub fn x(&self) -> &DVector<f64> {
        &self.x
    }

    /// Multipliers `y` of the equalities, see [`crate::KktResidual`].
    pub fn equality_multipliers(&self) -> &DVector<f64> {
        &self.equality_multipliers
    }

    /// Multipliers `z >= 0` of the inequalities, see [`crate::KktResidual`].
    pub fn inequality_multipliers(&self) -> &DVector<f64> {
        &self.inequality_multipliers
    }

    /// Solves a program.
    pub fn solve(&mut self, program: &QuadraticProgram) -> Report {
        if let Err(exit) = self.prepare(&program.hessian) {
            return Report {
                exit,
                iterations: 0,
            };
        }
        self.solve_prepared(&program.gradient, &program.equality, &program.inequality)
    }

    /// Factors a Hessian for several solves with [`Self::solve_prepared`].
    ///
    /// # Errors
    /// [`Exit::NotConvex`], [`Exit::NotFinite`] or [`Exit::ShapeMismatch`].
    pub fn prepare(&mut self, hessian: &DMatrix<f64>) -> Result<(), Exit> {
        if !hessian.is_square() {
            return Err(Exit::ShapeMismatch);
        }
        if !hessian.iter().all(|v| v.is_finite()) {
            return Err(Exit::NotFinite);
        }
        self.factor.prepare(hessian).ok_or(Exit::NotConvex)?;
        let n = hessian.nrows();
        for vector in [
            &mut self.x,
            &mut self.normal,
            &mut self.primal_step,
            &mut self.dual_step,
        ] {
            vector.resize_vertically_mut(n, 0.0);
        }
        Ok(())
    }

    /// Solves with the Hessian that was last prepared.
    pub fn solve_prepared(
        &mut self,
        gradient: &DVector<f64>,
        equality: &LinearRows,
        inequality: &LinearRows,
    ) -> Report {
        let n = self.factor.variables();
        let exit = if gradient.len() != n || !equality.fits(n) || !inequality.fits(n) {
            Exit::ShapeMismatch
        } else if !(gradient.iter().all(|v| v.is_finite())
            && equality.is_finite()
            && inequality.is_finite())
        {
            Exit::NotFinite
        } else {
            return self.run(gradient, equality, inequality);
        };
        Report {
            exit,
            iterations: 0,
        }
    }

    fn run(
        &mut self,
        gradient: &DVector<f64>,
        equality: &LinearRows,
        inequality: &LinearRows,
    ) -> Report {
        self.factor.reset();
        self.active.clear();
        self.implied.clear();
        self.x = self.factor.minimiser(gradient);
        let mut left = self.settings.max_iterations;
        let exit = self
            .meet_equalities(equality, inequality, &mut left)
            .and_then(|()| self.meet_inequalities(equality, inequality, &mut left))
            .err()
            .unwrap_or(Exit::Converged);
        self.store_multipliers(equality.len(), inequality.len());
        Report {
            exit,
            iterations: self.settings.max_iterations - left,
        }
    }

    fn meet_equalities(
        &mut self,
        equality: &LinearRows,
        inequality: &LinearRows,
        left: &mut usize,
    ) -> Result<(), Exit> {
        for row in 0..equality.len() {
            let source = Source::Equality(row);
            self.attempt(source, equality, inequality, left)?;
        }
        Ok(())
    }

    fn meet_inequalities(
        &mut self,
        equality: &LinearRows,
        inequality: &LinearRows,
        left: &mut usize,
    ) -> Result<(), Exit> {
        while let Some(row) = self.most_violated(inequality) {
            let source = Source::Inequality(row);
            self.attempt(source, equality, inequality, left)?;
        }
        Ok(())
    }

    /// Makes a constraint active and says why if that is not possible.
    fn attempt(
        &mut self,
        source: Source,
        equality: &LinearRows,
        inequality: &LinearRows,
        left: &mut usize,
    ) -> Result<(), Exit> {
        let rows = match source {
            Source::Equality(_) => equality,
            Source::Inequality(_) => inequality,
        };
        match self.activate(source, rows, left) {
            Attempt::Active => Ok(()),
            Attempt::Redundant => {
                if let Source::Inequality(row) = source {
                    self.implied.push(row);
                }
                Ok(())
            }
            Attempt::Impossible => Err(Exit::Infeasible {
                violation: self.violation(source, rows),
            }),
            Attempt::OutOfIterations => Err(Exit::IterationLimit {
                violation: self.worst_violation(equality, inequality),
            }),
        }
    }

    /// Step 2 of the method: partial steps drop constraints that block, a full step adds.
    fn activate(&mut self, source: Source, rows: &LinearRows, left: &mut usize) -> Attempt {
        let (row, sign) = self.orient(source, rows);
        self.normal.tr_copy_from(&rows.matrix.row(row));
        self.normal *= sign;
        let bound = sign * rows.bound[row];
        let scale = scale(self.normal.norm(), bound);
        let mut multiplier = 0.0;
        loop {
            if *left == 0 {
                return Attempt::OutOfIterations;
            }
            *left -= 1;
            let curvature =
                self.factor
                    .directions(&self.normal, &mut self.primal_step, &mut self.dual_step);
            let slack = self.normal.dot(&self.x) - bound;
            // After a partial step the normal is independent, and its multiplier must not be lost.
            if curvature == 0.0 && multiplier == 0.0 && self.is_implied(slack, scale) {
                return Attempt::Redundant;
            }
            let blocking = self.blocking();
            let dual_limit = blocking.map_or(f64::INFINITY, |(_, step)| step);
            let full = if curvature > 0.0 {
                -slack / curvature
            } else {
                f64::INFINITY
            };
            let step = full.min(dual_limit);
            if step.is_infinite() {
                return Attempt::Impossible;
            }
            for (i, active) in self.active.iter_mut().enumerate() {
                active.multiplier -= step * self.dual_step[i];
            }
            multiplier += step;
            if curvature > 0.0 {
                self.x.axpy(step, &self.primal_step, 1.0);
            }
            if full <= dual_limit {
                self.factor.add();
                self.active.push(Active {
                    source,
                    sign,
                    multiplier,
                    scale,
                });
                return Attempt::Active;
            }
            if let Some((place, _)) = blocking {
                self.factor.drop(place);
                self.active.remove(place);
                self.implied.clear();
            }
        }
    }

    /// Row and sign with which a violated constraint reads `normal . x >= bound`.
    fn orient(&self, source: Source, rows: &LinearRows) -> (usize, f64) {
        match source {
            Source::Inequality(row) => (row, -1.0),
            Source::Equality(row) => {
                let excess = row_dot(&rows.matrix, row, &self.x) - rows.bound[row];
                (row, if excess > 0.0 { -1.0 } else { 1.0 })
            }
        }
    }

    /// The active inequality whose multiplier first reaches zero, and the step at which it does.
    fn blocking(&self) -> Option<(usize, f64)> {
        let mut first: Option<(usize, f64)> = None;
        for (place, active) in self.active.iter().enumerate() {
            let rate = self.dual_step[place];
            if matches!(active.source, Source::Inequality(_)) && rate > 0.0 {
                let step = (active.multiplier / rate).max(0.0);
                if first.is_none_or(|(_, best)| step < best) {
                    first = Some((place, step));
                }
            }
        }
        first
    }

    /// Whether a constraint whose normal is a sum of active ones holds: its slack is the same sum of
    /// theirs, which are zero up to rounding.
    fn is_implied(&self, slack: f64, scale: f64) -> bool {
        let rates = self.dual_step.iter();
        let of_active = |(active, rate): (&Active, &f64)| rate.abs() * active.scale;
        let reach: f64 = self.active.iter().zip(rates).map(of_active).sum();
        slack.abs() <= self.settings.feasibility_tolerance * scale + ROUNDING * reach
    }

    /// The inequality with the greatest violation that is not active yet.
    fn most_violated(&self, inequality: &LinearRows) -> Option<usize> {
        let mut worst = None;
        let mut most = self.settings.feasibility_tolerance;
        for row in 0..inequality.len() {
            let bound = inequality.bound[row];
            let scale = scale(inequality.matrix.row(row).norm(), bound);
            let violation = (row_dot(&inequality.matrix, row, &self.x) - bound) / scale;
            if violation > most && !self.is_held(row) {
                most = violation;
                worst = Some(row);
            }
        }
        worst
    }

    /// Whether an inequality is active, or implied by those that are.
    fn is_held(&self, row: usize) -> bool {
        let source = Source::Inequality(row);
        self.active.iter().any(|active| active.source == source) || self.implied.contains(&row)
    }

    /// Violation divided by the norm of the row.
    fn violation(&self, source: Source, rows: &LinearRows) -> f64 {
        let (row, is_equality) = match source {
            Source::Equality(row) => (row, true),
            Source::Inequality(row) => (row, false),
        };
        let excess = row_dot(&rows.matrix, row, &self.x) - rows.bound[row];
        let amount = if is_equality {
            excess.abs()
        } else {
            excess.max(0.0)
        };
        amount / rows.matrix.row(row).norm().max(1e-300)
    }

    fn worst_violation(&self, equality: &LinearRows, inequality: &LinearRows) -> f64 {
        let equalities =
            (0..equality.len()).map(|row| self.violation(Source::Equality(row), equality));
        let inequalities =
            (0..inequality.len()).map(|row| self.violation(Source::Inequality(row), inequality));
        equalities.chain(inequalities).fold(0.0, f64::max)
    }

    /// The method holds `G x + g = sum multiplier * sign * row`; the conditions of optimality are
    /// written with the opposite sign.
    fn store_multipliers(&mut self, equalities: usize, inequalities: usize) {
        self.equality_multipliers
            .resize_vertically_mut(equalities, 0.0);
        self.inequality_multipliers
            .resize_vertically_mut(inequalities, 0.0);
        self.equality_multipliers.fill(0.0);
        self.inequality_multipliers.fill(0.0);
        for active in &self.active {
            let multiplier = -active.sign * active.multiplier;
            match active.source {
                Source::Equality(row) => self.equality_multipliers[row] = multiplier,
                Source::Inequality(row) => self.inequality_multipliers[row] = multiplier,
            }
        }
    }
}

/// What a violation is compared to: the length of the row and of what it is set against.
fn scale(norm: f64, bound: f64) -> f64 {
    (norm + bound.abs()).max(1e-300)
}

fn row_dot(matrix: &DMatrix<f64>, row: usize, x: &DVector<f64>) -> f64 {
    matrix.row(row).tr_dot(x)
}
