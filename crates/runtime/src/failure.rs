//! What stopped a flight, as stable words for tables.

use alula_geometry::Timestamp;
use alula_messages::{Hindrance, Violation};
use alula_sim::Collision;
use alula_sim::world::ThingId;

use crate::encounters::Encounters;
use crate::flight_log::{EventKind, FlightLog, LogEvent};

/// A hindrance explains a flight that ran out of time if it was last told of within this time, s.
const RECENT_S: f64 = 2.0;

/// A flight that ran out of time stood still if it had not moved for this long, s.
const STANDING_STILL_S: f64 = 5.0;

/// What it hit.
pub(crate) fn of_collision(collision: Option<&Collision>, encounters: &Encounters) -> &'static str {
    match collision {
        Some(Collision::Contact {
            thing: ThingId::Person(person),
            ..
        }) if encounters.came_unseen(*person) => "collision_person_unseen",
        Some(Collision::Contact {
            thing: ThingId::Person(_),
            ..
        }) => "collision_person",
        Some(Collision::Contact { .. }) => "collision_obstacle",
        _ => "collision_ground",
    }
}

/// Why it ran out of time: what the stack says hinders it, or that it does not move.
pub(crate) fn of_timeout(
    hindrance: Option<(Hindrance, Timestamp)>,
    now: Timestamp,
    log: &FlightLog,
) -> &'static str {
    match hindrance {
        Some((hindrance, at)) if now.seconds_since(at) <= RECENT_S => hindrance.name(),
        _ if log.standing_still_s() >= STANDING_STILL_S => "stalled",
        _ => "timeout",
    }
}

/// Why the mission ended early: what the vehicle gave up for, or else what the guard did.
pub(crate) fn of_abort(gave_up: Option<(Hindrance, Timestamp)>, log: &FlightLog) -> String {
    if let Some((hindrance, _)) = gave_up {
        return hindrance.name().to_owned();
    }
    match grave_event(log).map(|event| &event.kind) {
        Some(EventKind::Guard(_, Some(cause))) => format!("guard_{}", word(*cause)),
        Some(EventKind::Guard(_, None)) => "guard".to_owned(),
        Some(EventKind::Refused(_)) => "refused".to_owned(),
        _ => "aborted".to_owned(),
    }
}

/// The first refusal or gravest act of the guard, whichever came first.
pub(crate) fn grave_event(log: &FlightLog) -> Option<&LogEvent> {
    let grave = |kind: &EventKind| match kind {
        EventKind::Guard(fallback, _) => *fallback == log.worst_fallback,
        EventKind::Refused(_) => true,
        EventKind::Mode(_) => false,
    };
    log.events.iter().find(|event| grave(&event.kind))
}

fn word(violation: Violation) -> &'static str {
    match violation {
        Violation::Geofence => "geofence",
        Violation::Speed => "speed",
        Violation::Tilt => "tilt",
        Violation::EstimateStale => "estimate_stale",
        Violation::EstimateInconsistent => "estimate_inconsistent",
        Violation::RangeLow => "range_low",
        Violation::CommandInvalid => "command_invalid",
        Violation::ImuLost => "imu_lost",
        Violation::FlowLost => "flow_lost",
        Violation::RangeLost => "range_lost",
        Violation::DepthLost => "depth_lost",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alula_geometry::Pose;
    use alula_messages::{Fallback, Finding, FlightMode, StackOutput};
    use alula_record::TruthRecord;
    use nalgebra::Vector3;

    fn contact(thing: ThingId) -> Collision {
        Collision::Contact {
            time: Timestamp::ZERO,
            thing,
            what: String::new(),
        }
    }

    fn at_rest() -> TruthRecord {
        TruthRecord {
            time: Timestamp::ZERO,
            world_from_body: Pose::identity(),
            velocity_world: Vector3::zeros(),
            clearance_m: None,
        }
    }

    /// A log of a flight that stays in one place on its way for so long.
    fn standing(duration_s: f64) -> FlightLog {
        let mut log = FlightLog::default();
        for i in 0..=(10.0 * duration_s) as u32 {
            let output = StackOutput {
                time: Timestamp::from_s(0.1 * f64::from(i)),
                mode: FlightMode::Flying,
                ..StackOutput::default()
            };
            log.push(&output, &at_rest());
        }
        log
    }

    #[test]
    fn collisions_are_told_apart_by_what_was_hit() {
        let encounters = Encounters::new(0.4, [].iter());
        let word = |collision: &Collision| of_collision(Some(collision), &encounters);
        assert_eq!(word(&contact(ThingId::Person(0))), "collision_person");
        assert_eq!(word(&contact(ThingId::Obstacle(3))), "collision_obstacle");
        let hard = Collision::HardLanding {
            time: Timestamp::ZERO,
            speed_m_s: 3.0,
        };
        assert_eq!(word(&hard), "collision_ground");
    }

    #[test]
    fn a_flight_out_of_time_is_explained_by_its_last_hindrance() {
        let log = standing(8.0);
        let now = Timestamp::from_s(8.0);
        let word = |at_s| {
            of_timeout(
                Some((Hindrance::NoRoute, Timestamp::from_s(at_s))),
                now,
                &log,
            )
        };
        assert_eq!(word(7.0), "no_route");
        assert_eq!(word(5.0), "stalled");
    }

    #[test]
    fn a_flight_out_of_time_that_still_moves_is_just_late() {
        assert_eq!(
            of_timeout(None, Timestamp::from_s(3.0), &standing(3.0)),
            "timeout"
        );
    }

    #[test]
    fn an_abort_names_the_cause_of_the_gravest_act_of_the_guard() {
        let mut log = FlightLog::default();
        let mut output = StackOutput::default();
        for (fallback, violation) in [
            (Fallback::Hold, Violation::Geofence),
            (Fallback::Land, Violation::FlowLost),
        ] {
            output.guard.fallback = fallback;
            output.guard.cause = Some(Finding {
                violation,
                found: 1.0,
                limit: 0.5,
            });
            log.push(&output, &at_rest());
        }
        assert_eq!(of_abort(None, &log), "guard_flow_lost");
    }

    #[test]
    fn an_abort_without_the_guard_is_told_from_a_refusal() {
        assert_eq!(of_abort(None, &FlightLog::default()), "aborted");
    }

    #[test]
    fn a_vehicle_that_gave_up_is_explained_by_what_it_gave_up_for() {
        let blocked = Hindrance::GoalBlocked { obstacle: 2 };
        let gave_up = Some((blocked, Timestamp::from_s(9.0)));
        assert_eq!(of_abort(gave_up, &FlightLog::default()), "goal_blocked");
    }
}
