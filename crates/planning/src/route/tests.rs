use super::*;
use alula_geometry::Timestamp;
use alula_messages::{ObstacleCovariance, ObstacleMotion, Sight};

fn thing(id: u32, centre: [f64; 2], size: [f64; 2], footprint: Footprint) -> Obstacle {
    Obstacle {
        id,
        time: Timestamp::ZERO,
        centre_world: Vector3::new(centre[0], centre[1], 1.25),
        velocity_world: Vector3::zeros(),
        covariance: ObstacleCovariance::zeros(),
        yaw_rad: 0.0,
        size_m: Vector3::new(size[0], size[1], 2.5),
        size_variance_m2: Vector3::zeros(),
        footprint,
        motion: ObstacleMotion::Static,
        sight: Sight::Seen,
        last_seen: Timestamp::ZERO,
        images: 10,
    }
}

fn pillar(id: u32, x: f64, y: f64) -> Obstacle {
    thing(id, [x, y], [0.6, 0.6], Footprint::Round)
}

const START: Vector3<f64> = Vector3::new(0.0, 0.0, 1.2);

fn route(goal: [f64; 2], obstacles: &[Obstacle]) -> (Route, RoutePlanner) {
    let mut planner = RoutePlanner::new(&RouteConfig::default()).unwrap();
    let goal = Vector3::new(goal[0], goal[1], 1.2);
    (planner.route(&START, &goal, obstacles, |_| true), planner)
}

/// Least distance from the points of a way to an obstacle's surface, m.
fn distance_kept(planner: &RoutePlanner, obstacle: &Obstacle) -> f64 {
    let of = |point: &Vector2<f64>| clearance(obstacle, point, 0.0);
    planner.way().iter().map(of).fold(f64::INFINITY, f64::min)
}

#[test]
fn an_open_way_is_straight_to_the_goal() {
    let (route, _) = route([3.0, 1.0], &[]);
    assert_eq!(route.end, RouteEnd::Goal);
    assert!((route.target_world - Vector3::new(3.0, 1.0, 1.2)).norm() < 1e-9);
}

#[test]
fn a_pillar_on_the_line_is_passed_at_the_radius_or_more() {
    let obstacle = pillar(7, 3.0, 0.05);
    let (route, planner) = route([6.0, 0.0], &[obstacle]);
    assert_eq!(route.end, RouteEnd::Goal);
    assert!(distance_kept(&planner, &obstacle) >= RouteConfig::default().radius_m);
    assert!(route.length_m < 7.5, "{}", route.length_m);
}

#[test]
fn a_wall_with_one_door_is_passed_through_the_door() {
    // The wall reaches beyond the grid on both sides; the door is from y = 3.0 to 4.6.
    let walls = [
        thing(1, [2.0, -4.0], [0.1, 14.0], Footprint::Flat),
        thing(2, [2.0, 8.3], [0.1, 7.4], Footprint::Flat),
    ]
    .map(|mut wall| {
        wall.size_m = Vector3::new(wall.size_m.y, 0.1, 2.5);
        wall.yaw_rad = std::f64::consts::FRAC_PI_2;
        wall
    });
    let (route, planner) = route([5.0, 0.0], &walls);
    assert_eq!(route.end, RouteEnd::Goal);
    let crossing = planner.way().iter().find(|p| p.x > 2.0).unwrap();
    assert!(crossing.y > 3.4 && crossing.y < 4.2, "{crossing}");
}

#[test]
fn a_goal_in_an_obstacle_ends_the_way_before_it_and_names_it() {
    let (route, planner) = route([3.0, 0.0], &[pillar(42, 3.0, 0.0)]);
    let expected = RouteEnd::Closed {
        obstacle: 42,
        at_goal: true,
    };
    assert_eq!(route.end, expected);
    let left = (planner.way().last().unwrap() - Vector2::new(3.0, 0.0)).norm();
    assert!(left > 0.7 && left < 1.2, "{left}");
}

#[test]
fn a_start_inside_an_inflated_obstacle_leads_out() {
    let obstacle = pillar(1, 0.5, 0.0);
    let (route, _) = route([-4.0, 0.0], &[obstacle]);
    assert_eq!(route.end, RouteEnd::Goal);
    assert!(route.target_world.x < -0.2, "{}", route.target_world);
}

#[test]
fn a_goal_outside_the_grid_is_approached_to_its_edge() {
    let (route, _) = route([100.0, 20.0], &[]);
    assert_eq!(route.end, RouteEnd::Edge);
    let direction = route.target_world.xy();
    assert!((direction.y / direction.x - 0.2).abs() < 0.1);
    assert!((route.length_m - 102.0).abs() < 2.0);
}

#[test]
fn the_side_once_chosen_is_kept_when_the_obstacle_moves_a_little() {
    let mut planner = RoutePlanner::new(&RouteConfig::default()).unwrap();
    let goal = Vector3::new(6.0, 0.0, 1.2);
    let mut side = 0.0;
    for i in 0..40 {
        let y = if i % 2 == 0 { 0.08 } else { -0.08 };
        planner.route(&START, &goal, &[pillar(1, 3.0, y)], |_| true);
        let beside = planner.way().iter().find(|p| p.x > 2.9).unwrap().y;
        assert!(side == 0.0 || side * beside > 0.0, "changed sides");
        side = beside;
    }
}

#[test]
fn things_below_the_flight_do_not_close_the_way() {
    let mut low = pillar(1, 2.0, 0.0);
    low.centre_world.z = 0.2;
    low.size_m.z = 0.4;
    let (route, _) = route([4.0, 0.0], &[low]);
    assert!((route.length_m - 4.0).abs() < 0.3);
}

#[test]
fn numbers_that_are_not_finite_do_no_harm() {
    let mut broken = pillar(1, f64::NAN, 0.0);
    broken.size_m.x = f64::INFINITY;
    let (route, _) = route([4.0, 0.0], &[broken]);
    assert_eq!(route.end, RouteEnd::Goal);
}
