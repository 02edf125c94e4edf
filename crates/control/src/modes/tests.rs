use super::*;
use alula_geometry::{GRAVITY_M_S2, TimeDelta};
use nalgebra::Vector3;

const STEP_S: f64 = 0.01;
const HOVER: f64 = 0.45;

/// Modes with a situation that the tests change at will.
struct Bench {
    modes: FlightModes,
    time: Timestamp,
    state: NavState,
    range_m: Option<f64>,
    thrust: f64,
    trajectory: Progress,
    guard: Fallback,
}

impl Bench {
    fn new() -> Self {
        let state = NavState {
            health: EstimateHealth::Good,
            ..NavState::default()
        };
        Self {
            modes: FlightModes::new(&FlightModesConfig::default()).unwrap(),
            time: Timestamp::from_s(100.0),
            state,
            range_m: Some(0.05),
            thrust: 0.0,
            trajectory: Progress::Absent,
            guard: Fallback::None,
        }
    }

    fn hovering() -> Self {
        let mut bench = Self::new();
        bench.ask(Intent::Arm).unwrap();
        bench.ask(Intent::TakeOff { height_m: 1.5 }).unwrap();
        bench.thrust = HOVER;
        bench.rise_to(1.5);
        bench.run(2.0);
        assert_eq!(bench.modes.mode(), FlightMode::Hovering);
        bench
    }

    fn landing() -> Self {
        let mut bench = Self::hovering();
        bench.ask(Intent::Land).unwrap();
        bench
    }

    fn rise_to(&mut self, height_m: f64) {
        self.state.world_from_body.translation.vector.z = height_m;
        self.range_m = Some(height_m + 0.05);
    }

    fn with<T>(&mut self, f: impl FnOnce(&mut FlightModes, &Situation) -> T) -> T {
        let situation = Situation {
            time: self.time,
            state: &self.state,
            height_above_ground_m: self.range_m,
            thrust_fraction: self.thrust,
            trajectory: self.trajectory,
            guard: self.guard,
        };
        f(&mut self.modes, &situation)
    }

    fn ask(&mut self, intent: Intent) -> Result<(), Refusal> {
        self.with(|modes, situation| modes.request(&intent, situation))
    }

    fn step(&mut self) -> FlightMode {
        self.time += TimeDelta::from_s(STEP_S);
        self.with(FlightModes::update)
    }

    fn run(&mut self, seconds: f64) -> FlightMode {
        for _ in 0..(seconds / STEP_S).round() as usize {
            self.step();
        }
        self.modes.mode()
    }

    /// Seconds until the mode is `mode`, at most `limit_s`.
    fn seconds_until(&mut self, mode: FlightMode, limit_s: f64) -> Option<f64> {
        let begin = self.time;
        while self.time.seconds_since(begin) < limit_s {
            if self.step() == mode {
                return Some(self.time.seconds_since(begin));
            }
        }
        None
    }

    /// Stands on the ground while the controller, asked to descend, gives less and less thrust.
    fn stand(&mut self) {
        self.rise_to(0.0);
        self.state.velocity_world = Vector3::zeros();
        self.state.acceleration_world = Vector3::zeros();
        self.thrust = 0.3 * HOVER;
    }
}

fn fly() -> Intent {
    Intent::Fly {
        waypoints_world: vec![Vector3::new(1.0, 2.0, 1.5)],
    }
}

fn wrong_mode(mode: FlightMode) -> Result<(), Refusal> {
    Err(Refusal::WrongMode { mode })
}

#[test]
fn the_default_limits_are_valid() {
    assert!(FlightModes::new(&FlightModesConfig::default()).is_ok());
}

#[test]
fn heights_in_the_wrong_order_are_not_accepted() {
    let config = FlightModesConfig {
        min_height_m: 2.0,
        max_height_m: 1.0,
        ..FlightModesConfig::default()
    };
    assert_eq!(FlightModes::new(&config).unwrap_err().key, "min_height_m");
}

#[test]
fn a_whole_flight_goes_through_all_its_modes() {
    let mut bench = Bench::hovering();
    bench.ask(fly()).unwrap();
    bench.trajectory = Progress::Running;
    assert_eq!(bench.run(3.0), FlightMode::Flying);
    bench.trajectory = Progress::Finished;
    assert_eq!(bench.step(), FlightMode::Hovering);
    bench.ask(Intent::Land).unwrap();
    assert_eq!(bench.run(1.0), FlightMode::Landing);
    bench.stand();
    assert_eq!(bench.run(1.0), FlightMode::Disarmed);
}

#[test]
fn arming_needs_a_good_estimate() {
    for health in [
        EstimateHealth::Initialising,
        EstimateHealth::Failed,
        EstimateHealth::Degraded {
            since_velocity_s: 1.0,
            since_height_s: 0.0,
        },
    ] {
        let mut bench = Bench::new();
        bench.state.health = health;
        assert_eq!(bench.ask(Intent::Arm), Err(Refusal::EstimateNotReady));
    }
}

#[test]
fn arming_is_refused_while_tilted_moving_or_turning() {
    let limit = FlightModesConfig::default();
    for (excess, allowed) in [(1.1, false), (0.9, true)] {
        let mut tilted = Bench::new();
        let angle_rad = (limit.arm_tilt_deg * excess).to_radians();
        tilted.state.world_from_body.rotation = so3::from_roll_pitch_yaw(angle_rad, 0.0, 1.0);
        let mut moving = Bench::new();
        moving.state.velocity_world.y = limit.arm_speed_m_s * excess;
        let mut turning = Bench::new();
        turning.state.angular_rate_body.z = limit.arm_rate_rad_s * excess;
        for mut bench in [tilted, moving, turning] {
            assert_eq!(bench.ask(Intent::Arm).is_ok(), allowed);
        }
    }
}

#[test]
fn arming_is_refused_with_an_estimate_that_is_not_finite() {
    let mut bench = Bench::new();
    bench.state.velocity_world.x = f64::NAN;
    assert_eq!(bench.ask(Intent::Arm), Err(Refusal::EstimateNotReady));
}

#[test]
fn only_an_armed_vehicle_takes_off() {
    let mut bench = Bench::new();
    let take_off = Intent::TakeOff { height_m: 1.0 };
    assert_eq!(
        bench.ask(take_off.clone()),
        wrong_mode(FlightMode::Disarmed)
    );
    let mut bench = Bench::hovering();
    assert_eq!(bench.ask(take_off), wrong_mode(FlightMode::Hovering));
}

#[test]
fn a_take_off_to_no_sensible_height_is_refused() {
    for height_m in [f64::NAN, f64::INFINITY, -1.0, 0.39, 15.1] {
        let mut bench = Bench::new();
        bench.ask(Intent::Arm).unwrap();
        let answer = bench.ask(Intent::TakeOff { height_m });
        assert!(matches!(answer, Err(Refusal::OutOfLimits { .. })));
        assert_eq!(bench.modes.mode(), FlightMode::Armed);
    }
}

#[test]
fn waypoints_out_of_reach_are_refused() {
    for waypoint in [
        Vector3::new(46.0, 0.0, 1.0),
        Vector3::new(0.0, -46.0, 1.0),
        Vector3::new(0.0, 0.0, 0.1),
        Vector3::new(0.0, 0.0, 16.0),
        Vector3::new(f64::NAN, 0.0, 1.0),
    ] {
        let mut bench = Bench::hovering();
        let intent = Intent::Fly {
            waypoints_world: vec![Vector3::new(0.0, 0.0, 1.0), waypoint],
        };
        assert!(matches!(
            bench.ask(intent),
            Err(Refusal::OutOfLimits { .. })
        ));
        assert_eq!(bench.modes.mode(), FlightMode::Hovering);
    }
}

#[test]
fn no_waypoints_make_no_trajectory() {
    let intent = Intent::Fly {
        waypoints_world: Vec::new(),
    };
    assert_eq!(Bench::hovering().ask(intent), Err(Refusal::NoTrajectory));
}

#[test]
fn flying_begins_from_hovering_only() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask(fly()), wrong_mode(FlightMode::Disarmed));
    bench.ask(Intent::Arm).unwrap();
    assert_eq!(bench.ask(fly()), wrong_mode(FlightMode::Armed));
    bench.ask(Intent::TakeOff { height_m: 1.0 }).unwrap();
    assert_eq!(bench.ask(fly()), wrong_mode(FlightMode::TakingOff));
    assert_eq!(Bench::landing().ask(fly()), wrong_mode(FlightMode::Landing));
}

#[test]
fn motors_are_not_disarmed_in_the_air() {
    assert_eq!(
        Bench::hovering().ask(Intent::Disarm),
        wrong_mode(FlightMode::Hovering)
    );
    assert_eq!(
        Bench::landing().ask(Intent::Disarm),
        wrong_mode(FlightMode::Landing)
    );
}

#[test]
fn landing_and_holding_make_no_sense_on_the_ground() {
    for intent in [Intent::Land, Intent::Hold] {
        let mut bench = Bench::new();
        assert_eq!(bench.ask(intent.clone()), wrong_mode(FlightMode::Disarmed));
        bench.ask(Intent::Arm).unwrap();
        assert_eq!(bench.ask(intent), wrong_mode(FlightMode::Armed));
    }
}

#[test]
fn a_landing_is_broken_off_only_high_above_the_ground() {
    let mut bench = Bench::landing();
    bench.rise_to(0.2);
    assert!(matches!(
        bench.ask(Intent::Hold),
        Err(Refusal::OutOfLimits { .. })
    ));
    bench.rise_to(1.0);
    assert_eq!(bench.ask(Intent::Hold), Ok(()));
    assert_eq!(bench.modes.mode(), FlightMode::Hovering);
}

#[test]
fn kill_is_obeyed_in_every_mode() {
    let mut armed = Bench::new();
    armed.ask(Intent::Arm).unwrap();
    for mut bench in [Bench::new(), armed, Bench::hovering(), Bench::landing()] {
        bench.guard = Fallback::Descend;
        assert_eq!(bench.ask(Intent::Kill), Ok(()));
        assert_eq!(bench.run(10.0), FlightMode::Killed);
    }
}

#[test]
fn a_killed_vehicle_is_disarmed_only_when_it_lies_still() {
    let mut bench = Bench::hovering();
    bench.ask(Intent::Kill).unwrap();
    bench.state.acceleration_world.z = -GRAVITY_M_S2;
    bench.run(2.0);
    assert_eq!(bench.ask(Intent::Disarm), wrong_mode(FlightMode::Killed));
    bench.stand();
    bench.run(0.9);
    assert_eq!(bench.ask(Intent::Disarm), wrong_mode(FlightMode::Killed));
    bench.run(0.2);
    assert_eq!(bench.ask(Intent::Arm), wrong_mode(FlightMode::Killed));
    assert_eq!(bench.ask(Intent::Disarm), Ok(()));
}

#[test]
fn while_the_guard_acts_only_safer_requests_pass() {
    let mut bench = Bench::hovering();
    bench.guard = Fallback::Hold;
    assert_eq!(bench.ask(fly()), Err(Refusal::GuardActive));
    assert_eq!(bench.ask(Intent::Hold), Ok(()));
    bench.guard = Fallback::Land;
    bench.step();
    assert_eq!(bench.ask(Intent::Hold), Err(Refusal::GuardActive));
    assert_eq!(bench.ask(Intent::Land), Ok(()));
    let mut bench = Bench::new();
    bench.guard = Fallback::Land;
    assert_eq!(bench.ask(Intent::Arm), Err(Refusal::GuardActive));
}

#[test]
fn the_guard_turns_flying_into_hovering_landing_or_killed() {
    for (guard, mode) in [
        (Fallback::Hold, FlightMode::Hovering),
        (Fallback::Land, FlightMode::Landing),
        (Fallback::Descend, FlightMode::Landing),
        (Fallback::Cut, FlightMode::Killed),
    ] {
        let mut bench = Bench::hovering();
        bench.ask(fly()).unwrap();
        bench.trajectory = Progress::Running;
        bench.guard = guard;
        assert_eq!(bench.step(), mode);
    }
}

#[test]
fn a_hold_close_to_the_ground_in_the_take_off_lands() {
    let mut bench = Bench::new();
    bench.ask(Intent::Arm).unwrap();
    bench.ask(Intent::TakeOff { height_m: 1.5 }).unwrap();
    bench.rise_to(0.2);
    bench.guard = Fallback::Hold;
    assert_eq!(bench.step(), FlightMode::Landing);
}

#[test]
fn armed_motors_do_not_wait_for_ever() {
    let mut bench = Bench::new();
    bench.ask(Intent::Arm).unwrap();
    assert_eq!(bench.run(14.9), FlightMode::Armed);
    assert_eq!(bench.run(0.2), FlightMode::Disarmed);
}

#[test]
fn a_take_off_that_does_not_arrive_becomes_a_landing() {
    let mut bench = Bench::new();
    bench.ask(Intent::Arm).unwrap();
    bench.ask(Intent::TakeOff { height_m: 1.5 }).unwrap();
    assert_eq!(bench.run(29.9), FlightMode::TakingOff);
    assert_eq!(bench.run(0.2), FlightMode::Landing);
}

#[test]
fn the_take_off_ends_near_its_height_and_at_rest() {
    let mut bench = Bench::new();
    bench.ask(Intent::Arm).unwrap();
    bench.ask(Intent::TakeOff { height_m: 1.5 }).unwrap();
    bench.rise_to(1.3);
    assert_eq!(bench.step(), FlightMode::TakingOff);
    bench.rise_to(1.4);
    bench.state.velocity_world.z = 0.5;
    assert_eq!(bench.step(), FlightMode::TakingOff);
    bench.state.velocity_world.z = 0.1;
    assert_eq!(bench.step(), FlightMode::Hovering);
}

#[test]
fn touchdown_is_seen_within_half_a_second_when_the_range_agrees() {
    let mut bench = Bench::landing();
    bench.stand();
    let seconds = bench.seconds_until(FlightMode::Disarmed, 5.0).unwrap();
    // The dwell of 0.4 s and the low-pass of 0.1 s, which passes 0.2 of 0.7 early.
    assert!(seconds > 0.4 && seconds < 0.5, "{seconds}");
}

#[test]
fn touchdown_is_seen_without_a_range() {
    let mut bench = Bench::landing();
    bench.stand();
    bench.range_m = None;
    let seconds = bench.seconds_until(FlightMode::Disarmed, 5.0).unwrap();
    assert!(seconds > 1.0 && seconds < 1.2, "{seconds}");
}

#[test]
fn touchdown_is_seen_with_a_range_stuck_high() {
    let mut bench = Bench::landing();
    bench.stand();
    bench.range_m = Some(1.4);
    let seconds = bench.seconds_until(FlightMode::Disarmed, 5.0).unwrap();
    assert!(seconds > 2.0 && seconds < 2.3, "{seconds}");
}

#[test]
fn touchdown_is_seen_while_the_estimate_is_dead_reckoning_and_drifts() {
    let mut bench = Bench::landing();
    bench.stand();
    bench.range_m = None;
    bench.state.velocity_world = Vector3::new(1.0, 0.0, -0.8);
    bench.state.health = EstimateHealth::Degraded {
        since_velocity_s: 5.0,
        since_height_s: 5.0,
    };
    assert!(bench.seconds_until(FlightMode::Disarmed, 1.2).is_some());
}

#[test]
fn a_landing_before_lift_off_ends_at_once() {
    let mut bench = Bench::new();
    bench.ask(Intent::Arm).unwrap();
    bench.ask(Intent::TakeOff { height_m: 1.5 }).unwrap();
    bench.thrust = 0.5 * HOVER;
    bench.run(0.5);
    bench.ask(Intent::Land).unwrap();
    bench.thrust = 0.1 * HOVER;
    assert!(bench.seconds_until(FlightMode::Disarmed, 0.8).is_some());
}

/// Flies a landing in gusts: whatever force acts, acceleration and thrust obey Newton.
fn land_in_gusts(gust_weights: f64, range_m: Option<f64>) -> FlightMode {
    let mut bench = Bench::landing();
    let mut velocity_m_s: f64 = 0.0;
    for k in 0..2000 {
        let time_s = k as f64 * STEP_S;
        // A gust of a second each way, and a controller that pushes against the speed.
        let gust = gust_weights * (std::f64::consts::PI * time_s).sin();
        let thrust_weights = (1.0 - 0.3 * (velocity_m_s + 0.2)).clamp(0.1, 2.0);
        let acceleration = GRAVITY_M_S2 * (thrust_weights - 1.0 + gust);
        velocity_m_s += acceleration * STEP_S;
        bench.state.acceleration_world.z = acceleration;
        bench.state.velocity_world.z = velocity_m_s;
        bench.thrust = HOVER * thrust_weights;
        bench.range_m = range_m;
        if bench.step() != FlightMode::Landing {
            break;
        }
    }
    bench.modes.mode()
}

#[test]
fn gusts_of_a_quarter_of_the_weight_are_no_touchdown() {
    assert_eq!(land_in_gusts(0.25, Some(1.5)), FlightMode::Landing);
    assert_eq!(land_in_gusts(0.25, None), FlightMode::Landing);
}

#[test]
fn a_slow_descent_near_the_ground_is_no_touchdown() {
    assert_eq!(land_in_gusts(0.0, Some(0.1)), FlightMode::Landing);
}

#[test]
fn a_range_stuck_low_in_the_take_off_does_not_end_the_landing_in_the_air() {
    let mut bench = Bench::new();
    bench.ask(Intent::Arm).unwrap();
    bench.ask(Intent::TakeOff { height_m: 1.5 }).unwrap();
    bench.thrust = HOVER;
    bench.run(2.0);
    bench.ask(Intent::Land).unwrap();
    bench.thrust = 0.95 * HOVER;
    bench.state.acceleration_world.z = -0.05 * GRAVITY_M_S2;
    assert_eq!(bench.run(10.0), FlightMode::Landing);
}

#[test]
fn numbers_that_are_not_finite_neither_end_the_landing_nor_panic() {
    let mut bench = Bench::landing();
    bench.state.acceleration_world.z = f64::NAN;
    bench.thrust = f64::NAN;
    bench.range_m = Some(f64::NAN);
    assert_eq!(bench.run(5.0), FlightMode::Landing);
}
