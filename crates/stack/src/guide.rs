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
    /// Moving along a trajectory.
    Track {
        trajectory: Trajectory,
        start: Timestamp,
    },
    /// Descending vertically below a point.
    Descend { from: Reference, start: Timestamp },
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
        match &self.plan {
            Plan::Rest => None,
            Plan::Hover(reference) => Some(*reference),
            Plan::Track { trajectory, start } => Some(trajectory.sample(now.seconds_since(*start))),
            Plan::Descend { from, start } => {
                let speed = self.config.landing_speed_m_s;
                Some(descending(from, speed, now.seconds_since(*start)))
            }
        }
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
            Plan::Rest | Plan::Hover(_) | Plan::Descend { .. } => Progress::Absent,
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

    /// Straight down from where the reference is.
    fn descend(&mut self, now: Timestamp, state: &NavState) {
        let from = self.reference(now).unwrap_or_else(|| standing(state));
        self.plan = Plan::Descend {
            from: Reference::hover(from.position_world, from.yaw_rad),
            start: now,
        };
    }
}

/// The reference that keeps the vehicle where it is.
fn standing(state: &NavState) -> Reference {
    Reference::hover(
        state.position_world(),
        so3::yaw_rad(&state.world_from_body.rotation),
    )
}

/// A descent from `from` that gathers speed with a first-order lag.
///
/// v(t) = -s (1 - e^(-t/T)), z(t) = z_0 - s (t - T (1 - e^(-t/T))).
fn descending(from: &Reference, speed_m_s: f64, t_s: f64) -> Reference {
    let decay = (-t_s / DESCENT_RAMP_S).exp();
    let travelled = speed_m_s * (t_s - DESCENT_RAMP_S * (1.0 - decay));
    Reference {
        position_world: from.position_world - Vector3::z() * travelled,
        velocity_world: Vector3::z() * (-speed_m_s * (1.0 - decay)),
        acceleration_world: Vector3::z() * (-speed_m_s * decay / DESCENT_RAMP_S),
        ..*from
    }
}
