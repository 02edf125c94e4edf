//! Time of one step of the stack and of its parts after estimation, over the flight of the
//! first flight. The budget of a step is 50 us; `docs/budgets.md` has the others.
//!
//! Every sample of `stack_step` is another step of one flight, so `slowest` is the worst step that
//! occurred. The table at the end splits the steps of a whole flight into stages and tells slow
//! steps from interruptions.

// A benchmark of a flight that fails should stop, and what it finds it prints.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

#[path = "../../../tests/percentile.rs"]
mod percentile;
#[path = "../tests/support/mod.rs"]
mod support;

use std::sync::OnceLock;
use std::time::Instant;

use alula_control::geometric::{BodyFacts, GeometricController};
use alula_control::modes::{FlightModes, Progress, Situation};
use alula_safety::{Guard, GuardInput, GuardVehicle};
use alula_stack::{Stack, Stage};
use divan::{Bencher, black_box};
use percentile::percentile;
use support::{RATE_HZ, Step, first_step_of_waypoints, replayed, stack_config};

/// Steps that follow waypoints and are measured: 20 s.
const STEPS: u32 = 20 * RATE_HZ as u32;

/// Calls in a sample of a part, which is short beside a reading of the clock.
const CALLS: u32 = 10;

/// Replays of the flight from which the system's interruptions are told.
const REPLAYS: usize = 10;

fn main() {
    println!("budget of `stack_step`: 50 us, planning aside; see docs/budgets.md");
    divan::main();
    print_stages();
}

/// The recorded flight from the moment at which the vehicle follows its waypoints.
fn waypoints() -> &'static [Step] {
    let steps = flight();
    let start = first_step_of_waypoints(steps);
    &steps[start..start + STEPS as usize]
}

fn flight() -> &'static [Step] {
    static FLIGHT: OnceLock<Vec<Step>> = OnceLock::new();
    FLIGHT.get_or_init(support::flight)
}

#[divan::bench(sample_count = STEPS, sample_size = 1)]
fn stack_step(bencher: Bencher) {
    let steps = flight();
    let start = first_step_of_waypoints(steps);
    let mut stack = replayed(steps, start);
    let mut rest = steps[start..].iter();
    bencher.bench_local(|| {
        let step = rest.next().unwrap();
        black_box(stack.update(&step.batch));
    });
}

#[divan::bench(sample_count = STEPS / CALLS, sample_size = CALLS)]
fn geometric_controller(bencher: Bencher) {
    let config = stack_config();
    let body = BodyFacts {
        mass_kg: config.body.mass_kg,
        inertia_kg_m2: config.body.inertia_kg_m2,
    };
    let mut controller = GeometricController::new(&config.control, &body).unwrap();
    let mut steps = waypoints().iter().cycle();
    bencher.bench_local(|| {
        let output = &steps.next().unwrap().output;
        controller.update(&output.state, output.reference.as_ref().unwrap(), 0.004)
    });
}

#[divan::bench(sample_count = STEPS / CALLS, sample_size = CALLS)]
fn flight_modes(bencher: Bencher) {
    let mut modes = FlightModes::new(&stack_config().modes).unwrap();
    let mut steps = flight().iter().cycle();
    bencher.bench_local(|| {
        let step = steps.next().unwrap();
        let situation = Situation {
            time: step.output.time,
            state: &step.output.state,
            height_above_ground_m: step.batch.infrared.last().map(|sample| sample.range_m),
            thrust_fraction: 0.5,
            trajectory: Progress::Running,
            guard: step.output.guard.fallback,
        };
        if let Some(intent) = &step.intent {
            modes.request(intent, &situation).ok();
        }
        modes.update(&situation)
    });
}

#[divan::bench(sample_count = STEPS / CALLS, sample_size = CALLS)]
fn guard(bencher: Bencher) {
    let config = stack_config();
    let vehicle = GuardVehicle {
        mass_kg: config.body.mass_kg,
        max_thrust_n: config.body.max_thrust_n,
    };
    let mut guard = Guard::new(&config.guard, &vehicle).unwrap();
    let mut protect = |step: &Step| {
        let input = GuardInput {
            batch: &step.batch,
            state: &step.output.state,
            mode: step.output.mode,
            requested: &step.output.requested,
        };
        guard.update(&input).fallback
    };
    // It has to have seen the ground and the take-off to be the guard of this flight.
    let start = first_step_of_waypoints(flight());
    for step in &flight()[..start] {
        protect(step);
    }
    let mut steps = flight()[start..].iter();
    bencher.bench_local(|| protect(steps.next().unwrap()));
}

/// Durations of the steps of a whole flight, us: each stage, then the whole.
type Durations = [Vec<f64>; Stage::ALL.len() + 1];

/// Prints how long each stage took in one replay of the flight, and the worst step of which every
/// replay took at least that long. Equal inputs make equal steps, so what is not in all of them
/// is the system's doing.
fn print_stages() {
    let runs: [Durations; REPLAYS] = std::array::from_fn(|_| timed_replay());
    println!("\n{} steps of a whole flight, us:", flight().len());
    let heads = ["median", "p99", "worst", "worst in all"];
    println!(
        "{:16}{:>10}{:>10}{:>10}{:>14}",
        "", heads[0], heads[1], heads[2], heads[3]
    );
    let names = Stage::ALL.iter().map(|stage| stage.name());
    for (row, name) in names.chain(["whole step"]).enumerate() {
        print_row(name, &runs, row, |_| true);
    }
    print_row("without planning", &runs, Stage::ALL.len(), |step| {
        !plans(step)
    });
}

fn timed_replay() -> Durations {
    let mut stack = Stack::new(&stack_config()).unwrap();
    // A vector that grows would be counted as part of a step.
    let mut durations_us: Durations = std::array::from_fn(|_| Vec::with_capacity(flight().len()));
    for step in flight() {
        if let Some(intent) = &step.intent {
            stack.request(intent.clone());
        }
        let start = Instant::now();
        let mut last = start;
        stack.update_watched(&step.batch, &mut |stage| {
            let now = Instant::now();
            durations_us[stage as usize].push((now - last).as_secs_f64() * 1e6);
            last = now;
        });
        durations_us[Stage::ALL.len()].push(start.elapsed().as_secs_f64() * 1e6);
    }
    durations_us
}

/// Whether a trajectory may be planned in a step: a request, or a change of mode.
fn plans(index: usize) -> bool {
    let steps = flight();
    let changes = index > 0 && steps[index - 1].output.mode != steps[index].output.mode;
    changes || steps[index].intent.is_some()
}

fn print_row(name: &str, runs: &[Durations], row: usize, counts: impl Fn(usize) -> bool) {
    let chosen: Vec<usize> = (0..flight().len()).filter(|&step| counts(step)).collect();
    let mut once_us: Vec<f64> = chosen.iter().map(|&step| runs[0][row][step]).collect();
    let [median, p99, worst] = [0.5, 0.99, 1.0].map(|share| percentile(&mut once_us, share));
    let least_us = |step: usize| {
        let durations_us = runs.iter().map(|run| run[row][step]);
        durations_us.fold(f64::INFINITY, f64::min)
    };
    let worst_in_all = chosen.iter().map(|&s| least_us(s)).fold(0.0, f64::max);
    println!("{name:16}{median:10.2}{p99:10.2}{worst:10.2}{worst_in_all:14.2}");
}
