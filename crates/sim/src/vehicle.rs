//! A simulated vehicle: multirotor, autopilot and sensors in a world.

use std::collections::VecDeque;
use std::sync::Arc;

use alula_control::autopilot::Autopilot;
use alula_geometry::{Pose, TimeDelta, Timestamp, so3};
use alula_messages::{Command, SensorBatch, Vehicle, VehicleError};
use alula_parameters::{ParameterError, Parameters, facts, parameters};
use nalgebra::{Point3, Translation3, Vector3};

use crate::Truth;
use crate::multirotor::{Multirotor, STEP_S, VehicleModel, Wrench};
use crate::sensors::noise::derive_seed;
use crate::sensors::{AutopilotSensing, MotorActivity, OwnSense, SensorSuite, SensorSuiteConfig};
use crate::wind::{Wind, WindConfig};
use crate::world::{Clearance, ThingId, World};

/// Length of a step of the simulation.
const STEP: TimeDelta = TimeDelta::from_ns(1_000_000);

/// Nearer than this to an obstacle, contact is looked for in every step and not only once in a
/// control period: at 125 m/s it is crossed in a period of 4 ms.
const WATCHFUL_CLEARANCE_M: f64 = 0.5;

/// Beyond this tilt a rotor can reach the ground before the landing gear does.
const ROTOR_STRIKE_TILT_RAD: f64 = std::f64::consts::FRAC_PI_4;

parameters! {
    /// Where a vehicle stands at the start.
    pub struct StartConfig {
        /// Place of its feet, m: east, north, and above the ground.
        pub position_m: [f64; 3] = [0.0; 3], within(-1e5, 1e5);
        /// Heading, degrees counter-clockwise from east.
        pub yaw_deg: f64 = 0.0, within(-360.0, 360.0);
    }
}

parameters! {
    /// How a vehicle is told what to do, and what it survives.
    pub struct LinkConfig {
        /// Control periods per second; a period is a whole number of milliseconds.
        pub control_rate_hz: f64 = 250.0, within(1.0, 1000.0);
        /// Time from a command to its effect, s.
        pub command_latency_s: f64 = 0.0, within(0.0, 1.0);
        /// Greatest speed at touch-down that is not a crash, m/s.
        pub max_touchdown_m_s: f64 = 2.0, above(0.0);
    }
}

facts! {
    /// A vehicle to simulate.
    pub struct VehicleSetup {
        /// Body and autopilot.
        pub model: VehicleModel, nested();
        /// What the autopilot senses.
        #[serde(default)]
        pub autopilot_sensing: AutopilotSensing, nested();
        /// Sensors that the vehicle's computer reads.
        #[serde(default)]
        pub sensors: SensorSuiteConfig, nested();
        /// The air it flies in.
        #[serde(default)]
        pub wind: WindConfig, nested();
        /// Where it starts.
        #[serde(default)]
        pub start: StartConfig, nested();
        /// How it is commanded.
        #[serde(default)]
        pub link: LinkConfig, nested();
    }
}

impl VehicleSetup {
    /// A vehicle with a small multirotor's sensors, in still air at the origin.
    pub fn new(model: VehicleModel) -> Self {
        Self {
            model,
            autopilot_sensing: AutopilotSensing::default(),
            sensors: SensorSuiteConfig::small_multirotor(),
            wind: WindConfig::default(),
            start: StartConfig::default(),
            link: LinkConfig::default(),
        }
    }
}

impl LinkConfig {
    /// Steps in a control period.
    fn steps_per_period(&self) -> Result<u32, ParameterError> {
        let steps = 1.0 / (self.control_rate_hz * STEP_S);
        if (steps - steps.round()).abs() > 1e-9 {
            return Err(ParameterError::new(
                "link.control_rate_hz",
                self.control_rate_hz,
                "1000 divided by a whole number",
            ));
        }
        Ok(steps.round() as u32)
    }
}

/// How a flight ended in a crash.
#[derive(Clone, Debug, PartialEq)]
pub enum Collision {
    /// The vehicle touched an obstacle or a person.
    Contact {
        /// When.
        time: Timestamp,
        /// What it touched.
        thing: ThingId,
        /// Its name.
        what: String,
    },
    /// The landing gear met the ground too fast.
    HardLanding {
        /// When.
        time: Timestamp,
        /// Speed just before, m/s.
        speed_m_s: f64,
    },
    /// A rotor met the ground.
    RotorStrike {
        /// When.
        time: Timestamp,
        /// Angle between the body's z axis and the vertical, rad.
        tilt_rad: f64,
    },
}

/// A vehicle in a world. [`Vehicle::sense`] lets one control period pass.
pub struct SimulatedVehicle {
    world: Arc<World>,
    multirotor: Multirotor,
    autopilot: Autopilot,
    own_sense: OwnSense,
    sensors: SensorSuite,
    wind: Wind,
    steps_per_period: u32,
    command_latency: TimeDelta,
    max_touchdown_m_s: f64,
    truth: Truth,
    obeyed: Command,
    /// Commands that have not taken effect, with the time at which they will.
    pending: VecDeque<(Timestamp, Command)>,
    /// What is nearest, as of the last look.
    clearance: Option<Clearance>,
    collision: Option<Collision>,
}

impl SimulatedVehicle {
    /// A vehicle at rest on the ground, motors off, at time zero.
    ///
    /// # Errors
    /// The first parameter or fact that is not allowed.
    pub fn new(world: Arc<World>, setup: &VehicleSetup, seed: u64) -> Result<Self, ParameterError> {
        setup.validate()?;
        let airframe = setup.model.airframe.clone();
        let autopilot = Autopilot::new(&setup.model.autopilot, &airframe.airframe_facts())
            .map_err(|e| e.under("model.autopilot"))?;
        let standing_m = world.ground_height_m() + airframe.standing_height_m();
        let multirotor = Multirotor::new(airframe, setup.start.pose(standing_m))
            .map_err(|e| e.under("model.airframe"))?;
        let truth = multirotor.truth(Timestamp::ZERO);
        Ok(Self {
            clearance: clearance(&world, &truth, multirotor.config().radius_m),
            truth,
            multirotor,
            autopilot,
            own_sense: OwnSense::new(&setup.autopilot_sensing, seed),
            sensors: SensorSuite::new(&setup.sensors, seed).map_err(|e| e.under("sensors"))?,
            wind: Wind::new(setup.wind.clone(), derive_seed(seed, "wind"))
                .map_err(|e| e.under("wind"))?,
            steps_per_period: setup.link.steps_per_period()?,
            command_latency: TimeDelta::from_s(setup.link.command_latency_s),
            max_touchdown_m_s: setup.link.max_touchdown_m_s,
            obeyed: Command::Disarm,
            pending: VecDeque::new(),
            collision: None,
            world,
        })
    }

    /// The true motion, for those who judge a flight; nothing that flies may see it.
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// The world it is in.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// Duration of a control period.
    pub fn control_period(&self) -> TimeDelta {
        TimeDelta::from_ns(STEP.as_ns() * i64::from(self.steps_per_period))
    }

    /// True distance (m) from the vehicle's surface to the nearest thing other than the ground,
    /// negative inside, at the end of the last control period; `None` if there is nothing.
    pub fn clearance(&self) -> Option<Clearance> {
        self.clearance
    }

    /// The first collision, if there was one; it stays.
    pub fn collision(&self) -> Option<&Collision> {
        self.collision.as_ref()
    }

    /// One step: autopilot, motion, sensors.
    fn step(&mut self) {
        let before = self.truth;
        self.obey(before.time);
        let sensed = self.own_sense.sense(&before, STEP_S);
        let rotor_thrusts_n = self.autopilot.update(&self.obeyed, &sensed, STEP_S);
        let air_velocity_world = self.wind.velocity_world(STEP_S);
        let ground_height_m = self.world.ground_height_m();
        self.multirotor.step(
            &rotor_thrusts_n,
            &air_velocity_world,
            &Wrench::default(),
            ground_height_m,
        );
        self.truth = self.multirotor.truth(before.time + STEP);
        let motors = self.motors();
        self.sensors
            .advance(&self.world, &before, &self.truth, &motors);
        if self
            .clearance
            .is_some_and(|c| c.distance_m < WATCHFUL_CLEARANCE_M)
        {
            self.watch_obstacles();
        }
        self.watch_ground(&before);
    }

    /// Takes over the commands whose time has come.
    fn obey(&mut self, now: Timestamp) {
        while let Some((_, command)) = self.pending.front().filter(|(from, _)| *from <= now) {
            self.obeyed = *command;
            self.pending.pop_front();
        }
    }

    fn motors(&self) -> MotorActivity {
        MotorActivity {
            armed: self.obeyed != Command::Disarm,
            thrust_fraction: self.multirotor.thrust_fraction(),
        }
    }

    fn watch_obstacles(&mut self) {
        self.clearance = clearance(&self.world, &self.truth, self.multirotor.config().radius_m);
        if let Some(touched) = self.clearance.filter(|c| c.distance_m < 0.0) {
            let time = self.truth.time;
            let thing = touched.what;
            // Over a vehicle that stands on the ground people step.
            if self.truth.on_ground && matches!(thing, ThingId::Person(_)) {
                return;
            }
            let what = self.world.describe(thing).to_owned();
            self.collide(Collision::Contact { time, thing, what });
        }
    }

    fn watch_ground(&mut self, before: &Truth) {
        let (time, config) = (self.truth.time, self.multirotor.config());
        let speed_m_s = before.velocity_world.norm();
        if self.truth.on_ground && !before.on_ground && speed_m_s > self.max_touchdown_m_s {
            self.collide(Collision::HardLanding { time, speed_m_s });
            return;
        }
        let tilt_rad = so3::tilt_rad(&self.truth.world_from_body.rotation);
        let height_m = self.truth.position_world().z - self.world.ground_height_m();
        let lowest_rotor_m = height_m - config.radius_m * tilt_rad.sin();
        let upside_down = tilt_rad > std::f64::consts::FRAC_PI_2 && height_m < config.radius_m;
        if tilt_rad > ROTOR_STRIKE_TILT_RAD && (lowest_rotor_m < 0.0 || upside_down) {
            self.collide(Collision::RotorStrike { time, tilt_rad });
        }
    }

    /// Keeps the first collision only.
    fn collide(&mut self, collision: Collision) {
        self.collision.get_or_insert(collision);
    }
}

/// Distance from the surface of a ball of this radius round the vehicle to the nearest thing.
fn clearance(world: &World, truth: &Truth, radius_m: f64) -> Option<Clearance> {
    let mut clearance = world.clearance(&Point3::from(truth.position_world()), truth.time)?;
    clearance.distance_m -= radius_m;
    Some(clearance)
}

impl Vehicle for SimulatedVehicle {
    fn sense(&mut self, batch: &mut SensorBatch) -> Result<bool, VehicleError> {
        for _ in 0..self.steps_per_period {
            self.step();
        }
        self.watch_obstacles();
        batch.clear();
        self.sensors.deliver(self.truth.time, batch);
        Ok(true)
    }

    fn command(&mut self, command: &Command) -> Result<(), VehicleError> {
        let effective = self.truth.time + self.command_latency;
        self.pending.push_back((effective, *command));
        Ok(())
    }
}

impl StartConfig {
    /// Pose of a body whose centre stands `standing_m` above zero.
    fn pose(&self, standing_m: f64) -> Pose {
        let centre_m = Vector3::from(self.position_m) + Vector3::z() * standing_m;
        let rotation = so3::from_roll_pitch_yaw(0.0, 0.0, self.yaw_deg.to_radians());
        Pose::from_parts(Translation3::from(centre_m), rotation)
    }
}

#[cfg(test)]
mod tests;
