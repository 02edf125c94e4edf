//! From the mode of flight to the point where the vehicle should be now.

use alula_control::modes::Progress;
use alula_geometry::{Timestamp, so3};
use alula_messages::{FlightMode, NavState, Reference};
use alula_parameters::{ParameterError, Parameters, parameters};
use alula_planning::{
    MinimumSnap, MinimumSnapConfig, MotionLimits, PlanError, Trajectory, YawPolicy,
};
use nalgebra::Vector3;

parameters! {
    /// How the vehicle moves between the points it is sent to.
    pub struct GuideConfig {
        /// What a trajectory must keep; its acceleration is also that of braking on hold.
        pub limits: MotionLimits = MotionLimits::default(), nested();
        /// Speed of climbing at take-off.
        pub take_off_speed_m_s: f64 = 0.8, within(0.1, 3.0);
        /// Speed of descent before touch-down.
        pub landing_speed_m_s: f64 = 0.4, within(0.1, 1.5);
        /// Heading while flying through waypoints.
        pub yaw: YawPolicy = YawPolicy::Hold, any();
        /// Shape of the trajectories.
        pub minimum_snap: MinimumSnapConfig = MinimumSnapConfig::default(), nested();
    }
}

/// Time constant with which a descent gathers speed, s.
const DESCENT_RAMP_S: f64 = 0.5;

/// What the reference does with time.
#[derive(Clone, Debug)]
enum Plan {
    /// Motors off or idle: there is no reference.
    Rest,
    /// Standing still.
    Hover(Reference),
    /// Where another part leads.
    Led(Reference),
    /// Moving along a trajectory.
    Track {
        trajectory: Trajectory,
        start: Timestamp,
    },
    /// Descending while another plan brings the horizontal motion to rest.
    Descend { across: Box<Plan>, start: Timestamp },
}

/// Produces the reference that belongs to the mode of flight.
#[derive(Clone, Debug)]
pub struct Guide {
    config: GuideConfig,
    planner: MinimumSnap,
    plan: Plan,
    mode: FlightMode,
}

impl Guide {
    /// A guide at rest.
    ///
    /// # Errors
    /// When a parameter is outside its range.
    pub fn new(config: &GuideConfig) -> Result<Self, ParameterError> {
        config.validate()?;
        let planner =
            MinimumSnap::new(&config.minimum_snap).map_err(|error| error.under("minimum_snap"))?;
        Ok(Self {
            config: config.clone(),
            planner,
            plan: Plan::Rest,
            mode: FlightMode::Disarmed,
        })
    }

    /// A trajectory through waypoints (world, m), from where the reference is now.
    ///
    /// # Errors
    /// When no trajectory through them exists.
    pub fn plan_through(
        &self,
        now: Timestamp,
        state: &NavState,
        waypoints_world: &[Vector3<f64>],
    ) -> Result<Trajectory, PlanError> {
        let start = self.reference(now).unwrap_or_else(|| standing(state));
        self.planner.plan(
            &start,
            waypoints_world,
            &self.config.limits,
            self.config.yaw,
        )
    }

    /// Follows a trajectory from now on.
    pub fn follow(&mut self, trajectory: Trajectory, now: Timestamp) {
        self.plan = Plan::Track {
            trajectory,
            start: now,
        };
    }

    /// Goes where another part leads, until the mode changes or something else is followed.
    pub fn be_led(&mut self, reference: Reference) {
        self.plan = Plan::Led(reference);
    }

    /// Goes back to a hover.
    pub fn return_to(&mut self, hover: &Reference, now: Timestamp) {
        let moving = self.reference(now).unwrap_or(*hover);
        let planned = self.planner.plan(
            &moving,
            &[hover.position_world],
            &self.config.limits,
            YawPolicy::Hold,
        );
        self.plan = match planned {
            Ok(trajectory) => Plan::Track {
                trajectory,
                start: now,
            },
            Err(_) => self.braking(now, &moving),
        };
    }

    /// Where it stands, or comes to a stand.
    pub fn hover(&self) -> Option<Reference> {
        match &self.plan {
            Plan::Hover(reference) => Some(*reference),
            Plan::Track { trajectory, .. } => {
                let end = trajectory.sample(trajectory.duration_s());
                Some(Reference::hover(end.position_world, end.yaw_rad))
            }
            Plan::Rest | Plan::Led(_) | Plan::Descend { .. } => None,
        }
    }

    /// Brings a motion to rest.
    pub fn brake(&mut self, now: Timestamp, state: &NavState) {
        self.stop(now, state);
    }

    /// Adapts the plan to a change of mode. `take_off_height_m` is the height to climb to.
    pub fn enter(
        &mut self,
        mode: FlightMode,
        now: Timestamp,
        state: &NavState,
        take_off_height_m: f64,
    ) {
        if mode == self.mode {
            return;
        }
        match mode {
            FlightMode::Disarmed | FlightMode::Armed | FlightMode::Killed => self.plan = Plan::Rest,
            FlightMode::TakingOff => self.climb(now, state, take_off_height_m),
            FlightMode::Hovering => self.stop(now, state),
            FlightMode::Flying => {}
            FlightMode::Landing => self.descend(now, state),
        }
        self.mode = mode;
    }

    /// The reference at a time; `None` while the vehicle rests.
    pub fn reference(&self, now: Timestamp) -> Option<Reference> {
        self.plan.reference(now, self.config.landing_speed_m_s)
    }

    /// How far the reference is along its trajectory.
    pub fn progress(&self, now: Timestamp) -> Progress {
        match &self.plan {
            Plan::Track { trajectory, start }
                if now.seconds_since(*start) < trajectory.duration_s() =>
            {
                Progress::Running
            }
            Plan::Track { .. } => Progress::Finished,
            Plan::Rest | Plan::Hover(_) | Plan::Led(_) | Plan::Descend { .. } => Progress::Absent,
        }
    }

    fn limits_at(&self, max_speed_m_s: f64) -> MotionLimits {
        MotionLimits {
            max_speed_m_s,
            ..self.config.limits.clone()
        }
    }

    /// Straight up from where the vehicle stands.
    fn climb(&mut self, now: Timestamp, state: &NavState, height_m: f64) {
        let start = standing(state);
        let top = start.position_world + Vector3::z() * height_m;
        let limits = self.limits_at(self.config.take_off_speed_m_s);
        self.plan = match self.planner.plan(&start, &[top], &limits, YawPolicy::Hold) {
            Ok(trajectory) => Plan::Track {
                trajectory,
                start: now,
            },
            Err(_) => Plan::Hover(Reference::hover(top, start.yaw_rad)),
        };
    }

    /// Comes to a stop as soon as the limits allow and hovers there.
    fn stop(&mut self, now: Timestamp, state: &NavState) {
        if self.progress(now) != Progress::Running
            && let Some(reference) = self
                .reference(now)
                .filter(|r| r.velocity_world.norm() < 1e-3)
        {
            self.plan = Plan::Hover(reference);
            return;
        }
        let moving = self.reference(now).unwrap_or_else(|| standing(state));
        self.plan = self.braking(now, &moving);
    }

    fn braking(&self, now: Timestamp, moving: &Reference) -> Plan {
        let speed = moving.velocity_world.norm();
        let distance = speed * speed / self.config.limits.max_acceleration_m_s2;
        let ahead = moving
            .velocity_world
            .try_normalize(1e-3)
            .unwrap_or_else(Vector3::zeros);
        let target = moving.position_world + ahead * distance;
        let limits = self.limits_at(self.config.limits.max_speed_m_s.max(1.2 * speed));
        match self
            .planner
            .plan(moving, &[target], &limits, YawPolicy::Hold)
        {
            Ok(trajectory) => Plan::Track {
                trajectory,
                start: now,
            },
            Err(_) => Plan::Hover(Reference::hover(target, moving.yaw_rad)),
        }
    }

    /// Down from where the reference is; a horizontal motion is braked on the way.
    fn descend(&mut self, now: Timestamp, state: &NavState) {
        let moving = self.reference(now).unwrap_or_else(|| standing(state));
        let across = self.braking(now, &level(&moving));
        self.plan = Plan::Descend {
            across: Box::new(across),
            start: now,
        };
    }
}

impl Plan {
    fn reference(&self, now: Timestamp, landing_speed_m_s: f64) -> Option<Reference> {
        match self {
            Self::Rest => None,
            Self::Hover(reference) | Self::Led(reference) => Some(*reference),
            Self::Track { trajectory, start } => Some(trajectory.sample(now.seconds_since(*start))),
            Self::Descend { across, start } => {
                let level = across.reference(now, landing_speed_m_s)?;
                Some(descending(
                    &level,
                    landing_speed_m_s,
                    now.seconds_since(*start),
                ))
            }
        }
    }
}

/// The same motion without its vertical part.
fn level(reference: &Reference) -> Reference {
    let flat = |v: Vector3<f64>| Vector3::new(v.x, v.y, 0.0);
    Reference {
        velocity_world: flat(reference.velocity_world),
        acceleration_world: flat(reference.acceleration_world),
        jerk_world: flat(reference.jerk_world),
        snap_world: flat(reference.snap_world),
        ..*reference
    }
}

/// The reference that keeps the vehicle where it is.
fn standing(state: &NavState) -> Reference {
    Reference::hover(
        state.position_world(),
        so3::yaw_rad(&state.world_from_body.rotation),
    )
}

/// A level motion with a descent that gathers speed with a first-order lag.
///
/// v(t) = -s (1 - e^(-t/T)), z(t) = z_0 - s (t - T (1 - e^(-t/T))).
fn descending(level: &Reference, speed_m_s: f64, t_s: f64) -> Reference {
    let decay = (-t_s / DESCENT_RAMP_S).exp();
    let travelled = speed_m_s * (t_s - DESCENT_RAMP_S * (1.0 - decay));
    let up = Vector3::z();
    Reference {
        position_world: level.position_world - up * travelled,
        velocity_world: level.velocity_world - up * (speed_m_s * (1.0 - decay)),
        acceleration_world: level.acceleration_world - up * (speed_m_s * decay / DESCENT_RAMP_S),
        ..*level
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guide() -> Guide {
        Guide::new(&GuideConfig::default()).unwrap()
    }

    fn state_at(position: Vector3<f64>) -> NavState {
        let mut state = NavState::default();
        state.world_from_body.translation.vector = position;
        state
    }

    /// A guide that flies along x, at the time when its reference is fastest.
    fn flying() -> (Guide, Timestamp, NavState) {
        let mut guide = guide();
        let state = state_at(Vector3::new(0.0, 0.0, 1.5));
        guide.enter(FlightMode::Hovering, Timestamp::ZERO, &state, 0.0);
        let far = Vector3::new(10.0, 0.0, 1.5);
        let trajectory = guide.plan_through(Timestamp::ZERO, &state, &[far]).unwrap();
        let middle = Timestamp::from_s(0.5 * trajectory.duration_s());
        guide.follow(trajectory, Timestamp::ZERO);
        guide.enter(FlightMode::Flying, Timestamp::ZERO, &state, 0.0);
        (guide, middle, state)
    }

    /// Greatest acceleration of the reference from `start` on, and its last value.
    fn course(guide: &Guide, start: Timestamp) -> (f64, Reference) {
        let at = |i: i32| guide.reference(Timestamp::from_s(start.as_s() + 0.01 * f64::from(i)));
        let course: Vec<Reference> = (0..1000).filter_map(at).collect();
        let peak = course
            .iter()
            .map(|r| r.acceleration_world.norm())
            .fold(0.0, f64::max);
        (peak, *course.last().unwrap())
    }

    #[test]
    fn a_resting_vehicle_has_no_reference() {
        assert_eq!(guide().reference(Timestamp::ZERO), None);
    }

    #[test]
    fn a_hold_in_motion_brakes_within_the_limits_and_stands() {
        let (mut guide, middle, state) = flying();
        guide.enter(FlightMode::Hovering, middle, &state, 0.0);
        let (peak, last) = course(&guide, middle);
        assert!(
            peak <= 1.05 * guide.config.limits.max_acceleration_m_s2,
            "{peak}"
        );
        assert!(last.velocity_world.norm() < 1e-9);
    }

    #[test]
    fn a_landing_in_motion_brakes_on_the_way_down() {
        let (mut guide, middle, state) = flying();
        let before = guide.reference(middle).unwrap();
        guide.enter(FlightMode::Landing, middle, &state, 0.0);
        let after = guide.reference(middle).unwrap();
        assert!((after.velocity_world - before.velocity_world).norm() < 0.05);
        let (peak, last) = course(&guide, middle);
        assert!(
            peak <= 1.5 * guide.config.limits.max_acceleration_m_s2,
            "{peak}"
        );
        let down = Vector3::new(0.0, 0.0, -guide.config.landing_speed_m_s);
        assert!((last.velocity_world - down).norm() < 1e-6);
    }

    #[test]
    fn a_take_off_climbs_straight_to_its_height() {
        let mut guide = guide();
        let state = state_at(Vector3::new(1.0, 2.0, 0.2));
        guide.enter(FlightMode::TakingOff, Timestamp::ZERO, &state, 1.3);
        let (_, last) = course(&guide, Timestamp::ZERO);
        assert!((last.position_world - Vector3::new(1.0, 2.0, 1.5)).norm() < 1e-9);
    }
}
