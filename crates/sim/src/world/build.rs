//! From configs to things and people.

use std::sync::Arc;

use alula_geometry::Pose;
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector2, Vector3};

use super::people::{Loop, Motion, Person};
use super::{
    Assets, BoxConfig, CylinderConfig, Material, Mesh, MeshConfig, Obstacle, ObstacleConfig, Shape,
    SphereConfig, WallConfig, WorldConfig, WorldError, generate, tracks,
};
use crate::sensors::noise::Noise;

/// The things that a config lists one by one.
pub(super) fn obstacles(
    config: &WorldConfig,
    assets: &Assets<'_>,
) -> Result<Vec<Obstacle>, WorldError> {
    // Names count the things of a kind: box, wall, cylinder, sphere, mesh.
    let mut counts = [0_usize; 5];
    let mut name = |kind: usize, word: &str| {
        counts[kind] += 1;
        format!("{word} {}", counts[kind])
    };
    let ground_m = config.ground.height_m;
    let mut obstacles = Vec::with_capacity(config.obstacles.len());
    for (i, thing) in config.obstacles.iter().enumerate() {
        let key = format!("world.obstacles[{i}]");
        obstacles.push(match thing {
            ObstacleConfig::Box(b) => box_from(b, name(0, "box")),
            ObstacleConfig::Wall(w) => wall_from(w, name(1, "wall"), ground_m, &key)?,
            ObstacleConfig::Cylinder(c) => cylinder_from(c, name(2, "cylinder"), ground_m),
            ObstacleConfig::Sphere(s) => sphere_from(s, name(3, "sphere")),
            ObstacleConfig::Mesh(m) => mesh_from(m, name(4, "mesh"), &key, assets)?,
        });
    }
    Ok(obstacles)
}

fn box_from(config: &BoxConfig, name: String) -> Obstacle {
    generate::upright_box(
        name,
        Vector3::from(config.centre_m),
        Vector3::from(config.size_m),
        config.yaw_deg.unwrap_or(0.0).to_radians(),
        config.material.unwrap_or(Material::Concrete),
    )
}

fn wall_from(
    config: &WallConfig,
    name: String,
    ground_m: f64,
    key: &str,
) -> Result<Obstacle, WorldError> {
    let (from, to) = (Vector2::from(config.from_m), Vector2::from(config.to_m));
    let along = to - from;
    if along.norm() == 0.0 {
        let finding = "`from_m` and `to_m` are the same place";
        return Err(WorldError::degenerate(
            key,
            finding,
            "give the wall a length",
        ));
    }
    let middle = 0.5 * (from + to);
    Ok(generate::upright_box(
        name,
        Vector3::new(middle.x, middle.y, ground_m + 0.5 * config.height_m),
        Vector3::new(along.norm(), config.thickness_m, config.height_m),
        along.y.atan2(along.x),
        config.material.unwrap_or(Material::Plaster),
    ))
}

fn cylinder_from(config: &CylinderConfig, name: String, ground_m: f64) -> Obstacle {
    let (bottom_m, top_m) = match (config.bottom_m, config.height_m) {
        (bottom, Some(height)) => {
            let bottom = bottom.unwrap_or(ground_m);
            (bottom, bottom + height)
        }
        (Some(bottom), None) => (bottom, f64::INFINITY),
        (None, None) => (f64::NEG_INFINITY, f64::INFINITY),
    };
    let shape = Shape::Cylinder {
        centre_m: config.centre_m,
        radius_m: config.radius_m,
        bottom_m,
        top_m,
    };
    Obstacle::new(name, shape, config.material.unwrap_or(Material::Concrete))
}

fn sphere_from(config: &SphereConfig, name: String) -> Obstacle {
    let shape = Shape::Sphere {
        centre_world: Point3::from(config.centre_m),
        radius_m: config.radius_m,
    };
    Obstacle::new(name, shape, config.material.unwrap_or(Material::Metal))
}

fn mesh_from(
    config: &MeshConfig,
    name: String,
    key: &str,
    assets: &Assets<'_>,
) -> Result<Obstacle, WorldError> {
    let key = format!("{key}.file");
    let bytes = load(&config.file, &key, assets)?;
    let world_from_file = Pose::from_parts(
        Translation3::from(config.position_m),
        UnitQuaternion::from_axis_angle(
            &Vector3::z_axis(),
            config.yaw_deg.unwrap_or(0.0).to_radians(),
        ),
    );
    let scale = config.scale.unwrap_or(1.0);
    let mesh = Mesh::read(&config.file, &bytes, &world_from_file, scale).map_err(
        |(finding, remedy)| WorldError::Mesh {
            key,
            file: config.file.clone(),
            finding,
            remedy: remedy.into(),
        },
    )?;
    let material = config.material.unwrap_or(Material::Concrete);
    Ok(Obstacle::new(name, Shape::Mesh(Arc::new(mesh)), material))
}

/// All people of a config, walkers first; names count them from 1.
///
/// Every walker and every file of tracks draws its start from a source of its own, so that one
/// more does not change the others.
pub(super) fn people(
    config: &WorldConfig,
    seed: u64,
    assets: &Assets<'_>,
) -> Result<Vec<Person>, WorldError> {
    let drawn_s = |spread_s: f64, name: String| spread_s * Noise::new(seed, &name).uniform();
    let mut people = Vec::new();
    for (i, walker) in config.people.iter().enumerate() {
        let mut walker = walker.clone();
        walker.start_s += drawn_s(walker.start_spread_s, format!("start of person {i}"));
        people.push(Person {
            name: format!("person {}", people.len() + 1),
            semi_axes_m: Vector3::from(walker.semi_axes_m),
            motion: Motion::Loop(Loop::new(&walker, &format!("world.people[{i}]"))?),
        });
    }
    for (i, recorded) in config.tracks.iter().enumerate() {
        let key = format!("world.tracks[{i}]");
        let mut recorded = recorded.clone();
        recorded.start_s += drawn_s(recorded.start_spread_s, format!("start of tracks {i}"));
        let bytes = load(&recorded.file, &format!("{key}.file"), assets)?;
        for (id, track) in tracks::read(&recorded, &bytes, &key)? {
            people.push(Person {
                name: format!("person {} (track {id})", people.len() + 1),
                semi_axes_m: Vector3::from(recorded.semi_axes_m),
                motion: Motion::Track(track),
            });
        }
    }
    Ok(people)
}

fn load(file: &str, key: &str, assets: &Assets<'_>) -> Result<Vec<u8>, WorldError> {
    assets(file).map_err(|reason| WorldError::Unreadable {
        key: key.into(),
        file: file.into(),
        reason,
    })
}
