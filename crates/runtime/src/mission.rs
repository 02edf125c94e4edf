//! A mission: the sequence of requests that a flight consists of.

use alula_geometry::Timestamp;
use alula_messages::{EstimateHealth, Fallback, FlightMode, Hindrance, Intent, StackOutput};
use alula_parameters::parameters;
use nalgebra::Vector3;

parameters! {
    /// What to fly.
    pub struct MissionConfig {
        /// Height of the hover after take-off, above the take-off point.
        pub take_off_height_m: f64 = 1.5, within(0.3, 50.0);
        /// Points to fly through in order, world frame.
        pub waypoints_m: Vec<[f64; 3]> = Vec::new(), within(-1000.0, 1000.0);
        /// How often they are flown through, with the pause in the hover in between.
        pub rounds: usize = 1, within(1.0, 200.0);
        /// Pause in the hover before and after the waypoints.
        pub hover_s: f64 = 1.0, within(0.0, 600.0);
    }
}

/// How long a refused request waits before it is made again, s.
const RETRY_S: f64 = 0.5;

/// Where a mission is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Step {
    /// Waiting for a good estimate, then arming.
    Arm,
    /// Taking off.
    TakeOff,
    /// Hovering, then flying through the waypoints.
    Fly,
    /// Hovering, then landing.
    Land,
    /// On the way down.
    TouchDown,
    /// On the ground again with motors off.
    Done,
}

/// Makes the requests of a mission, each when the mode of flight allows it.
#[derive(Clone, Debug)]
pub struct Mission {
    config: MissionConfig,
    step: Step,
    /// Ways through the waypoints that have begun.
    rounds_begun: usize,
    /// Since when the vehicle has been hovering or standing ready.
    ready_since: Option<Timestamp>,
    last_request: Option<Timestamp>,
    asked_to_land: bool,
    interrupted: bool,
    mode: FlightMode,
    /// What hindered the last plan of the way.
    hindrance: Option<Hindrance>,
    gave_up: Option<(Hindrance, Timestamp)>,
}

impl Mission {
    /// A mission about to begin.
    pub fn new(config: &MissionConfig) -> Self {
        Self {
            config: config.clone(),
            step: Step::Arm,
            rounds_begun: 0,
            ready_since: None,
            last_request: None,
            asked_to_land: false,
            interrupted: false,
            mode: FlightMode::Disarmed,
            hindrance: None,
            gave_up: None,
        }
    }

    /// Where the mission is.
    pub fn step(&self) -> Step {
        self.step
    }

    /// Whether every waypoint was flown and the vehicle landed of its own accord.
    pub fn succeeded(&self) -> bool {
        self.step == Step::Done && !self.interrupted
    }

    /// Why the vehicle ended its way before the last waypoint by itself, and when.
    pub fn gave_up(&self) -> Option<(Hindrance, Timestamp)> {
        self.gave_up
    }

    /// The next request, if it is time for one, given the last output of the stack.
    pub fn next(&mut self, output: &StackOutput) -> Option<Intent> {
        if self.mode != FlightMode::Flying && output.mode == FlightMode::Flying {
            self.rounds_begun += 1;
            self.ready_since = None;
        }
        self.note_hold(output);
        self.advance(output.mode);
        let (mode, pause_s, intent) = self.wanted()?;
        let ready = output.mode == mode && output.state.health == EstimateHealth::Good;
        if !ready {
            self.ready_since = None;
            return None;
        }
        let since = *self.ready_since.get_or_insert(output.time);
        let rested = output.time.seconds_since(since) >= pause_s;
        let retry = self
            .last_request
            .is_none_or(|last| output.time.seconds_since(last) >= RETRY_S);
        (rested && retry).then(|| {
            self.last_request = Some(output.time);
            self.asked_to_land |= intent == Intent::Land;
            intent
        })
    }

    /// A hold by the guard ends the way through the waypoints before its end, and so does a vehicle
    /// that gives up: it stops while something keeps it from the goal.
    fn note_hold(&mut self, output: &StackOutput) {
        let stopped = self.mode == FlightMode::Flying && output.mode == FlightMode::Hovering;
        let held = stopped && output.guard.fallback != Fallback::None;
        if stopped && !held {
            self.gave_up = self.hindrance.map(|hindrance| (hindrance, output.time));
        }
        self.interrupted |= held || self.gave_up.is_some();
        self.mode = output.mode;
        self.note_hindrance(output);
    }

    /// A vehicle that gives up says why and then brakes without a plan; one that is free again
    /// makes a plan and says nothing.
    fn note_hindrance(&mut self, output: &StackOutput) {
        let keeps = output.hindrance.filter(|h| keeps_from_the_goal(*h));
        if keeps.is_some() || output.plan.is_some() {
            self.hindrance = keeps;
        }
    }

    /// Moves to the step that the mode of flight shows.
    fn advance(&mut self, mode: FlightMode) {
        let next = match (self.step, mode) {
            (Step::Arm, FlightMode::Armed) => Step::TakeOff,
            (Step::TakeOff, FlightMode::TakingOff) => Step::Fly,
            (Step::Fly, FlightMode::Flying) if self.is_last_round() => Step::Land,
            (Step::Fly, FlightMode::Hovering)
                if self.interrupted || self.config.waypoints_m.is_empty() =>
            {
                Step::Land
            }
            (Step::Land, FlightMode::Landing) if self.asked_to_land => Step::TouchDown,
            // A landing that the mission did not ask for ends it.
            (Step::Fly | Step::Land, FlightMode::Landing) => self.interrupt(Step::TouchDown),
            (Step::TouchDown, FlightMode::Disarmed) => Step::Done,
            (_, FlightMode::Killed) => self.interrupt(Step::Done),
            (Step::Fly | Step::Land, FlightMode::Disarmed) => self.interrupt(Step::Done),
            (step, _) => step,
        };
        if next != self.step {
            self.step = next;
            self.ready_since = None;
            self.last_request = None;
        }
    }

    /// Whether the way that has begun is the last one; one that ends before its end is, too.
    fn is_last_round(&self) -> bool {
        self.rounds_begun >= self.config.rounds
    }

    fn interrupt(&mut self, next: Step) -> Step {
        self.interrupted = true;
        next
    }

    /// The request of this step, the mode in which it is made and the pause before it.
    fn wanted(&self) -> Option<(FlightMode, f64, Intent)> {
        match self.step {
            Step::Arm => Some((FlightMode::Disarmed, 0.0, Intent::Arm)),
            Step::TakeOff => Some((
                FlightMode::Armed,
                RETRY_S,
                Intent::TakeOff {
                    height_m: self.config.take_off_height_m,
                },
            )),
            Step::Fly => Some((FlightMode::Hovering, self.config.hover_s, self.fly())),
            Step::Land => Some((FlightMode::Hovering, self.config.hover_s, Intent::Land)),
            Step::TouchDown | Step::Done => None,
        }
    }

    fn fly(&self) -> Intent {
        let waypoints_world = self
            .config
            .waypoints_m
            .iter()
            .map(|p| Vector3::from(*p))
            .collect();
        Intent::Fly { waypoints_world }
    }
}

/// Whether a vehicle gives up for it; it waits for the others to end.
fn keeps_from_the_goal(hindrance: Hindrance) -> bool {
    match hindrance {
        Hindrance::GoalBlocked { .. } | Hindrance::NoRoute | Hindrance::Stalled { .. } => true,
        Hindrance::DepthStale { .. }
        | Hindrance::EstimateJumped { .. }
        | Hindrance::PlannerFailed => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Requests made when the modes pass by, one second apart.
    fn requests(waypoints_m: Vec<[f64; 3]>, modes: &[FlightMode]) -> (Vec<Intent>, Mission) {
        let mut mission = Mission::new(&MissionConfig {
            waypoints_m,
            ..Default::default()
        });
        let made = requests_of(&mut mission, modes);
        (made, mission)
    }

    fn requests_of(mission: &mut Mission, modes: &[FlightMode]) -> Vec<Intent> {
        let mut made = Vec::new();
        let mut output = StackOutput::default();
        output.state.health = EstimateHealth::Good;
        for (second, mode) in modes.iter().enumerate() {
            let mut in_this_mode = Vec::new();
            for quarter in 0..8 {
                output.time = Timestamp::from_s(2.0 * second as f64 + 0.25 * f64::from(quarter));
                output.mode = *mode;
                in_this_mode.extend(mission.next(&output));
            }
            in_this_mode.dedup();
            made.extend(in_this_mode);
        }
        made
    }

    #[test]
    fn a_mission_arms_takes_off_flies_and_lands() {
        use FlightMode::*;
        let modes = [
            Disarmed, Armed, TakingOff, Hovering, Flying, Hovering, Landing, Disarmed,
        ];
        let (made, mission) = requests(vec![[1.0, 0.0, 1.0]], &modes);
        assert!(matches!(
            made[..],
            [
                Intent::Arm,
                Intent::TakeOff { .. },
                Intent::Fly { .. },
                Intent::Land
            ]
        ));
        assert!(mission.succeeded());
    }

    #[test]
    fn rounds_are_flown_one_after_the_other() {
        use FlightMode::*;
        let mut mission = Mission::new(&MissionConfig {
            waypoints_m: vec![[1.0, 0.0, 1.0]],
            rounds: 2,
            ..Default::default()
        });
        let modes = [
            Disarmed, Armed, TakingOff, Hovering, Flying, Hovering, Flying, Hovering, Landing,
            Disarmed,
        ];
        let made = requests_of(&mut mission, &modes);
        let rounds = made.iter().filter(|i| matches!(i, Intent::Fly { .. }));
        assert_eq!(rounds.count(), 2);
        assert_eq!(made.last(), Some(&Intent::Land));
        assert!(mission.succeeded());
    }

    #[test]
    fn a_landing_by_the_guard_is_no_success() {
        use FlightMode::*;
        let modes = [
            Disarmed, Armed, TakingOff, Hovering, Flying, Landing, Disarmed,
        ];
        let (_, mission) = requests(vec![[1.0, 0.0, 1.0]], &modes);
        assert_eq!(mission.step(), Step::Done);
        assert!(!mission.succeeded());
    }

    /// A mission on its way through the waypoints, at 10 s.
    fn on_the_way() -> Mission {
        let modes = [
            FlightMode::Disarmed,
            FlightMode::Armed,
            FlightMode::TakingOff,
            FlightMode::Hovering,
            FlightMode::Flying,
        ];
        requests(vec![[1.0, 0.0, 1.0]], &modes).1
    }

    /// The mission after a way whose last step was hindered like this.
    fn stopped_by(hindrance: Option<Hindrance>) -> Mission {
        let mut mission = on_the_way();
        let mut output = StackOutput {
            time: Timestamp::from_s(20.0),
            mode: FlightMode::Flying,
            hindrance,
            ..StackOutput::default()
        };
        mission.next(&output);
        // It brakes.
        output.hindrance = None;
        for mode in [
            FlightMode::Flying,
            FlightMode::Hovering,
            FlightMode::Landing,
        ] {
            output.mode = mode;
            mission.next(&output);
        }
        mission
    }

    #[test]
    fn a_vehicle_that_gives_up_says_why() {
        let blocked = Hindrance::GoalBlocked { obstacle: 3 };
        let at = Timestamp::from_s(20.0);
        for hindrance in [
            blocked,
            Hindrance::NoRoute,
            Hindrance::Stalled { since_s: 9.0 },
        ] {
            let mission = stopped_by(Some(hindrance));
            assert_eq!(mission.gave_up(), Some((hindrance, at)));
            assert!(mission.interrupted);
        }
    }

    #[test]
    fn a_vehicle_that_arrives_has_not_given_up() {
        let jumped = Hindrance::EstimateJumped { jump_m: 0.6 };
        for hindrance in [None, Some(jumped), Some(Hindrance::PlannerFailed)] {
            assert_eq!(stopped_by(hindrance).gave_up(), None);
        }
    }

    #[test]
    fn a_way_that_the_guard_cut_short_is_no_success() {
        let mut mission = on_the_way();
        let mut output = StackOutput {
            time: Timestamp::from_s(20.0),
            mode: FlightMode::Hovering,
            ..StackOutput::default()
        };
        output.state.health = EstimateHealth::Good;
        output.guard.fallback = Fallback::Hold;
        mission.next(&output);
        output.time = Timestamp::from_s(30.0);
        output.guard.fallback = Fallback::None;
        assert_eq!(mission.next(&output), Some(Intent::Land));
        for mode in [FlightMode::Landing, FlightMode::Disarmed] {
            output.mode = mode;
            mission.next(&output);
        }
        assert_eq!(mission.step(), Step::Done);
        assert!(!mission.succeeded());
    }

    #[test]
    fn nothing_is_asked_for_before_the_estimate_is_good() {
        let mut mission = Mission::new(&MissionConfig::default());
        assert_eq!(mission.next(&StackOutput::default()), None);
    }
}
