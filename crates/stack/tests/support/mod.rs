//! Flights of scenarios, step by step, for tests and benchmarks.

// Each of its users needs a part of it.
#![allow(dead_code, clippy::unwrap_used, clippy::panic)]

use std::sync::Arc;

use alula_messages::{EstimateHealth, FlightMode, Intent, SensorBatch, StackOutput, Vehicle};
use alula_sim::multirotor::preset;
use alula_sim::sensors::SensorSuiteConfig;
use alula_sim::world::World;
use alula_sim::{SimulatedVehicle, VehicleSetup};
use alula_stack::{Stack, StackConfig};
use nalgebra::Vector3;
use serde::de::DeserializeOwned;

/// The scenario that flies blind through waypoints.
pub const FIRST_FLIGHT: &str = include_str!("../../../../scenarios/first-flight.toml");
/// The scenario that flies among people and pillars by depth images.
pub const AMONG_PEOPLE: &str = include_str!("../../../../scenarios/among-people.toml");

/// Steps per second.
pub const RATE_HZ: usize = 250;

/// No flight of the scenario takes longer, steps.
const MAX_STEPS: usize = 120 * RATE_HZ;

/// Pause in the hover before and after the waypoints, steps.
const PAUSE_STEPS: usize = RATE_HZ;

/// What a stack got and what it made of it.
#[derive(Clone, Debug)]
pub struct Step {
    /// The request made before the step.
    pub intent: Option<Intent>,
    /// What the sensors said.
    pub batch: SensorBatch,
    /// The outcome.
    pub output: StackOutput,
}

/// The configuration of the first flight's stack.
pub fn stack_config() -> StackConfig {
    part(FIRST_FLIGHT, &["stack"])
}

/// The first flight without depth camera, from the ground to the ground.
pub fn flight() -> Vec<Step> {
    let mut stack = Stack::new(&stack_config()).unwrap();
    let sensors = SensorSuiteConfig {
        depth: None,
        ..part(FIRST_FLIGHT, &["simulation", "sensors"])
    };
    let mut vehicle = vehicle(FIRST_FLIGHT, sensors);
    let mut pilot = Pilot::of(FIRST_FLIGHT);
    let mut batch = SensorBatch::default();
    let mut steps = Vec::new();
    while !pilot.has_landed && steps.len() < MAX_STEPS {
        let intent = pilot.next(stack.output());
        vehicle.sense(&mut batch).unwrap();
        if let Some(intent) = &intent {
            stack.request(intent.clone());
        }
        let output = stack.update(&batch).clone();
        vehicle.command(&output.command).unwrap();
        steps.push(Step {
            intent,
            batch: batch.clone(),
            output,
        });
    }
    assert!(pilot.has_landed, "the flight did not end");
    steps
}

/// A flight of a scenario with all its sensors. `each` takes the steps of the stack: it must have
/// the stack look at the batch.
pub fn fly(scenario: &'static str, mut each: impl FnMut(&mut Stack, &SensorBatch)) {
    let mut stack = Stack::new(&part(scenario, &["stack"])).unwrap();
    let mut vehicle = vehicle(scenario, part(scenario, &["simulation", "sensors"]));
    let mut pilot = Pilot::of(scenario);
    let mut batch = SensorBatch::default();
    for _ in 0..MAX_STEPS {
        if let Some(intent) = pilot.next(stack.output()) {
            stack.request(intent);
        }
        vehicle.sense(&mut batch).unwrap();
        each(&mut stack, &batch);
        vehicle.command(&stack.output().command).unwrap();
        if pilot.has_landed {
            return;
        }
    }
    panic!("the flight did not end");
}

/// The same stack, fed with the same data up to step `end`.
pub fn replayed(steps: &[Step], end: usize) -> Stack {
    let mut stack = Stack::new(&stack_config()).unwrap();
    for step in &steps[..end] {
        replay(&mut stack, step);
    }
    stack
}

/// Makes a recorded step once more.
pub fn replay(stack: &mut Stack, step: &Step) {
    if let Some(intent) = &step.intent {
        stack.request(intent.clone());
    }
    stack.update(&step.batch);
}

/// The first step after which the vehicle follows its waypoints.
pub fn first_step_of_waypoints(steps: &[Step]) -> usize {
    let flying = |step: &Step| step.output.mode == FlightMode::Flying;
    steps.iter().position(flying).unwrap() + 1
}

/// Makes the requests of a scenario's mission.
struct Pilot {
    scenario: &'static str,
    hovered_steps: usize,
    has_flown: bool,
    has_landed: bool,
}

impl Pilot {
    fn of(scenario: &'static str) -> Self {
        Self {
            scenario,
            hovered_steps: 0,
            has_flown: false,
            has_landed: false,
        }
    }

    fn next(&mut self, output: &StackOutput) -> Option<Intent> {
        match output.mode {
            FlightMode::Disarmed if self.has_flown => {
                self.has_landed = true;
                None
            }
            FlightMode::Disarmed => {
                (output.state.health == EstimateHealth::Good).then_some(Intent::Arm)
            }
            FlightMode::Armed => Some(Intent::TakeOff {
                height_m: part(self.scenario, &["mission", "take_off_height_m"]),
            }),
            FlightMode::Hovering => self.leave_the_hover(),
            _ => None,
        }
    }

    fn leave_the_hover(&mut self) -> Option<Intent> {
        self.hovered_steps += 1;
        if self.hovered_steps < PAUSE_STEPS {
            return None;
        }
        self.hovered_steps = 0;
        if std::mem::replace(&mut self.has_flown, true) {
            return Some(Intent::Land);
        }
        let waypoints: Vec<[f64; 3]> = part(self.scenario, &["mission", "waypoints_m"]);
        Some(Intent::Fly {
            waypoints_world: waypoints.into_iter().map(Vector3::from).collect(),
        })
    }
}

fn vehicle(scenario: &str, sensors: SensorSuiteConfig) -> SimulatedVehicle {
    let name: String = part(scenario, &["simulation", "preset"]);
    let setup = VehicleSetup {
        sensors,
        wind: part(scenario, &["simulation", "wind"]),
        ..VehicleSetup::new(preset(&name).unwrap())
    };
    let assets = |name: &str| Err(format!("there is no `{name}`"));
    let world = World::new(&part(scenario, &["world"]), 1, &assets).unwrap();
    SimulatedVehicle::new(Arc::new(world), &setup, 1).unwrap()
}

/// A part of a scenario.
fn part<T: DeserializeOwned>(scenario: &str, keys: &[&str]) -> T {
    let root: toml::Value = toml::from_str(scenario).unwrap();
    let value = keys.iter().fold(&root, |value, key| &value[*key]);
    value.clone().try_into().unwrap()
}
