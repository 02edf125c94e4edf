//! Who came how near: true distances between the flying vehicle and people, and whether its depth
//! cameras could have seen those who came too near. It judges a flight; nothing that flies sees it.

use std::collections::BTreeMap;

use alula_geometry::{PinholeCamera, Pose, Timestamp};
use alula_sim::sensors::DepthSetup;
use alula_sim::world::{PersonState, ThingId, World};
use nalgebra::{Point3, Vector3};
use serde::Serialize;

/// Time between two looks through the depth camera, s.
const LOOK_S: f64 = 0.02;

/// Looks that are remembered: those of the last two seconds.
const REMEMBERED_LOOKS: u32 = 100;

/// A person who was in view for less than this in the remembered time came unseen, s.
const SEEN_S: f64 = 0.4;

/// Greatest depth at which a person counts as seen, m: that of the maps of obstacles (document L,
/// section 5-1-3).
const SIGHT_M: f64 = 5.0;

/// A contact is over when the person is this much further away than the distance that began it, m.
const RELEASE_M: f64 = 0.05;

/// A person who came nearer than allowed to the flying vehicle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Contact {
    /// When the distance fell below the allowed one, s from the start.
    pub t_s: f64,
    /// Who it was.
    pub who: String,
    /// Least distance from the vehicle's centre to the person's ellipsoid during the contact, m.
    pub min_distance_m: f64,
    /// How long the person was in view in the two seconds before, s.
    pub seen_s: f64,
    /// Whether the person came from outside the field of view: in view for less than 0.4 s.
    pub unseen: bool,
    #[serde(skip)]
    person: u32,
    #[serde(skip)]
    over: bool,
}

/// A depth camera as it is fixed to the true vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Eye {
    body_from_camera: Pose,
    camera: PinholeCamera,
    min_m: f64,
    max_m: f64,
}

/// Watches a flight for people who come near.
#[derive(Clone, Debug)]
pub struct Encounters {
    contact_distance_m: f64,
    eyes: Vec<Eye>,
    next_look_s: f64,
    /// Looks at each person who was ever in view, the last one in the lowest bit.
    looks: BTreeMap<u32, u128>,
    min_distance_m: Option<f64>,
    contacts: Vec<Contact>,
}

impl Encounters {
    /// A watch over a vehicle with these depth cameras; a contact is nearer than
    /// `contact_distance_m`.
    pub fn new<'a>(
        contact_distance_m: f64,
        depth_cameras: impl Iterator<Item = &'a DepthSetup>,
    ) -> Self {
        Self {
            contact_distance_m,
            eyes: depth_cameras.map(Eye::new).collect(),
            next_look_s: 0.0,
            looks: BTreeMap::new(),
            min_distance_m: None,
            contacts: Vec::new(),
        }
    }

    /// Takes the true state at one time in. Times come in order. On the ground nobody is too near.
    pub fn push(&mut self, world: &World, time: Timestamp, world_from_body: &Pose, airborne: bool) {
        if time.as_s() >= self.next_look_s {
            self.next_look_s = time.as_s() + LOOK_S - 1e-6;
            self.look(world, time, world_from_body);
        }
        if airborne {
            let centre = Point3::from(world_from_body.translation.vector);
            for person in world.people_at(time) {
                self.measure(world, time, &centre, &person);
            }
        }
    }

    /// Least distance from the vehicle's centre to a person's ellipsoid while it flew, m; `None` if
    /// nobody was there.
    pub fn min_distance_m(&self) -> Option<f64> {
        self.min_distance_m
    }

    /// Who came nearer than allowed, in the order of time.
    pub fn contacts(&self) -> &[Contact] {
        &self.contacts
    }

    /// Contacts with people who came from outside the field of view.
    pub fn unseen(&self) -> u32 {
        self.contacts.iter().filter(|c| c.unseen).count() as u32
    }

    /// Whether the last contact with this person began unseen.
    pub fn came_unseen(&self, person: u32) -> bool {
        let mut newest_first = self.contacts.iter().rev();
        newest_first
            .find(|c| c.person == person)
            .is_some_and(|c| c.unseen)
    }

    /// Notes who is in view.
    fn look(&mut self, world: &World, time: Timestamp, world_from_body: &Pose) {
        for looks in self.looks.values_mut() {
            *looks = (*looks << 1) & ((1 << REMEMBERED_LOOKS) - 1);
        }
        for person in world.people_at(time) {
            let sees = |eye: &Eye| eye.sees(world, time, world_from_body, &person);
            if self.eyes.iter().any(sees) {
                *self.looks.entry(person.id).or_default() |= 1;
            }
        }
    }

    fn measure(
        &mut self,
        world: &World,
        time: Timestamp,
        centre: &Point3<f64>,
        person: &PersonState,
    ) {
        let reach_m = person.semi_axes_m.max();
        let at_least_m = (person.centre_world - centre).norm() - reach_m;
        let known_m = self.min_distance_m.unwrap_or(f64::INFINITY);
        if at_least_m > known_m.max(self.contact_distance_m + RELEASE_M) {
            return;
        }
        let distance_m = person.distance(centre);
        self.min_distance_m = Some(known_m.min(distance_m));
        self.note_contact(world, time, person.id, distance_m);
    }

    fn note_contact(&mut self, world: &World, time: Timestamp, person: u32, distance_m: f64) {
        let open = |c: &&mut Contact| c.person == person && !c.over;
        if let Some(contact) = self.contacts.iter_mut().rev().find(open) {
            contact.min_distance_m = contact.min_distance_m.min(distance_m);
            contact.over = distance_m > self.contact_distance_m + RELEASE_M;
        } else if distance_m < self.contact_distance_m {
            let looks = self
                .looks
                .get(&person)
                .map_or(0, |looks| looks.count_ones());
            let seen_s = LOOK_S * f64::from(looks);
            self.contacts.push(Contact {
                t_s: time.as_s(),
                who: world.describe(ThingId::Person(person)).to_owned(),
                min_distance_m: distance_m,
                seen_s,
                // Half a look less, for the sum of looks is no exact number.
                unseen: seen_s < SEEN_S - 0.5 * LOOK_S,
                person,
                over: false,
            });
        }
    }
}

impl Eye {
    /// The eye of a vehicle with this depth camera.
    pub(crate) fn new(depth: &DepthSetup) -> Self {
        Self {
            body_from_camera: depth.mount.body_from_sensor(),
            camera: depth.model.camera(),
            min_m: depth.model.min_m,
            max_m: depth.model.max_m.min(SIGHT_M),
        }
    }

    /// Whether any of nine points of the person, three heights by three across, is in view of a
    /// vehicle with this true pose.
    pub(crate) fn sees(
        &self,
        world: &World,
        time: Timestamp,
        world_from_body: &Pose,
        person: &PersonState,
    ) -> bool {
        let world_from_camera = world_from_body * self.body_from_camera;
        let camera = Point3::from(world_from_camera.translation.vector);
        let towards = person.centre_world - camera;
        if towards.norm() > 2.0 * self.max_m + person.semi_axes_m.max() {
            return false;
        }
        let across = Vector3::new(-towards.y, towards.x, 0.0);
        let across = across.try_normalize(1e-9).unwrap_or(Vector3::x());
        let half_width_m = person.semi_axes_m.x.min(person.semi_axes_m.y);
        [0.0, -0.5, 0.5].into_iter().any(|up| {
            [0.0, -0.7, 0.7].into_iter().any(|aside| {
                let inside =
                    Vector3::z() * (up * person.semi_axes_m.z) + across * (aside * half_width_m);
                self.sees_point(world, time, &world_from_camera, person, inside)
            })
        })
    }

    /// Whether the surface of the person in front of a point within them, given from their centre,
    /// is in the image, in the range of depths and not hidden.
    fn sees_point(
        &self,
        world: &World,
        time: Timestamp,
        world_from_camera: &Pose,
        person: &PersonState,
        inside: Vector3<f64>,
    ) -> bool {
        let camera = Point3::from(world_from_camera.translation.vector);
        let point = person.centre_world + inside;
        let in_camera = world_from_camera.inverse_transform_point(&point);
        let Some(pixel) = self.camera.project(&in_camera) else {
            return false;
        };
        if !self.camera.contains(&pixel) {
            return false;
        }
        let towards = point - camera;
        let cosine = in_camera.z / towards.norm();
        let hit = world.cast_ray(&camera, &towards, self.max_m / cosine, time);
        hit.is_some_and(|hit| {
            hit.what == ThingId::Person(person.id) && hit.distance_m * cosine >= self.min_m
        })
    }
}

#[cfg(test)]
mod tests;
