//! A scenario: the world, the vehicle in it, what it believes about itself, and what it is to do.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use alula_parameters::{ParameterError, Parameters, facts, parameters};
use alula_sim::multirotor::{self, VehicleModel};
use alula_sim::sensors::{AutopilotSensing, SensorSuiteConfig};
use alula_sim::wind::WindConfig;
use alula_sim::world::{World, WorldConfig, WorldError};
use alula_sim::{LinkConfig, SimulatedVehicle, StartConfig, VehicleSetup};
use alula_stack::{Stack, StackConfig};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::config::{ConfigText, resolved_text};
use crate::mission::MissionConfig;
use crate::{ConfigError, RunError};

/// The scenario that flies when none is named.
const DEFAULT_SCENARIO: &str = include_str!("../../../scenarios/among-people.toml");

/// Nobody comes to where the vehicle takes off in this first time, s.
const START_DESERTED_S: f64 = 5.0;

/// Its name in messages.
const DEFAULT_NAME: &str = "the built-in scenario";

parameters! {
    /// A vehicle as it really is, which the stack does not get to know.
    pub struct SimulationConfig {
        /// One of the multirotors that come with the simulator.
        pub preset: Option<String> = None, any();
        /// The multirotor and its autopilot, in place of a preset.
        pub model: Option<VehicleModel> = None, nested();
        /// True mass over that of the preset or model.
        pub mass_factor: f64 = 1.0, within(0.5, 2.0);
        /// What its autopilot senses.
        pub autopilot_sensing: AutopilotSensing = AutopilotSensing::default(), nested();
        /// Sensors on board and around.
        pub sensors: SensorSuiteConfig = SensorSuiteConfig::default(), nested();
        /// Moving air.
        pub wind: WindConfig = WindConfig::default(), nested();
        /// Where it stands at the start.
        pub start: StartConfig = StartConfig::default(), nested();
        /// How it is commanded.
        pub link: LinkConfig = LinkConfig::default(), nested();
        /// What the stack uses as its state.
        pub state: StateSource = StateSource::Estimated, any();
        /// A person whose ellipsoid is nearer than this to the centre of the flying vehicle counts
        /// as a contact (document L, section 7-2-1).
        pub contact_distance_m: f64 = 0.4, within(0.0, 10.0);
        /// A flight that lasts longer has failed.
        pub time_limit_s: f64 = 300.0, within(1.0, 7200.0);
    }
}

/// Where the stack's state comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StateSource {
    /// Its own estimator.
    #[default]
    Estimated,
    /// The simulator's truth, to judge control alone.
    Truth,
}

facts! {
    /// The whole scenario file.
    pub struct ScenarioConfig {
        /// Short name, used for folders.
        pub name: String, any();
        /// What is around.
        pub world: WorldConfig, nested();
        /// The vehicle as it really is.
        pub simulation: SimulationConfig, nested();
        /// What the vehicle believes about itself, and how it estimates, decides and controls.
        pub stack: StackConfig, nested();
        /// What it is to do.
        pub mission: MissionConfig, nested();
    }
}

/// A checked scenario that can be flown.
#[derive(Clone, Debug)]
pub struct Scenario {
    config: ScenarioConfig,
    /// Where it came from, for messages.
    file: String,
    /// Folder to which file names in the scenario refer.
    folder: PathBuf,
}

impl Scenario {
    /// Reads a scenario file, or the built-in one, and applies `key=value` overrides.
    ///
    /// # Errors
    /// When the file cannot be read or anything in it is not allowed.
    pub fn load(path: Option<&Path>, overrides: &[String]) -> Result<Self, RunError> {
        let text = match path {
            Some(path) => ConfigText {
                file: path.display().to_string(),
                text: read_text(path)?,
            },
            None => ConfigText {
                file: DEFAULT_NAME.into(),
                text: DEFAULT_SCENARIO.into(),
            },
        };
        let folder = path
            .and_then(Path::parent)
            .unwrap_or(Path::new(""))
            .to_path_buf();
        Self::parse(text.with_overrides(overrides)?, folder)
    }

    /// A scenario from text; file names in it refer to `folder`.
    ///
    /// # Errors
    /// When anything in it is not allowed.
    pub fn parse(text: ConfigText, folder: PathBuf) -> Result<Self, RunError> {
        let config: ScenarioConfig = text.read()?;
        let scenario = Self {
            config,
            file: text.file.clone(),
            folder,
        };
        scenario
            .vehicle_setup()
            .map_err(|error| text.value_error(error))?;
        Stack::new(&scenario.config.stack)
            .map_err(|error| text.value_error(error.under("stack")))?;
        Ok(scenario)
    }

    /// The configuration, with every default filled in.
    pub fn config(&self) -> &ScenarioConfig {
        &self.config
    }

    /// The configuration as text, with every default filled in.
    ///
    /// # Errors
    /// When a value has no TOML form.
    pub fn resolved_text(&self) -> Result<String, ConfigError> {
        resolved_text(&self.config)
    }

    /// Builds the world for a seed and makes sure that the mission is possible in it.
    ///
    /// # Errors
    /// When the world cannot be, a file it names cannot be read, or a waypoint lies in an obstacle.
    pub fn build_world(&self, seed: u64) -> Result<Arc<World>, RunError> {
        let radius_m = self.vehicle_model()?.airframe.radius_m;
        self.possible_world(seed, radius_m)
            .map(Arc::new)
            .map_err(|error| RunError::Scenario {
                file: self.file.clone(),
                error: Box::new(error),
            })
    }

    /// A world in which a vehicle of this radius has room where the mission leads.
    fn possible_world(&self, seed: u64, radius_m: f64) -> Result<World, WorldError> {
        let assets = |name: &str| {
            let path = self.folder.join(with_variables(name)?);
            fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))
        };
        let world = World::new(&self.config.world, seed, &assets)?;
        let [x, y, _] = self.config.simulation.start.position_m;
        let ground_m = world.ground_height_m();
        let height_m = ground_m + self.config.mission.take_off_height_m;
        world.check_free(
            &Point3::new(x, y, ground_m + radius_m),
            radius_m,
            "the start",
        )?;
        world.check_free(
            &Point3::new(x, y, height_m),
            radius_m,
            "the hover after take-off",
        )?;
        for (height_m, what) in [
            (ground_m + radius_m, "the start"),
            (height_m, "the hover after take-off"),
        ] {
            let place = Point3::new(x, y, height_m);
            world.check_deserted(&place, radius_m, START_DESERTED_S, what)?;
        }
        for (i, waypoint) in self.config.mission.waypoints_m.iter().enumerate() {
            world.check_free(
                &Point3::from(*waypoint),
                radius_m,
                &format!("waypoint {}", i + 1),
            )?;
        }
        Ok(world)
    }

    /// A simulated vehicle at the start.
    ///
    /// # Errors
    /// When the vehicle's parameters are not allowed.
    pub fn build_vehicle(
        &self,
        world: Arc<World>,
        seed: u64,
    ) -> Result<SimulatedVehicle, RunError> {
        Ok(SimulatedVehicle::new(world, &self.vehicle_setup()?, seed)?)
    }

    /// The stack that flies it.
    ///
    /// # Errors
    /// When its parameters are not allowed.
    pub fn build_stack(&self) -> Result<Stack, RunError> {
        Ok(Stack::new(&self.config.stack).map_err(|e| e.under("stack"))?)
    }

    fn vehicle_setup(&self) -> Result<VehicleSetup, ParameterError> {
        let simulation = &self.config.simulation;
        let setup = VehicleSetup {
            model: self.vehicle_model()?,
            autopilot_sensing: simulation.autopilot_sensing.clone(),
            sensors: simulation.sensors.clone(),
            wind: simulation.wind.clone(),
            start: simulation.start.clone(),
            link: simulation.link.clone(),
        };
        setup
            .validate()
            .map_err(|error| error.under("simulation"))?;
        Ok(setup)
    }

    fn vehicle_model(&self) -> Result<VehicleModel, ParameterError> {
        let simulation = &self.config.simulation;
        let mut model = match (&simulation.model, &simulation.preset) {
            (Some(own), None) => own.clone(),
            (None, Some(name)) => multirotor::preset(name).ok_or_else(|| {
                let known = multirotor::PRESET_NAMES.join(", ");
                ParameterError::new("simulation.preset", name, format!("one of {known}"))
            })?,
            _ => {
                let finding = "without a vehicle, or with two";
                let allowed = "either the key `preset` or the table `model`";
                return Err(ParameterError::new("simulation", finding, allowed));
            }
        };
        model.airframe.mass_kg *= simulation.mass_factor;
        Ok(model)
    }
}

/// A file name in which every `${NAME}` is replaced by the environment variable of that name.
pub(crate) fn with_variables(name: &str) -> Result<String, String> {
    let mut parts = name.split("${");
    let mut full = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (variable, rest) = part
            .split_once('}')
            .ok_or_else(|| "`${` without `}`; write `${NAME}`".to_owned())?;
        let value = env::var(variable).map_err(|_| {
            format!("the environment variable `{variable}` is not set; set it to the folder meant")
        })?;
        full.push_str(&value);
        full.push_str(rest);
    }
    Ok(full)
}

/// Reads a text file, with a message that names it.
///
/// # Errors
/// When it does not exist or cannot be read.
pub fn read_text(path: &Path) -> Result<String, RunError> {
    fs::read_to_string(path).map_err(|source| RunError::Read {
        path: path.to_path_buf(),
        source,
    })
}
