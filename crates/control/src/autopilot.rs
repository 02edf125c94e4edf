//! The attitude loop of an autopilot: PID on roll, pitch, yaw rate and climb rate, and mixing
//! (document O, section 1.2.3; document L, appendix A-4).
//!
//! Commands pass a reference model that gives the vehicle its response; feed-forward makes the
//! vehicle follow the model, and the PID laws remove what is left. See
//! `docs/derivations/attitude-loop.md`.

mod config;
mod response;

use alula_geometry::GRAVITY_M_S2;
use alula_messages::Command;
use alula_parameters::{ParameterError, Parameters};
use nalgebra::Vector3;

pub use crate::mixer::AirframeFacts;
use crate::mixer::{Mix, Mixer};
use crate::pid::{Pid, PidGains, PidInput};
pub use config::{AutopilotConfig, ClimbConfig, TiltConfig, YawRateConfig};
use response::Response;

/// Below this cosine of pitch, Euler rates are computed as if at it: they are singular at zero.
const LEAST_COSINE: f64 = 0.3;

/// What the autopilot senses of the vehicle's motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutopilotState {
    /// Roll, rad.
    pub roll_rad: f64,
    /// Pitch, rad.
    pub pitch_rad: f64,
    /// Angular rate, body frame, rad/s.
    pub angular_rate_body: Vector3<f64>,
    /// Climb rate, m/s, up.
    pub climb_rate_m_s: f64,
}

impl AutopilotState {
    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.roll_rad.is_finite()
            && self.pitch_rad.is_finite()
            && self.climb_rate_m_s.is_finite()
            && self.angular_rate_body.iter().all(|x| x.is_finite())
    }
}

/// Desired tilt and yaw rate within the limits.
struct Tilt {
    roll_rad: f64,
    pitch_rad: f64,
    yaw_rate_rad_s: f64,
}

/// Turns commands into rotor thrusts.
#[derive(Clone, Debug)]
pub struct Autopilot {
    config: AutopilotConfig,
    facts: AirframeFacts,
    mixer: Mixer,
    roll: Axis,
    pitch: Axis,
    yaw_rate: Axis,
    climb: Axis,
}

/// A reference model and the law that follows it; at rest until it is used.
#[derive(Clone, Debug)]
struct Axis {
    response: Response,
    pid: Pid,
    engaged: bool,
}

impl Axis {
    fn new(response: Response, gains: PidGains) -> Self {
        Self {
            response,
            pid: Pid::new(gains),
            engaged: false,
        }
    }

    fn release(&mut self) {
        self.engaged = false;
    }

    /// Acceleration of the quantity that takes it along the response to `command`. A law that was
    /// at rest starts from the measurement.
    fn update(&mut self, command: f64, measured: f64, measured_rate: f64, dt_s: f64) -> f64 {
        if !self.engaged {
            self.response.start(measured);
            self.pid.reset();
            self.engaged = true;
        }
        self.response.advance(command, dt_s);
        let input = PidInput {
            setpoint: self.response.value(),
            setpoint_rate: self.response.rate(),
            measurement: measured,
            measurement_rate: measured_rate,
        };
        self.pid.update(&input, dt_s)
    }
}

impl Autopilot {
    /// An autopilot at rest.
    ///
    /// # Errors
    /// When a parameter or a fact is out of its range.
    pub fn new(config: &AutopilotConfig, facts: &AirframeFacts) -> Result<Self, ParameterError> {
        config.validate()?;
        let mixer = Mixer::new(facts)?;
        Ok(Self {
            roll: Axis::new(config.roll.response(), config.roll.gains()),
            pitch: Axis::new(config.pitch.response(), config.pitch.gains()),
            yaw_rate: Axis::new(config.yaw_rate.response(), config.yaw_rate.gains()),
            climb: Axis::new(config.climb.response(), config.climb.gains()),
            config: config.clone(),
            facts: facts.clone(),
            mixer,
        })
    }

    /// Rotor thrusts (N, each from zero to the greatest possible) for a command, `dt_s` seconds
    /// after the last.
    ///
    /// A command with a number that is not finite becomes a level descent; a state that is not
    /// finite is taken as level and at rest, which leaves thrust without stabilisation. Neither
    /// should come so far: the guard acts first.
    pub fn update(&mut self, command: &Command, sensed: &AutopilotState, dt_s: f64) -> [f64; 4] {
        let sensed = if sensed.is_finite() {
            *sensed
        } else {
            AutopilotState::default()
        };
        let dt_s = if dt_s.is_finite() { dt_s.max(0.0) } else { 0.0 };
        match self.safe(command) {
            Command::Disarm => self.rest(0.0),
            Command::Idle => self.rest(self.config.idle_thrust_share),
            Command::AttitudeThrust {
                roll_rad,
                pitch_rad,
                yaw_rate_rad_s,
                thrust_n,
            } => {
                self.climb.release();
                let tilt = self.limited(roll_rad, pitch_rad, yaw_rate_rad_s);
                self.hold_tilt(&tilt, thrust_n, &sensed, dt_s)
            }
            Command::TiltClimb {
                roll_rad,
                pitch_rad,
                yaw_rate_rad_s,
                climb_rate_m_s,
            } => {
                let tilt = self.limited(roll_rad, pitch_rad, yaw_rate_rad_s);
                let thrust_n = self.climb_thrust(climb_rate_m_s, &sensed, dt_s);
                self.hold_tilt(&tilt, thrust_n, &sensed, dt_s)
            }
            Command::ThrustTorque {
                thrust_n,
                torque_body_nm,
            } => {
                self.release();
                self.mixer.mix(thrust_n, &torque_body_nm).rotor_thrusts_n
            }
        }
    }

    /// The command, or a level descent in its place when it is not finite.
    fn safe(&self, command: &Command) -> Command {
        if command.is_finite() {
            return *command;
        }
        Command::TiltClimb {
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rate_rad_s: 0.0,
            climb_rate_m_s: -self.config.last_resort_descent_m_s,
        }
    }

    /// All loops at rest and the same share of the greatest thrust on every rotor.
    fn rest(&mut self, share: f64) -> [f64; 4] {
        self.release();
        [share * self.facts.max_thrust_per_rotor_n; 4]
    }

    fn release(&mut self) {
        self.roll.release();
        self.pitch.release();
        self.yaw_rate.release();
        self.climb.release();
    }

    /// Tilt limited as a whole, so that its direction stays, and yaw rate.
    fn limited(&self, roll_rad: f64, pitch_rad: f64, yaw_rate_rad_s: f64) -> Tilt {
        let limit = self.config.max_tilt_deg.to_radians();
        let scale = (limit / roll_rad.hypot(pitch_rad).max(f64::MIN_POSITIVE)).min(1.0);
        let max_yaw_rate = self.config.max_yaw_rate_deg_s.to_radians();
        Tilt {
            roll_rad: roll_rad * scale,
            pitch_rad: pitch_rad * scale,
            yaw_rate_rad_s: yaw_rate_rad_s.clamp(-max_yaw_rate, max_yaw_rate),
        }
    }

    /// Collective thrust (N) that follows a climb rate: m (g + a) over the cosine of the tilt.
    fn climb_thrust(&mut self, climb_rate_m_s: f64, sensed: &AutopilotState, dt_s: f64) -> f64 {
        let limit = self.config.max_climb_rate_m_s;
        let command = climb_rate_m_s.clamp(-limit, limit);
        let feedback = self.climb.update(command, sensed.climb_rate_m_s, 0.0, dt_s);
        let acceleration = self.climb.response.rate() + feedback;
        let vertical_n = self.facts.mass_kg * (GRAVITY_M_S2 + acceleration);
        let cosine = sensed.roll_rad.cos() * sensed.pitch_rad.cos();
        if cosine <= 0.0 {
            return 0.0;
        }
        let greatest_n = self.mixer.max_collective_n();
        let thrust_n = vertical_n / cosine.max(LEAST_COSINE);
        if thrust_n < 0.0 || thrust_n > greatest_n {
            self.climb.pid.undo_integration();
        }
        thrust_n.clamp(0.0, greatest_n)
    }

    /// Rotor thrusts that follow a tilt and a yaw rate with a given collective thrust.
    fn hold_tilt(
        &mut self,
        tilt: &Tilt,
        thrust_n: f64,
        sensed: &AutopilotState,
        dt_s: f64,
    ) -> [f64; 4] {
        let (roll, pitch) = (sensed.roll_rad, sensed.pitch_rad);
        let rates = euler_rates(roll, pitch, &sensed.angular_rate_body);
        let acceleration = Vector3::new(
            self.roll.update(tilt.roll_rad, roll, rates.x, dt_s)
                + self.roll.response.acceleration(),
            self.pitch.update(tilt.pitch_rad, pitch, rates.y, dt_s)
                + self.pitch.response.acceleration(),
            self.yaw_rate
                .update(tilt.yaw_rate_rad_s, rates.z, 0.0, dt_s)
                + self.yaw_rate.response.rate(),
        );
        let torque = self.torque(&body_rates(roll, pitch, &acceleration), sensed);
        let mix = self.mixer.mix(thrust_n, &torque);
        self.unwind(&mix);
        mix.rotor_thrusts_n
    }

    /// Torque for an angular acceleration: tau = I alpha + omega x I omega
    /// (document S, equation 2.83d).
    fn torque(&self, acceleration_body: &Vector3<f64>, sensed: &AutopilotState) -> Vector3<f64> {
        let inertia = Vector3::from(self.facts.inertia_kg_m2);
        let rate = sensed.angular_rate_body;
        inertia.component_mul(acceleration_body) + rate.cross(&inertia.component_mul(&rate))
    }

    /// Keeps the integrals from growing on what the rotors could not give.
    fn unwind(&mut self, mix: &Mix) {
        if mix.roll_pitch_share < 1.0 {
            self.roll.pid.undo_integration();
            self.pitch.pid.undo_integration();
        }
        if mix.yaw_share < 1.0 {
            self.yaw_rate.pid.undo_integration();
        }
    }
}

/// Rates of roll, pitch and yaw (rad/s) for an angular rate in the body frame.
fn euler_rates(roll_rad: f64, pitch_rad: f64, rate_body: &Vector3<f64>) -> Vector3<f64> {
    let (sin_roll, cos_roll) = roll_rad.sin_cos();
    let (sin_pitch, cos_pitch) = pitch_rad.sin_cos();
    let cos_pitch = cos_pitch.max(LEAST_COSINE);
    let yaw_rate = (rate_body.y * sin_roll + rate_body.z * cos_roll) / cos_pitch;
    Vector3::new(
        rate_body.x + yaw_rate * sin_pitch,
        rate_body.y * cos_roll - rate_body.z * sin_roll,
        yaw_rate,
    )
}

/// Inverse of [`euler_rates`]: the angular rate in the body frame for rates of roll, pitch and yaw.
fn body_rates(roll_rad: f64, pitch_rad: f64, rates: &Vector3<f64>) -> Vector3<f64> {
    let (sin_roll, cos_roll) = roll_rad.sin_cos();
    let (sin_pitch, cos_pitch) = pitch_rad.sin_cos();
    Vector3::new(
        rates.x - rates.z * sin_pitch,
        rates.y * cos_roll + rates.z * sin_roll * cos_pitch,
        rates.z * cos_roll * cos_pitch - rates.y * sin_roll,
    )
}

#[cfg(test)]
mod tests;
