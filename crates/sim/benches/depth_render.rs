//! Time of one depth image of 424x240 pixels with 100 obstacles, against a budget of 3 ms on one
//! core. The columns `median` and `slowest` are the ones to look at.

use alula_geometry::{PinholeCamera, Pose, Timestamp, so3};
use alula_sim::render::DepthRenderer;
use alula_sim::world::World;
use nalgebra::{Translation3, Vector3};

#[path = "../src/world/samples.rs"]
mod samples;

fn main() {
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
