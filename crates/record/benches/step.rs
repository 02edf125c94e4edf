//! Time to record one step of a flight; the budget is 20 us at the median. The slowest step of a
//! second is the one that compresses the second before and writes it to the file.

// A benchmark that cannot write should stop, and it prints its budget.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

#[path = "../tests/made/mod.rs"]
mod made;

use std::sync::Arc;

use alula_geometry::{PinholeCamera, Pose, Timestamp};
use alula_messages::{
    Command, DepthImage, FlightMode, FlowSample, Fusion, ImuSample, Looking, Mount, RangeSample,
    Reference, Sensor, SensorBatch, StackOutput,
};
use alula_record::{Header, Recorder, TruthRecord};
use divan::Bencher;
use made::Numbers;
use nalgebra::{Vector2, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Length of a step: 250 Hz.
const STEP_NS: i64 = 4_000_000;

fn main() {
    println!("budget of `step`: 20 us; see docs/budgets.md");
    divan::main();
}

/// What arrives in a step, what the stack says and what is true, with every number another one in
/// every step, as noise would have it.
struct Made {
    generator: Pcg64,
    batch: SensorBatch,
    output: StackOutput,
    truth: TruthRecord,
}

impl Made {
    fn new() -> Self {
        let output = StackOutput {
            mode: FlightMode::Flying,
            reference: Some(Reference::default()),
            ..StackOutput::default()
        };
        Self {
            generator: Pcg64::new(1, 2),
            batch: SensorBatch::default(),
            output,
            truth: TruthRecord {
                time: Timestamp::ZERO,
                world_from_body: Pose::identity(),
                velocity_world: Vector3::zeros(),
                clearance_m: Some(1.0),
            },
        }
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.generator.random())
    }

    fn advance(&mut self) {
        let time = Timestamp::from_ns(self.batch.now.as_ns() + STEP_NS);
        self.sense(time);
        self.decide(time);
        self.truth.time = time;
        self.truth.world_from_body.translation.vector = self.vector();
        self.truth.velocity_world = self.vector();
    }

    /// Inertial data in every step, flow in every second and range in every fifth.
    fn sense(&mut self, time: Timestamp) {
        self.batch.clear();
        self.batch.now = time;
        let sample = ImuSample {
            time,
            specific_force: self.vector(),
            angular_rate: self.vector(),
        };
        self.batch.imu.push(sample);
        let step = time.as_ns() / STEP_NS;
        if step % 2 == 0 {
            let flow = self.vector();
            self.batch.flow.push(FlowSample {
                time,
                interval_s: 0.008,
                flow_rad_s: Vector2::new(flow.x, flow.y),
                quality: flow.z,
            });
        }
        if step % 5 == 0 {
            let range_m = self.vector().x;
            self.batch.infrared.push(RangeSample {
                time,
                range_m,
                min_m: 0.05,
                max_m: 10.0,
            });
        }
    }

    fn decide(&mut self, time: Timestamp) {
        let numbers = self.vector();
        self.output.time = time;
        self.output.state.time = time;
        self.output.state.world_from_body.translation.vector = self.vector();
        self.output.state.velocity_world = self.vector();
        for number in self.output.state.covariance.iter_mut() {
            *number = self.generator.random();
        }
        self.output.fusions.clear();
        let measured = self.batch.flow.len() + self.batch.infrared.len();
        for _ in 0..measured {
            self.output.fusions.push(Fusion {
                time,
                sensor: Sensor::Flow,
                innovation: numbers.into(),
                innovation_variance: numbers.into(),
                mahalanobis_squared: numbers.x,
                gate: 9.2,
                rejection: None,
            });
        }
        if let Some(reference) = &mut self.output.reference {
            reference.position_world = numbers;
        }
        self.output.requested = Command::AttitudeThrust {
            roll_rad: numbers.x,
            pitch_rad: numbers.y,
            yaw_rate_rad_s: 0.0,
            thrust_n: numbers.z,
        };
        self.output.command = self.output.requested;
    }
}

/// Batch, output and truth into a file; ten seconds of flight.
#[divan::bench(sample_count = 2500, sample_size = 1)]
fn step(bencher: Bencher) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut recorder = Recorder::create(path, &Header::default()).unwrap();
    let mut made = Made::new();
    bencher
        .with_inputs(|| {
            made.advance();
            (made.batch.clone(), made.output.clone(), made.truth)
        })
        .bench_local_refs(|(batch, output, truth)| {
            recorder.write_batch(batch).unwrap();
            recorder.write_output(output).unwrap();
            recorder.write_truth(truth).unwrap();
        });
    recorder.finish().unwrap();
}

/// A step that looked at an image, knows twenty obstacles and made a plan; what is not every step.
#[divan::bench(sample_count = 300, sample_size = 1)]
fn step_with_twenty_obstacles_and_a_plan(bencher: Bencher) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut recorder = Recorder::create(path, &Header::default()).unwrap();
    let mut numbers = Numbers::plain(1);
    let mut made = Made::new();
    bencher
        .with_inputs(|| {
            // 16 Hz.
            (0..16).for_each(|_| made.advance());
            let mut output = made.output.clone();
            output.seen_at = Some(output.time);
            output.detections = (0..10).map(|_| made::detection(&mut numbers)).collect();
            output.obstacles = (0..20).map(|_| made::obstacle(&mut numbers)).collect();
            output.plan = Some(made::plan(&mut numbers));
            (made.batch.clone(), output)
        })
        .bench_local_refs(|(batch, output)| {
            recorder.write_batch(batch).unwrap();
            recorder.write_output(output).unwrap();
        });
    recorder.finish().unwrap();
}

/// A step that brings a depth image of 424x240 pixels with noise.
#[divan::bench(sample_count = 300, sample_size = 1)]
fn step_with_a_depth_image(bencher: Bencher) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut recorder = Recorder::create(path, &Header::default()).unwrap();
    let camera =
        PinholeCamera::from_field_of_view(424, 240, 87_f64.to_radians(), 58_f64.to_radians());
    let mut made = Made::new();
    let depth_mm = (0..424 * 240)
        .map(|_| made.generator.random_range(2000..2100))
        .collect();
    let mut image = DepthImage {
        time: Timestamp::ZERO,
        sensor: 0,
        camera,
        body_from_camera: Mount::at([0.1, 0.0, 0.0], Looking::Forward).body_from_sensor(),
        depth_mm,
    };
    bencher
        .with_inputs(|| {
            // 31 Hz.
            (0..8).for_each(|_| made.advance());
            image.time = made.batch.now;
            let mut batch = made.batch.clone();
            batch.depth.push(Arc::new(image.clone()));
            batch
        })
        .bench_local_refs(|batch| recorder.write_batch(batch).unwrap());
    recorder.finish().unwrap();
}
