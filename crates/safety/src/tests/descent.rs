//! The descent that the guard flies itself, with a vehicle that obeys Newton.

use alula_geometry::GRAVITY_M_S2;
use alula_messages::{Command, Fallback};

use super::bench::{Bench, HOVER_N, MASS_KG, Range, STEP_S, thrust};

/// Time constant of the rotors, s.
const ROTOR_S: f64 = 0.05;

struct Fall {
    bench: Bench,
    thrust_n: f64,
    /// True thrust over commanded thrust.
    gain: f64,
    greatest_descent_m_s: f64,
    greatest_tilt_rad: f64,
}

impl Fall {
    /// Hovers until the guard has learnt what that takes.
    fn from_hover(gain: f64) -> Self {
        let mut bench = Bench::flying();
        bench.requested = thrust(HOVER_N / gain);
        bench.run(8.0);
        Self {
            bench,
            thrust_n: HOVER_N,
            gain,
            greatest_descent_m_s: 0.0,
            greatest_tilt_rad: 0.0,
        }
    }

    /// One step of the vertical motion.
    fn step(&mut self) {
        let command_n = match self.bench.guard.command() {
            Command::AttitudeThrust {
                thrust_n,
                roll_rad,
                pitch_rad,
                ..
            } => {
                if self.bench.guard.report().fallback == Fallback::Descend {
                    let tilt_rad = roll_rad.abs().max(pitch_rad.abs());
                    self.greatest_tilt_rad = self.greatest_tilt_rad.max(tilt_rad);
                }
                thrust_n
            }
            _ => 0.0,
        };
        self.thrust_n += (self.gain * command_n - self.thrust_n) * STEP_S / ROTOR_S;
        let bench = &mut self.bench;
        let force_n = self.thrust_n + ground_n(bench.position.z, bench.velocity.z);
        bench.acceleration.z = force_n / MASS_KG - GRAVITY_M_S2;
        bench.velocity.z += bench.acceleration.z * STEP_S;
        self.greatest_descent_m_s = self.greatest_descent_m_s.max(-bench.velocity.z);
        bench.step();
    }

    /// Descends until the motors are cut; the height where, and the seconds on the ground.
    fn until_cut(&mut self, limit_s: f64) -> (f64, f64) {
        let mut on_ground_s = 0.0;
        for _ in 0..(limit_s / STEP_S) as i64 {
            self.step();
            if self.bench.position.z <= 0.0 {
                on_ground_s += STEP_S;
            }
            if self.bench.guard.report().fallback == Fallback::Cut {
                assert_eq!(self.bench.guard.command(), Command::Disarm);
                return (self.bench.position.z, on_ground_s);
            }
        }
        panic!("not cut; height {}", self.bench.position.z);
    }
}

/// Force of a ground at height zero that gives way like a landing gear, N.
fn ground_n(height_m: f64, climb_m_s: f64) -> f64 {
    const STIFFNESS_N_M: f64 = 2000.0;
    const DAMPING_N_S_M: f64 = 80.0;
    if height_m >= 0.0 {
        return 0.0;
    }
    (-STIFFNESS_N_M * height_m - DAMPING_N_S_M * climb_m_s).max(0.0)
}

fn descend(gain: f64, spoil: impl Fn(&mut Bench)) -> Fall {
    let mut fall = Fall::from_hover(gain);
    fall.bench.spoil = Box::new(|state| state.velocity_world.x = f64::NAN);
    spoil(&mut fall.bench);
    let (height_m, on_ground_s) = fall.until_cut(60.0);
    assert!(height_m <= 0.05, "cut at {height_m} m");
    assert!(on_ground_s < 5.0, "cut after {on_ground_s} s on the ground");
    assert_eq!(fall.greatest_tilt_rad, 0.0);
    fall
}

#[test]
fn the_descent_with_all_sensors_is_gentle() {
    let fall = descend(1.0, |_| {});
    // 0.5 m/s is asked for; the rotors' lag and the observer overshoot by a third.
    assert!(
        fall.greatest_descent_m_s < 0.7,
        "{}",
        fall.greatest_descent_m_s
    );
}

#[test]
fn the_descent_without_range_ends_on_the_ground_too() {
    let fall = descend(1.0, |bench| bench.range = Range::Silent);
    // Forgetting the vertical speed lets it grow by a tenth of a m/s^2.
    assert!(
        fall.greatest_descent_m_s < 1.3,
        "{}",
        fall.greatest_descent_m_s
    );
}

#[test]
fn a_wrong_thrust_table_is_learnt_before_it_is_needed() {
    for gain in [0.8, 1.25] {
        let fall = descend(gain, |bench| bench.range = Range::Silent);
        assert!(
            fall.greatest_descent_m_s < 1.5,
            "{}",
            fall.greatest_descent_m_s
        );
    }
}

#[test]
fn without_inertial_data_the_range_ends_the_descent() {
    let mut fall = Fall::from_hover(1.0);
    fall.bench.imu_works = false;
    let (height_m, _) = fall.until_cut(30.0);
    assert!(height_m <= 0.05);
    // Free of drag, 3 % less than hovering over 1.5 m: sqrt(2 * 0.29 * 1.5) = 0.94 m/s.
    assert!(
        fall.greatest_descent_m_s < 1.1,
        "{}",
        fall.greatest_descent_m_s
    );
}

#[test]
fn a_blind_descent_ends_after_its_time() {
    let mut bench = Bench::flying();
    bench.imu_works = false;
    bench.range = Range::Silent;
    bench.run(60.0);
    assert_eq!(bench.guard.report().fallback, Fallback::Descend);
    bench.run(0.2);
    assert_eq!(bench.guard.report().fallback, Fallback::Cut);
}

#[test]
fn a_vehicle_that_takes_climb_rates_gets_one() {
    let mut bench = Bench::flying();
    bench.requested = Command::TiltClimb {
        roll_rad: 0.3,
        pitch_rad: 0.2,
        yaw_rate_rad_s: 0.0,
        climb_rate_m_s: 1.0,
    };
    bench.imu_works = false;
    bench.run(0.2);
    let expected = Command::TiltClimb {
        roll_rad: 0.0,
        pitch_rad: 0.0,
        yaw_rate_rad_s: 0.0,
        climb_rate_m_s: -0.5,
    };
    assert_eq!(bench.guard.command(), expected);
}
