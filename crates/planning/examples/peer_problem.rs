//! Solves the optimal control problems that `bench/peers/nmpc.sh` gives to other solvers as well.
//!
//! Reads problems as rows of comma-separated numbers from standard input, a header first: seed, step,
//! state (9), goal (3), yaw of the goal, then for each of the 26 points of the horizon and each of two
//! obstacles its centre (3) and the variances (3) of the vector from it to the vehicle. Writes a row for each
//! as soon as it is solved. Solves are warm started, each by the answer to the row before; step 0 starts
//! from standing still. The problem itself is described in `bench/peers/nmpc/problem.py`.

use std::error::Error;
use std::io::{BufRead, Write};

use alula_optim::ocp::{OcpExit, OcpReport, OcpSettings, OcpSolver};
use alula_planning::mpc::{
    Input, Keepout, NU, NX, Penalty, Potential, Problem, Sideways, Stage, State, TiltDynamics,
    TiltModel, Volume,
};
use nalgebra::{Matrix3, Vector3};
use rustix::time::{ClockId, clock_gettime};

const INTERVALS: usize = 25;
const INTERVAL_S: f64 = 0.06;
const OBSTACLES: usize = 2;
/// Numbers of an obstacle at a point of the horizon.
const OBSTACLE_NUMBERS: usize = 6;
/// Numbers of a row before those of the obstacles.
const HEAD_NUMBERS: usize = 2 + NX + 3 + 1;
const ROW_NUMBERS: usize = HEAD_NUMBERS + (INTERVALS + 1) * OBSTACLES * OBSTACLE_NUMBERS;

/// Semi-axes of vehicle and obstacle together, m.
const SEMI_AXES_M: [f64; 3] = [0.7, 0.7, 1.3];
/// Quantile of the standard normal distribution for a chance of collision of 0.03.
const QUANTILE: f64 = 1.880_793_608_151_250_8;
/// Constraints at a point: obstacles, and both sides of the velocity along three axes.
const CONSTRAINTS: usize = OBSTACLES + 6;

/// One problem.
struct Row {
    seed: i64,
    step: i64,
    numbers: Vec<f64>,
}

impl Row {
    fn parse(line: &str) -> Result<Self, Box<dyn Error>> {
        let numbers = line
            .trim()
            .split(',')
            .map(str::parse)
            .collect::<Result<Vec<f64>, _>>()?;
        if numbers.len() != ROW_NUMBERS {
            return Err(format!("a row has {} numbers, not {ROW_NUMBERS}", numbers.len()).into());
        }
        Ok(Self {
            seed: numbers[0] as i64,
            step: numbers[1] as i64,
            numbers,
        })
    }

    fn state(&self) -> State {
        State::from_column_slice(&self.numbers[2..2 + NX])
    }

    fn vector(&self, start: usize) -> Vector3<f64> {
        Vector3::from_column_slice(&self.numbers[start..start + 3])
    }

    fn keepout(&self, k: usize, obstacle: usize) -> Keepout {
        let start = HEAD_NUMBERS + (k * OBSTACLES + obstacle) * OBSTACLE_NUMBERS;
        let axes = Vector3::from(SEMI_AXES_M);
        Keepout {
            centre: self.vector(start),
            covariance: Matrix3::from_diagonal(&self.vector(start + 3)),
            // Distances without unit, as the other solvers' problem has them.
            volume: Volume::Ellipsoid {
                unit_from_world: Matrix3::from_diagonal(&axes.map(|a| 1.0 / a)),
                scale_m: 1.0,
            },
        }
    }

    /// States this row's problem.
    fn state_in(&self, problem: &mut Problem) {
        let goal = self.vector(2 + NX);
        let yaw_rad = self.numbers[2 + NX + 3];
        let length2 = (goal - self.state().fixed_rows::<3>(0))
            .norm_squared()
            .max(1.0);
        for (k, stage) in problem.stages.iter_mut().enumerate() {
            let is_last = k == INTERVALS;
            let (goal_weight, yaw_weight, nearness) = if is_last {
                (8.0, 0.5, 1.2)
            } else {
                (0.01, 0.025, 1.0)
            };
            stage.target = goal;
            stage.position_weight = Vector3::repeat(goal_weight / length2);
            stage.velocity_weight = Vector3::repeat(0.005);
            stage.yaw_rad = yaw_rad;
            stage.yaw_weight = yaw_weight;
            stage.potential_weight = nearness;
            stage.keepouts.clear();
            stage
                .keepouts
                .extend((0..OBSTACLES).map(|o| self.keepout(k, o)));
        }
    }
}

/// The problem without what a row says.
fn blank_problem() -> Result<Problem, Box<dyn Error>> {
    let dynamics = TiltDynamics::new(&TiltModel::bebop(), INTERVAL_S)?;
    let tilt = 12.0_f64.to_radians();
    let penalty = Penalty {
        linear: 50.0,
        quadratic: 200.0,
    };
    Ok(Problem {
        dynamics: dynamics.with(9.81, Sideways::Decoupled),
        input_limit: Input::new(tilt, tilt, 1.0, 90.0_f64.to_radians()),
        input_weight: 0.1,
        potential: Potential {
            slope_1_m: 10.0,
            buffer_m: 0.4,
        },
        quantile: QUANTILE,
        collision: penalty,
        velocity_bound: Some((Vector3::new(2.0, 2.0, 1.0), penalty)),
        height_band: None,
        view: None,
        stages: vec![Stage::with_capacity(OBSTACLES); INTERVALS + 1],
    })
}

/// CPU time of this thread.
fn cpu_us() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e6 + time.tv_nsec as f64 * 1e-3
}

fn exit_name(exit: OcpExit) -> &'static str {
    match exit {
        OcpExit::Converged => "converged",
        OcpExit::IterationLimit => "iteration_limit",
        OcpExit::NoProgress { .. } => "no_progress",
        OcpExit::NotFinite => "not_finite",
    }
}

/// First row of the answers: after the exit follow the inputs of all intervals.
fn header() -> String {
    let mut names = String::from("seed,step,u0_roll,u0_pitch,u0_climb,u0_yaw_rate,");
    names += "cost,sqp_iterations,qp_iterations,cpu_us,exit";
    for k in 0..INTERVALS {
        for i in 0..NU {
            names += &format!(",u{k}_{i}");
        }
    }
    names
}

fn answer(row: &Row, report: &OcpReport, inputs: &[Input], cpu_us: f64) -> String {
    let mut numbers = format!("{},{}", row.seed, row.step);
    for u in inputs[0].iter() {
        numbers += &format!(",{u}");
    }
    numbers += &format!(
        ",{},{},{},{cpu_us},{}",
        report.cost,
        report.iterations,
        report.qp_iterations,
        exit_name(report.exit)
    );
    for u in inputs.iter().flat_map(|u| u.iter()) {
        numbers += &format!(",{u}");
    }
    numbers
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut problem = blank_problem()?;
    let mut solver = OcpSolver::<NX, NU>::new(INTERVALS, CONSTRAINTS, OcpSettings::default());
    let mut out = std::io::stdout().lock();
    for (number, line) in std::io::stdin().lock().lines().enumerate() {
        if number == 0 {
            writeln!(out, "{}", header())?;
            out.flush()?;
            continue;
        }
        let row = Row::parse(&line?)?;
        row.state_in(&mut problem);
        let start = cpu_us();
        if row.step == 0 {
            solver.forget();
            solver.set_guess(&[row.state(); INTERVALS + 1], &[Input::zeros(); INTERVALS]);
        } else {
            solver.shift();
        }
        let report = solver.solve(&problem, &row.state());
        let cpu_us = cpu_us() - start;
        writeln!(out, "{}", answer(&row, &report, solver.inputs(), cpu_us))?;
        out.flush()?;
    }
    Ok(())
}
