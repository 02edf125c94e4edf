//! Whether an obstacle stands or moves: a test of its velocity, with hysteresis.

use alula_geometry::gaussian::chi_square_quantile;
use alula_messages::ObstacleMotion;

use super::config::{MotionTestConfig, TrackModelConfig};
use super::followed::Track;

/// Degrees of freedom of the horizontal velocity.
const DEGREES: u32 = 2;

/// Test of the horizontal velocity against its covariance.
///
/// A standing obstacle is followed with little process noise, so that its velocity is known well
/// and a small one is found; once it moves, the process noise of walkers takes over.
#[derive(Clone, Debug)]
pub(super) struct MotionTest {
    config: MotionTestConfig,
    moving: f64,
    starting: f64,
    standing: f64,
}

impl MotionTest {
    pub fn new(config: &MotionTestConfig) -> Self {
        Self {
            config: config.clone(),
            moving: chi_square_quantile(config.moving_probability, DEGREES),
            starting: chi_square_quantile(config.starting_probability, DEGREES),
            standing: chi_square_quantile(config.standing_probability, DEGREES),
        }
    }

    /// Judges a track that was just seen, `dt_s` after the image before.
    pub fn judge(&self, track: &mut Track, dt_s: f64, model: &TrackModelConfig) {
        let test = track.state.velocity_test();
        let fast = track.state.velocity().xy().norm() > self.config.min_speed_m_s;
        let at_zero = !fast && test < self.standing;
        track.standing_s = if at_zero {
            track.standing_s + dt_s
        } else {
            0.0
        };
        if track.images < self.config.min_images {
            return;
        }
        let limit = match track.motion {
            ObstacleMotion::Static => self.starting,
            _ => self.moving,
        };
        if fast && test > limit {
            if track.motion == ObstacleMotion::Static {
                track.start(model);
            }
            track.motion = ObstacleMotion::Moving;
        } else if track.standing_s >= self.config.standing_s {
            track.motion = ObstacleMotion::Static;
        }
    }
}
