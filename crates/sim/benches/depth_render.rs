//! Time of one depth image of 424x240 pixels with 100 obstacles, against a budget of 3 ms on one
//! core, and of 4 ms with the errors of stereo. The columns `median` and `slowest` are the ones to
//! look at.

// It prints its budgets.
#![allow(clippy::print_stdout)]

use alula_geometry::{PinholeCamera, Pose, TimeDelta, Timestamp, so3};
use alula_messages::SensorBatch;
use alula_sim::Truth;
use alula_sim::render::DepthRenderer;
use alula_sim::sensors::{MotorActivity, SensorSuite, SensorSuiteConfig};
use alula_sim::world::World;
use nalgebra::{Translation3, Vector3};

#[path = "../src/world/samples.rs"]
mod samples;

/// A period of the camera at 30 Hz and a little more, so that none goes without an image.
const PERIOD: TimeDelta = TimeDelta::from_ns(33_333_400);

fn main() {
    println!("budgets of an image: 3 ms, with noise 4 ms; see docs/budgets.md");
    divan::main();
}

fn camera() -> PinholeCamera {
    PinholeCamera::from_field_of_view(424, 240, 87_f64.to_radians(), 58_f64.to_radians())
}

#[allow(clippy::expect_used)]
fn world(text: &str) -> World {
    let config = toml::from_str(text).expect("the text of a world");
    World::new(&config, 1, &samples::assets).expect("a world")
}

/// Level, 1.5 m over the ground, looking along `yaw_rad` from `x_m` along that way.
fn level(yaw_rad: f64, x_m: f64, tilt_rad: f64) -> Pose {
    let ahead = Vector3::new(yaw_rad.cos(), yaw_rad.sin(), 0.0) * x_m;
    let optical = so3::from_roll_pitch_yaw(
        -std::f64::consts::FRAC_PI_2 - tilt_rad,
        0.0,
        yaw_rad - std::f64::consts::FRAC_PI_2,
    );
    Pose::from_parts(Translation3::from(ahead + Vector3::z() * 1.5), optical)
}

fn bench(bencher: divan::Bencher<'_, '_>, world: &World, pose: &Pose) {
    let mut renderer = DepthRenderer::new(camera());
    bencher.bench_local(|| renderer.render(world, Timestamp::ZERO, pose)[0]);
}

/// Boxes, walls, cylinders, spheres, meshes and people all round; eight directions from the middle.
#[divan::bench(args = 0..8, sample_count = 500)]
fn mixed(bencher: divan::Bencher<'_, '_>, direction: i32) {
    let world = world(&samples::mixed_world(1, 100));
    let pose = level(f64::from(direction) * std::f64::consts::FRAC_PI_4, 0.0, 0.0);
    bench(bencher, &world, &pose);
}

/// The same world from its edge: nearly everything is in view.
#[divan::bench(args = 0..4, sample_count = 500)]
fn mixed_from_the_edge(bencher: divan::Bencher<'_, '_>, direction: i32) {
    let world = world(&samples::mixed_world(1, 100));
    let pose = level(
        f64::from(direction) * std::f64::consts::FRAC_PI_2,
        -26.0,
        0.1,
    );
    bench(bencher, &world, &pose);
}

/// Within a forest of endless trunks, all in view, the camera tilted.
#[divan::bench(sample_count = 500)]
fn forest(bencher: divan::Bencher<'_, '_>) {
    let world = world("[forest]\ncount = 100\nmin_m = [2.0, -15.0]\nmax_m = [40.0, 15.0]\n");
    bench(bencher, &world, &level(0.0, 0.0, 0.2));
}

/// A camera at 30 Hz, from exposure to delivery: the image with noise, holes and edges. The
/// inertial unit beside it takes no part worth counting.
#[allow(clippy::expect_used)]
#[divan::bench(sample_count = 500)]
fn mixed_with_noise(bencher: divan::Bencher<'_, '_>) {
    let world = world(&samples::mixed_world(1, 100));
    let config = SensorSuiteConfig {
        depth: SensorSuiteConfig::small_multirotor().depth,
        ..SensorSuiteConfig::default()
    };
    let mut sensors = SensorSuite::new(&config, 1).expect("a depth camera");
    let mut batch = SensorBatch::default();
    let mut truth = standing();
    bencher.bench_local(|| {
        let before = truth;
        truth.time += PERIOD;
        sensors.advance(&world, &before, &truth, &MotorActivity::default());
        batch.clear();
        sensors.deliver(truth.time, &mut batch);
        batch.depth.len()
    });
}

/// Hovering in the middle, 1.5 m over the ground.
fn standing() -> Truth {
    Truth {
        time: Timestamp::ZERO,
        world_from_body: Pose::translation(0.0, 0.0, 1.5),
        velocity_world: Vector3::zeros(),
        acceleration_world: Vector3::zeros(),
        angular_rate_body: Vector3::zeros(),
        angular_acceleration_body: Vector3::zeros(),
        on_ground: false,
    }
}
