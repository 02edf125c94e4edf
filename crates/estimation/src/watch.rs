//! Watching over one source of measurements.

use alula_geometry::Timestamp;
use alula_messages::{EstimateHealth, FlightPhase, FlowSample, Fusion, RangeSample, Rejection};

/// When a source was last accepted, and since when the gate has refused it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Watch {
    last_accepted: Timestamp,
    refused_since: Option<Timestamp>,
}

impl Watch {
    /// A source that counts as accepted at `now`.
    pub fn since(now: Timestamp) -> Self {
        Self {
            last_accepted: now,
            refused_since: None,
        }
    }

    /// Takes note of what became of a measurement.
    pub fn note(&mut self, fusion: &Fusion) {
        if fusion.accepted() {
            self.last_accepted = self.last_accepted.max(fusion.time);
            self.refused_since = None;
        } else if fusion.rejection == Some(Rejection::Gate) {
            self.refused_since.get_or_insert(fusion.time);
        }
    }

    /// Seconds since the last accepted measurement.
    pub fn silent_s(&self, now: Timestamp) -> f64 {
        now.seconds_since(self.last_accepted).max(0.0)
    }

    /// Whether the gate has refused everything for longer than `limit_s`; saying so starts the
    /// count again.
    pub fn take_refusal(&mut self, now: Timestamp, limit_s: f64) -> bool {
        let refused = self
            .refused_since
            .is_some_and(|since| now.seconds_since(since) > limit_s);
        if refused {
            self.refused_since = None;
        }
        refused
    }
}

/// Health of an estimate whose velocity and height have these sources, either of which may be silent
/// for `limit_s`.
pub fn health(velocity: &Watch, height: &Watch, now: Timestamp, limit_s: f64) -> EstimateHealth {
    let since_velocity_s = velocity.silent_s(now);
    let since_height_s = height.silent_s(now);
    if since_velocity_s.max(since_height_s) > limit_s {
        EstimateHealth::Degraded {
            since_velocity_s,
            since_height_s,
        }
    } else {
        EstimateHealth::Good
    }
}

/// How long a downward sensor may be silent in a phase, s: near the ground it is blind.
pub fn silence_limit_s(phase: FlightPhase, in_flight_s: f64, near_ground_s: f64) -> f64 {
    match phase {
        FlightPhase::Landed | FlightPhase::Flying => in_flight_s,
        FlightPhase::TakingOff | FlightPhase::Landing => near_ground_s,
    }
}

/// What every reading of a flow camera has to pass. `ready` is what the filter needs for it, or why
/// it has no use for readings now.
pub fn check_flow<S>(
    sample: &FlowSample,
    now: Timestamp,
    ready: Result<S, Rejection>,
    repetition: &mut Repetition,
    min_quality: f64,
    stuck_after_s: f64,
) -> Result<S, Rejection> {
    let flow = sample.flow_rad_s;
    if !(flow.iter().all(|x| x.is_finite()) && sample.interval_s.is_finite()) {
        return Err(Rejection::NotFinite);
    }
    let ready = ready?;
    let repeated_s = repetition.add(flow.into(), sample.time);
    let good = sample.quality >= min_quality
        && (0.0..=1.0).contains(&sample.interval_s)
        && repeated_s <= stuck_after_s
        && sample.time <= now;
    if good {
        Ok(ready)
    } else {
        Err(Rejection::Invalid)
    }
}

/// What every reading of a ranger has to pass; `ready` as for [`check_flow`].
pub fn check_range<S>(
    sample: &RangeSample,
    now: Timestamp,
    ready: Result<S, Rejection>,
    repetition: &mut Repetition,
    stuck_after_s: f64,
) -> Result<S, Rejection> {
    if !sample.range_m.is_finite() {
        return Err(Rejection::NotFinite);
    }
    let ready = ready?;
    let repeated_s = repetition.add([sample.range_m, 0.0], sample.time);
    if !sample.is_valid() || repeated_s > stuck_after_s || sample.time > now {
        return Err(Rejection::Invalid);
    }
    Ok(ready)
}

/// Finds sources that say the same thing to the last bit again and again: noise never does.
#[derive(Clone, Copy, Debug, Default)]
pub struct Repetition {
    last: Option<([f64; 2], Timestamp)>,
}

impl Repetition {
    /// Takes a reading; how long it has been the same, s.
    pub fn add(&mut self, reading: [f64; 2], time: Timestamp) -> f64 {
        match self.last {
            Some((same, since)) if same == reading => time.seconds_since(since),
            _ => {
                self.last = Some((reading, time));
                0.0
            }
        }
    }
}
