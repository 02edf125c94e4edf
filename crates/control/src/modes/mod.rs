//! The flight modes: which requests are taken in which mode, and which modes end by themselves
//! (the behaviour controller of document O, section 1.2.2).
//!
//! The table of all transitions is in `docs/derivations/flight-modes-and-guard.md`.

mod config;
mod requests;
mod touchdown;

#[cfg(test)]
mod tests;

pub use config::{FlightModesConfig, TouchdownConfig};

use alula_geometry::{Timestamp, so3};
use alula_messages::{EstimateHealth, Fallback, FlightMode, Intent, NavState, Refusal};
use alula_parameters::{ParameterError, Parameters};

use touchdown::Touchdown;

/// How far the vehicle is along its trajectory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Progress {
    /// There is no trajectory.
    #[default]
    Absent,
    /// It is being followed.
    Running,
    /// Its end is reached.
    Finished,
}

/// What the modes look at in one step.
#[derive(Clone, Copy, Debug)]
pub struct Situation<'a> {
    /// The present.
    pub time: Timestamp,
    /// The estimate.
    pub state: &'a NavState,
    /// Height above the ground below by a raw range that is recent, corrected for the
    /// tilt, m.
    pub height_above_ground_m: Option<f64>,
    /// Collective thrust that is produced (or else commanded), as a share of the greatest possible.
    pub thrust_fraction: f64,
    /// The trajectory that the vehicle follows.
    pub trajectory: Progress,
    /// What the guard demands.
    pub guard: Fallback,
}

impl Situation<'_> {
    /// Whether the estimate is good enough to begin something.
    fn estimate_is_good(&self) -> bool {
        self.state.is_finite() && self.state.health == EstimateHealth::Good
    }

    fn z_m(&self) -> f64 {
        self.state.position_world().z
    }
}

/// The state machine of the flight modes.
///
/// Each step: [`FlightModes::request`] for every intent that has arrived, then
/// [`FlightModes::update`] once.
#[derive(Clone, Debug)]
pub struct FlightModes {
    config: FlightModesConfig,
    mode: FlightMode,
    /// When the present mode was entered.
    since: Timestamp,
    /// World height of the place of the last take-off, m.
    ground_z_m: f64,
    /// Height above that place at which the take-off ends, m.
    take_off_height_m: f64,
    /// Since when a killed vehicle lies still.
    still_since: Option<Timestamp>,
    touchdown: Touchdown,
}

impl FlightModes {
    /// Begins disarmed.
    ///
    /// # Errors
    /// The first parameter outside its range.
    pub fn new(config: &FlightModesConfig) -> Result<Self, ParameterError> {
        config.validate()?;
        config.validate_order()?;
        Ok(Self {
            config: config.clone(),
            mode: FlightMode::Disarmed,
            since: Timestamp::ZERO,
            ground_z_m: 0.0,
            take_off_height_m: 0.0,
            still_since: None,
            touchdown: Touchdown::new(&config.touchdown),
        })
    }

    /// The present mode.
    pub fn mode(&self) -> FlightMode {
        self.mode
    }

    /// World height of the place where the vehicle was armed last, m.
    pub fn ground_z_m(&self) -> f64 {
        self.ground_z_m
    }

    /// World height at which the take-off under way, or the last one, ends, m.
    pub fn take_off_z_m(&self) -> f64 {
        self.ground_z_m + self.take_off_height_m
    }

    /// Takes a request, or says why not. A refused request changes nothing.
    ///
    /// # Errors
    /// The reason of the refusal.
    pub fn request(&mut self, intent: &Intent, situation: &Situation) -> Result<(), Refusal> {
        let next = self.judge(intent, situation)?;
        if let Intent::TakeOff { height_m } = *intent {
            self.take_off_height_m = height_m;
        }
        self.enter(next, situation);
        Ok(())
    }

    /// Lets time pass: obeys the guard, then makes the transitions that need no request.
    pub fn update(&mut self, situation: &Situation) -> FlightMode {
        self.touchdown.observe(self.mode, situation);
        self.watch_stillness(situation);
        self.obey_guard(situation);
        if let Some(next) = self.next_by_itself(situation) {
            self.enter(next, situation);
        }
        self.mode
    }

    fn enter(&mut self, mode: FlightMode, situation: &Situation) {
        if mode == self.mode {
            return;
        }
        if mode == FlightMode::Armed {
            self.ground_z_m = situation.z_m();
            self.touchdown.learn_ground(situation.height_above_ground_m);
        }
        self.touchdown.restart();
        self.still_since = None;
        self.mode = mode;
        self.since = situation.time;
    }

    fn seconds_in_mode(&self, situation: &Situation) -> f64 {
        situation.time.seconds_since(self.since)
    }

    fn obey_guard(&mut self, situation: &Situation) {
        use FlightMode::{Armed, Disarmed, Flying, Hovering, Killed, Landing, TakingOff};
        let next = match (situation.guard, self.mode) {
            (_, Disarmed | Killed) | (Fallback::None, _) => return,
            (_, Armed) => Disarmed,
            (Fallback::Hold, TakingOff) if !self.may_hover_here(situation) => Landing,
            (Fallback::Hold, TakingOff | Flying) => Hovering,
            (Fallback::Hold, mode) => mode,
            (Fallback::Land | Fallback::Descend, _) => Landing,
            (Fallback::Cut, _) => Killed,
        };
        self.enter(next, situation);
    }

    fn next_by_itself(&self, situation: &Situation) -> Option<FlightMode> {
        match self.mode {
            FlightMode::Armed => (self.seconds_in_mode(situation) >= self.config.armed_timeout_s)
                .then_some(FlightMode::Disarmed),
            FlightMode::TakingOff => self.end_of_take_off(situation),
            FlightMode::Flying => {
                (situation.trajectory != Progress::Running).then_some(FlightMode::Hovering)
            }
            FlightMode::Landing => self.touchdown.is_certain().then_some(FlightMode::Disarmed),
            FlightMode::Disarmed | FlightMode::Hovering | FlightMode::Killed => None,
        }
    }

    fn end_of_take_off(&self, situation: &Situation) -> Option<FlightMode> {
        let missing_m = self.take_off_z_m() - situation.z_m();
        let climb_m_s = situation.state.velocity_world.z.abs();
        if missing_m <= self.config.height_tolerance_m && climb_m_s <= self.config.settled_m_s {
            return Some(FlightMode::Hovering);
        }
        let late = self.seconds_in_mode(situation) >= self.config.take_off_timeout_s;
        late.then_some(FlightMode::Landing)
    }

    /// Height above the take-off point: by the raw range where there is one, else the estimate's.
    fn height_m(&self, situation: &Situation) -> f64 {
        let estimated = situation.z_m() - self.ground_z_m;
        situation.height_above_ground_m.unwrap_or(estimated)
    }

    fn may_hover_here(&self, situation: &Situation) -> bool {
        self.height_m(situation) >= self.config.min_height_m
    }

    /// Keeps the time since when a killed vehicle neither falls nor turns.
    fn watch_stillness(&mut self, situation: &Situation) {
        let limits = &self.config.touchdown;
        let state = situation.state;
        let still = self.mode == FlightMode::Killed
            && state.acceleration_world.norm() <= limits.still_acceleration_m_s2
            && state.angular_rate_body.norm() <= limits.still_rate_rad_s;
        self.still_since = if still {
            self.still_since.or(Some(situation.time))
        } else {
            None
        };
    }

    fn tilt_deg(situation: &Situation) -> f64 {
        so3::tilt_rad(&situation.state.world_from_body.rotation).to_degrees()
    }
}
