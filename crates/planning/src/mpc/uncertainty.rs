//! How the uncertainty of the vehicle's motion grows along the plan.

use alula_messages::{NavState, error_index};
use nalgebra::{Matrix3, SMatrix};

use super::config::PredictiveConfig;
use super::dynamics::{Input, NX, State, TiltDynamics};

type Covariance = SMatrix<f64, NX, NX>;

/// Covariance of the planner's state from that of the estimator.
///
/// Positions of obstacles are measured from the vehicle, so that its drift is common to both and
/// does not count: position starts at a small value of its own, without correlation, and yaw at
/// none. The orientation error, a rotation vector in the body, becomes one of roll and pitch by
/// `d(roll) = e_x + tan(pitch) (sin(roll) e_y + cos(roll) e_z)`,
/// `d(pitch) = cos(roll) e_y - sin(roll) e_z`.
pub(super) fn initial(config: &PredictiveConfig, state: &NavState) -> Covariance {
    let (roll, pitch, _) = alula_geometry::so3::to_roll_pitch_yaw(&state.world_from_body.rotation);
    let mut map = SMatrix::<f64, 5, 6>::zeros();
    map.fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&Matrix3::identity());
    map[(3, 3)] = 1.0;
    map[(3, 4)] = pitch.tan() * roll.sin();
    map[(3, 5)] = pitch.tan() * roll.cos();
    map[(4, 4)] = roll.cos();
    map[(4, 5)] = -roll.sin();
    let part = state
        .covariance
        .fixed_view::<6, 6>(error_index::VELOCITY, error_index::VELOCITY);
    let mut motion = map * part * map.transpose();
    believe(&mut motion, config.max_velocity_sigma_m_s);
    let mut covariance = Covariance::zeros();
    covariance.fixed_view_mut::<5, 5>(3, 3).copy_from(&motion);
    for i in 0..3 {
        covariance[(i, i)] = config.position_sigma_m * config.position_sigma_m;
    }
    covariance
}

/// Scales velocity, with its correlations, so that no component exceeds `sigma_m_s`.
fn believe(motion: &mut SMatrix<f64, 5, 5>, sigma_m_s: f64) {
    for i in 0..3 {
        let sigma = motion[(i, i)].max(0.0).sqrt();
        if sigma > sigma_m_s {
            let share = sigma_m_s / sigma;
            for j in 0..5 {
                motion[(i, j)] *= share;
                motion[(j, i)] *= share;
            }
        }
    }
}

/// Covariances of the position at every point, along states and inputs (document L, equation
/// 6-18): `C_(k+1) = F_k C_k F_k' + W`, with disturbing accelerations constant in an interval and
/// independent between intervals.
pub(super) fn propagate(
    config: &PredictiveConfig,
    dynamics: &TiltDynamics,
    initial: &Covariance,
    states: &[State],
    inputs: &[Input],
    positions: &mut [Matrix3<f64>],
) {
    let h = config.interval_s;
    let variance = config.acceleration_sigma_m_s2 * config.acceleration_sigma_m_s2;
    let mut covariance = *initial;
    for (k, position) in positions.iter_mut().enumerate() {
        *position = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let (Some(x), Some(u)) = (states.get(k), inputs.get(k)) else {
            continue;
        };
        let f = dynamics.step(x, u).a;
        covariance = f * covariance * f.transpose();
        for i in 0..3 {
            covariance[(i, i)] += variance * 0.25 * h.powi(4);
            covariance[(i, 3 + i)] += variance * 0.5 * h.powi(3);
            covariance[(3 + i, i)] += variance * 0.5 * h.powi(3);
            covariance[(3 + i, 3 + i)] += variance * h * h;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::dynamics::TiltModel;
    use super::*;
    use alula_geometry::so3;
    use nalgebra::Vector3;

    fn state(tilt: [f64; 2], sigma: f64) -> NavState {
        let mut state = NavState::default();
        state.world_from_body.rotation = so3::from_roll_pitch_yaw(tilt[0], tilt[1], 0.7);
        for i in 0..9 {
            state.covariance[(i, i)] = sigma * sigma;
        }
        state
    }

    #[test]
    fn the_orientation_error_becomes_one_of_roll_and_pitch() {
        let (roll, pitch, h) = (0.3, -0.4, 1e-6);
        let mut state = state([roll, pitch], 0.0);
        for axis in 0..3 {
            state.covariance[(6 + axis, 6 + axis)] = 1.0;
            let mut error = Vector3::zeros();
            error[axis] = h;
            let turned = state.world_from_body.rotation * so3::exp(&error);
            let (r, p, _) = so3::to_roll_pitch_yaw(&turned);
            let (dr, dp) = ((r - roll) / h, (p - pitch) / h);
            let covariance = initial(&PredictiveConfig::default(), &state);
            assert!((covariance[(6, 6)] - dr * dr).abs() < 1e-5);
            assert!((covariance[(7, 7)] - dp * dp).abs() < 1e-5);
            assert!((covariance[(6, 7)] - dr * dp).abs() < 1e-5);
            state.covariance[(6 + axis, 6 + axis)] = 0.0;
        }
    }

    #[test]
    fn drift_of_the_position_does_not_count() {
        let mut state = state([0.0; 2], 0.01);
        for i in 0..3 {
            state.covariance[(i, i)] = 100.0;
        }
        let config = PredictiveConfig::default();
        let covariance = initial(&config, &state);
        assert_eq!(
            covariance[(0, 0)],
            config.position_sigma_m * config.position_sigma_m
        );
    }

    #[test]
    fn position_grows_with_velocity_and_disturbance() {
        let config = PredictiveConfig::default();
        let dynamics = TiltDynamics::new(&TiltModel::bebop(), config.interval_s).unwrap();
        let mut covariance = Covariance::zeros();
        for i in 3..6 {
            covariance[(i, i)] = 0.04;
        }
        let (states, inputs) = ([State::zeros(); 26], [Input::zeros(); 25]);
        let mut positions = [Matrix3::zeros(); 26];
        propagate(
            &config,
            &dynamics,
            &covariance,
            &states,
            &inputs,
            &mut positions,
        );
        let sigmas: Vec<f64> = positions.iter().map(|p| p[(0, 0)].sqrt()).collect();
        assert!(sigmas.windows(2).all(|w| w[1] > w[0]));
        // Velocity alone, less drag; to it comes a random walk of the velocity.
        let horizon_s = 25.0 * config.interval_s;
        let alone = 0.2 * horizon_s * (1.0 - 0.5 * horizon_s * 0.184);
        let walked =
            config.acceleration_sigma_m_s2 * (config.interval_s * horizon_s.powi(3) / 3.0).sqrt();
        let expected = alone.hypot(walked);
        let error = (sigmas[25] - expected).abs();
        assert!(error < 0.05 * expected, "{} {expected}", sigmas[25]);
    }
}
