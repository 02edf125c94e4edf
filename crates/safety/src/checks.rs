//! What is checked in flight, and what follows.

use alula_geometry::{Timestamp, so3};
use alula_messages::{
    Command, EstimateHealth, Fallback, Finding, FlightMode, NavState, Violation, error_index,
};
use nalgebra::Vector3;

use crate::config::{CommandLimits, GuardConfig, GuardVehicle};
use crate::raw::{Ranger, RawMotion};
use crate::rules::{Stages, stages};

/// Height from which on a range is expected in the take-off, m.
const RANGE_EXPECTED_M: f64 = 0.6;
/// A valid range counts as present for this long, s; a longer silence is another finding.
const PRESENT_S: f64 = 0.3;
/// From this share of the weight on the ground on, a landing is about to end: twice the drag of
/// the descent, and what the flight modes ask for near the ground.
const STANDING_SUPPORT: f64 = 0.2;
/// The flight modes end such a landing within this time, or do not know the ground, s.
const STANDING_S: f64 = 1.5;
/// Rounding that a thrust at its limit may have.
const THRUST_ROUNDING: f64 = 1e-6;

/// One rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Check {
    Tumbling,
    ImuLost,
    EstimateStale,
    EstimateUnusable,
    EstimateNotFinite,
    VerticalGap,
    Command,
    AttitudeSigma,
    Sigma,
    HeightGap,
    ClimbGap,
    FlowGap,
    BlindLanding,
    RangeLost,
    RangeStuck,
    HeightDegraded,
    FlowLost,
    VelocityDegraded,
    DepthLost,
    RawTilt,
    Tilt,
    Outside,
    RangeLow,
    Speed,
    FenceAhead,
}

/// All rules; among equally grave ones the earlier names the cause.
pub(crate) const ALL: [Check; 25] = [
    Check::Tumbling,
    Check::ImuLost,
    Check::EstimateStale,
    Check::EstimateUnusable,
    Check::EstimateNotFinite,
    Check::VerticalGap,
    Check::Command,
    Check::AttitudeSigma,
    Check::Sigma,
    Check::HeightGap,
    Check::ClimbGap,
    Check::FlowGap,
    Check::BlindLanding,
    Check::RangeLost,
    Check::RangeStuck,
    Check::HeightDegraded,
    Check::FlowLost,
    Check::VelocityDegraded,
    Check::DepthLost,
    Check::RawTilt,
    Check::Tilt,
    Check::Outside,
    Check::RangeLow,
    Check::Speed,
    Check::FenceAhead,
];

/// The stages of every rule, in the order of [`ALL`].
pub(crate) fn all_stages(config: &GuardConfig) -> [Stages; ALL.len()] {
    ALL.map(|check| check.stages(config))
}

/// What the rules look at in one step.
pub(crate) struct View<'a> {
    pub(crate) config: &'a GuardConfig,
    pub(crate) vehicle: &'a GuardVehicle,
    pub(crate) now: Timestamp,
    pub(crate) mode: FlightMode,
    pub(crate) state: &'a NavState,
    /// Whether every number of the state and its covariance is finite; 225 of them are looked at
    /// once in a step.
    pub(crate) state_is_finite: bool,
    pub(crate) requested: &'a Command,
    pub(crate) raw: &'a RawMotion,
    /// World height of the place of take-off, m.
    pub(crate) ground_z_m: f64,
    /// For how long flow and range have been expected, s; zero when they are not.
    pub(crate) flow_expected_s: f64,
    pub(crate) range_expected_s: f64,
    /// Whether the vehicle avoids what it sees.
    pub(crate) needs_depth: bool,
    /// Share of the weight that the ground carries; zero when it cannot be known.
    pub(crate) support: f64,
}

impl Check {
    fn violation(self) -> Violation {
        match self {
            Self::Tumbling | Self::RawTilt | Self::Tilt => Violation::Tilt,
            Self::ImuLost => Violation::ImuLost,
            Self::EstimateStale | Self::EstimateUnusable => Violation::EstimateStale,
            Self::EstimateNotFinite
            | Self::VerticalGap
            | Self::AttitudeSigma
            | Self::Sigma
            | Self::HeightGap
            | Self::ClimbGap
            | Self::FlowGap => Violation::EstimateInconsistent,
            Self::Command => Violation::CommandInvalid,
            Self::BlindLanding | Self::RangeLost | Self::RangeStuck | Self::HeightDegraded => {
                Violation::RangeLost
            }
            Self::FlowLost | Self::VelocityDegraded => Violation::FlowLost,
            Self::DepthLost => Violation::DepthLost,
            Self::Outside | Self::FenceAhead => Violation::Geofence,
            Self::RangeLow => Violation::RangeLow,
            Self::Speed => Violation::Speed,
        }
    }

    /// Whether a finding puts the estimated motion into question, however short it is.
    pub(crate) fn doubts_the_estimate(self) -> bool {
        match self {
            Self::Tumbling
            | Self::ImuLost
            | Self::EstimateStale
            | Self::EstimateUnusable
            | Self::EstimateNotFinite
            | Self::VerticalGap
            | Self::AttitudeSigma
            | Self::Sigma
            | Self::ClimbGap
            | Self::FlowGap
            | Self::BlindLanding
            | Self::VelocityDegraded
            | Self::RawTilt
            | Self::Tilt => true,
            Self::Command
            | Self::HeightGap
            | Self::RangeLost
            | Self::RangeStuck
            | Self::HeightDegraded
            | Self::FlowLost
            | Self::DepthLost
            | Self::Outside
            | Self::RangeLow
            | Self::Speed
            | Self::FenceAhead => false,
        }
    }

    fn stages(self, config: &GuardConfig) -> Stages {
        use Fallback::{Cut, Descend, Hold, Land};
        let (motion, estimate, sensors) = (&config.motion, &config.estimate, &config.sensors);
        let distrust = |land_s: f64| [(land_s, Land), (land_s + estimate.distrust_s, Descend)];
        let flow_after = |s: f64| s - sensors.flow_hold_s;
        match self {
            Self::Tumbling => stages(&[(motion.tumble_s, Cut)]),
            Self::ImuLost
            | Self::EstimateStale
            | Self::EstimateUnusable
            | Self::EstimateNotFinite => stages(&[(0.0, Descend)]),
            Self::VerticalGap => stages(&[(estimate.vertical_gap_s, Descend)]),
            Self::Command => stages(&[(0.0, Hold), (config.command.invalid_descend_s, Descend)]),
            Self::AttitudeSigma => stages(&[(estimate.sigma_s, Descend)]),
            Self::Sigma => stages(&distrust(estimate.sigma_s)),
            Self::HeightGap => stages(&distrust(estimate.height_gap_s)),
            Self::ClimbGap | Self::FlowGap => stages(&distrust(estimate.velocity_gap_s)),
            Self::BlindLanding => stages(&[(estimate.blind_landing_s, Descend)]),
            Self::RangeLost | Self::RangeStuck | Self::HeightDegraded => stages(&[(0.0, Land)]),
            Self::FlowLost | Self::VelocityDegraded => stages(&[
                (0.0, Hold),
                (flow_after(sensors.flow_land_s), Land),
                (flow_after(sensors.flow_descend_s), Descend),
            ]),
            Self::DepthLost => stages(&[
                (0.0, Hold),
                (sensors.depth_land_s - sensors.depth_hold_s, Land),
            ]),
            Self::RawTilt | Self::Tilt => {
                stages(&[(motion.tilt_hold_s, Hold), (motion.tilt_descend_s, Descend)])
            }
            Self::Outside => stages(&[(0.0, Hold), (config.fence.outside_s, Land)]),
            Self::RangeLow => stages(&[
                (sensors.range_low_hold_s, Hold),
                (sensors.range_low_land_s, Land),
            ]),
            Self::Speed => stages(&[(motion.speed_hold_s, Hold), (motion.speed_land_s, Land)]),
            Self::FenceAhead => stages(&[(0.0, Hold)]),
        }
    }

    /// What the rule finds in this step.
    pub(crate) fn find(self, view: &View) -> Option<Finding> {
        let (found, limit) = self.excess(view)?;
        Some(Finding {
            violation: self.violation(),
            found,
            limit,
        })
    }

    fn excess(self, view: &View) -> Option<(f64, f64)> {
        match self {
            Self::Tumbling => view.tumbling(),
            Self::ImuLost => over(
                view.raw.seconds_since(view.raw.imu),
                view.config.sensors.imu_lost_s,
            ),
            Self::EstimateStale => view.stale(),
            Self::EstimateUnusable => (!view.health_is_usable()).then_some((1.0, 0.0)),
            Self::EstimateNotFinite => (!view.state_is_finite).then_some((1.0, 0.0)),
            Self::Command => command_excess(view.requested, &view.config.command, view.vehicle),
            Self::RangeLost => view.range_lost(),
            Self::RangeStuck => view.range_stuck(),
            Self::FlowLost => view.flow_lost(),
            Self::DepthLost => view.depth_lost(),
            Self::RawTilt => over(
                view.raw.tilt_rad().to_degrees(),
                view.config.motion.raw_tilt_deg,
            ),
            Self::RangeLow => view.range_low(),
            // The others judge the estimate, which must be one.
            _ if !view.estimate_is_usable() => None,
            Self::VerticalGap => view.vertical_gap(),
            Self::AttitudeSigma => view.attitude_sigma(),
            Self::Sigma => view.sigma(),
            Self::HeightGap => view.height_gap(),
            Self::ClimbGap => view.climb_gap(),
            Self::FlowGap => view.flow_gap(),
            Self::BlindLanding => view.blind_landing(),
            Self::HeightDegraded => view.height_degraded(),
            Self::VelocityDegraded => view.velocity_degraded(),
            Self::Tilt => over(view.tilt_deg(), view.config.motion.tilt_deg),
            Self::Outside => view.fence(&view.state.position_world()),
            Self::Speed => over(
                view.state.velocity_world.norm(),
                view.config.motion.speed_m_s,
            ),
            Self::FenceAhead => view.fence(&view.stopping_point()),
        }
    }
}

/// A number beyond its limit, or not a number.
fn over(found: f64, limit: f64) -> Option<(f64, f64)> {
    let within = found <= limit;
    (!within).then_some((found, limit))
}

/// Whether every number of the state and its covariance is finite.
pub(crate) fn is_finite(state: &NavState) -> bool {
    state.is_finite() && state.covariance.iter().all(|x| x.is_finite())
}

impl View<'_> {
    fn health_is_usable(&self) -> bool {
        matches!(
            self.state.health,
            EstimateHealth::Good | EstimateHealth::Degraded { .. }
        )
    }

    fn estimate_is_usable(&self) -> bool {
        self.health_is_usable() && self.state_is_finite
    }

    fn tilt_deg(&self) -> f64 {
        so3::tilt_rad(&self.state.world_from_body.rotation).to_degrees()
    }

    fn height_m(&self) -> f64 {
        self.state.position_world().z - self.ground_z_m
    }

    fn depth_lost(&self) -> Option<(f64, f64)> {
        let flies = matches!(self.mode, FlightMode::Hovering | FlightMode::Flying);
        if !(self.needs_depth && flies) {
            return None;
        }
        over(
            self.raw.seconds_since(self.raw.depth()),
            self.config.sensors.depth_hold_s,
        )
    }

    /// Both attitudes must agree on it, unless there is only the guard's own.
    fn tumbling(&self) -> Option<(f64, f64)> {
        let limit = self.config.motion.tumble_deg;
        let raw_deg = self.raw.tilt_rad().to_degrees();
        let agreed = !self.estimate_is_usable() || self.tilt_deg() > limit;
        over(raw_deg, limit).filter(|_| agreed)
    }

    /// An estimate from the future is as bad as an old one.
    fn stale(&self) -> Option<(f64, f64)> {
        let age_s = self.now.seconds_since(self.state.time);
        over(age_s.abs(), self.config.estimate.stale_s)
    }

    fn vertical_gap(&self) -> Option<(f64, f64)> {
        if !self.raw.imu_is_fresh() {
            return None;
        }
        let up_body = self.state.world_from_body.rotation.inverse() * Vector3::z();
        let gap_deg = up_body.angle(&self.raw.up_body).to_degrees();
        over(gap_deg, self.config.estimate.vertical_gap_deg)
    }

    fn attitude_sigma(&self) -> Option<(f64, f64)> {
        let sigma = self.state.sigma(error_index::ORIENTATION).xy().max();
        over(sigma.to_degrees(), self.config.estimate.attitude_sigma_deg)
    }

    fn sigma(&self) -> Option<(f64, f64)> {
        let limits = &self.config.estimate;
        let position = self.state.sigma(error_index::POSITION);
        let velocity = self.state.sigma(error_index::VELOCITY).max();
        over(velocity, limits.velocity_sigma_m_s)
            .or_else(|| over(position.z, limits.height_sigma_m))
            .or_else(|| over(position.xy().max(), limits.position_sigma_m))
    }

    fn height_gap(&self) -> Option<(f64, f64)> {
        let climbed_m = self.raw.range_height_m()? - self.raw.landed_height_m;
        let gap_m = (self.height_m() - climbed_m).abs();
        over(gap_m, self.config.estimate.height_gap_m)
    }

    fn climb_gap(&self) -> Option<(f64, f64)> {
        // Without a range, or inertial data, the guard's own vertical speed means little.
        self.raw.range_height_m()?;
        let gap_m_s = (self.state.velocity_world.z - self.raw.climb_m_s).abs();
        over(gap_m_s, self.config.estimate.climb_gap_m_s).filter(|_| self.raw.imu_is_fresh())
    }

    fn flow_gap(&self) -> Option<(f64, f64)> {
        over(self.flow_gap_m_s()?, self.config.estimate.flow_gap_m_s)
    }

    /// How far the estimated velocity is from that by flow, m/s, where the two can be compared.
    pub(crate) fn flow_gap_m_s(&self) -> Option<f64> {
        let present = self.raw.seconds_since(self.raw.flow) <= PRESENT_S;
        let comparable = present && self.flow_expected_s > 0.0 && self.raw.imu_is_fresh();
        comparable.then(|| self.raw.flow_gap_m_s.norm())
    }

    fn range_lost(&self) -> Option<(f64, f64)> {
        let age_s = self.rangers().map(|r| self.raw.seconds_since(r.valid));
        self.over_range(smallest(age_s), self.config.sensors.range_lost_s)
    }

    fn range_stuck(&self) -> Option<(f64, f64)> {
        let present = |r: &&Ranger| self.raw.seconds_since(r.valid) <= PRESENT_S;
        let same_s = self.rangers().filter(present).map(Ranger::same_s);
        self.over_range(smallest(same_s), self.config.sensors.range_stuck_s)
    }

    fn over_range(&self, seconds: Option<f64>, limit: f64) -> Option<(f64, f64)> {
        over(seconds?.min(self.range_expected_s), limit)
    }

    /// The rangers that the vehicle has.
    fn rangers(&self) -> impl Iterator<Item = &Ranger> {
        [&self.raw.sonar, &self.raw.infrared]
            .into_iter()
            .filter(|ranger| ranger.arrived.is_some())
    }

    fn height_degraded(&self) -> Option<(f64, f64)> {
        let EstimateHealth::Degraded { since_height_s, .. } = self.state.health else {
            return None;
        };
        self.over_range(Some(since_height_s), self.config.estimate.degraded_s)
    }

    /// A landing by an estimate that nothing corrects: neither velocity nor height, and no range.
    /// One that the ground carries is left to the flight modes for a while.
    fn blind_landing(&self) -> Option<(f64, f64)> {
        let EstimateHealth::Degraded {
            since_velocity_s,
            since_height_s,
        } = self.state.health
        else {
            return None;
        };
        let blind = self.mode == FlightMode::Landing && self.raw.range_height_m().is_none();
        let patience_s = if self.support < STANDING_SUPPORT {
            PRESENT_S
        } else {
            STANDING_S
        };
        over(since_velocity_s.min(since_height_s), patience_s).filter(|_| blind)
    }

    fn flow_lost(&self) -> Option<(f64, f64)> {
        // A vehicle that never had a flow camera has another source of velocity.
        self.raw.flow_arrived?;
        let age_s = self.raw.seconds_since(self.raw.flow);
        over(
            age_s.min(self.flow_expected_s),
            self.config.sensors.flow_hold_s,
        )
    }

    fn velocity_degraded(&self) -> Option<(f64, f64)> {
        let EstimateHealth::Degraded {
            since_velocity_s, ..
        } = self.state.health
        else {
            return None;
        };
        over(
            since_velocity_s.min(self.flow_expected_s),
            self.config.estimate.degraded_s,
        )
    }

    fn range_low(&self) -> Option<(f64, f64)> {
        if !matches!(self.mode, FlightMode::Hovering | FlightMode::Flying) {
            return None;
        }
        let height_m = self.raw.range_height_m()?;
        let limit_m = self.config.sensors.range_low_m;
        (height_m < limit_m).then_some((height_m, limit_m))
    }

    /// Where the vehicle stops when it brakes now: p + v |v| / (2 a) along each axis.
    fn stopping_point(&self) -> Vector3<f64> {
        let braking = self.config.fence.braking_m_s2;
        let way = self
            .state
            .velocity_world
            .map(|v| v * v.abs() / (2.0 * braking));
        self.state.position_world() + way
    }

    fn fence(&self, point_world: &Vector3<f64>) -> Option<(f64, f64)> {
        let fence = &self.config.fence;
        for axis in 0..3 {
            let coordinate = point_world[axis];
            if coordinate < fence.min_m[axis] {
                return Some((coordinate, fence.min_m[axis]));
            }
            if coordinate > fence.max_m[axis] {
                return Some((coordinate, fence.max_m[axis]));
            }
        }
        let by_range_m = self.raw.range_height_m().unwrap_or(f64::NEG_INFINITY);
        let height_m = (point_world.z - self.ground_z_m).max(by_range_m);
        over(height_m, fence.ceiling_m)
    }
}

fn smallest(values: impl Iterator<Item = f64>) -> Option<f64> {
    values.reduce(f64::min)
}

/// Whether flow is expected: a camera close to the ground sees nothing.
pub(crate) fn flow_is_expected(mode: FlightMode, raw: &RawMotion, min_height_m: f64) -> bool {
    let in_the_air = matches!(mode, FlightMode::Hovering | FlightMode::Flying);
    match raw.range_height_m() {
        Some(height_m) => height_m >= min_height_m,
        None => in_the_air || raw.height_m >= min_height_m,
    }
}

/// Whether a range is expected: on the ground and in the landing it may be too near.
pub(crate) fn range_is_expected(mode: FlightMode, raw: &RawMotion) -> bool {
    match mode {
        FlightMode::Hovering | FlightMode::Flying => true,
        FlightMode::TakingOff => raw.height_m >= RANGE_EXPECTED_M,
        _ => false,
    }
}

/// The first number of a command beyond what may be commanded, with its limit.
pub(crate) fn command_excess(
    command: &Command,
    limits: &CommandLimits,
    vehicle: &GuardVehicle,
) -> Option<(f64, f64)> {
    let tilt_rad = limits.tilt_deg.to_radians();
    let attitude = |roll: f64, pitch: f64, yaw_rate: f64| {
        over(roll.abs(), tilt_rad)
            .or_else(|| over(pitch.abs(), tilt_rad))
            .or_else(|| over(yaw_rate.abs(), limits.yaw_rate_rad_s))
    };
    let thrust = |thrust_n: f64| {
        if thrust_n < 0.0 {
            return Some((thrust_n, 0.0));
        }
        over(thrust_n, vehicle.max_thrust_n * (1.0 + THRUST_ROUNDING))
    };
    match *command {
        Command::Disarm | Command::Idle => None,
        Command::AttitudeThrust {
            roll_rad,
            pitch_rad,
            yaw_rate_rad_s,
            thrust_n,
        } => attitude(roll_rad, pitch_rad, yaw_rate_rad_s).or_else(|| thrust(thrust_n)),
        Command::TiltClimb {
            roll_rad,
            pitch_rad,
            yaw_rate_rad_s,
            climb_rate_m_s,
        } => attitude(roll_rad, pitch_rad, yaw_rate_rad_s)
            .or_else(|| over(climb_rate_m_s.abs(), limits.climb_rate_m_s)),
        Command::ThrustTorque {
            thrust_n,
            torque_body_nm,
        } => thrust(thrust_n).or_else(|| {
            let mut axes = torque_body_nm.iter();
            axes.find_map(|torque| over(torque.abs(), limits.torque_nm))
        }),
    }
}
