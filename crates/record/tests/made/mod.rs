//! Flights made of numbers: every field has a value of its own, and so has every variant.

#![allow(dead_code)]

use std::sync::Arc;

use alula_geometry::{PinholeCamera, Pose, Timestamp, so3};
use alula_messages::*;
use alula_record::{Event, TruthRecord};
use nalgebra::{SMatrix, Translation3, Vector2, Vector3};

/// Numbers without pattern (SplitMix64), now and then a special one.
pub struct Numbers {
    state: u64,
    special: bool,
}

impl Numbers {
    pub fn plain(seed: u64) -> Self {
        Self {
            state: seed,
            special: false,
        }
    }

    pub fn with_special_values(seed: u64) -> Self {
        Self {
            state: seed,
            special: true,
        }
    }

    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, n: u64) -> u64 {
        self.bits() % n
    }

    pub fn number(&mut self) -> f64 {
        const SPECIAL: [f64; 7] = [
            f64::NAN,
            -f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            0.0,
            -0.0,
            f64::MIN_POSITIVE / 3.0,
        ];
        if self.special && self.below(8) == 0 {
            return SPECIAL[self.below(7) as usize];
        }
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64 * 4.0 - 2.0
    }

    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.number(), self.number(), self.number())
    }

    pub fn pose(&mut self) -> Pose {
        Pose::from_parts(Translation3::from(self.vector()), so3::exp(&self.vector()))
    }

    fn array(&mut self) -> [f64; 3] {
        self.vector().into()
    }

    fn pick<T: Clone>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u64) as usize].clone()
    }

    fn some<T>(&mut self, make: impl Fn(&mut Self) -> T) -> Vec<T> {
        (0..self.below(3)).map(|_| make(self)).collect()
    }

    fn time(&mut self) -> Timestamp {
        Timestamp::from_ns(self.bits() as i64 >> 2)
    }
}

fn range(n: &mut Numbers) -> RangeSample {
    RangeSample {
        time: n.time(),
        range_m: n.number(),
        min_m: n.number(),
        max_m: n.number(),
    }
}

pub fn depth(n: &mut Numbers, time: Timestamp) -> Arc<DepthImage> {
    let camera = PinholeCamera {
        width_px: 6,
        height_px: 4,
        fx_px: n.number(),
        fy_px: n.number(),
        cx_px: n.number(),
        cy_px: n.number(),
    };
    Arc::new(DepthImage {
        time,
        sensor: n.below(4) as u8,
        camera,
        body_from_camera: n.pose(),
        depth_mm: (0..24).map(|_| n.bits() as u16).collect(),
    })
}

/// A batch with all kinds of samples.
pub fn batch(n: &mut Numbers, now: Timestamp) -> SensorBatch {
    SensorBatch {
        now,
        imu: n.some(|n| ImuSample {
            time: n.time(),
            specific_force: n.vector(),
            angular_rate: n.vector(),
        }),
        flow: n.some(|n| FlowSample {
            time: n.time(),
            interval_s: n.number(),
            flow_rad_s: Vector2::new(n.number(), n.number()),
            quality: n.number(),
        }),
        sonar: n.some(range),
        infrared: n.some(range),
        poses: n.some(|n| PoseSample {
            time: n.time(),
            sensor: n.below(3) as u8,
            world_from_body: n.pose(),
        }),
        depth: n.some(|n| {
            let time = n.time();
            depth(n, time)
        }),
        autopilot: n.some(|n| AutopilotStatus {
            time: n.time(),
            armed: n.below(2) == 0,
            thrust_fraction: n.number(),
        }),
    }
}

fn state(n: &mut Numbers) -> NavState {
    let mut covariance = ErrorCovariance::from_fn(|_, _| n.number());
    if n.below(2) == 0 {
        covariance.fill_lower_triangle_with_upper_triangle();
    }
    let degraded = EstimateHealth::Degraded {
        since_velocity_s: n.number(),
        since_height_s: n.number(),
    };
    NavState {
        time: n.time(),
        world_from_body: n.pose(),
        velocity_world: n.vector(),
        angular_rate_body: n.vector(),
        acceleration_world: n.vector(),
        accelerometer_bias: n.vector(),
        gyroscope_bias: n.vector(),
        covariance,
        phase: n.pick(&[
            FlightPhase::Landed,
            FlightPhase::TakingOff,
            FlightPhase::Flying,
            FlightPhase::Landing,
        ]),
        health: n.pick(&[
            EstimateHealth::Initialising,
            EstimateHealth::Good,
            degraded,
            EstimateHealth::Failed,
        ]),
    }
}

fn fusion(n: &mut Numbers) -> Fusion {
    use Rejection::*;
    Fusion {
        time: n.time(),
        sensor: n.pick(&[
            Sensor::Imu,
            Sensor::Flow,
            Sensor::Sonar,
            Sensor::Infrared,
            Sensor::Position,
            Sensor::Orientation,
            Sensor::Ground,
        ]),
        innovation: n.array(),
        innovation_variance: n.array(),
        mahalanobis_squared: n.number(),
        gate: n.number(),
        rejection: n.pick(&[
            None,
            Some(Gate),
            Some(NotFinite),
            Some(Invalid),
            Some(TooOld),
            Some(OutOfOrder),
            Some(Phase),
            Some(Outlier),
        ]),
    }
}

fn mode(n: &mut Numbers) -> FlightMode {
    use FlightMode::*;
    n.pick(&[
        Disarmed, Armed, TakingOff, Hovering, Flying, Landing, Killed,
    ])
}

fn request(n: &mut Numbers) -> (Intent, Option<Refusal>) {
    let take_off = Intent::TakeOff {
        height_m: n.number(),
    };
    let fly = Intent::Fly {
        waypoints_world: n.some(Numbers::vector),
    };
    let intents = [
        Intent::Arm,
        Intent::Disarm,
        take_off,
        fly,
        Intent::Hold,
        Intent::Land,
        Intent::Kill,
    ];
    let wrong_mode = Refusal::WrongMode { mode: mode(n) };
    let out_of_limits = Refusal::OutOfLimits {
        found: n.number(),
        low: n.number(),
        high: n.number(),
    };
    let refusals = [
        None,
        Some(wrong_mode),
        Some(Refusal::EstimateNotReady),
        Some(out_of_limits),
        Some(Refusal::NoTrajectory),
        Some(Refusal::GuardActive),
    ];
    (n.pick(&intents), n.pick(&refusals))
}

fn reference(n: &mut Numbers) -> Reference {
    Reference {
        position_world: n.vector(),
        velocity_world: n.vector(),
        acceleration_world: n.vector(),
        jerk_world: n.vector(),
        snap_world: n.vector(),
        yaw_rad: n.number(),
        yaw_rate_rad_s: n.number(),
        yaw_acceleration_rad_s2: n.number(),
    }
}

fn finding(n: &mut Numbers) -> Finding {
    use Violation::*;
    Finding {
        violation: n.pick(&[
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
        ]),
        found: n.number(),
        limit: n.number(),
    }
}

fn guard(n: &mut Numbers) -> GuardReport {
    // Most steps say what the step before said.
    if n.below(2) == 0 {
        return GuardReport::default();
    }
    use Fallback::*;
    GuardReport {
        fallback: n.pick(&[None, Hold, Land, Descend, Cut]),
        cause: n.some(finding).pop(),
        findings: n.some(finding),
    }
}

fn command(n: &mut Numbers) -> Command {
    let attitude = Command::AttitudeThrust {
        roll_rad: n.number(),
        pitch_rad: n.number(),
        yaw_rate_rad_s: n.number(),
        thrust_n: n.number(),
    };
    let tilt = Command::TiltClimb {
        roll_rad: n.number(),
        pitch_rad: n.number(),
        yaw_rate_rad_s: n.number(),
        climb_rate_m_s: n.number(),
    };
    let torque = Command::ThrustTorque {
        thrust_n: n.number(),
        torque_body_nm: n.vector(),
    };
    n.pick(&[Command::Disarm, Command::Idle, attitude, tilt, torque])
}

fn covariance<const N: usize>(n: &mut Numbers) -> SMatrix<f64, N, N> {
    let mut covariance = SMatrix::<f64, N, N>::from_fn(|_, _| n.number());
    if n.below(2) == 0 {
        covariance.fill_lower_triangle_with_upper_triangle();
    }
    covariance
}

fn coin(n: &mut Numbers) -> bool {
    n.below(2) == 0
}

fn footprint(n: &mut Numbers) -> Footprint {
    n.pick(&[Footprint::Round, Footprint::Flat])
}

pub fn detection(n: &mut Numbers) -> Detection {
    Detection {
        sensor: n.below(4) as u8,
        centre_world: n.vector(),
        yaw_rad: n.number(),
        size_m: n.vector(),
        footprint: footprint(n),
        centre_covariance: covariance(n),
        size_variance_m2: n.vector(),
        cut: Cut {
            left: coin(n),
            right: coin(n),
            top: coin(n),
            bottom: coin(n),
        },
        window: PixelBox {
            left: n.bits() as u16,
            right: n.bits() as u16,
            top: n.bits() as u16,
            bottom: n.bits() as u16,
        },
        depth_m: [n.number(), n.number()],
        pixels: n.bits() as u32,
    }
}

pub fn obstacle(n: &mut Numbers) -> Obstacle {
    Obstacle {
        id: n.bits() as u32,
        time: n.time(),
        centre_world: n.vector(),
        velocity_world: n.vector(),
        covariance: covariance(n),
        yaw_rad: n.number(),
        size_m: n.vector(),
        size_variance_m2: n.vector(),
        footprint: footprint(n),
        motion: n.pick(&[
            ObstacleMotion::Undecided,
            ObstacleMotion::Static,
            ObstacleMotion::Moving,
        ]),
        sight: n.pick(&[Sight::Seen, Sight::Hidden, Sight::OutOfView, Sight::Missed]),
        last_seen: n.time(),
        images: n.bits() as u32,
    }
}

fn plan_point(n: &mut Numbers) -> PlanPoint {
    PlanPoint {
        position_world: n.vector(),
        velocity_world: n.vector(),
        acceleration_world: n.vector(),
        yaw_rad: n.number(),
        yaw_rate_rad_s: n.number(),
        position_covariance: covariance(n),
    }
}

pub fn plan(n: &mut Numbers) -> Plan {
    // Gaps among the obstacles, and a rest without.
    let known = n.below(PLAN_OBSTACLES as u64 + 1) as usize;
    let mut obstacles = [NO_OBSTACLE; PLAN_OBSTACLES];
    for id in &mut obstacles[..known] {
        *id = n.pick(&[7, 0, NO_OBSTACLE]);
    }
    Plan {
        time: n.time(),
        interval_s: n.number(),
        points: std::array::from_fn(|_| plan_point(n)),
        target_world: n.vector(),
        exit: n.pick(&[
            PlanExit::Converged,
            PlanExit::IterationLimit,
            PlanExit::NoProgress,
            PlanExit::Failed,
        ]),
        iterations: n.bits() as u32,
        cost: n.number(),
        max_violation_m: n.number(),
        obstacles,
    }
}

fn hindrance(n: &mut Numbers) -> Hindrance {
    let hindrances = [
        Hindrance::DepthStale { age_s: n.number() },
        Hindrance::EstimateJumped { jump_m: n.number() },
        Hindrance::PlannerFailed,
        Hindrance::GoalBlocked {
            obstacle: n.bits() as u32,
        },
        Hindrance::NoRoute,
        Hindrance::Stalled {
            since_s: n.number(),
        },
    ];
    n.pick(&hindrances)
}

/// An output with all kinds of parts.
pub fn output(n: &mut Numbers, time: Timestamp) -> StackOutput {
    let requested = command(n);
    StackOutput {
        time,
        state: state(n),
        fusions: n.some(fusion),
        mode: mode(n),
        requests: n.some(request),
        seen_at: n.some(Numbers::time).pop(),
        detections: n.some(detection),
        obstacles: n.some(obstacle),
        plan: n.some(plan).pop(),
        hindrance: n.some(hindrance).pop(),
        reference: n.some(reference).pop(),
        requested,
        guard: guard(n),
        command: if n.below(2) == 0 {
            requested
        } else {
            command(n)
        },
    }
}

pub fn truth(n: &mut Numbers, time: Timestamp) -> TruthRecord {
    TruthRecord {
        time,
        world_from_body: n.pose(),
        velocity_world: n.vector(),
        clearance_m: n.some(Numbers::number).pop(),
    }
}

/// `steps` steps at 100 Hz from time 0: a batch, an output and a truth each.
pub fn events(n: &mut Numbers, steps: i64) -> Vec<Event> {
    (0..steps)
        .flat_map(|i| {
            let now = Timestamp::from_ns(i * 10_000_000);
            [
                Event::Batch(batch(n, now)),
                Event::Output(Box::new(output(n, now))),
                Event::Truth(truth(n, now)),
            ]
        })
        .collect()
}

/// A step of a smooth flight along a lying figure eight, as a stack at 200 Hz would report it:
/// one inertial sample a step, flow at 50 Hz, ranges at 20 Hz.
pub struct SmoothFlight {
    step: i64,
    state: NavState,
}

impl SmoothFlight {
    pub const RATE_HZ: i64 = 200;

    pub fn new() -> Self {
        Self {
            step: 0,
            state: NavState::default(),
        }
    }

    pub fn next(
        &mut self,
        batch: &mut SensorBatch,
        output: &mut StackOutput,
        truth: &mut Option<TruthRecord>,
    ) {
        let now = Timestamp::from_ns(self.step * 1_000_000_000 / Self::RATE_HZ);
        let t = now.as_s();
        let position = Vector3::new(3.0 * (0.4 * t).sin(), 1.5 * (0.8 * t).sin(), 1.5);
        let velocity = Vector3::new(1.2 * (0.4 * t).cos(), 1.2 * (0.8 * t).cos(), 0.0);
        let mut noise = Numbers::plain(self.step as u64);
        let pose = Pose::from_parts(
            Translation3::from(position),
            so3::exp(&(0.1 * Vector3::new((0.8 * t).sin(), (0.4 * t).sin(), t.sin()))),
        );
        batch.clear();
        batch.now = now;
        batch.imu.push(ImuSample {
            time: now,
            specific_force: Vector3::new(0.0, 0.0, 9.8) + 0.05 * noise.vector(),
            angular_rate: 0.01 * noise.vector(),
        });
        output.time = now;
        output.fusions.clear();
        if self.step % 4 == 0 {
            batch.flow.push(FlowSample {
                time: now,
                interval_s: 0.02,
                flow_rad_s: Vector2::new(noise.number(), noise.number()),
                quality: 0.8,
            });
            output.fusions.push(Fusion {
                rejection: None,
                ..fusion(&mut noise)
            });
        }
        if self.step % 10 == 0 {
            batch.infrared.push(range(&mut noise));
            output.fusions.push(fusion(&mut noise));
        }
        self.state.time = now;
        self.state.world_from_body = pose;
        self.state.velocity_world = velocity + 0.01 * noise.vector();
        self.state.angular_rate_body = 0.01 * noise.vector();
        self.state.acceleration_world = 0.05 * noise.vector();
        self.state.accelerometer_bias = 1e-3 * noise.vector();
        self.state.gyroscope_bias = 1e-4 * noise.vector();
        self.state.health = EstimateHealth::Good;
        let mut root = ErrorCovariance::from_fn(|_, _| 1e-2 * noise.number());
        root.fill_lower_triangle_with_upper_triangle();
        self.state.covariance = root;
        output.state.clone_from(&self.state);
        output.mode = FlightMode::Flying;
        output.reference = Some(Reference {
            position_world: position,
            velocity_world: velocity,
            acceleration_world: -0.16 * position,
            jerk_world: -0.16 * velocity,
            snap_world: 0.0256 * position,
            ..Reference::default()
        });
        output.requested = Command::AttitudeThrust {
            roll_rad: 0.1 * noise.number(),
            pitch_rad: 0.1 * noise.number(),
            yaw_rate_rad_s: 0.0,
            thrust_n: 4.9 + 0.1 * noise.number(),
        };
        output.command = output.requested;
        *truth = (self.step % 2 == 0).then_some(TruthRecord {
            time: now,
            world_from_body: pose,
            velocity_world: velocity,
            clearance_m: Some(1.0 + 0.1 * noise.number()),
        });
        self.step += 1;
    }
}
