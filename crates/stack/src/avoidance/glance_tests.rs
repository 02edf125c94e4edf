use super::*;
use alula_geometry::TimeDelta;
use alula_messages::ObstacleCovariance;
use nalgebra::Vector3;

/// Half of the view of the camera, rad.
const HALF_VIEW_RAD: f64 = 0.75;

/// The camera of the vehicle.
fn eye_ahead() -> Eye {
    Eye::new(0.0, HALF_VIEW_RAD)
}

/// Someone at a place with a velocity, seen at this time.
fn walker(place: [f64; 2], velocity: [f64; 2], last_seen_s: f64) -> Obstacle {
    Obstacle {
        id: 1,
        time: Timestamp::ZERO,
        centre_world: Vector3::new(place[0], place[1], 0.9),
        velocity_world: Vector3::new(velocity[0], velocity[1], 0.0),
        covariance: ObstacleCovariance::zeros(),
        yaw_rad: 0.0,
        size_m: Vector3::new(0.8, 0.8, 1.8),
        size_variance_m2: Vector3::zeros(),
        footprint: Footprint::Round,
        motion: ObstacleMotion::Moving,
        sight: Sight::Seen,
        last_seen: Timestamp::from_s(last_seen_s),
        images: 20,
    }
}

/// A vehicle at the origin that flies along x, at this time.
fn flying(now_s: f64, speed_m_s: f64) -> NavState {
    NavState {
        time: Timestamp::from_s(now_s),
        velocity_world: Vector3::new(speed_m_s, 0.0, 0.0),
        ..NavState::default()
    }
}

/// A vehicle that has looked ahead for five seconds, and saw somebody far away.
fn looked_ahead() -> Glance {
    let mut glance = Glance::new();
    let somebody = [walker([9.0, 0.0], [1.2, 0.0], 0.0)];
    for step in 0..=50 {
        let time = Timestamp::from_s(0.1 * f64::from(step));
        glance.note(time, 0, eye_ahead(), 0.0, &somebody);
    }
    glance
}

fn heading(glance: &mut Glance, state: &NavState, known: &[Obstacle]) -> Option<f64> {
    let soon = state.velocity_world.xy();
    glance.heading(state, 0.0, &soon, known, &ConductConfig::default())
}

/// How urgent it is to look at walkers for a vehicle that keeps its velocity.
fn walkers_of(state: &NavState, way_rad: f64, known: &[Obstacle]) -> [f64; SECTORS] {
    let walker_m_s = ConductConfig::default().walker_m_s;
    let soon = state.velocity_world.xy();
    Glance::new().walkers(state, way_rad, &soon, known, walker_m_s)
}

#[test]
fn where_nobody_is_the_vehicle_looks_ahead() {
    let mut glance = Glance::new();
    glance.note(Timestamp::ZERO, 0, eye_ahead(), 0.0, &[]);
    assert_eq!(heading(&mut glance, &flying(0.1, 0.2), &[]), None);
}

/// The eyes to the sides show him with less turning than the eye ahead alone would need.
#[test]
fn who_has_eyes_on_all_sides_turns_little_for_who_is_lost() {
    let mut glance = looked_ahead();
    for camera in 1..4 {
        let offset_rad = camera as f64 * 0.25 * TAU;
        let eye = Eye::new(offset_rad, HALF_VIEW_RAD);
        glance.note(Timestamp::from_s(4.0), camera, eye, offset_rad, &[]);
    }
    let lost = walker([0.0, 1.5], [0.0, -0.5], 4.5);
    let alone = heading(&mut looked_ahead(), &flying(5.0, 0.5), &[lost]).unwrap();
    let together = heading(&mut glance, &flying(5.0, 0.5), &[lost]);
    assert!(alone > 0.8, "{alone}");
    assert!(together.is_none_or(|turn| turn.abs() < 0.6), "{together:?}");
}

#[test]
fn the_vehicle_looks_ahead_again_when_nobody_was_seen_for_long() {
    let mut glance = looked_ahead();
    let later_s = 5.0 + ConductConfig::default().wary_s + 1.0;
    assert_eq!(heading(&mut glance, &flying(later_s, 0.2), &[]), None);
}

#[test]
fn who_left_the_view_beside_the_vehicle_is_looked_for() {
    let lost = walker([0.5, 1.6], [0.0, 1.2], 4.5);
    let heading = heading(&mut looked_ahead(), &flying(5.0, 1.2), &[lost]).unwrap();
    let bearing = 1.6_f64.atan2(0.5);
    assert!((heading - bearing).abs() < HALF_VIEW_RAD, "{heading}");
}

#[test]
fn who_cannot_catch_up_is_not_looked_for() {
    let behind = walker([-1.5, 0.0], [1.2, 0.0], 4.0);
    let urgency = walkers_of(&flying(5.0, 2.0), 0.0, &[behind]);
    assert!(urgency.iter().all(|u| *u == 0.0));
}

/// However long he was out of sight, and though he is nearer than he could have come meanwhile.
#[test]
fn who_was_left_behind_is_not_looked_for() {
    let mut behind = walker([-1.2, 0.4], [0.0, 1.2], 3.5);
    behind.sight = Sight::OutOfView;
    behind.covariance.fill_diagonal(0.5);
    let urgency = walkers_of(&flying(5.0, 1.5), 0.0, &[behind]);
    assert!(urgency.iter().all(|u| *u == 0.0));
    // A vehicle that is about to stop is caught up.
    let soon = Vector2::zeros();
    let urgency = Glance::new().walkers(&flying(5.0, 1.5), 0.0, &soon, &[behind], 1.3);
    assert!(urgency.iter().sum::<f64>() > 1.0);
}

/// One heading that shows both is better than one that shows the more urgent alone.
#[test]
fn two_walkers_are_looked_at_together() {
    let (left, right) = (0.44_f64, -0.26_f64);
    let at = |bearing_rad: f64| {
        let place = [2.0 * bearing_rad.cos(), 2.0 * bearing_rad.sin()];
        walker(
            place,
            [-0.8 * bearing_rad.cos(), -0.8 * bearing_rad.sin()],
            5.0,
        )
    };
    let known = [at(left), at(right)];
    let heading = heading(&mut looked_ahead(), &flying(5.0, 0.8), &known).unwrap();
    for bearing_rad in [left, right] {
        let off = wrap_angle(bearing_rad - heading).abs();
        assert!(
            off < HALF_VIEW_RAD - BORDER_RAD,
            "{bearing_rad} from {heading}"
        );
    }
}

#[test]
fn who_was_passed_is_looked_for_before_the_vehicle_turns_to_his_side() {
    let passed = walker([-0.7, -1.1], [1.2, 0.0], 4.5);
    let urgency = |way_rad| {
        let all = walkers_of(&flying(5.0, 1.5), way_rad, &[passed]);
        all.into_iter().fold(0.0, f64::max)
    };
    assert_eq!(urgency(0.0), 0.0);
    assert!(urgency(-1.1) > 1.0);
}

#[test]
fn who_is_not_where_he_should_be_is_looked_for_beside() {
    let mut lost = walker([1.0, 0.5], [-1.0, 0.0], 4.0);
    lost.sight = Sight::Missed;
    lost.covariance.fill_diagonal(1.0);
    let state = flying(5.0, 0.5);
    let mut glance = looked_ahead();
    let soon = state.velocity_world.xy();
    let urgency = |glance: &Glance| glance.walkers(&state, 0.0, &soon, &[lost], 1.3);
    let sector = |bearing_rad: f64| ((bearing_rad + PI) / TAU * SECTORS as f64) as usize;
    let ahead = urgency(&glance);
    assert_eq!(ahead[sector(0.46)], 0.0);
    assert!(ahead[sector(1.0)] > 0.0);
    // Once looked at, that is no place to look either.
    glance.note(Timestamp::from_s(5.0), 0, eye_ahead(), 1.2, &[]);
    assert_eq!(urgency(&glance)[sector(1.0)], 0.0);
}

#[test]
fn a_near_walker_is_kept_in_view_and_counts_more_than_a_far_one_lost_for_long() {
    let near = walker([1.4, 0.3], [-1.0, 0.0], 5.0);
    let far = walker([-3.0, 3.0], [1.0, -0.5], 1.0);
    let state = flying(5.0, 0.3);
    let urgency = walkers_of(&state, 0.0, &[far, near]);
    let of = |walker: &Obstacle| {
        let (middle_rad, _) = whereabouts(walker, &state);
        let nearest = |sector: &usize| wrap_angle(bearing(*sector) - middle_rad).abs() < 0.09;
        (0..SECTORS)
            .filter(nearest)
            .map(|s| urgency[s])
            .sum::<f64>()
    };
    assert!(of(&near) > of(&far) && of(&far) > 0.0);
}

#[test]
fn of_two_lost_walkers_the_one_who_comes_near_is_looked_at_first() {
    let comes = walker([1.5, 2.2], [0.0, -1.2], 4.6);
    let leaves = walker([1.5, -2.2], [0.0, -1.2], 4.6);
    let turn = heading(&mut looked_ahead(), &flying(5.0, 1.0), &[leaves, comes]);
    assert!(turn.unwrap() > 0.0);
}

#[test]
fn a_slow_vehicle_looks_round_and_a_fast_one_ahead() {
    let mut slow = looked_ahead();
    let mut turned = 0.0_f64;
    for step in 0..60 {
        let now_s = 5.0 + 0.1 * f64::from(step);
        let look = heading(&mut slow, &flying(now_s, 0.2), &[]).unwrap_or(0.0);
        let nobody = [];
        slow.note(Timestamp::from_s(now_s), 0, eye_ahead(), look, &nobody);
        turned = turned.max(look.abs());
    }
    assert!(turned > 2.0, "{turned}");
    let fast = heading(&mut looked_ahead(), &flying(5.0, 3.0), &[]);
    assert!(fast.is_none_or(|look| look.abs() < 0.1), "{fast:?}");
}

#[test]
fn no_direction_stays_unseen_for_two_turns_of_a_slow_vehicle() {
    let mut glance = looked_ahead();
    let mut yaw = 0.0;
    for step in 0..200 {
        let now = Timestamp::from_s(5.0) + TimeDelta::from_s(0.05 * f64::from(step));
        let mut state = flying(now.as_s(), 0.2);
        state.world_from_body.rotation = so3::from_roll_pitch_yaw(0.0, 0.0, yaw);
        if let Some(wanted) = heading(&mut glance, &state, &[]) {
            yaw += wrap_angle(wanted - yaw).clamp(-0.1, 0.1);
        }
        glance.note(
            now,
            0,
            eye_ahead(),
            yaw,
            &[walker([9.0, 0.0], [1.2, 0.0], 0.0)],
        );
        if step > 120 {
            // At 2 rad/s.
            let oldest = (0..SECTORS).map(|s| now.seconds_since(glance.seen[s].unwrap()));
            let oldest_s = oldest.fold(0.0, f64::max);
            assert!(oldest_s < 2.0 * TAU / 2.0, "{oldest_s} at {step}");
        }
    }
}

#[test]
fn the_nearest_approach_is_where_the_line_is_met_at_a_right_angle() {
    let (time_s, nearest_m) =
        nearest_approach(&Vector2::new(3.0, 1.0), &Vector2::new(-1.5, 0.0), 5.0);
    assert_eq!((time_s, nearest_m), (2.0, 1.0));
    let (_, at_end_m) = nearest_approach(&Vector2::new(3.0, 1.0), &Vector2::new(-1.5, 0.0), 1.0);
    assert!((at_end_m - 1.5_f64.hypot(1.0)).abs() < 1e-12);
}
