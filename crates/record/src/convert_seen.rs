//! What the vehicle sees and intends to their schemas and back, every bit kept.

use alula_messages::{
    Cut, Detection, Footprint, Hindrance, NO_OBSTACLE, Obstacle, ObstacleMotion, PLAN_OBSTACLES,
    PLAN_POINTS, PixelBox, Plan, PlanExit, PlanPoint, Sight,
};

use crate::convert::{Mismatch, Recorded, depth_sensor, time, vector_from, vector_to};
use crate::convert_output::{present, same_names};
use crate::covariance::{covariance_from, covariance_to};
use crate::schema;

same_names!(Footprint, schema::detection::Footprint { Round, Flat });
same_names!(
    ObstacleMotion,
    schema::obstacle::Motion {
        Undecided,
        Static,
        Moving
    }
);
same_names!(
    Sight,
    schema::obstacle::Sight {
        Seen,
        Hidden,
        OutOfView,
        Missed
    }
);
same_names!(
    PlanExit,
    schema::plan::Exit {
        Converged,
        IterationLimit,
        NoProgress,
        Failed
    }
);

impl Recorded for Cut {
    type Message = schema::detection::Cut;

    fn to_message(&self) -> schema::detection::Cut {
        schema::detection::Cut {
            left: self.left,
            right: self.right,
            top: self.top,
            bottom: self.bottom,
        }
    }

    fn from_message(message: &schema::detection::Cut) -> Result<Self, Mismatch> {
        Ok(Self {
            left: message.left,
            right: message.right,
            top: message.top,
            bottom: message.bottom,
        })
    }
}

impl Recorded for PixelBox {
    type Message = schema::detection::Window;

    fn to_message(&self) -> schema::detection::Window {
        schema::detection::Window {
            left_px: self.left.into(),
            right_px: self.right.into(),
            top_px: self.top.into(),
            bottom_px: self.bottom.into(),
        }
    }

    fn from_message(message: &schema::detection::Window) -> Result<Self, Mismatch> {
        let pixel = |value, name| u16::try_from(value).map_err(|_| Mismatch::TooLarge(name));
        Ok(Self {
            left: pixel(message.left_px, "left_px")?,
            right: pixel(message.right_px, "right_px")?,
            top: pixel(message.top_px, "top_px")?,
            bottom: pixel(message.bottom_px, "bottom_px")?,
        })
    }
}

impl Recorded for Detection {
    type Message = schema::Detection;

    fn to_message(&self) -> schema::Detection {
        schema::Detection {
            centre_world_m: vector_to(&self.centre_world),
            yaw_rad: self.yaw_rad,
            size_m: vector_to(&self.size_m),
            footprint: self.footprint.to_message(),
            centre_covariance_m2: covariance_to(&self.centre_covariance),
            size_variance_m2: vector_to(&self.size_variance_m2),
            cut: self.cut.to_message(),
            window: self.window.to_message(),
            nearest_m: self.depth_m[0],
            farthest_m: self.depth_m[1],
            pixels: self.pixels,
            sensor: Some(self.sensor.into()),
        }
    }

    fn from_message(message: &schema::Detection) -> Result<Self, Mismatch> {
        Ok(Self {
            sensor: depth_sensor(message.sensor())?,
            centre_world: vector_from(&message.centre_world_m),
            yaw_rad: message.yaw_rad,
            size_m: vector_from(&message.size_m),
            footprint: Footprint::from_message(&message.footprint)?,
            centre_covariance: covariance_from(&message.centre_covariance_m2)?,
            size_variance_m2: vector_from(&message.size_variance_m2),
            cut: Cut::from_message(&message.cut)?,
            window: PixelBox::from_message(&message.window)?,
            depth_m: [message.nearest_m, message.farthest_m],
            pixels: message.pixels,
        })
    }
}

impl Recorded for Obstacle {
    type Message = schema::Obstacle;

    fn to_message(&self) -> schema::Obstacle {
        schema::Obstacle {
            id: self.id,
            time_ns: self.time.as_ns(),
            centre_world_m: vector_to(&self.centre_world),
            velocity_world_m_s: vector_to(&self.velocity_world),
            covariance: covariance_to(&self.covariance),
            yaw_rad: self.yaw_rad,
            size_m: vector_to(&self.size_m),
            size_variance_m2: vector_to(&self.size_variance_m2),
            footprint: self.footprint.to_message(),
            motion: self.motion.to_message(),
            sight: self.sight.to_message(),
            last_seen_ns: self.last_seen.as_ns(),
            images: self.images,
        }
    }

    fn from_message(message: &schema::Obstacle) -> Result<Self, Mismatch> {
        Ok(Self {
            id: message.id,
            time: time(message.time_ns),
            centre_world: vector_from(&message.centre_world_m),
            velocity_world: vector_from(&message.velocity_world_m_s),
            covariance: covariance_from(&message.covariance)?,
            yaw_rad: message.yaw_rad,
            size_m: vector_from(&message.size_m),
            size_variance_m2: vector_from(&message.size_variance_m2),
            footprint: Footprint::from_message(&message.footprint)?,
            motion: ObstacleMotion::from_message(&message.motion)?,
            sight: Sight::from_message(&message.sight)?,
            last_seen: time(message.last_seen_ns),
            images: message.images,
        })
    }
}

impl Recorded for PlanPoint {
    type Message = schema::PlanPoint;

    fn to_message(&self) -> schema::PlanPoint {
        schema::PlanPoint {
            position_world_m: vector_to(&self.position_world),
            velocity_world_m_s: vector_to(&self.velocity_world),
            acceleration_world_m_s2: vector_to(&self.acceleration_world),
            yaw_rad: self.yaw_rad,
            yaw_rate_rad_s: self.yaw_rate_rad_s,
            position_covariance_m2: covariance_to(&self.position_covariance),
        }
    }

    fn from_message(message: &schema::PlanPoint) -> Result<Self, Mismatch> {
        Ok(Self {
            position_world: vector_from(&message.position_world_m),
            velocity_world: vector_from(&message.velocity_world_m_s),
            acceleration_world: vector_from(&message.acceleration_world_m_s2),
            yaw_rad: message.yaw_rad,
            yaw_rate_rad_s: message.yaw_rate_rad_s,
            position_covariance: covariance_from(&message.position_covariance_m2)?,
        })
    }
}

/// The message of a plan that was made at a step.
pub(crate) fn plan_to(step_ns: i64, plan: &Plan) -> schema::Plan {
    schema::Plan {
        time_ns: step_ns,
        start_ns: plan.time.as_ns(),
        interval_s: plan.interval_s,
        points: plan.points.iter().map(Recorded::to_message).collect(),
        target_world_m: vector_to(&plan.target_world),
        exit: plan.exit.to_message(),
        iterations: plan.iterations,
        cost: plan.cost,
        max_violation_m: plan.max_violation_m,
        obstacles: plan.obstacles[..used(&plan.obstacles)].to_vec(),
    }
}

/// Obstacles up to the last one that is there.
fn used(obstacles: &[u32]) -> usize {
    let last = obstacles.iter().rposition(|id| *id != NO_OBSTACLE);
    last.map_or(0, |last| last + 1)
}

pub(crate) fn plan_from(message: &schema::Plan) -> Result<Plan, Mismatch> {
    if message.points.len() != PLAN_POINTS {
        return Err(Mismatch::PlanPoints(message.points.len()));
    }
    if message.obstacles.len() > PLAN_OBSTACLES {
        return Err(Mismatch::TooLarge("obstacles"));
    }
    let mut plan = Plan {
        time: time(message.start_ns),
        interval_s: message.interval_s,
        target_world: vector_from(&message.target_world_m),
        exit: PlanExit::from_message(&message.exit)?,
        iterations: message.iterations,
        cost: message.cost,
        max_violation_m: message.max_violation_m,
        ..Plan::default()
    };
    for (point, recorded) in plan.points.iter_mut().zip(&message.points) {
        *point = PlanPoint::from_message(recorded)?;
    }
    for (id, recorded) in plan.obstacles.iter_mut().zip(&message.obstacles) {
        *id = *recorded;
    }
    Ok(plan)
}

/// The message of a hindrance that held at a step.
pub(crate) fn hindrance_to(step_ns: i64, hindrance: Hindrance) -> schema::Hindrance {
    use schema::hindrance::Kind;
    let of = |kind: Kind| schema::Hindrance {
        time_ns: step_ns,
        kind: kind as i32,
        ..schema::Hindrance::default()
    };
    match hindrance {
        Hindrance::DepthStale { age_s } => schema::Hindrance {
            age_s: Some(age_s),
            ..of(Kind::DepthStale)
        },
        Hindrance::EstimateJumped { jump_m } => schema::Hindrance {
            jump_m: Some(jump_m),
            ..of(Kind::EstimateJumped)
        },
        Hindrance::PlannerFailed => of(Kind::PlannerFailed),
        Hindrance::GoalBlocked { obstacle } => schema::Hindrance {
            obstacle: Some(obstacle),
            ..of(Kind::GoalBlocked)
        },
        Hindrance::NoRoute => of(Kind::NoRoute),
        Hindrance::Stalled { since_s } => schema::Hindrance {
            since_s: Some(since_s),
            ..of(Kind::Stalled)
        },
    }
}

pub(crate) fn hindrance_from(message: &schema::Hindrance) -> Result<Hindrance, Mismatch> {
    use schema::hindrance::Kind;
    Ok(match Kind::try_from(message.kind)? {
        Kind::DepthStale => Hindrance::DepthStale {
            age_s: present(message.age_s, "age_s")?,
        },
        Kind::EstimateJumped => Hindrance::EstimateJumped {
            jump_m: present(message.jump_m, "jump_m")?,
        },
        Kind::PlannerFailed => Hindrance::PlannerFailed,
        Kind::GoalBlocked => Hindrance::GoalBlocked {
            obstacle: present(message.obstacle, "obstacle")?,
        },
        Kind::NoRoute => Hindrance::NoRoute,
        Kind::Stalled => Hindrance::Stalled {
            since_s: present(message.since_s, "since_s")?,
        },
    })
}
