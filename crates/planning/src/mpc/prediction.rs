//! Which obstacles matter, what volumes they are, and where they will be.

use alula_geometry::Timestamp;
use alula_messages::{
    Footprint, Obstacle, ObstacleMotion, PLAN_INTERVALS, PLAN_OBSTACLES, PLAN_POINTS,
};
use nalgebra::{Matrix3, Vector2, Vector3};

use super::config::PredictiveConfig;
use super::dynamics::State;
use super::keepout::{Keepout, Volume, sum_with_sphere};

/// Every so many points the expected path is held against the obstacles.
const SAMPLING: usize = 3;

/// An obstacle that the plan keeps clear of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Threat {
    /// Place in the list of obstacles.
    pub index: usize,
    /// Its volume.
    volume: Volume,
    /// Nearest predicted approach, m.
    approach_m: f64,
}

/// What the choice of obstacles depends on.
pub(super) struct Scene<'a> {
    pub config: &'a PredictiveConfig,
    /// Quantile of the standard normal distribution for the allowed chance of collision.
    pub quantile: f64,
    /// Time of the first point.
    pub now: Timestamp,
    /// First guess of the states.
    pub states: &'a [State],
    /// Where the plan is to lead.
    pub target: Vector3<f64>,
    /// Speed on the straight way there, m/s.
    pub speed_m_s: f64,
}

impl Scene<'_> {
    /// Fills `threats` with the obstacles that come nearest to the expected path or to the
    /// straight way to the target. They are in the order of their numbers, so that the solver's
    /// memory of a constraint meets the same obstacle again.
    pub fn choose(&self, obstacles: &[Obstacle], threats: &mut Vec<Threat>) {
        threats.clear();
        for (index, obstacle) in obstacles.iter().enumerate() {
            let volume = self.volume(obstacle);
            let approach_m = self.approach_m(obstacle, volume);
            if approach_m > self.config.heed_m {
                continue;
            }
            let place = threats.partition_point(|t| t.approach_m <= approach_m);
            if place < PLAN_OBSTACLES {
                threats.truncate(PLAN_OBSTACLES - 1);
                let threat = Threat {
                    index,
                    volume,
                    approach_m,
                };
                threats.insert(place, threat);
            }
        }
        threats.sort_unstable_by_key(|threat| obstacles[threat.index].id);
    }

    /// The obstacle at point `k`, with the vehicle's own covariance there.
    pub fn keepout(
        &self,
        obstacle: &Obstacle,
        threat: &Threat,
        k: usize,
        own: &Matrix3<f64>,
    ) -> Keepout {
        let (centre, covariance) = self.predict(obstacle, k);
        let cap = self.config.max_margin_m / self.quantile;
        Keepout {
            centre,
            covariance: capped(covariance + own, cap * cap),
            volume: threat.volume,
        }
    }

    /// Centre and its covariance at point `k`.
    fn predict(&self, obstacle: &Obstacle, k: usize) -> (Vector3<f64>, Matrix3<f64>) {
        let ahead_s = k as f64 * self.config.interval_s;
        let age_s = self.now.seconds_since(obstacle.time);
        let centre = match obstacle.motion {
            ObstacleMotion::Static => obstacle.centre_world,
            _ => obstacle.centre_after(age_s + ahead_s),
        };
        (centre, obstacle.centre_covariance_after(age_s + ahead_s))
    }

    /// The volume that the vehicle's centre must keep out of.
    fn volume(&self, obstacle: &Obstacle) -> Volume {
        if let Some(level) = self.level(obstacle) {
            return level;
        }
        match obstacle.footprint {
            Footprint::Round => {
                let size = obstacle.size_m.map(|s| s.max(0.02));
                let hull = self
                    .config
                    .hull
                    .semi_axes_m(&size, self.config.hull_widening);
                Volume::ellipsoid(
                    &sum_with_sphere(&hull, self.config.radius_m),
                    obstacle.yaw_rad,
                )
            }
            Footprint::Flat => self.wall(obstacle),
        }
    }

    /// The half-space of an obstacle that lies wholly below or above the way.
    fn level(&self, obstacle: &Obstacle) -> Option<Volume> {
        let height = self.states.first()?[2];
        let (low, high) = (height.min(self.target.z), height.max(self.target.z));
        let (centre, covariance) = self.predict(obstacle, 0);
        let standoff_m = 0.5 * obstacle.size_m.z + self.config.radius_m;
        let margin_m = self.quantile * covariance[(2, 2)].max(0.0).sqrt();
        let up = if low - margin_m >= centre.z + standoff_m {
            1.0
        } else if high + margin_m <= centre.z - standoff_m {
            -1.0
        } else {
            return None;
        };
        Some(Volume::Level { up, standoff_m })
    }

    fn wall(&self, obstacle: &Obstacle) -> Volume {
        let (sin, cos) = obstacle.yaw_rad.sin_cos();
        let along = Vector2::new(cos, sin);
        let half_length_m = 0.5 * obstacle.size_m.x;
        Volume::Wall {
            along,
            half_length_m,
            standoff_m: self.config.radius_m + 0.5 * obstacle.size_m.y,
            side: self.side(obstacle, &along, half_length_m),
        }
    }

    /// Side of a wall on which the vehicle is, 0 where it may go to either.
    fn side(&self, obstacle: &Obstacle, along: &Vector2<f64>, half_length_m: f64) -> f64 {
        let Some(start) = self.states.first() else {
            return 0.0;
        };
        let from_centre = start.fixed_rows::<2>(0) - self.predict(obstacle, 0).0.xy();
        if along.dot(&from_centre).abs() > half_length_m {
            return 0.0;
        }
        1.0_f64.copysign(along.x * from_centre.y - along.y * from_centre.x)
    }

    /// Least distance from the expected path and from the straight way, less the margin, m.
    fn approach_m(&self, obstacle: &Obstacle, volume: Volume) -> f64 {
        let Some(start) = self.states.first() else {
            return f64::INFINITY;
        };
        let start = Vector3::new(start[0], start[1], start[2]);
        let way = self.target - start;
        let length = way.norm().max(1e-9);
        let mut least = f64::INFINITY;
        for k in (0..PLAN_POINTS).step_by(SAMPLING).chain([PLAN_INTERVALS]) {
            let (centre, covariance) = self.predict(obstacle, k);
            let keepout = Keepout {
                centre,
                covariance,
                volume,
            };
            let travelled = self.speed_m_s * self.config.interval_s * k as f64;
            let straight = start + way * (travelled / length).min(1.0);
            let guess = self.states[k].fixed_rows::<3>(0).into_owned();
            least = least
                .min(keepout.chance_value(&straight, self.quantile))
                .min(keepout.chance_value(&guess, self.quantile));
        }
        least
    }
}

/// `covariance` with its principal variances cut to `greatest`.
pub(super) fn capped(covariance: Matrix3<f64>, greatest: f64) -> Matrix3<f64> {
    if covariance.trace() <= greatest {
        return covariance;
    }
    let eigen = covariance.symmetric_eigen();
    let values = eigen.eigenvalues.map(|v| v.clamp(0.0, greatest));
    eigen.eigenvectors * Matrix3::from_diagonal(&values) * eigen.eigenvectors.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capping_cuts_only_what_is_too_uncertain() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.4, 1.0).into_inner();
        let make = |v: [f64; 3]| turn * Matrix3::from_diagonal(&v.into()) * turn.transpose();
        let cut = capped(make([0.01, 0.2, 0.5]), 0.1);
        assert!((cut - make([0.01, 0.1, 0.1])).norm() < 1e-12);
        assert_eq!(
            capped(make([0.01, 0.02, 0.03]), 0.1),
            make([0.01, 0.02, 0.03])
        );
    }
}
