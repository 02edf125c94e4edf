//! Time of one propagation, one fusion, one rewind. The median counts, and so does the worst.

// It prints its budgets.
#![allow(clippy::print_stdout)]

use alula_estimation::eskf::{
    Filter, FilterKind, ImuNoise, InertialInput, Nominal, QuaternionIntegration, Truncation,
    Variant,
};
use alula_estimation::history::History;
use alula_estimation::measurement::{
    FlowMeasurement, Gates, Measurement, PlanarVelocityMeasurement, PositionMeasurement,
    RangeMeasurement, SonarMeasurement,
};
use alula_geometry::{Timestamp, so3};
use alula_messages::{ImuSample, Looking, Mount, Sensor};
use divan::{Bencher, black_box};
use nalgebra::{Vector2, Vector3};

fn main() {
    println!("budgets: fusion 3 us each, rewind of 0.1 s 100 us; see docs/budgets.md");
    divan::main();
}

fn filter() -> Filter {
    let nominal = Nominal {
        position_world: Vector3::new(1.0, 2.0, 1.5),
        velocity_world: Vector3::new(1.0, -0.5, 0.1),
        world_from_body: so3::from_roll_pitch_yaw(0.1, -0.05, 0.7),
        ..Nominal::default()
    };
    let mut filter = Filter::new(nominal, [0.1, 0.1, 0.02, 0.05, 0.005].map(Vector3::repeat));
    for _ in 0..100 {
        filter.propagate(&input(), 0.004, &ImuNoise::default());
    }
    filter
}

fn input() -> InertialInput {
    InertialInput::steady(Vector3::new(0.3, -0.2, 9.9), Vector3::new(0.2, 0.4, -0.3))
}

fn down() -> alula_geometry::Pose {
    Mount::at([0.05, 0.0, -0.04], Looking::Down).body_from_sensor()
}

#[divan::bench(sample_count = 2000, sample_size = 50)]
fn propagate(bencher: Bencher) {
    let noise = ImuNoise::default();
    bencher.with_inputs(filter).bench_local_refs(|filter| {
        filter.propagate(black_box(&input()), black_box(0.004), &noise);
    });
}

/// The most costly transition of each kind of filter.
const COSTLIEST: [FilterKind; 3] = [
    FilterKind::ErrorStateLocal,
    FilterKind::ErrorStateGlobal,
    FilterKind::Extended,
];

fn costliest(kind: FilterKind) -> Filter {
    filter().in_variant(Variant {
        filter: kind,
        integration: QuaternionIntegration::Q1,
        transition: Truncation::F3,
    })
}

#[divan::bench(sample_count = 2000, sample_size = 50, args = COSTLIEST)]
fn propagate_f3(bencher: Bencher, kind: FilterKind) {
    let noise = ImuNoise::default();
    bencher
        .with_inputs(|| costliest(kind))
        .bench_local_refs(|filter| {
            filter.propagate(black_box(&input()), black_box(0.004), &noise);
        });
}

fn fuse(bencher: Bencher, kind: FilterKind, measurement: Measurement) {
    let gates = Gates::new(0.999);
    let fused = measurement.fuse(Timestamp::ZERO, &mut costliest(kind), &gates);
    assert!(fused.is_some_and(|fusion| fusion.accepted()));
    bencher
        .with_inputs(|| costliest(kind))
        .bench_local_refs(|filter| {
            black_box(black_box(&measurement).fuse(Timestamp::ZERO, filter, &gates))
        });
}

#[divan::bench(sample_count = 2000, sample_size = 50, args = COSTLIEST)]
fn fuse_range_1(bencher: Bencher, kind: FilterKind) {
    let range = RangeMeasurement {
        sensor: Sensor::Infrared,
        range_m: 1.5,
        body_from_ranger: down(),
        sigma_m: 0.02,
    };
    fuse(bencher, kind, Measurement::Range(range));
}

#[divan::bench(sample_count = 2000, sample_size = 50, args = COSTLIEST)]
fn fuse_sonar_1(bencher: Bencher, kind: FilterKind) {
    let sonar = SonarMeasurement {
        range_m: 1.5,
        body_from_sonar: down(),
        sigma_m: 0.05,
    };
    fuse(bencher, kind, Measurement::Sonar(sonar));
}

#[divan::bench(sample_count = 2000, sample_size = 50, args = COSTLIEST)]
fn fuse_flow_2(bencher: Bencher, kind: FilterKind) {
    let flow = FlowMeasurement {
        flow_rad_s: Vector2::new(0.0, 0.5),
        angular_rate: input().angular_rate,
        interval_s: 0.01,
        body_from_camera: down(),
        sigma_rad_s: 0.5,
        min_distance_m: 0.3,
    };
    fuse(bencher, kind, Measurement::Flow(flow));
}

#[divan::bench(sample_count = 2000, sample_size = 50, args = COSTLIEST)]
fn fuse_planar_velocity_2(bencher: Bencher, kind: FilterKind) {
    let velocity = PlanarVelocityMeasurement {
        angular_rate: input().angular_rate,
        interval_s: 0.01,
        body_from_camera: down(),
        sigma_m_s: 1.0,
        ..PlanarVelocityMeasurement::from_flow(Vector2::new(0.0, 0.5), 1.5)
    };
    fuse(bencher, kind, Measurement::PlanarVelocity(velocity));
}

#[divan::bench(sample_count = 2000, sample_size = 50, args = COSTLIEST)]
fn fuse_position_3(bencher: Bencher, kind: FilterKind) {
    let position = PositionMeasurement {
        position_world: Vector3::new(1.4, 1.8, 1.55),
        sigma_m: 0.01,
    };
    fuse(bencher, kind, Measurement::Position(position));
}

/// A position 0.1 s late at 250 Hz: 25 propagations and a fusion.
#[divan::bench(sample_count = 500)]
fn rewind_a_tenth_of_a_second(bencher: Bencher) {
    let time = |i: i64| Timestamp::from_ns(4_000_000 * i);
    let mut history = History::new(100, ImuNoise::default(), Gates::new(0.999));
    history.start(time(0), input(), filter());
    for i in 1..80 {
        let sample = ImuSample {
            time: time(i),
            specific_force: input().specific_force,
            angular_rate: input().angular_rate,
        };
        history.push(&sample, 1.0, &mut |_| {});
    }
    history.settle(&mut |_| {});
    let late = Measurement::Position(PositionMeasurement {
        position_world: Vector3::new(1.5, 1.8, 1.55),
        sigma_m: 0.1,
    });
    bencher
        .with_inputs(|| history.clone())
        .bench_local_refs(|history| {
            history.insert(time(54), late).ok();
            history.settle(&mut |fusion| {
                black_box(fusion);
            });
        });
}
