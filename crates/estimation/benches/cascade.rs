//! Time of one step of the two-stage estimator: an inertial sample, and one with flow and range.

// It prints its budgets.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use alula_estimation::complementary::{Complementary, ComplementaryConfig};
use alula_estimation::{Cascade, CascadeConfig, Estimator, FlowCalibration};
use alula_geometry::{TimeDelta, Timestamp};
use alula_messages::{FlightMode, FlowSample, ImuSample, Looking, Mount, RangeSample, SensorBatch};
use divan::{Bencher, black_box};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

fn main() {
    println!("budgets: 3 us for each inertial sample and each fusion; see docs/budgets.md");
    divan::main();
}

const STEP: TimeDelta = TimeDelta::from_ns(4_000_000);

fn imu(time: Timestamp) -> ImuSample {
    ImuSample {
        time,
        specific_force: Vector3::new(0.01, -0.02, 9.81),
        angular_rate: Vector3::new(1e-3, -1e-3, 2e-3),
    }
}

/// An estimator that hovers, with the batch of its next inertial sample.
fn hovering() -> (Cascade, SensorBatch) {
    let mount = Mount::at([0.0; 3], Looking::Down);
    let calibration = FlowCalibration {
        flow_camera: mount.clone(),
        infrared: mount,
    };
    let mut config = CascadeConfig::default();
    config.alignment.start_position_m = [0.0, 0.0, 1.0];
    let mut cascade = Cascade::new(&config, &calibration).unwrap();
    let mut batch = SensorBatch::default();
    for i in 0..500 {
        batch.clear();
        batch.now += STEP;
        batch.imu.push(imu(batch.now));
        let mode = if i < 400 {
            FlightMode::Armed
        } else {
            FlightMode::Flying
        };
        cascade.update(&batch, mode);
    }
    batch.clear();
    batch.now += STEP;
    (cascade, batch)
}

fn update(bencher: Bencher, fill: impl Fn(&mut SensorBatch)) {
    let (cascade, mut batch) = hovering();
    fill(&mut batch);
    bencher
        .with_inputs(|| cascade.clone())
        .bench_local_refs(|cascade| cascade.update(black_box(&batch), FlightMode::Flying));
}

#[divan::bench(sample_count = 2000, sample_size = 50)]
fn attitude(bencher: Bencher) {
    let start = UnitQuaternion::identity();
    let config = ComplementaryConfig::default();
    let mut filter = Complementary::new(&config, start, Vector3::zeros()).unwrap();
    let sample = imu(Timestamp::ZERO);
    bencher.bench_local(|| {
        let sample = black_box(&sample);
        filter.update(&sample.specific_force, &sample.angular_rate, 0.004);
    });
}

#[divan::bench(sample_count = 2000, sample_size = 50)]
fn inertial_sample(bencher: Bencher) {
    update(bencher, |batch| batch.imu.push(imu(batch.now)));
}

#[divan::bench(sample_count = 2000, sample_size = 50)]
fn late_flow(bencher: Bencher) {
    update(bencher, |batch| {
        batch.flow.push(FlowSample {
            time: batch.now - TimeDelta::from_s(0.02),
            interval_s: 0.012,
            flow_rad_s: Vector2::new(0.001, -0.002),
            quality: 1.0,
        });
    });
}

#[divan::bench(sample_count = 2000, sample_size = 50)]
fn late_range(bencher: Bencher) {
    update(bencher, |batch| {
        batch.infrared.push(RangeSample {
            time: batch.now - TimeDelta::from_s(0.02),
            range_m: 1.01,
            min_m: 0.1,
            max_m: 10.0,
        });
    });
}
