//! Decisions of the stack to their schemas and back, every bit kept.

use alula_messages::{
    Command, Fallback, Finding, FlightMode, FlightPhase, GuardReport, Intent, Reference, Refusal,
    Rejection, Sensor, Violation,
};

use crate::convert::{Mismatch, Recorded, vector_from, vector_to};
use crate::schema;

/// Maps an enumeration to its schema and back, name by name.
macro_rules! same_names {
    ($ours:ty, $theirs:ty { $($name:ident),* $(,)? }) => {
        impl Recorded for $ours {
            type Message = i32;

            fn to_message(&self) -> i32 {
                match self { $(Self::$name => <$theirs>::$name as i32,)* }
            }

            fn from_message(message: &i32) -> Result<Self, Mismatch> {
                Ok(match <$theirs>::try_from(*message)? {
                    $(<$theirs>::$name => Self::$name,)*
                })
            }
        }
    };
}
pub(crate) use same_names;

same_names!(
    FlightPhase,
    schema::nav_state::Phase {
        Landed,
        TakingOff,
        Flying,
        Landing
    }
);
same_names!(
    FlightMode,
    schema::flight_mode::Kind {
        Disarmed,
        Armed,
        TakingOff,
        Hovering,
        Flying,
        Landing,
        Killed,
    }
);
same_names!(
    Sensor,
    schema::fusion::Sensor {
        Imu,
        Flow,
        Sonar,
        Infrared,
        Position,
        Orientation,
        Ground,
    }
);
same_names!(
    Rejection,
    schema::fusion::Rejection {
        Gate,
        NotFinite,
        Invalid,
        TooOld,
        OutOfOrder,
        Phase,
        Outlier,
    }
);
same_names!(
    Violation,
    schema::finding::Violation {
        Geofence,
        Speed,
        Tilt,
        EstimateStale,
        EstimateInconsistent,
        RangeLow,
        CommandInvalid,
        ImuLost,
        FlowLost,
        RangeLost,
        DepthLost,
    }
);
same_names!(
    Fallback,
    schema::guard_report::Fallback {
        None,
        Hold,
        Land,
        Descend,
        Cut
    }
);

impl Recorded for (Intent, Option<Refusal>) {
    type Message = schema::Request;

    fn to_message(&self) -> schema::Request {
        schema::Request {
            intent: self.0.to_message(),
            refusal: self.1.map(|refusal| refusal.to_message()),
        }
    }

    fn from_message(message: &schema::Request) -> Result<Self, Mismatch> {
        let refusal = message.refusal.as_ref();
        Ok((
            Intent::from_message(&message.intent)?,
            refusal.map(Refusal::from_message).transpose()?,
        ))
    }
}

impl Recorded for Intent {
    type Message = schema::Intent;

    fn to_message(&self) -> schema::Intent {
        use schema::intent::Kind;
        let (kind, height_m, waypoints) = match self {
            Self::Arm => (Kind::Arm, None, &[][..]),
            Self::Disarm => (Kind::Disarm, None, &[][..]),
            Self::TakeOff { height_m } => (Kind::TakeOff, Some(*height_m), &[][..]),
            Self::Fly { waypoints_world } => (Kind::Fly, None, waypoints_world.as_slice()),
            Self::Hold => (Kind::Hold, None, &[][..]),
            Self::Land => (Kind::Land, None, &[][..]),
            Self::Kill => (Kind::Kill, None, &[][..]),
        };
        schema::Intent {
            kind: kind as i32,
            height_m,
            waypoints_world_m: waypoints.iter().map(vector_to).collect(),
        }
    }

    fn from_message(message: &schema::Intent) -> Result<Self, Mismatch> {
        use schema::intent::Kind;
        Ok(match Kind::try_from(message.kind)? {
            Kind::Arm => Self::Arm,
            Kind::Disarm => Self::Disarm,
            Kind::TakeOff => Self::TakeOff {
                height_m: present(message.height_m, "height_m")?,
            },
            Kind::Fly => Self::Fly {
                waypoints_world: message.waypoints_world_m.iter().map(vector_from).collect(),
            },
            Kind::Hold => Self::Hold,
            Kind::Land => Self::Land,
            Kind::Kill => Self::Kill,
        })
    }
}

impl Recorded for Refusal {
    type Message = schema::Refusal;

    fn to_message(&self) -> schema::Refusal {
        use schema::refusal::Kind;
        let of = |kind: Kind| schema::Refusal {
            kind: kind as i32,
            ..schema::Refusal::default()
        };
        match *self {
            Self::WrongMode { mode } => schema::Refusal {
                mode: Some(mode.to_message()),
                ..of(Kind::WrongMode)
            },
            Self::EstimateNotReady => of(Kind::EstimateNotReady),
            Self::OutOfLimits { found, low, high } => schema::Refusal {
                found: Some(found),
                low: Some(low),
                high: Some(high),
                ..of(Kind::OutOfLimits)
            },
            Self::NoTrajectory => of(Kind::NoTrajectory),
            Self::GuardActive => of(Kind::GuardActive),
        }
    }

    fn from_message(message: &schema::Refusal) -> Result<Self, Mismatch> {
        use schema::refusal::Kind;
        Ok(match Kind::try_from(message.kind)? {
            Kind::WrongMode => Self::WrongMode {
                mode: FlightMode::from_message(&present(message.mode, "mode")?)?,
            },
            Kind::EstimateNotReady => Self::EstimateNotReady,
            Kind::OutOfLimits => Self::OutOfLimits {
                found: present(message.found, "found")?,
                low: present(message.low, "low")?,
                high: present(message.high, "high")?,
            },
            Kind::NoTrajectory => Self::NoTrajectory,
            Kind::GuardActive => Self::GuardActive,
        })
    }
}

pub(crate) fn present<T>(value: Option<T>, name: &'static str) -> Result<T, Mismatch> {
    value.ok_or(Mismatch::Absent(name))
}

/// The message of a reference that held at a step.
pub(crate) fn reference_to(step_ns: i64, reference: &Reference) -> schema::Reference {
    schema::Reference {
        time_ns: step_ns,
        position_world_m: vector_to(&reference.position_world),
        velocity_world_m_s: vector_to(&reference.velocity_world),
        acceleration_world_m_s2: vector_to(&reference.acceleration_world),
        jerk_world_m_s3: vector_to(&reference.jerk_world),
        snap_world_m_s4: vector_to(&reference.snap_world),
        yaw_rad: reference.yaw_rad,
        yaw_rate_rad_s: reference.yaw_rate_rad_s,
        yaw_acceleration_rad_s2: reference.yaw_acceleration_rad_s2,
    }
}

pub(crate) fn reference_from(message: &schema::Reference) -> Reference {
    Reference {
        position_world: vector_from(&message.position_world_m),
        velocity_world: vector_from(&message.velocity_world_m_s),
        acceleration_world: vector_from(&message.acceleration_world_m_s2),
        jerk_world: vector_from(&message.jerk_world_m_s3),
        snap_world: vector_from(&message.snap_world_m_s4),
        yaw_rad: message.yaw_rad,
        yaw_rate_rad_s: message.yaw_rate_rad_s,
        yaw_acceleration_rad_s2: message.yaw_acceleration_rad_s2,
    }
}

impl Recorded for Finding {
    type Message = schema::Finding;

    fn to_message(&self) -> schema::Finding {
        schema::Finding {
            violation: self.violation.to_message(),
            found: self.found,
            limit: self.limit,
        }
    }

    fn from_message(message: &schema::Finding) -> Result<Self, Mismatch> {
        Ok(Self {
            violation: Violation::from_message(&message.violation)?,
            found: message.found,
            limit: message.limit,
        })
    }
}

impl Recorded for GuardReport {
    type Message = schema::GuardReport;

    /// The time is left at zero, so that two reports that say the same are the same.
    fn to_message(&self) -> schema::GuardReport {
        schema::GuardReport {
            time_ns: 0,
            fallback: self.fallback.to_message(),
            cause: self.cause.map(|finding| finding.to_message()),
            findings: self.findings.iter().map(Recorded::to_message).collect(),
        }
    }

    fn from_message(message: &schema::GuardReport) -> Result<Self, Mismatch> {
        let cause = message.cause.as_ref();
        let findings = message.findings.iter().map(Finding::from_message);
        Ok(Self {
            fallback: Fallback::from_message(&message.fallback)?,
            cause: cause.map(Finding::from_message).transpose()?,
            findings: findings.collect::<Result<_, _>>()?,
        })
    }
}

impl Recorded for Command {
    type Message = schema::Command;

    fn to_message(&self) -> schema::Command {
        use schema::command::Kind;
        let of = |kind: Kind| schema::Command {
            kind: kind as i32,
            ..schema::Command::default()
        };
        match *self {
            Self::Disarm => of(Kind::Disarm),
            Self::Idle => of(Kind::Idle),
            Self::AttitudeThrust {
                roll_rad,
                pitch_rad,
                yaw_rate_rad_s,
                thrust_n,
            } => schema::Command {
                roll_rad: Some(roll_rad),
                pitch_rad: Some(pitch_rad),
                yaw_rate_rad_s: Some(yaw_rate_rad_s),
                thrust_n: Some(thrust_n),
                ..of(Kind::AttitudeThrust)
            },
            Self::TiltClimb {
                roll_rad,
                pitch_rad,
                yaw_rate_rad_s,
                climb_rate_m_s,
            } => schema::Command {
                roll_rad: Some(roll_rad),
                pitch_rad: Some(pitch_rad),
                yaw_rate_rad_s: Some(yaw_rate_rad_s),
                climb_rate_m_s: Some(climb_rate_m_s),
                ..of(Kind::TiltClimb)
            },
            Self::ThrustTorque {
                thrust_n,
                torque_body_nm,
            } => schema::Command {
                thrust_n: Some(thrust_n),
                torque_body_nm: Some(vector_to(&torque_body_nm)),
                ..of(Kind::ThrustTorque)
            },
        }
    }

    fn from_message(message: &schema::Command) -> Result<Self, Mismatch> {
        use schema::command::Kind;
        let roll = || present(message.roll_rad, "roll_rad");
        let pitch = || present(message.pitch_rad, "pitch_rad");
        let yaw_rate = || present(message.yaw_rate_rad_s, "yaw_rate_rad_s");
        let thrust = || present(message.thrust_n, "thrust_n");
        Ok(match Kind::try_from(message.kind)? {
            Kind::Disarm => Self::Disarm,
            Kind::Idle => Self::Idle,
            Kind::AttitudeThrust => Self::AttitudeThrust {
                roll_rad: roll()?,
                pitch_rad: pitch()?,
                yaw_rate_rad_s: yaw_rate()?,
                thrust_n: thrust()?,
            },
            Kind::TiltClimb => Self::TiltClimb {
                roll_rad: roll()?,
                pitch_rad: pitch()?,
                yaw_rate_rad_s: yaw_rate()?,
                climb_rate_m_s: present(message.climb_rate_m_s, "climb_rate_m_s")?,
            },
            Kind::ThrustTorque => Self::ThrustTorque {
                thrust_n: thrust()?,
                torque_body_nm: vector_from(&present(message.torque_body_nm, "torque_body_nm")?),
            },
        })
    }
}
