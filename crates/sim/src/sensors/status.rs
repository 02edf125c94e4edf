//! Reports of the autopilot about itself.

use alula_geometry::Timestamp;
use alula_messages::AutopilotStatus;
use alula_parameters::parameters;

use super::channel::Channel;
use super::failure::FailureConfig;
use super::noise::Noise;
use super::step::Step;

parameters! {
    /// Rate and errors of the autopilot's reports.
    pub struct StatusModel {
        /// Reports per second.
        pub rate_hz: f64 = 50.0, within(1.0, 500.0);
        /// Time from the report to its arrival, s.
        pub latency_s: f64 = 0.005, within(0.0, 1.0);
        /// White noise of the reported thrust, as a share of the greatest possible.
        pub thrust_noise: f64 = 0.005, within(0.0, 0.5);
        /// Failures.
        pub failures: Vec<FailureConfig> = Vec::new(), nested();
    }
}

/// The simulated reports.
#[derive(Clone, Debug)]
pub(super) struct Status {
    model: StatusModel,
    channel: Channel<AutopilotStatus>,
    noise: Noise,
}

impl Status {
    pub(super) fn new(model: &StatusModel, flight_seed: u64) -> Self {
        Self {
            model: model.clone(),
            channel: Channel::new(
                model.rate_hz,
                model.latency_s,
                &model.failures,
                flight_seed,
                "status",
            ),
            noise: Noise::new(flight_seed, "status"),
        }
    }

    pub(super) fn advance(&mut self, step: &Step) {
        while self.channel.due() <= step.to.time {
            let thrust =
                step.motors.thrust_fraction + self.noise.normal() * self.model.thrust_noise;
            let report = AutopilotStatus {
                time: self.channel.due(),
                armed: step.motors.armed,
                thrust_fraction: if step.motors.armed {
                    thrust.clamp(0.0, 1.0)
                } else {
                    0.0
                },
            };
            self.channel.send(report);
        }
    }

    pub(super) fn deliver(&mut self, now: Timestamp, received: &mut Vec<AutopilotStatus>) {
        self.channel.deliver(now, received);
    }
}
