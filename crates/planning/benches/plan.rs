//! Time to plan; the budget for ten waypoints is 5 ms on one core.

// A benchmark of a plan that fails should stop, and it prints its budget.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use alula_messages::Reference;
use alula_planning::{MinimumSnap, MinimumSnapConfig, MotionLimits, YawPolicy};
use nalgebra::Vector3;

fn main() {
    println!("budget of 10 waypoints: 5 ms; see docs/budgets.md");
    divan::main();
}

/// A winding course: legs of 3 to 6 m with turns of every size.
fn course(count: usize) -> Vec<Vector3<f64>> {
    let mut point = Vector3::zeros();
    (0..count)
        .map(|k| {
            let k = k as f64;
            let heading = 1.3 * k + 0.8 * (2.1 * k).sin();
            let leg = 4.5 + 1.5 * (3.7 * k).cos();
            point += Vector3::new(heading.cos(), heading.sin(), 0.2 * (1.1 * k).sin()) * leg;
            point
        })
        .collect()
}

fn plan(bencher: divan::Bencher<'_, '_>, count: usize, corridor_m: f64) {
    let config = MinimumSnapConfig {
        corridor_m,
        ..MinimumSnapConfig::default()
    };
    let planner = MinimumSnap::new(&config).unwrap();
    let (waypoints, limits) = (course(count), MotionLimits::default());
    let start = Reference::default();
    bencher.bench_local(|| {
        planner
            .plan(&start, &waypoints, &limits, YawPolicy::FaceMotion)
            .unwrap()
    });
}

#[divan::bench(args = [1, 10, 30])]
fn free(bencher: divan::Bencher<'_, '_>, count: usize) {
    plan(bencher, count, 1000.0);
}

#[divan::bench(args = [10, 30])]
fn in_the_default_corridor(bencher: divan::Bencher<'_, '_>, count: usize) {
    plan(bencher, count, 0.5);
}
