//! Worlds drawn at random from a seed, and worlds drawn by rule.

use alula_geometry::Pose;
use nalgebra::{Translation3, UnitQuaternion, Vector2, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;

use super::config::{Ceiling, CorridorConfig, ForestConfig, RoomConfig};
use super::people::{self, Person};
use super::{Material, Obstacle, Shape, WorldError};

/// Draws for one trunk or pillar before the demands count as impossible.
const ATTEMPTS: usize = 10_000;

/// Streams of the generator, so that one part of a world does not change another.
const FOREST_STREAM: u128 = 0xf0;
const CORRIDOR_STREAM: u128 = 0xc0;

/// A circle on the ground.
#[derive(Clone, Copy, Debug)]
struct Disc {
    centre: Vector2<f64>,
    radius_m: f64,
}

impl Disc {
    fn gap_m(&self, other: &Self) -> f64 {
        (self.centre - other.centre).norm() - self.radius_m - other.radius_m
    }
}

fn uniform(generator: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * generator.random::<f64>()
}

/// Checks a pair of least and greatest.
fn ordered(key: &str, name: &str, [low, high]: [f64; 2]) -> Result<(), WorldError> {
    if low <= high {
        return Ok(());
    }
    let finding = format!("`{name}` is [{low}, {high}]");
    Err(WorldError::degenerate(
        key,
        finding,
        "put the lesser number first",
    ))
}

/// Room left between somebody who walks by and a trunk, m.
const ELBOW_ROOM_M: f64 = 0.1;

/// The trunks of a forest, clear of where people walk if that is wanted.
pub(super) fn forest(
    config: &ForestConfig,
    seed: u64,
    ground_m: f64,
    people: &[Person],
) -> Result<Vec<Obstacle>, WorldError> {
    const KEY: &str = "world.forest";
    let count = forest_count(config, KEY)?;
    ordered(KEY, "radius_m", config.radius_m)?;
    let mut generator = Pcg64::new(u128::from(seed), FOREST_STREAM);
    let kept_clear = [config.start_m, config.goal_m];
    let walks = walks(config.clear_of_people_s, people);
    let mut trunks: Vec<Disc> = Vec::with_capacity(count);
    for i in 0..count {
        let fits = |trunk: &Disc, trunks: &[Disc]| {
            trunks.iter().all(|t| t.gap_m(trunk) >= config.clear_gap_m)
                && kept_clear.iter().flatten().all(|&place| {
                    (trunk.centre - Vector2::from(place)).norm() - trunk.radius_m
                        >= config.clear_radius_m
                })
                && walks.iter().all(|step| step.gap_m(trunk) >= ELBOW_ROOM_M)
        };
        let trunk = (0..ATTEMPTS)
            .map(|_| draw_trunk(config, &mut generator))
            .find(|trunk| fits(trunk, &trunks));
        let Some(trunk) = trunk else {
            if config.clear_of_people_s.is_some() {
                break;
            }
            let finding = format!("only {i} of {count} trunks find a place");
            let remedy = "lower `density_per_m2`, `count`, `clear_gap_m` or `clear_radius_m`";
            return Err(WorldError::impossible(KEY, finding, remedy));
        };
        trunks.push(trunk);
    }
    let top_m = config.height_m.map_or(f64::INFINITY, |h| ground_m + h);
    let bottom_m = if config.height_m.is_some() {
        ground_m
    } else {
        f64::NEG_INFINITY
    };
    Ok(pillars("tree", &trunks, bottom_m, top_m, config.material))
}

/// The places where people walk in this first time of the simulation.
fn walks(duration_s: Option<f64>, people: &[Person]) -> Vec<Disc> {
    let mut walks = Vec::new();
    for time in duration_s.into_iter().flat_map(people::times) {
        for state in people.iter().filter_map(|p| p.state(0, 0.0, time)) {
            walks.push(Disc {
                centre: state.centre_world.xy().coords,
                radius_m: state.semi_axes_m.x.max(state.semi_axes_m.y),
            });
        }
    }
    walks
}

/// Number of trunks that a config asks for.
fn forest_count(config: &ForestConfig, key: &str) -> Result<usize, WorldError> {
    let [width, length] = [0, 1].map(|i| config.max_m[i] - config.min_m[i]);
    if width <= 0.0 || length <= 0.0 {
        let finding = format!("the area is {width} m by {length} m");
        return Err(WorldError::degenerate(
            key,
            finding,
            "`max_m` must exceed `min_m` in x and y",
        ));
    }
    match (config.count, config.density_per_m2) {
        (Some(count), None) => Ok(count),
        (None, Some(density)) => Ok((density * width * length).round() as usize),
        (None, None) => Err(WorldError::degenerate(
            key,
            "neither `count` nor `density_per_m2` is given",
            "give one of them",
        )),
        (Some(_), Some(_)) => Err(WorldError::degenerate(
            key,
            "both `count` and `density_per_m2` are given",
            "give one of them",
        )),
    }
}

fn draw_trunk(config: &ForestConfig, generator: &mut Pcg64) -> Disc {
    let x = uniform(generator, config.min_m[0], config.max_m[0]);
    let y = uniform(generator, config.min_m[1], config.max_m[1]);
    Disc {
        centre: Vector2::new(x, y),
        radius_m: uniform(generator, config.radius_m[0], config.radius_m[1]),
    }
}

/// Cylinders over discs, with names counted from 1.
fn pillars(
    name: &str,
    discs: &[Disc],
    bottom_m: f64,
    top_m: f64,
    material: Material,
) -> Vec<Obstacle> {
    let pillar = |(i, disc): (usize, &Disc)| {
        let shape = Shape::Cylinder {
            centre_m: disc.centre.into(),
            radius_m: disc.radius_m,
            bottom_m,
            top_m,
        };
        Obstacle::new(format!("{name} {}", i + 1), shape, material)
    };
    discs.iter().enumerate().map(pillar).collect()
}

/// A box from its centre and full size in a frame that is turned about the vertical.
pub(super) fn upright_box(
    name: String,
    centre: Vector3<f64>,
    size: Vector3<f64>,
    yaw_rad: f64,
    material: Material,
) -> Obstacle {
    let shape = Shape::Box {
        world_from_box: Pose::from_parts(
            Translation3::from(centre),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad),
        ),
        half_size_m: 0.5 * size,
    };
    Obstacle::new(name, shape, material)
}

/// The walls and pillars of a corridor.
pub(super) fn corridor(
    config: &CorridorConfig,
    seed: u64,
    ground_m: f64,
) -> Result<Vec<Obstacle>, WorldError> {
    let yaw = config.yaw_deg.to_radians();
    let along = Vector2::new(yaw.cos(), yaw.sin());
    let across = Vector2::new(-along.y, along.x);
    let place = |x: f64, y: f64| Vector2::from(config.start_m) + along * x + across * y;
    let mut things = Vec::new();
    for (name, side) in [("left", 1.0), ("right", -1.0)] {
        let middle = place(
            0.5 * config.length_m,
            side * 0.5 * (config.width_m + config.thickness_m),
        );
        things.push(upright_box(
            format!("{name} wall of the corridor"),
            Vector3::new(middle.x, middle.y, ground_m + 0.5 * config.height_m),
            Vector3::new(config.length_m, config.thickness_m, config.height_m),
            yaw,
            config.material,
        ));
    }
    let mut discs = corridor_pillars(config, seed)?;
    for disc in &mut discs {
        disc.centre = place(disc.centre.x, disc.centre.y);
    }
    let top_m = ground_m + config.height_m;
    things.extend(pillars("pillar", &discs, ground_m, top_m, config.material));
    Ok(things)
}

/// Pillars in the frame of the corridor: x along it, y to its left.
fn corridor_pillars(config: &CorridorConfig, seed: u64) -> Result<Vec<Disc>, WorldError> {
    const KEY: &str = "world.corridor";
    ordered(KEY, "pillar_radius_m", config.pillar_radius_m)?;
    let mut generator = Pcg64::new(u128::from(seed), CORRIDOR_STREAM);
    let half_width = 0.5 * config.width_m;
    let mut discs: Vec<Disc> = Vec::with_capacity(config.pillars);
    for i in 0..config.pillars {
        let draw = |generator: &mut Pcg64| {
            let radius_m = uniform(
                generator,
                config.pillar_radius_m[0],
                config.pillar_radius_m[1],
            );
            let x = uniform(generator, 0.0, config.length_m);
            let y = uniform(generator, -half_width, half_width);
            Disc {
                centre: Vector2::new(x, y),
                radius_m,
            }
        };
        let fits = |disc: &Disc| {
            let ends = disc.centre.x.min(config.length_m - disc.centre.x) - disc.radius_m;
            let passage = half_width + disc.centre.y.abs() - disc.radius_m;
            ends >= config.clear_ends_m
                && passage >= config.clear_gap_m
                && discs.iter().all(|d| d.gap_m(disc) >= config.clear_gap_m)
        };
        let disc = (0..ATTEMPTS).map(|_| draw(&mut generator)).find(fits);
        let Some(disc) = disc else {
            let finding = format!("only {i} of {} pillars find a place", config.pillars);
            let remedy = "lower `pillars`, `pillar_radius_m`, `clear_gap_m` or `clear_ends_m`";
            return Err(WorldError::impossible(KEY, finding, remedy));
        };
        discs.push(disc);
    }
    Ok(discs)
}

/// The walls of a room and its ceiling.
pub(super) fn room(config: &RoomConfig, ground_m: f64) -> Vec<Obstacle> {
    let [length, width, height] = config.size_m;
    let t = config.thickness_m;
    let [x, y] = config.centre_m;
    let part = |name: &str, dx: f64, dy: f64, middle_z: f64, size: [f64; 3]| {
        upright_box(
            format!("{name} of the room"),
            Vector3::new(x + dx, y + dy, ground_m + middle_z),
            Vector3::from(size),
            0.0,
            config.material,
        )
    };
    let (dx, dy) = (0.5 * (length + t), 0.5 * (width + t));
    let outer = length + 2.0 * t;
    let mut parts = vec![
        part("east wall", dx, 0.0, 0.5 * height, [t, width, height]),
        part("west wall", -dx, 0.0, 0.5 * height, [t, width, height]),
        part("north wall", 0.0, dy, 0.5 * height, [outer, t, height]),
        part("south wall", 0.0, -dy, 0.5 * height, [outer, t, height]),
    ];
    if config.ceiling == Ceiling::Closed {
        let size = [outer, width + 2.0 * t, t];
        parts.push(part("ceiling", 0.0, 0.0, height + 0.5 * t, size));
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn discs(things: &[Obstacle]) -> Vec<Disc> {
        things
            .iter()
            .filter_map(|thing| match thing.shape {
                Shape::Cylinder {
                    centre_m, radius_m, ..
                } => Some(Disc {
                    centre: Vector2::from(centre_m),
                    radius_m,
                }),
                _ => None,
            })
            .collect()
    }

    fn least_gap(discs: &[Disc]) -> f64 {
        let mut least = f64::INFINITY;
        for (i, a) in discs.iter().enumerate() {
            for b in &discs[..i] {
                least = least.min(a.gap_m(b));
            }
        }
        least
    }

    fn dense() -> ForestConfig {
        ForestConfig {
            density_per_m2: Some(0.08),
            start_m: Some([5.0, 0.0]),
            goal_m: Some([55.0, 3.0]),
            ..ForestConfig::default()
        }
    }

    #[test]
    fn forests_have_their_density_gaps_and_clear_places_for_every_seed() {
        let config = dense();
        for seed in 0..50 {
            let trunks = discs(&forest(&config, seed, 0.0, &[]).unwrap());
            assert_eq!(trunks.len(), 144);
            assert!(least_gap(&trunks) >= config.clear_gap_m);
            for trunk in &trunks {
                assert!((0.1..=0.3).contains(&trunk.radius_m));
                assert!((0.0..=60.0).contains(&trunk.centre.x));
                assert!((-15.0..=15.0).contains(&trunk.centre.y));
                for place in [config.start_m, config.goal_m].into_iter().flatten() {
                    let gap = (trunk.centre - Vector2::from(place)).norm() - trunk.radius_m;
                    assert!(gap >= config.clear_radius_m);
                }
            }
        }
    }

    #[test]
    fn forests_fill_their_area_evenly() {
        // 50 x 144 trunks, half of them on each side of the middle: sigma 42, five of them allowed.
        let north: usize = (0..50)
            .map(|seed| {
                let config = ForestConfig {
                    start_m: None,
                    goal_m: None,
                    ..dense()
                };
                let trunks = discs(&forest(&config, seed, 0.0, &[]).unwrap());
                trunks.iter().filter(|t| t.centre.y > 0.0).count()
            })
            .sum();
        assert!(north.abs_diff(3600) < 210, "{north}");
    }

    #[test]
    fn seeds_make_forests_and_equal_seeds_equal_ones() {
        let place = |seed| discs(&forest(&dense(), seed, 0.0, &[]).unwrap())[17].centre;
        assert_eq!(place(3), place(3));
        assert_ne!(place(3), place(4));
    }

    #[test]
    fn a_forest_too_dense_for_its_gaps_is_refused() {
        let config = ForestConfig {
            density_per_m2: Some(2.0),
            max_m: [5.0, 0.0],
            ..ForestConfig::default()
        };
        let message = forest(&config, 0, 0.0, &[]).unwrap_err().to_string();
        assert!(
            message.contains("`world.forest` cannot be generated: only"),
            "{message}"
        );
        assert!(message.contains("of 150 trunks"));
    }

    #[test]
    fn corridors_can_be_passed_for_every_seed() {
        let config = CorridorConfig {
            pillars: 8,
            yaw_deg: 30.0,
            start_m: [2.0, 1.0],
            ..CorridorConfig::default()
        };
        for seed in 0..50 {
            let pillars = corridor_pillars(&config, seed).unwrap();
            assert_eq!(pillars.len(), 8);
            assert!(least_gap(&pillars) >= config.clear_gap_m);
            for pillar in &pillars {
                let (x, y, r) = (pillar.centre.x, pillar.centre.y, pillar.radius_m);
                assert!(x - r >= 2.0 && x + r <= 28.0);
                assert!(1.5 + y.abs() - r >= 1.0);
            }
            assert_eq!(corridor(&config, seed, 0.0).unwrap().len(), 10);
        }
    }
}
