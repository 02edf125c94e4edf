//! What a flight looked like: series for plots, events for people, figures for scripts. It is built
//! step by step, from a flight under way or from a recording of one.

use alula_geometry::{Timestamp, so3};
use alula_messages::{EstimateHealth, Fallback, FlightMode, StackOutput, Violation, error_index};
use alula_record::TruthRecord;
use nalgebra::{Vector3, Vector4};
use serde::Serialize;

/// Rate of the samples kept for plots, Hz.
const SAMPLE_RATE_HZ: f64 = 50.0;

/// A vehicle that stays within this distance of a place makes no progress, m.
const STALL_RADIUS_M: f64 = 0.5;

/// One instant of a flight, for plots.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Time since the start, s.
    pub t_s: f64,
    /// True position, world, m.
    pub true_position: Vector3<f64>,
    /// True velocity, world, m/s.
    pub true_velocity: Vector3<f64>,
    /// Estimated position, world, m.
    pub position: Vector3<f64>,
    /// Estimated velocity, world, m/s.
    pub velocity: Vector3<f64>,
    /// Standard deviation of the position estimate, m.
    pub position_sigma: Vector3<f64>,
    /// Standard deviation of the velocity estimate, m/s.
    pub velocity_sigma: Vector3<f64>,
    /// Rotation vector from the estimated to the true attitude, body frame, rad.
    pub attitude_error: Vector3<f64>,
    /// Standard deviation of the attitude estimate, body frame, rad.
    pub attitude_sigma: Vector3<f64>,
    /// Where the vehicle should have been, world, m.
    pub reference: Option<Vector3<f64>>,
    /// True distance from the vehicle's surface to the nearest thing, m.
    pub clearance_m: Option<f64>,
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq)]
pub struct LogEvent {
    /// Time since the start, s.
    pub t_s: f64,
    /// What happened.
    pub kind: EventKind,
}

/// Kinds of events.
#[derive(Clone, Debug, PartialEq)]
pub enum EventKind {
    /// The mode of flight changed.
    Mode(FlightMode),
    /// The guard changed what it does, and why.
    Guard(Fallback, Option<Violation>),
    /// A request was refused.
    Refused(String),
}

impl LogEvent {
    /// A short phrase for people.
    pub fn describe(&self) -> String {
        match &self.kind {
            EventKind::Mode(mode) => describe_mode(*mode).to_owned(),
            EventKind::Guard(Fallback::None, _) => "guard releases".to_owned(),
            EventKind::Guard(fallback, cause) => {
                let why = cause.map_or("", Violation::describe);
                format!("guard: {} ({why})", describe_fallback(*fallback))
            }
            EventKind::Refused(what) => format!("refused: {what}"),
        }
    }
}

fn describe_mode(mode: FlightMode) -> &'static str {
    match mode {
        FlightMode::Disarmed => "disarmed",
        FlightMode::Armed => "armed",
        FlightMode::TakingOff => "take-off",
        FlightMode::Hovering => "hover",
        FlightMode::Flying => "fly",
        FlightMode::Landing => "landing",
        FlightMode::Killed => "killed",
    }
}

fn describe_fallback(fallback: Fallback) -> &'static str {
    match fallback {
        Fallback::None => "none",
        Fallback::Hold => "hold",
        Fallback::Land => "land",
        Fallback::Descend => "descend",
        Fallback::Cut => "cut",
    }
}

/// Differences between estimate and truth, root mean square over all steps of a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct EstimationErrors {
    /// Position, m.
    pub position_rmse_m: f64,
    /// Velocity, m/s.
    pub velocity_rmse_m_s: f64,
    /// Roll and pitch, degrees.
    pub tilt_rmse_deg: f64,
    /// Heading, degrees.
    pub yaw_rmse_deg: f64,
}

/// The story of a flight.
#[derive(Clone, Debug, Default)]
pub struct FlightLog {
    /// Instants for plots, oldest first.
    pub samples: Vec<Sample>,
    /// What happened, oldest first.
    pub events: Vec<LogEvent>,
    /// True path length while airborne, m.
    pub path_length_m: f64,
    /// Greatest true speed, m/s.
    pub max_speed_m_s: f64,
    /// Least true distance to the nearest thing while airborne, m.
    pub min_clearance_m: Option<f64>,
    /// Longest time of the way through the waypoints within half a metre of one place, s.
    pub stalled_s: f64,
    /// The gravest thing that the guard did.
    pub worst_fallback: Fallback,
    /// Measurements that met the filter, and how many of them were rejected.
    pub fusions: (u64, u64),
    start: Option<Timestamp>,
    next_sample_s: f64,
    mode: FlightMode,
    fallback: Fallback,
    last_position: Option<Vector3<f64>>,
    first_position: Option<Vector3<f64>>,
    /// Where it was when it last made progress, world, m, and when, s; on the way only.
    last_progress: Option<(Vector3<f64>, f64)>,
    /// Sums of squares: position, velocity, tilt, yaw.
    squares: Vector4<f64>,
    counted: u64,
    /// Sum of squared distances between truth and reference, and their number.
    tracking: (f64, u64),
}

impl FlightLog {
    /// Takes one step of a flight in. Steps come in order.
    pub fn push(&mut self, output: &StackOutput, truth: &TruthRecord) {
        let start = *self.start.get_or_insert(output.time);
        let t_s = output.time.seconds_since(start);
        self.note_events(t_s, output);
        self.note_motion(truth);
        self.note_progress(t_s, truth);
        self.note_errors(output, truth);
        if t_s >= self.next_sample_s {
            self.next_sample_s = t_s + 1.0 / SAMPLE_RATE_HZ - 1e-6;
            self.samples.push(sample(t_s, output, truth));
        }
    }

    /// Whether the mode of flight is one of those in the air.
    pub fn airborne(&self) -> bool {
        !matches!(self.mode, FlightMode::Disarmed | FlightMode::Armed)
    }

    /// How long it has now stayed in one place on the way through the waypoints, s.
    pub fn standing_still_s(&self) -> f64 {
        let now_s = self.duration_s();
        self.last_progress
            .map_or(0.0, |(_, since_s)| now_s - since_s)
    }

    /// Time since the first step, s.
    pub fn duration_s(&self) -> f64 {
        self.samples.last().map_or(0.0, |s| s.t_s)
    }

    /// Errors of the estimate over the whole flight.
    pub fn estimation_errors(&self) -> EstimationErrors {
        let rms = (self.squares / self.counted.max(1) as f64).map(f64::sqrt);
        EstimationErrors {
            position_rmse_m: rms[0],
            velocity_rmse_m_s: rms[1],
            tilt_rmse_deg: rms[2].to_degrees(),
            yaw_rmse_deg: rms[3].to_degrees(),
        }
    }

    /// Root mean square distance between the true position and the reference, m.
    pub fn tracking_rmse_m(&self) -> f64 {
        (self.tracking.0 / self.tracking.1.max(1) as f64).sqrt()
    }

    /// Horizontal true distance between the first and the last position, m.
    pub fn distance_from_start_m(&self) -> f64 {
        match (self.first_position, self.last_position) {
            (Some(first), Some(last)) => (last - first).xy().norm(),
            _ => 0.0,
        }
    }

    fn note_events(&mut self, t_s: f64, output: &StackOutput) {
        if output.mode != self.mode {
            self.mode = output.mode;
            self.events.push(LogEvent {
                t_s,
                kind: EventKind::Mode(output.mode),
            });
        }
        if output.guard.fallback != self.fallback {
            self.fallback = output.guard.fallback;
            self.worst_fallback = self.worst_fallback.max(self.fallback);
            let cause = output.guard.cause.map(|finding| finding.violation);
            self.events.push(LogEvent {
                t_s,
                kind: EventKind::Guard(self.fallback, cause),
            });
        }
        for (intent, refusal) in &output.requests {
            if let Some(refusal) = refusal {
                let kind = EventKind::Refused(format!("{intent:?} because {refusal:?}"));
                self.events.push(LogEvent { t_s, kind });
            }
        }
        self.fusions.0 += output.fusions.len() as u64;
        self.fusions.1 += output.fusions.iter().filter(|f| !f.accepted()).count() as u64;
    }

    fn note_motion(&mut self, truth: &TruthRecord) {
        let position = truth.world_from_body.translation.vector;
        self.first_position.get_or_insert(position);
        if self.airborne() {
            let last = self.last_position.unwrap_or(position);
            self.path_length_m += (position - last).norm();
            let clearance = [self.min_clearance_m, truth.clearance_m];
            self.min_clearance_m = clearance.into_iter().flatten().reduce(f64::min);
        }
        self.last_position = Some(position);
        self.max_speed_m_s = self.max_speed_m_s.max(truth.velocity_world.norm());
    }

    /// Measures how long it stays in one place while it should be on the way.
    fn note_progress(&mut self, t_s: f64, truth: &TruthRecord) {
        if self.mode != FlightMode::Flying {
            self.last_progress = None;
            return;
        }
        let position = truth.world_from_body.translation.vector;
        let (place, since_s) = *self.last_progress.get_or_insert((position, t_s));
        if (position - place).norm() > STALL_RADIUS_M {
            self.last_progress = Some((position, t_s));
        }
        self.stalled_s = self.stalled_s.max(t_s - since_s);
    }

    fn note_errors(&mut self, output: &StackOutput, truth: &TruthRecord) {
        let state = &output.state;
        if let Some(reference) = output
            .reference
            .filter(|_| output.mode == FlightMode::Flying)
        {
            let error = truth.world_from_body.translation.vector - reference.position_world;
            self.tracking.0 += error.norm_squared();
            self.tracking.1 += 1;
        }
        if state.health == EstimateHealth::Initialising || !state.is_finite() {
            return;
        }
        let yaw = so3::wrap_angle(
            so3::yaw_rad(&truth.world_from_body.rotation)
                - so3::yaw_rad(&state.world_from_body.rotation),
        );
        let up = |q: &nalgebra::UnitQuaternion<f64>| q.inverse() * Vector3::z();
        let tilt = up(&truth.world_from_body.rotation).angle(&up(&state.world_from_body.rotation));
        self.squares += Vector4::new(
            (truth.world_from_body.translation.vector - state.position_world()).norm_squared(),
            (truth.velocity_world - state.velocity_world).norm_squared(),
            tilt * tilt,
            yaw * yaw,
        );
        self.counted += 1;
    }
}

fn sample(t_s: f64, output: &StackOutput, truth: &TruthRecord) -> Sample {
    let state = &output.state;
    if state.health == EstimateHealth::Initialising {
        return Sample {
            position: UNKNOWN,
            velocity: UNKNOWN,
            position_sigma: UNKNOWN,
            velocity_sigma: UNKNOWN,
            attitude_error: UNKNOWN,
            attitude_sigma: UNKNOWN,
            ..known_sample(t_s, output, truth)
        };
    }
    known_sample(t_s, output, truth)
}

/// In place of an estimate that does not exist yet.
const UNKNOWN: Vector3<f64> = Vector3::new(f64::NAN, f64::NAN, f64::NAN);

fn known_sample(t_s: f64, output: &StackOutput, truth: &TruthRecord) -> Sample {
    let state = &output.state;
    Sample {
        t_s,
        true_position: truth.world_from_body.translation.vector,
        true_velocity: truth.velocity_world,
        position: state.position_world(),
        velocity: state.velocity_world,
        position_sigma: state.sigma(error_index::POSITION),
        velocity_sigma: state.sigma(error_index::VELOCITY),
        attitude_error: so3::log(
            &(state.world_from_body.rotation.inverse() * truth.world_from_body.rotation),
        ),
        attitude_sigma: state.sigma(error_index::ORIENTATION),
        reference: output.reference.map(|r| r.position_world),
        clearance_m: truth.clearance_m,
    }
}
