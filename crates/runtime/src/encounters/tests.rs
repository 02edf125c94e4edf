use super::*;
use alula_messages::{Looking, Mount};
use alula_sim::sensors::DepthModel;
use nalgebra::{Translation3, UnitQuaternion};

/// Semi-axis of a person across, m.
const PERSON_M: f64 = 0.4;

/// A world with one person and whatever else the text says.
fn world(text: &str) -> World {
    let config = toml::from_str(text).unwrap();
    World::new(&config, 1, &|name| Err(format!("no {name}"))).unwrap()
}

fn camera() -> DepthSetup {
    DepthSetup {
        mount: Mount::at([0.0; 3], Looking::Forward),
        model: DepthModel::default(),
    }
}

/// The watch over a vehicle that hovers at the origin, 0.9 m high, heading `yaw_deg`, for
/// `duration_s`.
fn watched(text: &str, yaw_deg: f64, duration_s: f64, airborne: bool) -> Encounters {
    let world = world(text);
    let mut encounters = Encounters::new(0.4, [camera()].iter());
    let pose = Pose::from_parts(
        Translation3::new(0.0, 0.0, 0.9),
        UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_deg.to_radians()),
    );
    for i in 0..(250.0 * duration_s) as u32 {
        let time = Timestamp::from_s(0.004 * f64::from(i));
        encounters.push(&world, time, &pose, airborne);
    }
    encounters
}

/// Somebody who comes from the east at 1 m/s and turns back 0.6 m east of the vehicle, so that
/// their surface comes as near as 0.2 m, 3.4 s after the start.
const FROM_THE_EAST: &str = "[[people]]\nwaypoints_m = [[4.0, 0.0], [0.6, 0.0]]\nspeed_m_s = 1.0\n";

#[test]
fn the_least_distance_is_that_from_centre_to_surface() {
    let encounters = watched(FROM_THE_EAST, 0.0, 6.0, true);
    let least_m = encounters.min_distance_m().unwrap();
    // Looked at every 4 ms, at 1 m/s.
    assert!((least_m - (0.6 - PERSON_M)).abs() < 0.004, "{least_m}");
}

#[test]
fn who_comes_from_ahead_is_seen() {
    let encounters = watched(FROM_THE_EAST, 0.0, 6.0, true);
    let [contact] = encounters.contacts() else {
        panic!("{:?}", encounters.contacts());
    };
    // 0.4 m to the surface is 0.8 m to the centre.
    assert!((contact.t_s - 3.2).abs() < 0.01, "{contact:?}");
    assert!(contact.seen_s > 1.95 && !contact.unseen, "{contact:?}");
    assert_eq!((contact.who.as_str(), encounters.unseen()), ("person 1", 0));
    assert!((contact.min_distance_m - 0.2).abs() < 0.004);
}

#[test]
fn who_comes_from_behind_is_unseen() {
    let encounters = watched(FROM_THE_EAST, 180.0, 6.0, true);
    assert_eq!(encounters.contacts()[0].seen_s, 0.0);
    assert_eq!(encounters.unseen(), 1);
    assert!(encounters.came_unseen(0) && !encounters.came_unseen(1));
}

#[test]
fn who_stands_behind_a_wall_until_the_last_moment_is_unseen() {
    // The wall ends 0.05 m beside the line along which the person comes out from behind it.
    let corner = "[[people]]\nwaypoints_m = [[0.75, 3.0], [0.75, -3.0]]\nspeed_m_s = 2.0\n\
                  [[obstacles]]\nkind = \"wall\"\nfrom_m = [0.3, 0.25]\nto_m = [0.3, 4.0]\n\
                  height_m = 3.0\nthickness_m = 0.02\n";
    let open = corner.split("[[obstacles]]").next().unwrap();
    let unseen = |text| watched(text, 45.0, 2.0, true).contacts()[0].unseen;
    assert_eq!((unseen(corner), unseen(open)), (true, false));
}

#[test]
fn nobody_is_too_near_on_the_ground() {
    let encounters = watched(FROM_THE_EAST, 0.0, 6.0, false);
    assert_eq!(encounters.contacts(), []);
    assert_eq!(encounters.min_distance_m(), None);
}

#[test]
fn every_approach_is_a_contact_of_its_own() {
    // There and back takes 6.8 s.
    let encounters = watched(FROM_THE_EAST, 0.0, 12.0, true);
    assert_eq!(encounters.contacts().len(), 2);
}

#[test]
fn without_a_camera_everybody_comes_unseen() {
    let world = world(FROM_THE_EAST);
    let mut encounters = Encounters::new(0.4, [].iter());
    let pose = Pose::translation(0.0, 0.0, 0.9);
    for i in 0..400 {
        encounters.push(&world, Timestamp::from_s(0.01 * f64::from(i)), &pose, true);
    }
    assert_eq!(encounters.unseen(), 1);
}
