//! The reference model: how a commanded quantity is meant to answer.

/// Two first-order lags in a row: u' = (K c - u) / t_s, y' = (u - y) / t.
///
/// The second lag is the response of document L, equations; the short first one keeps
/// the second derivative finite, so that it can be fed forward.
#[derive(Clone, Debug)]
pub(super) struct Response {
    gain: f64,
    time_constant_s: f64,
    smoothing_s: f64,
    smoothed: f64,
    value: f64,
    target: f64,
}

impl Response {
    pub(super) fn new(gain: f64, time_constant_s: f64, smoothing_s: f64) -> Self {
        Self {
            gain,
            time_constant_s,
            smoothing_s,
            smoothed: 0.0,
            value: 0.0,
            target: 0.0,
        }
    }

    /// Stands still at `value`.
    pub(super) fn start(&mut self, value: f64) {
        self.smoothed = value;
        self.value = value;
        self.target = value;
    }

    /// Moves on by `dt_s` with a constant command; each lag is solved exactly for an input that is
    /// constant over the step, so that no step is too long.
    pub(super) fn advance(&mut self, command: f64, dt_s: f64) {
        self.target = self.gain * command;
        let before = self.smoothed;
        self.smoothed += (self.target - before) * (1.0 - (-dt_s / self.smoothing_s).exp());
        let input = 0.5 * (before + self.smoothed);
        self.value += (input - self.value) * (1.0 - (-dt_s / self.time_constant_s).exp());
    }

    pub(super) fn value(&self) -> f64 {
        self.value
    }

    pub(super) fn rate(&self) -> f64 {
        (self.smoothed - self.value) / self.time_constant_s
    }

    pub(super) fn acceleration(&self) -> f64 {
        ((self.target - self.smoothed) / self.smoothing_s - self.rate()) / self.time_constant_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y = K c (1 - (t e^(-x/t) - t_s e^(-x/t_s)) / (t - t_s)) after x seconds of command c.
    fn analytic(x: f64) -> f64 {
        let (t, s) = (0.2_f64, 0.05_f64);
        1.5 * (1.0 - (t * (-x / t).exp() - s * (-x / s).exp()) / (t - s))
    }

    #[test]
    fn a_step_gives_the_analytic_response_of_two_lags() {
        let mut response = Response::new(1.5, 0.2, 0.05);
        for i in 1..=1000 {
            response.advance(1.0, 1e-3);
            // The mean of the smoothed input over a step is second order in the step.
            assert!((response.value() - analytic(f64::from(i) * 1e-3)).abs() < 1e-4);
        }
    }

    #[test]
    fn rate_and_acceleration_are_derivatives_of_the_value() {
        let h = 1e-4;
        let mut response = Response::new(1.5, 0.2, 0.05);
        for _ in 0..1000 {
            response.advance(1.0, h);
        }
        let (before, rate_before) = (response.value(), response.rate());
        response.advance(1.0, h);
        let middle = (response.rate(), response.acceleration(), response.value());
        response.advance(1.0, h);
        // Central differences: the remainder is y''' h^2 / 6, with y''' below 1.5 / (t t_s^2).
        assert!(((response.value() - before) / (2.0 * h) - middle.0).abs() < 1e-4);
        assert!(((response.rate() - rate_before) / (2.0 * h) - middle.1).abs() < 1e-2);
    }
}
