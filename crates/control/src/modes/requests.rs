//! Which requests are taken, and why the others are refused.

use alula_messages::{Fallback, FlightMode, Intent, Refusal};
use nalgebra::Vector3;

use super::{FlightModes, Situation};

impl FlightModes {
    /// The mode that the intent leads to.
    pub(super) fn judge(
        &self,
        intent: &Intent,
        situation: &Situation,
    ) -> Result<FlightMode, Refusal> {
        self.yield_to_guard(intent, situation.guard)?;
        match intent {
            Intent::Arm => self.judge_arm(situation),
            Intent::Disarm => self.judge_disarm(situation),
            Intent::TakeOff { height_m } => self.judge_take_off(*height_m, situation),
            Intent::Fly { waypoints_world } => self.judge_fly(waypoints_world, situation),
            Intent::Hold => self.judge_hold(situation),
            Intent::Land => self.judge_land(),
            Intent::Kill => Ok(FlightMode::Killed),
        }
    }

    /// While the guard acts, only what is at least as safe passes.
    fn yield_to_guard(&self, intent: &Intent, guard: Fallback) -> Result<(), Refusal> {
        let passes = match intent {
            Intent::Land | Intent::Kill | Intent::Disarm => true,
            Intent::Hold => guard <= Fallback::Hold,
            Intent::Arm | Intent::TakeOff { .. } | Intent::Fly { .. } => guard == Fallback::None,
        };
        passes.then_some(()).ok_or(Refusal::GuardActive)
    }

    fn judge_arm(&self, situation: &Situation) -> Result<FlightMode, Refusal> {
        self.require(self.mode == FlightMode::Disarmed)?;
        require_estimate(situation)?;
        let state = situation.state;
        require_within(Self::tilt_deg(situation), 0.0, self.config.arm_tilt_deg)?;
        require_within(state.velocity_world.norm(), 0.0, self.config.arm_speed_m_s)?;
        require_within(
            state.angular_rate_body.norm(),
            0.0,
            self.config.arm_rate_rad_s,
        )?;
        Ok(FlightMode::Armed)
    }

    fn judge_disarm(&self, situation: &Situation) -> Result<FlightMode, Refusal> {
        let lies_still = self.still_since.is_some_and(|since| {
            situation.time.seconds_since(since) >= self.config.touchdown.still_dwell_s
        });
        self.require(match self.mode {
            FlightMode::Disarmed | FlightMode::Armed => true,
            FlightMode::Killed => lies_still,
            _ => false,
        })?;
        Ok(FlightMode::Disarmed)
    }

    fn judge_take_off(&self, height_m: f64, situation: &Situation) -> Result<FlightMode, Refusal> {
        self.require(self.mode == FlightMode::Armed)?;
        require_estimate(situation)?;
        require_within(height_m, self.config.min_height_m, self.config.max_height_m)?;
        Ok(FlightMode::TakingOff)
    }

    fn judge_fly(
        &self,
        waypoints_world: &[Vector3<f64>],
        situation: &Situation,
    ) -> Result<FlightMode, Refusal> {
        self.require(matches!(
            self.mode,
            FlightMode::Hovering | FlightMode::Flying
        ))?;
        require_estimate(situation)?;
        if waypoints_world.is_empty() {
            return Err(Refusal::NoTrajectory);
        }
        for waypoint in waypoints_world {
            self.require_reachable(waypoint)?;
        }
        Ok(FlightMode::Flying)
    }

    fn require_reachable(&self, waypoint_world: &Vector3<f64>) -> Result<(), Refusal> {
        let reach = self.config.max_distance_m;
        require_within(waypoint_world.x, -reach, reach)?;
        require_within(waypoint_world.y, -reach, reach)?;
        require_within(
            waypoint_world.z,
            self.ground_z_m + self.config.min_height_m,
            self.ground_z_m + self.config.max_height_m,
        )
    }

    fn judge_hold(&self, situation: &Situation) -> Result<FlightMode, Refusal> {
        self.require(matches!(
            self.mode,
            FlightMode::TakingOff | FlightMode::Hovering | FlightMode::Flying | FlightMode::Landing
        ))?;
        if matches!(self.mode, FlightMode::TakingOff | FlightMode::Landing) {
            // Below this height the ground could be met while the vehicle comes to rest.
            let height_m = self.height_m(situation);
            require_within(height_m, self.config.min_height_m, f64::INFINITY)?;
        }
        Ok(FlightMode::Hovering)
    }

    fn judge_land(&self) -> Result<FlightMode, Refusal> {
        self.require(matches!(
            self.mode,
            FlightMode::TakingOff | FlightMode::Hovering | FlightMode::Flying | FlightMode::Landing
        ))?;
        Ok(FlightMode::Landing)
    }

    fn require(&self, in_right_mode: bool) -> Result<(), Refusal> {
        let refusal = Refusal::WrongMode { mode: self.mode };
        in_right_mode.then_some(()).ok_or(refusal)
    }
}

fn require_estimate(situation: &Situation) -> Result<(), Refusal> {
    let good = situation.estimate_is_good();
    good.then_some(()).ok_or(Refusal::EstimateNotReady)
}

/// A number that is not a number lies within no limits.
fn require_within(found: f64, low: f64, high: f64) -> Result<(), Refusal> {
    if found >= low && found <= high && found.is_finite() {
        return Ok(());
    }
    Err(Refusal::OutOfLimits { found, low, high })
}
