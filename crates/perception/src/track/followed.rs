//! One followed obstacle, and how it goes on unseen.

use std::f64::consts::{FRAC_PI_2, PI};

use alula_geometry::Timestamp;
use alula_messages::{Footprint, Obstacle, ObstacleMotion, Sight};
use nalgebra::{Cholesky, Vector2, Vector3};

use super::config::TrackModelConfig;
use super::kalman::{Motion, SIZE, State};
use super::turns::Turns;

/// One followed obstacle.
#[derive(Clone, Debug)]
pub(super) struct Track {
    pub id: u32,
    pub footprint: Footprint,
    pub state: State,
    /// How it may be turning, while it may move: `state` is their mean.
    pub turns: Option<Turns>,
    pub yaw_rad: f64,
    pub motion: ObstacleMotion,
    /// Time for which the velocity has counted as zero, s.
    pub standing_s: f64,
    pub sight: Sight,
    /// The camera that judged its sight last.
    pub sensor: u8,
    pub last_seen: Timestamp,
    pub images: u32,
    /// Images in sequence without detection though the view is free beyond.
    pub misses: u32,
    /// Time without detection though it should be seen, s.
    pub missed_s: f64,
}

impl Track {
    pub fn position(&self) -> Vector3<f64> {
        self.state.position()
    }

    pub fn size(&self) -> Vector3<f64> {
        self.state.size()
    }

    pub fn shift(&mut self, by_world: &Vector3<f64>) {
        self.state.shift(by_world);
        if let Some(turns) = &mut self.turns {
            turns.shift(by_world);
        }
    }

    /// What stood begins to move: nothing is known of its velocity any more.
    pub fn start(&mut self, model: &TrackModelConfig) {
        self.state
            .open_velocity(model.max_velocity_sigma_m_s, model);
        self.turns = None;
    }

    /// Moves the state on by `dt_s`: with turns while the obstacle may move, not at all for pieces
    /// of walls and unseen standing ones.
    pub fn predict(&mut self, dt_s: f64, model: &TrackModelConfig) {
        let is_flat = self.footprint == Footprint::Flat;
        if !is_flat && self.motion != ObstacleMotion::Static {
            let turns = self.turns.get_or_insert_with(|| Turns::new(&self.state));
            turns.move_on(dt_s, self.sight, model);
            self.state = turns.mean();
            self.state.bound_velocity(model);
            return;
        }
        self.turns = None;
        if is_flat || self.sight != Sight::Seen {
            self.state.rest(dt_s, model);
        } else {
            let motion = Motion::straight(self.motion, self.sight, model);
            self.state.move_on(dt_s, &motion, model);
        }
    }

    /// Which of the track's lengths lies along each axis of a box, and how far the track must
    /// turn to be aligned with it (to a quarter turn), rad.
    pub fn alignment(&self, yaw_rad: f64) -> ([usize; 3], f64) {
        let turn = yaw_rad - self.yaw_rad;
        let quarters = (turn / FRAC_PI_2).round();
        let rest = turn - quarters * FRAC_PI_2;
        let odd = quarters.rem_euclid(2.0) != 0.0;
        (if odd { [1, 0, 2] } else { [0, 1, 2] }, rest)
    }

    /// Turns the box to be aligned with another, to a quarter turn.
    pub fn align(&mut self, yaw_rad: f64) {
        let (_, turn) = self.alignment(yaw_rad);
        self.yaw_rad = wrap(self.yaw_rad + turn);
    }

    pub fn mark_seen(&mut self, time: Timestamp) {
        self.sight = Sight::Seen;
        self.last_seen = time;
        self.images = self.images.saturating_add(1);
        self.misses = 0;
        self.missed_s = 0.0;
    }

    /// Whether it is something round that may move and was seen in so many images by now.
    pub fn is_fresh_round(&self, images: u32) -> bool {
        self.footprint == Footprint::Round
            && self.motion != ObstacleMotion::Static
            && self.sight == Sight::Seen
            && self.images == images
    }

    /// Whether it is something round that moves and is not seen.
    pub fn is_lost(&self) -> bool {
        self.footprint == Footprint::Round
            && self.motion == ObstacleMotion::Moving
            && self.sight != Sight::Seen
    }

    /// Squared Mahalanobis distance of another track, seen from above; `None` if both places are
    /// known without error.
    pub fn distance_as(&self, found: &Self) -> Option<f64> {
        let block = |track: &Self| {
            let view = track.state.covariance.fixed_view::<2, 2>(0, 0);
            view.into_owned()
        };
        let factor = Cholesky::new(block(self) + block(found))?;
        let apart = (found.position() - self.position()).xy();
        Some(apart.dot(&factor.solve(&apart)))
    }

    /// Horizontal distance of another track, m.
    pub fn apart_m(&self, other: &Self) -> f64 {
        (other.position() - self.position()).xy().norm()
    }

    /// Goes on as a track that turned out to be of the same thing, with the lengths that were known.
    pub fn resume(&mut self, found: &Self) {
        self.align(found.yaw_rad);
        let lengths = self.state;
        self.state = found.state;
        self.state.take_lengths(&lengths);
        self.turns = None;
        self.sensor = found.sensor;
        let images = self.images.saturating_add(found.images);
        self.mark_seen(found.last_seen);
        self.images = images;
    }

    /// Half the extent of the footprint along a horizontal direction of length one, m: of the
    /// ellipse in the box.
    pub fn reach_m(&self, direction: &Vector2<f64>) -> f64 {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let along = direction.x * cos + direction.y * sin;
        let across = direction.y * cos - direction.x * sin;
        let size = self.size();
        0.5 * (size.x * along).hypot(size.y * across)
    }

    /// Whether a point lies within the box, widened by a margin, seen from above.
    pub fn covers(&self, point: &Vector3<f64>, margin_m: f64) -> bool {
        covers(
            &self.position(),
            self.yaw_rad,
            &self.size(),
            point,
            margin_m,
        )
    }

    /// What others see of the track.
    pub fn obstacle(&self, time: Timestamp) -> Obstacle {
        let stands = self.motion == ObstacleMotion::Static;
        let covariance = &self.state.covariance;
        Obstacle {
            id: self.id,
            time,
            centre_world: self.position(),
            velocity_world: if stands {
                Vector3::zeros()
            } else {
                self.state.velocity()
            },
            covariance: covariance.fixed_view::<6, 6>(0, 0).into(),
            yaw_rad: self.yaw_rad,
            size_m: self.size(),
            size_variance_m2: Vector3::from_fn(|i, _| covariance[(SIZE + i, SIZE + i)]),
            footprint: self.footprint,
            motion: self.motion,
            sight: self.sight,
            last_seen: self.last_seen,
            images: self.images,
        }
    }
}

/// Whether a point lies within a box, widened by a margin, seen from above.
pub(super) fn covers(
    centre: &Vector3<f64>,
    yaw_rad: f64,
    size: &Vector3<f64>,
    point: &Vector3<f64>,
    margin_m: f64,
) -> bool {
    let (sin, cos) = yaw_rad.sin_cos();
    let offset = point - centre;
    let along = offset.x * cos + offset.y * sin;
    let across = offset.y * cos - offset.x * sin;
    along.abs() <= 0.5 * size.x + margin_m && across.abs() <= 0.5 * size.y + margin_m
}

/// Angle in (-pi, pi], rad.
pub(super) fn wrap(angle: f64) -> f64 {
    let turned = angle.rem_euclid(2.0 * PI);
    if turned > PI {
        turned - 2.0 * PI
    } else {
        turned
    }
}
