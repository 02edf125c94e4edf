//! The world as a whole, against sampling.

use super::samples::{assets, mixed_world};
use super::*;
use proptest::prelude::*;
use rand::RngExt;
use rand_pcg::Pcg64;

fn world(text: &str) -> World {
    World::new(&toml::from_str(text).unwrap(), 0, &assets).unwrap()
}

fn refusal(text: &str) -> String {
    let config = toml::from_str(text).unwrap();
    World::new(&config, 0, &assets).unwrap_err().to_string()
}

const ZERO: Timestamp = Timestamp::ZERO;

/// One world of each kind of shape, about the point (0, 0, 2), at most 1.5 m from it.
const SHAPES: [&str; 6] = [
    "kind = \"box\"\ncentre_m = [0, 0, 2]\nsize_m = [1.0, 0.6, 1.4]\nyaw_deg = 20",
    "kind = \"wall\"\nfrom_m = [-1, 0.2]\nto_m = [1, 0]\nheight_m = 2.5\nthickness_m = 0.4",
    "kind = \"cylinder\"\ncentre_m = [0.1, 0]\nradius_m = 0.5\nbottom_m = 1.0\nheight_m = 2",
    "kind = \"cylinder\"\ncentre_m = [0.1, 0]\nradius_m = 0.5",
    "kind = \"sphere\"\ncentre_m = [0, 0.1, 2]\nradius_m = 0.7",
    "kind = \"mesh\"\nfile = \"pyramid.obj\"\nposition_m = [0, 0, 1.5]\nscale = 0.7",
];

fn shape_world(index: usize) -> World {
    world(&format!("[[obstacles]]\n{}", SHAPES[index]))
}

/// Marches along a ray by the signed distance: slow, and independent of the analytic crossing.
fn march(world: &World, origin: &Point3<f64>, direction: &Vector3<f64>, max_m: f64) -> Option<f64> {
    let distance = |t: f64| {
        let p = origin + direction * t;
        let ground = (p.z - world.ground_height_m()).abs();
        let things = world
            .clearance(&p, ZERO)
            .map_or(f64::INFINITY, |c| c.distance_m.abs());
        ground.min(things)
    };
    let mut t = 1e-9;
    while t < max_m {
        let step = distance(t);
        if step < 1e-7 {
            return Some(t);
        }
        t += step;
    }
    None
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]
    #[test]
    fn rays_end_where_marching_by_distance_ends(
        shape in 0..SHAPES.len(),
        o in [-4.0..4.0_f64, -4.0..4.0_f64, 0.1..5.0_f64],
        d in [-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64],
    ) {
        let world = shape_world(shape);
        let (origin, direction) = (Point3::from(o), Vector3::from(d).normalize());
        let cast = world.cast_ray(&origin, &direction, 30.0, ZERO);
        match (cast, march(&world, &origin, &direction, 30.0)) {
            // Marching ends within 1e-7 m of the surface; the ray may graze it there.
            (Some(hit), Some(t)) => {
                let grazing = -hit.normal_world.dot(&direction);
                prop_assert!((hit.distance_m - t) * grazing < 2e-7 || grazing < 1e-3, "{hit:?} {t}");
                prop_assert!(t < hit.distance_m + 1e-7);
            }
            (None, Some(t)) => {
                let end = origin + direction * t;
                let near = world.clearance(&end, ZERO).unwrap().distance_m;
                prop_assert!(near > 0.0 && near < 1e-7 || t > 29.99, "missed at {t}");
            }
            (hit, None) => prop_assert!(hit.is_none_or(|h| h.distance_m > 29.99)),
        }
    }

    #[test]
    fn hits_lie_on_the_surface_and_normals_are_gradients_of_the_distance(
        shape in 0..SHAPES.len(),
        o in [-4.0..4.0_f64, -4.0..4.0_f64, 0.1..5.0_f64],
        aim in [-0.6..0.6_f64, -0.6..0.6_f64, 1.5..2.5_f64],
    ) {
        let world = shape_world(shape);
        let origin = Point3::from(o);
        let inside = world.clearance(&origin, ZERO).unwrap().distance_m < 0.0;
        let Some(hit) = world.cast_ray(&origin, &(Point3::from(aim) - origin), 30.0, ZERO) else {
            return Ok(());
        };
        if hit.what == ThingId::Ground {
            return Ok(());
        }
        let end = origin + (Point3::from(aim) - origin).normalize() * hit.distance_m;
        let near = |p: &Point3<f64>| world.clearance(p, ZERO).unwrap().distance_m;
        prop_assert!(near(&end).abs() < 1e-9);
        prop_assert!((hit.normal_world.norm() - 1.0).abs() < 1e-12);
        // A step along the normal leads away from the surface by its length, or further inside;
        // within a step of an edge inside a body another face is nearer.
        let step = 1e-6;
        let away = near(&(end + hit.normal_world * step));
        let expected = if inside { -step } else { step };
        prop_assert!((away - expected).abs() < 1e-9 || inside && away > expected, "{away}");
    }
}

#[test]
fn clearance_is_that_of_the_nearest_thing() {
    let world = world(&mixed_world(1, 100));
    let mut generator = Pcg64::new(5, 5);
    for i in 0..2000 {
        let time = Timestamp::from_s(f64::from(i) * 0.01);
        let mut coordinate = |span: f64| span * (2.0 * generator.random::<f64>() - 1.0);
        let p = Point3::new(coordinate(25.0), coordinate(25.0), 2.0 + coordinate(2.0));
        let things = world
            .obstacles()
            .iter()
            .map(|o| o.shape.distance(&p, f64::INFINITY));
        let people = world.people_at(time).map(|person| person.distance(&p));
        let expected = things.chain(people).fold(f64::INFINITY, f64::min);
        assert_eq!(world.clearance(&p, time).unwrap().distance_m, expected);
    }
}

#[test]
fn the_ground_has_no_clearance_but_stops_rays() {
    let world = world("[ground]\nheight_m = -1.0\nmaterial = \"concrete\"");
    assert_eq!(world.clearance(&Point3::origin(), ZERO), None);
    let down = Vector3::new(0.0, 3.0, -4.0);
    let hit = world
        .cast_ray(&Point3::origin(), &down, 10.0, ZERO)
        .unwrap();
    assert!((hit.distance_m - 1.25).abs() < 1e-12);
    assert_eq!(hit.what, ThingId::Ground);
    assert_eq!(hit.material, Material::Concrete);
    assert_eq!(hit.normal_world, Vector3::z());
    assert!(
        world
            .cast_ray(&Point3::origin(), &down, 1.0, ZERO)
            .is_none()
    );
    assert!(
        world
            .cast_ray(&Point3::origin(), &-down, 1e9, ZERO)
            .is_none()
    );
}

#[test]
fn people_are_met_where_they_are_at_the_time() {
    let world = world(
        "[[people]]\nwaypoints_m = [[5.0, -3.0], [5.0, 3.0]]\nspeed_m_s = 1.0\n\
         semi_axes_m = [0.2, 0.4, 0.9]",
    );
    let eye = Point3::new(0.0, 0.0, 0.9);
    let at = |t: f64| world.cast_ray(&eye, &Vector3::x(), 50.0, Timestamp::from_s(t));
    assert!(at(0.0).is_none());
    // The person walks north, so the eye sees the side of 0.4 m.
    let hit = at(3.0).unwrap();
    assert!((hit.distance_m - 4.6).abs() < 1e-12);
    assert_eq!(world.describe(hit.what), "person 1");
    assert_eq!(hit.material, Material::Cloth);
    let clearance = world.clearance(&eye, Timestamp::from_s(3.0)).unwrap();
    assert!((clearance.distance_m - 4.6).abs() < 1e-12);
}

#[test]
fn names_count_the_things_of_a_kind() {
    let world = world(&mixed_world(0, 20));
    let names: Vec<_> = world.obstacles().iter().map(|o| o.name.as_str()).collect();
    assert_eq!(
        names[..5],
        ["box 1", "box 2", "box 3", "cylinder 1", "cylinder 2"]
    );
    assert_eq!(names[19], "mesh 2");
    assert_eq!(world.describe(ThingId::Person(2)), "person 3");
}

#[test]
fn places_inside_things_are_refused_by_name() {
    let world = shape_world(0);
    let refused = |x: f64, z: f64, radius: f64| {
        world
            .check_free(&Point3::new(x, 0.0, z), radius, "waypoint 3")
            .map_err(|e| e.to_string())
    };
    assert_eq!(
        refused(0.1, 2.0, 0.3).unwrap_err(),
        "waypoint 3 at (0.10, 0.00, 2.00) m lies inside `box 1`; move it or the obstacle"
    );
    assert!(
        refused(0.8, 2.0, 0.5)
            .unwrap_err()
            .contains("m (less than 0.50 m) from `box 1`")
    );
    assert!(
        refused(3.0, -0.1, 0.0)
            .unwrap_err()
            .contains("lies below `the ground`")
    );
    assert_eq!(refused(3.0, 0.0, 0.5), Ok(()));
}

#[test]
fn worlds_that_cannot_be_are_refused_with_their_key() {
    let wall = "[[obstacles]]\nkind = \"wall\"\nfrom_m = [1, 1]\nto_m = [1, 1]\nheight_m = 2\nthickness_m = 0.1";
    assert!(refusal(wall).contains("`world.obstacles[0]`: `from_m` and `to_m` are the same place"));
    let mesh = "[[obstacles]]\nkind = \"mesh\"\nfile = \"x.stl\"\nposition_m = [0, 0, 0]";
    assert_eq!(
        refusal(mesh),
        "`world.obstacles[0].file`: cannot read `x.stl`: there is no `x.stl`"
    );
    assert!(refusal("[forest]").contains("`world.forest`: neither `count` nor"));
    assert!(refusal("[corridor]\npillars = 500").contains("`world.corridor` cannot be generated"));
    assert!(refusal("[[people]]").contains("`world.people[0]`: `waypoints_m` is empty"));
}

#[test]
fn a_room_encloses_its_size() {
    let world = world("[room]\nsize_m = [6.0, 4.0, 2.5]\nceiling = \"closed\"");
    let eye = Point3::new(0.0, 0.0, 1.0);
    for (direction, expected, name) in [
        (Vector3::x(), 3.0, "east wall of the room"),
        (-Vector3::y(), 2.0, "south wall of the room"),
        (Vector3::z(), 1.5, "ceiling of the room"),
    ] {
        let hit = world.cast_ray(&eye, &direction, 100.0, ZERO).unwrap();
        assert!((hit.distance_m - expected).abs() < 1e-12);
        assert_eq!(world.describe(hit.what), name);
    }
}

#[test]
fn equal_seeds_make_equal_worlds() {
    let config = toml::from_str("[forest]\ncount = 40\n[corridor]\npillars = 5").unwrap();
    let places = |seed| {
        let world = World::new(&config, seed, &assets).unwrap();
        let balls = world.obstacles().iter().map(|o| o.ball.0);
        balls.collect::<Vec<_>>()
    };
    assert_eq!(places(9), places(9));
    assert_ne!(places(9), places(10));
}

#[test]
fn recorded_people_come_and_go() {
    let config = toml::from_str("[[tracks]]\nfile = \"walk.csv\"").unwrap();
    let csv = |_: &str| Ok(b"t_s,id,x_m,y_m\n1.0,8,0,0\n2.0,8,1,0\n".to_vec());
    let world = World::new(&config, 0, &csv).unwrap();
    let present = |t: f64| world.people_at(Timestamp::from_s(t)).count();
    assert_eq!([0.5, 1.5, 2.5].map(present), [0, 1, 0]);
    assert_eq!(world.describe(ThingId::Person(0)), "person 1 (track 8)");
}

/// Somebody who walks east at 1 m/s on a line that takes 50 s, with a random start.
const WALKER: &str =
    "[[people]]\nwaypoints_m = [[0, 0], [50, 0]]\nspeed_m_s = 1.0\nstart_spread_s = 40.0\n";

/// Where the people of a world with this seed start.
fn starts_m(text: &str, seed: u64) -> Vec<f64> {
    let world = World::new(&toml::from_str(text).unwrap(), seed, &assets).unwrap();
    let at_start = world.people_at(ZERO);
    at_start.map(|person| person.centre_world.x).collect()
}

#[test]
fn another_person_does_not_change_where_the_others_start() {
    for seed in 0..20 {
        let [one, two] = [1, 2].map(|count| starts_m(&WALKER.repeat(count), seed));
        assert_eq!(one[0], two[0]);
        assert_ne!(two[0], two[1]);
    }
}

#[test]
fn starts_are_spread_evenly_over_the_seeds() {
    let starts: Vec<f64> = (0..2000).map(|seed| starts_m(WALKER, seed)[0]).collect();
    assert!(starts.iter().all(|s| (0.0..40.0).contains(s)));
    // The mean of 2000 has a standard deviation of 40 / sqrt(12 * 2000) = 0.26; five of them.
    let mean = starts.iter().sum::<f64>() / 2000.0;
    assert!((mean - 20.0).abs() < 1.3, "{mean}");
}

#[test]
fn people_of_one_recording_start_together() {
    let config = toml::from_str("[[tracks]]\nfile = \"walk.csv\"\nstart_spread_s = 5.0").unwrap();
    let csv = |_: &str| Ok(b"t_s,id,x_m,y_m\n0,1,0,0\n0,2,0,3\n9,1,9,0\n9,2,9,3\n".to_vec());
    let places = |seed| {
        let world = World::new(&config, seed, &csv).unwrap();
        let places: Vec<f64> = world.people_at(ZERO).map(|p| p.centre_world.x).collect();
        assert_eq!(places[0], places[1]);
        assert!((0.0..5.0).contains(&places[0]));
        places[0]
    };
    assert_ne!(places(1), places(2));
}

#[test]
fn no_trunk_stands_where_somebody_walks() {
    let forest = "[forest]\nmin_m = [0, -6]\nmax_m = [12, 6]\ncount = 12\nradius_m = [0.2, 0.6]\n\
                  clear_gap_m = 1.4\nclear_of_people_s = 30.0\n\
                  [[people]]\nwaypoints_m = [[2, -8], [7, 8]]\nstart_spread_s = 20.0\n";
    for seed in 0..50 {
        let world = World::new(&toml::from_str(forest).unwrap(), seed, &assets).unwrap();
        for i in 0..3000 {
            for person in world.people_at(Timestamp::from_s(0.01 * f64::from(i))) {
                let nearest = world.clearance_of_obstacles(&person.centre_world).unwrap();
                // Half a step of 0.12 m aside of a place that is 0.5 m away comes 4 mm nearer.
                assert!(nearest.distance_m > 0.4 + 0.1 - 0.004, "{nearest:?}");
            }
        }
    }
}

#[test]
fn a_place_that_somebody_crosses_in_time_is_refused_by_name() {
    let world = world("[[people]]\nwaypoints_m = [[-5, 0], [5, 0]]\nspeed_m_s = 1.0");
    let start = Point3::new(0.0, 0.0, 0.9);
    let check = |duration_s| world.check_deserted(&start, 0.3, duration_s, "the start");
    // The person's surface is 0.3 m away after 4.3 s.
    assert_eq!(check(4.2), Ok(()));
    assert_eq!(
        check(10.0).unwrap_err().to_string(),
        "the start at (0.00, 0.00, 0.90) m lies at 4.4 s less than 0.30 m from `person 1`; move it \
         or the obstacle"
    );
}
