//! Rendered depth against rays.

use super::*;
use crate::world::samples::{assets, mixed_world};
use alula_geometry::so3;
use nalgebra::Translation3;
use rand::RngExt;
use rand_pcg::Pcg64;

fn world(text: &str) -> World {
    World::new(&toml::from_str(text).unwrap(), 0, &assets).unwrap()
}

fn camera() -> PinholeCamera {
    PinholeCamera::from_field_of_view(106, 60, 87_f64.to_radians(), 58_f64.to_radians())
}

/// A camera at a place that looks in a random direction, any way up.
fn anywhere(generator: &mut Pcg64, low: [f64; 3], high: [f64; 3]) -> Pose {
    let mut uniform = |a: f64, b: f64| a + (b - a) * generator.random::<f64>();
    let place = Vector3::from_fn(|i, _| uniform(low[i], high[i]));
    let turn = Vector3::from_fn(|_, _| uniform(-1.8, 1.8));
    Pose::from_parts(Translation3::from(place), so3::exp(&turn))
}

/// Depth by a ray through (u, v).
fn by_ray(world: &World, time: Timestamp, pose: &Pose, u: f64, v: f64) -> f64 {
    let ray = camera().ray(u, v);
    let origin = Point3::from(pose.translation.vector);
    let hit = world.cast_ray(&origin, &(pose.rotation * ray), f64::INFINITY, time);
    hit.map_or(f64::INFINITY, |h| h.distance_m / ray.norm())
}

/// Two roundings to f32, of inverse depth and of depth, err by 2^-24 each; 2^-22 leaves as much for
/// the computation in f64 at grazing incidence.
fn same(rendered: f32, depth: f64) -> bool {
    let rendered = f64::from(rendered);
    rendered == depth || (rendered - depth).abs() <= depth * 2.0_f64.powi(-22)
}

/// Whether a pixel agrees with the ray through its centre, or, where the outline of a thing passes
/// within 1e-7 pixels, with a ray on either side of it.
fn agrees(rendered: f32, ray: impl Fn(f64, f64) -> f64) -> bool {
    let e = 1e-7;
    let around = [(0.0, 0.0), (e, 0.0), (-e, 0.0), (0.0, e), (0.0, -e)];
    around.iter().any(|&(du, dv)| same(rendered, ray(du, dv)))
}

/// Compares all pixels of an image with rays.
fn check(world: &World, time: Timestamp, pose: &Pose) {
    let mut renderer = DepthRenderer::new(camera());
    let image = renderer.render(world, time, pose);
    for (i, &depth) in image.iter().enumerate() {
        let (u, v) = ((i % 106) as f64, (i / 106) as f64);
        assert!(
            agrees(depth, |du, dv| by_ray(world, time, pose, u + du, v + dv)),
            "pixel ({u}, {v}): rendered {depth}, ray {}, {pose:?}",
            by_ray(world, time, pose, u, v)
        );
    }
}

#[test]
fn images_equal_rays_in_mixed_worlds() {
    let mut generator = Pcg64::new(1, 2);
    for seed in 0..10 {
        let world = world(&mixed_world(seed, 100));
        for _ in 0..3 {
            let pose = anywhere(&mut generator, [-20.0, -20.0, 0.2], [20.0, 20.0, 6.0]);
            check(&world, Timestamp::from_s(seed as f64), &pose);
        }
    }
}

/// Close to one thing, on all sides of it and inside it, where whole planes pass behind the camera.
fn check_close(thing: &str) {
    let world = world(&format!("[ground]\nheight_m = -3.0\n{thing}"));
    let mut generator = Pcg64::new(7, 11);
    for _ in 0..60 {
        let pose = anywhere(&mut generator, [-1.5; 3], [1.5; 3]);
        check(&world, Timestamp::ZERO, &pose);
    }
}

#[test]
fn images_equal_rays_close_to_a_box() {
    check_close(
        "[[obstacles]]\nkind = \"box\"\ncentre_m = [0, 0, 0]\nsize_m = [1, 2, 1.5]\nyaw_deg = 30",
    );
}

#[test]
fn images_equal_rays_close_to_a_cylinder() {
    check_close(
        "[[obstacles]]\nkind = \"cylinder\"\ncentre_m = [0, 0.2]\nradius_m = 0.7\nbottom_m = -0.5\nheight_m = 1.0",
    );
}

#[test]
fn images_equal_rays_close_to_endless_cylinders() {
    check_close("[[obstacles]]\nkind = \"cylinder\"\ncentre_m = [0, 0.2]\nradius_m = 0.7");
    check_close(
        "[[obstacles]]\nkind = \"cylinder\"\ncentre_m = [0, 0.2]\nradius_m = 0.7\nbottom_m = 0.1",
    );
}

#[test]
fn images_equal_rays_close_to_a_sphere() {
    check_close("[[obstacles]]\nkind = \"sphere\"\ncentre_m = [0.1, 0, 0]\nradius_m = 0.9");
}

#[test]
fn images_equal_rays_close_to_a_mesh() {
    check_close("[[obstacles]]\nkind = \"mesh\"\nfile = \"pyramid.obj\"\nposition_m = [0, 0, -1]");
}

#[test]
fn images_equal_rays_close_to_a_person() {
    check_close(
        "[[people]]\nwaypoints_m = [[0.0, 0.0], [1.0, 0.4]]\nsemi_axes_m = [0.3, 0.5, 2.9]",
    );
}

#[test]
fn rows_of_a_level_camera_and_a_camera_below_the_ground_agree_with_rays() {
    let world = world(&mixed_world(3, 30));
    let level = Pose::from_parts(
        Translation3::new(0.0, 0.0, 1.5),
        so3::from_roll_pitch_yaw(-std::f64::consts::FRAC_PI_2, 0.0, 0.3),
    );
    check(&world, Timestamp::ZERO, &level);
    let below = Pose::from_parts(Translation3::new(2.0, 1.0, -1.5), level.rotation);
    check(&world, Timestamp::ZERO, &below);
}

#[test]
fn nothing_is_infinitely_far() {
    let world = world("");
    let up = Pose::translation(0.0, 0.0, 1.0);
    let mut renderer = DepthRenderer::new(camera());
    assert!(
        renderer
            .render(&world, Timestamp::ZERO, &up)
            .iter()
            .all(|&d| d == f32::INFINITY)
    );
}

#[test]
fn frames_do_not_depend_on_the_frames_before() {
    let world = world(&mixed_world(4, 50));
    let mut generator = Pcg64::new(3, 3);
    let mut kept = DepthRenderer::new(camera());
    for _ in 0..5 {
        let pose = anywhere(&mut generator, [-5.0, -5.0, 0.5], [5.0, 5.0, 3.0]);
        let mut fresh = DepthRenderer::new(camera());
        let expected = fresh.render(&world, Timestamp::ZERO, &pose);
        assert_eq!(kept.render(&world, Timestamp::ZERO, &pose), expected);
    }
}
