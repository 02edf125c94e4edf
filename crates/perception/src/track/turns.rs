//! Whether somebody walks straight on or turns: three Kalman filters that share what they know
//! (an interacting multiple model estimator, Blom and Bar-Shalom 1988).

use alula_messages::{ObstacleMotion, Sight};
use nalgebra::Vector3;

use super::config::TrackModelConfig;
use super::kalman::{Motion, State};

/// Straight on, to the left, to the right.
pub(super) const WAYS: usize = 3;

/// Probability of a new obstacle to go each way.
const AT_FIRST: [f64; WAYS] = [0.8, 0.1, 0.1];

/// The least probability of a way, which keeps it able to win.
const LEAST: f64 = 1e-6;

/// One state for each way to go on, with its probability.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turns {
    probabilities: [f64; WAYS],
    states: [State; WAYS],
}

impl Turns {
    pub fn new(state: &State) -> Self {
        Self {
            probabilities: AT_FIRST,
            states: [*state; WAYS],
        }
    }

    pub fn states_mut(&mut self) -> &mut [State; WAYS] {
        &mut self.states
    }

    pub fn shift(&mut self, by_world: &Vector3<f64>) {
        for state in &mut self.states {
            state.shift(by_world);
        }
    }

    /// Somebody may change his way, then each state moves on in its own. Who is not seen ends his
    /// turn and begins none: his velocity is kept.
    pub fn move_on(&mut self, dt_s: f64, sight: Sight, model: &TrackModelConfig) {
        self.mix(&changes(dt_s, sight, model));
        for (state, motion) in self.states.iter_mut().zip(ways(sight, model)) {
            state.move_on(dt_s, &motion, model);
        }
    }

    /// Each state becomes the mean over where it may come from. `changes[i][j]` is the probability
    /// to change from way `i` to `j`.
    fn mix(&mut self, changes: &[[f64; WAYS]; WAYS]) {
        let before = *self;
        for to in 0..WAYS {
            let joint: [f64; WAYS] =
                std::array::from_fn(|from| changes[from][to] * before.probabilities[from]);
            let total: f64 = joint.iter().sum();
            self.probabilities[to] = total;
            if total > 0.0 {
                self.states[to] = mean(&joint.map(|p| p / total), &before.states);
            }
        }
    }

    /// Weighs the ways with the logarithms of the likelihoods of what was seen.
    pub fn weigh(&mut self, log_likelihoods: &[f64; WAYS]) {
        let best = log_likelihoods.iter().copied().fold(f64::MIN, f64::max);
        for (p, log) in self.probabilities.iter_mut().zip(log_likelihoods) {
            *p = (*p * (log - best).exp()).max(LEAST);
        }
        let total: f64 = self.probabilities.iter().sum();
        self.probabilities = self.probabilities.map(|p| p / total);
    }

    /// Mean and covariance over all ways.
    pub fn mean(&self) -> State {
        mean(&self.probabilities, &self.states)
    }
}

/// Mean and covariance of a mixture.
fn mean(weights: &[f64; WAYS], states: &[State; WAYS]) -> State {
    let mut mixed = State::zero();
    for (weight, state) in weights.iter().zip(states) {
        mixed.mean += state.mean * *weight;
    }
    for (weight, state) in weights.iter().zip(states) {
        let apart = state.mean - mixed.mean;
        mixed.covariance += (state.covariance + apart * apart.transpose()) * *weight;
    }
    mixed
}

/// How each way moves.
fn ways(sight: Sight, model: &TrackModelConfig) -> [Motion; WAYS] {
    let straight = Motion::straight(ObstacleMotion::Moving, sight, model);
    let rate = model.turn_rate_deg_s.to_radians();
    let turn_noise = model.turn_acceleration_noise_m_s2_sqrt_hz;
    let turning = |turn_rate_rad_s: f64| Motion {
        turn_rate_rad_s,
        horizontal_noise: straight.horizontal_noise.max(turn_noise),
        ..straight
    };
    [straight, turning(rate), turning(-rate)]
}

/// Probability of each change of way within `dt_s`: ways end after exponential times, and the other
/// two are equally likely to follow. Unseen, only turns end, and straight on follows.
fn changes(dt_s: f64, sight: Sight, model: &TrackModelConfig) -> [[f64; WAYS]; WAYS] {
    let ends = |mean_s: f64| -(-dt_s / mean_s).exp_m1();
    let (turn, straight) = (ends(model.turn_s), ends(model.straight_s));
    if sight != Sight::Seen {
        return [
            [1.0, 0.0, 0.0],
            [turn, 1.0 - turn, 0.0],
            [turn, 0.0, 1.0 - turn],
        ];
    }
    [
        [1.0 - straight, 0.5 * straight, 0.5 * straight],
        [0.5 * turn, 1.0 - turn, 0.5 * turn],
        [0.5 * turn, 0.5 * turn, 1.0 - turn],
    ]
}

#[cfg(test)]
mod tests {
    use super::super::kalman::{POSITION, STATES, VELOCITY};
    use super::*;
    use nalgebra::{SMatrix, SVector};

    fn walker() -> State {
        let mut state = State::zero();
        state.mean[VELOCITY] = 1.2;
        let root = SMatrix::<f64, STATES, STATES>::from_fn(|i, j| 0.1 * ((3 * i + j) as f64).sin());
        state.covariance = root * root.transpose() + SMatrix::identity() * 0.01;
        state.covariance *= 0.1;
        state
    }

    fn model() -> TrackModelConfig {
        TrackModelConfig::default()
    }

    #[test]
    fn the_covariance_moves_with_the_jacobian_of_the_motion() {
        let quiet = |turn_rate_rad_s: f64| Motion {
            turn_rate_rad_s,
            horizontal_noise: 0.0,
            vertical_noise: 0.0,
            size_noise: 0.0,
        };
        for rate in [0.0, 2.0, -1.3] {
            let moved = |mean: SVector<f64, STATES>| {
                let mut state = State { mean, ..walker() };
                state.move_on(0.3, &quiet(rate), &model());
                state
            };
            let mean = walker().mean;
            let h = 1e-6;
            let mut jacobian = SMatrix::<f64, STATES, STATES>::zeros();
            for column in 0..STATES {
                let mut step = SVector::zeros();
                step[column] = h;
                let slope = (moved(mean + step).mean - moved(mean - step).mean) / (2.0 * h);
                jacobian.set_column(column, &slope);
            }
            let expected = jacobian * walker().covariance * jacobian.transpose();
            assert!((moved(mean).covariance - expected).amax() < 1e-9);
        }
    }

    #[test]
    fn a_turn_of_a_whole_round_ends_where_it_began() {
        let motion = ways(Sight::Seen, &model())[1];
        let round_s = std::f64::consts::TAU / motion.turn_rate_rad_s;
        let mut state = walker();
        state.move_on(round_s, &motion, &model());
        assert!((state.mean - walker().mean).amax() < 1e-9);
        let mut quarter = walker();
        quarter.move_on(0.25 * round_s, &motion, &model());
        assert!(quarter.velocity().y > 1.19, "to the left");
    }

    /// E[x x^T] of a mixture is the mean of its parts' second moments.
    #[test]
    fn a_mixture_has_the_moments_of_its_parts() {
        let mut states = [walker(); WAYS];
        states[1].mean[POSITION] = 0.3;
        states[2].mean[VELOCITY + 1] = -0.7;
        let weights = [0.5, 0.3, 0.2];
        let mixed = mean(&weights, &states);
        let moment = |state: &State| state.covariance + state.mean * state.mean.transpose();
        let sum = (0..WAYS).fold(SMatrix::zeros(), |sum, i| {
            sum + moment(&states[i]) * weights[i]
        });
        assert!((moment(&mixed) - sum).amax() < 1e-12);
    }

    #[test]
    fn who_is_lost_in_a_turn_turns_on_and_then_goes_straight() {
        let mut turns = Turns::new(&walker());
        turns.weigh(&[-50.0, 0.0, -50.0]);
        for _ in 0..90 {
            turns.move_on(1.0 / 30.0, Sight::OutOfView, &model());
        }
        assert!(turns.probabilities[0] > 0.99);
        let velocity = turns.mean().velocity();
        assert!(velocity.y > 0.4, "{velocity}");
        let mut straight = Turns::new(&walker());
        straight.weigh(&[0.0, -50.0, -50.0]);
        straight.move_on(3.0, Sight::OutOfView, &model());
        assert!((straight.mean().velocity().x - 1.2).abs() < 0.01);
    }

    #[test]
    fn probabilities_of_changes_and_ways_sum_to_one() {
        for sight in [Sight::Seen, Sight::Hidden] {
            for row in changes(0.033, sight, &model()) {
                assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            }
        }
        let mut turns = Turns::new(&walker());
        turns.move_on(0.033, Sight::Seen, &model());
        turns.weigh(&[-1.0, -800.0, 3.0]);
        assert!((turns.probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(turns.probabilities[2] > turns.probabilities[1]);
    }
}
