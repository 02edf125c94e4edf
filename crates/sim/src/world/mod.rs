//! The world: ground, things that stand still, and people. It does not change; where people are is
//! a function of time. Several vehicles and sensors share one world through an `Arc`.

mod build;
mod config;
mod distance;
mod error;
mod generate;
mod material;
mod mesh;
mod people;
mod ray;
mod shape;
mod tracks;

use alula_geometry::Timestamp;
use alula_parameters::check::Tables;
use nalgebra::{Point3, Vector3};

pub use config::{
    AfterEnd, BoxConfig, Ceiling, CorridorConfig, CylinderConfig, ForestConfig, GroundConfig,
    MeshConfig, ObstacleConfig, PersonConfig, RoomConfig, SphereConfig, TrackConfig, WallConfig,
    WorldConfig,
};
pub use error::WorldError;
pub use material::Material;
pub use mesh::Mesh;
pub use people::PersonState;
pub use shape::{Obstacle, Shape};

use people::Person;
use ray::{Crossing, Ray};

/// Loads the bytes of a file that a world refers to, by the path in the scenario; the error is the
/// reason in words.
pub type Assets<'a> = dyn Fn(&str) -> Result<Vec<u8>, String> + 'a;

/// A thing in a world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ThingId {
    /// The ground.
    Ground,
    /// A thing that stands still, by its index in [`World::obstacles`].
    Obstacle(u32),
    /// A person, by [`PersonState::id`].
    Person(u32),
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, m.
    pub distance_m: f64,
    /// Unit normal of the surface, world frame, on the side from which the ray comes.
    pub normal_world: Vector3<f64>,
    /// The surface.
    pub material: Material,
    /// What is met.
    pub what: ThingId,
}

/// Distance to the nearest thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Signed distance to its surface, m, negative inside.
    pub distance_m: f64,
    /// The thing.
    pub what: ThingId,
}

/// Ground, things and people. Immutable.
#[derive(Clone, Debug)]
pub struct World {
    ground_height_m: f64,
    ground_material: Material,
    obstacles: Vec<Obstacle>,
    people: Vec<Person>,
    /// When each person is in the world, so that of a long recording few are looked at.
    presence_s: Vec<(f64, f64)>,
}

impl World {
    /// Builds the world of a config; `seed` drives its random parts, `assets` loads its files.
    ///
    /// # Errors
    /// A value out of range, a file that cannot be read or understood, or demands that no world
    /// meets; keys are given from the root of a scenario (`world.…`).
    pub fn new(config: &WorldConfig, seed: u64, assets: &Assets<'_>) -> Result<Self, WorldError> {
        config.validate_under("world")?;
        let ground_m = config.ground.height_m;
        let people = build::people(config, seed, assets)?;
        let mut obstacles = build::obstacles(config, assets)?;
        if let Some(room) = &config.room {
            obstacles.extend(generate::room(room, ground_m));
        }
        if let Some(corridor) = &config.corridor {
            obstacles.extend(generate::corridor(corridor, seed, ground_m)?);
        }
        if let Some(forest) = &config.forest {
            obstacles.extend(generate::forest(forest, seed, ground_m, &people)?);
        }
        Ok(Self {
            ground_height_m: ground_m,
            ground_material: config.ground.material,
            obstacles,
            presence_s: people.iter().map(Person::presence_s).collect(),
            people,
        })
    }

    /// Height of the ground, m.
    pub fn ground_height_m(&self) -> f64 {
        self.ground_height_m
    }

    /// Surface of the ground.
    pub fn ground_material(&self) -> Material {
        self.ground_material
    }

    /// Everything that stands still, in the order of [`ThingId::Obstacle`].
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// The people who are in the world at a time.
    pub fn people_at(&self, time: Timestamp) -> impl Iterator<Item = PersonState> + '_ {
        let now_s = time.as_s();
        let there =
            move |(_, (first, last)): &(usize, &(f64, f64))| *first <= now_s && now_s <= *last;
        let state = move |(i, _): (usize, &(f64, f64))| {
            self.people[i].state(i as u32, self.ground_height_m, time)
        };
        self.presence_s
            .iter()
            .enumerate()
            .filter(there)
            .filter_map(state)
    }

    /// What a person calls a thing, for example `box 2`, `person 1` or `the ground`.
    pub fn describe(&self, what: ThingId) -> &str {
        let name = match what {
            ThingId::Ground => Some("the ground"),
            ThingId::Obstacle(i) => self.obstacles.get(i as usize).map(|o| o.name.as_str()),
            ThingId::Person(i) => self.people.get(i as usize).map(|p| p.name.as_str()),
        };
        name.unwrap_or("a thing of another world")
    }

    /// The first surface that a ray meets within `max_m`. The direction need not be of unit length;
    /// a ray from inside a thing meets its surface from within.
    pub fn cast_ray(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        max_m: f64,
        time: Timestamp,
    ) -> Option<Hit> {
        let ray = Ray {
            origin: *origin,
            direction: direction.try_normalize(0.0)?,
        };
        let mut best: Option<Hit> = None;
        let mut limit_m = max_m;
        let mut offer = |crossing: Option<Crossing>, material, what| {
            if let Some(hit) = crossing
                && (hit.distance_m < limit_m || (best.is_none() && hit.distance_m == limit_m))
            {
                limit_m = hit.distance_m;
                best = Some(seen_by(&ray, &hit, material, what));
            }
            limit_m
        };
        let ground = ray::horizontal_plane(&ray, self.ground_height_m);
        let mut reach_m = offer(ground, self.ground_material, ThingId::Ground);
        for (i, obstacle) in self.obstacles.iter().enumerate() {
            let crossing = obstacle.shape.cast(&ray, reach_m);
            reach_m = offer(crossing, obstacle.material, ThingId::Obstacle(i as u32));
        }
        for person in self.people_at(time) {
            let pose = person.world_from_person();
            let crossing = ray::ellipsoid(&ray, &pose, &person.semi_axes_m);
            offer(crossing, Material::Cloth, ThingId::Person(person.id));
        }
        best
    }

    /// Signed distance from a point to the nearest thing but the ground; `None` in an empty world.
    pub fn clearance(&self, point: &Point3<f64>, time: Timestamp) -> Option<Clearance> {
        let mut best = self.clearance_of_obstacles(point);
        for person in self.people_at(time) {
            let limit_m = best.map_or(f64::INFINITY, |b| b.distance_m);
            if (person.centre_world - point).norm() - person.semi_axes_m.max() > limit_m {
                continue;
            }
            let distance_m = person.distance(point);
            if distance_m < limit_m {
                let what = ThingId::Person(person.id);
                best = Some(Clearance { distance_m, what });
            }
        }
        best
    }

    /// Signed distance from a point to the nearest thing that stands still, but the ground.
    pub fn clearance_of_obstacles(&self, point: &Point3<f64>) -> Option<Clearance> {
        let mut best: Option<Clearance> = None;
        for (i, obstacle) in self.obstacles.iter().enumerate() {
            let limit_m = best.map_or(f64::INFINITY, |b| b.distance_m);
            let (centre, radius_m) = obstacle.ball;
            if (point - centre).norm() - radius_m > limit_m {
                continue;
            }
            let distance_m = obstacle.shape.distance(point, limit_m);
            if distance_m < limit_m {
                let what = ThingId::Obstacle(i as u32);
                best = Some(Clearance { distance_m, what });
            }
        }
        best
    }

    /// Refuses a place that lies below the ground, in a thing that stands still, or nearer to one
    /// than `radius_m`. People come and go, so they are not looked at.
    ///
    /// # Errors
    /// The thing in the way; `what` names what should be there, for example `waypoint 3`.
    pub fn check_free(
        &self,
        point: &Point3<f64>,
        radius_m: f64,
        what: &str,
    ) -> Result<(), WorldError> {
        let occupied = |relation: String, thing: ThingId| WorldError::Occupied {
            what: what.into(),
            point: *point,
            relation,
            thing: self.describe(thing).into(),
        };
        if point.z < self.ground_height_m {
            return Err(occupied("below".into(), ThingId::Ground));
        }
        let nearest = self.clearance_of_obstacles(point);
        match nearest.filter(|n| n.distance_m < radius_m.max(0.0)) {
            Some(n) if n.distance_m < 0.0 => Err(occupied("inside".into(), n.what)),
            Some(n) => {
                let relation = format!("{:.2} m (less than {radius_m:.2} m) from", n.distance_m);
                Err(occupied(relation, n.what))
            }
            None => Ok(()),
        }
    }

    /// Refuses a place to which somebody comes nearer than `radius_m` in the first `duration_s` of
    /// the simulation.
    ///
    /// # Errors
    /// The person in the way; `what` names what should be there, for example `the start`.
    pub fn check_deserted(
        &self,
        point: &Point3<f64>,
        radius_m: f64,
        duration_s: f64,
        what: &str,
    ) -> Result<(), WorldError> {
        let near = |person: &PersonState| person.distance(point) < radius_m;
        let passer = people::times(duration_s)
            .find_map(|time| self.people_at(time).find(near).map(|person| (time, person)));
        let Some((time, person)) = passer else {
            return Ok(());
        };
        Err(WorldError::Occupied {
            what: what.into(),
            point: *point,
            relation: format!("at {:.1} s less than {radius_m:.2} m from", time.as_s()),
            thing: self.describe(ThingId::Person(person.id)).into(),
        })
    }
}

/// A crossing as the ray sees it: the normal towards its origin.
fn seen_by(ray: &Ray, hit: &Crossing, material: Material, what: ThingId) -> Hit {
    let behind = hit.normal.dot(&ray.direction) > 0.0;
    Hit {
        distance_m: hit.distance_m,
        normal_world: if behind { -hit.normal } else { hit.normal },
        material,
        what,
    }
}

#[cfg(test)]
pub(crate) mod samples;
#[cfg(test)]
mod tests;
