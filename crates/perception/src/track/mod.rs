//! Obstacles followed through the images (document L, section 5-2).

mod associate;
mod birth;
mod config;
mod faces;
mod flat;
mod followed;
mod kalman;
mod motion;
mod sight;
mod turns;
mod update;

use alula_geometry::Timestamp;
use alula_geometry::gaussian::chi_square_quantile;
use alula_messages::{Detection, Footprint, MAX_DEPTH_CAMERAS, Obstacle, ObstacleMotion, Sight};
use alula_parameters::{ParameterError, Parameters};
use nalgebra::Vector3;

use crate::Contour;
use crate::contour::is_too_late;
use associate::{Associator, Seen};
pub use config::{FlatConfig, MotionTestConfig, TrackLifeConfig, TrackModelConfig, TrackerConfig};
use faces::FACES;
use followed::Track;
use motion::MotionTest;
use sight::View;

/// A camera that has sent nothing for this long shows nothing any more, s.
const SILENT_S: f64 = 0.25;

/// Quantiles of chi-square.
#[derive(Clone, Debug)]
struct Gates {
    /// For comparisons of 0 to [`FACES`] sides.
    of_sides: [f64; FACES + 1],
}

impl Gates {
    fn new(config: &TrackerConfig) -> Self {
        let mut of_sides = [0.0; FACES + 1];
        for (degrees, gate) in (0_u32..).zip(of_sides.iter_mut()).skip(1) {
            *gate = chi_square_quantile(config.gate_probability, degrees);
        }
        Self { of_sides }
    }
}

/// Follows obstacles from image to image.
///
/// Round things are tracked at constant velocity with white acceleration by a Kalman filter over
/// position, velocity and lengths with its full covariance; what it measures are the sides of the
/// box that the image shows, so that a box that grows into view does not seem to move. Pieces of
/// walls stand. Detections and tracks are matched within gates at the greatest likelihood. Tracks
/// out of view keep their velocity until they are too far or too uncertain; tracks whose place is
/// seen to be free end. Allocates nothing after construction. See
/// `docs/derivations/tracking.md`.
#[derive(Clone, Debug)]
pub struct Tracker {
    config: TrackerConfig,
    gates: Gates,
    motion: MotionTest,
    associator: Associator,
    seen: Vec<Seen>,
    tracks: Vec<Track>,
    obstacles: Vec<Obstacle>,
    time: Option<Timestamp>,
    /// Time of the last image of each camera.
    images: [Option<Timestamp>; MAX_DEPTH_CAMERAS],
    next_id: u32,
}

impl Tracker {
    /// A tracker that knows of nothing.
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(config: &TrackerConfig) -> Result<Self, ParameterError> {
        config.validate()?;
        Ok(Self {
            gates: Gates::new(config),
            motion: MotionTest::new(&config.motion),
            associator: Associator::new(config.max_tracks, config.max_detections),
            seen: Vec::with_capacity(config.max_detections),
            tracks: Vec::with_capacity(config.max_tracks),
            obstacles: Vec::with_capacity(config.max_tracks),
            config: config.clone(),
            time: None,
            images: [None; MAX_DEPTH_CAMERAS],
            next_id: 0,
        })
    }

    /// Takes in one image: its detections, its contour, and where the vehicle was.
    ///
    /// An image that is not later than the last one of its camera, or [too late](Self::is_too_late),
    /// changes nothing. Detections that are not finite are left out. Returns [`Self::obstacles`].
    pub fn update(
        &mut self,
        time: Timestamp,
        detections: &[Detection],
        contour: &Contour,
        vehicle_world: &Vector3<f64>,
    ) -> &[Obstacle] {
        let is_too_late = self.is_too_late(time);
        let Some(image) = self.images.get_mut(usize::from(contour.sensor)) else {
            return &self.obstacles;
        };
        let since_s = |last: Option<Timestamp>| last.map_or(0.0, |last| time.seconds_since(last));
        if is_too_late || image.is_some_and(|last| time <= last) {
            return &self.obstacles;
        }
        let image_s = since_s(image.replace(time));
        let step_s = since_s(self.time).max(0.0);
        let time = self.time.map_or(time, |last| last.max(time));
        self.time = Some(time);
        self.predict(step_s);
        self.take(detections, contour, vehicle_world);
        self.associator.run(
            &self.config,
            &self.gates,
            time,
            &mut self.tracks,
            &mut self.seen,
        );
        self.correct(time, contour.sensor, image_s);
        self.judge_unseen(time, contour, image_s);
        self.forget(time, vehicle_world);
        self.recognise(time);
        self.start_new(time, contour.sensor, vehicle_world);
        self.publish(time);
        &self.obstacles
    }

    /// Obstacles after the last update, in the order in which they were first seen. Tracks that
    /// were seen once are among them, with velocity zero and its bounded variance.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// Whether an image of this time is older than the last one of all by more than
    /// [`MOST_LATE_S`](crate::MOST_LATE_S).
    pub fn is_too_late(&self, time: Timestamp) -> bool {
        is_too_late(time, self.time)
    }

    /// Moves all tracks along with an estimate of position that jumped, m.
    pub fn shift(&mut self, by_world: &Vector3<f64>) {
        if !by_world.iter().all(|x| x.is_finite()) {
            return;
        }
        for track in &mut self.tracks {
            track.shift(by_world);
        }
        for obstacle in &mut self.obstacles {
            obstacle.centre_world += by_world;
        }
    }

    /// Forgets all tracks, and the time of the last image. Numbers are not used again.
    pub fn clear(&mut self) {
        self.tracks.clear();
        self.obstacles.clear();
        self.time = None;
        self.images = [None; MAX_DEPTH_CAMERAS];
    }

    /// Predicts all tracks; those that become too uncertain would match anything and end.
    fn predict(&mut self, dt_s: f64) {
        for track in &mut self.tracks {
            track.predict(dt_s, &self.config.model);
        }
        let limit = self.config.life.keep_sigma_m;
        self.tracks.retain(|track| {
            track.footprint == Footprint::Flat || track.state.position_sigma_m() <= limit
        });
    }

    /// Chooses the usable detections, the nearest if they are too many, and reads their sides.
    fn take(&mut self, detections: &[Detection], contour: &Contour, vehicle: &Vector3<f64>) {
        let camera = if contour.rays.is_empty() {
            *vehicle
        } else {
            contour.camera_world
        };
        self.seen.clear();
        for (index, detection) in detections.iter().enumerate() {
            if !associate::is_usable(detection) {
                continue;
            }
            let distance_m = (detection.centre_world - camera).xy().norm();
            let place = if self.seen.len() < self.config.max_detections {
                None
            } else {
                let farthest = farthest_of(self.seen.iter().map(|seen| seen.distance_m));
                match farthest {
                    Some((place, farthest_m)) if distance_m < farthest_m => Some(place),
                    _ => continue,
                }
            };
            let hidden = associate::hidden_sides(detections, index);
            let noise = self.config.model.shape_noise_m;
            let seen = Seen::new(detection, &camera, hidden, noise, distance_m);
            match place {
                None => self.seen.push(seen),
                Some(place) => self.seen[place] = seen,
            }
        }
    }

    /// Corrects the tracks that were matched.
    fn correct(&mut self, time: Timestamp, sensor: u8, image_s: f64) {
        let Self {
            config,
            gates,
            motion,
            ..
        } = self;
        for seen in &self.seen {
            let Some(track) = seen.track.and_then(|index| self.tracks.get_mut(index)) else {
                continue;
            };
            let unseen_s = time.seconds_since(track.last_seen);
            track.sensor = sensor;
            if track.footprint == Footprint::Flat {
                let (flat, model) = (&config.flat, &config.model);
                flat::update(track, time, &seen.detection, &seen.faces, flat, model);
            } else {
                track.update(time, &seen.faces, gates, &config.model);
                // Two cameras may show it at the same time.
                motion.judge(track, image_s.min(unseen_s), &config.model);
            }
        }
    }

    /// Says of every track without detection why it has none.
    fn judge_unseen(&mut self, time: Timestamp, contour: &Contour, image_s: f64) {
        let life = &self.config.life;
        let doubt = if life.doubtful_s > 0.0 {
            life.ghost_s / life.doubtful_s
        } else {
            1.0
        };
        let associator = &self.associator;
        let shows_others = self
            .images
            .map(|image| image.is_some_and(|image| time.seconds_since(image) <= SILENT_S));
        for (index, track) in self.tracks.iter_mut().enumerate() {
            if associator.is_matched(index) {
                continue;
            }
            let mut view = sight::view(contour, track, life.view_margin_m);
            if view == View::Doubtful && associator.is_merged(index) {
                view = View::Hidden;
            }
            let is_others =
                track.sensor != contour.sensor && shows_others[usize::from(track.sensor)];
            if is_others && (track.sight == Sight::Seen || view == View::Outside) {
                continue;
            }
            track.sensor = contour.sensor;
            match view {
                View::Outside => track.sight = Sight::OutOfView,
                View::Hidden => track.sight = Sight::Hidden,
                View::Doubtful => {
                    track.sight = Sight::Missed;
                    track.missed_s += doubt * image_s;
                }
                View::Clear => {
                    track.sight = Sight::Missed;
                    track.misses += 1;
                    track.missed_s += image_s;
                }
            }
        }
    }

    /// Ends tracks that are gone, replaced, too old, too far or beyond numbers.
    fn forget(&mut self, time: Timestamp, vehicle_world: &Vector3<f64>) {
        let life = &self.config.life;
        let associator = &self.associator;
        let mut index = 0;
        self.tracks.retain(|track| {
            let replaced = associator.is_replaced(index);
            index += 1;
            let finite = track.state.is_finite();
            if (track.sight == Sight::Seen && !replaced) || !finite {
                return finite;
            }
            let unseen_s = time.seconds_since(track.last_seen);
            let distance_m = (track.position() - vehicle_world).xy().norm();
            let trusted = track.images >= life.confirm_images;
            let gone = if trusted {
                track.missed_s > life.ghost_s
            } else {
                track.misses >= life.tentative_misses
                    || track.missed_s > life.ghost_s
                    || unseen_s > life.tentative_keep_s
            };
            let old = track.motion != ObstacleMotion::Static && unseen_s > life.keep_s;
            !(replaced || gone || old || distance_m > life.keep_distance_m)
        });
    }

    /// Somebody new who appears where one who was lost may be is the one who was lost.
    fn recognise(&mut self, time: Timestamp) {
        let mut index = 0;
        while index < self.tracks.len() {
            let Some(lost) = self.lost_as(index, time) else {
                index += 1;
                continue;
            };
            let found = self.tracks.remove(index);
            let lost = if lost > index { lost - 1 } else { lost };
            self.tracks[lost].resume(&found);
        }
    }

    /// The nearest of the tracks that were lost and may be the one at `index`, which is new.
    fn lost_as(&self, index: usize, time: Timestamp) -> Option<usize> {
        let life = &self.config.life;
        let found = &self.tracks[index];
        if !found.is_fresh_round(life.confirm_images) {
            return None;
        }
        let may_be = |track: &Track| {
            track.is_lost()
                && time.seconds_since(track.last_seen) > life.merge_s
                && track.images >= life.confirm_images
                && track.apart_m(found) <= life.recognise_m
                && track
                    .distance_as(found)
                    .is_some_and(|distance| distance <= self.gates.of_sides[2])
        };
        let apart = |at: &usize| self.tracks[*at].apart_m(found);
        (0..self.tracks.len())
            .filter(|&at| at != index && may_be(&self.tracks[at]))
            .min_by(|a, b| apart(a).total_cmp(&apart(b)))
    }

    /// Starts a track for every detection that has none; without room, in place of a farther one.
    fn start_new(&mut self, time: Timestamp, sensor: u8, vehicle_world: &Vector3<f64>) {
        for seen in self.seen.iter().filter(|seen| seen.is_new()) {
            let footprint = seen.detection.footprint;
            let (id, model) = (self.next_id, &self.config.model);
            let mut track = Track::new(id, time, footprint, &seen.faces, model);
            track.sensor = sensor;
            let distance = |track: &Track| (track.position() - vehicle_world).xy().norm();
            if self.tracks.len() >= self.config.max_tracks {
                match farthest_of(self.tracks.iter().map(distance)) {
                    Some((place, farthest_m)) if distance(&track) < farthest_m => {
                        self.tracks.remove(place);
                    }
                    _ => continue,
                }
            }
            self.tracks.push(track);
            self.next_id = self.next_id.wrapping_add(1);
        }
    }

    fn publish(&mut self, time: Timestamp) {
        self.obstacles.clear();
        self.obstacles
            .extend(self.tracks.iter().map(|track| track.obstacle(time)));
    }
}

/// Index and value of the greatest distance.
fn farthest_of(distances: impl Iterator<Item = f64>) -> Option<(usize, f64)> {
    distances.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
}
