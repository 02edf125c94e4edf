//! A proportional, integral and derivative law for one quantity.

/// Gains and limits of a [`Pid`]. The units follow from the quantity and the output that the
/// gains connect; the integral is kept in units of the output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PidGains {
    /// Output per error.
    pub proportional: f64,
    /// Output per error and second.
    pub integral: f64,
    /// Output per rate of the error.
    pub derivative: f64,
    /// Greatest magnitude of the integral's share of the output.
    pub integral_limit: f64,
    /// Greatest magnitude of the output.
    pub output_limit: f64,
}

/// What a [`Pid`] compares.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PidInput {
    /// Where the quantity should be.
    pub setpoint: f64,
    /// The rate at which the setpoint is planned to move; zero when it jumps, so that a jump gives
    /// no impulse: the derivative acts on the measurement.
    pub setpoint_rate: f64,
    /// Where the quantity is.
    pub measurement: f64,
    /// The measured rate of the quantity.
    pub measurement_rate: f64,
}

/// u = k_p e + k_i integral(e) + k_d (setpoint rate - measured rate), limited, without windup.
#[derive(Clone, Debug)]
pub struct Pid {
    gains: PidGains,
    integral: f64,
    integral_before: f64,
}

impl Pid {
    /// A law at rest.
    pub fn new(gains: PidGains) -> Self {
        Self {
            gains,
            integral: 0.0,
            integral_before: 0.0,
        }
    }

    /// The output after `dt_s` seconds of this input.
    ///
    /// Windup is kept off twice: the integral is limited, and it does not grow while the output is
    /// at its limit in the same direction.
    pub fn update(&mut self, input: &PidInput, dt_s: f64) -> f64 {
        let g = &self.gains;
        let error = input.setpoint - input.measurement;
        let direct =
            g.proportional * error + g.derivative * (input.setpoint_rate - input.measurement_rate);
        let candidate =
            (self.integral + g.integral * error * dt_s).clamp(-g.integral_limit, g.integral_limit);
        let output = (direct + candidate).clamp(-g.output_limit, g.output_limit);
        let excess = direct + candidate - output;
        self.integral_before = self.integral;
        if excess * (candidate - self.integral) <= 0.0 {
            self.integral = candidate;
        }
        output
    }

    /// Takes the last step of the integral back, when what follows could not carry the output out.
    pub fn undo_integration(&mut self) {
        self.integral = self.integral_before;
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.integral = 0.0;
        self.integral_before = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAINS: PidGains = PidGains {
        proportional: 2.0,
        integral: 1.0,
        derivative: 0.5,
        integral_limit: 3.0,
        output_limit: 10.0,
    };

    fn error(e: f64) -> PidInput {
        PidInput {
            setpoint: e,
            ..PidInput::default()
        }
    }

    #[test]
    fn a_jump_of_the_setpoint_gives_the_proportional_share_only() {
        let mut pid = Pid::new(GAINS);
        assert_eq!(pid.update(&error(1.5), 0.0), 3.0);
    }

    #[test]
    fn the_derivative_opposes_the_measured_rate() {
        let mut pid = Pid::new(GAINS);
        let input = PidInput {
            measurement_rate: 2.0,
            ..PidInput::default()
        };
        assert_eq!(pid.update(&input, 0.0), -1.0);
    }

    #[test]
    fn a_constant_disturbance_is_integrated_away() {
        // x' = u - 1 settles at zero error only if the integral carries the disturbance.
        let mut pid = Pid::new(GAINS);
        let mut x = 0.0;
        for _ in 0..20_000 {
            let input = PidInput {
                measurement: x,
                ..PidInput::default()
            };
            x += (pid.update(&input, 1e-3) - 1.0) * 1e-3;
        }
        // The poles are both at -1: after 20 s the remainder is 20 exp(-20) = 4e-8.
        assert!(x.abs() < 1e-7, "{x}");
    }

    #[test]
    fn the_integral_never_exceeds_its_limit() {
        let mut pid = Pid::new(GAINS);
        for _ in 0..100_000 {
            pid.update(&error(1.0), 1e-3);
        }
        assert_eq!(pid.update(&error(0.0), 1e-3), GAINS.integral_limit);
    }

    #[test]
    fn the_integral_stands_still_while_the_output_is_at_its_limit() {
        let mut pid = Pid::new(GAINS);
        for _ in 0..1000 {
            assert_eq!(pid.update(&error(100.0), 1e-3), GAINS.output_limit);
        }
        assert_eq!(pid.update(&error(0.0), 1e-3), 0.0);
    }

    #[test]
    fn an_undone_step_leaves_no_trace() {
        let mut pid = Pid::new(GAINS);
        pid.update(&error(1.0), 0.1);
        pid.update(&error(1.0), 0.1);
        pid.undo_integration();
        assert!((pid.update(&error(0.0), 0.1) - 0.1).abs() < 1e-15);
    }
}
